"""Gauss–Newton sequential quadratic programming, for Functions that hold a whole solver."""

from __future__ import annotations

from typing import Any

import casadi as ca


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
) -> ca.Function:
    """`sqpmethod` with `qrqp` on a given positive semidefinite Hessian of the objective.

    Both become self-contained C. Nothing is printed and nothing raised: a caller checks the result.
    Without line search every step is full, as real-time iterations want it.
    """
    scale = ca.MX.sym("lam_f")
    multipliers = ca.MX.sym("lam_g", constraints.shape[0])
    quiet = {"print_iter": False, "print_header": False, "print_info": False}
    options: dict[str, Any] = {
        "hess_lag": ca.Function(
            name + "_hessian",
            [x, parameters, scale, multipliers],
            [scale * hessian],
            ["x", "p", "lam_f", "lam_g"],
            ["hess_gamma_x_x"],
        ),
        "qpsol": "qrqp",
        "qpsol_options": {**quiet, "error_on_fail": False},
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
