"""Steady aerodynamics of wings, strip by strip."""

from curvcasadi.aero.airload import AerodynamicLoad, Flow, StripForces, strip_forces
from curvcasadi.aero.strip import ControlSurface, ExponentialTipLoss, StripAerodynamics, mirror_aero

__all__ = [
    "AerodynamicLoad",
    "ControlSurface",
    "ExponentialTipLoss",
    "Flow",
    "StripAerodynamics",
    "StripForces",
    "mirror_aero",
    "strip_forces",
]
