"""A flexible aircraft in free flight as a control model."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple, TypeAlias

import casadi as ca

from curvcasadi.aero.gust import GustEntry, GustField
from curvcasadi.aero.induced import LiftingLine
from curvcasadi.aero.lag_states import IndicialLag
from curvcasadi.aircraft.flight_equations import (
    FlightEquations,
    FlightState,
    Wind,
    air_decays,
    flight_equations,
    flight_mass,
    unbalanced,
)
from curvcasadi.aircraft.free_air import FreeAir
from curvcasadi.aircraft.free_flight import free_momenta
from curvcasadi.aircraft.free_motion import offsets_of
from curvcasadi.aircraft.parts import Aircraft, LiftingSurface, Wing
from curvcasadi.beam.along import scalar
from curvcasadi.control.bending import element_angles
from curvcasadi.control.damping import damping_matrix
from curvcasadi.control.flight_outputs import Chosen, chosen, flight_outputs, output_names
from curvcasadi.control.model import ControlModel, SecondOrder
from curvcasadi.control.second_order import second_order_model
from curvcasadi.control.spans import Span, air_spans, curvature_spans
from curvcasadi.lie import quaternion
from curvcasadi.loads.kinds import STANDARD_GRAVITY
from curvcasadi.statics.energy import stiffness_matrix
from curvcasadi.symbolic.expressions import (
    AnyExpr,
    Number,
    choice,
    function_name,
    instance,
    number,
    numeric,
    optional,
    positive,
    sequence,
    station,
)
from curvcasadi.symbolic.layout import Layout, Part

#: The lag of the air unless the user says otherwise.
LAG = IndicialLag(poles=3, modes=3)
#: How strips follow a gust unless the user says otherwise.
ENTRY = GustEntry()
#: Stations of outputs unless the user says otherwise.
STATIONS = (0.0, 0.5, 1.0)
#: An upward gust whose velocity is a parameter, one in space and time, or one in time, s -> m/s up.
Gust: TypeAlias = GustEntry | GustField | Callable[[AnyExpr], AnyExpr] | None


def aircraft_model(
    aircraft: Aircraft,
    *,
    density: float,
    gravity: float = STANDARD_GRAVITY,
    lag: IndicialLag | None = LAG,
    induced_flow: LiftingLine | None = None,
    damping: Number | Mapping[str, Number] = 0.0,
    gust: Gust = None,
    entry: GustEntry = ENTRY,
    outputs: Sequence[str] | None = None,
    stations: Sequence[float] = STATIONS,
    name: str = "aircraft",
) -> ControlModel:
    """A rigid body with flexible wings and rigid surfaces that flies freely.

    The state is the attitude of the body axes (a unit quaternion, body to inertial axes), the
    position of the body origin (north, east, down), q of each wing, the body twist (rad/s, m/s) at
    the body origin, q_dot of each wing, and the states of the air of each wing and surface, m/s
    (`UnsteadyAirload`). The inputs are deflections, rad, then thrusts, N.

    Outputs are known by their names: first those of the body, then those of each wing, behind which
    stand an underscore and its name, as in "root_moment_right". Those of stations stand station by
    station.

    ==================  ========================================================================
    height              of the body origin, m
    airspeed            of the body origin in air without gusts, m/s
    angle_of_attack     of the body x axis there, rad
    sideslip            likewise, rad
    acceleration        3, m/s², body axes: what an accelerometer at the body origin reads
    load_factor         that along −z over 9.80665 m/s²
    ..._<wing>          tip_position, tip_rotation, curvature, root_moment, root_force,
                        station_position, station_rotation, angular_rate, acceleration, load_factor,
                        angle_of_attack: as of `wing_model`, positions and rotations in body axes,
                        the last two of wings with airfoil data
    ==================  ========================================================================

    Those of loads and accelerations solve the equations of motion: ask for what is needed where
    time counts.

    Parameters
    ----------
    aircraft : Aircraft
        With the inertia of its body, and mass in its wings.
    density : float
        Density of the air, kg/m³; with 0 there is no air.
    gravity : float
        m/s², down.
    lag : IndicialLag or None
        Lag of the circulation; None for circulation that follows at once.
    induced_flow : LiftingLine or None
        A lifting line of each wing, which moves with it or is frozen at a shape, and whose
        horseshoes also turn the air at the rigid surfaces, at once; or none.
    damping : float, array or mapping of str to either
        The time β, s, of stiffness-proportional damping C = β S of the wings, or a matrix C (n, n)
        for each of them, as `modal_damping` makes it; or these by the name of the wing.
    gust : GustEntry, GustField, function of time, or None
        With a `GustEntry` p["gust"] is an upward gust, m/s, the same everywhere. A `GustField` is
        met by every strip where it is, at p["time"], s; a function of time such as
        `OneMinusCosine`, m/s upward, is met by all of them at once. In `simulate` p["time"] is the
        time unless given.
    entry : GustEntry
        How the strips follow a gust that is not a `GustEntry` itself.
    outputs : sequence of str, optional
        Names of the outputs that are wanted; all unless given. They stand in the order above.
    stations : sequence of float
        Stations s/L in [0, 1] of the outputs of each wing.
    name : str
        Name of the model and of its Functions.

    Returns
    -------
    ControlModel
        With its equations of motion in `second_order`, whose derivatives are structured, and, where
        there is no air, its momenta.

    Raises
    ------
    ValueError
        If the density is below zero, or zero with a gust or a lag of its own; if a lifting line has
        an image that a wing has not; if a field holds a symbol, or as `free_inverse_dynamics`.
    """
    instance("aircraft", aircraft, Aircraft)
    function_name("name", name)
    optional("lag", lag, IndicialLag)
    optional("induced_flow", induced_flow, LiftingLine)
    instance("entry", entry, GustEntry)
    matrix = _damping(aircraft, damping)
    gusts = _gusts(gust, entry)
    equations = flight_equations(
        aircraft, _air(density, lag, gusts, induced_flow), number("gravity", gravity), name
    )
    wanted = _wanted(aircraft, outputs, stations)
    x, u, p = _layouts(equations, gusts)
    symbols = {key: ca.MX.sym(key, part.size) for key, part in (("x", x), ("u", u), ("p", p))}
    model = second_order_model(
        name=name,
        x=x,
        u=u,
        p=p,
        y=wanted.layout,
        motion=_motion(name, equations, x, u, symbols, gusts, matrix),
        output=ca.Function(f"{name}_nothing", [*symbols.values()], [ca.MX(0, 1)]),
        real=aircraft.beams[0].beam.grid.real,
        spans=_spans(aircraft, equations),
    )
    rates = model.xdot(*symbols.values()) if wanted.accelerated else ca.MX(x.size, 1)
    y = flight_outputs(
        f"{name}_motion",
        equations,
        flight_state(aircraft, x.split(symbols["x"])),
        x.split(rates),
        u.split(symbols["u"]),
        gusts.wind(symbols["p"]),
        wanted,
    )
    output = ca.Function(f"{name}_output", [*symbols.values()], [y], [*symbols], ["y"])
    bent = element_angles(x, {f"q_{wing.name}": wing.beam for wing in aircraft.beams})
    return replace(model, output=output, element_angles=bent)


def _wanted(aircraft: Aircraft, outputs: Sequence[str] | None, stations: Sequence[float]) -> Chosen:
    names = output_names(aircraft.beams)
    asked = names if outputs is None else sequence("outputs", outputs)
    places = [station("stations", xi) for xi in sequence("stations", stations)]
    return chosen(aircraft.beams, [choice("outputs", key, names) for key in asked], places)


def flight_state(aircraft: Aircraft, parts: Mapping[str, AnyExpr]) -> FlightState:
    """The state of an aircraft from the parts of x by name."""
    wings = [wing.name for wing in aircraft.beams]
    names = [*wings, *(surface.name for surface in aircraft.surfaces)]
    return FlightState(
        attitude=quaternion.rotation(parts["quaternion_wxyz"]),
        position=parts["position"],
        q={name: parts[f"q_{name}"] for name in wings},
        twist=parts["twist"],
        q_dot={name: parts[f"q_dot_{name}"] for name in wings},
        lag={name: parts[f"lag_{name}"] for name in names if f"lag_{name}" in parts},
    )


class _Gusts(NamedTuple):
    """How a gust enters a model."""

    entry: GustEntry | None
    parameter: Part | None
    velocity: Callable[[AnyExpr, AnyExpr], AnyExpr]  #: (position, parameter), inertial axes

    def wind(self, p: ca.MX) -> Wind | None:
        """The gust as a function of the position alone."""
        if self.entry is None:
            return None
        return lambda position: self.velocity(position, p)


def _gusts(gust: Gust, entry: GustEntry) -> _Gusts:
    if gust is None:
        return _Gusts(None, None, lambda position, p: ca.DM.zeros(3))
    if isinstance(gust, GustEntry):
        part = Part("gust", 1, "m/s", nominal=0.0)
        return _Gusts(gust, part, lambda position, p: ca.vertcat(0, 0, -p))
    time = Part("time", 1, "s")
    if isinstance(gust, GustField):
        return _Gusts(entry, time, gust)
    if not callable(gust):
        raise ValueError(
            "gust: expected a GustEntry, a GustField or a function of time such as OneMinusCosine, "
            f"found {gust!r}"
        )
    return _Gusts(entry, time, lambda position, p: ca.vertcat(0, 0, -scalar("gust", gust(p))))


def _damping(aircraft: Aircraft, damping: Number | Mapping[str, Number]) -> ca.DM:
    """C of the velocities, (6 + n, 6 + n)."""
    names = [wing.name for wing in aircraft.beams]
    if not isinstance(damping, Mapping):
        damping = dict.fromkeys(names, damping)
    if set(damping) != set(names):
        raise ValueError(f"damping: expected the wings {names}, found {sorted(damping)}")
    blocks = [ca.DM(6, 6)]
    for wing in aircraft.beams:
        value, n = numeric("damping", damping[wing.name]), wing.beam.basis.n
        made = damping_matrix(value, n, ca.DM(stiffness_matrix(wing.beam)))
        blocks.append(ca.evalf(made))
    return ca.DM(ca.sparsify(ca.diagcat(*blocks)))


def _spans(aircraft: Aircraft, equations: FlightEquations) -> dict[str, tuple[Span, ...]]:
    """Functions along the span of the wings' weights and of the states of the air."""
    found: dict[str, tuple[Span, ...]] = {}
    for wing in aircraft.beams:
        found |= curvature_spans(wing.beam.basis, wing.name)
    parts: list[Wing | LiftingSurface] = [*aircraft.beams, *aircraft.surfaces]
    for part in parts:
        states = None if equations.air is None else equations.air.states(part)
        if states is not None and states.size:
            found[f"lag_{part.name}"] = air_spans(states)
    return found


