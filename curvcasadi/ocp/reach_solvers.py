"""The solves behind `reach_shape`: nearest to the targets, then the best shape that meets them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import casadi as ca
import numpy as np

from curvcasadi.beam.beam import Beam
from curvcasadi.ocp.limits import Limits, Regularizer, regularizer_matrix, shape_limits
from curvcasadi.ocp.targets import Residuals, Target, residuals, values_of
from curvcasadi.solvers.interrupt import solved
from curvcasadi.symbolic.expressions import Array, Number

Hessian = Literal["gauss_newton", "limited_memory"]

#: Part of a tolerance that the regularizer may use up: the target stays well within it.
_USED_TOLERANCE = 1e-2
#: Bounds of a last constraint that is none. CasADi's `qrqp` lists where multipliers change their
#: signs in a vector too short for all of them and its end; that of this one is always zero.
_ROOM = {"lbg": -np.inf, "ubg": np.inf}
#: Damping of the Gauss–Newton Hessian along directions that no target sees, times W.
_DAMPING = 1e-6


@dataclass(frozen=True, eq=False, kw_only=True)
class ReachProblem:
    """Expressions, limits and values of one shape-target problem."""

    q: ca.MX
    values: tuple[ca.DM, ca.DM]
    residuals: Residuals
    limits: Limits
    bounds: tuple[Array, Array]
    weights: ca.DM  #: W
    preference: ca.DM  #: regularization W, or W where no weighted target stands against it


def reach_problem(
    beam: Beam,
    targets: list[Target],
    curvature_bound: Number | None,
    regularizer: Regularizer,
    regularization: float,
) -> ReachProblem:
    """The problem of `reach_shape` for checked arguments."""
    q = ca.MX.sym("q", beam.basis.n)
    errors, weights = residuals(beam, targets, q), regularizer_matrix(beam, regularizer)
    return ReachProblem(
        q=q,
        values=values_of(targets),
        residuals=errors,
        limits=shape_limits(beam, q, curvature_bound),
        bounds=beam.bounds,
        weights=weights,
        preference=weights * (float(regularization) if errors.weighted.numel() else 1.0),
    )


class ReachSolvers:
    """The two solves of `reach_shape`, built once: nearest to the unweighted targets, then best."""

    def __init__(
        self, problem: ReachProblem, hessian: Hessian, solver: str, options: dict[str, Any]
    ) -> None:
        self.problem, self.iterations, self.converged = problem, 0, False
        self._has_room = solver == "sqpmethod"
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
        """Largest error of an unweighted target, as a length, over its tolerance."""
        return float(np.max(self._scaled_errors(q), initial=0.0))

    def distance(self, q: Array) -> float:
        """Distance from all unweighted targets: root of the sum of squares over tolerances.

        Lengths of errors are the same in every parent frame.
        """
        return float(np.linalg.norm(self._scaled_errors(q)))

    def is_kept(self, q: Array) -> bool:
        """Whether weights keep the limits of curvature and element angles."""
        limits = self.problem.limits
        values = self._limits(q).full().ravel()
        return bool(np.all((values >= limits.lower) & (values <= limits.upper)))

    def _scaled_errors(self, q: Array) -> Array:
        """Length of each error (3,) of an unweighted target, over its tolerance."""
        error, _, _ = self.errors(q)
        return np.linalg.norm((error / self.problem.residuals.tolerances).reshape(-1, 3), axis=1)

    def nearest(self, q: Array) -> Array:
        """Weights nearest to the unweighted targets, from `q`."""
        limits = self.problem.limits
        return self._solve(self._nearest, q, limits.lower, limits.upper)

    def polish(self, q: Array) -> Array:
        """`q`, or better weights by a trust region on the errors themselves.

        Their squares hide what badly conditioned targets still miss. It knows the bounds of the
        weights alone: if it leaves other limits, `q` stays.
        """
        from scipy.optimize import least_squares

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
        self.iterations += int(solution.nfev)
        better = self.is_kept(solution.x) and self.distance(solution.x) < self.distance(q)
        return solution.x if better else q

    def choose(self, q: Array) -> Array:
        """Best weights that meet the unweighted targets, from weights `q` that meet them."""
        limits = self.problem.limits
        band = np.full(len(self.problem.residuals.tolerances), _USED_TOLERANCE)
        lower, upper = np.append(limits.lower, -band), np.append(limits.upper, band)
        best = self._solve(self._choose, q, lower, upper)
        return best if self.misses(best) <= 1 else q

    def _solve(self, nlp: ca.Function, q: Array, lower: Array, upper: Array) -> Array:
        lbx, ubx = self.problem.bounds
        limits = {"lbx": lbx, "ubx": ubx, "lbg": lower, "ubg": upper}
        if self._has_room:
            limits |= {key: np.append(limits[key], side) for key, side in _ROOM.items()}
        solution, stats = solved(nlp, x0=q, p=self._parameters, **limits)
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
        if self._solver == "sqpmethod":
            constraints = ca.vertcat(constraints, ca.MX.zeros(1))  # has the bounds _ROOM
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
