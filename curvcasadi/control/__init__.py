"""Models as a control engineer sees them: x, u, p, y."""

from curvcasadi.control.error_state import difference, retract
from curvcasadi.control.kinematic_model import kinematic_model
from curvcasadi.control.model import ControlModel, SecondOrder
from curvcasadi.control.simulation import Simulation, simulate
from curvcasadi.control.step import rk4_step, step_function

__all__ = [
    "ControlModel",
    "SecondOrder",
    "Simulation",
    "difference",
    "kinematic_model",
    "retract",
    "rk4_step",
    "simulate",
    "step_function",
]
