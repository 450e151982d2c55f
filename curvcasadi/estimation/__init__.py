"""Shapes from measurements: filters, fits, and where sensors should sit."""

from curvcasadi.estimation.ekf.delayed import DelayedFilter
from curvcasadi.estimation.ekf.filter import Estimate, ShapeEkf
from curvcasadi.estimation.ekf.maker import shape_ekf
from curvcasadi.estimation.ekf.run import run_ekf
from curvcasadi.estimation.fit.fit import fit_shape
from curvcasadi.estimation.fit.result import ShapeFit
from curvcasadi.estimation.information import ShapeDeviations, information_matrix, shape_deviations
from curvcasadi.estimation.mhe.estimate import WindowEstimate
from curvcasadi.estimation.mhe.estimator import ShapeMhe
from curvcasadi.estimation.mhe.maker import shape_mhe
from curvcasadi.estimation.mhe.run import run_mhe
from curvcasadi.estimation.model_process import ModelProcess
from curvcasadi.estimation.placement.placement import Placement, place_sensors
from curvcasadi.estimation.process import RandomWalk, WhiteAcceleration

__all__ = [
    "DelayedFilter",
    "Estimate",
    "ModelProcess",
    "Placement",
    "RandomWalk",
    "ShapeDeviations",
    "ShapeEkf",
    "ShapeFit",
    "ShapeMhe",
    "WhiteAcceleration",
    "WindowEstimate",
    "fit_shape",
    "information_matrix",
    "place_sensors",
    "run_ekf",
    "run_mhe",
    "shape_deviations",
    "shape_ekf",
    "shape_mhe",
]
