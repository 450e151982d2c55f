"""The motion of a beam's root, and the fields of the world that sensors read."""

from __future__ import annotations

from dataclasses import dataclass, field, fields

import casadi as ca

from curvcasadi.expressions import (
    AnyExpr,
    Number,
    expression,
    instance,
    is_numeric,
    rotation_matrix,
)
from curvcasadi.pose import Pose


def _rest() -> AnyExpr:
    return ca.DM.zeros(6)


@dataclass(frozen=True, eq=False, kw_only=True)
class RootMotion:
    """How the root moves in inertial axes. The defaults are a beam clamped to the ground.

    Fields may be symbols. For a wing of an aircraft `pose` is that of the body axes.
    """

    pose: Pose = field(default_factory=Pose.identity)  #: of the parent, in inertial axes
    #: (6, 1), rad/s and m/s: the root's own body twist, root axes, the parent's motion included
    twist: Number = field(default_factory=_rest)
    #: (6, 1), rad/s² and m/s²: time derivative of the components of `twist`
    twist_rate: Number = field(default_factory=_rest)
    gravity: Number | None = None  #: acceleration (3, 1), m/s², inertial axes
    magnetic_field: Number | None = None  #: (3, 1), T, inertial axes

    def __post_init__(self) -> None:
        instance("RootMotion.pose", self.pose, Pose)
        rotation_matrix("RootMotion.pose.rotation", self.pose.rotation)
        for name, size in (("twist", 6), ("twist_rate", 6), ("gravity", 3), ("magnetic_field", 3)):
            value = getattr(self, name)
            if value is not None or size == 6:
                checked = expression(f"RootMotion.{name}", value, (size, 1))
                object.__setattr__(self, name, checked)

    @property
    def symbols(self) -> dict[str, AnyExpr]:
        """Fields that hold CasADi symbols, by name."""
        values = {f"RootMotion.{f.name}": getattr(self, f.name) for f in fields(self)[1:]}
        values["RootMotion.pose.rotation"] = self.pose.rotation
        values["RootMotion.pose.position"] = self.pose.position
        return {name: v for name, v in values.items() if v is not None and not is_numeric(v)}
