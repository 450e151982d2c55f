"""Files: wings, aircraft and sensors in TOML, weights, modes and shapes in CSV or NPZ."""

from curvcasadi.files.aircraft import load_aircraft
from curvcasadi.files.estimation import EstimationFile, load_estimation
from curvcasadi.files.history import SHAPE_COLUMNS, load_weights, write_shape
from curvcasadi.files.modes import load_modes, modal_basis
from curvcasadi.files.simulation import write_simulation
from curvcasadi.files.wing import FAMILIES, WingFile, load_beam, load_wing

__all__ = [
    "FAMILIES",
    "SHAPE_COLUMNS",
    "EstimationFile",
    "WingFile",
    "load_aircraft",
    "load_beam",
    "load_estimation",
    "load_modes",
    "load_weights",
    "load_wing",
    "modal_basis",
    "write_shape",
    "write_simulation",
]
