"""How a trim is found: Newton's method, or what comes nearest within bounds, then the best."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np

from curvcasadi.aero import AerodynamicLoad, Flow, LiftingLine, StripForces, strip_forces
from curvcasadi.aero.induced import line_of_wing
from curvcasadi.aircraft.parts import Aircraft
from curvcasadi.aircraft.trim_case import Case, case_bounds, check_settled, free_bounds
from curvcasadi.aircraft.trim_problem import (
    BALANCES,
    LATERAL,
    MOTION,
    PATH,
    TOLERANCE,
    Hessian,
    Objective,
    TrimProblem,
    at_root,
)
from curvcasadi.aircraft.trim_result import (
    TrimResult,
    bounds_that_hold,
    failure_message,
    wing_shape,
)
from curvcasadi.errors import ConvergenceError
from curvcasadi.solvers.interrupt import solved
from curvcasadi.symbolic.expressions import Array, expression, instance, positive

#: What Newton's method leaves as it is.
_ROUNDING = 1e-13
#: Largest change of a scaled unknown in one of Newton's steps, and their number.
_LARGEST_STEP, _NEWTON_STEPS = 1.5, 20


class TrimSolver:
    """The two NLPs of a trim, built once: nearest to balance, then best."""

    def __init__(
        self,
        aircraft: Aircraft,
        objective: Objective,
        hessian: Hessian,
        induced_flow: LiftingLine | None = None,
        *,
        turning: bool = False,
    ) -> None:
        if not isinstance(aircraft, Aircraft):
            raise ValueError(f"aircraft: expected an Aircraft, found {aircraft!r}")
        if induced_flow is not None:
            instance("induced_flow", induced_flow, LiftingLine)
        self.problem = problem = TrimProblem(aircraft, induced_flow, turning=turning)
        self.objective = objective
        self._nearest = problem.nearest()
        self._best = None if objective is None else problem.best(objective, hessian)
        wrenches = [*problem.rigid.values(), *problem.wrenches.values()]
        energies = problem.objective("strain_energy") * problem.length
        outputs = [problem.balances, problem.residuals, problem.flight.attitude]
        outputs += [problem.flight.flow.velocity, problem.drag(), energies, ca.horzcat(*wrenches)]
        self._evaluate = ca.Function("trim", [problem.x, problem.p], outputs)
        conditions = ca.vertcat(problem.balances, problem.residuals)
        self._slope = ca.Function(
            "slope", [problem.x, problem.p], [ca.densify(ca.jacobian(conditions, problem.x))]
        )

    def solve(self, case: Case, guess: TrimResult | None, throw: bool) -> TrimResult:
        """The trim of one case."""
        p = self._parameters(case)
        lower, upper = case_bounds(case, self.problem, p)
        start = np.clip(self._start(case, guess, p), lower, upper)
        slope = self._slope(start, p).full()
        if self.objective is None:
            check_settled(case, self.problem, (lower, upper), slope[self._rows(case)])
        x, iterations = self._newton(case, start, p, lower, upper)
        converged = self._missed(case, x, p) <= TOLERANCE
        if not converged:
            x, stats = _run(self._nearest, start, p, lower, upper, *self._on_path(case))
            iterations += int(stats["iter_count"])
            converged = bool(stats["success"])
            ahead, further = self._newton(case, x, p, lower, upper)
            if self._missed(case, ahead, p) <= TOLERANCE:
                x, iterations = ahead, iterations + further
        if self._best is not None and self._missed(case, x, p) <= TOLERANCE:
            inputs = np.flatnonzero(lower < upper)
            inputs = inputs[(inputs >= len(MOTION)) & (inputs < len(self.problem.names))]
            turned = np.abs(slope[list(LATERAL)][:, inputs]) > TOLERANCE
            sides = self._conditions(case, lateral=case.lateral or bool(np.any(turned)))
            best, stats = _run(self._best, x, p, lower, upper, *sides)
            iterations += int(stats["iter_count"])
            met = self._missed(case, best, p) <= TOLERANCE
            x, converged = (best, bool(stats["success"])) if met else (x, False)
        result = self._result(case, p, x, (lower, upper), converged, iterations)
        if throw and not result.trimmed:
            raise ConvergenceError(result.message, result)
        return result

    def _start(self, case: Case, guess: TrimResult | None, p: Array) -> Array:
        """The guess, banked as a turn is: the scaled turn rate is the tangent of the bank angle."""
        size = self.problem.x.shape[0]
        if guess is None:
            start = np.zeros(size)
        elif not isinstance(guess, TrimResult) or len(guess.unknowns) != size:
            raise ValueError("guess: expected a TrimResult of the same aircraft, found another")
        else:
            start = guess.unknowns.copy()
        if case.turn is not None:
            roll, rate = (self.problem.names.index(name) for name in ("roll", "turn_rate"))
            held = case.held_motion()
            tangent = held.get("turn_rate", 0.0) / float(self.problem.scales(p)[rate])
            bank = held.get("roll", float(np.arctan(tangent)))
            start[[roll, rate]] = bank, np.tan(bank)
        return start

    def _rows(self, case: Case) -> Array:
        """Which of the balances and further conditions a case has."""
        rows = np.ones(len(BALANCES) + self.problem.residuals.shape[0], dtype=bool)
        rows[len(BALANCES) :][: len(PATH)] = case.flight_path is not None, case.coordinated
        return rows

    def _newton(
        self, case: Case, x: Array, p: Array, lower: Array, upper: Array
    ) -> tuple[Array, int]:
        """Newton's method on all conditions while it comes closer; bounds stop it.

        Least squares, because symmetry makes some conditions redundant and free inputs may be too
        many: then the step is the smallest.
        """
        free, missed, rows = lower < upper, self._missed(case, x, p), self._rows(case)
        for iteration in range(_NEWTON_STEPS):
            balances, residuals, *_ = self._evaluate(x, p)
            conditions = np.append(balances.full(), residuals.full())[rows]
            slope = self._slope(x, p).full()[np.ix_(rows, free)]
            step = np.zeros(len(x))
            step[free] = np.linalg.lstsq(slope, -conditions, rcond=1e-12)[0]
            step *= min(1.0, _LARGEST_STEP / max(np.max(np.abs(step)), _LARGEST_STEP))
            ahead = np.clip(x + step, lower, upper)
            left = self._missed(case, ahead, p)
            if not left < missed or missed <= _ROUNDING:
                return x, iteration
            x, missed = ahead, left
        return x, _NEWTON_STEPS

    def _parameters(self, case: Case) -> Array:
        """`PARAMETERS`; the weight is what the aircraft weighs in still, empty air."""
        speed, density = positive("speed", case.speed), positive("density", case.density)
        gravity = positive("gravity", case.gravity)
        path = 0.0 if case.flight_path is None else case.flight_path
        path = float(expression("flight_path", path, (1, 1)))
        if not -np.pi / 2 < path < np.pi / 2:
            raise ValueError(f"flight_path: expected an angle within ±π/2 rad, found {path}")
        p = np.array([speed, density, gravity, np.sin(path), 1.0])
        unknown = np.zeros(self.problem.x.shape[0])
        heavy, weightless = (
            self._evaluate(unknown, np.array([speed, 0.0, g, 0.0, 1.0]))[0] for g in (gravity, 0.0)
        )
        p[-1] = float(heavy[2] - weightless[2])
        return p

    def _on_path(self, case: Case) -> tuple[Array, Array]:
        """Bounds of the climb, of the side force, and of the residuals of the wings."""
        slack = np.zeros(len(PATH) + sum(self.problem.sizes))
        slack[0] = np.inf if case.flight_path is None else 0.0
        slack[1] = 0.0 if case.coordinated else np.inf
        return -slack, slack

    def _conditions(self, case: Case, *, lateral: bool) -> tuple[Array, Array]:
        """Bounds of the balances, too.

        What symmetry keeps at zero is no equation there: it would be one without an unknown.
        """
        slack = np.zeros(len(BALANCES))
        if not lateral:
            slack[list(LATERAL)] = np.inf
        low, high = self._on_path(case)
        return np.append(-slack, low), np.append(slack, high)

    def _missed(self, case: Case, x: Array, p: Array) -> float:
        balances, residuals, *_ = self._evaluate(x, p)
        low, high = self._on_path(case)
        left = residuals.full().ravel()
        left = left - np.clip(left, low, high)
        return float(np.max(np.abs(np.append(balances.full(), left))))

    def _result(
        self,
        case: Case,
        p: Array,
        x: Array,
        bounds: tuple[Array, Array],
        converged: bool,
        iterations: int,
    ) -> TrimResult:
        problem, aircraft = self.problem, self.problem.aircraft
        values = self._evaluate(x, p)
        balances, residuals, attitude, velocity, drag, energy, wrenches = values
        found = problem.unknowns(ca.DM(x), p)
        named = {name: float(found[name]) for name in problem.names}
        q = {wing.name: found[wing.name] for wing in aircraft.beams}
        on_body = ca.horzsplit(wrenches)[len(problem.rigid) :]
        scales = p[-1] * np.repeat([1.0, problem.arm], 3)
        active = bounds_that_hold(problem, x, bounds, p)
        edges = np.cumsum([len(PATH), *problem.sizes])
        left = {
            wing.name: float(np.max(np.abs(residuals.full()[a:b])) * p[-1] * problem.length**2)
            for wing, (a, b) in zip(aircraft.beams, pairwise(edges), strict=True)
        }
        missed = self._missed(case, x, p)
        limit = TOLERANCE * p[-1] * problem.length**2
        path = np.abs(residuals.full().ravel()[: len(PATH)])
        kept = (case.flight_path is not None, case.coordinated)
        others = [
            name for name, r, on in zip(PATH, path, kept, strict=True) if on and r > TOLERANCE
        ]
        others += [f"wing {n} is out of equilibrium" for n, r in left.items() if r > limit]
        held = active if converged else None
        failure = failure_message(balances.full().ravel(), scales, others, held, case.remedy)
        trimmed = missed <= TOLERANCE
        return TrimResult(
            speed=float(p[0]),
            gravity=float(p[2]),
            **{name: named[name] for name in MOTION},
            coordinated=case.coordinated,
            flight_path=float(np.arcsin(np.clip(-float((attitude @ velocity)[2]) / p[0], -1, 1))),
            inputs={name: named[name] for name in aircraft.inputs},
            input_units=dict(aircraft.inputs),
            q=q,
            shapes={w.name: wing_shape(w.beam, q[w.name], trimmed) for w in aircraft.beams},
            root_loads={
                wing.name: at_root(wing, wrench).full().ravel()
                for wing, wrench in zip(aircraft.beams, on_body, strict=True)
            },
            airloads=self._airloads(p, attitude, velocity, q, named),
            strain_energy=float(energy) * p[-1],
            drag=float(drag),
            balances=dict(zip(BALANCES, (balances.full().ravel() * scales).tolist(), strict=True)),
            equilibrium_residuals=left,
            trimmed=trimmed,
            converged=converged,
            iterations=iterations,
            active_bounds=active,
            message=_outcome(case, failure, converged, iterations),
            unknowns=x,
            bounds=free_bounds(problem, bounds, p),
            path_is_free=case.flight_path is None,
        )

    def _airloads(
        self,
        p: Array,
        attitude: ca.DM,
        velocity: ca.DM,
        q: dict[str, ca.DM],
        named: dict[str, float],
    ) -> dict[str, StripForces]:
        rate = named["turn_rate"] * attitude[2, :].T
        flow = Flow(density=p[1], velocity=velocity, angular_rate=rate)
        found = {}
        for wing in self.problem.aircraft.beams:
            if wing.strips is None:
                continue
            deflections = {name: named[name] for name in wing.strips.inputs}
            load = AerodynamicLoad(
                strips=wing.strips,
                flow=flow,
                deflections=deflections,
                induced_flow=line_of_wing(self.problem.induced_flow, wing.name),
            )
            found[wing.name] = strip_forces(wing.beam, q[wing.name], load)
        return found


def _outcome(case: Case, failure: str, converged: bool, iterations: int) -> str:
    """What a search found, in words."""
    if not failure:
        return "trimmed" if converged else "trimmed, not optimal"
    if converged:
        return f"no trim at {case.flight}: {failure}"
    return (
        f"trim at {case.flight} did not converge in {iterations} iterations, so that there may be "
        f"one; try another guess. Where it stopped, {failure}"
    )


def _run(
    nlp: ca.Function, x: Array, p: Array, lower: Array, upper: Array, *sides: Array
) -> tuple[Array, dict[str, Any]]:
    low, high = sides[0], sides[-1]
    start = np.clip(x, lower, upper)
    solution, stats = solved(nlp, x0=start, p=p, lbx=lower, ubx=upper, lbg=low, ubg=high)
    return np.clip(solution["x"].full().ravel(), lower, upper), stats
