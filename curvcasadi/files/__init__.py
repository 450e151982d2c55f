"""Files, by subject: wings from TOML, weights from CSV, shapes to CSV or NPZ."""

from curvcasadi.files.history import SHAPE_COLUMNS, load_weights, write_shape
from curvcasadi.files.wing import FAMILIES, WingFile, load_beam, load_wing

__all__ = [
    "FAMILIES",
    "SHAPE_COLUMNS",
    "WingFile",
    "load_beam",
    "load_weights",
    "load_wing",
    "write_shape",
]
