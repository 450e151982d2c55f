"""Loads at the stations of a moving beam: their wrenches, and how these follow a motion.

A load may depend on the pose of its station, on its twist, and on its acceleration (see `Load`).
With the fields S of `derivatives` a change of the weights turns the station by A, moves it by
G = B + A × p, and changes its local twist by Ad(T⁻¹) S′ and its local acceleration by

    Rᵀ (A″ − Ω × A′)   and   Rᵀ (B″ + A″ × p + 2 A′ × ṗ + g × A),

where S″ is that of a frame that falls with −g. A change of the rates of the weights changes them by
Ad(T⁻¹) S, Rᵀ (2 A′ − Ω × A) and 2 Rᵀ (B′ + A′ × p + A × ṗ), one of their accelerations changes the
local acceleration by Rᵀ A and Rᵀ G.
"""

from __future__ import annotations

from functools import lru_cache

import casadi as ca

from curvcasadi.beam.pose import unpack_pose
from curvcasadi.dynamics import recursion
from curvcasadi.dynamics.system import System
from curvcasadi.kinematics import chain
from curvcasadi.kinematics.jacobian import to_body
from curvcasadi.kinematics.motion import unpack_motion
from curvcasadi.kinematics.state import StationMotion
from curvcasadi.lie import so3
from curvcasadi.loads.stations import WrenchFormula
from curvcasadi.symbolic.expressions import AnyExpr


def local_wrenches(
    system: System, q: AnyExpr, q_dot: AnyExpr, motions: list[AnyExpr]
) -> list[AnyExpr]:
    """Sum of the loads on each station, (moment, force), (6, 1), its local axes; None where none.

    `motions` are those of `recursion.outward`. Poses and velocities are computed only if loads
    depend on them.
    """
    order = max((formula.order for acting in system.loads for formula, _ in acting), default=-1)
    if order < 0:
        return [None] * len(system.loads)
    pattern = system.chain.pattern
    poses = system.chain.march([chain.pose_step(pattern)], system.beam.root.packed, q)
    twists = [ca.DM.zeros(6)] * len(poses)
    if order:
        step = recursion.twist_step(pattern)
        twists = system.chain.march([step], system.root_twist, q, q_dot)
    results = []
    for pose, twist, motion, acting in zip(poses, twists, motions, system.loads, strict=True):
        total = None
        for formula, data in acting:
            wrench_of = _local_wrench(formula, data.numel())
            wrench = wrench_of(pose, twist, motion, system.parent.gravity, data)
            total = wrench if total is None else total + wrench
        results.append(total)
    return results


@lru_cache(maxsize=256)
def _local_wrench(formula: WrenchFormula, size: int) -> ca.Function:
    """(pose, twist, motion, gravity, data) -> wrench (moment, force) at the station, its axes."""
    pose, twist, motion, gravity, data = (
        ca.SX.sym(*s)
        for s in (("pose", 12), ("twist", 6), ("motion", 9), ("gravity", 3), ("data", size))
    )
    rotation, position = unpack_pose(pose)
    acceleration = ca.vertcat(motion[3:6], motion[6:] + rotation.T @ gravity)
    wrench = formula(rotation, position, data, twist, acceleration)
    moment = wrench[:3] - ca.cross(position, wrench[3:])
    local = ca.vertcat(rotation.T @ moment, rotation.T @ wrench[3:])
    return ca.Function("local_wrench", [pose, twist, motion, gravity, data], [local], {"cse": True})


