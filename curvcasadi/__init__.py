"""Curvature bases for very flexible wings, as CasADi expressions."""

from curvcasadi.basis import ChannelBasis, VectorBasis
from curvcasadi.beam import Beam, mirror
from curvcasadi.control_model import ControlModel, kinematic_model
from curvcasadi.errors import ConvergenceError
from curvcasadi.export import export_c
from curvcasadi.families import (
    BSpline,
    CantileverModes,
    Chebyshev,
    Legendre,
    Monomial,
    PiecewiseConstant,
    Tabulated,
)
from curvcasadi.files import load_beam
from curvcasadi.functions import function
from curvcasadi.grid import Grid
from curvcasadi.integrators import rk4_step
from curvcasadi.kinematics import body_jacobian, body_jacobian_rate, body_twist
from curvcasadi.layout import Layout, Part
from curvcasadi.ocp.reach import ShapeResult, reach_shape
from curvcasadi.ocp.shape_target import shape_target_function
from curvcasadi.ocp.targets import Target
from curvcasadi.ocp.tip_path import tip_path_step_function
from curvcasadi.pose import Pose
from curvcasadi.pose_function import pose_function, tip_function
from curvcasadi.resolution import elements_for
from curvcasadi.section import Section
from curvcasadi.shape import Shape, curvature, pose_at, shape_map, squared_element_angles
from curvcasadi.statics import strain_energy

__all__ = [
    "BSpline",
    "Beam",
    "CantileverModes",
    "ChannelBasis",
    "Chebyshev",
    "ControlModel",
    "ConvergenceError",
    "Grid",
    "Layout",
    "Legendre",
    "Monomial",
    "Part",
    "PiecewiseConstant",
    "Pose",
    "Section",
    "Shape",
    "ShapeResult",
    "Tabulated",
    "Target",
    "VectorBasis",
    "body_jacobian",
    "body_jacobian_rate",
    "body_twist",
    "curvature",
    "elements_for",
    "export_c",
    "function",
    "kinematic_model",
    "load_beam",
    "mirror",
    "pose_at",
    "pose_function",
    "reach_shape",
    "rk4_step",
    "shape_map",
    "shape_target_function",
    "squared_element_angles",
    "strain_energy",
    "tip_function",
    "tip_path_step_function",
]
