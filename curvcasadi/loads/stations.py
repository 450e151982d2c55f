"""What loads amount to at the stations of a beam.

At a station with pose (R, p), parent axes, every load below is one wrench about the parent origin

    force  F = F_d + R F_f,      moment = p × F + axial(R N) + M_d + R M_f

of 21 numbers: forces and moments fixed in the parent frame (F_d, M_d) and in local axes (F_f, M_f),
and N = Σ r F_dᵀ of the offsets r at which fixed forces act, axial(R N) = Σ (R r) × F_d. A load that
depends on the pose otherwise brings a formula of its own, its class attribute `wrench`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import singledispatch
from typing import Any, NamedTuple, TypeAlias

import casadi as ca
import numpy as np

from curvcasadi.beam.beam import Beam, merged_breaks
from curvcasadi.beam.quadrature import Panel
from curvcasadi.beam.section import Section
from curvcasadi.lie import so3
from curvcasadi.loads.kinds import (
    DistributedForce,
    DistributedMoment,
    Frame,
    Gravity,
    PointForce,
    PointMoment,
)
from curvcasadi.symbolic.expressions import (
    AnyExpr,
    Array,
    Number,
    expression,
    rotation_matrix,
)

#: Numbers that describe the loads at one station: F_d, M_d, vec N, F_f, M_f.
SIZE = 21


#: Formula (R, p, data) -> wrench (moment, force), (6, 1), about the parent origin, parent axes.
WrenchFormula: TypeAlias = Callable[[AnyExpr, AnyExpr, AnyExpr], AnyExpr]
#: What acts at one station: formulas, each with its data.
StationLoads: TypeAlias = list[tuple[WrenchFormula, AnyExpr]]
#: (index of a station, load data that it gains) of one load.
Contributions: TypeAlias = Iterator[tuple[int, AnyExpr]]


class Site(NamedTuple):
    """Where a load acts: a node of the quadrature or a point."""

    node: int  #: index of the station
    xi: float  #: its s/L, within the panel that the load belongs to
    measure: Number  #: m of arc length that the node stands for; 1 for a point


class Mesh(NamedTuple):
    """Stations of a loaded beam, and its panels for quadrature."""

    stations: Array
    panels: tuple[Panel, ...]


def load_breaks(loads: Sequence[Any]) -> tuple[float, ...]:
    """Stations at which `loads` begin, end or jump."""
    points: set[float] = set()
    for load in loads:
        if hasattr(load, "xi"):
            points.add(float(load.xi))
        points.update(getattr(load, "breaks", ()))
        for name in ("force", "moment"):
            points.update(getattr(getattr(load, name, None), "breaks", ()))
    return tuple(points)


def loaded_mesh(beam: Beam, loads: Sequence[Any]) -> Mesh:
    """Stations of `beam` and panels that also break where `loads` begin, end or jump.

    Where loads are distributed, a panel has three elements at least: fewer do not integrate them.
    """
    breaks = merged_breaks([*beam.breaks, *load_breaks(loads)])
    least = _LEAST_ELEMENTS if breaks and any(_is_distributed(beam, load) for load in loads) else 1
    return Mesh(beam.grid.stations(breaks, least), beam.grid.panels(breaks, least))


#: Elements that a panel between two breaks needs for the quadrature of a distributed load.
_LEAST_ELEMENTS = 3


def _is_distributed(beam: Beam, load: Any) -> bool:
    if isinstance(load, Gravity):
        return beam.section is not None and beam.section.mass_per_length is not None
    return not isinstance(load, (PointForce, PointMoment))


def station_loads(
    beam: Beam, loads: Sequence[Any], mesh: Mesh, attitude: AnyExpr | None
) -> list[StationLoads]:
    """Formulas and load data for every station of `mesh`; those of `linear_wrench` as one sum.

    Parameters
    ----------
    attitude : (3, 3), parent to inertial axes; None if they are the same
    """
    to_parent = ca.DM.eye(3) if attitude is None else rotation_matrix("attitude", attitude).T
    totals: list[AnyExpr] = [None for _ in mesh.stations]
    others: list[StationLoads] = [[] for _ in mesh.stations]
    for load in loads:
        formula = getattr(load, "wrench", linear_wrench)
        for node, data in contributions(load, beam, mesh, to_parent):
            if formula is linear_wrench:
                totals[node] = data if totals[node] is None else totals[node] + data
            else:
                others[node].append((formula, data))
    return [
        other if total is None else [(linear_wrench, total), *other]
        for total, other in zip(totals, others, strict=True)
    ]


def linear_wrench(rotation: AnyExpr, position: AnyExpr, data: AnyExpr) -> AnyExpr:
    """Wrench (moment, force), (6, 1), about the parent origin, of 21 numbers of load data."""
    fixed, fixed_moment, lever, local, local_moment = ca.vertsplit(data, [0, 3, 6, 15, 18, SIZE])
    force = fixed + rotation @ local
    levers = -2 * so3.vee(rotation @ ca.reshape(lever, 3, 3))
    moment = ca.cross(position, force) + levers + fixed_moment + rotation @ local_moment
    return ca.vertcat(moment, force)


@singledispatch
def contributions(load: Any, beam: Beam, mesh: Mesh, to_parent: AnyExpr) -> Contributions:
    """Load data of one load, station by station; another kind of load registers its own."""
    raise ValueError(f"loads: expected loads such as PointForce or Gravity, found {load!r}")


@contributions.register
def _(load: PointForce, beam: Beam, mesh: Mesh, to_parent: AnyExpr) -> Contributions:
    yield _node(mesh, load.xi), _force(load.force, load.frame, load.offset, to_parent)


@contributions.register
def _(load: PointMoment, beam: Beam, mesh: Mesh, to_parent: AnyExpr) -> Contributions:
    yield _node(mesh, load.xi), _moment(load.moment, load.frame, to_parent)


@contributions.register
def _(load: DistributedForce, beam: Beam, mesh: Mesh, to_parent: AnyExpr) -> Contributions:
    for site in sites(beam, mesh):
        force = _value("DistributedForce.force", load.force, site.xi)
        offset = _value("DistributedForce.offset", load.offset, site.xi)
        yield site.node, site.measure * _force(force, load.frame, offset, to_parent)


@contributions.register
def _(load: DistributedMoment, beam: Beam, mesh: Mesh, to_parent: AnyExpr) -> Contributions:
    for site in sites(beam, mesh):
        moment = _value("DistributedMoment.moment", load.moment, site.xi)
        yield site.node, site.measure * _moment(moment, load.frame, to_parent)


@contributions.register
def _(load: Gravity, beam: Beam, mesh: Mesh, to_parent: AnyExpr) -> Contributions:
    section = beam.section
    if not isinstance(section, Section) or (section.mass_per_length is None and not beam.bodies):
        raise ValueError(
            "Gravity: expected a Section with mass_per_length or bodies, found neither"
        )
    if section.mass_per_length is not None:
        for site in sites(beam, mesh):
            weight = site.measure * section.mass_at(site.xi) * load.acceleration
            yield site.node, _force(weight, "dead", section.center_of_mass_at(site.xi), to_parent)
    for body in beam.bodies:
        weight = body.mass * load.acceleration
        yield _node(mesh, body.xi), _force(weight, "dead", body.offset, to_parent)


def sites(beam: Beam, mesh: Mesh) -> Iterator[Site]:
    """Quadrature nodes along the span; at a break one for each side."""
    for panel in mesh.panels:
        for node, xi, weight in zip(panel.nodes, panel.xi, panel.weights, strict=True):
            yield Site(node, xi, weight * beam.length)


def _node(mesh: Mesh, xi: float) -> int:
    return int(np.argmin(np.abs(mesh.stations - xi)))


def _value(name: str, value: Number, xi: float) -> AnyExpr:
    return expression(f"{name} at xi = {xi}", value(xi), (3, 1)) if callable(value) else value


def _force(force: AnyExpr, frame: Frame, offset: AnyExpr, to_parent: AnyExpr) -> AnyExpr:
    zero = ca.DM.zeros(3)
    if frame == "follower":
        return ca.vertcat(zero, zero, ca.DM.zeros(9), force, ca.cross(offset, force))
    fixed = to_parent @ force if frame == "dead" else force
    return ca.vertcat(fixed, zero, ca.vec(offset @ fixed.T), zero, zero)


def _moment(moment: AnyExpr, frame: Frame, to_parent: AnyExpr) -> AnyExpr:
    zero, none = ca.DM.zeros(3), ca.DM.zeros(9)
    if frame == "follower":
        return ca.vertcat(zero, zero, none, zero, moment)
    fixed = to_parent @ moment if frame == "dead" else moment
    return ca.vertcat(zero, fixed, none, zero, zero)
