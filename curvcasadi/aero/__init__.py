"""Aerodynamics of wings, strip by strip: steady, unsteady, in gusts, with induced flow."""

from curvcasadi.aero.airload import AerodynamicLoad, Flow, StripForces, strip_forces
from curvcasadi.aero.gust import (
    GustEntry,
    GustField,
    OneMinusCosine,
    StepGust,
    frozen_gust,
    kussner,
)
from curvcasadi.aero.induced import LiftingLine
from curvcasadi.aero.lag_states import IndicialLag
from curvcasadi.aero.outline import Planform, planform
from curvcasadi.aero.sides import mirror_aero
from curvcasadi.aero.strip import StripAerodynamics
from curvcasadi.aero.surfaces import ControlSurface, ExponentialTipLoss
from curvcasadi.aero.turbulence import SampledGust, Turbulence
from curvcasadi.aero.unsteady import UnsteadyAirload

__all__ = [
    "AerodynamicLoad",
    "ControlSurface",
    "ExponentialTipLoss",
    "Flow",
    "GustEntry",
    "GustField",
    "IndicialLag",
    "LiftingLine",
    "OneMinusCosine",
    "Planform",
    "SampledGust",
    "StepGust",
    "StripAerodynamics",
    "StripForces",
    "Turbulence",
    "UnsteadyAirload",
    "frozen_gust",
    "kussner",
    "mirror_aero",
    "planform",
    "strip_forces",
]