def _air(
    density: float, lag: IndicialLag | None, gusts: _Gusts, induced_flow: LiftingLine | None
) -> FreeAir | None:
    rho = float(positive("density", numeric("density", density), zero=True))
    if rho > 0:
        return FreeAir(density=rho, lag=lag, entry=gusts.entry, induced_flow=induced_flow)
    if gusts.entry is not None or induced_flow is not None or lag not in (LAG, None):
        raise ValueError(
            "density: expected a number above zero with a gust, an induced flow or a lag, found 0"
        )
    return None


def _layouts(equations: FlightEquations, gusts: _Gusts) -> tuple[Layout, Layout, Layout]:
    """Parts of x, u and p."""
    aircraft = equations.aircraft
    beams = [(wing.name, wing.beam) for wing in aircraft.beams]
    configuration = [Part("quaternion_wxyz", 4, "1", attitude=True), Part("position", 3, "m")]
    configuration += [
        Part(f"q_{name}", beam.basis.n, "rad/m", *beam.bounds) for name, beam in beams
    ]
    velocities = [Part("twist", 6, "rad/s, m/s")]
    velocities += [Part(f"q_dot_{name}", beam.basis.n, "rad/(m s)") for name, beam in beams]
    lag = [Part(f"lag_{name}", size, "m/s") for name, size in equations.states.items()]
    # Deflections before thrusts.
    units = sorted(aircraft.inputs.items(), key=lambda pair: pair[1] == "N")
    parameters = () if gusts.parameter is None else (gusts.parameter,)
    return (
        Layout((*configuration, *velocities, *lag)),
        Layout(tuple(Part(name, 1, unit) for name, unit in units)),
        Layout(parameters),
    )


