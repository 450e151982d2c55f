"""The kinds of sensors: what each reads, and the derivatives of it in closed form."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import sqrt
from typing import Any, ClassVar

import casadi as ca
import numpy as np

from curvcasadi.beam.pose import Pose
from curvcasadi.kinematics.state import StationMotion
from curvcasadi.lie import so3
from curvcasadi.sensors.sensor import (
    XYZ,
    CurvatureSensor,
    Frames,
    Mount,
    Sensor,
    point,
    point_in_parent,
    point_in_parent_by_q,
    sensor_axes,
    world_in_parent,
)
from curvcasadi.symbolic.expressions import AnyExpr, Array, Number, is_rotation, rotation_matrix

#: What no camera sees lies further from its optical axis: tangent of the angle, 89.94°. A bearing
#: is no number from there on to behind the camera.
WIDEST = 1e3


def _origin() -> AnyExpr:
    return ca.DM.zeros(3)


def _unit() -> AnyExpr:
    return ca.DM.eye(3)


@dataclass(frozen=True, eq=False, kw_only=True)
class _Sampled(Sensor):
    """A strapped-down sensor of three axes whose data sheet states a noise density.

    White noise of the density N, sampled at the rate f, has the standard deviation N √f a sample.
    """

    noise_density: Number  #: N, unit/√Hz, for all axes or each
    rate: float  #: samples per second, Hz
    offset: Number = field(default_factory=_origin)  #: (3,), m, local axes
    mounting: Number = field(default_factory=_unit)  #: (3, 3), sensor to local axes
    bias: Number = None  #: (3,), unit of the value, sensor axes; zero where None

    components = XYZ
    residual_components = XYZ

    @property
    def noise(self) -> Array:
        """Standard deviation of one sample (3,), unit of the value."""
        return np.asarray(self.noise_density) * sqrt(self.rate)


@dataclass(frozen=True, eq=False, kw_only=True)
class RateGyro(_Sampled):
    """Rate gyro of three axes.

    It reads the angular rate, rad/s, sensor axes: Omega of Eq. 1 and the root's rate.

    Attributes
    ----------
    xi : float
        Station s/L in [0, 1].
    name : str or None
        Name of the sensor; its kind and number where None.
    noise_density : float or array, shape (3,)
        Density of the white noise, rad/(s √Hz), of all axes or each.
    rate : float
        Samples per second, Hz.
    offset : array or symbol, shape (3,)
        Its place from the reference curve, m, local axes.
    mounting : array or symbol, shape (3, 3)
        Rotation from sensor to local axes.
    bias : array, symbol or None, shape (3,)
        Bias, rad/s, sensor axes; zero where None.
    """

    prefix = "gyro"
    unit = residual_unit = "rad/s"
    order = 1

    @classmethod
    def value(cls, at: StationMotion, frames: Frames, mount: Mount) -> Any:
        return sensor_axes(at, mount) @ at.twist[:3] + mount.bias

    @classmethod
    def slopes(cls, at: StationMotion, frames: Frames, mount: Mount) -> dict[str, Any]:
        to_sensor = sensor_axes(at, mount)
        (a, _), (a_t, _), *_ = at.sums
        by_twist = ca.horzcat(to_sensor, ca.DM.zeros(3, 3))
        return {"q": to_sensor @ a_t, "q_dot": to_sensor @ a, "twist": by_twist}


@dataclass(frozen=True, eq=False, kw_only=True)
class Accelerometer(_Sampled):
    """Accelerometer of three axes.

    It reads the specific force, m/s², sensor axes: inertial acceleration of its place minus
    gravity.

    Attributes
    ----------
    xi : float
        Station s/L in [0, 1].
    name : str or None
        Name of the sensor; its kind and number where None.
    noise_density : float or array, shape (3,)
        Density of the white noise, m/(s² √Hz), of all axes or each.
    rate : float
        Samples per second, Hz.
    offset : array or symbol, shape (3,)
        Its place from the reference curve, m, local axes.
    mounting : array or symbol, shape (3, 3)
        Rotation from sensor to local axes.
    bias : array, symbol or None, shape (3,)
        Bias, m/s², sensor axes; zero where None.
    """

    prefix = "accelerometer"
    unit = residual_unit = "m/s²"
    order = 2
    world = "gravity"

    @classmethod
    def value(cls, at: StationMotion, frames: Frames, mount: Mount) -> Any:
        *_, acceleration = point(at, mount.offset)
        gravity = frames.root_rotation.T @ world_in_parent(frames)
        return sensor_axes(at, mount) @ (acceleration - gravity) + mount.bias

    @classmethod
    def slopes(cls, at: StationMotion, frames: Frames, mount: Mount) -> dict[str, Any]:
        """With γ gravity and f = Rᵀ (P_tt − γ):

        f_q = Rᵀ (B_tt + A_tt × P + 2 A_t × P_t + A × γ)
        """
        to_sensor = sensor_axes(at, mount)
        (a, b), (a_t, b_t), (a_tt, b_tt) = at.sums
        position, velocity, _ = point(at, mount.offset)
        in_parent = world_in_parent(frames)
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


@dataclass(frozen=True, eq=False, kw_only=True)
class Magnetometer(_Sampled):
    """Magnetometer of three axes.

    It reads the magnetic field `RootMotion.magnetic_field`, T, in sensor axes.

    Attributes
    ----------
    xi : float
        Station s/L in [0, 1].
    name : str or None
        Name of the sensor; its kind and number where None.
    noise_density : float or array, shape (3,)
        Density of the white noise, T/√Hz, of all axes or each.
    rate : float
        Samples per second, Hz.
    offset : array or symbol, shape (3,)
        Its place from the reference curve, m, local axes.
    mounting : array or symbol, shape (3, 3)
        Rotation from sensor to local axes.
    bias : array, symbol or None, shape (3,)
        Bias, T, sensor axes; zero where None.
    """

    prefix = "magnetometer"
    unit = residual_unit = "T"
    world = "magnetic_field"

    @classmethod
    def value(cls, at: StationMotion, frames: Frames, mount: Mount) -> Any:
        field = frames.root_rotation.T @ world_in_parent(frames)
        return sensor_axes(at, mount) @ field + mount.bias

    @classmethod
    def slopes(cls, at: StationMotion, frames: Frames, mount: Mount) -> dict[str, Any]:
        to_sensor, in_parent = sensor_axes(at, mount), world_in_parent(frames)
        a, _ = at.sums[0]
        return {
            "q": to_sensor @ so3.hat(frames.root_rotation.T @ in_parent) @ a,
            "attitude": to_sensor @ frames.root_rotation.T @ so3.hat(in_parent),
        }


@dataclass(frozen=True, eq=False, kw_only=True)
class AttitudeSensor(Sensor):
    """Attitude sensor, with noise and bias on the right.

    It reads R exp(bias) exp(noise) with the rotation R (3, 3) from sensor to inertial axes. The
    residual is log(R_measuredᵀ R), (3,), rad.

    Attributes
    ----------
    xi : float
        Station s/L in [0, 1].
    name : str or None
        Name of the sensor; its kind and number where None.
    noise : float or array, shape (3,)
        Standard deviation of one sample, rad, of all sensor axes or each.
    mounting : array or symbol, shape (3, 3)
        Rotation from sensor to local axes.
    bias : array, symbol or None, shape (3,)
        Rotation vector, rad, sensor axes; zero where None.
    """

    noise: Number  #: standard deviation of one sample, rad, for all sensor axes or each
    mounting: Number = field(default_factory=_unit)  #: (3, 3), sensor to local axes
    bias: Number = None  #: rotation vector (3,), rad, sensor axes; zero where None

    prefix = "attitude"
    components = tuple(f"R_{row}{column}" for column in XYZ for row in XYZ)
    residual_components = XYZ
    unit, residual_unit = "1", "rad"
    whole = True
    stand_in = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)  # the logarithm there is finite

    @classmethod
    def value(cls, at: StationMotion, frames: Frames, mount: Mount) -> Any:
        in_parent = frames.root_rotation @ at.rotation @ mount.mounting
        return ca.vec(frames.attitude @ in_parent @ so3.exp(mount.bias))

    @classmethod
    def slopes(cls, at: StationMotion, frames: Frames, mount: Mount) -> dict[str, Any]:
        to_sensor = so3.exp(mount.bias).T @ sensor_axes(at, mount)
        a, _ = at.sums[0]
        return {"q": to_sensor @ a, "attitude": to_sensor @ frames.root_rotation.T}

    @classmethod
    def residual(cls, value: Any, measured: Any) -> Any:
        """log(R_measuredᵀ R).

        An attitude of a few digits is orthonormalized by one Newton step: of errors of 1e-3 it
        leaves 1e-6.
        """
        desired: Any = ca.reshape(measured, 3, 3)
        return so3.log_error(ca.reshape(value, 3, 3), so3.orthonormal(desired))

    @classmethod
    def residual_by_variation(cls, residual: Any) -> Any:
        return so3.right_jacobian_inverse(residual)

    @classmethod
    def present(cls, values: Any) -> Any:
        return is_rotation(values)

    @classmethod
    def checked_sample(cls, name: str, values: ca.DM) -> ca.DM:
        rotation: Any = rotation_matrix(name, ca.reshape(values, 3, 3))
        return ca.DM(rotation[:])


@dataclass(frozen=True, eq=False, kw_only=True)
class StrainGauge(CurvatureSensor):
    """Axial strain at a point (y, z) of the section: ε = κ_y z − κ_z y with κ = K − K_0.

    A gauge that is bonded to the unloaded wing reads zero there, pre-curved or not, and what it
    measures is the strain that the strain energy counts. With `reference="straight"` it reads zero
    on a straight wing, as a shape-sensing fibre that was calibrated before it was bonded: κ = K.

    Attributes
    ----------
    xi : float
        Station s/L in [0, 1].
    name : str or None
        Name of the sensor; its kind and number where None.
    offset : array or symbol, shape (2,)
        Place (y, z) in the section, m, local axes.
    noise : float
        Standard deviation of one sample, m/m.
    bias : float, symbol or None
        Bias, m/m; zero where None.
    reference : {"unloaded", "straight"}
        Shape at which it reads zero: the unloaded beam, so that it measures K − K_0, or a straight
        one.
    """

    offset: Number  #: (y, z), m, local axes
    noise: Number  #: standard deviation of one sample, m/m
    bias: Number = None  #: m/m; zero where None

    prefix = "strain"
    components = residual_components = ("",)
    unit = residual_unit = "1"
    shapes: ClassVar[dict[str, tuple[int, int]]] = {"offset": (2, 1)}

    def factors(self) -> AnyExpr:
        offset: AnyExpr = self.offset
        return ca.horzcat(0, offset[1], -offset[0])


@dataclass(frozen=True, eq=False, kw_only=True)
class ShearGauge(CurvatureSensor):
    """Elastic torsion K_x − K_0x, rad/m: shear strain over the distance from the axis of twist.

    With `reference="straight"` it reads K_x, built-in twist included.

    Attributes
    ----------
    xi : float
        Station s/L in [0, 1].
    name : str or None
        Name of the sensor; its kind and number where None.
    noise : float
        Standard deviation of one sample, rad/m.
    bias : float, symbol or None
        Bias, rad/m; zero where None.
    reference : {"unloaded", "straight"}
        Shape at which it reads zero: the unloaded beam, so that it measures K − K_0, or a straight
        one.
    """

    noise: Number  #: standard deviation of one sample, rad/m
    bias: Number = None  #: rad/m; zero where None

    prefix = "shear"
    components = residual_components = ("",)
    unit = residual_unit = "rad/m"

    def factors(self) -> AnyExpr:
        return ca.DM([[1, 0, 0]])


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

    noise: Number  #: standard deviation of one sample, m, for all inertial axes or each
    offset: Number = field(default_factory=_origin)  #: (3,), m, local axes
    bias: Number = None  #: (3,), m, inertial axes; zero where None

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

    pose: Pose  #: of the camera, in parent axes: the body axes of an aircraft
    noise: Number  #: standard deviation of one sample, tangent of an angle
    offset: Number = field(default_factory=_origin)  #: (3,) of the point, m, local axes
    bias: Number = None  #: (2,); zero where None

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
