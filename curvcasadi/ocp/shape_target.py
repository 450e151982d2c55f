"""Shape targets as one Function, solved by sequential quadratic programming: exportable as C."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import casadi as ca
import numpy as np

from curvcasadi.beam.beam import Beam, numeric_length
from curvcasadi.ocp.limits import Limits, Regularizer, regularizer_matrix, shape_limits
from curvcasadi.ocp.targets import (
    Residuals,
    Target,
    checked_problem,
    residuals,
    rest_values,
    rotations_defect,
    slopes,
)
from curvcasadi.solvers.certificate import TOLERANCES, Bounds, larger
from curvcasadi.solvers.embedded import EmbeddedSolver, solver_function
from curvcasadi.solvers.gauss_newton import GaussNewton
from curvcasadi.solvers.settings import SqpSettings, sqp_settings
from curvcasadi.solvers.stages import linearization
from curvcasadi.symbolic.expressions import Number, Real, function_name, positive

#: (weight of the preference in the objective, the same in the Hessian), stage by stage. From a
#: stronger preference, which leads to the right valley, to ever weaker ones, with which multipliers
#: converge along directions that the targets hardly see, and to none: last steps onto the targets.
#: Twice the weight in the Hessian damps Gauss–Newton, which does not know the curvature of the
#: constraint. In single precision programs are rounded by 6e-8: with a weight of 3e-8 alone the way
#: onto the targets moved weights that these do not see by 1.5e-3 rad/m, and with 3e-8 at last
#: targets were missed where torsion alone, of a wing that is hardly bent, moves the tip onto them.
_STAGES: dict[Real, tuple[tuple[float, float], ...]] = {
    "double": ((1e-3, 1e-3), (1e-4, 2e-4), (1e-5, 2e-5), (1e-6, 2e-6), (1e-7, 2e-7), (0.0, 1e-9)),
    "float": ((1e-3, 1e-3), (1e-4, 2e-4), (0.0, 1e-6), (0.0, 3e-8), (0.0, 1e-9)),
}
_PREFERENCE_ONLY = ((1.0, 1.0),)
#: Part of its tolerance to which a stage is solved: a weak preference hides in more.
_ENOUGH: dict[Real, float] = {"double": 1e-5, "float": 0.01}
#: Of the guess where the solver converges, times the length, rad.
_BEND = 1e-5

#: Of real-time iterations: `python -m benchmarks` shows how six wings follow a path with others.
DAMPING = 1e-3
#: Where it converges with weights for all targets: more than single precision rounds; in double as
#: much as the regularization, so that full steps along directions that targets do not see halve
#: what is left: without, those of hard cases overshoot for ever; with ten times as much all creep.
_LEAST_DAMPING: dict[Real, float] = {"double": 1e-8, "float": 1e-6}
#: Of its first steps, which from a straight wing end far from where the residual falls.
_FIRST_DAMPING: dict[Real, float] = {"double": 1e-2, "float": 0.0}


def shape_target_function(
    beam: Beam,
    targets: Sequence[Target],
    *,
    name: str = "shape_target",
    curvature_bound: Number | None = None,
    regularizer: Regularizer = "smoothness",
    regularization: float = 1e-8,
    iterations: int | None = None,
    max_iter: int = 100,
    damping: float | None = None,
    qp_solver: str = "own",
    settings: SqpSettings | None = None,
) -> ca.Function:
    """`reach_shape` as one Function, which becomes self-contained C.

    The unweighted targets e(q) = 0, over xi² for positions and xi for attitudes, are met by the
    method of multipliers: with y ← y + e, each stage minimizes

        ½ |e|² + y·e + a (½ Σ weight (|Δp|²/L² + |Δφ|²) + ½ regularization qᵀ W q)

    by Gauss–Newton, within the bounds of `reach_shape`; a falls to zero.
    One solver serves all stages, so that generated C holds it once. Redundant targets are no
    obstacle. It follows one guess into one valley: `reach_shape` tries several, and finds the
    nearest shape to unreachable targets, which this need not. Where every target is weighted there
    is one stage.

    Parameters
    ----------
    beam : Beam
        Beam with numeric fields.
    targets : sequence of Target
        Stations and kinds; their numbers arrive as inputs.
    name : str
        Name of the Function, also in generated C.
    curvature_bound, regularizer : optional
        As of `reach_shape`.
    regularization : float
        As of `reach_shape`. Where every target is weighted, Gauss–Newton converges slowly if
        residuals stay: for targets that may be out of reach take 1e-4 where it converges.
    iterations : int, optional
        None to converge; k for k quadratic programs with full steps, from the last solution as
        guess, where every target is weighted.
    max_iter : int
        Iterations of one stage at most; there are six stages (with `Grid(real="float")` five), or
        one.
    damping : float, optional
        Weight of ½ (q − q_guess)ᵀ W (q − q_guess) in every program, dimensionless: steps stay near
        the guess where targets hardly see. A converged shape is the same with any. Unless given it
        is 1e-3 with `iterations`, of which full steps without damping wander off where the path
        leaves reach, and where it converges 0, or with weights for all targets 1e-8, at most the
        regularization (in single precision 1e-6: with less, rounding makes programs singular whose
        targets do not see all weights).
    qp_solver : str
        "own" becomes self-contained C; in Python it is CasADi's DAQP on the same numbers. Or
        another of CasADi's QP solvers, such as "qpoases", for Python alone.
    settings : SqpSettings, optional
        Values of iterations, max_iter and qp_solver in one object, in place of these.

    Returns
    -------
    casadi.Function
        Inputs: q_guess (n, 1), rad/m; positions (3, P), m, if any; rotations (3, 3 R), if any; in
        the order of `targets`. Outputs: q (n, 1), rad/m; distances (P, 1), m; angles (R, 1), rad;
        violation (1, 1): the largest error of an unweighted target over its tolerance, or excess
        over a limit of weights, curvature (rad/m) or squared element angle (rad²) over 1e-6 (float:
        1e-5), or error of a target's rotation that is none over 1e-3, at most 1 where all is kept;
        stationarity (1, 1): what is left of the optimality conditions (of the last programs, for
        `iterations`) over 1e-8 rad/m (float: 1e-6), and what a Newton step would still take from
        the residual over 1e-6 (float: 1e-4), at most 1 where it converged; compromise (1, 1), where
        targets are weighted: the largest error of one, over 1e-6 (float: 1e-5) of the length or
        rad: at most 1 where all are reached; above, the shape is a compromise between weights,
        regularizer and limits, which misses them by `distances` and `angles`. It does not raise,
        but for NaN inputs, or where its steps lead to what cannot be computed: check violation and
        stationarity. From an
        exactly straight guess a target on the beam's axis has no gradient: guess a slight bend.
    """
    function_name("name", name)
    targets = checked_problem(beam, targets)
    solving = sqp_settings(settings, iterations=iterations, max_iter=max_iter, qp_solver=qp_solver)
    positive("regularization", regularization)
    q = ca.MX.sym("q", beam.basis.n)
    problem = residuals(beam, targets, q)
    is_to_be_met = len(problem.tolerances) > 0
    if damping is None:
        damping = DAMPING
        if solving.iterations is None:
            damping = 0.0 if is_to_be_met else _least_damping(beam.grid.real, regularization)
    positive("damping", damping, zero=True)
    if solving.iterations is not None and is_to_be_met:
        raise ValueError(
            "iterations: expected None, or a weight for every target (least squares): targets to "
            "be met take several stages"
        )
    preference = regularizer_matrix(beam, regularizer)
    limits = shape_limits(beam, q, curvature_bound)
    rounds = _STAGES[beam.grid.real] if is_to_be_met else _PREFERENCE_ONLY
    described = _Linearized(
        beam=beam,
        targets=targets,
        q=q,
        problem=problem,
        preference=preference * (float(regularization) if problem.weighted.numel() else 1.0),
        damping=ca.sparsify(preference * float(damping)),
        limits=limits,
    )
    unit = 1 / described.largest()
    linearized = described.function(f"{name}_linearization", unit)
    solver = GaussNewton(
        name=f"{name}_stage",
        linearization=linearized,
        values=ca.Function(
            f"{name}_values",
            [q, linearized.mx_in(1)],
            [ca.densify(limits.expression), ca.MX(0, 1)],
        ),
        bounds=Bounds(*beam.bounds, limits.lower, limits.upper),
        real=beam.grid.real,
        residual_unit=_residual_unit(targets) * unit**0.5,
        first_damping=0.0 if is_to_be_met else _FIRST_DAMPING[beam.grid.real],
        flat=0.0 if is_to_be_met else None,
        enough=_ENOUGH[beam.grid.real] if len(rounds) > 1 else 0.1,
        **vars(solving),
    )
    bend = 0.0 if solving.iterations else _BEND / numeric_length(beam, "a shape target")
    begin, finish = _ends(name, beam, problem, rounds[0], q, bend)
    steps = [(a / last if a else 0.0, a, b) for (last, _), (a, b) in pairwise(rounds)]
    return solver_function(
        name,
        EmbeddedSolver(
            problem=solver,
            begin=begin,
            finish=finish,
            advance=_advance(name, problem, q),
            rounds=steps,
        ),
    )


def _least_damping(real: Real, regularization: float) -> float:
    """More than the regularization would slow the last steps in double precision."""
    least = _LEAST_DAMPING[real]
    return least if real == "float" else min(least, float(regularization))


def _residual_unit(targets: Sequence[Target]) -> float:
    """Size of a unit of the largest residual in the objective."""
    return max([1.0, *(float(t.weight) ** 0.5 for t in targets if t.weight is not None)])


@dataclass(frozen=True, eq=False, kw_only=True)
class _Linearized:
    """One stage at q; its parameters are values of the targets, multipliers y, a and b."""

    beam: Beam
    targets: list[Target]
    q: ca.MX
    problem: Residuals
    preference: ca.DM
    damping: ca.DM
    limits: Limits

    def largest(self) -> float:
        """Largest diagonal entry of the Hessian at rest."""
        f = self.function("at_rest", 1.0)
        multipliers = ca.DM.zeros(self.problem.to_meet.numel())
        at = f(0, ca.vertcat(rest_values(self.beam, self.targets), multipliers, 1, 1))
        return float(ca.mmax(ca.diag(at[2])))

    def function(self, name: str, unit: float) -> ca.Function:
        """(q, parameters) -> objective, gradient, hessian, values, slopes: over `unit`."""
        y = ca.MX.sym("multipliers", self.problem.to_meet.numel())
        a, b = ca.MX.sym("a"), ca.MX.sym("b")
        (e, e_q), (w, w_q) = slopes(self.beam, self.targets, self.q, self.problem)
        # An inner station moves less than the tip: as it is, its error would yield to the rest.
        arms = ca.DM(self.problem.leverages)
        e, e_q = e / arms, e_q / ca.repmat(arms, 1, e_q.shape[1])
        preferred = self.preference @ self.q
        values = ca.veccat(*_symbols(self.problem))
        objective = ca.sumsqr(e) / 2 + ca.dot(y, e)
        objective += a * (ca.sumsqr(w) + ca.dot(self.q, preferred)) / 2
        gradient = e_q.T @ (e + y) + a * (w_q.T @ w + preferred)
        hessian = e_q.T @ e_q + b * (w_q.T @ w_q + self.preference) + self.damping
        constraints = self.limits.expression
        outputs = [objective, gradient, hessian, constraints, ca.jacobian(constraints, self.q).T]
        # Graphs in one export that differ by a term have different names.
        graph = ca.Function(
            "stage" if self.damping.nnz() else "undamped_stage",
            [self.q, *_symbols(self.problem), y, a, b],
            [unit * x for x in outputs[:3]],
        )
        limits = ca.Function("limits", [self.q], outputs[3:])
        x, stacked = ca.MX.sym("x", self.q.numel()), ca.MX.sym("p", values.numel() + y.numel() + 2)
        ends = np.cumsum([0, values.numel(), y.numel(), 1, 1]).tolist()
        pieces = ca.vertsplit(stacked, ends)
        shaped = _shaped(self.problem, pieces[0])
        at = [*graph(x, *shaped, *pieces[1:]), *limits(x)]
        return linearization(name, x, stacked, *at)


def _ends(
    name: str, beam: Beam, problem: Residuals, first: tuple[float, float], q: ca.MX, bend: float
) -> tuple[ca.Function, ca.Function]:
    """What the solver begins from, and what is made of its solution."""
    given = {"q_guess": ca.MX.sym("q_guess", beam.basis.n)}
    given |= {"positions": problem.positions, "rotations": problem.rotations}
    inputs = {key: symbol for key, symbol in given.items() if symbol.numel()}
    values = ca.veccat(problem.positions, problem.rotations)
    multipliers = ca.DM.zeros(problem.to_meet.numel())
    lower, upper = (ca.DM(side) for side in beam.bounds)
    kept = ca.fmin(ca.fmax(inputs["q_guess"], lower), upper)
    begin = ca.Function(
        f"{name}_solver_begin",
        [*inputs.values()],
        [kept + _slight(beam.basis.n, bend), ca.vertcat(values, multipliers, *first)],
        [*inputs],
        ["start", "parameters"],
    )
    found, states = ca.MX.sym("found", beam.basis.n), ca.MX.sym("states", 0, 1)
    excess, distance, before = (ca.MX.sym(key) for key in ("excess", "distance", "before"))
    outcome = ca.Function(
        f"{name}_outcome",
        [q, values],
        [problem.distances, problem.angles, _violated(problem), _compromise(problem)],
    )
    distances, angles, violated, compromise = outcome(found, values)
    results = {
        "q": found,
        "distances": distances,
        "angles": angles,
        "violation": larger(violated, excess / TOLERANCES[beam.grid.real].limit),
        "stationarity": larger(distance, before),
        "compromise": compromise,
    }
    given = {key: value for key, value in results.items() if value.numel()}
    finish = ca.Function(
        f"{name}_solver_finish",
        [*inputs.values(), found, states, excess, distance, before],
        [*given.values()],
        [*inputs, "found", "states", "excess", "distance", "before"],
        [*given],
    )
    return begin, finish


def _slight(n: int, bend: float) -> ca.DM:
    """A bend that no symmetry has: steps from a symmetric guess would never leave it."""
    return ca.DM(bend * np.random.default_rng(0).uniform(0.5, 1, n) * (-1) ** np.arange(n))


def _advance(name: str, problem: Residuals, q: ca.MX) -> ca.Function:
    """(q, parameters, (a over the last one, a, b)) -> parameters of the next stage: y ← y + e."""
    values = ca.veccat(problem.positions, problem.rotations)
    y, last = ca.MX.sym("multipliers", problem.to_meet.numel()), ca.MX.sym("last", 2)
    settings = ca.MX.sym("settings", 3)
    error = problem.to_meet / ca.DM(problem.leverages)
    following = ca.vertcat(values, settings[0] * (y + error), settings[1:])
    parts = [values, y, last]
    stacked = ca.MX.sym("parameters", sum(part.numel() for part in parts))
    graph = ca.Function("advance", [q, *_symbols(problem), y, last, settings], [following])
    pieces = ca.vertsplit(stacked, [0, *np.cumsum([part.numel() for part in parts]).tolist()])
    positions, rotations = _shaped(problem, pieces[0])
    return ca.Function(
        f"{name}_solver_advance",
        [q, stacked, settings],
        [graph(q, positions, rotations, *pieces[1:], settings)],
    )


def _symbols(problem: Residuals) -> list[ca.MX]:
    return [problem.positions, problem.rotations]


def _shaped(problem: Residuals, values: ca.MX) -> list[ca.MX]:
    """Positions and rotations of their stacked values."""
    size = problem.positions.numel()
    pieces = values[:size], values[size:]
    return [ca.reshape(v, *s.shape) for v, s in zip(pieces, _symbols(problem), strict=True)]


def _violated(problem: Residuals) -> ca.MX:
    """Largest error of a target to be met over its tolerance, or of a rotation that is none."""
    errors = ca.fabs(problem.to_meet) / problem.tolerances
    return ca.mmax(ca.vertcat(rotations_defect(problem.rotations), errors))


def _compromise(problem: Residuals) -> ca.MX:
    """Largest error of a weighted target over the tolerance of one to be met; empty without any."""
    if not problem.missed.numel():
        return ca.MX(0, 1)
    return ca.mmax(ca.fabs(problem.missed))
