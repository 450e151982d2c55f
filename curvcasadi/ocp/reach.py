"""Shape targets: weights that bring stations to given positions and attitudes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import casadi as ca
import numpy as np

from curvcasadi.beam.beam import Beam
from curvcasadi.errors import ConvergenceError
from curvcasadi.kinematics.shape import Shape, shape_map
from curvcasadi.ocp.limits import Regularizer
from curvcasadi.ocp.reach_solvers import Hessian, ReachProblem, ReachSolvers, reach_problem
from curvcasadi.ocp.targets import TOLERANCE, Target, checked_problem
from curvcasadi.solvers.active import active_bounds
from curvcasadi.symbolic.expressions import (
    AnyExpr,
    Array,
    Number,
    choice,
    expression,
    numeric,
    positive,
)
from curvcasadi.symbolic.text import described, shown

#: Starts that are tried, beyond the guess, before unweighted targets count as unreachable.
_FURTHER_STARTS = 8


@dataclass(frozen=True, eq=False, kw_only=True)
class ShapeResult:
    """Weights that reach, or come nearest to, shape targets.

    Attributes
    ----------
    q : DM, shape (n, 1)
        Curvature weights, rad/m.
    shape : Shape
        Shape at `q`.
    distances : array
        Remaining distance, m, per target with a position.
    angles : array
        Remaining angle, rad, per target with a rotation.
    reached : bool
        Whether every unweighted target is met to its tolerance.
    converged : bool
        Whether the last solve ended at an optimum.
    iterations : int
        Iterations of all solves.
    active_bounds : tuple of str
        Bounds that hold the weights or the shape, in words.
    compromise : bool
        Whether a weighted target is missed, by more than 1e-6 of the length or rad: the shape is a
        compromise between weights, regularizer and bounds.
    message : str
        What was reached, and which targets are missed by how much, in words.
    """

    q: ca.DM
    shape: Shape
    distances: Array
    angles: Array
    reached: bool
    converged: bool
    iterations: int
    active_bounds: tuple[str, ...]
    compromise: bool
    message: str

    @property
    def success(self) -> bool:
        """Whether the targets are met, by the best of the shapes that meet them."""
        return self.reached and self.converged

    def __repr__(self) -> str:
        return f"<ShapeResult: {self.message}>"

    def __str__(self) -> str:
        rows = {"q": shown(self.q, "rad/m"), "tip": str(self.shape.tip)}
        if self.distances.size:
            rows["distances"] = f"{shown(self.distances, 'm')} to the positions"
        if self.angles.size:
            rows["angles"] = f"{shown(self.angles, 'rad')} to the attitudes"
        rows["held by"] = "; ".join(self.active_bounds) or "no bound"
        rows["solved"] = f"{self.iterations} iterations"
        return described(f"ShapeResult: {self.message}", rows)


def reach_shape(
    beam: Beam,
    targets: Sequence[Target],
    *,
    q_guess: AnyExpr | None = None,
    curvature_bound: Number | None = None,
    regularizer: Regularizer = "smoothness",
    regularization: float = 1e-8,
    hessian: Hessian = "gauss_newton",
    solver: str = "ipopt",
    solver_options: dict[str, Any] | None = None,
    throw: bool = True,
) -> ShapeResult:
    """Weights that bring stations of `beam` to `targets`.

    Unweighted targets come first: q minimizes their squared errors. If that meets them, then, while
    they stay met, q minimizes

        ½ Σ weight (|Δp|²/L² + |Δφ|²) + ½ regularization qᵀ W q

    so that the regularizer chooses among the shapes that reach the targets and never moves a
    reachable one. Redundant targets are no obstacle: they are kept within their tolerances, not as
    equations. Where they cannot be met the result is the nearest of nine starts and the guess
    itself, by the length of the errors over their tolerances; of one start, where a position lies
    beyond the length of the beam.

    Parameters
    ----------
    beam : Beam
        Beam with numeric fields.
    targets : sequence of Target
        What stations shall reach.
    q_guess : array, shape (n, 1), optional
        Weights to start from, rad/m, brought within the bounds; the straight beam unless given.
    curvature_bound : float or array, shape (3,), optional
        Largest |K_x|, |K_y|, |K_z| at the stations, rad/m. Weights also keep `Beam.weight_bounds`,
        and elements `Grid.max_angle`.
    regularizer : {"smoothness", "strain_energy"}
        The matrix W; "strain_energy" needs a section.
    regularization : float
        Factor of the regularizer, dimensionless; it weighs against weighted targets only.
    hessian : {"gauss_newton", "limited_memory"}
        Hessian of the solves; "gauss_newton" is exact in the constraints.
    solver : str
        An NLP solver of CasADi.
    solver_options : dict, optional
        Its options.
    throw : bool
        Whether unmet unweighted targets raise; otherwise the result says so.

    Returns
    -------
    ShapeResult
        The weights, and how near they come to the targets.

    Raises
    ------
    ConvergenceError
        If an unweighted target is not met: its `result` holds the best weights, its message the
        remaining distance and the reason. Weighted targets never raise it.
    ValueError
        For arguments of the wrong shape, kind or range.
    """
    targets = checked_problem(beam, targets)
    choice("hessian", hessian, ("gauss_newton", "limited_memory"))
    positive("regularization", regularization)
    if not ca.has_nlpsol(solver):
        raise ValueError(f"solver: expected an NLP solver of CasADi, found {solver!r}")
    problem = reach_problem(beam, targets, curvature_bound, regularizer, regularization)
    solvers = ReachSolvers(problem, hessian, solver, solver_options or {})
    guess = np.zeros(beam.basis.n)
    if q_guess is not None:
        guess = numeric("q_guess", expression("q_guess", q_guess, (beam.basis.n, 1)))
        guess = guess.full().ravel()
    guess = np.clip(guess, *beam.bounds)

    q, met = guess, True
    if problem.residuals.to_meet.numel():
        q, met = _meet(beam, targets, solvers, guess)
    if met:
        q = solvers.choose(q)
    result = _result(beam, targets, problem, solvers, q)
    if throw and not result.reached:
        raise ConvergenceError(result.message, result)
    return result


def _meet(
    beam: Beam, targets: Sequence[Target], solvers: ReachSolvers, guess: Array
) -> tuple[Array, bool]:
    """Weights that meet the unweighted targets, or the nearest of several starts and the guess."""
    lower, upper = (np.clip(side, -1 / beam.length, 1 / beam.length) for side in beam.bounds)
    random = np.random.default_rng(0)
    further = _FURTHER_STARTS if not any(map(partial(_excess, beam), targets)) else 0
    starts = [guess, *(random.uniform(lower, upper) for _ in range(further))]
    best, least = guess, solvers.distance(guess) if solvers.is_kept(guess) else np.inf
    for start in starts:
        q = solvers.nearest(start)
        if solvers.misses(q) > 1:
            q = solvers.polish(q)
        if solvers.misses(q) <= 1:
            return q, True
        if solvers.distance(q) < least:
            best, least = q, solvers.distance(q)
    return best, False


def _excess(beam: Beam, target: Target) -> float:
    """By how much, m, an unweighted position lies beyond the length of the beam to its station."""
    if target.position is None or target.weight is not None:
        return 0.0
    tolerance = TOLERANCE if target.tolerance is None else float(target.tolerance)
    reach = float(target.xi * beam.length)
    away = float(ca.norm_2(target.position - beam.root.position))
    return away - reach if away > reach + tolerance * float(beam.length) else 0.0


def _result(
    beam: Beam, targets: list[Target], problem: ReachProblem, solvers: ReachSolvers, q: Array
) -> ShapeResult:
    _, distances, angles = solvers.errors(q)
    reached = solvers.misses(q) <= 1
    active = _active_bounds(beam, problem, q)
    missed = _missed(beam, targets, distances, angles)
    compromise = [words for target, words in zip(targets, missed, strict=True) if target.weight]
    weighted = ", ".join(filter(None, compromise))
    message = "reached"
    if not reached:
        message = _why_missed(beam, targets, missed, active)
    elif weighted:
        message = f"a compromise of weights: {weighted}"
    if reached and not solvers.converged:
        best = "the best one" if weighted else "the best shape among those that reach"
        message += f", but {best} was not found"
    return ShapeResult(
        q=ca.DM(q),
        shape=shape_map(beam, q),
        distances=distances,
        angles=angles,
        reached=reached,
        converged=solvers.converged,
        iterations=solvers.iterations,
        active_bounds=active,
        compromise=bool(weighted),
        message=message,
    )


def _active_bounds(beam: Beam, problem: ReachProblem, q: Array) -> tuple[str, ...]:
    limits = problem.limits
    values = ca.Function("limits", [problem.q], [limits.expression])(q).full().ravel()
    names = [f"q[{i}] ({label})" for i, label in enumerate(beam.basis.labels)]
    sides = zip(problem.bounds, (limits.lower, limits.upper), strict=True)
    lower, upper = (np.concatenate(side) for side in sides)
    at = [*names, *limits.names], np.concatenate([q, values]), (lower, upper)
    return tuple(active_bounds(*at, tolerance=1e-4).values())


def _missed(beam: Beam, targets: list[Target], distances: Array, angles: Array) -> list[str]:
    """By how much each target is missed, in words; "" where it is within its tolerance."""
    remaining_distances, remaining_angles = iter(distances), iter(angles)
    found = []
    for i, target in enumerate(targets):
        parts, fractions = [], []
        if target.position is not None:
            distance = next(remaining_distances)
            parts.append(f"{distance:.3g} m")
            fractions.append(distance / beam.length)
        if target.rotation is not None:
            angle = next(remaining_angles)
            parts.append(f"{angle:.3g} rad")
            fractions.append(angle)
        tolerance = TOLERANCE if target.tolerance is None else target.tolerance
        is_missed = max(fractions) > tolerance
        words = f"targets[{i}] (xi = {target.xi:g}) by {' and '.join(parts)}"
        found.append(words if is_missed else "")
    return found


def _why_missed(
    beam: Beam, targets: list[Target], missed: list[str], active: tuple[str, ...]
) -> str:
    """Which unweighted targets are missed, by how much, and what holds them off."""
    reasons = []
    for i, target in enumerate(targets):
        if excess := _excess(beam, target):
            reach = float(target.xi * beam.length)
            reasons.append(
                f"targets[{i}] is out of reach: {reach + excess:.6g} m from the root, "
                f"the beam ends at most {reach:.6g} m from it"
            )
    if active and not reasons:
        reasons.append("bounds hold it: " + "; ".join(active))
    if not reasons:
        reasons.append(
            f"no bound holds it: {beam.basis.n} weights of this basis cannot form the shape, "
            f"or none of {_FURTHER_STARTS + 1} starts led there; try a q_guess"
        )
    misses = [words for t, words in zip(targets, missed, strict=True) if words and not t.weight]
    return f"targets not met: {', '.join(misses)}; {'; '.join(reasons)}"
