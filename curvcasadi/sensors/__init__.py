"""Sensors on a wing, what they read, and the derivatives of it."""

from curvcasadi.kinematics.root_motion import RootMotion as RootMotion
from curvcasadi.sensors.channels import Channels as Channels, sensor_channels
from curvcasadi.sensors.kinds import (
    Accelerometer,
    AttitudeSensor,
    Camera,
    Magnetometer,
    Marker,
    RateGyro,
    ShearGauge,
    StrainGauge,
)
from curvcasadi.sensors.measurement import (
    Measurement as Measurement,
    measure,
    measurement_function,
    measurement_residual,
)
from curvcasadi.sensors.sensor import (
    CurvatureSensor as CurvatureSensor,
    Frames as Frames,
    Mount as Mount,
    Sensor,
    point as point,
)

__all__ = [
    "Accelerometer",
    "AttitudeSensor",
    "Camera",
    "Magnetometer",
    "Marker",
    "RateGyro",
    "Sensor",
    "ShearGauge",
    "StrainGauge",
    "measure",
    "measurement_function",
    "measurement_residual",
    "sensor_channels",
]
