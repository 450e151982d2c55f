"""Curvature bases for very flexible wings, as CasADi expressions."""

from curvcasadi.basis import ChannelBasis, VectorBasis
from curvcasadi.beam import Beam, mirror
from curvcasadi.families import (
    BSpline,
    CantileverModes,
    Chebyshev,
    Legendre,
    Monomial,
    PiecewiseConstant,
    Tabulated,
)
from curvcasadi.functions import function
from curvcasadi.grid import Grid
from curvcasadi.kinematics import body_jacobian, body_jacobian_rate, body_twist
from curvcasadi.pose import Pose
from curvcasadi.pose_function import pose_function, tip_function
from curvcasadi.section import Section
from curvcasadi.shape import Shape, curvature, pose_at, shape_map, squared_element_angles
from curvcasadi.statics import strain_energy

__all__ = [
    "BSpline",
    "Beam",
    "CantileverModes",
    "ChannelBasis",
    "Chebyshev",
    "Grid",
    "Legendre",
    "Monomial",
    "PiecewiseConstant",
    "Pose",
    "Section",
    "Shape",
    "Tabulated",
    "VectorBasis",
    "body_jacobian",
    "body_jacobian_rate",
    "body_twist",
    "curvature",
    "function",
    "mirror",
    "pose_at",
    "pose_function",
    "shape_map",
    "squared_element_angles",
    "strain_energy",
    "tip_function",
]