def _motion(
    name: str,
    equations: FlightEquations,
    x_layout: Layout,
    u_layout: Layout,
    symbols: Mapping[str, ca.MX],
    gusts: _Gusts,
    damping: ca.DM,
) -> SecondOrder:
    """The equations of motion as the integrators take them."""
    aircraft = equations.aircraft
    x, u, p = symbols.values()
    parts, inputs = x_layout.split(x), u_layout.split(u)
    state = flight_state(aircraft, parts)
    ends = [6 + k for k in offsets_of(aircraft)]
    a = ca.MX.sym("acceleration", ends[-1])
    twist_rate, *accelerations = ca.vertsplit(a, [0, *ends])
    q_ddot: Any = dict(zip(state.q, accelerations, strict=True))
    stiffness = ca.diagcat(ca.DM(6, 6), *(ca.DM(stiffness_matrix(w.beam)) for w in aircraft.beams))
    velocity = ca.vertcat(state.twist, *state.q_dot.values())
    left = unbalanced(equations, state, twist_rate, q_ddot, inputs, gusts.wind(p))
    mass = flight_mass(equations, state.q)
    omega, linear, rates = ca.vertsplit(velocity, [0, 3, 6, ends[-1]])
    rate = ca.vertcat(omega, state.attitude @ linear, rates)
    matrices = [mass, ca.densify(damping), ca.densify(stiffness)]
    momenta = None
    if equations.air is None:
        found = free_momenta(aircraft, ca.vertcat(*state.q.values()), velocity)
        momenta = ca.Function(
            f"{name}_momenta",
            [x],
            [found.velocities, ca.vertcat(ca.MX.zeros(6), found.by_shape)],
            ["x"],
            ["momenta", "by_configuration"],
        )
    return SecondOrder(
        configuration=2 + len(state.q),
        velocities=ends[-1],
        kinematics=ca.Function(f"{name}_kinematics", [x], [rate], ["x"], ["rate"]),
        balance=ca.Function(
            f"{name}_balance",
            [x, a, u, p],
            [left.stacked + damping @ velocity, left.rates],
            ["x", "acceleration", "u", "p"],
            ["balance", "other_rates"],
        ),
        matrices=ca.Function(
            f"{name}_matrices", [x, p], matrices, ["x", "p"], ["mass", "damping", "stiffness"]
        ),
        momenta=momenta,
        decays=ca.Function(
            f"{name}_decays", [x, p], [air_decays(equations, state)], ["x", "p"], ["decays"]
        ),
    )
