"""What a wing in the air shows: poses, motion and angles at stations, loads at its root.

A station has its pose and local twist, its acceleration less gravity, f = Rᵀ (p̈ − g), what an
accelerometer reads, and the angle of attack at three quarters of its chord. Their derivatives are
those of one station by its local motion, and of the motion by the fields of one march: with the
sums A, B of the Jacobian and G = B + A × p, the motion of the root included,

    df/dq = Rᵀ (B″ + A″ × p + 2 A′ × ṗ − g × A),   df/dq̇ = 2 Rᵀ (G′ + A × ṗ),   df/dq̈ = Rᵀ G
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from functools import lru_cache
from typing import NamedTuple

import casadi as ca
import numpy as np

from curvcasadi.aero import section
from curvcasadi.aero.stations import section_data
from curvcasadi.aero.unsteady import UnsteadyAirload
from curvcasadi.aircraft.parts import Wing
from curvcasadi.dynamics import root_wrench_function
from curvcasadi.kinematics import chain
from curvcasadi.kinematics.jacobian import to_body
from curvcasadi.kinematics.motion import Motion, motion_states
from curvcasadi.kinematics.pose_function import tip_function
from curvcasadi.kinematics.root_motion import RootMotion
from curvcasadi.kinematics.shape import curvature
from curvcasadi.kinematics.state import StateLayout, StationMotion
from curvcasadi.lie import se3, so3
from curvcasadi.loads.kinds import STANDARD_GRAVITY
from curvcasadi.symbolic.derivatives import with_jacobian
from curvcasadi.symbolic.expressions import AnyExpr
from curvcasadi.symbolic.functions import identities
from curvcasadi.symbolic.layout import Layout, Part

#: Outputs of a wing: entries, unit; at the root, at the tip, and of each station.
ROOT = {"root_moment": (3, "N m"), "root_force": (3, "N")}
TIP = {"tip_position": (3, "m"), "tip_rotation": (9, "1")}
STATION = {
    "station_position": (3, "m"),
    "station_rotation": (9, "1"),
    "angular_rate": (3, "rad/s"),
    "acceleration": (3, "m/s²"),
    "load_factor": (1, "1"),
    "angle_of_attack": (1, "rad"),
}
CURVATURE = {"curvature": (3, "rad/m")}
#: All of them, in the order in which they stand.
OUTPUTS = (*TIP, *CURVATURE, *ROOT, *STATION)
#: Those that follow the accelerations of the weights.
ACCELERATED = {*ROOT, "acceleration", "load_factor"}


#: Where the data of the section begin among those of a station.
_PACKED = 30


class Surroundings(NamedTuple):
    """What the outputs need beside the wing."""

    load: UnsteadyAirload
    root: RootMotion
    symbols: Mapping[str, ca.MX]  #: lag states, inputs and parameters by name
    gusts: AnyExpr | None = None  #: (3, stations), parent axes, in place of that of the load


def output_layout(outputs: Collection[str], stations: Sequence[float]) -> Layout:
    """The outputs that are asked for; those at stations stand station by station."""
    single, each = {**TIP, **ROOT}, {**CURVATURE, **STATION}
    parts = []
    for name in OUTPUTS:
        if name in outputs and name in single:
            parts.append(Part(name, *single[name]))
        elif name in outputs:
            size, unit = each[name]
            parts.append(Part(name, size * len(stations), unit))
    return Layout(tuple(parts))


def output_function(
    name: str, wing: Wing, around: Surroundings, y: Layout, stations: Sequence[float]
) -> ca.Function:
    """(q, q_dot, q_ddot, lag states, inputs, parameters …) -> y, with structured derivatives."""
    n = wing.beam.basis.n
    asked = [part.name for part in y.parts]
    states = {key: ca.MX.sym(key, n) for key in ("q", "q_dot", "q_ddot")}
    inputs = {**states, **around.symbols}
    values: dict[str, AnyExpr] = {}
    geometry, curving = (
        {k: s for k, s in around.symbols.items() if set(identities(shaping)) & set(identities([s]))}
        for shaping in (wing.beam.design_symbols.values(), wing.beam.shaping_symbols.values())
    )
    beyond = [key for key in asked if key in {**ROOT, **STATION} and curving]
    if beyond:
        raise ValueError(
            f"outputs: expected those of tip and curvature where parameters change the length or "
            f"initial curvature of the beam, as {min(curving)} does; found {beyond[0]!r}"
        )
    if not set(asked).isdisjoint(ROOT):
        loads = [around.load, *wing.loads]
        wrench = root_wrench_function(
            wing.beam, loads, around.symbols, root=around.root, name=f"{name}_root"
        )(*inputs.values())
        values |= {"root_moment": wrench[:3], "root_force": wrench[3:]}
    if "curvature" in asked:
        values["curvature"] = ca.veccat(*(curvature(wing.beam, states["q"], xi) for xi in stations))
    if not set(asked).isdisjoint(TIP):
        tip = tip_function(wing.beam, parameters=geometry)
        position, rotation = tip(states["q"], *geometry.values())
        values |= {"tip_position": position, "tip_rotation": ca.vec(rotation)}
    if not set(asked).isdisjoint(STATION):
        motions = motion_function(f"{name}_motion", wing, around, stations)
        values |= motions(**inputs)
    stacked = y.join({key: values[key] for key in asked})
    return ca.Function(name, [*inputs.values()], [stacked], [*inputs], ["y"])


def motion_function(
    name: str, wing: Wing, around: Surroundings, stations: Sequence[float]
) -> ca.Function:
    """Inputs as of `output_function` -> the outputs `STATION`, with structured derivatives."""
    beam, load, n = wing.beam, around.load, wing.beam.basis.n
    states = {key: ca.MX.sym(key, n) for key in ("q", "q_dot", "q_ddot")}
    parameters = ca.veccat(*around.symbols.values())
    to_parent, to_root = around.root.pose.rotation.T, beam.root.rotation.T
    gusts = around.gusts
    if gusts is None:
        gusts = ca.repmat(to_parent @ load.gust, 1, len(stations))
    stream = load.flow.velocity - to_parent @ load.flow.wind
    streams = to_root @ (ca.repmat(stream, 1, len(stations)) - gusts)
    gravity, root = to_parent @ around.root.gravity, around.root
    frames = ca.vertcat(
        to_root @ gravity,
        ca.vec(beam.root.rotation),
        beam.root.position,
        root.twist,
        root.twist_rate,
    )
    placed = list(dict.fromkeys(stations))
    motion = Motion(**states, root_twist=root.twist, root_twist_rate=root.twist_rate)
    plain, sloped = (
        dict(
            zip(
                placed,
                motion_states(chain.build(beam, placed), motion, 2, jacobian),
                strict=True,
            )
        )
        for jacobian in (False, True)
    )
    ends = np.cumsum([0, *(size for size, _ in STATION.values())]).tolist()
    rows, slopes = [], []
    for k, xi in enumerate(stations):
        strip = section_data(load.strips, xi, {}, density=1.0, measure=1.0)
        data = ca.vertcat(streams[:, k], frames, strip.pack())
        *by_states, by_data = _at_station(n)(sloped[xi], data)
        slope = ca.horzcat(*by_states, by_data @ ca.jacobian(data, parameters))
        rows.append(ca.vertsplit(_at_station(0)(plain[xi], data), ends))
        slopes.append(ca.vertsplit(slope, ends))
    values, changes = (
        {key: ca.vertcat(*(part[i] for part in parts)) for i, key in enumerate(STATION)}
        for parts in (rows, slopes)
    )
    return with_jacobian(name, {**states, **around.symbols}, values, changes)


@lru_cache(maxsize=32)
def _at_station(columns: int) -> ca.Function:
    """(state, data) -> outputs of a station; with `columns` of sums their slopes instead.

    Data are the velocity through the air and gravity in root axes, the root's pose in the body, its
    twist and the rates of that, and `SectionData`. Slopes are those by q, q_dot, q_ddot and data.
    """
    layout = StateLayout(2, columns)
    state, data = layout.symbol(), ca.SX.sym("data", _PACKED + section.SIZE)
    at = layout.unpack(state)
    rotation, position, turning = at.rotation, at.position, at.twist[:3]
    velocity = at.twist[3:] + ca.cross(turning, position)
    gravity = data[3:6]
    local = _local(at, at.twist, at.acceleration, gravity)
    symbols = ca.SX.sym("local", 21)
    value = _outputs(symbols, data)
    if not columns:
        (value,) = ca.substitute([value], [symbols], [local])
        return ca.Function("station_outputs", [state, data], [value], {"cse": True})
    by_local, by_data = ca.substitute(
        [ca.jacobian(value, symbols), ca.jacobian(value, data)], [symbols], [local]
    )
    (a, b), (a1, b1), (a2, b2) = at.sums

    def point(angular: ca.SX, linear: ca.SX) -> ca.SX:
        return linear - so3.hat(position) @ angular

    none = ca.SX(3, columns)
    turned = ca.vertcat(*(-so3.hat(rotation[:, k]) @ a for k in range(3)))
    bent = point(a2, b2) - 2 * so3.hat(velocity) @ a1 - so3.hat(gravity) @ a
    pushed = 2 * (point(a1, b1) - so3.hat(velocity) @ a)
    by_q = ca.vertcat(turned, point(a, b), to_body(rotation, position, a1, b1), rotation.T @ bent)
    at_rest = ca.SX(12, columns)
    by_q_dot = ca.vertcat(at_rest, to_body(rotation, position, a, b), rotation.T @ pushed)
    by_q_ddot = ca.vertcat(at_rest, none, none, rotation.T @ point(a, b))
    # Gravity and the motion of the root enter the local values: a change of the root's twist adds
    # itself everywhere, and turns what moves relative to the root.
    change = ca.SX.sym("change", 12)
    relative = at.twist - data[18:24]
    carried = at.acceleration + change[6:] + se3.small_adjoint(change[:6]) @ relative
    by_root = ca.jacobian(_local(at, at.twist + change[:6], carried, gravity), change)
    (by_root,) = ca.substitute([by_root], [change], [ca.SX.zeros(12)])
    fallen = ca.horzcat(
        ca.SX(21, 3),
        ca.vertcat(ca.SX(18, 3), -rotation.T),
        ca.SX(21, 12),
        by_root,
        ca.SX(21, section.SIZE),
    )
    results = [
        by_local @ by_q,
        by_local @ by_q_dot,
        by_local @ by_q_ddot,
        by_data + by_local @ fallen,
    ]
    return ca.Function(
        "station_output_slopes", [state, data], [ca.densify(x) for x in results], {"cse": True}
    )


def _local(at: StationMotion, twist: ca.SX, acceleration: ca.SX, gravity: ca.SX) -> ca.SX:
    """Pose, twist and acceleration less gravity of a station, (21, 1), the last two in its axes."""
    rotation, position, turning = at.rotation, at.position, twist[:3]
    velocity = twist[3:] + ca.cross(turning, position)
    moving = acceleration[3:] + ca.cross(acceleration[:3], position)
    moving += ca.cross(turning, velocity)
    return ca.SX(
        ca.veccat(
            rotation,
            position,
            to_body(rotation, position, turning, twist[3:]),
            rotation.T @ (moving - gravity),
        )
    )


def _outputs(local: ca.SX, data: ca.SX) -> ca.SX:
    """The outputs `STATION` from pose, twist and acceleration of the station, root axes."""
    ends = [0, 9, 12, 15, 18, 21]
    columns, position, rate, velocity, acceleration = ca.vertsplit(local, ends)
    stream, _, root_rotation, origin, _, packed = ca.vertsplit(
        data, [0, 3, 6, 15, 18, _PACKED, _PACKED + section.SIZE]
    )
    rotation, root = ca.reshape(columns, 3, 3), ca.reshape(root_rotation, 3, 3)
    strip = section.unpack(packed)
    angle = section.circulation(velocity + rotation.T @ stream, rate, strip).angle
    return ca.SX(
        ca.vertcat(
            origin + root @ position,
            ca.vec(root @ rotation),
            rate,
            acceleration,
            strip.upper * acceleration[2] / STANDARD_GRAVITY,
            angle,
        )
    )
