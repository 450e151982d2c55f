"""Balance of an aircraft: the wrenches of its parts, and the equilibrium of its wings.

Forces and moments are in body axes (x forward, y right, z down), moments about the body origin. In
steady flight the wrenches of all parts balance, and every wing is in equilibrium.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import casadi as ca

from curvcasadi.aero import AerodynamicLoad, LiftingLine, line_functions
from curvcasadi.aero.airload import strip_data, strip_wrench, wash_of
from curvcasadi.aero.induced import line_of_wing
from curvcasadi.aircraft.free_motion import body_inertia, body_wrench
from curvcasadi.aircraft.parts import Aircraft, Flight, Wing
from curvcasadi.dynamics import SteadyRotation
from curvcasadi.dynamics.system import ParentMotion
from curvcasadi.kinematics import chain
from curvcasadi.kinematics.jacobian import jacobian_states, unpack_sums
from curvcasadi.loads.kinds import Gravity
from curvcasadi.loads.stations import loaded_mesh
from curvcasadi.statics.balance import Balance, balance, parameter_slopes
from curvcasadi.symbolic.derivatives import with_jacobian
from curvcasadi.symbolic.expressions import (
    AnyExpr,
    Number,
)
from curvcasadi.symbolic.functions import free_symbols


def wing_loads(
    wing: Wing,
    flight: Flight,
    inputs: Mapping[str, Number],
    induced_flow: LiftingLine | None = None,
) -> list[Any]:
    """Loads on a wing in flight: airloads, weight where it has mass, and its further loads."""
    airloads: list[Any] = []
    if wing.strips is not None:
        deflections = {name: inputs.get(name, 0.0) for name in wing.strips.inputs}
        airloads.append(
            AerodynamicLoad(
                strips=wing.strips,
                flow=flight.flow,
                deflections=deflections,
                induced_flow=line_of_wing(induced_flow, wing.name),
            )
        )
    weight = [Gravity(flight.acceleration)] if _has_mass(wing) else []
    return [*airloads, *weight, *wing.loads]


def _has_mass(wing: Wing) -> bool:
    section: Any = wing.beam.section
    return section.mass_per_length is not None or bool(wing.beam.bodies)


def inertial_loads(wing: Wing, flight: Flight) -> list[Any]:
    """Inertial forces of a wing in a steady turn, at the angular rate of `flight.flow`."""
    if not _has_mass(wing):
        return []
    rate, velocity = flight.flow.angular_rate, flight.flow.velocity
    return [SteadyRotation(angular_rate=rate, velocity=velocity)]


def inertial_wrench(aircraft: Aircraft, flight: Flight) -> AnyExpr:
    """Wrench (moment, force), (6, 1), of the inertia of the rigid body likewise; body axes."""
    twist: AnyExpr = ca.vertcat(flight.flow.angular_rate, flight.flow.velocity)
    steady = ParentMotion(twist, ca.DM.zeros(6), ca.DM.zeros(3))
    return -body_wrench(body_inertia(aircraft), steady)


def wing_balance(
    wing: Wing,
    q: AnyExpr,
    flight: Flight,
    inputs: Mapping[str, Number],
    *,
    induced_flow: LiftingLine | None = None,
    tangent: bool = False,
) -> Balance:
    """Equilibrium residual of a wing, and the wrench that it hands on to the body."""
    loads = wing_loads(wing, flight, inputs, induced_flow)
    return balance(wing.beam, q, loads, flight.attitude, tangent=tangent)


def rigid_wrenches(
    aircraft: Aircraft,
    flight: Flight,
    inputs: Mapping[str, Number],
    wash: AnyExpr | None = None,
) -> dict[str, AnyExpr]:
    """Wrenches (moment, force), (6, 1), on the rigid parts by name; body axes, N m and N.

    `wash` (3, surfaces) is the velocity of the air, m/s, body axes, that wings induce at the
    aerodynamic centre of each surface.
    """
    body = aircraft.body
    down = flight.attitude.T @ flight.acceleration
    wrenches = {"weight": _at(body.center_of_mass, body.mass * down)}
    for thrust in aircraft.thrusts:
        force = inputs.get(thrust.name, 0.0) * thrust.direction
        wrenches[thrust.name] = _at(thrust.position, force)
    for i, surface in enumerate(aircraft.surfaces):
        strips, flow = surface.strips, flight.flow
        if wash is not None:
            flow = replace(flow, velocity=flow.velocity - wash[:, i])
        deflections = {name: inputs.get(name, 0.0) for name in strips.inputs}
        load = AerodynamicLoad(strips=strips, flow=flow, deflections=deflections)
        chord = strips.at("chord", 0.5)
        data = strip_data(load, 0.5, surface.area / chord, flight.attitude.T)
        wrenches[surface.name] = strip_wrench(surface.pose.rotation, surface.pose.position, data)
    return wrenches


def surface_points(aircraft: Aircraft) -> list[AnyExpr]:
    """Aerodynamic centres (3, 1) of the lifting surfaces, m, body axes."""
    return [
        surface.pose.position
        + surface.strips.at("aerodynamic_center", 0.5) * surface.pose.rotation[:, 1]
        for surface in aircraft.surfaces
    ]


class Wash(NamedTuple):
    """Velocities that a wing induces at points off it, m/s, body axes, and their derivatives."""

    value: AnyExpr  #: (3, points)
    by_weights: AnyExpr = None  #: (3 points, n)
    by_parameters: AnyExpr = None  #: (3 points, m)


def wing_wash(
    wing: Wing,
    q: AnyExpr,
    flight: Flight,
    inputs: Mapping[str, Number],
    induced_flow: LiftingLine,
    points: Sequence[AnyExpr],
    parameters: AnyExpr | None = None,
) -> Wash:
    """Velocities that the horseshoes of a wing induce; with `parameters` also their derivatives."""
    if wing.strips is None or not points:
        return Wash(ca.DM.zeros(3, len(points)))
    loads = wing_loads(wing, flight, inputs, induced_flow)
    beam, load, mesh = wing.beam, loads[0], loaded_mesh(wing.beam, loads)
    line = wash_of(load, beam, flight.attitude.T)
    beam_chain = chain.build(beam, load.points, boundaries=mesh.stations)
    slopes = parameters is not None
    if slopes:
        states = jacobian_states(beam_chain, q, beam.root.packed)
    else:
        states = beam_chain.march([chain.pose_step(beam_chain.pattern)], beam.root.packed, q)
    motions = ca.horzcat(*(state[:12] for state in states))
    data = ca.vertcat(line.data, *points)
    value = line_functions.wash(line.key, len(points))(motions, data)
    if parameters is None:
        return Wash(value)
    by_motions, by_data = line_functions.wash_slopes(line.key, len(points))(motions, data)
    moves = ca.vertcat(*(part for state in states for part in unpack_sums(state)))
    return Wash(value, by_motions @ moves, by_data @ ca.densify(ca.jacobian(data, parameters)))


def aircraft_wrench(
    aircraft: Aircraft,
    q: Mapping[str, AnyExpr],
    flight: Flight,
    inputs: Mapping[str, Number],
    induced_flow: LiftingLine | None = None,
) -> AnyExpr:
    """Sum of all wrenches (moment, force) on an aircraft.

    Parameters
    ----------
    aircraft : Aircraft
        Aircraft.
    q : mapping of str to SX, MX, DM or array
        Curvature weights (n, 1), rad/m, by the name of the wing.
    flight : Flight
        Air, attitude and gravity.
    inputs : mapping of str to float or symbol
        Thrusts, N, and deflections, rad, by name; others are zero.
    induced_flow : LiftingLine, optional
        Induced flow of every wing, with its downwash at the lifting surfaces.

    Returns
    -------
    SX, MX or DM, shape (6, 1)
        Moment, N m, and force, N, about the body origin, body axes.
    """
    unknown = sorted(set(inputs) - set(aircraft.inputs))
    if unknown:
        raise ValueError(f"inputs: expected names of {[*aircraft.inputs]}, found {unknown}")
    wash = None
    if induced_flow is not None:
        points = surface_points(aircraft)
        wash = ca.DM.zeros(3, len(points))
        for wing in aircraft.beams:
            washed = wing_wash(wing, q[wing.name], flight, inputs, induced_flow, points)
            wash = wash + washed.value
    total = sum(rigid_wrenches(aircraft, flight, inputs, wash).values())
    for wing in aircraft.beams:
        balanced = wing_balance(wing, q[wing.name], flight, inputs, induced_flow=induced_flow)
        total = total + balanced.wrench
    return total


def wing_function(
    wing: Wing,
    flight: Flight,
    inputs: Mapping[str, Number],
    y: ca.MX,
    induced_flow: LiftingLine | None = None,
    points: Sequence[AnyExpr] = (),
    *,
    turning: bool = False,
) -> ca.Function:
    """`wing_balance` as a Function with its structured derivatives: q, y -> residual, wrench.

    With induced flow a third output is its wash (3, points) at `points`; when `turning` the wing
    has its `inertial_loads` as well.

    Parameters
    ----------
    y : (m, 1) MX symbol of which `flight` and `inputs` are made
    """
    q = ca.MX.sym("q", wing.beam.basis.n)
    if wing.beam.design_symbols:
        raise ValueError(f"Wing {wing.name!r}: expected numbers, found symbols in its beam")
    loads = wing_loads(wing, flight, inputs, induced_flow)
    loads += inertial_loads(wing, flight) if turning else []
    value = balance(wing.beam, q, loads, flight.attitude)
    missing = free_symbols(ca.vertcat(value.residual, value.wrench), [q, y])
    if missing:
        raise ValueError(f"Wing {wing.name!r}: expected numbers, found {', '.join(missing)}")
    by_q = balance(wing.beam, q, loads, flight.attitude, tangent=True)
    residual_by_y, wrench_by_y = parameter_slopes(wing.beam, q, loads, y, flight.attitude)
    outputs = {"residual": value.residual, "wrench": value.wrench}
    slopes = {
        "residual": ca.horzcat(by_q.residual_slope, residual_by_y),
        "wrench": ca.horzcat(by_q.wrench_slope, wrench_by_y),
    }
    if induced_flow is not None and points and wing.strips is not None:
        at = (wing, q, flight, inputs, induced_flow, points)
        outputs["wash"] = wing_wash(*at).value
        found = wing_wash(*at, parameters=y)
        slopes["wash"] = ca.horzcat(found.by_weights, found.by_parameters)
    return with_jacobian(f"balance_{wing.name}", {"q": q, "y": y}, outputs, slopes)


def _at(position: AnyExpr, force: AnyExpr) -> AnyExpr:
    return ca.vertcat(ca.cross(position, force), force)
