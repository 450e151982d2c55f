"""Sensors on a wing, what they read, and the derivatives of it."""

from curvcasadi.kinematics.root_motion import RootMotion
from curvcasadi.sensors.channels import Channels, sensor_channels
from curvcasadi.sensors.kinds import (
    Accelerometer,
    AttitudeSensor,
    Camera,
    Magnetometer,
    Marker,
    RateGyro,
    Sensor,
    ShearGauge,
    StrainGauge,
)
from curvcasadi.sensors.measurement import (
    Measurement,
    measure,
    measurement_function,
    measurement_residual,
)

__all__ = [
    "Accelerometer",
    "AttitudeSensor",
    "Camera",
    "Channels",
    "Magnetometer",
    "Marker",
    "Measurement",
    "RateGyro",
    "RootMotion",
    "Sensor",
    "ShearGauge",
    "StrainGauge",
    "measure",
    "measurement_function",
    "measurement_residual",
    "sensor_channels",
]
