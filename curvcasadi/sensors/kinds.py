"""Sensors on a wing: where they sit, how they are mounted, and how noisy they are.

A sensor sits at the station `xi`, at `offset` from the reference curve in local axes, and its own
axes are turned by `mounting`, which takes sensor components to local ones. Noise is white, and
independent between samples, axes and sensors. `offset`, `mounting`, `pose` and `bias` may be
symbols; `bias` adds to what an ideal sensor reads.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from math import sqrt
from typing import Any, ClassVar, Literal

import casadi as ca
import numpy as np

from curvcasadi.beam.pose import Pose, checked_pose
from curvcasadi.symbolic.expressions import (
    AnyExpr,
    Array,
    Number,
    choice,
    expression,
    function_name,
    numbers,
    own_fields,
    positive,
    rotation_matrix,
    station,
)

XYZ = ("x", "y", "z")


@dataclass(frozen=True, eq=False, kw_only=True)
class Sensor:
    """What all kinds of sensors have in common; it measures nothing itself."""

    xi: float  #: station s/L
    name: str | None = None  #: begins its labels; None for "gyro_1" and so on

    prefix: ClassVar[str] = "sensor"  #: of the names of unnamed sensors
    components: ClassVar[tuple[str, ...]] = ()  #: of the value; ("",) of a scalar
    unit: ClassVar[str] = ""  #: of the value
    residual_components: ClassVar[tuple[str, ...]] = ()  #: of prediction against measurement
    residual_unit: ClassVar[str] = ""
    offset_size: ClassVar[int] = 3
    order: ClassVar[int] = 0  #: 0: reads the shape, 1: and its rate, 2: and its acceleration

    def __post_init__(self) -> None:
        own_fields(self)
        size = len(self.residual_components)
        for entry in fields(self):
            where = f"{type(self).__name__}.{entry.name}"
            value = self._checked(entry.name, where, getattr(self, entry.name), size)
            object.__setattr__(self, entry.name, value)

    def _checked(self, field_name: str, where: str, value: Any, size: int) -> Any:
        """The value of a field, or a ValueError that names it."""
        match field_name:
            case "xi":
                return station(where, value)
            case "name":
                return value if value is None else function_name(where, value)
            case "offset":
                return expression(where, value, (self.offset_size, 1))
            case "mounting":
                return rotation_matrix(where, value)
            case "pose":
                return checked_pose(where, value)
            case "bias":
                return expression(where, np.zeros(size) if value is None else value, (size, 1))
            case "reference":
                return choice(where, value, REFERENCES)
            case "rate":
                return float(positive_numbers(where, value, 1)[0])
        return positive_numbers(where, value, size)


def positive_numbers(where: str, value: Number, size: int) -> Array:
    """One number above zero for all entries, or one for each: (size,)."""
    array = numbers(where, value).ravel()
    if array.size not in (1, size):
        expected = "1 number" if size == 1 else f"1 number or {size}"
        raise ValueError(f"{where}: expected {expected}, found {array.size}")
    for entry in array:
        positive(where, entry)
    return np.array(np.broadcast_to(array, (size,)))


def deviations(sensor: Any) -> Array:
    """Standard deviation of one sample of each residual of `sensor`, its `residual_unit`."""
    return np.asarray(sensor.noise)


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


#: Shapes at which a gauge may read zero.
REFERENCES = ("unloaded", "straight")


@dataclass(frozen=True, eq=False, kw_only=True)
class StrainGauge(Sensor):
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
    reference: Literal["unloaded", "straight"] = "unloaded"  #: shape at which it reads zero

    prefix = "strain"
    components = residual_components = ("",)
    unit = residual_unit = "1"
    offset_size = 2


@dataclass(frozen=True, eq=False, kw_only=True)
class ShearGauge(Sensor):
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
    reference: Literal["unloaded", "straight"] = "unloaded"  #: shape at which it reads zero

    prefix = "shear"
    components = residual_components = ("",)
    unit = residual_unit = "rad/m"


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
    unit = residual_unit = "1"
