"""Whether a result is a solution, from the result alone: violation and stationarity."""

from __future__ import annotations

from typing import NamedTuple

import casadi as ca
import numpy as np

from curvcasadi.symbolic.expressions import BOUND_SLACK, Number, Real


class Tolerances(NamedTuple):
    """What counts as zero in a number format, in units of x (the objective is scaled so)."""

    step: float  #: of Newton's steps, at which they end
    dual: float  #: of the gradient, at which they end
    primal: float  #: of the constraints, at which they end
    program: tuple[float, float]  #: of a quadratic program, primal and dual
    stationarity: float  #: of the optimality conditions of a solution that is called one
    decrement: float  #: of a residual that a Newton step would still take away
    limit: float  #: by which a solution may exceed a limit
    flat: float  #: curvature beside which that of the objective is none


TOLERANCES: dict[Real, Tolerances] = {
    "double": Tolerances(
        1e-10, 1e-13, 1e-9, (1e-10, 1e-12), 1e-8, 1e-6, BOUND_SLACK["double"], 1e-12
    ),
    "float": Tolerances(3e-6, 1e-10, 1e-6, (3e-7, 1e-8), 1e-6, 1e-4, BOUND_SLACK["float"], 1e-6),
}


class Bounds(NamedTuple):
    """Numbers: lbx ≤ x ≤ ubx, lbg ≤ constraints ≤ ubg."""

    lbx: Number
    ubx: Number
    lbg: Number
    ubg: Number


def larger(a: ca.MX, b: ca.MX) -> ca.MX:
    """The larger of two numbers, and NaN if one is, which `fmax` would overlook."""
    return (a + b + ca.fabs(a - b)) / 2


def certificate(
    name: str,
    x: ca.MX,
    parameters: ca.MX,
    objective: ca.MX,
    hessian: ca.MX,
    constraints: ca.MX,
    bounds: Bounds,
    tolerances: Tolerances,
    *,
    stiffness: float,
    linearized: bool,
    residual_unit: float | None,
) -> ca.Function:
    """(solution, p, λ_x, λ_g[, x]) -> violation, stationarity.

    The optimality conditions at the solution: r = ∇f + Jᵀ λ_g + λ_x = 0, and a multiplier only
    where its bound is reached; linearized those of the quadratic program at x, with f and the
    constraints expanded about it. All over `stiffness`, the size of the Hessian, and so in units of
    x. With a unit of residuals also the Newton decrement (rᵀ H⁻¹ r)^½: the bound of what is left to
    gain, as a residual.
    """
    n, m = x.shape[0], constraints.shape[0]
    lam_x, lam_g = ca.MX.sym("lam_x", n), ca.MX.sym("lam_g", m)
    solution = ca.MX.sym("solution", n) if linearized else x
    left = ca.gradient(objective + ca.dot(lam_g, constraints), x) + lam_x
    expanded = values = constraints
    if linearized:
        left += hessian @ (solution - x)
        expanded = constraints + ca.jtimes(constraints, x, solution - x)
        constrained = ca.Function(f"{name}_constraints", [x, parameters], [constraints])
        values = constrained(solution, parameters)
    lower, upper = (
        ca.DM(np.concatenate([np.broadcast_to(np.ravel(side), size) for side, size in sides]))
        for sides in (((bounds.lbx, n), (bounds.lbg, m)), ((bounds.ubx, n), (bounds.ubg, m)))
    )
    reached, multipliers = ca.vertcat(solution, expanded), ca.vertcat(lam_x, lam_g) / stiffness
    idle = ca.vertcat(
        ca.fmin(ca.fmax(multipliers, 0), ca.fmax(upper - reached, 0)),
        ca.fmin(ca.fmax(-multipliers, 0), ca.fmax(reached - lower, 0)),
    )
    errors = [left / (stiffness * tolerances.stationarity), idle / tolerances.stationarity]
    if residual_unit is not None:
        curved = hessian + stiffness * tolerances.flat * ca.DM.eye(n)
        gain = ca.dot(left, ca.solve(curved, left, "qr"))
        errors.append(ca.sqrt(gain) / (residual_unit * tolerances.decrement))
    values = ca.vertcat(solution, values)
    excess = values - ca.fmin(ca.fmax(values, lower), upper)
    # Euclidean norms, as a maximum would overlook NaN.
    violation, stationarity = ca.norm_2(excess), ca.norm_2(ca.vertcat(*errors))
    at = [x] if linearized else []
    return ca.Function(name, [solution, parameters, lam_x, lam_g, *at], [violation, stationarity])
