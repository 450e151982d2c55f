"""Actuators: inputs follow their commands late, and not faster than they can."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from curvcasadi.symbolic.expressions import (
    Array,
    Number,
    number,
    numbers,
    numeric,
    own_fields,
    positive,
)


@dataclass(frozen=True, eq=False, kw_only=True)
class Actuators:
    """Inputs u that follow commands with a lag, at a limited rate, between limits.

        du/dt = clip((clip(command, lower, upper) − u)/lag, −rate, rate)

    Attributes
    ----------
    lag : float
        Time constant, s.
    rate : float or array, shape (nu,) or (lanes, nu)
        Largest rates, units of u per second; infinite for none.
    lower, upper : float or array, shape (nu,) or (lanes, nu)
        Limits of the commands, units of u; infinite for none.
    """

    lag: float
    rate: Number = np.inf
    lower: Number = -np.inf
    upper: Number = np.inf
    _limits: tuple[Array, Array, Array] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        own_fields(self)
        positive("Actuators.lag", numeric("Actuators.lag", self.lag))
        rate, lower, upper = (
            _limits(f"Actuators.{name}", getattr(self, name)) for name in ("rate", "lower", "upper")
        )
        if not np.all(rate > 0):
            raise ValueError(f"Actuators.rate: expected rates above zero, found {rate.tolist()}")
        if not np.all(lower <= upper):
            raise ValueError(
                f"Actuators.lower: expected at most upper, {upper.tolist()}, found {lower.tolist()}"
            )
        object.__setattr__(self, "_limits", (rate, lower, upper))

    def follow(self, u: ArrayLike, command: ArrayLike, dt: float) -> Array:
        """The inputs after `dt` with a constant command, by the exact solution.

        While the error e exceeds rate · lag the input moves at its rate, then e decays by
        exp(−t/lag).

        Parameters
        ----------
        u : array, shape (nu,) or (lanes, nu)
            Inputs at the start.
        command : array, shape (nu,) or (lanes, nu)
            Commanded inputs.
        dt : float
            Time, s.

        Returns
        -------
        array, shape as `u` and `command` together
            Inputs after `dt`.

        Raises
        ------
        ValueError
            If an argument is not finite, or `dt` is negative.
        """
        start, goal = numbers("u", u), numbers("command", command)
        try:
            np.broadcast_shapes(start.shape, goal.shape, *map(np.shape, self._limits))
        except ValueError:
            raise ValueError(
                f"u, command: expected shapes that fit those of the limits, "
                f"{', '.join(str(limit.shape) for limit in self._limits)}, "
                f"found {start.shape} and {goal.shape}"
            ) from None
        rate, lower, upper = self._limits
        goal = np.clip(goal, lower, upper)
        if not number("dt", dt) >= 0:
            raise ValueError(f"dt: expected a time of at least zero, s, found {dt}")
        error = goal - start
        excess = np.maximum(np.abs(error) - rate * self.lag, 0)
        at_rate = np.minimum(excess, rate * dt) if dt else 0 * excess
        left = (np.abs(error) - at_rate) * np.exp(-(dt - at_rate / rate) / self.lag)
        return np.asarray(goal - np.sign(error) * left)


def _limits(name: str, value: Number) -> Array:
    """Numbers that may be infinite."""
    try:
        array = np.asarray(numeric(name, value), dtype=float)
    except TypeError:
        raise ValueError(f"{name}: expected numbers, found {value!r}") from None
    numbers(name, np.where(np.isinf(array), 0.0, array))
    return array
