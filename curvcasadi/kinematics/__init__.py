"""From weights to poses, Jacobians and twists."""

from curvcasadi.kinematics.jacobian import (
    body_jacobian,
)
from curvcasadi.kinematics.motion import (
    body_jacobian_rate,
    body_twist,
)
from curvcasadi.kinematics.pose_function import (
    pose_function,
    tip_function,
)
from curvcasadi.kinematics.resolution import (
    elements_for,
)
from curvcasadi.kinematics.root_motion import (
    RootMotion,
)
from curvcasadi.kinematics.shape import (
    Shape,
    curvature,
    pose_at,
    shape_map,
    squared_element_angles,
)

__all__ = [
    "RootMotion",
    "Shape",
    "body_jacobian",
    "body_jacobian_rate",
    "body_twist",
    "curvature",
    "elements_for",
    "pose_at",
    "pose_function",
    "shape_map",
    "squared_element_angles",
    "tip_function",
]
