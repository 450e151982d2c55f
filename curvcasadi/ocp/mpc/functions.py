"""Functions of a model that the stages of a predictive controller are made of."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import casadi as ca

from curvcasadi.control.model import ControlModel
from curvcasadi.control.step import Method, step_function
from curvcasadi.ocp.mpc.terms import angle_function
from curvcasadi.symbolic.compiled import compile_function


@dataclass(frozen=True, kw_only=True)
class ModelFunctions:
    """A model over a stage, its outputs, rates and angles.

    Attributes
    ----------
    model : ControlModel
        The model.
    dt : float
        Length of a stage, s.
    method, substeps, newton : str, int, bool
        As in `step_function`.
    """

    model: ControlModel
    dt: float
    method: Method
    substeps: int
    newton: bool

    @cached_property
    def step(self) -> ca.Function:
        """(x, u, p) -> x_next, residual."""
        return step_function(
            self.model,
            self.dt,
            method=self.method,
            substeps=self.substeps,
            newton=self.newton,
        )

    @property
    def output(self) -> ca.Function:
        """(x, u, p) -> y."""
        return self.model.output

    @property
    def xdot(self) -> ca.Function:
        """(x, u, p) -> dx/dt."""
        return self.model.xdot

    @property
    def angles(self) -> ca.Function | None:
        """(x) -> squared angles of elements over what they may be, where the model knows them."""
        return angle_function(self.model)

    @cached_property
    def native(self) -> NativeFunctions:
        """The same as native code, compiled once for all who hold this object."""
        return NativeFunctions(self)


@dataclass(frozen=True, eq=False)
class NativeFunctions:
    """Functions of a model as native code, each compiled when it is first asked for."""

    of: ModelFunctions

    @cached_property
    def step(self) -> ca.Function:
        """(x, u, p) -> x_next, residual."""
        return compile_function(self.of.step)

    @cached_property
    def output(self) -> ca.Function:
        """(x, u, p) -> y."""
        return compile_function(self.of.output)

    @cached_property
    def xdot(self) -> ca.Function:
        """(x, u, p) -> dx/dt."""
        return compile_function(self.of.xdot)

    @cached_property
    def angles(self) -> ca.Function | None:
        """(x) -> squared angles of elements over what they may be, where the model knows them."""
        return compile_function(self.of.angles) if self.of.angles else None
