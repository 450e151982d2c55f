"""Motions of a control model in time."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import ceil
from typing import Any, Literal, TypeAlias, get_args

import casadi as ca
import numpy as np

from curvcasadi.control import variational_midpoint as variational
from curvcasadi.control.implicit_midpoint import TOLERANCE, midpoint_solver
from curvcasadi.control.model import ControlModel
from curvcasadi.control.signals import (
    Course,
    Signal,
    increasing,
    over_time,
    stacked,
    within_bounds,
)
from curvcasadi.control.step import midpoint_rule, rk4
from curvcasadi.errors import ConvergenceError
from curvcasadi.symbolic.compiled import compile_function
from curvcasadi.symbolic.expressions import Array, Number, choice, instance, positive

SimulationMethod = Literal["rk4", "implicit_midpoint", "variational", "cvodes"]


@dataclass(frozen=True, eq=False, kw_only=True)
class Simulation:
    """A motion of a control model.

    Attributes
    ----------
    model : ControlModel
        The model that moved; its layouts name the rows below.
    t : array, shape (T,)
        Times, s.
    x : array, shape (nx, T)
        States, one column per time.
    u : array, shape (nu, T)
        Inputs that were held from each time to the next one.
    p : array, shape (np, T)
        Parameters likewise.
    y : array, shape (ny, T)
        Outputs.
    iterations : float
        Iterations per implicit step, on average; 1 for explicit methods.
    success : bool
        Whether the last time asked for was reached.
    message : str
        What happened, in words.
    """

    model: ControlModel
    t: Array
    x: Array
    u: Array
    p: Array
    y: Array
    iterations: float
    success: bool
    message: str

    def part(self, name: str) -> Array:
        """Rows of one part of state, output, input or parameter.

        Parameters
        ----------
        name : str
            Name of the part.

        Returns
        -------
        ndarray, shape (size, T)
            One column per time.
        """
        model = self.model
        layouts = [(model.x, self.x), (model.y, self.y), (model.u, self.u), (model.p, self.p)]
        for layout, values in layouts:
            rows = layout.slices.get(name)
            if rows is not None:
                return values[rows]
        names = [part.name for layout, _ in layouts for part in layout.parts]
        raise ValueError(f"name: expected one of {names}, found {name!r}")

    def __str__(self) -> str:
        return (
            f"{self.model.name}: {len(self.t)} times from {self.t[0]:g} to {self.t[-1]:g} s; "
            f"{self.message}"
        )


def simulate(
    model: ControlModel,
    x0: Number | Mapping[str, Number],
    times: Number,
    u: Signal = None,
    p: Signal = None,
    method: SimulationMethod = "rk4",
    dt: float | None = None,
    *,
    newton: bool = False,
    tolerance: float | None = None,
    progress: bool = False,
) -> Simulation:
    """The motion of a model from a state, as native code where there is a C compiler.

    Parameters
    ----------
    model : ControlModel
        Model.
    x0 : array, shape (nx,), or mapping of str to array
        State at the first time; of a mapping, parts that it leaves out are zero, attitudes level.
    times : array, shape (T,)
        Increasing times at which the motion is wanted, s.
    u, p : array, mapping, function of time, optional
        Inputs and parameters: numbers (n,) that are held, columns (n, T) held from each time to the
        next one, a mapping from part names to such, or a function of the time, s, which is taken at
        the middle of each step. Zero unless given.
    method : {"rk4", "implicit_midpoint", "variational", "cvodes"}
        See `step_function`. "variational" is the variational midpoint rule in momenta, for free
        flight: it keeps momentum to rounding where no loads act. "cvodes" is CasADi's multistep
        integrator of variable order and step (SUNDIALS), which holds inputs from each time to the
        next one.
    dt : float, optional
        Longest step, s; the whole interval between two times unless given. Unused by cvodes.
    newton : bool
        As in `step_function`.
    tolerance : float, optional
        Relative: of corrections of implicit steps (1e-10; variational 1e-13), or of cvodes' errors
        (1e-8).
    progress : bool
        Show a progress bar.

    Returns
    -------
    Simulation
        Motion at the times asked for.

    Raises
    ------
    ValueError
        If an argument has a wrong size, an input leaves its bounds (an angle without any: ±π/2), a
        quaternion has no unit length, or times do not increase.
    ConvergenceError
        If a step does not converge or leaves the numbers; it names time and remedy, and `.result`
        is the simulation up to there.
    """
    from tqdm import tqdm

    instance("model", model, ControlModel)
    choice("method", method, get_args(SimulationMethod))
    start, grid = stacked("x0", model.x, x0), increasing("times", times)
    longest = positive("dt", dt) if dt is not None else np.inf
    inputs = (
        within_bounds("u", model.u, over_time("u", model.u, u, grid)),
        over_time("p", model.p, p, grid),
    )
    held = all(signal.held for signal in inputs)
    advance = _stepper(model, method, newton, tolerance)
    states, work = [start], []
    failure = None
    for k in tqdm(range(len(grid) - 1), disable=not progress, unit="step"):
        # A hair's breadth above a whole number of steps is rounding of the times.
        steps = max(1, ceil((grid[k + 1] - grid[k]) / longest * (1 - 1e-12)))
        h, x = (grid[k + 1] - grid[k]) / steps, states[-1]
        for i in range(steps):
            if i == 0 or not held:
                u_held, p_held = (signal(k, grid[k] + (i + 0.5) * h) for signal in inputs)
            x, iterations, failure = advance(x, u_held, p_held, h)
            work.append(iterations)
            if failure:
                failure = f"at t = {grid[k] + i * h:.6g} s with steps of {h:.3g} s {failure}"
                break
        if failure:
            break
        states.append(x)
    result = _result(model, grid, states, inputs, work, failure)
    if failure:
        raise ConvergenceError(f"simulate: {failure}", result)
    return result


#: (x, u, p, h) -> x_next, iterations, what failed.
Stepper: TypeAlias = Callable[[Array, Array, Array, float], tuple[Array, float, str | None]]


def _stepper(
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
    x, u, p, h = _symbols(model)
    end = rk4(model, h, x, u, p)
    step = Native(ca.Function(f"{model.name}_rk4", [x, u, p, h], [end]))

    def advance(x: Array, u: Array, p: Array, h: float) -> tuple[Array, float, str | None]:
        (end,) = step(x, u, p, h)
        if np.all(np.isfinite(end)):
            return end, 1.0, None
        return end, 1.0, "the state left the numbers: take shorter steps or 'implicit_midpoint'"

    return advance


#: Relative correction after all iterations of a step from which on more of them help.
_CONTRACTED = 1e-3


def _midpoint(model: ControlModel, newton: bool, tolerance: float) -> Stepper:
    rule = midpoint_rule(model, newton, tolerance=tolerance)
    solve = Native(midpoint_solver(rule))
    last, before = np.zeros(rule.n_rates), np.zeros(rule.n_rates)

    def advance(x: Array, u: Array, p: Array, h: float) -> tuple[Array, float, str | None]:
        nonlocal last, before
        guess, spent, nothing = 2 * last - before, 0.0, np.zeros(rule.n_rates)
        # What contracts slowly goes on once; else the guess itself may have been at fault.
        for _ in range(3):
            end, residual, forces, count = solve(x, u, p, h, guess)
            spent += float(count[0])
            if residual[0] <= tolerance:
                break
            guess = forces if residual[0] < _CONTRACTED else nothing
        last, before = forces, last
        if residual[0] <= tolerance:
            return end, spent, None
        remedy = "shorter steps" if newton else "shorter steps or newton=True"
        words = f"did not converge (relative correction {residual[0]:.1e}): take {remedy}"
        return end, spent, words

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
    x, u, p, h = _symbols(model)
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
            return x, 1.0, f"cvodes failed: {str(error).splitlines()[-1]}"
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

    def __call__(self, *arguments: Array | float) -> list[Array]:
        for array, argument in zip(self.inputs, arguments, strict=True):
            if array.size:
                array[:] = argument
        self.evaluate()
        return [array.copy() for array in self.outputs]


def _symbols(model: ControlModel) -> list[ca.MX]:
    sizes = {"x": model.x.size, "u": model.u.size, "p": model.p.size, "h": 1}
    return [ca.MX.sym(name, size) for name, size in sizes.items()]


def _result(
    model: ControlModel,
    times: Array,
    states: list[Array],
    inputs: tuple[Course, Course],
    work: list[float],
    failure: str | None,
) -> Simulation:
    """What was reached; inputs are those at the times themselves."""
    t, x = times[: len(states)], np.column_stack(states)
    u, p = (np.column_stack([signal(k, time) for k, time in enumerate(t)]) for signal in inputs)
    columns = [model.output(*column) for column in zip(x.T, u.T, p.T, strict=True)]
    return Simulation(
        model=model,
        t=t,
        x=x,
        u=u,
        p=p,
        y=np.hstack([column.full() for column in columns]),
        iterations=float(np.mean(work)) if work else 0.0,
        success=failure is None,
        message=failure or "reached the last time",
    )
