"""A beam with inertia as a control model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import casadi as ca

from curvcasadi.beam.beam import Beam
from curvcasadi.control.bending import element_angles
from curvcasadi.control.damping import damping_matrix
from curvcasadi.control.model import ControlModel, SecondOrder
from curvcasadi.control.second_order import second_order_model
from curvcasadi.control.spans import curvature_spans
from curvcasadi.control.symbols import refuse_idle, refuse_sx
from curvcasadi.dynamics import (
    inverse_dynamics,
    inverse_dynamics_function,
    mass_matrix,
    root_wrench_function,
    system,
)
from curvcasadi.dynamics.inverse import root_wrench
from curvcasadi.dynamics.mass import check_invertible
from curvcasadi.kinematics.pose_function import tip_function
from curvcasadi.kinematics.shape import curvature
from curvcasadi.statics.energy import stiffness_matrix
from curvcasadi.symbolic.expressions import (
    AnyExpr,
    Number,
    choice,
    function_name,
    instance,
    refuse_repeated,
    sequence,
    station,
)
from curvcasadi.symbolic.functions import free_symbols, identities
from curvcasadi.symbolic.layout import Layout, Part

#: Stations of the curvatures among the outputs, unless others are asked for.
CURVATURE_STATIONS = (0.0, 0.25, 0.5, 0.75, 1.0)
#: Names and units of the outputs, in their order.
OUTPUTS = {
    "position": "m",
    "rotation": "1",
    "curvature": "rad/m",
    "root_moment": "N m",
    "root_force": "N",
}
#: Those that follow the accelerations of the weights.
_ACCELERATED = ("root_moment", "root_force")
CSE = {"cse": True}


def beam_model(
    beam: Beam,
    loads: Sequence[Any] = (),
    inputs: Mapping[str, ca.MX] | None = None,
    parameters: Mapping[str, ca.MX] | None = None,
    damping: Number = 0.0,
    *,
    outputs: Sequence[str] = tuple(OUTPUTS),
    curvature_stations: Sequence[float] = CURVATURE_STATIONS,
    name: str = "beam",
) -> ControlModel:
    """A beam with a clamped root that moves under loads.

        M(q) q_ddot + bias(q, q_dot) + C q_dot + S q = Q(q, loads)

    The state is q, rad/m, bounded by `Beam.weight_bounds`, and q_dot. The outputs are known by
    their names:

    ============  ==============================================================================
    position      3, m: the tip, parent axes
    rotation      9: the tip, local to parent, by columns
    curvature     K_x, K_y, K_z at each of `curvature_stations`, rad/m, local axes
    root_moment   3, N m: what the beam hands on to its root, about the root station, root axes
    root_force    3, N, likewise
    ============  ==============================================================================

    The last two solve the equations of motion: leave them out where time counts.

    Parameters
    ----------
    beam : Beam
        With stiffness and mass.
    loads : sequence of loads
        As for `inverse_dynamics`; their fields may hold the symbols of `inputs` and `parameters`.
    inputs, parameters : mapping of str to MX symbol
        Symbols in loads and fields by the name of their part of u or p.
    damping : float or array, shape (n, n)
        The time β, s, of stiffness-proportional damping C = β S, which is exact Kelvin–Voigt
        damping here and gives a mode of frequency ω the damping ratio β ω/2; or C itself, N m³ s,
        as `modal_damping` makes it of the damping ratios of modes.
    outputs : sequence of str
        Names of the outputs that are wanted; all unless given. They stand in the order above.
    curvature_stations : sequence of float
        Stations s/L in [0, 1].
    name : str
        Name of the model and of its Functions.

    Returns
    -------
    ControlModel
        With its equations of motion in `second_order`.

    Raises
    ------
    ValueError
        If a symbol is SX, or neither an input nor a parameter, an input or a parameter stands
        nowhere, there are fewer masses than weights, or as `inverse_dynamics`.
    """
    n = instance("beam", beam, Beam).basis.n
    refuse_sx(beam, sequence("loads", loads))
    wanted = [choice("outputs", key, OUTPUTS) for key in sequence("outputs", outputs)]
    places = [
        station("curvature_stations", xi)
        for xi in sequence("curvature_stations", curvature_stations)
    ]
    inputs, parameters = dict(inputs or {}), dict(parameters or {})
    symbols = _symbols(inputs, parameters)
    listed = list(parameters.values())
    states = [ca.MX.sym(key, n) for key in ("q", "q_dot", "q_ddot")]
    q, q_dot, q_ddot = states
    stiffness = ca.MX(ca.densify(stiffness_matrix(beam)))
    matrix = damping_matrix(damping, n, stiffness)
    force = inverse_dynamics(beam, q, q_dot, q_ddot, loads) + matrix @ q_dot
    built = system.build(beam, loads, None, {"q": q})
    check_invertible(built)
    for argument, named in (("inputs", inputs), ("parameters", parameters)):
        refuse_idle(argument, named, built, [matrix])
    matrices = [ca.MX(ca.densify(mass_matrix(beam, q, loads))), matrix, stiffness]
    _refuse_unnamed(force, [*states, *symbols.values()], "an input or a parameter")
    for value in matrices:
        _refuse_unnamed(value, [q, *listed], "a parameter, as it is not a load's")
    if not beam.shaping_symbols:  # of length and initial curvature there is AD alone
        residual = inverse_dynamics_function(beam, loads, symbols, name=f"{name}_residual")
        force = residual(*states, *symbols.values()) + matrix @ q_dot
    forces = ca.Function(f"{name}_forces", [*states, *symbols.values()], [force], CSE)
    masses = ca.Function(f"{name}_masses", [q, *listed], matrices, CSE)

    x_layout = Layout((Part("q", n, "rad/m", *beam.bounds), Part("q_dot", n, "rad/(m s)")))
    u_layout, p_layout = _layout(inputs), _layout(parameters)
    x, a = ca.MX.sym("x", 2 * n), ca.MX.sym("acceleration", n)
    u, p = ca.MX.sym("u", u_layout.size), ca.MX.sym("p", p_layout.size)
    state = x_layout.split(x)
    u_values, p_values = _unstack(inputs, u_layout, u), _unstack(parameters, p_layout, p)
    balance = [forces(state["q"], state["q_dot"], a, *u_values, *p_values), ca.MX(0, 1)]
    motion = SecondOrder(
        configuration=1,
        velocities=n,
        kinematics=ca.Function(f"{name}_kinematics", [x], [state["q_dot"]], ["x"], ["rate"]),
        balance=ca.Function(
            f"{name}_balance",
            [x, a, u, p],
            balance,
            ["x", "acceleration", "u", "p"],
            ["balance", "other_rates"],
        ),
        matrices=ca.Function(
            f"{name}_matrices",
            [x, p],
            masses.call([state["q"], *p_values]),
            ["x", "p"],
            ["mass", "damping", "stiffness"],
        ),
    )
    model = second_order_model(
        name=name,
        x=x_layout,
        u=u_layout,
        p=p_layout,
        y=Layout(()),
        motion=motion,
        output=ca.Function(f"{name}_nothing", [x, u, p], [ca.MX(0, 1)]),
        real=beam.grid.real,
        spans=curvature_spans(beam.basis),
    )
    of_shape = _shape_outputs(f"{name}_shape", beam, places, wanted, symbols)
    named = dict(zip(symbols, [*u_values, *p_values], strict=True))
    values = of_shape.call({"q": state["q"], **named})
    if not set(wanted).isdisjoint(_ACCELERATED):
        acceleration = model.xdot(x, u, p)[n:]
        wrench = _root_wrench(f"{name}_root_wrench", beam, loads, symbols)(
            state["q"], state["q_dot"], acceleration, *u_values, *p_values
        )
        values |= {"root_moment": wrench[:3], "root_force": wrench[3:]}
    chosen = [key for key in OUTPUTS if key in wanted]
    y = Layout(tuple(Part(key, values[key].numel(), OUTPUTS[key]) for key in chosen))
    stacked = ca.vertcat(ca.MX(0, 1), *(values[key] for key in chosen))
    output = ca.Function(f"{name}_output", [x, u, p], [stacked], ["x", "u", "p"], ["y"])
    bent = element_angles(x_layout, {"q": beam})
    return replace(model, y=y, output=output, element_angles=bent)


def _symbols(inputs: Mapping[str, Any], parameters: Mapping[str, Any]) -> dict[str, ca.MX]:
    """All symbols by name."""
    for field, named in (("inputs", inputs), ("parameters", parameters)):
        for key, symbol in named.items():
            if not isinstance(symbol, ca.MX) or not symbol.is_valid_input():
                raise ValueError(f"{field}[{key!r}]: expected an MX symbol, found {symbol!r}")
            function_name(f"name in {field}", key)
    twice = set(inputs) & set(parameters)
    if twice:
        raise ValueError(f"parameters: expected names other than inputs', found {min(twice)!r}")
    refuse_repeated("inputs, parameters", {**inputs, **parameters})
    return {**inputs, **parameters}


def _refuse_unnamed(value: AnyExpr, known: list[ca.MX], expected: str) -> None:
    missing = free_symbols(value, known)
    if missing:
        raise ValueError(f"{missing[0]}: expected {expected}, found a symbol that is not named")


def _layout(named: Mapping[str, ca.MX]) -> Layout:
    return Layout(tuple(Part(key, symbol.numel(), "SI") for key, symbol in named.items()))


def _unstack(named: Mapping[str, ca.MX], layout: Layout, vector: ca.MX) -> list[ca.MX]:
    """Values of the symbols, in their shapes, out of a stacked vector."""
    parts = layout.split(vector)
    return [ca.reshape(parts[key], *symbol.shape) for key, symbol in named.items()]


def _shape_outputs(
    name: str,
    beam: Beam,
    stations: Sequence[float],
    wanted: Sequence[str],
    symbols: Mapping[str, ca.MX],
) -> ca.Function:
    """(q, inputs and parameters …) -> the outputs that follow the shape alone, by name."""
    q = ca.MX.sym("q", beam.basis.n)
    values: dict[str, ca.MX] = {}
    if not {"position", "rotation"}.isdisjoint(wanted):
        own = set(identities(beam.design_symbols.values()))
        design = {key: x for key, x in symbols.items() if own & set(identities([x]))}
        position, rotation = tip_function(beam, parameters=design)(q, *design.values())
        values |= {"position": position, "rotation": ca.vec(rotation)}
    if "curvature" in wanted:
        places = [station("curvature_stations", xi) for xi in stations]
        values["curvature"] = ca.veccat(*(curvature(beam, q, xi) for xi in places))
    return ca.Function(
        name, [q, *symbols.values()], [*values.values()], ["q", *symbols], [*values], CSE
    )


def _root_wrench(
    name: str, beam: Beam, loads: Sequence[Any], symbols: Mapping[str, ca.MX]
) -> ca.Function:
    """(q, q_dot, q_ddot, inputs and parameters …) -> wrench, derivatives structured if possible."""
    if not beam.shaping_symbols:
        return root_wrench_function(beam, loads, symbols, name=name)
    states = {key: ca.MX.sym(key, beam.basis.n) for key in ("q", "q_dot", "q_ddot")}
    wrench = root_wrench(system.build(beam, loads, None, states), *states.values())
    return ca.Function(name, [*states.values(), *symbols.values()], [wrench], CSE)
