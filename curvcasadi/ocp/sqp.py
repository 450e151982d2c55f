"""Gauss–Newton sequential quadratic programming, for Functions that hold a whole solver."""

from __future__ import annotations

from typing import Any

import casadi as ca

_QUIET: dict[str, dict[str, Any]] = {
    "qrqp": {"print_iter": False, "print_header": False, "print_info": False},
    "qpoases": {"printLevel": "none"},
}


def gauss_newton_sqp(
    name: str,
    x: ca.MX,
    parameters: ca.MX,
    objective: ca.MX,
    hessian: ca.MX,
    constraints: ca.MX,
    *,
    max_iter: int,
    tolerance: float = 1e-9,
    line_search: bool = True,
    qp_solver: str = "qrqp",
) -> ca.Function:
    """`sqpmethod` on a given positive semidefinite Hessian of the objective.

    With `qrqp` it becomes self-contained C. Nothing is printed and nothing raised: a caller checks
    the result. Without line search every step is full, as real-time iterations want it.
    """
    if not ca.has_conic(qp_solver):
        raise ValueError(f"qp_solver: expected a QP solver of CasADi, found {qp_solver!r}")
    scale = ca.MX.sym("lam_f")
    multipliers = ca.MX.sym("lam_g", constraints.shape[0])
    qp_options = {"error_on_fail": False, **_QUIET.get(qp_solver, {})}
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
        "max_iter": max_iter,
        **({} if line_search else {"max_iter_ls": 0}),
        "tol_du": tolerance,
        "tol_pr": tolerance,
        "print_header": False,
        "print_iteration": False,
        "print_status": False,
        "print_time": False,
    }
    nlp: dict[str, Any] = {"x": x, "p": parameters, "f": objective, "g": constraints}
    return ca.nlpsol(name, "sqpmethod", nlp, options)
