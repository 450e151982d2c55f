"""A control model as the process of a filter: its state, what is estimated beside it, its steps.

The state of the filter is z = (x, e, b): the model's x, those of its parameters that are estimated,
and biases of sensors. With δ the error state, z_true = z ⊕ δ (`retract`; attitudes on the group),
f the model's step (Runge–Kutta or implicit midpoint) and white noise of density s on parts of δ:

    z ← f(z),   P ← F (P + dt/2 S) Fᵀ + dt/2 S,    F = d(f(z ⊕ δ) ⊖ f(z))/dδ,   S = diag(s²)

Half of the noise comes before the step and half behind it, which is of second order in dt. An
estimated parameter e wanders, e' = w, or returns to zero in a time τ, e' = −e/τ + w.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, get_args

import casadi as ca
import numpy as np

from curvcasadi.control.error_state import add, in_error_state, subtract
from curvcasadi.control.implicit_midpoint import midpoint_step_of_any_length
from curvcasadi.control.model import ControlModel
from curvcasadi.control.stability import unstable_step
from curvcasadi.control.step import Method, midpoint_rule, rk4
from curvcasadi.estimation import ud
from curvcasadi.estimation.process import REJECTIONS
from curvcasadi.symbolic.expressions import (
    AnyExpr,
    Array,
    Expr,
    Number,
    Real,
    choice,
    count,
    instance,
    numbers,
)
from curvcasadi.symbolic.layout import Layout, Part

#: Relative correction at which an implicit step has converged: a part of any process noise.
CONVERGED: dict[Real, float] = {"double": 1e-9, "float": 1e-5}


@dataclass(frozen=True, eq=False, kw_only=True)
class ModelProcess:
    """A control model that is driven by its inputs and by white noise.

    Attributes
    ----------
    model : ControlModel
        Model of the wing or aircraft: `beam_model`, `wing_model`, `aircraft_model`, or one of the
        user's whose state has parts called q and q_dot.
    density : mapping of str to float or array
        Density of the white noise on parts of the error state, by name: their unit/√s. After the
        time t its integral has the standard deviation density √t. That of q_dot stands for what
        the model does not know of the forces.
    estimated : mapping of str to float or None
        Parameters of the model that are estimated, such as airspeed or gust, by name of the part:
        the time in which they return to zero, s, or None for a random walk. Each needs a density;
        one that returns in the time τ has the standard deviation density √(τ/2) in the long run.
    acceleration : float, array or mapping of str to such, optional
        Standard deviation of q_ddot about the model's, rad/(m s²), for accelerometers: of all
        weights, or by name of the part q_dot. It is forgotten from sample to sample.
    substeps : int
        Steps of the model between two samples.
    method : {"rk4", "implicit_midpoint"}
        As in `step_function`. Steps of Runge–Kutta have to stay below 2.8 over the model's highest
        frequency; implicit ones are stable for stiff wings, and take several balances of forces and
        the derivatives of one. One that does not converge gives NaN.
    """

    model: ControlModel
    density: Mapping[str, Number]
    estimated: Mapping[str, float | None] = field(default_factory=dict)
    acceleration: Number | Mapping[str, Number] | None = None
    substeps: int = 1
    method: Method = "rk4"


@dataclass(frozen=True, eq=False, kw_only=True)
class Dynamics:
    """Checked description of the state of a filter and of what drives it."""

    model: ControlModel
    density: Mapping[str, Array]  #: by name of parts of the error state
    returns: Mapping[str, float]  #: times of estimated parameters, s; infinite in a random walk
    biases: Mapping[str, int]  #: sizes of the biases
    counters: int  #: how many kinds of sensors have their rejections counted
    substeps: int
    method: Method

    @property
    def parameters(self) -> Layout:
        """Parameters of the model that are estimated."""
        return Layout(tuple(part for part in self.model.p.parts if part.name in self.returns))

    @property
    def estimated(self) -> tuple[Part, ...]:
        """What is estimated beside the model's state."""
        units = {"gyro_bias": "rad/s", "accelerometer_bias": "m/s2"}
        return (*self.parameters.parts, *(Part(k, n, units[k]) for k, n in self.biases.items()))

    @property
    def whole(self) -> Layout:
        """The state without counters."""
        return Layout((*self.model.x.parts, *self.estimated))

    @property
    def state(self) -> Layout:
        """The state; counters of rejected updates are last."""
        counters = (Part(REJECTIONS, self.counters, "1"),) if self.counters else ()
        return Layout((*self.whole.parts, *counters))

    @property
    def error(self) -> Layout:
        """The error state."""
        return self.whole.errors

    @property
    def known(self) -> Layout:
        """Parameters that are inputs."""
        return Layout(tuple(part for part in self.model.p.parts if part.name not in self.returns))

    @property
    def inputs(self) -> dict[str, ca.MX]:
        """Symbols of what both Functions take of the model's inputs and parameters."""
        sizes = {"u": self.model.u.size, "p": self.known.size}
        return {key: ca.MX.sym(key, size) for key, size in sizes.items() if size}

    def arguments(self, whole: Expr, given: Mapping[str, Expr]) -> tuple[Expr, Expr, Expr]:
        """x, u and p of the model, of a state without counters."""
        none = type(whole)(0, 1)
        parts = self.whole.split(whole)
        known = self.known.split(given.get("p", none))
        p = ca.vertcat(*((parts | known)[part.name] for part in self.model.p.parts), none)
        x = ca.vertcat(*(parts[part.name] for part in self.model.x.parts))
        return x, given.get("u", none), p

    def unstable_step(self, dt: float, state: Array, given: Mapping[str, Array]) -> str | None:
        """What is wrong with `dt` between samples at a state, u and p, in words, or None."""
        if self.method != "rk4":
            return None
        numbers = {key: ca.DM(value) for key, value in given.items()}
        at = self.arguments(ca.DM(state[: self.whole.size]), numbers)
        x, u, p = (value.full().ravel() for value in at)
        remedy = "method='implicit_midpoint' or more substeps of the ModelProcess"
        return unstable_step(self.model, dt / self.substeps, x, u, p, remedy)

    def unstable_at_rest(self, dt: float) -> str | None:
        """As `unstable_step`, where state, u and p are zero."""
        given = {key: np.zeros(symbol.numel()) for key, symbol in self.inputs.items()}
        return self.unstable_step(dt, np.zeros(self.whole.size), given)

    def retraction(self) -> ca.Function:
        """(state, error) -> state."""
        state, error = ca.MX.sym("state", self.state.size), ca.MX.sym("error", self.error.size)
        whole, counters = ca.vertsplit(state, [0, self.whole.size, self.state.size])
        moved = ca.vertcat(add(self.whole, whole, error), counters)
        return ca.Function("retract", [state, error], [moved], {"cse": True})

    def difference(self) -> ca.Function:
        """(a, b) -> the error that takes the state a to b."""
        a, b = (ca.MX.sym(key, self.state.size) for key in "ab")
        start, end = (state[: self.whole.size] for state in (a, b))
        return ca.Function("difference", [a, b], [subtract(self.whole, start, end)], {"cse": True})


