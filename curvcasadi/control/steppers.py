"""One step of each integrator as native code: what a simulation calls in a row."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal, TypeAlias

import casadi as ca
import numpy as np

from curvcasadi.control import variational_midpoint as variational
from curvcasadi.control.implicit_midpoint import TOLERANCE, midpoint_solver
from curvcasadi.control.model import ControlModel, symbols_of
from curvcasadi.control.stability import SLACK, remedy, warn_of_unstable_step
from curvcasadi.control.step import midpoint_rule, rk4
from curvcasadi.symbolic.compiled import compile_function
from curvcasadi.symbolic.expressions import Array, positive

SimulationMethod = Literal["rk4", "implicit_midpoint", "variational", "cvodes"]

#: (x, u, p, h) -> x_next, iterations, what failed.
Stepper: TypeAlias = Callable[[Array, Array, Array, float], tuple[Array, float, str | None]]


def stepper(
    model: ControlModel, method: SimulationMethod, newton: bool, tolerance: float | None
) -> Stepper:
    if tolerance is not None:
        tolerance = float(positive("tolerance", tolerance))
    if method == "rk4":
        return _rk4(model)
    if method == "cvodes":
        return _cvodes(model, 1e-8 if tolerance is None else tolerance)
    if method == "variational":
        return _variational(model, variational.TOLERANCE if tolerance is None else tolerance)
    return _midpoint(model, newton, TOLERANCE if tolerance is None else tolerance)


def _rk4(model: ControlModel) -> Stepper:
    (x, u, p), h = symbols_of(model), ca.MX.sym("h")
    end = rk4(model, h, x, u, p)
    step = Native(ca.Function(f"{model.name}_rk4", [x, u, p, h], [end]))

    longest = 0.0

    def advance(x: Array, u: Array, p: Array, h: float) -> tuple[Array, float, str | None]:
        nonlocal longest
        if h > longest * (1 + SLACK):
            longest = h
            warn_of_unstable_step("simulate", model, h, [x, u, p], stacklevel=4)
        (end,) = step(x, u, p, h)
        if np.all(np.isfinite(end)):
            return end, 1.0, None
        todo = remedy(model, h, x, u, p) or "take shorter steps"
        return end, 1.0, f"the state is not finite: {todo}"

    return advance


#: Relative correction after all iterations of a step from which on more of them help.
_CONTRACTED = 1e-3


def _midpoint(model: ControlModel, newton: bool, tolerance: float) -> Stepper:
    rule = midpoint_rule(model, newton, tolerance=tolerance)
    solve = Native(midpoint_solver(rule))
    guess = solve.inputs[-1]
    end, residual, forces, count = solve.outputs
    last, before = np.zeros(rule.n_rates), np.zeros(rule.n_rates)

    def advance(x: Array, u: Array, p: Array, h: float) -> tuple[Array, float, str | None]:
        # In place: arrays that come and go would take a good part of the time of a step.
        np.multiply(last, 2.0, out=guess)
        np.subtract(guess, before, out=guess)
        spent = 0.0
        # What contracts slowly goes on once; else the guess itself may have been at fault.
        for _ in range(3):
            solve.run(x, u, p, h)
            spent += count.item()
            if residual.item() <= tolerance:
                break
            guess[:] = forces if residual.item() < _CONTRACTED else 0.0
        before[:], last[:] = last, forces
        if residual.item() <= tolerance:
            return end.copy(), spent, None
        remedy = "shorter steps" if newton else "shorter steps or newton=True"
        words = f"did not converge (relative correction {residual.item():.1e}): take {remedy}"
        return end.copy(), spent, words

    return advance


def _variational(model: ControlModel, tolerance: float) -> Stepper:
    motion = variational.variational_motion(model)
    solve = Native(variational.variational_solver(model, tolerance=tolerance))
    start = model.x.size - motion.velocities
    momenta: Array | None = None
    velocities = np.zeros(motion.velocities)

    def advance(x: Array, u: Array, p: Array, h: float) -> tuple[Array, float, str | None]:
        nonlocal momenta, velocities
        if momenta is None:  # kept from step to step: velocities would lose their last digits
            momenta, velocities = variational.momenta_of(motion, x), x[start:]
        c, after, residual, velocities, count = solve(x[:start], momenta, u, p, h, velocities)
        momenta = after
        end = np.concatenate([c, variational.velocities_of(motion, c, after, p)])
        if residual[0] <= tolerance:
            return end, float(count[0]), None
        words = f"did not converge (relative correction {residual[0]:.1e}): take shorter steps"
        return end, float(count[0]), words

    return advance


def _cvodes(model: ControlModel, tolerance: float) -> Stepper:
    (x, u, p), h = symbols_of(model), ca.MX.sym("h")
    slope = compile_function(model.xdot, derivatives=0)
    # Adams' methods with functional iteration take no derivative, though CasADi asks for one.
    options = {"enable_fd": True, "never_inline": True}
    options |= dict.fromkeys(("enable_forward", "enable_reverse", "enable_jacobian"), False)
    rate = ca.Function("rate", [x, u, p, h], [h * slope(x, u, p)], options)
    integrator = ca.integrator(
        f"{model.name}_cvodes",
        "cvodes",
        {"x": x, "p": ca.vertcat(u, p, h), "ode": rate(x, u, p, h)},
        0.0,
        1.0,
        {
            "reltol": tolerance,
            "abstol": tolerance,
            "linear_multistep_method": "adams",
            "nonlinear_solver_iteration": "functional",
            "max_num_steps": 100_000,
        },
    )

    def advance(x: Array, u: Array, p: Array, h: float) -> tuple[Array, float, str | None]:
        try:
            end = integrator(x0=x, p=np.concatenate([u, p, [h]]))["xf"].full().ravel()
        except RuntimeError as error:
            reason = str(error).splitlines()[-1].rpartition(": ")[2]
            words = f"cvodes failed ({reason}): take another tolerance or 'implicit_midpoint'"
            return x, 1.0, words
        return end, 1.0, None

    return advance


class Native:
    """A Function as native code, called on arrays without CasADi's conversions."""

    def __init__(self, f: ca.Function) -> None:
        self.function = compile_function(f, derivatives=0)  # the buffer does not keep it alive
        self.buffer: Any
        self.buffer, self.evaluate = self.function.buffer()
        self.inputs = [np.zeros(self.function.nnz_in(i)) for i in range(self.function.n_in())]
        self.outputs = [np.zeros(self.function.nnz_out(i)) for i in range(self.function.n_out())]
        for i, array in enumerate(self.inputs):
            self.buffer.set_arg(i, memoryview(array.data))
        for i, array in enumerate(self.outputs):
            self.buffer.set_res(i, memoryview(array.data))

    def run(self, *arguments: Array | float) -> None:
        """Evaluate with the first inputs so; the others stay, and `outputs` hold the results."""
        for array, argument in zip(self.inputs, arguments, strict=False):
            if array.size:
                array[:] = argument
        self.evaluate()

    def __call__(self, *arguments: Array | float) -> list[Array]:
        self.run(*arguments)
        return [array.copy() for array in self.outputs]
