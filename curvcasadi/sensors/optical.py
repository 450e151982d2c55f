"""Sensors that see a point of the wing from outside: markers and cameras."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import casadi as ca

from curvcasadi.beam.pose import Pose
from curvcasadi.kinematics.state import StationMotion
from curvcasadi.lie import so3
from curvcasadi.sensors.frames import Frames, Mount, origin, point_in_parent, point_in_parent_by_q
from curvcasadi.sensors.sensor import XYZ, Sensor
from curvcasadi.symbolic.expressions import Number

#: What no camera sees lies further from its optical axis: tangent of the angle, 89.94°. A bearing
#: is no number from there on to behind the camera.
WIDEST = 1e3


@dataclass(frozen=True, eq=False, kw_only=True)
class Marker(Sensor):
    """Position of a point of the wing, as motion capture or satellite navigation sees it.

    It reads the position (3,), m, in inertial axes.

    Attributes
    ----------
    xi : float
        Station s/L in [0, 1].
    name : str or None
        Name of the sensor; its kind and number where None.
    noise : float or array, shape (3,)
        Standard deviation of one sample, m, of all inertial axes or each.
    offset : array or symbol, shape (3,)
        The point from the reference curve, m, local axes.
    bias : array, symbol or None, shape (3,)
        Bias, m, inertial axes; zero where None.
    """

    noise: Number
    offset: Number = field(default_factory=origin)
    bias: Number = None

    prefix = "marker"
    components = residual_components = XYZ
    unit = residual_unit = "m"

    @classmethod
    def value(cls, at: StationMotion, frames: Frames, mount: Mount) -> Any:
        point = point_in_parent(at, frames, mount)
        return frames.position + frames.attitude @ point + mount.bias

    @classmethod
    def slopes(cls, at: StationMotion, frames: Frames, mount: Mount) -> dict[str, Any]:
        return {
            "q": frames.attitude @ point_in_parent_by_q(at, frames, mount),
            "attitude": -frames.attitude @ so3.hat(point_in_parent(at, frames, mount)),
            "position": ca.DM.eye(3),
        }


@dataclass(frozen=True, eq=False, kw_only=True)
class Camera(Sensor):
    """Bearing to a point of the wing: normalized image coordinates (u, v) = (x/z, y/z).

    (x, y, z) is the point in camera axes, z along the optical axis. A camera sees what lies before
    it, within 89.94° of that axis: z > 0, |(x, y)| < 1e3 z. Of all else the bearing is NaN, with
    zeros for derivatives: estimators take it for missing, and numbers are refused where there is
    nothing else to go by. The camera moves with the parent, whose pose changes no bearing, while
    markers and attitude sensors read in inertial axes.

    Attributes
    ----------
    xi : float
        Station s/L in [0, 1].
    name : str or None
        Name of the sensor; its kind and number where None.
    pose : Pose
        Pose of the camera in parent axes, the body axes of an aircraft.
    noise : float or array, shape (2,)
        Standard deviation of one sample, tangent of an angle.
    offset : array or symbol, shape (3,)
        The point from the reference curve, m, local axes.
    bias : array, symbol or None, shape (2,)
        Bias; zero where None.
    """

    pose: Pose
    noise: Number
    offset: Number = field(default_factory=origin)
    bias: Number = None

    prefix = "camera"
    components = residual_components = ("u", "v")
    may_be_hidden = True
    unit = residual_unit = "1"

    @classmethod
    def in_view(cls, at: StationMotion, frames: Frames, mount: Mount) -> Any:
        """1 if a camera sees the point, z > 0 and |(x, y)| < 1e3 z, else 0."""
        point = in_camera(at, frames, mount)
        return (point[2] > 0) * (ca.sumsqr(point[:2]) < (WIDEST * point[2]) ** 2)

    @classmethod
    def value(cls, at: StationMotion, frames: Frames, mount: Mount) -> Any:
        """(x, y)/z, and NaN, a root of −1, of what is not in view."""
        point = in_camera(at, frames, mount)
        return point[:2] / point[2] + ca.sqrt(cls.in_view(at, frames, mount) - 1) + mount.bias

    @classmethod
    def slopes(cls, at: StationMotion, frames: Frames, mount: Mount) -> dict[str, Any]:
        """(x/z)' = (x' − (x/z) z')/z."""
        point = in_camera(at, frames, mount)
        projection = ca.horzcat(ca.DM.eye(2), -point[:2] / point[2]) / point[2]
        by_q = point_in_parent_by_q(at, frames, mount)
        return {"q": projection @ mount.pose[:, :3].T @ by_q}


def in_camera(at: StationMotion, frames: Frames, mount: Mount) -> Any:
    point = point_in_parent(at, frames, mount)
    return mount.pose[:, :3].T @ (point - mount.pose[:, 3])
