"""Optimal control and shape targets built on the shape map."""

from curvcasadi.ocp.mpc import Mpc, MpcStep
from curvcasadi.ocp.reach import ShapeResult, reach_shape
from curvcasadi.ocp.shape_target import shape_target_function
from curvcasadi.ocp.targets import Target, target_residual_function
from curvcasadi.ocp.tip_path import tip_path_step_function

__all__ = [
    "Mpc",
    "MpcStep",
    "ShapeResult",
    "Target",
    "reach_shape",
    "shape_target_function",
    "target_residual_function",
    "tip_path_step_function",
]
