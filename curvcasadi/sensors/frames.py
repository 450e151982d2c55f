"""Where a sensor is: the frames above its station, and points that move with the station."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, NamedTuple, TypeAlias

import casadi as ca

from curvcasadi.kinematics.state import StationMotion
from curvcasadi.lie import so3
from curvcasadi.symbolic.expressions import AnyExpr


class Frames(NamedTuple):
    """The parent in inertial axes, the root in the parent, and what the world is like."""

    attitude: Any  #: C (3, 3), parent to inertial
    position: Any  #: of the parent, inertial axes
    root_rotation: Any  #: R_0 (3, 3), root to parent
    root_position: Any  #: p_0, parent axes
    twist: Any  #: of the root, root axes
    world: Any  #: gravity or magnetic field (3, 1), inertial axes


#: Fields of a sensor that its reading depends on, by name; a pose as (R, p), (3, 4).
Mount: TypeAlias = SimpleNamespace


def origin() -> AnyExpr:
    """The place of a sensor on the reference curve."""
    return ca.DM.zeros(3)


def sensor_axes(at: StationMotion, mount: Mount) -> Any:
    """Root to sensor axes."""
    return mount.mounting.T @ at.rotation.T


def point(at: StationMotion, offset: Any) -> tuple[Any, Any, Any]:
    """Position, velocity and acceleration of a material point."""
    omega, alpha = so3.hat(at.twist[:3]), so3.hat(at.acceleration[:3])
    position = at.position + at.rotation @ offset
    velocity = at.twist[3:] + omega @ position
    return position, velocity, at.acceleration[3:] + alpha @ position + omega @ velocity


def world_in_parent(frames: Frames) -> Any:
    """Gravity or magnetic field in parent axes."""
    return frames.attitude.T @ frames.world


def point_in_parent(at: StationMotion, frames: Frames, mount: Mount) -> Any:
    point = at.position + at.rotation @ mount.offset
    return frames.root_position + frames.root_rotation @ point


def point_in_parent_by_q(at: StationMotion, frames: Frames, mount: Mount) -> Any:
    a, b = at.sums[0]
    point = at.position + at.rotation @ mount.offset
    return frames.root_rotation @ (b - so3.hat(point) @ a)
