"""Sensors on a wing, what they read, and the derivatives of it."""

from curvcasadi.kinematics.root_motion import RootMotion as RootMotion
from curvcasadi.sensors.channels import Channels as Channels, sensor_channels
from curvcasadi.sensors.frames import Frames as Frames, Mount as Mount, point as point
from curvcasadi.sensors.gauges import ShearGauge, StrainGauge
from curvcasadi.sensors.link import SensorLink
from curvcasadi.sensors.measurement import (
    Measurement as Measurement,
    measure,
    measurement_function,
    measurement_residual,
)
from curvcasadi.sensors.optical import Camera, Marker
from curvcasadi.sensors.sensor import CurvatureSensor as CurvatureSensor, Sensor
from curvcasadi.sensors.strapdown import (
    Accelerometer,
    AttitudeSensor,
    Magnetometer,
    RateGyro,
)

__all__ = [
    "Accelerometer",
    "AttitudeSensor",
    "Camera",
    "Magnetometer",
    "Marker",
    "RateGyro",
    "Sensor",
    "SensorLink",
    "ShearGauge",
    "StrainGauge",
    "measure",
    "measurement_function",
    "measurement_residual",
    "sensor_channels",
]
