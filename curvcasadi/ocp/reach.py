"""Shape targets: weights that bring stations to given positions and attitudes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import casadi as ca
import numpy as np
from scipy.optimize import least_squares

from curvcasadi.beam import Beam
from curvcasadi.errors import ConvergenceError
from curvcasadi.expressions import AnyExpr, Array, Number, choice, expression, positive
from curvcasadi.ocp.targets import (
    TOLERANCE,
    Limits,
    Regularizer,
    Residuals,
    Target,
    checked_problem,
    numeric,
    regularizer_matrix,
    residuals,
    shape_limits,
    values_of,
)
from curvcasadi.shape import Shape, shape_map

Hessian = Literal["gauss_newton", "limited_memory"]

#: Starts that are tried, beyond the guess, before unweighted targets count as unreachable.
_FURTHER_STARTS = 8
#: Part of a tolerance that the regularizer may use up: the target stays well within it.
_USED_TOLERANCE = 1e-2
#: Damping of the Gauss–Newton Hessian along directions that no target sees, times W.
_DAMPING = 1e-6


@dataclass(frozen=True, eq=False, kw_only=True)
class ShapeResult:
    """Weights that reach, or come nearest to, shape targets."""

    q: ca.DM  #: (n, 1), rad/m
    shape: Shape  #: the shape at `q`
    distances: Array  #: remaining distance, m, per target with a position
    angles: Array  #: remaining angle, rad, per target with a rotation
    reached: bool  #: every unweighted target is met to its tolerance
    converged: bool  #: the last solve ended at an optimum
    iterations: int  #: of all solves
    active_bounds: tuple[str, ...]  #: bounds that hold the weights or the shape
    message: str


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
    equations.

    Parameters
    ----------
    q_guess : (n, 1), rad/m; the straight beam unless given
    curvature_bound : on |K_x|, |K_y|, |K_z| at the stations, rad/m: one number, three, or None.
        Weights also keep `Beam.weight_bounds`, and elements `Grid.max_angle`.
    regularizer : "smoothness" or "strain_energy" (needs a section)
    regularization : dimensionless; it weighs against weighted targets only
    hessian : "gauss_newton" (exact in the constraints) or "limited_memory"
    solver, solver_options : an NLP plugin of CasADi and its options
    throw : whether unmet unweighted targets raise; otherwise they are told in the result

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
    problem = _problem(beam, targets, curvature_bound, regularizer, regularization)
    solvers = _Solvers(problem, hessian, solver, solver_options or {})
    guess = np.zeros(beam.basis.n)
    if q_guess is not None:
        guess = numeric("q_guess", expression("q_guess", q_guess, (beam.basis.n, 1)))
        guess = guess.full().ravel()
    guess = np.clip(guess, *beam.bounds)

    q, met = guess, True
    if problem.residuals.to_meet.numel():
        q, met = _meet(beam, solvers, guess)
    if met:
        q = solvers.choose(q)
    result = _result(beam, targets, problem, solvers, q)
    if throw and not result.reached:
        raise ConvergenceError(result.message, result)
    return result


@dataclass(frozen=True, eq=False, kw_only=True)
class _Problem:
    q: ca.MX
    values: tuple[ca.DM, ca.DM]
    residuals: Residuals
    limits: Limits
    bounds: tuple[Array, Array]
    weights: ca.DM  #: W
    preference: ca.DM  #: regularization W, or W where no weighted target stands against it


def _problem(
    beam: Beam,
    targets: list[Target],
    curvature_bound: Number | None,
    regularizer: Regularizer,
    regularization: float,
) -> _Problem:
    q = ca.MX.sym("q", beam.basis.n)
    errors, weights = residuals(beam, targets, q), regularizer_matrix(beam, regularizer)
    return _Problem(
        q=q,
        values=values_of(targets),
        residuals=errors,
        limits=shape_limits(beam, q, curvature_bound),
        bounds=beam.bounds,
        weights=weights,
        preference=weights * (float(regularization) if errors.weighted.numel() else 1.0),
    )


class _Solvers:
    """The two solves of `reach_shape`, built once: nearest to the unweighted targets, then best."""

    def __init__(
        self, problem: _Problem, hessian: Hessian, solver: str, options: dict[str, Any]
    ) -> None:
        self.problem, self.iterations, self.converged = problem, 0, False
        r = problem.residuals
        self._parameters = ca.veccat(*problem.values)
        symbols = ca.veccat(r.positions, r.rotations)
        preference = problem.q.T @ problem.preference @ problem.q / 2
        make = _NlpFactory(problem.q, symbols, hessian, solver, options)

        limits = problem.limits.expression
        damping = _DAMPING * problem.weights
        self._nearest = make("nearest", ca.sumsqr(r.to_meet) / 2, r.to_meet, damping, limits)
        self._choose = make(
            "choose",
            ca.sumsqr(r.weighted) / 2 + preference,
            r.weighted,
            problem.preference,
            ca.vertcat(limits, r.to_meet / r.tolerances) if len(r.tolerances) else limits,
        )
        self._errors = ca.Function(
            "errors", [problem.q, symbols], [r.to_meet, r.distances, r.angles]
        )
        slope = ca.densify(ca.jacobian(r.to_meet, problem.q))
        self._slope = ca.Function("slope", [problem.q, symbols], [slope])
        self._limits = ca.Function("limits", [problem.q], [limits])

    def errors(self, q: Array) -> tuple[Array, Array, Array]:
        """(errors of unweighted targets, distances in m, angles in rad)."""
        return tuple(e.full().ravel() for e in self._errors(q, self._parameters))

    def misses(self, q: Array) -> float:
        """Largest error of an unweighted target over its tolerance."""
        error, _, _ = self.errors(q)
        return float(np.max(np.abs(error) / self.problem.residuals.tolerances, initial=0.0))

    def nearest(self, q: Array) -> Array:
        """Weights nearest to the unweighted targets, from `q`."""
        limits = self.problem.limits
        return self._solve(self._nearest, q, limits.lower, limits.upper)

    def polish(self, q: Array) -> Array:
        """`q`, or better weights by a trust region on the errors themselves.

        Their squares hide what badly conditioned targets still miss. It knows the bounds of the
        weights alone: if it leaves other limits, `q` stays.
        """
        tolerances = self.problem.residuals.tolerances
        lower, upper = self.problem.bounds
        solution = least_squares(
            lambda x: self.errors(x)[0] / tolerances,
            q,
            lambda x: self._slope(x, self._parameters).full() / tolerances[:, None],
            bounds=(lower, np.maximum(upper, np.nextafter(lower, np.inf))),
            xtol=1e-15,
            ftol=1e-15,
            gtol=1e-15,
            max_nfev=500,
        )
        limits = self.problem.limits
        values = self._limits(solution.x).full().ravel()
        kept = np.all((values >= limits.lower) & (values <= limits.upper))
        self.iterations += int(solution.nfev)
        return solution.x if kept and self.misses(solution.x) < self.misses(q) else q

    def choose(self, q: Array) -> Array:
        """Best weights that meet the unweighted targets, from weights `q` that meet them."""
        limits = self.problem.limits
        band = np.full(len(self.problem.residuals.tolerances), _USED_TOLERANCE)
        lower, upper = np.append(limits.lower, -band), np.append(limits.upper, band)
        best = self._solve(self._choose, q, lower, upper)
        return best if self.misses(best) <= 1 else q

    def _solve(self, nlp: ca.Function, q: Array, lower: Array, upper: Array) -> Array:
        lbx, ubx = self.problem.bounds
        solution = nlp(x0=q, p=self._parameters, lbx=lbx, ubx=ubx, lbg=lower, ubg=upper)
        stats = nlp.stats()
        self.iterations += int(stats["iter_count"])
        self.converged = bool(stats["success"])
        return np.asarray(np.clip(solution["x"].full().ravel(), lbx, ubx))


class _NlpFactory:
    """NLPs in q with a Gauss–Newton Hessian of the objective, exact in the constraints."""

    def __init__(
        self, q: ca.MX, parameters: ca.MX, hessian: Hessian, solver: str, options: dict[str, Any]
    ) -> None:
        self._q, self._parameters = q, parameters
        self._hessian, self._solver = hessian, solver
        self._options = {**_QUIET.get(solver, {}), "error_on_fail": False, **options}

    def __call__(
        self, name: str, objective: ca.MX, residual: ca.MX, quadratic: ca.DM, constraints: ca.MX
    ) -> ca.Function:
        """min objective = ½ |residual|² + ½ qᵀ quadratic q, subject to `constraints`."""
        q, options = self._q, dict(self._options)
        if self._hessian == "gauss_newton":
            options["hess_lag"] = self._lagrangian_hessian(residual, quadratic, constraints)
        elif self._solver == "ipopt":
            options["ipopt.hessian_approximation"] = "limited-memory"
        else:
            options["hessian_approximation"] = "limited-memory"
        nlp = {"x": q, "p": self._parameters, "f": objective, "g": constraints}
        return ca.nlpsol(name, self._solver, nlp, options)

    def _lagrangian_hessian(
        self, residual: ca.MX, quadratic: ca.DM, constraints: ca.MX
    ) -> ca.Function:
        q = self._q
        jacobian = ca.jacobian(residual, q)
        of_objective, of_constraints = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", constraints.shape[0])
        matrix = of_objective * (jacobian.T @ jacobian + quadratic)
        matrix += ca.hessian(ca.dot(of_constraints, constraints), q)[0]
        triangular = self._solver == "ipopt"
        return ca.Function(
            "hessian",
            [q, self._parameters, of_objective, of_constraints],
            [ca.triu(matrix) if triangular else matrix],
            ["x", "p", "lam_f", "lam_g"],
            ["triu_hess_gamma_x_x" if triangular else "hess_gamma_x_x"],
        )


_QUIET: dict[str, dict[str, Any]] = {
    "ipopt": {
        "print_time": False,
        "ipopt.print_level": 0,
        "ipopt.sb": "yes",
        "ipopt.tol": 1e-9,
        "ipopt.bound_relax_factor": 0.0,
        "ipopt.max_iter": 300,
    },
    "sqpmethod": {
        "print_time": False,
        "print_header": False,
        "print_iteration": False,
        "print_status": False,
        "qpsol": "qrqp",
        "qpsol_options": {"print_iter": False, "print_header": False, "error_on_fail": False},
    },
}


def _meet(beam: Beam, solvers: _Solvers, guess: Array) -> tuple[Array, bool]:
    """Weights that meet the unweighted targets, or the nearest of several starts."""
    lower, upper = (np.clip(side, -1 / beam.length, 1 / beam.length) for side in beam.bounds)
    random = np.random.default_rng(0)
    starts = [guess, *(random.uniform(lower, upper) for _ in range(_FURTHER_STARTS))]
    best, least = guess, np.inf
    for start in starts:
        q = solvers.nearest(start)
        missed = solvers.misses(q)
        if missed > 1:
            q = solvers.polish(q)
            missed = solvers.misses(q)
        if missed <= 1:
            return q, True
        if missed < least:
            best, least = q, missed
    return best, False


def _result(
    beam: Beam, targets: list[Target], problem: _Problem, solvers: _Solvers, q: Array
) -> ShapeResult:
    _, distances, angles = solvers.errors(q)
    reached = solvers.misses(q) <= 1
    active = _active_bounds(beam, problem, q)
    message = "reached" if reached else _why_missed(beam, targets, distances, angles, active)
    return ShapeResult(
        q=ca.DM(q),
        shape=shape_map(beam, q),
        distances=distances,
        angles=angles,
        reached=reached,
        converged=solvers.converged,
        iterations=solvers.iterations,
        active_bounds=active,
        message=message,
    )


def _active_bounds(beam: Beam, problem: _Problem, q: Array) -> tuple[str, ...]:
    limits = problem.limits
    values = ca.Function("limits", [problem.q], [limits.expression])(q).full().ravel()
    names = [f"q[{i}] ({label})" for i, label in enumerate(beam.basis.labels)]
    sides = [*zip(names, q, *problem.bounds, strict=True)]
    sides += [*zip(limits.names, values, limits.lower, limits.upper, strict=True)]
    active = []
    for name, value, lower, upper in sides:
        margin = 1e-4 * (upper - lower)
        if np.isfinite(margin) and value > upper - margin:
            active.append(f"{name} at its upper bound {upper:g}")
        elif np.isfinite(margin) and value < lower + margin and "angle" not in name:
            active.append(f"{name} at its lower bound {lower:g}")
    return tuple(active)


def _why_missed(
    beam: Beam, targets: list[Target], distances: Array, angles: Array, active: tuple[str, ...]
) -> str:
    """Which unweighted targets are missed, by how much, and what holds them off."""
    remaining_distances, remaining_angles = iter(distances), iter(angles)
    root = beam.root.position
    misses, reasons = [], []
    for i, target in enumerate(targets):
        parts, fractions = [], []
        if target.position is not None:
            distance = next(remaining_distances)
            parts.append(f"{distance:.3g} m")
            fractions.append(distance / beam.length)
            away, reach = float(ca.norm_2(target.position - root)), float(target.xi * beam.length)
            if target.weight is None and away > reach:
                reasons.append(
                    f"targets[{i}] is out of reach: {away:.6g} m from the root, "
                    f"the beam ends at most {reach:.6g} m from it"
                )
        if target.rotation is not None:
            angle = next(remaining_angles)
            parts.append(f"{angle:.3g} rad")
            fractions.append(angle)
        tolerance = TOLERANCE if target.tolerance is None else target.tolerance
        if target.weight is None and max(fractions) > tolerance:
            misses.append(f"targets[{i}] (xi = {target.xi:g}) by {' and '.join(parts)}")
    if active and not reasons:
        reasons.append("bounds hold it: " + "; ".join(active))
    if not reasons:
        reasons.append(
            f"no bound holds it: {beam.basis.n} weights of this basis cannot form the shape, "
            f"or none of {_FURTHER_STARTS + 1} starts led there; try a q_guess"
        )
    return f"targets not met: {', '.join(misses)}; {'; '.join(reasons)}"
