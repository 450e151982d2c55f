"""A clamped wing in a stream as a control model: flutter, gusts, load alleviation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np

from curvcasadi.aero.air_states import state_parts
from curvcasadi.aero.airload import Flow
from curvcasadi.aero.gust import GustEntry
from curvcasadi.aero.induced import LiftingLine, line_of_wing
from curvcasadi.aero.lag_states import IndicialLag
from curvcasadi.aero.unsteady import UnsteadyAirload
from curvcasadi.aircraft.parts import Wing
from curvcasadi.beam.along import scalar
from curvcasadi.beam.pose import Pose
from curvcasadi.control.beam_model import CURVATURE_STATIONS
from curvcasadi.control.bending import element_angles
from curvcasadi.control.model import ControlModel, symbols_of
from curvcasadi.control.second_order import second_order_model
from curvcasadi.control.spans import air_spans, curvature_spans
from curvcasadi.control.symbols import refuse_idle, refuse_sx
from curvcasadi.control.wing_equations import equations, forces_function
from curvcasadi.control.wing_outputs import (
    ACCELERATED,
    OUTPUTS,
    Surroundings,
    output_function,
    output_layout,
)
from curvcasadi.dynamics import system
from curvcasadi.kinematics.root_motion import RootMotion
from curvcasadi.loads.kinds import STANDARD_GRAVITY
from curvcasadi.symbolic.expressions import (
    Number,
    choice,
    function_name,
    instance,
    is_numeric,
    numeric,
    optional,
    positive,
    refuse_repeated,
    sequence,
    station,
)
from curvcasadi.symbolic.layout import Layout, Part


def wing_model(
    wing: Wing,
    *,
    density: float,
    gravity: float = STANDARD_GRAVITY,
    lag: IndicialLag | None = IndicialLag(poles=3, modes=3),  # noqa: B008 (frozen)
    induced_flow: LiftingLine | None = None,
    damping: Number = 0.0,
    gust: GustEntry | None = None,
    parameters: Mapping[str, ca.MX] | None = None,
    outputs: Sequence[str] = OUTPUTS,
    stations: Sequence[float] = CURVATURE_STATIONS,
    name: str = "wing",
) -> ControlModel:
    """A wing whose root is clamped to a body that flies straight and level.

    The body flies north at p["airspeed"], m/s, nose-up by p["pitch"], rad; gravity and dead loads
    turn under it. The state is q, rad/m, q_dot, and the states of the air, m/s (`UnsteadyAirload`).
    Inputs are the deflections of the control surfaces, rad.

    Outputs are known by their names. Those of stations stand station by station:

    ==================  ========================================================================
    tip_position        3, m, body axes
    tip_rotation        9, local to body, by columns
    curvature           K_x, K_y, K_z at each station, rad/m, local axes
    root_moment         3, N m: what the wing hands on to its root, about the root station and in
                        its axes, so that the second entry bends the wing upward where it is
                        negative on a right wing, as K_y does
    root_force          3, N, likewise
    station_position    3 at each station, m, body axes
    station_rotation    9 at each station, local to body, by columns
    angular_rate        3 at each station, rad/s, local axes: what a gyro reads
    acceleration        3 at each station, m/s², local axes: what an accelerometer reads, gravity
                        included
    load_factor         1 at each station: its acceleration toward the upper side over 9.80665 m/s²
    angle_of_attack     1 at each station, rad, at three quarters of the chord, with the motion of
                        the wing and the gust as a whole
    ==================  ========================================================================

    Those of loads and accelerations solve the equations of motion: ask for what is needed where
    time counts.

    Parameters
    ----------
    wing : Wing
        With stiffness and mass.
    density : float
        Of the air, kg/m³.
    gravity : float
        Acceleration of gravity, m/s².
    lag : IndicialLag or None
        Lag of the circulation; None for circulation that follows at once.
    induced_flow : LiftingLine or None
        A lifting line that moves with the wing, or one that is frozen at a shape, or none.
    damping : float or array, shape (n, n)
        The time β, s, of stiffness-proportional damping C = β S, or C itself, as `modal_damping`
        makes it.
    gust : GustEntry or None
        With one p["gust"] is an upward gust, m/s, which enters the strips as it says.
    parameters : mapping of str to MX symbol, optional
        Design symbols, columns, in fields of the wing, by the name of their part of p: stiffness,
        mass, chord, offsets and the pose of the root (sweep) have structured derivatives, length
        and initial curvature those of CasADi.
    outputs : sequence of str
        Names of the outputs that are wanted; all unless given. They stand in the order above.
    stations : sequence of float
        Stations s/L in [0, 1] of the outputs.
    name : str
        Name of the model and of its Functions.

    Returns
    -------
    ControlModel
        With its equations of motion in `second_order`; their derivatives are structured.

    Raises
    ------
    ValueError
        For symbols in the wing that are no parameters, parameters that stand nowhere, a gust that
        is no `GustEntry` (its course is p["gust"] of a simulation), a density of zero with lag
        states, a lifting line or a gust, lag functions that the aerodynamic stations do not
        resolve, and unknown outputs.
    """
    instance("wing", wing, Wing)
    strips = wing.strips
    if strips is None:
        raise ValueError("Wing.strips: expected airfoil data, found None; use beam_model")
    function_name("name", name)
    optional("lag", lag, IndicialLag)
    optional("induced_flow", induced_flow, LiftingLine)
    optional("gust", gust, GustEntry)
    scalar("gravity", gravity)
    refuse_sx(wing)
    acting = {"lag": lag, "induced_flow": induced_flow, "gust": gust}
    if positive("density", numeric("density", density), zero=True) == 0:
        for key, value in acting.items():
            if value is not None:
                raise ValueError(f"density: expected a number above zero with {key}, found 0")
    wanted = [choice("outputs", key, OUTPUTS) for key in sequence("outputs", outputs)]
    places = [station("stations", xi) for xi in sequence("stations", stations)]
    beam, n = wing.beam, wing.beam.basis.n
    inputs = {key: ca.MX.sym(key) for key in strips.inputs}
    airspeed, pitch, upward = ca.MX.sym("airspeed"), ca.MX.sym("pitch"), ca.MX.sym("gust")
    flight = {"airspeed": airspeed, "pitch": pitch}
    if gust is not None:
        flight["gust"] = upward
    design = _design(parameters, {*flight, *inputs})
    c, s = ca.cos(pitch), ca.sin(pitch)
    attitude = ca.vertcat(ca.horzcat(c, 0, s), ca.horzcat(0, 1, 0), ca.horzcat(-s, 0, c))

    def load_of(states: Any) -> UnsteadyAirload:
        return UnsteadyAirload(
            strips=strips,
            flow=Flow(density=density, velocity=airspeed * ca.vertcat(c, 0, s)),
            lag=lag,
            states=states,
            deflections=inputs,
            gust=ca.vertcat(0, 0, -upward) if gust is not None else ca.DM.zeros(3),
            entry=gust,
            induced_flow=line_of_wing(induced_flow, wing.name),
        )

    of_air = state_parts(strips, lag, gust)
    size = of_air.size
    states = ca.MX.sym("lag", size)
    load = load_of(states)
    symbols = {**({"lag": states} if size else {}), **inputs, **flight, **design}
    root = RootMotion(
        pose=Pose(rotation=attitude, position=ca.DM.zeros(3)), gravity=[0, 0, gravity]
    )
    forces = forces_function(f"{name}_forces", wing, load, symbols, root)
    if design:
        built = system.build(beam, [load, *wing.loads], root, {"q": ca.MX.sym("q", n)})
        refuse_idle("parameters", design, built, [] if is_numeric(damping) else [damping])

    x = Layout(
        (
            Part("q", n, "rad/m", *beam.bounds),
            Part("q_dot", n, "rad/(m s)"),
            *((Part("lag", size, "m/s"),) if size else ()),
        )
    )
    u = Layout(tuple(Part(key, 1, "rad") for key in inputs))
    p = Layout(
        (
            *(
                Part(key, 1, _UNITS[key], _LEAST.get(key, -np.inf), nominal=_CALM.get(key))
                for key in flight
            ),
            *(Part(key, symbol.numel(), "SI") for key, symbol in design.items()),
        )
    )
    motion = equations(name, wing, forces, load, design, (x, u, p), damping)
    model = second_order_model(
        name=name,
        x=x,
        u=u,
        p=p,
        y=Layout(()),
        motion=motion,
        output=ca.Function(f"{name}_nothing", [*map(ca.MX.sym, "xup")], [ca.MX(0, 1)]),
        real=beam.grid.real,
        spans=curvature_spans(beam.basis) | ({"lag": air_spans(of_air)} if size else {}),
    )
    y = output_layout(wanted, places)
    around = Surroundings(load, root, symbols)
    values = output_function(f"{name}_outputs", wing, around, y, places)
    output = _output(f"{name}_output", model, values, y)
    bent = element_angles(model.x, {"q": beam})
    return replace(model, y=y, output=output, element_angles=bent)


_UNITS = {"airspeed": "m/s", "pitch": "rad", "gust": "m/s"}
#: The strips, and their lag, are those of a stream that meets the leading edge.
_LEAST = {"airspeed": 0.0}
#: What parameters are unless given.
_CALM = {"gust": 0.0}


def _design(parameters: Mapping[str, ca.MX] | None, taken: set[str]) -> dict[str, ca.MX]:
    """Design symbols by name, checked."""
    design = dict(parameters or {})
    for key, symbol in design.items():
        if not isinstance(symbol, ca.MX) or not symbol.is_valid_input() or not symbol.is_column():
            raise ValueError(
                f"parameters[{key!r}]: expected an MX symbol, a column, found {symbol!r}"
            )
        if key in taken or key in ("q", "q_dot", "q_ddot", "lag"):
            raise ValueError(f"parameters: expected a name of its own, found {key!r}")
        function_name("name in parameters", key)
    refuse_repeated("parameters", design)
    return design


def _output(name: str, model: ControlModel, values: ca.Function, y: Layout) -> ca.Function:
    """(x, u, p) -> y; with accelerations only where an output follows them."""
    x, u, p = symbols_of(model)
    state = model.x.split(x)
    n = state["q"].numel()
    accelerations = ca.MX(n, 1)
    if not ACCELERATED.isdisjoint(part.name for part in y.parts):
        accelerations = model.xdot(x, u, p)[n : 2 * n]
    others = [state["lag"]] if "lag" in state else []
    others += [*model.u.split(u).values(), *model.p.split(p).values()]
    result = values(state["q"], state["q_dot"], accelerations, *others)
    return ca.Function(name, [x, u, p], [result], ["x", "u", "p"], ["y"])
