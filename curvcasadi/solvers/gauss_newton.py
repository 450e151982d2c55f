"""Gauss–Newton sequential quadratic programming on a condensed problem.

At x a problem is its `linearization`: objective f, gradient g, Hessian H, values c of the
constraints and their slopes A. A step d solves

    min ½ dᵀH d + gᵀd   within the limits of x + d and c + A d

A number of steps is taken in full (real-time iterations); otherwise steps are halved until the
objective and σ times the violation fall, but for what rounding adds, and the next ones are damped,
up to the optimality conditions. On a host a QP solver of CasADi takes the programs, in double
precision; generated C has its own, and damps those that its precision cannot solve.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from curvcasadi.solvers.certificate import TOLERANCES, Bounds, Tolerances, larger
from curvcasadi.solvers.stages import Stages
from curvcasadi.symbolic.expressions import Array, Real

#: The project's own solver: C on a target, CasADi's DAQP on the same numbers on a host.
OWN = "own"
_TIGHT = {"eps_abs": 1e-11, "eps_rel": 0.0}
_TIGHT_GAP = {"eps_duality_gap_abs": 1e-11, "eps_duality_gap_rel": 0.0}
_TIGHT_RESIDUALS = {f"res_{key}_max": 1e-12 if key in "gbd" else 1e-14 for key in "gbdm"}
_QUIET = {"verbose": False}
PLUGINS: dict[str, tuple[str, dict[str, Any]]] = {
    OWN: ("daqp", {"daqp": {"primal_tol": 1e-10, "dual_tol": 1e-12}}),
    "qrqp": ("qrqp", {"print_iter": False, "print_header": False, "print_info": False}),
    "qpoases": ("qpoases", {"printLevel": "none"}),
    "hpipm": ("hpipm", {"hpipm": {"mode": "balance", **_TIGHT_RESIDUALS}}),
    "piqp": ("piqp", {"piqp": {**_TIGHT, **_TIGHT_GAP}}),
    "osqp": ("osqp", {"osqp": {**_TIGHT, **_QUIET, "max_iter": 100_000, "polishing": True}}),
    "proxqp": ("proxqp", {"proxqp": {**_TIGHT, **_QUIET}}),
}

#: Factor of the objective for solvers with tolerances of their own that are too wide.
STRETCH = {"hpipm": 1e2, "piqp": 1e4, "proxqp": 1e2}

#: Rounding of a number of size 1.
EPSILON: dict[Real, float] = {"double": 2.3e-16, "float": 1.2e-7}
#: Decrease that a step must reach, over what its linearization promises.
ARMIJO = 1e-4
#: Penalty of violations over the largest multiplier.
PENALTY = 1.5
#: Factor of the damping where a step was too long, and divisor where it was not; the least that
#: counts, over the largest entry of the Hessian at rest.
DAMPING, LEAST_DAMPING = 4.0, 1e-7
#: Part of the tolerance of steps at which no more are taken.
STILL = 0.01
#: Between limits that coincide: DAQP refuses equalities that depend on each other.
_ROOM = 1e-10
#: Beyond all that is computed; a limit there is none.
FAR = 1e30


class Solution(NamedTuple):
    """The result of a solver; the last two fields are computed from it, not by the solver."""

    x: ca.MX
    values: ca.MX  #: of the constraints at x
    states: ca.MX  #: of the stages, one a column; empty where there are none
    violation: ca.MX  #: excess over bounds and constraints, Euclidean norm
    stationarity: ca.MX  #: distance from the optimality conditions over its tolerance


@dataclass(frozen=True, eq=False, kw_only=True)
class GaussNewton:
    """A problem and how it is solved.

    Attributes
    ----------
    name : str
        Prefix of its Functions.
    linearization : casadi.Function
        (x, p) -> objective, gradient, hessian, values, slopes, as in `stages.linearization`.
    values : casadi.Function
        (x, p) -> values of the constraints (m, 1), states (s, k).
    bounds : Bounds
        Numbers.
    real : str
        Precision that it will be solved in.
    iterations : int or None
        So many quadratic programs with full steps, or None to converge.
    max_iter, halvings : int
        Programs, and halvings of a step, at most, where it converges.
    residual_unit : float or None
        Size of a unit in the objective ½ |residual|²; the certificate then asks, too, what a
        Newton step would still take from the residual where the objective is soft.
    flat : float or None
        Curvature beside which that of the objective is none in that question. Unless given it is
        that of the precision, for a largest curvature of 1.
    stationarity : float or None
        Tolerance of gradient and idle multipliers in units of x, that of the precision unless
        given. 0 asks for what is left of the residual alone, multipliers times slack included: the
        bound of the distance to the optimum where no curvature is below one unit.
    first_damping : float
        Of the first steps where it converges, over the largest entry of the Hessian at rest: steps
        along a curved valley then do not end beyond its walls. Full steps take it away.
    enough : float
        Part of their tolerances at which it converged: no more steps are taken then.
    stages : Stages or None
        Where the linearization is condensed of.
    relative : bool
        Whether the objective has any size: what counts as none is relative to the largest diagonal
        entry of its Hessian then, which is near 1 otherwise.
    qp_solver : str
        "own", or a QP plugin of CasADi.
    """

    name: str
    linearization: ca.Function
    values: ca.Function
    bounds: Bounds
    real: Real
    iterations: int | None = None
    max_iter: int = 100
    halvings: int = 10
    residual_unit: float | None = None
    flat: float | None = None
    stationarity: float | None = None
    first_damping: float = 0.0
    enough: float = 0.1
    stages: Stages | None = None
    relative: bool = False
    qp_solver: str = OWN

    def __post_init__(self) -> None:
        plugin = PLUGINS.get(self.qp_solver, (self.qp_solver,))[0]
        if not isinstance(plugin, str) or not ca.has_conic(plugin):
            raise ValueError(
                f"qp_solver: expected 'own' or a QP solver of CasADi, found {self.qp_solver!r}"
            )

    @property
    def is_embeddable(self) -> bool:
        """Whether the solver in C takes its place."""
        return self.qp_solver == OWN

    @property
    def tolerances(self) -> Tolerances:
        """Of its precision."""
        return TOLERANCES[self.real]

    @property
    def flatness(self) -> float:
        """Curvature beside which that of the objective is none."""
        return self.tolerances.flat if self.flat is None else self.flat

    @property
    def still(self) -> float:
        """Tolerance of gradient and idle multipliers; 0 where these are not asked for."""
        chosen = self.stationarity
        return self.tolerances.stationarity if chosen is None else chosen

    @property
    def noise(self) -> float:
        """Of the objective ½ |residual|² by rounding of the residual, over its square root."""
        return 8 * EPSILON[self.real] * (self.residual_unit or 0.0)

    @property
    def n(self) -> int:
        """Unknowns."""
        return int(self.linearization.nnz_in(0))

    @property
    def m(self) -> int:
        """Constraints."""
        return int(self.linearization.nnz_out("values"))

    @property
    def passes(self) -> int:
        """Linearizations at most: of programs, and of shorter steps."""
        return self.iterations if self.iterations is not None else 2 * self.max_iter

    @cached_property
    def limits(self) -> tuple[Array, Array]:
        """(n + m,) lower and upper limits of x, then of the constraints."""
        b = self.bounds
        sides = ((b.lbx, b.lbg), (b.ubx, b.ubg))
        sizes = (self.n, self.m)
        return tuple(  # type: ignore[return-value]
            np.concatenate(
                [np.broadcast_to(np.ravel(part), size) for part, size in zip(s, sizes, strict=True)]
            ).astype(float)
            for s in sides
        )

    @cached_property
    def program(self) -> ca.Function:
        """(H triangle, g, Aᵀ, lower, upper) -> d, multipliers: one quadratic program."""
        n, m = self.n, self.m
        plugin, options = PLUGINS.get(self.qp_solver, (self.qp_solver, {}))
        if plugin == "hpipm":  # of one stage, whose inputs are the unknowns
            options = {**options, "N": 1, "nx": [0, 0], "nu": [n, 0], "ng": [m, 0]}
        triangle = self.linearization.sparsity_out("hessian")
        slopes = self.linearization.sparsity_out("slopes")
        shapes = {"h": ca.Sparsity.dense(n, n), "a": slopes.T}
        solve = ca.conic(f"{self.name}_qp", plugin, shapes, {**options, "error_on_fail": False})
        H, g = ca.MX.sym("H", triangle), ca.MX.sym("g", n)
        At = ca.MX.sym("At", slopes)
        lower, upper = ca.MX.sym("lower", n + m), ca.MX.sym("upper", n + m)
        full = ca.densify(ca.triu2symm(H))
        low, high = self.sides(lower, upper)
        sides = {"lbx": low[:n], "ubx": high[:n], "lba": low[n:], "uba": high[n:]}
        found = solve(h=full, g=g, a=At.T, **sides)
        return ca.Function(
            f"{self.name}_program",
            [H, g, At, lower, upper],
            [found["x"], ca.vertcat(found["lam_x"], found["lam_a"])],
            {"never_inline": True},
        )

    def sides(self, lower: ca.MX, upper: ca.MX) -> tuple[ca.MX, ca.MX]:
        """Limits as the solvers of CasADi take them.

        They raise for NaN. fmin and fmax overlook it: no limit is there then, and the certificate,
        which is NaN, says that the program was none.
        """
        return ca.fmin(ca.fmax(lower, -np.inf), FAR), ca.fmax(ca.fmin(upper, np.inf), -FAR)

    def step(self, x: ca.MX, at: list[ca.MX]) -> tuple[ca.MX, ca.MX, ca.MX]:
        """(d, multipliers, distance from its optimality conditions) of the program at x."""
        _, g, H, c, At = at
        lower, upper = (ca.DM(side) for side in self.limits)
        here = ca.vertcat(x, c)
        room = ca.DM(_ROOM * (self.limits[0] == self.limits[1]))
        unit = self.unit(H) / STRETCH.get(self.qp_solver, 1.0)
        sides = lower - here - room, upper - here + room
        d, multipliers = self.program(self.divided(H, unit), g / unit, At, *sides)
        multipliers = unit * multipliers
        left = self.curved(H, At, d) + g
        reached = here + ca.vertcat(d, self.changed(H, At, d))
        return d, multipliers, self.distance(H, left, At, reached, multipliers)

    def unit(self, H: ca.MX) -> ca.MX | float:
        """Size of the objective."""
        return ca.mmax(ca.diag(H)) if self.relative else 1.0

    def divided(self, H: ca.MX, unit: ca.MX | float) -> ca.MX:
        """H of the objective in units of its size."""
        return H / unit

    def damped(self, H: ca.MX, damping: ca.MX) -> ca.MX:
        """H with a damping, over the size of the objective."""
        return H + damping * self.unit(H) * ca.DM.eye(self.n)

    def curved(self, H: ca.MX, At: ca.MX, d: ca.MX) -> ca.MX:
        """H d."""
        return ca.triu2symm(H) @ d

    def changed(self, H: ca.MX, At: ca.MX, d: ca.MX) -> ca.MX:
        """A d, changes of the values."""
        return At.T @ d

    def pulled(self, H: ca.MX, At: ca.MX, multipliers: ca.MX) -> ca.MX:
        """Aᵀ times multipliers of the values."""
        return At @ multipliers

    def distance(
        self, H: ca.MX, gradient: ca.MX, At: ca.MX, reached: ca.MX, multipliers: ca.MX
    ) -> ca.MX:
        """Distance from the optimality conditions over its tolerance, in units of x.

        r = ∇f + Aᵀ λ_g + λ_x = 0, and multipliers only where their limit is reached; rᵀ H⁻¹ r is
        what a Newton step would take from |residual|².
        """
        lower, upper = (ca.DM(side) for side in self.limits)
        tolerances = self.tolerances
        # Not by indices: none of the entries of a scalar is a row.
        of_x, of_g = ca.vertsplit(multipliers, [0, self.n, self.n + self.m])
        unit = self.unit(H)
        left = gradient + of_x + self.pulled(H, At, of_g)
        multipliers = multipliers / unit
        pairs = [
            (ca.fmax(multipliers, 0), ca.fmax(upper - reached, 0)),
            (ca.fmax(-multipliers, 0), ca.fmax(reached - lower, 0)),
        ]
        errors = []
        if self.still > 0:
            idle = [ca.fmin(multiplier, slack) for multiplier, slack in pairs]
            errors = [part / self.still for part in (left / unit, *idle)]
        if self.residual_unit is not None:
            curved = ca.triu2symm(H) + unit * self.flatness * ca.DM.eye(self.n)
            gain = ca.dot(left, ca.solve(curved, left, "ldl"))
            if not errors:
                gain += unit * sum(ca.sum1(_product(*pair)) for pair in pairs)
            errors.append(ca.sqrt(gain) / (self.residual_unit * tolerances.decrement))
        return ca.norm_2(ca.vertcat(*errors))

    def violation(self, x: ca.MX, values: ca.MX) -> ca.MX:
        """Excess over the limits, Euclidean norm."""
        here = ca.vertcat(x, values)
        lower, upper = (ca.DM(side) for side in self.limits)
        return ca.norm_2(here - ca.fmin(ca.fmax(here, lower), upper))

    def within(self, x: ca.MX) -> ca.MX:
        """x, moved to within its bounds."""
        sides = [side[: self.n] for side in self.limits]
        if not np.any(np.isfinite(sides)):
            return x  # NaN, too
        lower, upper = map(ca.DM, sides)
        return ca.fmin(ca.fmax(x, lower), upper)

    def __call__(self, guess: ca.MX, p: ca.MX) -> Solution:
        """Solution from a guess, which is moved to within the bounds first."""
        if self.iterations is None:
            state = self.loop(self.begun(self.within(guess)), ca.repmat(p, 1, self.passes))
            parts = self.parts(state)
            x, stationarity = parts["x"], parts["distance"]
        else:
            x, stationarity = self.within(guess), ca.MX(0)
            for _ in range(self.iterations):
                d, _, stationarity = self.step(x, self.linearization.call([x, p]))
                x = self.within(x + d)
        values, states = self.values(x, p)
        return Solution(x, values, states, self.violation(x, values), stationarity)

    @property
    def _layout(self) -> dict[str, int]:
        n = self.n
        numbers = ("shrink", "merit", "change", "penalty", "damping", "halved", "distance", "done")
        return {"tried": n, "x": n, "d": n, "multipliers": n + self.m, **dict.fromkeys(numbers, 1)}

    def parts(self, state: ca.MX) -> dict[str, ca.MX]:
        """What the loop carries, by name."""
        found, at = {}, 0
        for key, size in self._layout.items():
            found[key] = state[at : at + size]
            at += size
        return found

    def _state(self, **changed: Any) -> ca.MX:
        return ca.vertcat(*(ca.densify(ca.MX(changed[key])) for key in self._layout))

    def begun(self, x: ca.MX) -> ca.MX:
        """State of the loop at a first point."""
        zeros = {key: ca.MX.zeros(size) for key, size in self._layout.items()}
        far = ca.MX(FAR)
        first = {"damping": ca.MX(DAMPING * self.first_damping)}  # divided where x is accepted
        return self._state(**zeros | first | {"tried": x, "x": x, "merit": far, "distance": far})

    @cached_property
    def loop(self) -> ca.Function:
        """State after at most `passes` points: (state, p a column a pass) -> state."""
        size = sum(self._layout.values())
        state, p = ca.MX.sym("state", size), ca.MX.sym("p", self.linearization.nnz_in(1))
        name = f"{self.name}_pass"
        rest = ca.Function(f"{name}_done", [state, p], [state])
        go = ca.Function.if_else(name, rest, self._try())
        done = self.parts(state)["done"]
        one = ca.Function(f"{name}_one", [state, p], [go(done, state, p)])
        return one.fold(self.passes)

    def _try(self) -> ca.Function:
        """(state, p) -> state: the tried point is accepted, or the step to it halved."""
        size = sum(self._layout.values())
        state, p = ca.MX.sym("state", size), ca.MX.sym("p", self.linearization.nnz_in(1))
        s = self.parts(state)
        at = self.linearization.call([s["tried"], p])
        symbols = [ca.MX.sym(f"at{i}", part.sparsity()) for i, part in enumerate(at)]
        lower, upper = (ca.DM(side[self.n :]) for side in self.limits)
        c = symbols[3]
        excess = ca.sum1(ca.fabs(c - ca.fmin(ca.fmax(c, lower), upper))) if self.m else ca.MX(0)

        more = ca.fmax(DAMPING * s["damping"], LEAST_DAMPING)
        shorter = {"shrink": s["shrink"] / 2, "halved": s["halved"] + 1, "damping": more}
        again = s | shorter | {"tried": self.within(s["x"] + shorter["shrink"] * s["d"])}
        halve = ca.Function(f"{self.name}_halve", [state, *symbols], [self._state(**again)])
        accept = ca.Function(
            f"{self.name}_accept", [state, *symbols], [self._accepted(s, symbols, excess)]
        )
        merit = ca.Function("merit", [state, *symbols], [symbols[0] + s["penalty"] * excess])
        merit_size = ca.fabs(s["merit"])
        rounding = 16 * EPSILON[self.real] * merit_size + self.noise * ca.sqrt(merit_size)
        allowed = s["merit"] + ARMIJO * s["shrink"] * s["change"] + rounding
        worse = ca.logic_and(
            ca.logic_not(merit(state, *at) <= allowed), s["halved"] < self.halvings
        )
        choose = ca.Function.if_else(f"{self.name}_choose", halve, accept)
        return ca.Function(f"{self.name}_try", [state, p], [choose(worse, state, *at)])

    def _accepted(self, s: dict[str, ca.MX], at: list[ca.MX], excess: ca.MX) -> ca.MX:
        """State after the tried point: done, or with the step from there."""
        f, g, H, c, At = at
        x = s["tried"]
        here = ca.vertcat(x, c)
        stationarity = self.distance(H, g, At, here, s["multipliers"])
        violation = self.violation(x, c) / self.tolerances.limit
        moved = s["shrink"] * ca.norm_inf(s["d"])
        still = ca.logic_and(s["shrink"] > 0, moved <= STILL * self.tolerances.step)
        is_done = ca.logic_or(larger(stationarity, violation) <= self.enough, still)
        same = s | {"x": x, "distance": stationarity}
        full = s["halved"] < 1
        damping = ca.if_else(full, s["damping"] / DAMPING, s["damping"])
        damping = ca.if_else(damping < LEAST_DAMPING, 0, damping)
        d, multipliers, _ = self.step(x, [f, g, self.damped(H, damping), c, At])
        largest = ca.norm_inf(multipliers[self.n :]) if self.m else ca.MX(0)
        penalty = ca.fmax(s["penalty"], PENALTY * largest)
        on = same | {
            "tried": self.within(x + d),
            "d": d,
            "multipliers": multipliers,
            "shrink": ca.MX(1),
            "halved": ca.MX(0),
            "damping": damping,
            "penalty": penalty,
            "merit": f + penalty * excess,
            "change": ca.dot(g, d) - penalty * excess,
        }
        done = same | {"done": ca.MX(1)}
        return ca.if_else(is_done, self._state(**done), self._state(**on), True)


def _product(multiplier: ca.MX, slack: ca.MX) -> ca.MX:
    """Multipliers times slack, of which either may be zero and the other infinite."""
    return ca.fmin(multiplier, FAR) * ca.if_else(multiplier > 0, slack, 0)
