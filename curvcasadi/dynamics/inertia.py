"""The inertia of a beam, lumped at its stations by the quadrature of its loads.

A station carries ten numbers (m, m c, J) about itself in its local axes: the mass, the mass times
the centre of mass, and the inertia J = J_c + m (c·c I − c cᵀ), which are additive over panels and
bodies. Their order is m, m c_x, m c_y, m c_z, J_xx, J_yy, J_zz, J_xy, J_xz, J_yz.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from curvcasadi.beam.beam import Beam
from curvcasadi.beam.section import Section
from curvcasadi.lie import so3
from curvcasadi.loads.kinds import Gravity
from curvcasadi.loads.stations import Mesh, loaded_mesh, sites
from curvcasadi.symbolic.expressions import AnyExpr, Number, expression, is_numeric

#: Numbers that describe the inertia of a station.
SIZE = 10
#: Rows and columns of J_xx, J_yy, J_zz, J_xy, J_xz, J_yz.
_ENTRIES = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))

#: Which of the ten numbers differ from zero at some station: the others are not data.
Mask = tuple[bool, ...]


class Inertia(NamedTuple):
    """Ten numbers in parts; in the axes and about the point that the context names."""

    mass: AnyExpr  #: (1, 1), kg
    first: AnyExpr  #: mass times centre of mass, (3, 1), kg m
    second: AnyExpr  #: (3, 3), kg m²


class StationInertias(NamedTuple):
    """The inertia of all stations of a mesh."""

    mask: Mask
    data: tuple[AnyExpr, ...]  #: per station the numbers that `mask` leaves


def inertial_mesh(beam: Beam, loads: Sequence[Any]) -> Mesh:
    """Stations and panels on which the inertia and the `loads` of `beam` are integrated.

    They are those of statics with a `Gravity` among the loads: distributed mass is a distributed
    load.
    """
    weight = () if any(isinstance(load, Gravity) for load in loads) else (Gravity([0, 0, 0]),)
    return loaded_mesh(beam, [*loads, *weight])


def total_mass(beam: Beam) -> AnyExpr:
    """Mass of a beam with its bodies, kg, integrated as its weight is."""
    section, mass = beam.section, sum((body.mass for body in beam.bodies), 0.0)
    if section is None or section.mass_per_length is None:
        return mass
    mesh = inertial_mesh(beam, ())
    return sum((site.measure * section.mass_at(site.xi) for site in sites(beam, mesh)), mass)


def lumped(beam: Beam, mesh: Mesh) -> list[AnyExpr]:
    """Ten numbers (10, 1) of every station: the section over the panels of `mesh`, and the bodies.

    Raises
    ------
    ValueError
        If the beam has no mass.
    """
    section = beam.section
    if not isinstance(section, Section) or (section.mass_per_length is None and not beam.bodies):
        raise ValueError(
            "Beam: dynamics need mass, Section.mass_per_length or Beam.bodies; found neither"
        )
    totals: list[AnyExpr] = [ca.DM.zeros(SIZE) for _ in mesh.stations]
    if section.mass_per_length is not None:
        for site in sites(beam, mesh):
            totals[site.node] += site.measure * _section_inertia(section, site.xi)
    for body in beam.bodies:
        node = int(np.argmin(np.abs(mesh.stations - body.xi)))
        inertia = expression("Body.inertia", body.inertia, (3, 3))
        totals[node] += about_point(body.mass, body.offset, inertia)
    return totals


def station_inertias(beam: Beam, mesh: Mesh) -> StationInertias:
    """Inertia of the section, integrated over the panels of `mesh`, and of the bodies.

    Raises
    ------
    ValueError
        If the beam has no mass, or nothing resists a rotation about the beam although there are
        weights of torsion.
    """
    totals = lumped(beam, mesh)
    mask = tuple(any(_differs_from_zero(total[k]) for total in totals) for k in range(SIZE))
    _check(beam, totals)
    kept = [k for k in range(SIZE) if mask[k]]
    return StationInertias(mask, tuple(total[kept] for total in totals))


def about_point(mass: Number, center: AnyExpr, inertia: AnyExpr) -> AnyExpr:
    """The ten numbers (10, 1) of a body, from its inertia (3, 3) about its centre of mass.

    Parameters
    ----------
    mass : number or symbol
        kg.
    center : SX, MX or DM, shape (3, 1)
        Centre of mass from the point, m.
    inertia : SX, MX or DM, shape (3, 3)
        About the centre of mass, kg m².
    """
    moved = inertia + mass * (ca.dot(center, center) * ca.DM.eye(3) - center @ center.T)
    return ca.densify(ca.vertcat(mass, mass * center, *(moved[i, j] for i, j in _ENTRIES)))


def unpack(numbers: AnyExpr) -> Inertia:
    """Parts of ten numbers (10, 1)."""
    xx, yy, zz, xy, xz, yz = (numbers[k] for k in range(4, SIZE))
    rows = (ca.horzcat(xx, xy, xz), ca.horzcat(xy, yy, yz), ca.horzcat(xz, yz, zz))
    return Inertia(numbers[0], numbers[1:4], ca.vertcat(*rows))


def masked(mask: Mask, data: ca.SX) -> Inertia:
    """Parts of the numbers that `mask` leaves, the others structurally zero."""
    values = iter(ca.vertsplit(data))
    return unpack(ca.sparsify(ca.vertcat(*(next(values) if on else 0 for on in mask))))


def moved_to_parent(inertia: Inertia, rotation: ca.SX, position: ca.SX) -> Inertia:
    """Inertia of a station about the parent origin, parent axes.

    With c in parent axes: m, m (p + c) and R J Rᵀ − m ([p×]² + [p×] [c×] + [c×] [p×]).
    """
    mass, first, second = inertia
    turned = rotation @ first
    lever = mass * position
    mixed = ca.dot(position, lever + 2 * turned) * ca.DM.eye(3)
    outer = position @ (lever + turned).T + turned @ position.T
    moved = rotation @ second @ rotation.T + mixed - outer
    return Inertia(mass, lever + turned, ca.triu2symm(ca.triu(moved)))


def pack(inertia: Inertia) -> AnyExpr:
    """The ten numbers (10, 1)."""
    entries = (inertia.second[i, j] for i, j in _ENTRIES)
    return ca.densify(ca.vertcat(inertia.mass, inertia.first, *entries))


def momentum(inertia: Inertia, twists: AnyExpr) -> AnyExpr:
    """I V = (J ω + m c × v, m v − m c × ω), (6, columns), of twists (ω, v) (6, columns)."""
    angular, linear = twists[:3, :], twists[3:, :]
    lever = so3.hat(inertia.first)
    return ca.vertcat(
        inertia.second @ angular + lever @ linear, inertia.mass * linear - lever @ angular
    )


def _section_inertia(section: Section, xi: float) -> AnyExpr:
    """The ten numbers of a section, per length."""
    inertia = ca.DM(3, 3) if section.inertia is None else section.inertia_at(xi)
    return about_point(section.mass_at(xi), section.center_of_mass_at(xi), inertia)


def _differs_from_zero(value: AnyExpr) -> bool:
    return not is_numeric(value) or float(value) != 0


def _check(beam: Beam, totals: Sequence[AnyExpr]) -> None:
    if not any(_differs_from_zero(total[0]) for total in totals):
        raise ValueError("Beam: dynamics need mass, found Section.mass_per_length and bodies of 0")
    twisted = any(np.any(beam.basis(xi)[0]) for xi in beam.stations)
    if twisted and not any(_differs_from_zero(total[4]) for total in totals[1:]):
        raise ValueError(
            "Section.inertia: expected a rotary inertia about the local x axis, because "
            "Beam.basis has weights of torsion; found none, which makes the mass matrix singular"
        )
