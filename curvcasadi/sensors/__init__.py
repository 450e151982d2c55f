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
    ShearGauge,
    StrainGauge,
)
from curvcasadi.sensors.measurement import (
    Measurement,
    measure,
    measurement_function,
    measurement_residual,
)
from curvcasadi.sensors.sensor import CurvatureSensor, Frames, Mount, Sensor, point

__all__ = [
    "Accelerometer",
    "AttitudeSensor",
    "Camera",
    "Channels",
    "CurvatureSensor",
    "Frames",
    "Magnetometer",
    "Marker",
    "Measurement",
    "Mount",
    "RateGyro",
    "RootMotion",
    "Sensor",
    "ShearGauge",
    "StrainGauge",
    "measure",
    "measurement_function",
    "measurement_residual",
    "point",
    "sensor_channels",
]
