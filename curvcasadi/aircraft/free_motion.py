"""What the equations of free flight need of an aircraft in motion: its body and its wings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from curvcasadi.aircraft.parts import Aircraft
from curvcasadi.dynamics import inertia, recursion, system
from curvcasadi.symbolic.expressions import AnyExpr, Number, expression, instance, rotation_matrix

#: Further loads by the name of the wing.
WingLoads = Mapping[str, Sequence[Any]]


class WingMotion(NamedTuple):
    """A wing, and the motion of its weights."""

    system: system.System
    q: AnyExpr
    q_dot: AnyExpr
    q_ddot: AnyExpr


class FreeMotion(NamedTuple):
    """An aircraft in motion, divided into its body and its wings."""

    body: AnyExpr  #: the ten numbers of the rigid body about the body origin
    twist: AnyExpr
    parent: system.ParentMotion
    wings: list[WingMotion]


def free_motion(
    aircraft: Aircraft,
    q: AnyExpr,
    velocity: AnyExpr,
    acceleration: AnyExpr,
    attitude: AnyExpr | None,
    gravity: Number,
    loads: WingLoads | None,
) -> FreeMotion:
    """Parts of an aircraft in motion; arguments of `free_flight.free_inverse_dynamics`."""
    instance("aircraft", aircraft, Aircraft)
    offsets = offsets_of(aircraft)
    q = expression("q", q, (offsets[-1], 1))
    velocity = expression("velocity", velocity, (6 + offsets[-1], 1))
    acceleration = expression("acceleration", acceleration, (6 + offsets[-1], 1))
    turned = ca.DM.eye(3) if attitude is None else rotation_matrix("attitude", attitude)
    down = turned.T @ ca.vertcat(0, 0, gravity)
    parent = system.ParentMotion(velocity[:6], acceleration[:6], down)
    further = dict(loads or {})
    unknown = sorted(set(further) - {wing.name for wing in aircraft.beams})
    if unknown:
        raise ValueError(f"loads: expected names of wings, found {unknown}")
    symbols = {"q": q, "velocity": velocity, "acceleration": acceleration}
    parts = (ca.vertsplit(x, offsets) for x in (q, velocity[6:], acceleration[6:]))
    wings = []
    for wing, *motion in zip(aircraft.beams, *parts, strict=True):
        acting = [*wing.loads, *further.get(wing.name, ())]
        built = system.in_parent(wing.beam, acting, parent, turned, symbols)
        wings.append(WingMotion(built, *motion))
    return FreeMotion(body_inertia(aircraft), velocity[:6], parent, wings)


def at_rest(aircraft: Aircraft, q: AnyExpr) -> FreeMotion:
    """An aircraft that does not move."""
    rest = ca.DM.zeros(6 + weights_of(aircraft))
    return free_motion(aircraft, q, rest, rest, None, 0.0, None)


def body_inertia(aircraft: Aircraft) -> AnyExpr:
    """The ten numbers of the rigid body about the body origin, body axes."""
    body = aircraft.body
    if body.inertia is None:
        raise ValueError("RigidBody.inertia: expected (3, 3) for free flight and turns, found None")
    return inertia.about_point(body.mass, body.center_of_mass, body.inertia)


def body_wrench(body: AnyExpr, parent: system.ParentMotion) -> AnyExpr:
    """Wrench that the motion of the rigid body needs, body axes, at the body origin.

    `body` are the ten numbers of `body_inertia`.
    """
    twist, acceleration = parent.twist, parent.acceleration
    linear = acceleration[3:] + ca.cross(twist[:3], twist[3:])
    return recursion.inertial_wrench(inertia.unpack(body), twist[:3], acceleration[:3], linear)


def thrust_wrench(aircraft: Aircraft, inputs: Mapping[str, Number]) -> AnyExpr:
    """Wrench (moment, force), (6, 1), of the thrusts about the body origin, body axes."""
    unknown = sorted(set(inputs) - {thrust.name for thrust in aircraft.thrusts})
    if unknown:
        names = [thrust.name for thrust in aircraft.thrusts]
        raise ValueError(f"inputs: expected names of {names}, found {unknown}")
    total = ca.DM.zeros(6)
    for thrust in aircraft.thrusts:
        force = inputs.get(thrust.name, 0.0) * thrust.direction
        total = total + ca.vertcat(ca.cross(thrust.position, force), force)
    return total


def offsets_of(aircraft: Aircraft) -> list[int]:
    """Where the weights of each wing begin among those of all, and their number."""
    return [0, *np.cumsum([wing.beam.basis.n for wing in aircraft.beams]).tolist()]


def weights_of(aircraft: Aircraft) -> int:
    """Number of weights of all wings."""
    return offsets_of(aircraft)[-1]
