"""Models as a control engineer sees them: x, u, p, y."""

from curvcasadi.control.integrators import rk4_step
from curvcasadi.control.kinematic_model import kinematic_model
from curvcasadi.control.model import ControlModel

__all__ = [
    "ControlModel",
    "kinematic_model",
    "rk4_step",
]
