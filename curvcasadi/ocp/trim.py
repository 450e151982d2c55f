"""Trim: attitude, inputs and shape of a flexible aircraft in steady straight flight."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
from tqdm import tqdm

from curvcasadi.aero import AerodynamicLoad, Flow, StripForces, strip_forces
from curvcasadi.aircraft import Aircraft
from curvcasadi.errors import ConvergenceError
from curvcasadi.expressions import Array, choice, expression, positive
from curvcasadi.ocp.trim_problem import (
    ANGLES,
    BALANCES,
    LATERAL,
    Objective,
    TrimProblem,
    at_root,
    bounds_of,
)
from curvcasadi.ocp.trim_result import TrimResult
from curvcasadi.shape import shape_map

#: What counts as zero, in the scales of `TrimProblem`.
TOLERANCE = 1e-8
#: Standard gravity, m/s².
STANDARD_GRAVITY = 9.80665


def trim(
    aircraft: Aircraft,
    *,
    speed: float,
    density: float,
    gravity: float = STANDARD_GRAVITY,
    flight_path: float | None = 0.0,
    free: Sequence[str] = (),
    inputs: Mapping[str, float] | None = None,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    objective: Objective = None,
    guess: TrimResult | None = None,
    throw: bool = True,
) -> TrimResult:
    """Steady straight flight of `aircraft` at `speed`.

    Unknowns are the angle of attack, the pitch angle, the weights of the wings and the inputs;
    conditions are the balance of forces and moments about the body origin, the flight path, and
    equilibrium of every wing. First the unknowns come as near to balance as bounds let them; then,
    if `objective` is given, it chooses among all that balance.

    Parameters
    ----------
    speed, density, gravity : m/s, kg/m³, m/s²
    flight_path : climb angle, rad; None leaves it free, as in a glide with a given thrust
    free : of "sideslip" and "roll"; what is not named stays zero
    inputs : inputs that are held, by name: N or rad. All others are free
    bounds : (lower, upper) of angles and inputs by name. Unless given: angle of attack and sideslip
        within 0.35 rad, deflections within 0.5 rad, thrusts not below zero
    objective : "strain_energy", "drag", "root_bending" (sum of squared out-of-plane moments at the
        roots), a `TipHeight`, or None where nothing is left to choose
    guess : an earlier result of the same aircraft

    Raises
    ------
    ConvergenceError
        If something does not balance: the message says what, by how much, and which bounds hold;
        its `result` is the nearest state that was found.
    ValueError
        For unknown names, bad numbers, and more free inputs than the balances settle.
    """
    solver = _Solver(aircraft, objective)
    case = _Case(speed, density, gravity, flight_path, tuple(free), inputs or {}, bounds or {})
    return solver.solve(case, guess, throw)


def trim_sweep(
    aircraft: Aircraft,
    speeds: Sequence[float],
    *,
    density: float,
    gravity: float = STANDARD_GRAVITY,
    flight_path: float | None = 0.0,
    free: Sequence[str] = (),
    inputs: Mapping[str, float] | None = None,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    objective: Objective = None,
    throw: bool = False,
    progress: bool = True,
) -> list[TrimResult]:
    """`trim` at each of `speeds`, m/s, each from the last one that was trimmed.

    Without `throw` a speed at which nothing balances gives a result that says so.
    """
    solver, guess, results = _Solver(aircraft, objective), None, []
    for speed in tqdm(speeds, desc="trim", unit="speed", disable=not progress):
        case = _Case(speed, density, gravity, flight_path, tuple(free), inputs or {}, bounds or {})
        result = solver.solve(case, guess, throw)
        guess = result if result.trimmed else guess
        results.append(result)
    return results


class _Case(NamedTuple):
    """The conditions of one trim, as the user gave them."""

    speed: float
    density: float
    gravity: float
    flight_path: float | None
    free: tuple[str, ...]
    inputs: Mapping[str, float]
    bounds: Mapping[str, tuple[float, float]]


class _Solver:
    """The two NLPs of a trim, built once: nearest to balance, then best."""

    def __init__(self, aircraft: Aircraft, objective: Objective) -> None:
        if not isinstance(aircraft, Aircraft):
            raise ValueError(f"aircraft: expected an Aircraft, found {aircraft!r}")
        self.problem = problem = TrimProblem(aircraft)
        self.objective = objective
        self._nearest = problem.nearest()
        self._best = None if objective is None else problem.best(objective)
        wrenches = [*problem.rigid.values(), *problem.wrenches.values()]
        energies = problem.objective("strain_energy") * problem.length
        outputs = [problem.balances, problem.residuals, problem.flight.attitude]
        outputs += [problem.flight.flow.velocity, problem.drag(), energies, ca.horzcat(*wrenches)]
        self._evaluate = ca.Function("trim", [problem.x, problem.p], outputs)

    def solve(self, case: _Case, guess: TrimResult | None, throw: bool) -> TrimResult:
        """The trim of one case."""
        p = self._parameters(case)
        lower, upper = self._bounds(case, p[-1])
        x = np.zeros(len(lower)) if guess is None else guess.unknowns
        x, stats = _run(self._nearest, x, p, lower, upper, *self._on_path(case))
        iterations = int(stats["iter_count"])
        if self._best is not None and self._missed(case, x, p) <= TOLERANCE:
            conditions = self._conditions(case)
            best, stats = _run(self._best, x, p, lower, upper, *conditions)
            iterations += int(stats["iter_count"])
            x = best if self._missed(case, best, p) <= TOLERANCE else x
        result = self._result(case, p, x, (lower, upper), bool(stats["success"]), iterations)
        if throw and not result.trimmed:
            raise ConvergenceError(result.message, result)
        return result

    def _parameters(self, case: _Case) -> Array:
        """`PARAMETERS`; the weight is what the aircraft weighs in still, empty air."""
        speed, density = positive("speed", case.speed), positive("density", case.density)
        gravity = positive("gravity", case.gravity)
        path = 0.0 if case.flight_path is None else case.flight_path
        path = float(expression("flight_path", path, (1, 1)))
        p = np.array([speed, density, gravity, np.sin(path), 1.0])
        empty = np.array([speed, 0.0, gravity, 0.0, 1.0])
        balances, *_ = self._evaluate(np.zeros(self.problem.x.shape[0]), empty)
        p[-1] = float(balances[2])
        return p

    def _bounds(self, case: _Case, weight: float) -> tuple[Array, Array]:
        """Scaled bounds; held unknowns have the same on both sides."""
        problem, (lower, upper) = self.problem, bounds_of(self.problem)
        units = problem.aircraft.inputs
        sides = {name: (float(v), float(v)) for name, v in case.inputs.items()}
        for name in case.inputs:
            choice("inputs", name, tuple(units))
        for name in case.free:
            choice("free", name, ("sideslip", "roll"))
        sides |= {name: (0.0, 0.0) for name in ("sideslip", "roll") if name not in case.free}
        for name, pair in case.bounds.items():
            if choice("bounds", name, problem.names) in sides:
                raise ValueError(f"bounds: {name!r} is held, not free")
            sides[name] = tuple(expression(f"bounds[{name!r}]", pair, (2, 1)).full().ravel())
        for name, (low, high) in sides.items():
            if low > high:
                raise ValueError(f"bounds[{name!r}]: expected lower <= upper, found {low}, {high}")
            scale = weight if units.get(name) == "N" else 1.0
            k = problem.names.index(name)
            lower[k], upper[k] = low / scale, high / scale
        self._check_count(case, lower, upper)
        return lower, upper

    def _check_count(self, case: _Case, lower: Array, upper: Array) -> None:
        names = self.problem.names
        free = [n for n, a, b in zip(names, lower, upper, strict=False) if a < b]
        conditions = 3 + (case.flight_path is not None) + 3 * bool(case.free)
        if self.objective is None and len(free) > conditions:
            raise ValueError(
                f"inputs: {conditions} balances settle {conditions} of the free unknowns "
                f"{', '.join(free)}; hold others by `inputs`, or give an objective"
            )

    def _on_path(self, case: _Case) -> tuple[Array, Array]:
        """Bounds of the climb and of the residuals of the wings."""
        slack = np.zeros(1 + sum(self.problem.sizes))
        slack[0] = np.inf if case.flight_path is None else 0.0
        return -slack, slack

    def _conditions(self, case: _Case) -> tuple[Array, Array]:
        """Bounds of the balances, too.

        What symmetry keeps at zero is no equation there: it would be one without an unknown.
        """
        slack = np.zeros(len(BALANCES))
        if not case.free:
            slack[list(LATERAL)] = np.inf
        low, high = self._on_path(case)
        return np.append(-slack, low), np.append(slack, high)

    def _missed(self, case: _Case, x: Array, p: Array) -> float:
        balances, residuals, *_ = self._evaluate(x, p)
        low, high = self._on_path(case)
        left = residuals.full().ravel()
        left = left - np.clip(left, low, high)
        return float(np.max(np.abs(np.append(balances.full(), left))))

    def _result(
        self,
        case: _Case,
        p: Array,
        x: Array,
        bounds: tuple[Array, Array],
        converged: bool,
        iterations: int,
    ) -> TrimResult:
        problem, aircraft = self.problem, self.problem.aircraft
        values = self._evaluate(x, p)
        balances, residuals, attitude, velocity, drag, energy, wrenches = values
        found = problem.unknowns(ca.DM(x), p[-1])
        named = {name: float(found[name]) for name in problem.names}
        q = {wing.name: found[wing.name] for wing in aircraft.beams}
        on_body = ca.horzsplit(wrenches)[len(problem.rigid) :]
        scales = p[-1] * np.repeat([1.0, problem.arm], 3)
        active = _active(problem, x, bounds)
        edges = np.cumsum([1, *problem.sizes])
        left = {
            wing.name: float(np.max(np.abs(residuals.full()[a:b])) * p[-1] * problem.length**2)
            for wing, a, b in zip(aircraft.beams, edges, edges[1:], strict=False)
        }
        missed = self._missed(case, x, p)
        unsettled = [n for n, r in left.items() if r > TOLERANCE * p[-1] * problem.length**2]
        return TrimResult(
            speed=float(p[0]),
            **{name: named[name] for name in ANGLES},
            flight_path=float(np.arcsin(np.clip(-float((attitude @ velocity)[2]) / p[0], -1, 1))),
            inputs={name: named[name] for name in aircraft.inputs},
            input_units=dict(aircraft.inputs),
            q=q,
            shapes={wing.name: shape_map(wing.beam, q[wing.name]) for wing in aircraft.beams},
            root_loads={
                wing.name: at_root(wing, wrench).full().ravel()
                for wing, wrench in zip(aircraft.beams, on_body, strict=True)
            },
            airloads=self._airloads(p, velocity, q, named),
            strain_energy=float(energy) * p[-1],
            drag=float(drag),
            balances=dict(zip(BALANCES, (balances.full().ravel() * scales).tolist(), strict=True)),
            equilibrium_residuals=left,
            trimmed=missed <= TOLERANCE,
            converged=converged,
            iterations=iterations,
            active_bounds=active,
            message=_message(case, balances.full().ravel(), scales, unsettled, active),
            unknowns=x,
        )

    def _airloads(
        self, p: Array, velocity: ca.DM, q: dict[str, ca.DM], named: dict[str, float]
    ) -> dict[str, StripForces]:
        flow = Flow(density=p[1], velocity=velocity)
        found = {}
        for wing in self.problem.aircraft.beams:
            deflections = {name: named[name] for name in wing.strips.inputs}
            load = AerodynamicLoad(strips=wing.strips, flow=flow, deflections=deflections)
            found[wing.name] = strip_forces(wing.beam, q[wing.name], load)
        return found


def _run(
    nlp: ca.Function, x: Array, p: Array, lower: Array, upper: Array, *sides: Array
) -> tuple[Array, dict[str, Any]]:
    low, high = sides[0], sides[-1]
    solution = nlp(x0=np.clip(x, lower, upper), p=p, lbx=lower, ubx=upper, lbg=low, ubg=high)
    return np.clip(solution["x"].full().ravel(), lower, upper), nlp.stats()


def _active(problem: TrimProblem, x: Array, bounds: tuple[Array, Array]) -> tuple[str, ...]:
    """Bounds that hold a free angle, input or weight."""
    names = [*problem.names]
    for wing in problem.aircraft.beams:
        names += [f"{wing.name} q[{i}] ({label})" for i, label in enumerate(wing.beam.basis.labels)]
    active = []
    for name, value, low, high in zip(names, x, *bounds, strict=True):
        if low < high and value - low < 1e-5 * max(1.0, abs(low)):
            active.append(f"{name} at its lower bound")
        elif low < high and high - value < 1e-5 * max(1.0, abs(high)):
            active.append(f"{name} at its upper bound")
    return tuple(active)


def _message(
    case: _Case, balances: Array, scales: Array, unsettled: list[str], active: tuple[str, ...]
) -> str:
    """Which balances are missed, the worst first, and what holds them."""
    misses = []
    for k in np.argsort(-np.abs(balances)):
        if abs(balances[k]) > TOLERANCE:
            left = f"{balances[k] * scales[k]:.4g} {'N' if k < 3 else 'N m'}"
            part = f" ({100 * abs(balances[k]):.2g} % of the weight)" if k < 3 else ""
            misses.append(f"{BALANCES[k]} is left with {left}{part}")
    misses += [f"wing {name} is out of equilibrium" for name in unsettled]
    if not misses:
        return "trimmed"
    text = f"no trim at {case.speed:g} m/s: {'; '.join(misses)}"
    if active:
        text += f"; held by bounds: {', '.join(active)}"
    elif not case.free and any(abs(balances[k]) > TOLERANCE for k in LATERAL):
        text += "; free sideslip and roll by `free`, with inputs that turn the aircraft"
    return text
