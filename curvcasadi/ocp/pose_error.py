"""Errors of poses and their slopes by the weights, of the poses' body Jacobians."""

from __future__ import annotations

from functools import cache

import casadi as ca

from curvcasadi.lie import so3


@cache
def position_error(n: int) -> ca.Function:
    """(position, rotation, body Jacobian (6, n), desired) -> p − p_d, its slope R J_v (3, n)."""
    position, rotation, jacobian, desired = (
        ca.SX.sym("position", 3),
        ca.SX.sym("rotation", 3, 3),
        ca.SX.sym("jacobian", 6, n),
        ca.SX.sym("desired", 3),
    )
    outputs = [position - desired, rotation @ jacobian[3:, :]]
    inputs = [position, rotation, jacobian, desired]
    return ca.Function("position_error", inputs, outputs, {"cse": True})


@cache
def attitude_error(n: int) -> ca.Function:
    """(rotation, body Jacobian (6, n), desired) -> log(R_dᵀ R), its slope (3, n).

    Of a body twist with angular part ω the error changes as that of R exp([ω×]).
    """
    rotation, jacobian = ca.SX.sym("rotation", 3, 3), ca.SX.sym("jacobian", 6, n)
    desired, turn = ca.SX.sym("desired", 3, 3), ca.SX.sym("turn", 3)
    turned = so3.log_error(rotation @ (ca.SX.eye(3) + so3.hat(turn)), desired)
    error, by_turn = (
        ca.substitute(part, turn, ca.SX.zeros(3)) for part in (turned, ca.jacobian(turned, turn))
    )
    outputs = [error, by_turn @ jacobian[:3, :]]
    return ca.Function("attitude_error", [rotation, jacobian, desired], outputs, {"cse": True})