def densities(process: ModelProcess, error: Layout) -> dict[str, Array]:
    """Checked densities by name of parts of the error state."""
    if not isinstance(process.density, Mapping) or not process.density:
        raise ValueError(
            "density: expected densities by name of a part of the error state, such as "
            f"{{'q_dot': 0.1}}; found {process.density!r}"
        )
    sizes = {part.name: part.size for part in error.parts}
    found = {}
    for name, value in process.density.items():
        choice("density", name, list(sizes))
        array = numbers(f"density[{name!r}]", value).ravel()
        if array.size not in (1, sizes[name]) or not np.all(array >= 0):
            raise ValueError(
                f"density[{name!r}]: expected 1 or {sizes[name]} numbers of at least zero, found "
                f"{array.tolist()}"
            )
        found[name] = np.array(np.broadcast_to(array, (sizes[name],)))
    return found


def return_times(process: ModelProcess) -> dict[str, float]:
    """Checked times of the estimated parameters, s."""
    names = [part.name for part in process.model.p.parts]
    found = {}
    for name, value in instance("estimated", process.estimated, Mapping).items():
        choice("estimated", name, names)
        seconds = np.inf if value is None else float(numbers(f"estimated[{name!r}]", value))
        if not seconds > 0:
            raise ValueError(
                f"estimated[{name!r}]: expected a time above zero, s, or None, found {value}"
            )
        if name not in process.density:
            raise ValueError(f"density: expected one of {name!r}, which is estimated; not found")
        found[name] = seconds
    return found


def checked_process(process: ModelProcess) -> ModelProcess:
    """`process`, of checked kinds."""
    model = instance("process.model", process.model, ControlModel)
    count("substeps", process.substeps)
    choice("method", process.method, get_args(Method))
    if process.method == "implicit_midpoint":
        midpoint_rule(model)
    return process


def model_predict_function(name: str, dynamics: Dynamics) -> ca.Function:
    """(state, factor, dt and, where the model has them, u and p) -> state_after, factor_after."""
    error = dynamics.error
    state = ca.MX.sym("state", dynamics.state.size)
    factor = ca.MX.sym("factor", ca.Sparsity.upper(error.size))
    dt = ca.MX.sym("dt")
    inputs = {"state": state, "factor": factor, "dt": dt, **dynamics.inputs}
    whole, counters = ca.vertsplit(state, [0, dynamics.whole.size, dynamics.state.size])
    given = [inputs[key] for key in dynamics.inputs]
    end, slope = flow_function(dynamics)(whole, dt, *given)

    unit = ca.triu(ca.densify(factor), False) + ca.DM.eye(error.size)
    columns: list[AnyExpr] = [slope @ unit]
    densities = [ca.diag(factor)]
    for part, density in dynamics.density.items():
        where = error.slices[part]
        noisy = [i for i, value in enumerate(density) if value > 0]
        rows = [where.start + i for i in noisy]
        # A variance is the square of a deviation; CasADi would simplify (√dt)² to dt.
        variance = (ca.DM(density[noisy]) * ca.sqrt(dt / 2)) ** 2
        columns += [slope[:, rows], ca.DM.eye(error.size)[:, rows]]
        densities += [variance, variance]
    stacked: Any = ca.horzcat(*columns)
    factor_after = ud.factor_of_columns(stacked, ca.vertcat(*densities))
    return ca.Function(
        name,
        [*inputs.values()],
        [ca.vertcat(end, counters), factor_after],
        [*inputs],
        ["state_after", "factor_after"],
        {"cse": True},
    )


