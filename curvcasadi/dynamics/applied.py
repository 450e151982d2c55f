"""Loads at the stations of a moving beam: their wrenches, and how these follow a motion.

A load may depend on the pose of its station, on its twist, and on its acceleration (see `Load`).
With the fields S of `derivatives` a change of the weights turns the station by A, moves it by
G = B + A × p, and changes its local twist by Ad(T⁻¹) S′ and its local acceleration by

    Rᵀ (A″ − Ω × A′)   and   Rᵀ (B″ + A″ × p + 2 A′ × ṗ + g × A),

where S″ is that of a frame that falls with −g. A change of the rates of the weights changes them by
Ad(T⁻¹) S, Rᵀ (2 A′ − Ω × A) and 2 Rᵀ (B′ + A′ × p + A × ṗ), one of their accelerations changes the
local acceleration by Rᵀ A and Rᵀ G. A vector s of the parent is Rᵀ s in local axes, and changes by
Rᵀ (s × A); a wrench W that is held in local axes changes by S ×* W.

A load with states of its own has rates beside its wrench, which change likewise.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import casadi as ca

from curvcasadi.beam.pose import unpack_pose
from curvcasadi.dynamics import coupled, recursion
from curvcasadi.dynamics.fields import cross_force
from curvcasadi.dynamics.system import System
from curvcasadi.kinematics import chain
from curvcasadi.kinematics.jacobian import to_body
from curvcasadi.kinematics.motion import unpack_motion
from curvcasadi.kinematics.state import StationMotion
from curvcasadi.lie import so3
from curvcasadi.loads.formulas import Formula, LocalFormula
from curvcasadi.symbolic.expressions import AnyExpr


class Acting(NamedTuple):
    """What loads do at the stations."""

    wrenches: list[AnyExpr]  #: their sum on each station, (6, 1), its local axes; None where none
    rates: AnyExpr  #: of what loads with states follow, station by station, (m, 1)


def acting(system: System, q: AnyExpr, q_dot: AnyExpr, motions: list[AnyExpr]) -> Acting:
    """Loads on the stations of a motion.

    `motions` are those of `recursion.outward`. Poses and velocities are computed only if loads
    depend on them.
    """
    if system.order < 0:
        return Acting([None] * len(system.loads), type(q)(0, 1))
    pattern = system.chain.pattern
    poses = system.chain.march([chain.pose_step(pattern)], system.beam.root.packed, q)
    twists = [ca.DM.zeros(6)] * len(poses)
    if system.order:
        step = recursion.twist_step(pattern)
        twists = system.chain.march([step], system.root_twist, q, q_dot)
    wrenches, rates = [], []
    joint = coupled.at_stations(system, poses, twists)
    for k, (pose, twist, motion) in enumerate(zip(poses, twists, motions, strict=True)):
        total = None
        for formula, data in [*system.loads[k], *(part[:2] for part in joint[k])]:
            values = _at_station(formula, data.numel())(
                pose, twist, motion, system.parent.gravity, data
            )
            total = values[:6] if total is None else total + values[:6]
            rates.append(values[6:])
        wrenches.append(total)
    return Acting(wrenches, ca.vertcat(type(q)(0, 1), *rates))


@lru_cache(maxsize=256)
def _at_station(formula: Formula, size: int) -> ca.Function:
    """(pose, twist, motion, gravity, data) -> wrench (moment, force) in local axes, and rates."""
    pose, twist, motion, gravity, data = (
        ca.SX.sym(*s)
        for s in (("pose", 12), ("twist", 6), ("motion", 9), ("gravity", 3), ("data", size))
    )
    rotation, position = unpack_pose(pose)
    acceleration = ca.vertcat(motion[3:6], motion[6:] + rotation.T @ gravity)
    values = ca.densify(formula.at_station(rotation, position, data, twist, acceleration))
    return ca.Function(
        "local_wrench", [pose, twist, motion, gravity, data], [values], {"cse": True}
    )


class LoadSlopes(NamedTuple):
    """Wrench about the parent origin in parent axes, then rates, and their derivatives."""

    value: AnyExpr  #: (6 + rates, 1)
    by_weights: AnyExpr  #: (6 + rates, columns)
    by_rates: AnyExpr
    by_accelerations: AnyExpr


@lru_cache(maxsize=256)
def load_slopes(
    formula: Formula, size: int, columns: int, moving: tuple[int, ...] = ()
) -> ca.Function:
    """(state, gravity, data, S, S′, S″, S′ of rates) -> the entries of `LoadSlopes`.

    State: pose, spatial twist and acceleration. Of the data at the rows `moving` the derivatives
    (rows, columns) by weights and by rates are further inputs.
    """
    state, gravity, data = (ca.SX.sym(*s) for s in (("state", 24), ("gravity", 3), ("data", size)))
    fields = [ca.SX.sym(name, 6, columns) for name in ("S", "S1", "S2", "S1_rates")]
    at = unpack_motion(state, 2)
    rotation, position = at.rotation, at.position
    turning, velocity = at.twist[:3], at.twist[3:] + ca.cross(at.twist[:3], at.position)
    value, by_place, by_twist, by_acceleration, by_data = _formula_slopes(
        formula, at, gravity, data
    )

    a, b, a1, b1, a2, b2, a1r, b1r = (x for f in fields for x in (f[:3, :], f[3:, :]))
    moved, omega, speed = b - so3.hat(position) @ a, so3.hat(turning), so3.hat(velocity)

    def point(angular: ca.SX, linear: ca.SX) -> ca.SX:
        return linear - so3.hat(position) @ angular

    by_weights = by_place @ _change_of_place(formula, rotation, data, a, moved)
    by_rates = by_accelerations = ca.SX(value.numel(), columns)
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
    inputs = [state, gravity, data, *fields]
    if moving:
        changes_of_data = [ca.SX.sym(name, len(moving), columns) for name in ("d_data", "d_rates")]
        by_weights, by_rates = (
            total + by_data[:, list(moving)] @ change
            for total, change in zip((by_weights, by_rates), changes_of_data, strict=True)
        )
        inputs += changes_of_data
    found = [value, by_weights, by_rates, by_accelerations]
    if isinstance(formula, LocalFormula):
        found = [_to_parent(at, part) for part in found]
        found[1][:6, :] += cross_force(fields[0], found[0][:6])
    return ca.Function("load_slopes", inputs, [*map(ca.densify, found)], {"cse": True})


@lru_cache(maxsize=256)
def data_slope(
    formula: Formula, size: int, rows: tuple[int, ...], columns: int, m: int
) -> ca.Function:
    """(state, gravity, data, S, d data (rows, m)) -> Sᵀ ∂W (columns, m), ∂rates (rates, m).

    Of the data only the `rows` change.
    """
    state, gravity, data = (ca.SX.sym(*s) for s in (("state", 24), ("gravity", 3), ("data", size)))
    field, d_data = ca.SX.sym("S", 6, columns), ca.SX.sym("d_data", len(rows), m)
    at = unpack_motion(state, 2)
    by_data = _formula_slopes(formula, at, gravity, data)[-1][:, list(rows)]
    works = field
    if isinstance(formula, LocalFormula):
        works = to_body(at.rotation, at.position, field[:3, :], field[3:, :])
    outputs = [(works.T @ by_data[:6, :]) @ d_data, by_data[6:, :] @ d_data]
    inputs = [state, gravity, data, field, d_data]
    return ca.Function("load_by_data", inputs, [*map(ca.densify, outputs)], {"cse": True})


def _formula_slopes(
    formula: Formula, at: StationMotion, gravity: ca.SX, data: ca.SX
) -> list[ca.SX]:
    """Values of a formula, and their derivatives by place, twist, acceleration and data.

    The place is the pose (12), or the vectors that the station sees in its own axes.
    """
    twist, acceleration = ca.SX.sym("twist", 6), ca.SX.sym("acceleration", 6)
    motion = _local_motion(at, gravity)
    if not isinstance(formula, LocalFormula):
        place, own = ca.SX.sym("pose", 12), data
        values = formula(*unpack_pose(place), data, twist, acceleration)
        found = ca.veccat(at.rotation, at.position)
    else:
        k = formula.vectors
        vectors, own = data[: 3 * k], ca.SX.sym("own", data.numel() - 3 * k)
        place = ca.SX.sym("vectors", 3 * k)
        values = formula.function(ca.reshape(place, 3, k), own, twist, acceleration)
        found = ca.vec(at.rotation.T @ ca.reshape(vectors, 3, k))
    values = ca.densify(ca.SX(values))
    parts = [values, *(ca.jacobian(values, x) for x in (place, twist, acceleration, own))]
    if isinstance(formula, LocalFormula):
        turned = ca.diagcat(*[at.rotation.T] * formula.vectors)
        parts[4] = ca.horzcat(parts[1] @ turned, parts[4])
        parts = ca.substitute(parts, [own], [data[3 * formula.vectors :]])
    slopes: list[ca.SX] = ca.substitute(parts, [place, twist, acceleration], [found, *motion])
    return slopes


def _change_of_place(
    formula: Formula, rotation: ca.SX, data: ca.SX, turned: ca.SX, moved: ca.SX
) -> ca.SX:
    """How the place of `_formula_slopes` follows a turn and a motion of the station."""
    if isinstance(formula, LocalFormula):
        vectors = (data[3 * k : 3 * k + 3] for k in range(formula.vectors))
        return ca.vertcat(*(rotation.T @ (so3.hat(vector) @ turned) for vector in vectors))
    columns = (-so3.hat(rotation[:, k]) @ turned for k in range(3))
    return ca.vertcat(*columns, moved)


def _local_motion(at: StationMotion, gravity: ca.SX) -> list[ca.SX]:
    """Twist and acceleration of a station as formulas take them."""
    rotation, position, turning = at.rotation, at.position, at.twist[:3]
    velocity = at.twist[3:] + ca.cross(turning, position)
    linear = at.acceleration[3:] + gravity + ca.cross(at.acceleration[:3], position)
    linear += ca.cross(turning, velocity)
    return [
        to_body(rotation, position, turning, at.twist[3:]),
        ca.vertcat(rotation.T @ at.acceleration[:3], rotation.T @ linear),
    ]


def _to_parent(at: StationMotion, values: ca.SX) -> ca.SX:
    """Values (6 + rates, columns) whose wrenches are local, with these in parent axes."""
    force = at.rotation @ values[3:6, :]
    moment = at.rotation @ values[:3, :] + so3.hat(at.position) @ force
    return ca.vertcat(moment, force, values[6:, :])
