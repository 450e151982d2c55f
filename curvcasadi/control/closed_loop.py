"""A loop of sensors, filter, controller and actuators around wings that are not their model."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike

from curvcasadi.control.actuators import Actuators
from curvcasadi.errors import ConvergenceError
from curvcasadi.symbolic.expressions import Array, count, instance, numbers, positive

#: (time, estimate (lanes, nz) or state (lanes, nx), applied inputs (lanes, nu)) -> commands.
Control = Callable[[float, Array, Array], ArrayLike]
#: Time -> parameters of the plant, (np,) or (lanes, np).
Parameters = Callable[[float], Array]


class Observer(Protocol):
    """What makes estimates of samples, such as `DelayedFilter`."""

    def take(self, samples: Array | None, u: Array) -> None:
        """Go on by an interval, with the samples that arrive and the inputs applied at present."""

    def present(self) -> Array:
        """Estimates of the present, (lanes, nz)."""


class ClosedLoop(NamedTuple):
    """What `closed_loop` flew, at the times of the samples.

    Attributes
    ----------
    t : array, shape (T,)
        Times of the samples, s.
    x : array, shape (T, lanes, nx)
        States of the plant.
    u : array, shape (T, lanes, nu)
        Inputs that the actuators apply.
    p : array, shape (T, lanes, np)
        Parameters of the plant.
    estimates : array, shape (T, lanes, nz)
        What the controller was given: estimates, or states without an observer.
    """

    t: Array
    x: Array
    u: Array
    p: Array
    estimates: Array


def closed_loop(
    step: Callable[..., ArrayLike],
    x: ArrayLike,
    control: Control,
    times: ArrayLike,
    *,
    substeps: int,
    actuators: Actuators,
    p: Parameters,
    u: ArrayLike,
    every: int = 1,
    read: Callable[..., ArrayLike] | None = None,
    link: Callable[[Array], Array | None] | None = None,
    observer: Observer | None = None,
) -> ClosedLoop:
    """Fly wings, of which each is a lane, in closed loop.

    At each time the sensors are read, what arrives goes to the observer, every `every` samples the
    controller is asked, and until the next time the plant goes on in `substeps` steps, in each of
    which inputs and parameters are those of its middle.

    Parameters
    ----------
    step : callable
        (x (lanes, nx), u (lanes, nu), p (lanes, np)) -> the states after one of the `substeps`,
        such as `compile_batch(rk4_step(plant, dt / substeps))`.
    x : array, shape (lanes, nx)
        States at the start.
    control : callable
        (time, estimates, applied inputs) -> commands (lanes, nu).
    times : array, shape (T,)
        Times of the samples, s, evenly spaced.
    substeps : int
        Steps of the plant in an interval of the samples.
    actuators : Actuators
        How the inputs follow the commands.
    p : callable
        Time -> parameters of the plant, (lanes, np); a gust is in them.
    u : array, shape (lanes, nu)
        Inputs, and commands, at the start.
    every : int
        Intervals of the samples from one command to the next.
    read : callable, optional
        (x, u, p) -> true readings of the sensors (lanes, m); needed by an observer.
    link : callable, optional
        True readings -> what arrives, such as a `SensorLink`; the readings unless given.
    observer : Observer, optional
        Such as a `DelayedFilter`; the controller is given the state unless there is one.

    Returns
    -------
    ClosedLoop
        The motion.

    Raises
    ------
    ConvergenceError
        If a state or command is not finite: at which time, of which lanes. `.result` is the
        motion so far.
    ValueError
        If an argument is not of that kind.
    """
    state, applied = (np.array(numbers(*pair), ndmin=2) for pair in (("x", x), ("u", u)))
    times = numbers("times", times).ravel()
    if len(times) < 2 or not np.allclose(np.diff(times), times[1] - times[0]):
        raise ValueError(f"times: expected at least two, evenly spaced, s, found {times}")
    dt = positive("times[1] - times[0]", times[1] - times[0]) / count("substeps", substeps)
    instance("actuators", actuators, Actuators)
    functions = {"step": step, "control": control, "p": p, "read": read, "link": link}
    for name, function in functions.items():
        if not callable(function) and (name not in ("read", "link") or function is not None):
            raise ValueError(f"{name}: expected a function, found {function!r}")
    count("every", every)
    if observer is not None and read is None:
        raise ValueError("read: expected a function of x, u and p for the observer, found None")
    shape = (len(state), applied.shape[-1])
    if len(applied) not in (1, len(state)):
        raise ValueError(f"u: expected shape (nu,) or ({len(state)}, nu), found {applied.shape}")
    applied = np.array(np.broadcast_to(applied, shape))
    command, estimates = applied, state
    log: list[tuple[Any, ...]] = []

    def parameters(time: float) -> Array:
        values = np.array(numbers("p", p(time)), ndmin=2)
        if values.ndim > 2 or len(values) not in (1, len(state)):
            raise ValueError(f"p: expected shape (np,) or ({len(state)}, np), found {values.shape}")
        return np.array(np.broadcast_to(values, (len(state), values.shape[-1])))

    def so_far() -> ClosedLoop:
        return ClosedLoop(*(np.array(rows) for rows in zip(*log, strict=True)))

    for k, time in enumerate(times):
        present = parameters(time)
        if observer is not None and read is not None:
            readings = np.asarray(read(state, applied, present))
            observer.take(readings if link is None else link(readings), applied)
        if k % every == 0:
            estimates = state if observer is None else observer.present()
            command = np.asarray(control(float(time), estimates, applied), dtype=float)
            if command.shape != shape:
                raise ValueError(f"control: expected commands {shape}, found {command.shape}")
        log.append((time, state, applied, present, estimates))
        _finite("command", command, time, so_far)
        if k == len(times) - 1:
            break
        for j in range(substeps):
            middle = actuators.follow(applied, command, dt / 2)
            after = np.asarray(step(state, middle, parameters(time + (j + 0.5) * dt)))
            if after.shape != state.shape:
                raise ValueError(f"step: expected states {state.shape}, found {after.shape}")
            state = after
            applied = actuators.follow(middle, command, dt / 2)
        _finite("state", state, time, so_far)
    return so_far()


def _finite(what: str, values: Array, time: float, so_far: Callable[[], ClosedLoop]) -> None:
    lanes = np.flatnonzero(~np.all(np.isfinite(values), axis=1))
    if lanes.size:
        raise ConvergenceError(
            f"closed_loop: the {what} is not finite after {time:g} s, in lanes {lanes.tolist()}",
            so_far(),
        )
