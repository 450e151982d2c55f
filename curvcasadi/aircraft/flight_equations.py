"""The equations of motion of a flexible aircraft in the air, from one Function per part.

As in `free_flight`, the rows are the moment and the force on the whole aircraft about the body
origin in body axes, then the forces on the weights of each wing. The air adds states of its own:
those of every wing, then those of every surface.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import casadi as ca

from curvcasadi.aero.air_states import decays
from curvcasadi.aircraft.balance import surface_points
from curvcasadi.aircraft.flying_wash import wing_wash_function
from curvcasadi.aircraft.flying_wing import wing_balance_function, wing_mass
from curvcasadi.aircraft.free_air import (
    FreeAir,
    strip_points,
    surface_apparent_mass,
    surface_function,
)
from curvcasadi.aircraft.free_motion import body_inertia, body_wrench, thrust_wrench
from curvcasadi.aircraft.parts import Aircraft, LiftingSurface, Wing
from curvcasadi.aircraft.symmetry import check_images
from curvcasadi.dynamics import inertia
from curvcasadi.dynamics.system import ParentMotion
from curvcasadi.kinematics.pose_function import pose_function
from curvcasadi.symbolic.expressions import AnyExpr

#: Velocity of the air (3, 1), m/s, at a position (3, 1), m; inertial axes both.
Wind = Callable[[AnyExpr], AnyExpr]


class FlightState(NamedTuple):
    """The state of a flying aircraft, wings and states of the air by name."""

    attitude: AnyExpr  #: (3, 3), body to inertial axes
    position: AnyExpr  #: (3, 1) of the body origin, m, inertial axes
    q: Mapping[str, AnyExpr]
    twist: AnyExpr  #: (6, 1) of the body, rad/s and m/s, body axes
    q_dot: Mapping[str, AnyExpr]
    lag: Mapping[str, AnyExpr]  #: of wings and surfaces that have states of the air


class Unbalanced(NamedTuple):
    """What a motion leaves unbalanced."""

    wrench: AnyExpr  #: (6, 1) on the whole aircraft, N m and N, body axes
    residuals: dict[str, AnyExpr]  #: (n, 1) by wing, N m²
    needed: dict[str, AnyExpr]  #: wrench (6, 1) that each wing needs of the body, body axes
    rates: AnyExpr  #: of all states of the air, m/s², in order

    @property
    def stacked(self) -> AnyExpr:
        """All rows of the equations, (6 + n, 1)."""
        return ca.vertcat(self.wrench, *self.residuals.values())


@dataclass(frozen=True, eq=False, kw_only=True)
class FlightEquations:
    """An aircraft in the air, divided into Functions.

    Attributes
    ----------
    aircraft : Aircraft
        The aircraft.
    air : FreeAir or None
        The air; None where there is none.
    gravity : float
        m/s², down.
    balances : dict of str to Function
        Those of `flying_wing` by the name of the wing.
    surfaces : dict of str to Function
        `free_air.surface_function` of each surface in the air.
    washes : dict of str to Function
        `flying_wash.wing_wash_function` at the surfaces by the name of the wing; without induced
        flow none.
    """

    aircraft: Aircraft
    air: FreeAir | None
    gravity: float
    balances: dict[str, ca.Function]
    surfaces: dict[str, ca.Function]
    washes: dict[str, ca.Function]

    @property
    def states(self) -> dict[str, int]:
        """Number of states of the air by wing and surface, of those that have some."""
        if self.air is None:
            return {}
        parts: list[Wing | LiftingSurface] = [*self.aircraft.beams, *self.aircraft.surfaces]
        sizes = {part.name: self.air.size(part) for part in parts}
        return {name: size for name, size in sizes.items() if size}


def flight_equations(
    aircraft: Aircraft, air: FreeAir | None, gravity: float, name: str
) -> FlightEquations:
    """The Functions of an aircraft; their names begin with `name`."""
    balances = {
        wing.name: wing_balance_function(wing, air, f"{name}_{wing.name}")
        for wing in aircraft.beams
    }
    surfaces, washes = {}, {}
    if air is not None:
        check_images(aircraft, air.induced_flow)
        surfaces = {
            surface.name: surface_function(surface, air, f"{name}_surface_{k}")
            for k, surface in enumerate(aircraft.surfaces)
        }
    if air is not None and air.induced_flow is not None and aircraft.surfaces:
        points = surface_points(aircraft)
        washes = {
            wing.name: wing_wash_function(wing, air, points, f"{name}_{wing.name}_wash")
            for wing in aircraft.beams
            if wing.strips is not None
        }
    return FlightEquations(
        aircraft=aircraft,
        air=air,
        gravity=gravity,
        balances=balances,
        surfaces=surfaces,
        washes=washes,
    )


def unbalanced(
    equations: FlightEquations,
    state: FlightState,
    twist_rate: AnyExpr,
    q_ddot: Mapping[str, AnyExpr],
    inputs: Mapping[str, Any],
    wind: Wind | None,
) -> Unbalanced:
    """The equations of motion; `twist_rate` (6, 1) are the rates of the components of the twist.

    `wind` is the gust, None where there is none.
    """
    aircraft = equations.aircraft
    down = state.attitude.T @ ca.vertcat(0, 0, equations.gravity)
    thrusts = {thrust.name: inputs[thrust.name] for thrust in aircraft.thrusts}
    wrench = body_wrench(body_inertia(aircraft), ParentMotion(state.twist, twist_rate, down))
    wrench = wrench - thrust_wrench(aircraft, thrusts)
    residuals, needed, rates = {}, {}, []
    for wing in aircraft.beams:
        key, function = wing.name, equations.balances[wing.name]
        known = {**state._asdict(), "twist_rate": twist_rate, "gravity": down, **inputs}
        known |= {"q": state.q[key], "q_dot": state.q_dot[key], "q_ddot": q_ddot[key]}
        known["lag"] = state.lag.get(key)
        if wind is not None and "gust" in function.name_in():
            points, _ = pose_function("strips", wing.beam, strip_points(wing))(known["q"])
            known["gust"] = gusts_at(state, points, wind)
        arguments = (known[name] for name in function.name_in())
        residuals[key], needed[key], found = function(*arguments)
        wrench = wrench + needed[key]
        rates.append(found)
    washes = ca.horzsplit(_washes(equations, state, inputs))
    for surface, wash in zip(aircraft.surfaces, washes, strict=True):
        if surface.name in equations.surfaces:
            load, found = _of_surface(equations, surface, state, twist_rate, wind, wash, inputs)
            wrench = wrench - load
            rates.append(found)
    moving = [rate for rate in rates if rate.numel()]
    return Unbalanced(wrench, residuals, needed, ca.vertcat(type(wrench)(0, 1), *moving))


def air_decays(equations: FlightEquations, state: FlightState) -> AnyExpr:
    """Rates, 1/s, at which the states of the air decay: κ V/b with the mean half chord b."""
    if equations.air is None:
        return ca.DM(0, 1)
    aircraft, rates = equations.aircraft, []
    parts: list[Wing | LiftingSurface] = [*aircraft.beams, *aircraft.surfaces]
    for part in parts:
        count = equations.states.get(part.name, 0)
        if part.strips is None or not count:
            continue
        chords = [part.strips.at("chord", xi) for xi in strip_points(part)]
        poles = [rate for series in equations.air.poles for rate in series]
        rates.append(decays(poles, equations.air.sizes(part), chords))
    return ca.norm_1(state.twist[3:]) * ca.vertcat(*rates)


def flight_mass(equations: FlightEquations, q: Mapping[str, AnyExpr]) -> AnyExpr:
    """Mass matrix of the equations, (6 + n, 6 + n), with the apparent mass of the air."""
    aircraft, air = equations.aircraft, equations.air
    whole: AnyExpr = inertia.momentum(inertia.unpack(body_inertia(aircraft)), ca.DM.eye(6))
    if air is not None:
        for surface in aircraft.surfaces:
            whole = whole + surface_apparent_mass(surface, air)
    blocks = [wing_mass(wing, air, q[wing.name]) for wing in aircraft.beams]
    whole = sum((block.parent for block in blocks), whole)
    coupling = ca.horzcat(*(block.coupling for block in blocks))
    weights = ca.densify(ca.diagcat(*(block.weights for block in blocks)))
    return ca.densify(ca.vertcat(ca.horzcat(whole, coupling), ca.horzcat(coupling.T, weights)))


def _washes(equations: FlightEquations, state: FlightState, inputs: Mapping[str, Any]) -> AnyExpr:
    """Velocities (3, surfaces), m/s, body axes, that the wings induce at the rigid surfaces."""
    total: AnyExpr = ca.DM.zeros(3, len(equations.aircraft.surfaces))
    for key, function in equations.washes.items():
        known = {"q": state.q[key], "twist": state.twist, "lag": state.lag.get(key), **inputs}
        total = total + function(*(known[name] for name in function.name_in()))
    return total


def _of_surface(
    equations: FlightEquations,
    surface: LiftingSurface,
    state: FlightState,
    twist_rate: AnyExpr,
    wind: Wind | None,
    wash: AnyExpr,
    inputs: Mapping[str, Any],
) -> tuple[AnyExpr, AnyExpr]:
    """Wrench on a surface, body axes, and the rates of its states."""
    lag = state.lag.get(surface.name, ca.DM(0, 1))
    gust = ca.DM.zeros(3) if wind is None else gusts_at(state, surface.pose.position, wind)
    deflections = [inputs[name] for name in surface.strips.inputs]
    function = equations.surfaces[surface.name]
    wrench, rates = function(state.twist, twist_rate, lag, gust, wash, *deflections)
    return wrench, rates


def gusts_at(state: FlightState, points: AnyExpr, wind: Wind) -> AnyExpr:
    """Velocities of the gust (3, N), body axes, at points (3, N), m, body axes."""
    at = [state.position + state.attitude @ point for point in ca.horzsplit(points)]
    return state.attitude.T @ ca.horzcat(*(wind(position) for position in at))
