"""Files: wings, aircraft and sensors in TOML, weights, modes and shapes in CSV or NPZ."""

from curvcasadi.files.aircraft import load_aircraft
from curvcasadi.files.basis import FAMILIES as FAMILIES
from curvcasadi.files.beamdyn import load_beamdyn_sections
from curvcasadi.files.estimation import EstimationFile, load_estimation
from curvcasadi.files.history import (
    SHAPE_COLUMNS as SHAPE_COLUMNS,
    load_weights as load_weights,
    write_shape as write_shape,
)
from curvcasadi.files.modes import load_modes, modal_basis, write_modes
from curvcasadi.files.nastran import load_nastran_modes
from curvcasadi.files.scenario import Scenario, load_scenario, simulate_scenario
from curvcasadi.files.sharpy import load_sharpy_sections
from curvcasadi.files.simulation import write_simulation
from curvcasadi.files.study import GustStudy, load_study
from curvcasadi.files.timed_load import TimedLoad
from curvcasadi.files.wing import WingFile, load_beam, load_wing

__all__ = [
    "EstimationFile",
    "GustStudy",
    "Scenario",
    "TimedLoad",
    "WingFile",
    "load_aircraft",
    "load_beam",
    "load_beamdyn_sections",
    "load_estimation",
    "load_modes",
    "load_nastran_modes",
    "load_scenario",
    "load_sharpy_sections",
    "load_study",
    "load_wing",
    "modal_basis",
    "simulate_scenario",
    "write_modes",
    "write_simulation",
]
