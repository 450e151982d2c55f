"""Files: wings, aircraft and sensors in TOML, weights, modes and shapes in CSV or NPZ."""

from curvcasadi.files.aircraft import load_aircraft
from curvcasadi.files.estimation import EstimationFile, load_estimation
from curvcasadi.files.history import (
    SHAPE_COLUMNS as SHAPE_COLUMNS,
    load_weights as load_weights,
    write_shape as write_shape,
)
from curvcasadi.files.modes import load_modes, modal_basis
from curvcasadi.files.simulation import write_simulation
from curvcasadi.files.wing import FAMILIES as FAMILIES, WingFile, load_beam, load_wing

__all__ = [
    "EstimationFile",
    "WingFile",
    "load_aircraft",
    "load_beam",
    "load_estimation",
    "load_modes",
    "load_wing",
    "modal_basis",
    "write_simulation",
]
