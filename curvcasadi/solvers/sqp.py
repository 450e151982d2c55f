"""Gauss–Newton sequential quadratic programming, for Functions that hold a whole solver."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from curvcasadi.solvers.certificate import TOLERANCES, Bounds, certificate
from curvcasadi.symbolic.expressions import Number, Real

_QUIET: dict[str, dict[str, Any]] = {
    "qrqp": {"print_iter": False, "print_header": False, "print_info": False},
    "qpoases": {"printLevel": "none"},
}
#: Largest number of active-set changes of one quadratic program, for every unknown and constraint.
_QP_CHANGES = 3
#: Halvings of a step, at most, in programs with the equations of a model among their constraints:
#: the merit function refuses good steps there, in single precision any.
SHOOTING: dict[Real, int] = {"double": 2, "float": 0}


def roomy(constraints: ca.MX) -> ca.MX:
    """`constraints`, and a last one that is none, of whose bounds `with_room` knows.

    CasADi's `qrqp` lists where multipliers change their signs in a vector that is too short for all
    of them and its end: where all change at once it writes beyond. This one is always zero.
    """
    return ca.vertcat(constraints, ca.MX.zeros(1))


def with_room(limits: dict[str, Number]) -> dict[str, Number]:
    """`limits` of an NLP whose constraints are `roomy`."""
    free = {"lbg": -ca.inf, "ubg": ca.inf}
    return limits | {key: ca.vertcat(limits[key], side) for key, side in free.items()}


class Solution(NamedTuple):
    """The result of a solver; the last two fields are computed from it, not by the solver."""

    x: ca.MX
    violation: ca.MX  #: excess over bounds and constraints, Euclidean norm
    stationarity: ca.MX  #: distance from the optimality conditions over its tolerance


@dataclass(frozen=True, eq=False, kw_only=True)
class GaussNewton:
    """`sqpmethod` on a given positive semidefinite Hessian, with a certificate of its result."""

    solver: ca.Function
    bounds: Bounds
    certificate: ca.Function
    iterations: int | None  #: None: converges; otherwise so many programs, with full steps

    def __call__(self, guess: ca.MX, p: ca.MX) -> Solution:
        """Solution from `guess`, which is moved to within the bounds first."""
        x = ca.fmin(ca.fmax(guess, self.bounds.lbx), self.bounds.ubx)
        limits = with_room(self.bounds._asdict())
        found = self.solver(x0=x, p=p, **limits)
        for _ in range((self.iterations or 1) - 1):
            x = found["x"]
            warm = {"lam_x0": found["lam_x"], "lam_g0": found["lam_g"]}
            found = self.solver(x0=x, p=p, **warm, **limits)
        multipliers = found["lam_x"], found["lam_g"][:-1]
        at = () if self.iterations is None else (x,)
        return Solution(found["x"], *self.certificate(found["x"], p, *multipliers, *at))


def gauss_newton_sqp(
    name: str,
    x: ca.MX,
    parameters: ca.MX,
    objective: ca.MX,
    hessian: ca.MX,
    constraints: ca.MX,
    bounds: Bounds,
    *,
    nominal: tuple[Number, Number],
    real: Real,
    residual_unit: float | None = None,
    scaled: bool = True,
    iterations: int | None = None,
    max_iter: int = 100,
    halvings: int = 10,
    qp_solver: str = "qrqp",
) -> GaussNewton:
    """Solver of min objective within `bounds` of x and the constraints; with `qrqp` it becomes C.

    Nothing is printed and nothing raised: a caller checks the certificate.

    Parameters
    ----------
    nominal : numbers (x, parameters) at which the largest diagonal entry of the Hessian scales the
        objective. Gradients and multipliers then have the size of x, which `qrqp` needs: unscaled
        it gave up on half of the programs with many active bounds
    real : of the numbers that it will compute with, for tolerances that it can meet
    residual_unit : size of one unit in ½ |residual|², of which the objective is made: the
        certificate then asks, too, what a Newton step would still take from the residual along
        directions in which the objective is soft
    scaled : False keeps the objective as it is, for QP solvers that would lose the least part of it
    iterations : None to converge within `max_iter`; k for k quadratic programs with full steps
    halvings : of a step at most, where it converges, until the merit function falls; the last is
        taken in any case
    """
    qp_solver = "qrqp" if qp_solver == "own" else qp_solver
    if not isinstance(qp_solver, str) or not ca.has_conic(qp_solver):
        raise ValueError(f"qp_solver: expected a QP solver of CasADi, found {qp_solver!r}")
    largest = ca.Function("largest", [x, parameters], [ca.mmax(ca.diag(hessian))])(*nominal)
    stiffness = float(largest)
    if scaled:
        objective, hessian, stiffness = objective / stiffness, hessian / stiffness, 1.0
    tolerances = TOLERANCES[real]
    qp_options = {"error_on_fail": False, **_QUIET.get(qp_solver, {})}
    if qp_solver == "qrqp":
        primal, dual = tolerances.program
        at_most = {"constr_viol_tol": primal, "dual_inf_tol": dual * stiffness}
        changes = _QP_CHANGES * (x.shape[0] + constraints.shape[0])
        qp_options |= {"max_iter": max(changes, 20), **at_most}
    scale, multipliers = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", constraints.shape[0] + 1)
    options: dict[str, Any] = {
        "hess_lag": ca.Function(
            name + "_hessian",
            [x, parameters, scale, multipliers],
            [scale * hessian],
            ["x", "p", "lam_f", "lam_g"],
            ["hess_gamma_x_x"],
        ),
        "qpsol": qp_solver,
        "qpsol_options": qp_options,
        "error_on_fail": False,
        "max_iter": max_iter if iterations is None else 1,
        "beta": 0.5,
        "max_iter_ls": halvings if iterations is None else 0,
        "tol_du": tolerances.dual * stiffness,
        "tol_pr": tolerances.primal,
        "min_step_size": tolerances.step,
        "print_header": False,
        "print_iteration": False,
        "print_status": False,
        "print_time": False,
    }
    nlp: dict[str, Any] = {"x": x, "p": parameters, "f": objective, "g": roomy(constraints)}
    return GaussNewton(
        solver=ca.nlpsol(name, "sqpmethod", nlp, options),
        bounds=bounds,
        certificate=certificate(
            f"{name}_certificate",
            x,
            parameters,
            objective,
            hessian,
            constraints,
            bounds,
            tolerances,
            stiffness=stiffness,
            linearized=iterations is not None,
            residual_unit=residual_unit and residual_unit * np.sqrt(stiffness / float(largest)),
        ),
        iterations=iterations,
    )
