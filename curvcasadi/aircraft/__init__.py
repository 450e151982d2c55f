"""A flexible aircraft, and its trim."""

from curvcasadi.aircraft.balance import aircraft_wrench
from curvcasadi.aircraft.parts import (
    Aircraft,
    Flight,
    LiftingSurface,
    RigidBody,
    Thrust,
    Wing,
    mirror_wing,
)
from curvcasadi.aircraft.trim import trim, trim_sweep
from curvcasadi.aircraft.trim_problem import TipHeight
from curvcasadi.aircraft.trim_result import TrimResult, trim_table

__all__ = [
    "Aircraft",
    "Flight",
    "LiftingSurface",
    "RigidBody",
    "Thrust",
    "TipHeight",
    "TrimResult",
    "Wing",
    "aircraft_wrench",
    "mirror_wing",
    "trim",
    "trim_sweep",
    "trim_table",
]
