"""A flexible aircraft, and its trim."""

from curvcasadi.aircraft.balance import aircraft_wrench
from curvcasadi.aircraft.free_flight import (
    FlightMomenta,
    free_forward_dynamics,
    free_inverse_dynamics,
    free_kinetic_energy,
    free_mass_matrix,
    free_momenta,
    free_strain_energy,
)
from curvcasadi.aircraft.free_flight_function import free_inverse_dynamics_function
from curvcasadi.aircraft.parts import (
    Aircraft,
    Flight,
    LiftingSurface,
    NoBody,
    RigidBody,
    Thrust,
    Wing,
    mirror_wing,
)
from curvcasadi.aircraft.trim import trim, trim_sweep
from curvcasadi.aircraft.trim_problem import TipHeight
from curvcasadi.aircraft.trim_result import TrimResult, trim_table
from curvcasadi.aircraft.turn import Turn

__all__ = [
    "Aircraft",
    "Flight",
    "FlightMomenta",
    "LiftingSurface",
    "NoBody",
    "RigidBody",
    "Thrust",
    "TipHeight",
    "TrimResult",
    "Turn",
    "Wing",
    "aircraft_wrench",
    "free_forward_dynamics",
    "free_inverse_dynamics",
    "free_inverse_dynamics_function",
    "free_kinetic_energy",
    "free_mass_matrix",
    "free_momenta",
    "free_strain_energy",
    "mirror_wing",
    "trim",
    "trim_sweep",
    "trim_table",
]
