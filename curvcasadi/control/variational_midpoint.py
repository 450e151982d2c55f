"""The variational midpoint rule in momenta, for aircraft in free flight.

With m = (m_b, m_q) the momenta, T the kinetic energy and F the forces that have no inertia, all at
the middle of a step with the velocities y = (V, v) held over it, and μ the momenta at its start:

    J_l(h V)⁻ᵀ m_b − h/2 F_b = μ_b,      m_q − h/2 (∂T/∂q + F_q) = μ_q
    μ_b⁺ = J_r(h V)⁻ᵀ m_b + h/2 F_b,     μ_q⁺ = m_q + h/2 (∂T/∂q + F_q)
    pose⁺ = pose exp(h V),               q⁺ = q + h v

Without loads it keeps linear and angular momentum to rounding, and energy within bounds.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from curvcasadi.control.iteration import iterated, relative_size
from curvcasadi.control.model import ControlModel, SecondOrder
from curvcasadi.lie import quaternion, se3, so3
from curvcasadi.symbolic.expressions import AnyExpr, Array

#: Relative correction of the velocities at which a step has converged: rounding.
TOLERANCE = 1e-13
#: Most iterations of a step.
ITERATIONS = 60


def variational_motion(model: ControlModel) -> SecondOrder:
    """The equations of motion of a model that the rule can take, or an error that says why not."""
    motion = model.second_order
    if motion is None or motion.momenta is None:
        raise ValueError(
            f"method: 'variational' needs a model with momenta, such as aircraft_model, found "
            f"{model.name!r}; use 'implicit_midpoint'"
        )
    return motion


def variational_solver(
    model: ControlModel, iterations: int = ITERATIONS, tolerance: float = TOLERANCE
) -> ca.Function:
    """(c, momenta, u, p, h, guess) -> c_next, momenta_next, residual, velocities, iterations.

    `c` is the configuration as in the state; `guess` and `velocities` are y.
    """
    motion = variational_motion(model)
    nv = motion.velocities
    c = ca.MX.sym("c", model.x.size - nv)
    start, u, p, h, guess = (
        ca.MX.sym(name, size)
        for name, size in (
            ("momenta", nv), ("u", model.u.size), ("p", model.p.size), ("h", 1), ("guess", nv)
        )
    )  # fmt: skip
    y, a = ca.MX.sym("y", nv), ca.MX.sym("A", nv, nv)
    constants = [c, start, u, p, h, a]
    first, _ = _momenta_at_ends(motion, c, u, p, h, y)
    change = ca.solve(a, first - start, "ldl")
    size = ca.norm_1(y - change)
    better = ca.Function(
        "iteration", [y, *constants], [y - change, relative_size(change, size, model.real)]
    )
    mass, damping, stiffness = motion.matrices(ca.vertcat(c, guess), p)
    matrix = ca.densify(mass + h / 2 * damping + h**2 / 4 * stiffness)
    loop = iterated(better, iterations, tolerance)
    velocities, residual, count = loop(guess, c, start, u, p, h, matrix)
    _, end = _momenta_at_ends(motion, c, u, p, h, velocities)
    return ca.Function(
        f"{model.name}_variational",
        [c, start, u, p, h, guess],
        [_moved(c, h, velocities), end, residual, velocities, count],
        ["c", "momenta", "u", "p", "h", "guess"],
        ["c_next", "momenta_next", "residual", "velocities", "iterations"],
    )


def _momenta_at_ends(
    motion: SecondOrder,
    c: ca.MX,
    u: ca.MX,
    p: ca.MX,
    h: AnyExpr,
    y: ca.MX,
) -> tuple[ca.MX, ca.MX]:
    """Momenta at the start and the end of a step with the velocities y."""
    middle = _moved(c, h / 2, y)
    momenta, slope = _momenta(motion)(ca.vertcat(middle, y))
    at_rest = ca.vertcat(middle, ca.MX.zeros(motion.velocities))
    force = -motion.balance(at_rest, ca.DM.zeros(motion.velocities), u, p)[0]
    _, damping, _ = motion.matrices(at_rest, p)
    push = h / 2 * (slope + force - damping @ y)
    turn = h * y[:6]
    body = [
        jacobian(turn).T @ momenta[:6]
        for jacobian in (se3.left_jacobian_inverse, se3.right_jacobian_inverse)
    ]
    return (
        ca.vertcat(body[0], momenta[6:]) - push,
        ca.vertcat(body[1], momenta[6:]) + push,
    )


def _moved(c: ca.MX, h: AnyExpr, y: ca.MX) -> ca.MX:
    """The configuration (quaternion, position, q) after `h` at the velocities y, on SE(3)."""
    turn, shift = h * y[:3], h * y[3:6]
    rotation = quaternion.rotation(c[:4])
    position = c[4:7] + rotation @ (so3.left_jacobian(turn) @ shift)
    return ca.vertcat(
        quaternion.normalize(quaternion.product(c[:4], quaternion.exp(turn))),
        position,
        c[7:] + h * y[6:],
    )


def _momenta(motion: SecondOrder) -> ca.Function:
    if motion.momenta is None:
        raise ValueError("SecondOrder.momenta: expected a Function, found None")
    return motion.momenta


def momenta_of(motion: SecondOrder, x: Array) -> Array:
    """Momenta (nv,) of a state."""
    return np.asarray(_momenta(motion)(x)[0].full().ravel())


def velocities_of(motion: SecondOrder, c: Array, momenta: Array, p: Array) -> Array:
    """M⁻¹ momenta, the velocities (nv,) at a configuration."""
    at_rest = np.concatenate([c, np.zeros(motion.velocities)])
    return np.asarray(np.linalg.solve(motion.matrices(at_rest, p)[0].full(), momenta))
