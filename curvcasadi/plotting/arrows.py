"""Loads of a deformed wing as arrows."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from curvcasadi.aero.airload import AerodynamicLoad, strip_data, strip_wrench
from curvcasadi.beam.along import Along, vector
from curvcasadi.beam.beam import Beam
from curvcasadi.beam.section import Section
from curvcasadi.kinematics.shape import pose_at
from curvcasadi.loads.kinds import (
    DistributedForce,
    DistributedMoment,
    Gravity,
    PointForce,
    PointMoment,
)
from curvcasadi.symbolic.expressions import Array

#: Stations at which distributed loads are drawn, s/L.
ALONG = np.linspace(0.02, 0.98, 13)
#: Length of the longest arrow of each kind, as a fraction of the length of the wing.
LONGEST = 0.2


class Arrows(NamedTuple):
    """Arrows of one kind of load; their length is in proportion to the load."""

    name: str
    unit: str
    points: Array  #: (3, k), m, parent axes
    values: Array  #: (3, k), in `unit`, parent axes

    @property
    def label(self) -> str:
        """What the legend says."""
        largest = np.max(np.linalg.norm(self.values, axis=0))
        return f"{self.name}, largest {largest:.3g} {self.unit}"

    def lengths(self, longest: float) -> Array:
        """Arrows (3, k) of which the longest has this length, m."""
        largest = np.max(np.linalg.norm(self.values, axis=0))
        return self.values * (longest / largest) if largest > 0 else self.values


def with_mirror_images(arrows: Sequence[Arrows]) -> list[Arrows]:
    """Arrows and their mirror images in the parent's x-z plane; moments are axial vectors."""
    plane = np.array([[1.0], [-1.0], [1.0]])
    return [
        Arrows(
            kind.name,
            kind.unit,
            np.hstack([kind.points, plane * kind.points]),
            np.hstack([kind.values, plane * kind.values * (-1 if "moment" in kind.name else 1)]),
        )
        for kind in arrows
    ]


#: (station, force or moment in `frame`, unit) at a distance `offset` from the curve.
_Site = tuple[float, Any, str, Any]


def load_arrows(beam: Beam, q: Array, loads: Sequence[Any]) -> list[Arrows]:
    """Arrows of all loads, by kind. Inertial axes are parent axes."""
    arrows: list[Arrows] = []
    for load in loads:
        if isinstance(load, AerodynamicLoad):
            arrows.append(_airload(beam, q, load))
            continue
        makers = [make for kind, make in _KINDS.items() if isinstance(load, kind)]
        if not makers:
            known = ", ".join(kind.__name__ for kind in (*_KINDS, AerodynamicLoad))
            raise ValueError(f"loads: expected {known} in a figure, found {type(load).__name__}")
        for name, unit, sites in makers[0](beam, load):
            points, values = [], []
            for xi, value, frame, offset in sites:
                pose = pose_at(beam, q, xi)
                value = ca.DM(value)
                values.append((pose.rotation @ value if frame == "follower" else value).full())
                points.append((pose.position + pose.rotation @ ca.DM(offset)).full())
            arrows.append(Arrows(name, unit, np.hstack(points), np.hstack(values)))
    return arrows


def _airload(beam: Beam, q: Array, load: AerodynamicLoad) -> Arrows:
    """Force per length in the flow of each strip alone, at the aerodynamic centres."""
    if load.induced_flow is not None:
        raise ValueError("loads: expected airloads without induced flow in a figure, found some")
    points, values = [], []
    for xi in ALONG:
        pose = pose_at(beam, q, xi)
        data = strip_data(load, xi, 1.0, ca.DM.eye(3))
        values.append(ca.DM(strip_wrench(pose.rotation, pose.position, data))[3:].full())
        ahead = float(load.strips.at("aerodynamic_center", xi))
        points.append((pose.position + pose.rotation[:, 1] * ahead).full())
    return Arrows("airload", "N/m", np.hstack(points), np.hstack(values))


_Rows = list[tuple[str, str, list[_Site]]]


def _gravity(beam: Beam, load: Gravity) -> _Rows:
    rows: _Rows = []
    section = beam.section
    if isinstance(section, Section) and load.is_distributed(beam):
        along = [
            (xi, section.mass_at(xi) * load.acceleration, "dead", section.center_of_mass_at(xi))
            for xi in ALONG
        ]
        rows.append(("weight", "N/m", along))
    if beam.bodies:
        bodies = [(b.xi, b.mass * load.acceleration, "dead", b.offset) for b in beam.bodies]
        rows.append(("weight of bodies", "N", bodies))
    return rows


def _point_force(beam: Beam, load: PointForce) -> _Rows:
    return [("force", "N", [(load.xi, load.force, load.frame, load.offset)])]


def _point_moment(beam: Beam, load: PointMoment) -> _Rows:
    return [("moment", "N m", [(load.xi, load.moment, load.frame, (0, 0, 0))])]


def _force_along(beam: Beam, load: DistributedForce) -> _Rows:
    force, offset = (
        Along(f"DistributedForce.{key}", getattr(load, key), vector) for key in ("force", "offset")
    )
    return [("distributed force", "N/m", [(x, force(x), load.frame, offset(x)) for x in ALONG])]


def _moment_along(beam: Beam, load: DistributedMoment) -> _Rows:
    moment = Along("DistributedMoment.moment", load.moment, vector)
    return [("distributed moment", "N", [(x, moment(x), load.frame, (0, 0, 0)) for x in ALONG])]


_KINDS: dict[type, Callable[[Beam, Any], _Rows]] = {
    Gravity: _gravity,
    PointForce: _point_force,
    PointMoment: _point_moment,
    DistributedForce: _force_along,
    DistributedMoment: _moment_along,
}
