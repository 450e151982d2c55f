"""Model predictive control of any control model."""

from curvcasadi.ocp.mpc.controller import Mpc
from curvcasadi.ocp.mpc.result import MpcStep

__all__ = ["Mpc", "MpcStep"]
