"""Motions of a control model in time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import ceil
from typing import get_args

import numpy as np

from curvcasadi.control.bending import check_bending, warn_of_bending
from curvcasadi.control.model import ControlModel
from curvcasadi.control.signals import (
    Course,
    Signal,
    increasing,
    over_time,
    stacked,
    with_nominal,
    with_time,
    within_bounds,
)
from curvcasadi.control.steppers import SimulationMethod, stepper
from curvcasadi.errors import ConvergenceError
from curvcasadi.symbolic.expressions import Array, Number, choice, instance, positive


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

    def __repr__(self) -> str:
        return f"<Simulation of {self}>"

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
        the middle of each step. Inputs that are not given are zero, parameters have their nominal
        values where the model has them, as gusts; a parameter "time", as that of a model in a gust,
        is the time.
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
        If an argument has a wrong size, parameters without a nominal value are missing, an input or
        parameter leaves its bounds (an angle without any: ±π/2), a quaternion has no unit length,
        times do not increase, or an element turns by more than `Grid.max_angle` at the start. A
        motion that turns it so far later warns, and so does a step of "rk4" that is unstable.
    ConvergenceError
        If a step does not converge or is not finite; it names time and remedy, and `.result`
        is the simulation up to there.
    """
    from tqdm import tqdm

    instance("model", model, ControlModel)
    choice("method", method, get_args(SimulationMethod))
    start, grid = stacked("x0", model.x, x0), increasing("times", times)
    longest = positive("dt", dt) if dt is not None else np.inf
    parameters = with_nominal("p", model.p, with_time(model.p, p))
    inputs = (
        within_bounds("u", model.u, over_time("u", model.u, u, grid)),
        within_bounds("p", model.p, over_time("p", model.p, parameters, grid)),
    )
    check_bending(model, start)
    held = all(signal.held for signal in inputs)
    advance = stepper(model, method, newton, tolerance)
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
    warn_of_bending(model, result.t, result.x)
    if failure:
        raise ConvergenceError(f"simulate: {failure}", result)
    return result


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
