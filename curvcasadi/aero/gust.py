"""Gusts: how the air moves, and how strips meet it.

A gust is a velocity of the air beside the steady wind of `Flow`. It reaches the leading edge of a
strip first: Küssner's function ψ(s) = 1 − ½ exp(−0.13 s) − ½ exp(−s) of the half chords travelled
says how much of it the lift has followed. Entry states do the same,

    dg_i/dt = κ_i W/b (u_g − g_i),      u_e gains Σ B_i g_i

with u_g, what the gust adds to the velocity u of the strip. One entry lag of rate W/b in front of
the lag states of the circulation is nearly as good, for one state less.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from curvcasadi.aero.lag_states import Poles
from curvcasadi.symbolic.expressions import (
    AnyExpr,
    Array,
    Number,
    choice,
    count,
    expression,
    numbers,
    positive,
)

#: Küssner's function by two poles (R. T. Jones).
KUSSNER = Poles(np.array([0.5, 0.5]), np.array([0.13, 1.0]))
#: Rate of the single entry lag in front of the lag states of the circulation.
ENTRY_RATE = 1.0


@dataclass(frozen=True, eq=False, kw_only=True)
class OneMinusCosine:
    """The discrete gust of the airworthiness codes, w = ½ amplitude (1 − cos(2 π t/duration)).

    Attributes
    ----------
    amplitude : number or symbol
        Largest velocity of the air, m/s; upward where it is positive.
    duration : number or symbol
        From the beginning to the end of the gust, s.
    start : number or symbol
        When it begins, s.
    """

    amplitude: Number
    duration: Number
    start: Number = 0.0

    def __post_init__(self) -> None:
        expression("OneMinusCosine.amplitude", self.amplitude, (1, 1))
        positive("OneMinusCosine.duration", self.duration)
        expression("OneMinusCosine.start", self.start, (1, 1))

    def __call__(self, time: Number) -> AnyExpr:
        """Velocity of the air at `time`, s: m/s upward, a scalar of the kind of `time`."""
        phase = (time - self.start) / self.duration
        inside = ca.logic_and(phase >= 0, phase <= 1)
        return ca.if_else(inside, self.amplitude / 2 * (1 - ca.cos(2 * np.pi * phase)), 0)


@dataclass(frozen=True, eq=False, kw_only=True)
class StepGust:
    """A gust that is there from a moment on.

    Attributes
    ----------
    amplitude : number or symbol
        Velocity of the air, m/s; upward where it is positive.
    start : number or symbol
        When it begins, s.
    """

    amplitude: Number
    start: Number = 0.0

    def __post_init__(self) -> None:
        expression("StepGust.amplitude", self.amplitude, (1, 1))
        expression("StepGust.start", self.start, (1, 1))

    def __call__(self, time: Number) -> AnyExpr:
        """Velocity of the air at `time`, s: m/s upward, a scalar of the kind of `time`."""
        return ca.if_else(time >= self.start, self.amplitude, 0)


@dataclass(frozen=True, eq=False)
class GustField:
    """Velocity of the air as a function of position and time.

    Attributes
    ----------
    function : callable
        `function(position, time)` with the position (3, 1), m, inertial axes (north, east, down),
        and the time, s, both SX, MX or DM; it returns the velocity (3, 1), m/s, inertial axes.
    """

    function: Callable[[AnyExpr, AnyExpr], AnyExpr]

    def __post_init__(self) -> None:
        if not callable(self.function):
            raise ValueError(
                "GustField.function: expected a function of position and time, "
                f"found {self.function!r}"
            )

    def __call__(self, position: AnyExpr, time: Number) -> AnyExpr:
        """Velocity of the air, (3, 1), m/s, inertial axes."""
        return expression("GustField", self.function(position, time), (3, 1))


def frozen_gust(profile: Callable[[AnyExpr], AnyExpr], speed: float) -> GustField:
    """A gust that stands still in the air: who flies north at `speed` meets `profile` in time.

    Parameters
    ----------
    profile : callable
        Velocity upward, m/s, as a function of time, s, such as a `OneMinusCosine`.
    speed : float
        Speed that turns distance north into time, m/s.

    Returns
    -------
    GustField
        Velocity of the air as a function of position and time.
    """
    speed = float(positive("speed", speed))

    def velocity(position: AnyExpr, time: Number) -> AnyExpr:
        return ca.vertcat(0, 0, -profile(position[0] / speed))

    return GustField(velocity)


@dataclass(frozen=True, eq=False, kw_only=True)
class GustEntry:
    """How the lift of a strip follows a gust that enters it at the leading edge.

    Attributes
    ----------
    kind : "kussner" or "lag"
        Küssner's two states, or one lag in front of the lag states of the circulation.
    modes : int or None
        Number of Legendre functions along the span that carry the states; None for a set per
        aerodynamic station.
    """

    kind: Literal["kussner", "lag"] = "kussner"
    modes: int | None = 3

    def __post_init__(self) -> None:
        choice("GustEntry.kind", self.kind, ("kussner", "lag"))
        if self.modes is not None:
            count("GustEntry.modes", self.modes)

    @property
    def poles(self) -> Poles:
        """Amplitudes and rates of the entry states."""
        return KUSSNER if self.kind == "kussner" else Poles(np.ones(1), np.array([ENTRY_RATE]))


def kussner(s: ArrayLike) -> Array:
    """Küssner's function ψ(s), the lift after a gust's edge over its final value.

    Parameters
    ----------
    s : array
        Distance travelled since the leading edge met the gust, half chords.

    Returns
    -------
    ndarray
        ψ(s), of the shape of `s`.
    """
    decay = np.exp(-np.multiply.outer(numbers("s", s), KUSSNER.rates))
    return np.asarray(1 - decay @ KUSSNER.amplitudes)
