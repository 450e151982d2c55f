"""A beam with inertia as a control model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import casadi as ca

from curvcasadi.beam.beam import Beam
from curvcasadi.control.model import ControlModel, SecondOrder
from curvcasadi.control.second_order import second_order_model
from curvcasadi.dynamics import inverse_dynamics, inverse_dynamics_function, mass_matrix
from curvcasadi.kinematics.pose_function import tip_function
from curvcasadi.kinematics.shape import curvature
from curvcasadi.statics.energy import stiffness_matrix
from curvcasadi.symbolic.expressions import (
    AnyExpr,
    Number,
    instance,
    is_numeric,
    numbers,
    station,
)
from curvcasadi.symbolic.functions import free_symbols
from curvcasadi.symbolic.layout import Layout, Part

#: Stations of the curvatures among the outputs, unless others are asked for.
CURVATURE_STATIONS = (0.0, 0.25, 0.5, 0.75, 1.0)
CSE = {"cse": True}


def beam_model(
    beam: Beam,
    loads: Sequence[Any] = (),
    inputs: Mapping[str, ca.MX] | None = None,
    parameters: Mapping[str, ca.MX] | None = None,
    damping: Number = 0.0,
    *,
    curvature_stations: Sequence[float] = CURVATURE_STATIONS,
    name: str = "beam",
) -> ControlModel:
    """A beam with a clamped root that moves under loads.

        M(q) q_ddot + bias(q, q_dot) + C q_dot + S q = Q(q, loads)

    The state is q, rad/m, bounded by `Beam.weight_bounds`, and q_dot. The outputs are position (3),
    m, and rotation (9, by columns) of the tip, local to parent, and curvature (K_x, K_y, K_z at
    each of `curvature_stations`), rad/m, local axes.

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
        damping here and gives a mode of frequency ω the damping ratio β ω/2; or C itself, N m² s,
        as `modal_damping` makes it.
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
        If a symbol is neither an input nor a parameter, or as `inverse_dynamics`.
    """
    n = instance("beam", beam, Beam).basis.n
    inputs, parameters = dict(inputs or {}), dict(parameters or {})
    symbols = _symbols(inputs, parameters)
    listed = list(parameters.values())
    states = [ca.MX.sym(key, n) for key in ("q", "q_dot", "q_ddot")]
    q, q_dot, q_ddot = states
    stiffness = ca.MX(ca.densify(stiffness_matrix(beam)))
    matrix = _damping(damping, n, stiffness)
    force = inverse_dynamics(beam, q, q_dot, q_ddot, loads) + matrix @ q_dot
    matrices = [ca.MX(ca.densify(mass_matrix(beam, q, loads))), matrix, stiffness]
    _refuse_unnamed(force, [*states, *symbols.values()], "an input or a parameter")
    for value in matrices:
        _refuse_unnamed(value, [q, *listed], "a parameter, as it is not a load's")
    if not beam.design_symbols:  # of length, root and initial curvature there is AD alone
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
    outputs = _outputs(beam, state["q"], curvature_stations)
    y = Layout(tuple(Part(key, value.numel(), unit) for key, (value, unit) in outputs.items()))
    stacked = y.join({key: value for key, (value, _) in outputs.items()})
    return second_order_model(
        name=name,
        x=x_layout,
        u=u_layout,
        p=p_layout,
        y=y,
        motion=motion,
        output=ca.Function(f"{name}_output", [x, u, p], [stacked], ["x", "u", "p"], ["y"]),
        real=beam.grid.real,
    )


def _symbols(inputs: Mapping[str, Any], parameters: Mapping[str, Any]) -> dict[str, ca.MX]:
    """All symbols by name."""
    for field, named in (("inputs", inputs), ("parameters", parameters)):
        for key, symbol in named.items():
            if not isinstance(symbol, ca.MX) or not symbol.is_valid_input():
                raise ValueError(f"{field}[{key!r}]: expected an MX symbol, found {symbol!r}")
    twice = set(inputs) & set(parameters)
    if twice:
        raise ValueError(f"parameters: expected names other than inputs', found {min(twice)!r}")
    return {**inputs, **parameters}


def _refuse_unnamed(value: AnyExpr, known: list[ca.MX], expected: str) -> None:
    missing = free_symbols(value, known)
    if missing:
        raise ValueError(f"{missing[0]}: expected {expected}, found a symbol that is not named")


def _damping(value: Number, n: int, stiffness: ca.MX) -> ca.MX:
    """C of a number β, C = β S, or of C itself."""
    if not is_numeric(value):
        matrix = value * stiffness if value.numel() == 1 else value
    else:
        array = numbers("damping", value)
        if array.size == 1 and not float(array.ravel()[0]) >= 0:
            raise ValueError(f"damping: expected a time of at least zero, s, found {array}")
        matrix = float(array.ravel()[0]) * stiffness if array.size == 1 else ca.MX(ca.DM(array))
    if matrix.shape != (n, n):
        raise ValueError(f"damping: expected a number or a matrix ({n}, {n}), found {matrix.shape}")
    return ca.densify(matrix)


def _layout(named: Mapping[str, ca.MX]) -> Layout:
    return Layout(tuple(Part(key, symbol.numel(), "SI") for key, symbol in named.items()))


def _unstack(named: Mapping[str, ca.MX], layout: Layout, vector: ca.MX) -> list[ca.MX]:
    """Values of the symbols, in their shapes, out of a stacked vector."""
    parts = layout.split(vector)
    return [ca.reshape(parts[key], *symbol.shape) for key, symbol in named.items()]


def _outputs(beam: Beam, q: ca.MX, stations: Sequence[float]) -> dict[str, tuple[ca.MX, str]]:
    """Values and units of the outputs by name."""
    position, rotation = tip_function(beam)(q)
    stations = [station("curvature_stations", xi) for xi in stations]
    curvatures = ca.veccat(*(curvature(beam, q, xi) for xi in stations))
    return {
        "position": (position, "m"),
        "rotation": (ca.vec(rotation), "1"),
        "curvature": (curvatures, "rad/m"),
    }
