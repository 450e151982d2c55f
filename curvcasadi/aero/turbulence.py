"""Continuous turbulence: its power spectrum, and samples of it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from curvcasadi.symbolic.expressions import (
    AnyExpr,
    Array,
    Number,
    choice,
    is_numeric,
    numbers,
    positive,
)

Component = Literal["vertical", "lateral", "longitudinal"]


@dataclass(frozen=True, eq=False, kw_only=True)
class Turbulence:
    """Continuous turbulence of the military specifications, one component of it.

    With Ω = ω/speed and L the scale, power spectra over ω from 0 to ∞ whose integral is intensity²:

        Dryden, across:      σ² L/(π V) (1 + 3 (L Ω)²)/(1 + (L Ω)²)²
        Dryden, along:       2 σ² L/(π V)/(1 + (L Ω)²)
        von Kármán, across:  σ² L/(π V) (1 + 8/3 (1.339 L Ω)²)/(1 + (1.339 L Ω)²)^(11/6)
        von Kármán, along:   2 σ² L/(π V)/(1 + (1.339 L Ω)²)^(5/6)

    Attributes
    ----------
    intensity : float
        Root mean square σ of the velocity, m/s.
    scale : float
        Scale length L, m.
    speed : float
        Speed at which the turbulence is crossed, m/s.
    model : "dryden" or "von_karman"
        Which spectrum.
    component : "vertical", "lateral" or "longitudinal"
        The component of the velocity; the first two have the spectrum across.
    """

    intensity: float
    scale: float
    speed: float
    model: Literal["dryden", "von_karman"] = "dryden"
    component: Component = "vertical"

    def __post_init__(self) -> None:
        positive("Turbulence.intensity", self.intensity, zero=True)
        positive("Turbulence.scale", self.scale)
        positive("Turbulence.speed", self.speed)
        choice("Turbulence.model", self.model, ("dryden", "von_karman"))
        choice("Turbulence.component", self.component, ("vertical", "lateral", "longitudinal"))

    def spectrum(self, omega: ArrayLike) -> Array:
        """Power spectrum of the velocity.

        Parameters
        ----------
        omega : array
            Frequencies not below zero, rad/s.

        Returns
        -------
        ndarray
            Power spectrum, (m/s)²/(rad/s), of the shape of `omega`.
        """
        frequency = numbers("omega", omega)
        stretch = 1.0 if self.model == "dryden" else 1.339
        x = (stretch * self.scale / self.speed * frequency) ** 2
        level = self.intensity**2 * self.scale / (np.pi * self.speed)
        if self.component == "longitudinal":
            return np.asarray(2 * level / (1 + x) ** (1 if self.model == "dryden" else 5 / 6))
        if self.model == "dryden":
            return np.asarray(level * (1 + 3 * x) / (1 + x) ** 2)
        return np.asarray(level * (1 + 8 / 3 * x) / (1 + x) ** (11 / 6))

    def sample(self, *, duration: float, dt: float, seed: int) -> SampledGust:
        """A history of the velocity whose spectrum is that of the turbulence.

        Harmonics of 2 π/duration with random phases: the history has the period `duration`, and
        its mean square is that of the spectrum between the lowest harmonic and π/dt.

        Parameters
        ----------
        duration, dt : float
            Length of the history and interval of its samples, s.
        seed : int
            Of the random phases.

        Returns
        -------
        SampledGust
            The history, periodic.
        """
        period, step = positive("duration", duration), positive("dt", dt)
        n = round(period / step)
        if n < 2 or abs(n * step - period) > 1e-6 * period:
            raise ValueError(
                f"duration: expected two or more whole intervals dt = {dt}, found {duration}"
            )
        spacing = 2 * np.pi / period
        omega = spacing * np.arange(1, (n - 1) // 2 + 1)
        phases = np.random.default_rng(seed).uniform(0, 2 * np.pi, len(omega))
        amplitudes = np.sqrt(2 * self.spectrum(omega) * spacing)
        line = np.zeros(n // 2 + 1, dtype=complex)
        line[1 : len(omega) + 1] = amplitudes * np.exp(1j * phases) * n / 2
        return SampledGust(times=step * np.arange(n), velocities=np.fft.irfft(line, n))


@dataclass(frozen=True, eq=False, kw_only=True)
class SampledGust:
    """A gust from samples in time, linear between them, periodic beyond them.

    Attributes
    ----------
    times : ndarray, shape (N,)
        Equally spaced from zero, s.
    velocities : ndarray, shape (N,)
        Velocities of the air, m/s; upward where they are positive.
    """

    times: Array
    velocities: Array
    _table: Any = field(init=False, repr=False)

    def __post_init__(self) -> None:
        times, velocities = (
            numbers(f"SampledGust.{name}", getattr(self, name)) for name in ("times", "velocities")
        )
        if times.ndim != 1 or len(times) < 2 or times[0] != 0 or np.any(np.diff(times) <= 0):
            raise ValueError(
                f"SampledGust.times: expected two or more increasing numbers from 0, found {times}"
            )
        if not np.allclose(np.diff(times), times[1], rtol=1e-6):
            raise ValueError(f"SampledGust.times: expected equal intervals, found {times}")
        if velocities.shape != times.shape:
            raise ValueError(
                f"SampledGust.velocities: expected shape {times.shape}, found {velocities.shape}"
            )
        ends = np.append(times, times[-1] + times[1])
        table = ca.interpolant("gust", "linear", [ends], np.append(velocities, velocities[0]))
        for name, value in (("times", times), ("velocities", velocities), ("_table", table)):
            object.__setattr__(self, name, value)

    def __call__(self, time: Number) -> AnyExpr:
        """Velocity of the air at `time`, s, a number or an MX: m/s upward."""
        period = float(self.times[-1] + self.times[1])
        if is_numeric(time):
            return float(self._table(float(time) % period))
        return self._table(ca.fmod(ca.fmod(time, period) + period, period))
