"""Model predictive control of any control model."""

from curvcasadi.ocp.mpc.controller import Mpc, MpcStep

__all__ = ["Mpc", "MpcStep"]
