"""Loads on a beam, as data."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

from curvcasadi.symbolic.expressions import Number, choice, expression, station

Frame = Literal["dead", "follower", "body"]
FRAMES = ("dead", "follower", "body")


@dataclass(frozen=True, eq=False)
class Gravity:
    """Weight of the sections (mass per length, centre of mass) and bodies of a beam."""

    acceleration: Number  #: (3,), m/s², inertial axes

    def __post_init__(self) -> None:
        _vector(self, "acceleration")


@dataclass(frozen=True, eq=False)
class PointForce:
    """A force at a station. "dead": fixed inertial direction; "follower": fixed in local axes;
    "body": fixed in the parent (an aircraft's body axes)."""

    xi: float  #: station s/L
    force: Number  #: (3,), N, axes as `frame` says
    frame: Frame = "dead"
    offset: Number = (0.0, 0.0, 0.0)  #: where it acts from the reference curve, m, local axes

    def __post_init__(self) -> None:
        station("PointForce.xi", self.xi)
        choice("PointForce.frame", self.frame, FRAMES)
        _vector(self, "force")
        _vector(self, "offset")


@dataclass(frozen=True, eq=False)
class PointMoment:
    """A moment at a station; frames as of `PointForce`. A dead moment has no potential."""

    xi: float  #: station s/L
    moment: Number  #: (3,), N m, axes as `frame` says
    frame: Frame = "dead"

    def __post_init__(self) -> None:
        station("PointMoment.xi", self.xi)
        choice("PointMoment.frame", self.frame, FRAMES)
        _vector(self, "moment")


@dataclass(frozen=True, eq=False)
class DistributedForce:
    """A force per length along the whole span; frames as of `PointForce`."""

    force: Number  #: (3,), N/m, or a function of xi; one with jumps has `breaks`
    frame: Frame = "dead"
    offset: Number = (0.0, 0.0, 0.0)  #: where it acts from the reference curve, m, local axes

    def __post_init__(self) -> None:
        choice("DistributedForce.frame", self.frame, FRAMES)
        _vector(self, "force")
        _vector(self, "offset")


@dataclass(frozen=True, eq=False)
class DistributedMoment:
    """A moment per length along the whole span; frames as of `PointForce`."""

    moment: Number  #: (3,), N, or a function of xi; one with jumps has `breaks`
    frame: Frame = "dead"

    def __post_init__(self) -> None:
        choice("DistributedMoment.frame", self.frame, FRAMES)
        _vector(self, "moment")


def _vector(load: Any, name: str) -> None:
    value = getattr(load, name)
    if not callable(value):
        checked = expression(f"{type(load).__name__}.{name}", value, (3, 1))
        object.__setattr__(load, name, checked)
