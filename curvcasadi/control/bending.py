"""How far the elements of the beams of a model are bent in a state."""

from __future__ import annotations

import warnings
from collections.abc import Mapping

import casadi as ca
import numpy as np

from curvcasadi.beam.beam import Beam
from curvcasadi.control.model import ControlModel
from curvcasadi.kinematics.shape import squared_element_angles
from curvcasadi.symbolic.expressions import BOUND_SLACK, Array
from curvcasadi.symbolic.layout import Layout


def element_angles(x: Layout, beams: Mapping[str, Beam]) -> ca.Function | None:
    """(x) -> squared angles of the elements over what they may turn, for `ControlModel`.

    `beams` are known by the part of the state that holds their weights. None where their length
    or initial curvature is a parameter.
    """
    if any(beam.shaping_symbols for beam in beams.values()):
        return None
    state = ca.MX.sym("x", x.size)
    parts = x.split(state)
    squares = [
        squared_element_angles(beam, parts[name]) / beam.grid.max_angle**2
        for name, beam in beams.items()
    ]
    return ca.Function("element_angles", [state], [ca.vertcat(*squares)], ["x"], ["angles"])


def check_bending(model: ControlModel, x: Array) -> None:
    """Refuse a state in which an element turns too far.

    Raises
    ------
    ValueError
        It names the angle in terms of `Grid.max_angle`.
    """
    largest = _largest(model, x[:, None])[0]
    if largest > 1 + BOUND_SLACK[model.real]:
        raise ValueError(
            f"x0: expected every element to turn at most Grid.max_angle, found {largest:.3g} times "
            "as much; weights are in rad/m. Use more elements for such a shape"
        )


def warn_of_bending(
    model: ControlModel, at: Array, states: Array, what: str = "simulate", unit: str = "s"
) -> None:
    """Warn where states (nx, T) at times or speeds (T,) first turn an element too far."""
    largest = _largest(model, states)
    beyond = np.flatnonzero(largest > 1 + BOUND_SLACK[model.real])
    if beyond.size:
        first, most = at[beyond[0]], largest.max()
        name = "t" if unit == "s" else "V"
        warnings.warn(
            f"{what}: from {name} = {first:g} {unit} on elements turn by up to {most:.3g} times "
            "Grid.max_angle, where the motion is not exact; use more elements",
            stacklevel=3,
        )


def _largest(model: ControlModel, states: Array) -> Array:
    """Largest angle of each state over what it may be, (T,)."""
    if model.element_angles is None:
        return np.zeros(states.shape[1])
    squares = model.element_angles.map(states.shape[1])(states).full()
    return np.asarray(np.sqrt(squares.max(axis=0)))
