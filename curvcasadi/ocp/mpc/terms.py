"""What a predictive controller weighs and bounds."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from curvcasadi.control.model import ControlModel
from curvcasadi.lie import quaternion, so3
from curvcasadi.symbolic.expressions import Array
from curvcasadi.symbolic.layout import Part

Source = Literal["y", "x", "u", "angles", "rate"]

#: Name under which the squared angles of elements, over what they may be, are bounded.
ANGLES = "element_angles"
#: How many times as far as the other bound a bound tells nothing of the size of a quantity.
WIDE = 1e4
#: Range beside the bounds' place below which it tells nothing either.
NARROW = 1e-3
#: Outputs with this word in their name are rotation matrices by columns, one or several.
_ROTATION = "rotation"


@dataclass(frozen=True, eq=False, kw_only=True)
class Penalty:
    """½ Σ weight error² of a part of the outputs, the state or the input at the end of each stage.

    Attributes
    ----------
    part : Part
        What is compared with its reference.
    source : {"y", "x", "u"}
        Where it stands.
    weights : array, shape (ne,)
        Of the entries of its error; three for an attitude.
    """

    part: Part
    source: Source
    weights: Array

    @property
    def is_rotation(self) -> bool:
        """Whether its values are rotation matrices by columns, one or several."""
        return is_rotation(self.part) and self.source == "y"

    def error(self, value: ca.MX, goal: ca.MX) -> ca.MX:
        """Weighted error (ne, 1): a difference, or the rotation vector from the goal."""
        if self.is_rotation:
            pairs = zip(ca.vertsplit(value, 9), ca.vertsplit(goal, 9), strict=True)
            turns = [so3.log_error(*(ca.reshape(r, 3, 3) for r in pair)) for pair in pairs]
            difference = ca.vertcat(*turns)
        elif self.part.attitude:
            difference = quaternion.log(quaternion.product(quaternion.conjugate(goal), value))
        else:
            difference = value - goal
        return ca.DM(np.sqrt(self.weights)) * difference


@dataclass(frozen=True, eq=False, kw_only=True)
class Limit:
    """Bounds of a part, scaled by its units; soft where it has a weight.

    Attributes
    ----------
    name : str
        Name of the part.
    source : {"y", "x", "u", "angles", "rate"}
        Where it stands; "rate" for rates of a part of the state.
    rows : array of int
        Its entries with bounds, among those of all parts of the source.
    lower, upper : array, shape (rows,)
        Bounds; infinite where there is none on one side.
    weight : float or None
        Of the squared excess, ½ weight slack²; None for a bound that holds.
    """

    name: str
    source: Source
    rows: NDArray[np.intp]
    lower: Array
    upper: Array
    weight: float | None = None

    @property
    def unit(self) -> float:
        """Size of what is bounded: that of the narrowest range, or the largest of lone bounds."""
        ranges = sizes(self.lower, self.upper)
        if np.any(ranges > 0):
            return float(np.min(ranges[ranges > 0]))
        ends = np.abs(np.concatenate([self.lower, self.upper]))
        largest = float(np.max(ends[np.isfinite(ends)]))
        return largest if largest > 0 else 1.0


@dataclass(frozen=True, eq=False, kw_only=True)
class Terminal:
    """½ |factor (δ, u − u_rest)|², of the state and the input at the end of the last stage.

    Attributes
    ----------
    x, u : array, shape (nx,), (nu,)
        The equilibrium.
    y : array, shape (ny,)
        Its outputs.
    factor : array, shape (rank, nd + nu)
        Of P = factorᵀ factor.
    """

    x: Array
    u: Array
    y: Array
    factor: Array


def sizes(lower: Array, upper: Array) -> Array:
    """Sizes of what lies between bounds: half their range; 0 where that is none.

    A bound that is `WIDE` times as far as the other is one in name only: the size is that of the
    nearer one. Beside its place no range is narrower than `NARROW`, as rounding is none.
    """
    found = np.zeros(lower.size)
    for i, (low, high) in enumerate(zip(lower, upper, strict=True)):
        nearer, farther = sorted((abs(low), abs(high)))
        if high > low and np.isfinite(farther):
            named = 0 < nearer < farther / WIDE
            found[i] = nearer if named else max((high - low) / 2, NARROW * farther)
    return found


def is_rotation(part: Part) -> bool:
    """Whether a part holds rotation matrices by columns."""
    return part.size % 9 == 0 and _ROTATION in part.name.split("_")


def angle_function(model: ControlModel) -> ca.Function | None:
    """(x) -> squared angles of elements over what they may be: of those that may exceed it."""
    return model.angles if model.angles is not None else model.element_angles
