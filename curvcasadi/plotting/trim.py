"""Figures of trimmed aircraft."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from curvcasadi.aircraft.parts import Aircraft, Wing
from curvcasadi.aircraft.trim_result import TrimResult
from curvcasadi.kinematics.shape import poses
from curvcasadi.plotting.figures import CURVE_STATIONS, UNDEFORMED_COLOR
from curvcasadi.symbolic.expressions import Array

#: Colours of the first speed of a sweep and of the last, red, green and blue.
SLOWEST, FASTEST = (0.10, 0.25, 0.65), (0.90, 0.45, 0.05)
LARGEST_LEGEND = 7


def plot_trim(aircraft: Aircraft, results: Sequence[TrimResult]) -> Figure:
    """Trimmed wings from behind, and the lift along their span; one or more speeds.

    Parameters
    ----------
    aircraft : Aircraft
        The aircraft.
    results : sequence of TrimResult
        One for each speed, as those of `trim_sweep`.

    Returns
    -------
    matplotlib.figure.Figure
        The figure; `save_figure` writes it.
    """
    figure = Figure(figsize=(7.5, 6.4), layout="constrained")
    front, lift = figure.subplots(2, 1, sharex=True)
    shown = set(np.linspace(0, len(results) - 1, LARGEST_LEGEND).round().astype(int).tolist())
    for wing in aircraft.beams:
        y, height = _front(wing, np.zeros(wing.beam.basis.n), CURVE_STATIONS)
        first = wing is aircraft.beams[0]
        label = "undeformed" if first else None
        front.plot(y, height, "--", color=UNDEFORMED_COLOR, label=label)
        for k, result in enumerate(results):
            color = _mixed(k / max(len(results) - 1, 1))
            label = _label(result) if first and k in shown else None
            y, height = _front(wing, result.q[wing.name], CURVE_STATIONS)
            front.plot(y, height, color=color, label=label)
            airload = result.airloads[wing.name]
            y, _ = _front(wing, result.q[wing.name], airload.xi)
            lift.plot(y, np.asarray(airload.lift).ravel(), color=color)
    front.set(ylabel="height $-z$ [m]", title="from behind, body axes")
    front.set_aspect("equal", adjustable="datalim")
    lift.set(xlabel="$y$, to the right [m]", ylabel="lift per length [N/m]")
    lift.set_title("lift in the section plane, normal to the local velocity")
    lift.axhline(0, color="0.6", linewidth=0.8)
    for axes in (front, lift):
        axes.grid(color="0.9")
        axes.title.set_fontsize("medium")
    figure.legend(
        loc="outside lower center",
        ncols=4 if any(result.roll for result in results) else LARGEST_LEGEND + 1,
        fontsize="small",
        handlelength=1.7,
        columnspacing=1.2,
        frameon=False,
    )
    return figure


def _label(result: TrimResult) -> str:
    """Speed, and the bank angle where there is one."""
    bank = np.degrees(result.roll)
    return f"{result.speed:.4g} m/s" + (f", bank {bank:.3g}°" if abs(bank) > 5e-3 else "")


def _front(wing: Wing, q: Any, stations: Array) -> tuple[Array, Array]:
    """y and −z of the deformed reference curve, m, body axes."""
    different = np.unique(stations)
    found = poses(wing.beam, np.asarray(q), different.tolist())
    at = np.searchsorted(different, stations)
    positions = np.hstack([np.asarray(pose.position) for pose in found])[:, at]
    return positions[1], -positions[2]


def _mixed(part: float) -> tuple[float, ...]:
    return tuple((1 - part) * a + part * b for a, b in zip(SLOWEST, FASTEST, strict=True))
