"""What each kind of sensor reads at a station, and the derivatives of it.

All in the inertial axes that coincide with the root's at this instant ("root axes" below), where a
station moves as `kinematics.motion.StationMotion` says. With the spatial Jacobian J = (A, B), its
rates (A_t, B_t), (A_tt, B_tt), and a material point P = p + R r:

    R_q = [A×] R,    P_q = B + A × P,    (Rᵀ Ω)_q = Rᵀ A_t,    (Rᵀ Ω)_q_dot = Rᵀ A
    P_tt,q = (P_q)_tt,    P_tt,q_dot = 2 (P_q)_t,    P_tt,q_ddot = P_q

The attitude of the parent is varied on the right, C exp(φ), φ in parent axes.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, TypeAlias

import casadi as ca

from curvcasadi.kinematics.motion import StationMotion
from curvcasadi.lie import so3
from curvcasadi.sensors.kinds import (
    Accelerometer,
    AttitudeSensor,
    Camera,
    Magnetometer,
    Marker,
    RateGyro,
    Sensor,
)


class Frames(NamedTuple):
    """The parent in inertial axes, the root in the parent, and what the world is like."""

    attitude: Any  #: C (3, 3), parent to inertial
    position: Any  #: of the parent, inertial axes
    root_rotation: Any  #: R_0 (3, 3), root to parent
    root_position: Any  #: p_0, parent axes
    twist: Any  #: of the root, root axes
    world: Any  #: gravity or magnetic field (3, 1), inertial axes


class Mount(NamedTuple):
    """Fields of a sensor that its reading depends on."""

    offset: Any = None
    mounting: Any = None
    bias: Any = None
    pose: Any = None  #: (R, p) of a camera in the parent, (3, 4)


#: What no camera sees lies further from its optical axis: tangent of the angle, 89.94°. A bearing
#: is no number from there on to behind the camera.
WIDEST = 1e3

Value: TypeAlias = Callable[[StationMotion, Frames, Mount], Any]
#: Derivatives by the name of what is varied; of an attitude, its variation on the right.
Slopes: TypeAlias = Callable[[StationMotion, Frames, Mount], dict[str, Any]]


def _to_sensor(at: StationMotion, mount: Mount) -> Any:
    """Root to sensor axes."""
    return mount.mounting.T @ at.rotation.T


def _point(at: StationMotion, offset: Any) -> tuple[Any, Any, Any]:
    """Position, velocity and acceleration of a material point."""
    omega, alpha = so3.hat(at.twist[:3]), so3.hat(at.acceleration[:3])
    position = at.position + at.rotation @ offset
    velocity = at.twist[3:] + omega @ position
    return position, velocity, at.acceleration[3:] + alpha @ position + omega @ velocity


def _in_parent(frames: Frames) -> Any:
    """Gravity or magnetic field in parent axes."""
    return frames.attitude.T @ frames.world


def _gyro(at: StationMotion, frames: Frames, mount: Mount) -> Any:
    return _to_sensor(at, mount) @ at.twist[:3] + mount.bias


def _gyro_slopes(at: StationMotion, frames: Frames, mount: Mount) -> dict[str, Any]:
    to_sensor = _to_sensor(at, mount)
    (a, _), (a_t, _), *_ = at.sums
    by_twist = ca.horzcat(to_sensor, ca.DM.zeros(3, 3))
    return {"q": to_sensor @ a_t, "q_dot": to_sensor @ a, "twist": by_twist}


def _accelerometer(at: StationMotion, frames: Frames, mount: Mount) -> Any:
    *_, acceleration = _point(at, mount.offset)
    gravity = frames.root_rotation.T @ _in_parent(frames)
    return _to_sensor(at, mount) @ (acceleration - gravity) + mount.bias


def _accelerometer_slopes(at: StationMotion, frames: Frames, mount: Mount) -> dict[str, Any]:
    """With γ gravity and f = Rᵀ (P_tt − γ):  f_q = Rᵀ (B_tt + A_tt × P + 2 A_t × P_t + A × γ)."""
    to_sensor = _to_sensor(at, mount)
    (a, b), (a_t, b_t), (a_tt, b_tt) = at.sums
    position, velocity, _ = _point(at, mount.offset)
    in_parent = _in_parent(frames)
    gravity = so3.hat(frames.root_rotation.T @ in_parent)
    p, v = so3.hat(position), so3.hat(velocity)
    omega_0, v_0 = so3.hat(frames.twist[:3]), so3.hat(frames.twist[3:])
    return {
        "q": to_sensor @ (b_tt - p @ a_tt - 2 * (v @ a_t) - gravity @ a),
        "q_dot": to_sensor @ (2 * (b_t - p @ a_t - v @ a)),
        "q_ddot": to_sensor @ (b - p @ a),
        "attitude": -to_sensor @ frames.root_rotation.T @ so3.hat(in_parent),
        "twist": to_sensor @ ca.horzcat(v_0 - 2 * v - p @ omega_0, omega_0),
        "twist_rate": to_sensor @ ca.horzcat(-p, ca.DM.eye(3)),
    }


def _magnetometer(at: StationMotion, frames: Frames, mount: Mount) -> Any:
    field = frames.root_rotation.T @ _in_parent(frames)
    return _to_sensor(at, mount) @ field + mount.bias


def _magnetometer_slopes(at: StationMotion, frames: Frames, mount: Mount) -> dict[str, Any]:
    to_sensor, in_parent = _to_sensor(at, mount), _in_parent(frames)
    a, _ = at.sums[0]
    return {
        "q": to_sensor @ so3.hat(frames.root_rotation.T @ in_parent) @ a,
        "attitude": to_sensor @ frames.root_rotation.T @ so3.hat(in_parent),
    }


def _attitude(at: StationMotion, frames: Frames, mount: Mount) -> Any:
    in_parent = frames.root_rotation @ at.rotation @ mount.mounting
    return ca.vec(frames.attitude @ in_parent @ so3.exp(mount.bias))


def _attitude_slopes(at: StationMotion, frames: Frames, mount: Mount) -> dict[str, Any]:
    to_sensor = so3.exp(mount.bias).T @ _to_sensor(at, mount)
    a, _ = at.sums[0]
    return {"q": to_sensor @ a, "attitude": to_sensor @ frames.root_rotation.T}


def _point_in_parent(at: StationMotion, frames: Frames, mount: Mount) -> Any:
    point = at.position + at.rotation @ mount.offset
    return frames.root_position + frames.root_rotation @ point


def _point_in_parent_by_q(at: StationMotion, frames: Frames, mount: Mount) -> Any:
    a, b = at.sums[0]
    point = at.position + at.rotation @ mount.offset
    return frames.root_rotation @ (b - so3.hat(point) @ a)


def _marker(at: StationMotion, frames: Frames, mount: Mount) -> Any:
    point = _point_in_parent(at, frames, mount)
    return frames.position + frames.attitude @ point + mount.bias


def _marker_slopes(at: StationMotion, frames: Frames, mount: Mount) -> dict[str, Any]:
    return {
        "q": frames.attitude @ _point_in_parent_by_q(at, frames, mount),
        "attitude": -frames.attitude @ so3.hat(_point_in_parent(at, frames, mount)),
        "position": ca.DM.eye(3),
    }


def _in_camera(at: StationMotion, frames: Frames, mount: Mount) -> Any:
    point = _point_in_parent(at, frames, mount)
    return mount.pose[:, :3].T @ (point - mount.pose[:, 3])


def in_view(at: StationMotion, frames: Frames, mount: Mount) -> Any:
    """1 if a camera sees the point, z > 0 and |(x, y)| < 1e3 z, else 0."""
    point = _in_camera(at, frames, mount)
    return (point[2] > 0) * (ca.sumsqr(point[:2]) < (WIDEST * point[2]) ** 2)


def _camera(at: StationMotion, frames: Frames, mount: Mount) -> Any:
    """(x, y)/z, and NaN, a root of −1, of what is not in view."""
    point = _in_camera(at, frames, mount)
    return point[:2] / point[2] + ca.sqrt(in_view(at, frames, mount) - 1) + mount.bias


def _camera_slopes(at: StationMotion, frames: Frames, mount: Mount) -> dict[str, Any]:
    """(x/z)' = (x' − (x/z) z')/z."""
    point = _in_camera(at, frames, mount)
    projection = ca.horzcat(ca.DM.eye(2), -point[:2] / point[2]) / point[2]
    by_q = _point_in_parent_by_q(at, frames, mount)
    return {"q": projection @ mount.pose[:, :3].T @ by_q}


class Reading(NamedTuple):
    """How a kind of sensor reads."""

    value: Value
    slopes: Slopes
    world: str | None = None  #: the field of `RootMotion` that it reads


READINGS: dict[type[Sensor], Reading] = {
    RateGyro: Reading(_gyro, _gyro_slopes),
    Accelerometer: Reading(_accelerometer, _accelerometer_slopes, "gravity"),
    Magnetometer: Reading(_magnetometer, _magnetometer_slopes, "magnetic_field"),
    AttitudeSensor: Reading(_attitude, _attitude_slopes),
    Marker: Reading(_marker, _marker_slopes),
    Camera: Reading(_camera, _camera_slopes),
}
