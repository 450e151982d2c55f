"""Loads on a beam, and what they amount to at its stations."""

from curvcasadi.loads.kinds import (
    DistributedForce,
    DistributedMoment,
    Gravity,
    PointForce,
    PointMoment,
)
from curvcasadi.loads.stations import (
    Load,
    force_data as force_data,
    moment_data as moment_data,
    sites as sites,
)

__all__ = [
    "DistributedForce",
    "DistributedMoment",
    "Gravity",
    "Load",
    "PointForce",
    "PointMoment",
]