@lru_cache(maxsize=256)
def wrench_with_slopes(formula: WrenchFormula, size: int, columns: int) -> ca.Function:
    """(state, gravity, data, S, S′, S″, S′ of rates) -> wrench, and its derivatives by fields.

    The wrench (6, 1) is about the parent origin in parent axes; the derivatives, (6, columns) each,
    are those by weights, rates and accelerations. State: pose, spatial twist and acceleration.
    """
    state, gravity, data = (ca.SX.sym(*s) for s in (("state", 24), ("gravity", 3), ("data", size)))
    fields = [ca.SX.sym(name, 6, columns) for name in ("S", "S1", "S2", "S1_rates")]
    at = unpack_motion(state, 2)
    rotation, position = at.rotation, at.position
    turning, velocity = at.twist[:3], at.twist[3:] + ca.cross(at.twist[:3], at.position)
    parts, local = _formula_slopes(formula, data)
    values = _local_arguments(at, gravity)
    wrench, by_pose, by_twist, by_acceleration = ca.substitute(parts, local, values)

    a, b, a1, b1, a2, b2, a1r, b1r = (x for f in fields for x in (f[:3, :], f[3:, :]))
    moved, omega, speed = b - so3.hat(position) @ a, so3.hat(turning), so3.hat(velocity)

    def point(angular: ca.SX, linear: ca.SX) -> ca.SX:
        return linear - so3.hat(position) @ angular

    turned = ca.vertcat(*(-so3.hat(rotation[:, k]) @ a for k in range(3)))
    by_weights = by_pose @ ca.vertcat(turned, moved)
    by_rates = by_accelerations = ca.SX(6, columns)
    if formula.order:
        by_weights += by_twist @ to_body(rotation, position, a1, b1)
        by_rates = by_twist @ to_body(rotation, position, a, b)
    if formula.order == 2:
        changes = (
            (a2 - omega @ a1, point(a2, b2) - 2 * speed @ a1 + so3.hat(gravity) @ a),
            (2 * a1r - omega @ a, 2 * (point(a1r, b1r) - speed @ a)),
            (a, moved),
        )
        by_weights, by_rates, by_accelerations = (
            total + by_acceleration @ ca.vertcat(rotation.T @ x, rotation.T @ y)
            for total, (x, y) in zip((by_weights, by_rates, by_accelerations), changes, strict=True)
        )
    outputs = [wrench, by_weights, by_rates, by_accelerations]
    return ca.Function(
        "load_slopes", [state, gravity, data, *fields], [*map(ca.densify, outputs)], {"cse": True}
    )


@lru_cache(maxsize=256)
def data_slope(formula: WrenchFormula, size: int, columns: int, m: int) -> ca.Function:
    """(state, gravity, data, S, d data, d gravity) -> Sᵀ ∂W, (columns, m).

    The derivatives of data and gravity have m columns. Gravity enters a load only because states
    hold accelerations less gravity, so that of these it takes the part that gravity has.
    """
    state, gravity, data = (ca.SX.sym(*s) for s in (("state", 24), ("gravity", 3), ("data", size)))
    field = ca.SX.sym("S", 6, columns)
    d_data, d_gravity = ca.SX.sym("d_data", size, m), ca.SX.sym("d_gravity", 3, m)
    (wrench, _, _, by_acceleration), local = _formula_slopes(formula, data)
    at = unpack_motion(state, 2)
    by_data, by_acceleration = ca.substitute(
        [ca.jacobian(wrench, data), by_acceleration], local, _local_arguments(at, gravity)
    )
    change = by_data @ d_data + by_acceleration[:, 3:] @ (at.rotation.T @ d_gravity)
    inputs = [state, gravity, data, field, d_data, d_gravity]
    return ca.Function("load_by_data", inputs, [ca.densify(field.T @ change)], {"cse": True})


def _formula_slopes(formula: WrenchFormula, data: ca.SX) -> tuple[list[ca.SX], list[ca.SX]]:
    """Wrench of a formula, its derivatives by pose, twist and acceleration; and these symbols."""
    local = [ca.SX.sym("pose", 12), ca.SX.sym("twist", 6), ca.SX.sym("acceleration", 6)]
    wrench = ca.densify(ca.SX(formula(*unpack_pose(local[0]), data, *local[1:])))
    return [wrench, *(ca.jacobian(wrench, x) for x in local)], local


def _local_arguments(at: StationMotion, gravity: ca.SX) -> list[ca.SX]:
    """Pose, twist and acceleration of a station as formulas take them."""
    rotation, position, turning = at.rotation, at.position, at.twist[:3]
    velocity = at.twist[3:] + ca.cross(turning, position)
    linear = at.acceleration[3:] + gravity + ca.cross(at.acceleration[:3], position)
    linear += ca.cross(turning, velocity)
    return [
        ca.veccat(rotation, position),
        to_body(rotation, position, turning, at.twist[3:]),
        ca.vertcat(rotation.T @ at.acceleration[:3], rotation.T @ linear),
    ]
