"""Loads on a beam, and what they amount to at its stations."""

from curvcasadi.loads.kinds import (
    DistributedForce,
    DistributedMoment,
    Gravity,
    PointForce,
    PointMoment,
)

__all__ = [
    "DistributedForce",
    "DistributedMoment",
    "Gravity",
    "PointForce",
    "PointMoment",
]
