"""Balance of an aircraft: the wrenches of its parts, and the equilibrium of its wings.

Forces and moments are in body axes (x forward, y right, z down), moments about the body origin. In
steady flight the wrenches of all parts balance, and every wing is in equilibrium.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca

from curvcasadi.aero import AerodynamicLoad
from curvcasadi.aero.airload import strip_data, strip_wrench
from curvcasadi.aircraft.parts import Aircraft, Flight, Wing
from curvcasadi.loads.kinds import Gravity
from curvcasadi.statics.balance import Balance, balance, parameter_slopes
from curvcasadi.symbolic.derivatives import with_jacobian
from curvcasadi.symbolic.expressions import (
    AnyExpr,
    Number,
)
from curvcasadi.symbolic.functions import free_symbols


def wing_loads(wing: Wing, flight: Flight, inputs: Mapping[str, Number]) -> list[Any]:
    """Loads on a wing in flight: airloads, weight where it has mass, and its further loads."""
    airloads: list[Any] = []
    if wing.strips is not None:
        deflections = {name: inputs.get(name, 0.0) for name in wing.strips.inputs}
        airloads.append(
            AerodynamicLoad(strips=wing.strips, flow=flight.flow, deflections=deflections)
        )
    section: Any = wing.beam.section
    heavy = section.mass_per_length is not None or wing.beam.bodies
    weight = [Gravity(flight.acceleration)] if heavy else []
    return [*airloads, *weight, *wing.loads]


def wing_balance(
    wing: Wing, q: AnyExpr, flight: Flight, inputs: Mapping[str, Number], *, tangent: bool = False
) -> Balance:
    """Equilibrium residual of a wing, and the wrench that it hands on to the body."""
    loads = wing_loads(wing, flight, inputs)
    return balance(wing.beam, q, loads, flight.attitude, tangent=tangent)


def rigid_wrenches(
    aircraft: Aircraft, flight: Flight, inputs: Mapping[str, Number]
) -> dict[str, AnyExpr]:
    """Wrenches (moment, force), (6, 1), on the rigid parts by name; body axes, N m and N."""
    body = aircraft.body
    down = flight.attitude.T @ flight.acceleration
    wrenches = {"weight": _at(body.center_of_mass, body.mass * down)}
    for thrust in aircraft.thrusts:
        force = inputs.get(thrust.name, 0.0) * thrust.direction
        wrenches[thrust.name] = _at(thrust.position, force)
    for surface in aircraft.surfaces:
        strips = surface.strips
        deflections = {name: inputs.get(name, 0.0) for name in strips.inputs}
        load = AerodynamicLoad(strips=strips, flow=flight.flow, deflections=deflections)
        chord = strips.at("chord", 0.5)
        data = strip_data(load, 0.5, surface.area / chord, flight.attitude.T)
        wrenches[surface.name] = strip_wrench(surface.pose.rotation, surface.pose.position, data)
    return wrenches


def aircraft_wrench(
    aircraft: Aircraft,
    q: Mapping[str, AnyExpr],
    flight: Flight,
    inputs: Mapping[str, Number],
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

    Returns
    -------
    SX, MX or DM, shape (6, 1)
        Moment, N m, and force, N, about the body origin, body axes.
    """
    unknown = sorted(set(inputs) - set(aircraft.inputs))
    if unknown:
        raise ValueError(f"inputs: expected names of {[*aircraft.inputs]}, found {unknown}")
    total = sum(rigid_wrenches(aircraft, flight, inputs).values())
    for wing in aircraft.beams:
        total = total + wing_balance(wing, q[wing.name], flight, inputs).wrench
    return total


def wing_function(
    wing: Wing, flight: Flight, inputs: Mapping[str, Number], y: ca.MX
) -> ca.Function:
    """`wing_balance` as a Function with its structured derivatives: q, y -> residual, wrench.

    Parameters
    ----------
    y : (m, 1) MX symbol of which `flight` and `inputs` are made
    """
    q = ca.MX.sym("q", wing.beam.basis.n)
    if wing.beam.design_symbols:
        raise ValueError(f"Wing {wing.name!r}: expected numbers, found symbols in its beam")
    loads = wing_loads(wing, flight, inputs)
    value = balance(wing.beam, q, loads, flight.attitude)
    missing = free_symbols(ca.vertcat(value.residual, value.wrench), [q, y])
    if missing:
        raise ValueError(f"Wing {wing.name!r}: expected numbers, found {', '.join(missing)}")
    by_q = balance(wing.beam, q, loads, flight.attitude, tangent=True)
    residual_by_y, wrench_by_y = parameter_slopes(wing.beam, q, loads, y, flight.attitude)
    return with_jacobian(
        f"balance_{wing.name}",
        {"q": q, "y": y},
        {"residual": value.residual, "wrench": value.wrench},
        {
            "residual": ca.horzcat(by_q.residual_slope, residual_by_y),
            "wrench": ca.horzcat(by_q.wrench_slope, wrench_by_y),
        },
    )


def _at(position: AnyExpr, force: AnyExpr) -> AnyExpr:
    return ca.vertcat(ca.cross(position, force), force)
