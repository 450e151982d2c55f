"""Geometry of wings as people give it: sweep, dihedral, incidence, twist, chord.

In body axes (x forward, y right, z down) the local axes of a right wing, x along the reference
curve, y forward and z up, are

    R = R_x(−dihedral) R_z(sweep) R_0 R_x(twist),      R_0 = [[0, 1, 0], [1, 0, 0], [0, 0, −1]]

with sweep positive tip aft, dihedral positive tip up, and twist about the reference curve positive
leading edge up: the planform is swept in its own plane, which dihedral then tilts about the body's
x axis. The left wing is the mirror image.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from math import pi
from typing import Any, Literal, TypeAlias, get_args

import casadi as ca
import numpy as np

from curvcasadi.beam.along import Piecewise, breaks_of, scalar, vector
from curvcasadi.beam.mirror import CURVATURE, LOCAL, PARENT
from curvcasadi.beam.pose import Pose
from curvcasadi.lie import so3
from curvcasadi.symbolic.expressions import (
    AnyExpr,
    Number,
    choice,
    is_numeric,
    numbers,
    own_fields,
    positive,
)
from curvcasadi.symbolic.plausible import warn_of_size

Side = Literal["right", "left"]
#: Share of the span over which a kink of the reference curve is bent.
KINK = 1e-3
#: Turn over the span, rad, that is rounding.
ROUNDING = 1e-14
#: Sweep and dihedral, and incidence and twist, rad, beyond which a warning names the unit.
LARGEST, LARGEST_TURN = {"sweep": 1.3, "dihedral": 1.3}, 0.6
DEGREES = "degrees are np.deg2rad(...)"
_UNSWEPT = ca.DM([[0, 1, 0], [1, 0, 0], [0, 0, -1]])


def wing_root(
    *,
    side: Side = "right",
    sweep: Number = 0.0,
    dihedral: Number = 0.0,
    incidence: Number = 0.0,
    position: Number = (0.0, 0.0, 0.0),
) -> Pose:
    """The root pose of a half wing in body axes.

    Parameters
    ----------
    side : {"right", "left"}
        The half wing; the same angles on both sides are mirror images.
    sweep : float or symbol
        Of the reference curve, positive tip aft, rad.
    dihedral : float or symbol
        Positive tip up, rad.
    incidence : float or symbol
        Turn of the root section about the reference curve, positive leading edge up, rad.
    position : array, shape (3,)
        Of the root in body axes (x forward, y right, z down), m; y is negative on a left wing.

    Returns
    -------
    Pose
        Of the root, in body axes.

    Raises
    ------
    ValueError
        If an angle is beyond ±π/2, as degrees are.
    """
    choice("side", side, get_args(Side))
    for name, angle in (("sweep", sweep), ("dihedral", dihedral), ("incidence", incidence)):
        _angle(name, angle)
        warn_of_size(name, angle, LARGEST.get(name, LARGEST_TURN), "rad", DEGREES)
    rotation = _axes(sweep, dihedral, incidence)
    if side == "left":
        rotation = ca.diag(PARENT) @ rotation @ ca.diag(LOCAL)
    return Pose(rotation=rotation, position=position)


#: A number, or a table (see `Piecewise`) along the span.
Table: TypeAlias = Any


@dataclass(frozen=True, eq=False, kw_only=True)
class WingGeometry:
    """The unloaded reference curve of a half wing by tables: root pose and initial curvature.

    Sweep and dihedral are constant between stations; where they change, the curve is bent over
    `kink` of the span behind the station, so that the attitude is exact beyond. Twist is linear
    between stations; washout is a twist that falls towards the tip.

    Attributes
    ----------
    length : float
        Arc length of the reference curve, m.
    side : {"right", "left"}
        The half wing.
    sweep, dihedral : float or Piecewise
        rad, positive tip aft and tip up; a table has one value per interval.
    twist : float or Piecewise
        rad, positive leading edge up, about the reference curve; a table has one value per station.
        Its value at the root is the incidence.
    position : array, shape (3,)
        Of the root in body axes, m.
    kink : float
        Share of the span over which a kink is bent.
    """

    length: float
    side: Side = "right"
    sweep: Table = 0.0
    dihedral: Table = 0.0
    twist: Table = 0.0
    position: Number = (0.0, 0.0, 0.0)
    kink: float = KINK

    def __post_init__(self) -> None:
        own_fields(self)
        choice("WingGeometry.side", self.side, get_args(Side))
        positive("WingGeometry.length", self.length)
        vector("WingGeometry.position", self.position)
        for name in ("sweep", "dihedral", "twist"):
            _table(f"WingGeometry.{name}", getattr(self, name), linear=name == "twist")
        for name in ("sweep", "dihedral", "twist"):
            largest = LARGEST.get(name, LARGEST_TURN)
            warn_of_size(f"WingGeometry.{name}", getattr(self, name), largest, "rad", DEGREES)
        closest = min(np.diff([0.0, *self.breaks, 1.0]))
        if not 0 < self.kink < closest:
            raise ValueError(
                f"WingGeometry.kink: expected between 0 and {closest:g}, the shortest interval of "
                f"its tables, found {self.kink}"
            )

    @property
    def breaks(self) -> tuple[float, ...]:
        """Stations at which sweep, dihedral or the slope of twist changes."""
        return breaks_of(self.sweep, self.dihedral, self.twist)

    @property
    def root(self) -> Pose:
        """Root pose, body axes."""
        sweep, dihedral, twist = (
            _at(table, 0.0) for table in (self.sweep, self.dihedral, self.twist)
        )
        return wing_root(
            side=self.side,
            sweep=sweep,
            dihedral=dihedral,
            incidence=twist,
            position=self.position,
        )

    @property
    def initial_curvature(self) -> Piecewise | None:
        """K_0, rad/m, local axes, constant between breaks; None of a straight, untwisted wing."""
        ends = self._ends
        attitudes = [self._axes(0.0, ends[1] / 2)]
        attitudes += [self._axes(b, (a + b) / 2) for a, b in pairwise(ends)]
        values = [
            so3.log(before.T @ after).full().ravel() / (self.length * (right - left))
            for (before, after), (left, right) in zip(
                pairwise(attitudes), pairwise(ends), strict=True
            )
        ]
        values = [np.where(np.abs(value) * self.length > ROUNDING, value, 0.0) for value in values]
        if not np.any(values):
            return None
        if self.side == "left":
            values = [CURVATURE.full().ravel() * value for value in values]
        return Piecewise(ends, values)

    @property
    def _ends(self) -> list[float]:
        """Stations between which the initial curvature is constant."""
        kinks = breaks_of(self.sweep, self.dihedral)
        bent = [station + self.kink for station in kinks]
        return sorted({0.0, *self.breaks, *bent, 1.0})

    def _axes(self, xi: float, inside: float) -> ca.DM:
        """Right-wing axes at a station, with sweep and dihedral of the interval around `inside`."""
        return ca.DM(
            _axes(_at(self.sweep, inside), _at(self.dihedral, inside), _at(self.twist, xi))
        )


def _axes(sweep: Number, dihedral: Number, twist: Number) -> AnyExpr:
    """Local axes of a right wing in body axes, R_x(−dihedral) R_z(sweep) R_0 R_x(twist)."""
    return _about(0, -dihedral) @ _about(2, sweep) @ _UNSWEPT @ _about(0, twist)


def _about(axis: int, angle: Number) -> AnyExpr:
    """Rotation matrix about a coordinate axis."""
    c, s = ca.cos(angle), ca.sin(angle)
    if axis == 0:
        return ca.blockcat([[1, 0, 0], [0, c, -s], [0, s, c]])
    return ca.blockcat([[c, -s, 0], [s, c, 0], [0, 0, 1]])


def _at(table: Table, xi: float) -> float:
    return float(table(xi)) if callable(table) else float(table)


def _angle(name: str, angle: Number) -> Number:
    value = scalar(name, angle)
    if is_numeric(value) and not abs(float(value)) < pi / 2:
        raise ValueError(
            f"{name}: expected an angle between -π/2 and π/2, rad, found {float(value):g}; degrees?"
        )
    return value


def _table(name: str, table: Table, *, linear: bool) -> None:
    if not callable(table):
        _angle(name, table)
        if not is_numeric(table):
            raise ValueError(f"{name}: expected numbers, found the symbol {table}")
        return
    if not isinstance(table, Piecewise) or table.linear != linear:
        number = "one value per station" if linear else "one value per interval"
        raise ValueError(f"{name}: expected a number or a Piecewise with {number}, found {table!r}")
    if linear and np.any(np.diff(table.xi) == 0):
        raise ValueError(f"{name}: expected a twist without jumps, found {list(table.xi)}")
    for value in table.values:
        _angle(name, value)
        numbers(name, value)
