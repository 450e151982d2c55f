"""Figures of flutter sweeps: growth and frequency over the airspeed, and the root locus."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from curvcasadi.control.flutter import Flutter
from curvcasadi.symbolic.expressions import Array, count, instance

#: Of growth: what is damped more is not drawn.
LOWEST = -0.6


def plot_flutter(flutter: Flutter, number: int = 6) -> Figure:
    """V-g and V-f diagrams: growth 2 Re λ/|λ| and frequency of oscillations over the airspeed.

    Growth above zero is flutter. The speeds of flutter and divergence are marked.

    Parameters
    ----------
    flutter : Flutter
        From `flutter`.
    number : int
        How many oscillations are drawn, from the slowest at the first speed where they are one.

    Returns
    -------
    matplotlib.figure.Figure
        Growth above, frequency below.
    """
    instance("flutter", flutter, Flutter)
    figure = Figure(figsize=(6.4, 5.6), layout="constrained")
    growth, frequency = figure.subplots(2, 1, sharex=True)
    for k, column in enumerate(_oscillations(flutter, number)):
        roots = _oscillating(flutter.roots[:, column])
        line = {"color": f"C{k}", "lw": 1.5}
        growth.plot(flutter.speeds, 2 * roots.real / np.abs(roots), **line)
        frequency.plot(flutter.speeds, roots.imag / (2 * np.pi), **line)
    growth.axhline(0, color="black", lw=0.8)
    growth.set_ylim(bottom=max(LOWEST, growth.get_ylim()[0]))
    if flutter.speed is not None and flutter.frequency is not None:
        label = f"flutter, {flutter.speed:.4g} m/s"
        growth.plot(flutter.speed, 0, "o", color="black", mfc="white", label=label)
        frequency.plot(
            flutter.speed, flutter.frequency / (2 * np.pi), "o", color="black", mfc="white"
        )
    if flutter.divergence_speed is not None:
        for axes in (growth, frequency):
            label = f"divergence, {flutter.divergence_speed:.4g} m/s"
            axes.axvline(flutter.divergence_speed, color="0.4", ls="--", lw=1, label=label)
    _finish(growth, "growth $2\\,\\mathrm{Re}\\,\\lambda/|\\lambda|$ [-]")
    _finish(frequency, "frequency [Hz]")
    frequency.set_ylim(bottom=0)
    frequency.set_xlabel("airspeed [m/s]")
    if growth.get_legend_handles_labels()[0]:
        growth.legend(loc="upper left", fontsize="small", frameon=False)
    return figure


def plot_root_locus(flutter: Flutter, number: int = 6) -> Figure:
    """Roots in the complex plane, from the first to the last airspeed, coloured by it.

    Parameters
    ----------
    flutter : Flutter
        From `flutter`.
    number : int
        How many oscillations are drawn, from the slowest at the first speed where they are one.

    Returns
    -------
    matplotlib.figure.Figure
        With the airspeed as colour.
    """
    instance("flutter", flutter, Flutter)
    figure = Figure(figsize=(6.4, 5.2), layout="constrained")
    axes = figure.subplots()
    points = None
    for column in _oscillations(flutter, number):
        roots = _oscillating(flutter.roots[:, column])
        axes.plot(roots.real, roots.imag, color="0.75", lw=1, zorder=1)
        points = axes.scatter(
            roots.real,
            roots.imag,
            c=flutter.speeds,
            s=14,
            cmap="viridis",
            vmin=flutter.speeds[0],
            vmax=flutter.speeds[-1],
            zorder=2,
        )
    axes.axvline(0, color="black", lw=0.8)
    if flutter.frequency is not None:
        axes.plot(0, flutter.frequency, "o", color="black", mfc="none", ms=9, label="flutter")
        axes.legend(loc="lower left", fontsize="small", frameon=False)
    if points is not None:
        figure.colorbar(points, ax=axes, label="airspeed [m/s]")
    _finish(axes, "imaginary part [rad/s]")
    axes.set_xlabel("real part [1/s]")
    return figure


def _oscillations(flutter: Flutter, number: int) -> list[int]:
    """Columns of roots with a positive imaginary part somewhere, the slowest first."""
    number = count("number", number)
    imaginary = np.abs(_oscillating(flutter.roots).imag) * (flutter.roots.imag > 0)
    moving = np.flatnonzero(np.nansum(imaginary, axis=0) > 0)
    first = [imaginary[imaginary[:, k] > 0, k][0] for k in moving]
    return [int(moving[i]) for i in np.argsort(first)[:number]]


def _oscillating(roots: Array) -> Array:
    """The roots, NaN where they do not oscillate."""
    return np.where(roots.imag > 1e-6 * np.abs(roots), roots, complex(np.nan, np.nan))


def _finish(axes: Axes, label: str) -> None:
    axes.set_ylabel(label)
    axes.grid(color="0.9")
