"""What a flying aircraft shows: body and wings, each output with its name and unit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import casadi as ca

from curvcasadi.aero.airload import Flow
from curvcasadi.aero.section import speed_and_angle
from curvcasadi.aero.strip import StripAerodynamics
from curvcasadi.aero.unsteady import UnsteadyAirload
from curvcasadi.aircraft.flight_equations import (
    FlightEquations,
    FlightState,
    Wind,
    gusts_at,
    unbalanced,
)
from curvcasadi.aircraft.parts import Wing
from curvcasadi.beam.pose import Pose
from curvcasadi.control.wing_outputs import (
    CURVATURE,
    ROOT,
    STATION,
    TIP,
    Surroundings,
    motion_function as wing_motion_function,
)
from curvcasadi.kinematics.pose_function import pose_function, tip_function
from curvcasadi.kinematics.root_motion import RootMotion
from curvcasadi.kinematics.shape import curvature
from curvcasadi.lie import se3
from curvcasadi.loads.kinds import STANDARD_GRAVITY
from curvcasadi.symbolic.expressions import AnyExpr
from curvcasadi.symbolic.layout import Layout, Part

#: Outputs of the body: entries, unit.
BODY = {
    "height": (1, "m"),
    "airspeed": (1, "m/s"),
    "angle_of_attack": (1, "rad"),
    "sideslip": (1, "rad"),
    "acceleration": (3, "m/s²"),
    "load_factor": (1, "1"),
}
#: Outputs of each wing, in their order; an underscore and its name stand behind them.
WING = {**TIP, **CURVATURE, **ROOT, **STATION}
EACH = {*CURVATURE, *STATION}
#: Those that follow the accelerations.
ACCELERATED = {*ROOT, "acceleration", "load_factor"}


class Chosen(NamedTuple):
    """The outputs that are wanted, and where."""

    body: tuple[str, ...]
    wings: Mapping[str, tuple[str, ...]]  #: by wing
    stations: tuple[float, ...]

    @property
    def accelerated(self) -> bool:
        """Whether one of them follows the accelerations."""
        names = {*self.body, *(name for names in self.wings.values() for name in names)}
        return not ACCELERATED.isdisjoint(names)

    @property
    def layout(self) -> Layout:
        """The outputs as parts."""
        parts = [Part(name, *BODY[name]) for name in self.body]
        for wing, names in self.wings.items():
            for name in names:
                size, unit = WING[name]
                size *= len(self.stations) if name in EACH else 1
                parts.append(Part(f"{name}_{wing}", size, unit))
        return Layout(tuple(parts))


def output_names(wings: Sequence[Wing]) -> tuple[str, ...]:
    """Names of all outputs, in the order in which they stand."""
    return (*BODY, *(f"{name}_{wing.name}" for wing in wings for name in _known(wing)))


def chosen(wings: Sequence[Wing], outputs: Sequence[str], stations: Sequence[float]) -> Chosen:
    """The known outputs among `outputs`."""
    asked = set(outputs)
    return Chosen(
        tuple(name for name in BODY if name in asked),
        {w.name: tuple(n for n in _known(w) if f"{n}_{w.name}" in asked) for w in wings},
        tuple(stations),
    )


def flight_outputs(
    name: str,
    equations: FlightEquations,
    state: FlightState,
    rates: Mapping[str, AnyExpr],
    inputs: Mapping[str, AnyExpr],
    wind: Wind | None,
    wanted: Chosen,
) -> AnyExpr:
    """The wanted outputs, stacked, with structured derivatives of what is along the wings.

    `rates` are those of the twist and of the weights' rates, as parts of a state.
    """
    values = _body(equations, state, rates["twist"], wanted.body)
    needed: Mapping[str, AnyExpr] = {}
    if any(not ROOT.keys().isdisjoint(names) for names in wanted.wings.values()):
        q_ddot = {key: rates[f"q_dot_{key}"] for key in state.q}
        needed = unbalanced(equations, state, rates["twist"], q_ddot, inputs, wind).needed
    for wing in equations.aircraft.beams:
        asked, q = wanted.wings[wing.name], state.q[wing.name]
        found: dict[str, AnyExpr] = {}
        if not TIP.keys().isdisjoint(asked):
            position, rotation = tip_function(wing.beam)(q)
            found |= {"tip_position": position, "tip_rotation": ca.vec(rotation)}
        if "curvature" in asked:
            along = (curvature(wing.beam, q, xi) for xi in wanted.stations)
            found["curvature"] = ca.veccat(*along)
        if not ROOT.keys().isdisjoint(asked):
            load = -_to_root(wing.beam.root, needed[wing.name])
            found |= {"root_moment": load[:3], "root_force": load[3:]}
        if not STATION.keys().isdisjoint(asked):
            found |= _stations(name, equations, state, rates, wind, wing, wanted.stations)
        values |= {f"{key}_{wing.name}": found[key] for key in asked}
    return wanted.layout.join(values)


def _body(
    equations: FlightEquations, state: FlightState, twist_rate: AnyExpr, asked: Sequence[str]
) -> dict[str, AnyExpr]:
    omega, velocity = state.twist[:3], state.twist[3:]
    flow, angle = speed_and_angle(velocity[0], -velocity[2])
    speed, sideslip = speed_and_angle(flow, -velocity[1])
    down = state.attitude.T @ ca.vertcat(0, 0, equations.gravity)
    felt = twist_rate[3:] + ca.cross(omega, velocity) - down
    values = {
        "height": -state.position[2],
        "airspeed": speed,
        "angle_of_attack": angle,
        "sideslip": sideslip,
        "acceleration": felt,
        "load_factor": -felt[2] / STANDARD_GRAVITY,
    }
    return {name: values[name] for name in asked}


def _stations(
    name: str,
    equations: FlightEquations,
    state: FlightState,
    rates: Mapping[str, AnyExpr],
    wind: Wind | None,
    wing: Wing,
    stations: tuple[float, ...],
) -> dict[str, AnyExpr]:
    """The outputs of stations of a wing."""
    key, beam, count = wing.name, wing.beam, len(stations)
    symbols = {"twist": ca.MX.sym("twist", 6), "twist_rate": ca.MX.sym("twist_rate", 6)}
    symbols |= {"gravity": ca.MX.sym("gravity", 3), "gust": ca.MX.sym("gust", 3, count)}
    inward = se3.adjoint(se3.matrix(beam.root.inverse().rotation, beam.root.inverse().position))
    root = RootMotion(
        twist=inward @ symbols["twist"],
        twist_rate=inward @ symbols["twist_rate"],
        gravity=symbols["gravity"],
    )
    load = UnsteadyAirload(strips=_strips(wing), flow=Flow(density=0.0), lag=None)
    around = Surroundings(load, root, symbols, symbols["gust"])
    function = wing_motion_function(f"{name}_{key}", wing, around, stations)
    gusts: AnyExpr = ca.DM.zeros(3, count)
    if wind is not None:
        points, _ = pose_function("places", beam, stations)(state.q[key])
        gusts = gusts_at(state, points, wind)
    down = state.attitude.T @ ca.vertcat(0, 0, equations.gravity)
    weights = (state.q[key], state.q_dot[key], rates[f"q_dot_{key}"])
    found = function(*weights, state.twist, rates["twist"], down, gusts)
    return dict(zip(function.name_out(), found, strict=True))


def _known(wing: Wing) -> tuple[str, ...]:
    """Outputs of a wing: those of sections only where it has some."""
    of_sections = ("load_factor", "angle_of_attack")
    return tuple(name for name in WING if wing.strips is not None or name not in of_sections)


def _strips(wing: Wing) -> StripAerodynamics:
    """Airfoil data of a wing; of one without them, any."""
    if wing.strips is not None:
        return wing.strips
    return StripAerodynamics(chord=1.0, aerodynamic_center=0.0, lift_slope=1.0, upper_side=1)


def _to_root(root: Pose, wrench: AnyExpr) -> AnyExpr:
    """A wrench about the body origin, body axes, about the root in its axes."""
    moment = wrench[:3] - ca.cross(root.position, wrench[3:])
    return ca.vertcat(root.rotation.T @ moment, root.rotation.T @ wrench[3:])
