"""Loads on a beam, as data; each says what it amounts to at stations."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from curvcasadi.beam.along import Along, breaks_of, vector
from curvcasadi.beam.basis import refuse_at_tip
from curvcasadi.beam.beam import Beam
from curvcasadi.beam.section import Section
from curvcasadi.loads.stations import (
    FRAMES,
    Contributions,
    Frame,
    Load,
    Mesh,
    force_data,
    moment_data,
    sites,
)
from curvcasadi.symbolic.expressions import AnyExpr, Number, choice, station

#: Standard gravity, m/s².
STANDARD_GRAVITY = 9.80665


@dataclass(frozen=True, eq=False)
class Gravity(Load):
    """Weight of the sections (mass per length, centre of mass) and bodies of a beam.

    Attributes
    ----------
    acceleration : array or symbol, shape (3,)
        Acceleration of gravity, m/s², inertial axes.
    """

    acceleration: Number

    def __post_init__(self) -> None:
        _check(self, "acceleration")

    def is_distributed(self, beam: Beam) -> bool:
        return beam.section is not None and beam.section.mass_per_length is not None

    def contributions(self, beam: Beam, mesh: Mesh, to_parent: AnyExpr) -> Contributions:
        section = beam.section
        if not isinstance(section, Section) or not (self.is_distributed(beam) or beam.bodies):
            raise ValueError(
                "Gravity: expected a Section with mass_per_length or bodies, found neither"
            )
        for site in sites(beam, mesh) if self.is_distributed(beam) else ():
            weight = site.measure * section.mass_at(site.xi) * self.acceleration
            center = section.center_of_mass_at(site.xi)
            yield site.node, force_data(weight, "dead", center, to_parent)
        for body in beam.bodies:
            weight = body.mass * self.acceleration
            yield mesh.node(body.xi), force_data(weight, "dead", body.offset, to_parent)


@dataclass(frozen=True, eq=False)
class PointForce(Load):
    """A force at a station.

    Attributes
    ----------
    xi : float
        Station s/L in [0, 1].
    force : array or symbol, shape (3,)
        Force, N, in the axes that `frame` names.
    frame : {"dead", "follower", "body"}
        "dead" is a fixed inertial direction, "follower" is fixed in the local axes of the station,
        and "body" in the parent axes, those of an aircraft's body.
    offset : array or symbol, shape (3,)
        Point of action from the reference curve, m, local axes.
    """

    xi: float
    force: Number
    frame: Frame = "dead"
    offset: Number = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        object.__setattr__(self, "xi", station("PointForce.xi", self.xi))
        choice("PointForce.frame", self.frame, FRAMES)
        _check(self, "force", "offset")

    @property
    def breaks(self) -> tuple[float, ...]:
        return (float(self.xi),)

    def is_distributed(self, beam: Beam) -> bool:
        return False

    def contributions(self, beam: Beam, mesh: Mesh, to_parent: AnyExpr) -> Contributions:
        refuse_at_tip(beam.basis, "PointForce", self.xi, force=self.force, offset=self.offset)
        yield mesh.node(self.xi), force_data(self.force, self.frame, self.offset, to_parent)


@dataclass(frozen=True, eq=False)
class PointMoment(Load):
    """A moment at a station. A dead moment has no potential.

    Attributes
    ----------
    xi : float
        Station s/L in [0, 1].
    moment : array or symbol, shape (3,)
        Moment, N m, in the axes that `frame` names.
    frame : {"dead", "follower", "body"}
        As of `PointForce`.
    """

    xi: float
    moment: Number
    frame: Frame = "dead"

    def __post_init__(self) -> None:
        object.__setattr__(self, "xi", station("PointMoment.xi", self.xi))
        choice("PointMoment.frame", self.frame, FRAMES)
        _check(self, "moment")

    @property
    def breaks(self) -> tuple[float, ...]:
        return (float(self.xi),)

    def is_distributed(self, beam: Beam) -> bool:
        return False

    def contributions(self, beam: Beam, mesh: Mesh, to_parent: AnyExpr) -> Contributions:
        refuse_at_tip(beam.basis, "PointMoment", self.xi, moment=self.moment)
        yield mesh.node(self.xi), moment_data(self.moment, self.frame, to_parent)


@dataclass(frozen=True, eq=False)
class DistributedForce(Load):
    """A force per length along the whole span.

    Attributes
    ----------
    force : array, symbol or callable, shape (3,)
        Force per length, N/m, in the axes that `frame` names, or a function of xi that returns it;
        one with jumps has `breaks`.
    frame : {"dead", "follower", "body"}
        As of `PointForce`.
    offset : array or symbol, shape (3,)
        Points of action from the reference curve, m, local axes.
    """

    force: Number
    frame: Frame = "dead"
    offset: Number = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        choice("DistributedForce.frame", self.frame, FRAMES)
        _check(self, "force", "offset")

    @property
    def breaks(self) -> tuple[float, ...]:
        return breaks_of(self.force, self.offset)

    def contributions(self, beam: Beam, mesh: Mesh, to_parent: AnyExpr) -> Contributions:
        force, offset = _along(self, "force"), _along(self, "offset")
        for site in sites(beam, mesh):
            data = force_data(force(site.xi), self.frame, offset(site.xi), to_parent)
            yield site.node, site.measure * data


@dataclass(frozen=True, eq=False)
class DistributedMoment(Load):
    """A moment per length along the whole span.

    Attributes
    ----------
    moment : array, symbol or callable, shape (3,)
        Moment per length, N, in the axes that `frame` names, or a function of xi that returns it;
        one with jumps has `breaks`.
    frame : {"dead", "follower", "body"}
        As of `PointForce`.
    """

    moment: Number
    frame: Frame = "dead"

    def __post_init__(self) -> None:
        choice("DistributedMoment.frame", self.frame, FRAMES)
        _check(self, "moment")

    @property
    def breaks(self) -> tuple[float, ...]:
        return breaks_of(self.moment)

    def contributions(self, beam: Beam, mesh: Mesh, to_parent: AnyExpr) -> Contributions:
        moment = _along(self, "moment")
        for site in sites(beam, mesh):
            yield site.node, site.measure * moment_data(moment(site.xi), self.frame, to_parent)


def _along(load: Any, name: str) -> Along:
    return Along(f"{type(load).__name__}.{name}", getattr(load, name), vector)


def _check(load: Any, *names: str) -> None:
    for name in names:
        object.__setattr__(load, name, _along(load, name).source)
