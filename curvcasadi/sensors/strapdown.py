"""Strapped-down sensors, as in inertial units: rates, specific force, magnetic field, attitude."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import sqrt
from typing import Any

import casadi as ca
import numpy as np

from curvcasadi.kinematics.state import StationMotion
from curvcasadi.lie import so3
from curvcasadi.sensors.frames import Frames, Mount, origin, point, sensor_axes, world_in_parent
from curvcasadi.sensors.sensor import XYZ, Sensor
from curvcasadi.symbolic.expressions import AnyExpr, Array, Number, is_rotation, rotation_matrix


def _unit() -> AnyExpr:
    return ca.DM.eye(3)


@dataclass(frozen=True, eq=False, kw_only=True)
class _Sampled(Sensor):
    """A strapped-down sensor of three axes whose data sheet states a noise density.

    White noise of the density N, sampled at the rate f, has the standard deviation N √f a sample.
    """

    noise_density: Number  #: N, unit/√Hz, for all axes or each
    rate: float  #: samples per second, Hz
    offset: Number = field(default_factory=origin)  #: (3,), m, local axes
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

    noise: Number
    mounting: Number = field(default_factory=_unit)
    bias: Number = None

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