def flow_function(dynamics: Dynamics) -> ca.Function:
    """(state without counters, dt, u, p) -> the state after dt, and F."""
    layout = dynamics.whole
    start, dt = ca.MX.sym("start", layout.size), ca.MX.sym("dt")
    error, given = ca.MX.sym("error", dynamics.error.size), dynamics.inputs
    moved = add(layout, start, error)
    x, u, p = dynamics.arguments(moved, given)
    x, residual = _stepped(dynamics, dt, x, u, p)
    parts = layout.split(moved) | dynamics.model.x.split(x)
    for name, seconds in dynamics.returns.items():
        if seconds < np.inf:
            parts[name] = ca.exp(-dt / seconds) * parts[name]
    end = layout.join(parts)
    slope = ca.densify(in_error_state(layout, end, ca.jacobian(end, error)))
    arguments = [start, dt, *given.values()]
    at_zero = ca.Function("varied", [error, *arguments], [end, slope, residual], {"cse": True})
    end, slope, residual = at_zero(ca.DM.zeros(error.numel()), *arguments)
    if dynamics.method == "implicit_midpoint":  # NaN unless it is small
        end += ca.sqrt((residual <= dynamics.substeps * CONVERGED[dynamics.model.real]) - 1)
    return ca.Function("flow", arguments, [end, slope], {"cse": True})


def _stepped(dynamics: Dynamics, dt: ca.MX, x: ca.MX, u: ca.MX, p: ca.MX) -> tuple[ca.MX, ca.MX]:
    """The model's state after dt, and the residual of implicit steps."""
    model, h, residual = dynamics.model, dt / dynamics.substeps, ca.MX(0)
    if dynamics.method == "rk4":
        for _ in range(dynamics.substeps):
            x = rk4(model, h, x, u, p)
        return x, residual
    rule = midpoint_rule(model, tolerance=CONVERGED[model.real])
    step = midpoint_step_of_any_length(rule)
    for _ in range(dynamics.substeps):
        x, last, _ = step(x, u, p, h)
        residual += last
    return x, residual


def rates_function(dynamics: Dynamics, names: tuple[str, ...]) -> ca.Function:
    """(state without counters, u, p) -> the model's rates of the parts `names`, and their
    derivatives by the error state."""
    start, given = ca.MX.sym("start", dynamics.whole.size), dynamics.inputs
    error = ca.MX.sym("error", dynamics.error.size)
    x, u, p = dynamics.arguments(add(dynamics.whole, start, error), given)
    rates = dynamics.model.x.split(dynamics.model.xdot(x, u, p))
    value = ca.vertcat(*(rates[name] for name in names))
    arguments = [start, *given.values()]
    varied = ca.Function(
        "varied", [error, *arguments], [value, ca.densify(ca.jacobian(value, error))]
    )
    results = varied(ca.DM.zeros(error.numel()), *arguments)
    return ca.Function("rates", arguments, [*results], {"cse": True})


def unknown_accelerations(process: ModelProcess, sizes: Mapping[str, int]) -> dict[str, Array]:
    """Standard deviations of q_ddot about the model's, by name of the part of velocities."""
    value = process.acceleration
    if value is None:
        return {}
    by_name = value if isinstance(value, Mapping) else dict.fromkeys(sizes, value)
    found = {}
    for name, deviation in by_name.items():
        choice("acceleration", name, list(sizes))
        array = numbers(f"acceleration[{name!r}]", deviation).ravel()
        if array.size not in (1, sizes[name]) or not np.all(array > 0):
            raise ValueError(
                f"acceleration[{name!r}]: expected 1 or {sizes[name]} numbers above zero, found "
                f"{array.tolist()}"
            )
        found[name] = np.array(np.broadcast_to(array, (sizes[name],)))
    return found


def columns_of(name: str, layout: Layout, block: AnyExpr) -> AnyExpr:
    """A block of derivatives by one part, set among those by the whole error state."""
    where = layout.slices[name]
    left = ca.DM.zeros(block.shape[0], where.start)
    right = ca.DM.zeros(block.shape[0], layout.size - where.stop)
    return ca.horzcat(left, block, right)
