"""Figure of a sensor placement: the wing, the sensors, and how well the shape is known."""

from __future__ import annotations

from collections import defaultdict
from itertools import cycle
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from curvcasadi.beam.beam import Beam, numeric_length
from curvcasadi.estimation.placement.placement import Placement
from curvcasadi.symbolic.expressions import Array

WING_COLOR, ATTITUDE_COLORS = "black", ("tab:red", "tab:green", "tab:blue")
#: Of the kinds of sensors, in turn.
MARKERS, COLORS = "os^DvPX", ("tab:blue", "tab:orange", "tab:green", "tab:purple", "tab:brown")


def plot_placement(beam: Beam, placement: Placement) -> Figure:
    """The wing with the chosen sensors, and the expected standard deviation along the span.

    Above the first shape in the plane of the root's x and z axes, equal scales, with all
    candidates, and the chosen ones by number, one kind a symbol. Below the standard deviations of
    the position (root mean square of the distance, m) and of the attitude (local axes, rad), both
    with and without sensors, on a logarithmic scale.

    Parameters
    ----------
    beam : Beam
        On which the sensors were placed.
    placement : Placement
        The sensors, as `place_sensors` returns them.

    Returns
    -------
    matplotlib.figure.Figure
        The figure; `save_figure` writes it.
    """
    numeric_length(beam, "a figure")
    shape = placement.shape
    root = beam.root
    curve = (root.rotation.T @ (shape.positions - root.position)).full()[[0, 2]]
    figure = Figure(figsize=(6.8, 7.0), layout="constrained")
    above, middle, below = figure.subplots(3, 1, height_ratios=(1.3, 1, 1))
    _draw_wing(above, placement, shape.stations, curve)

    xi = placement.deviations.stations
    after, before = placement.deviations, placement.prior_deviations
    middle.semilogy(xi[1:], after.distance[1:], color=WING_COLOR, label="position")
    middle.semilogy(xi[1:], before.distance[1:], color=WING_COLOR, linestyle=":")
    middle.set_ylabel("position [m]")
    for k, color in enumerate(ATTITUDE_COLORS):
        below.semilogy(xi[1:], after.attitude[k, 1:], color=color, label=f"about local {'xyz'[k]}")
        below.semilogy(xi[1:], before.attitude[k, 1:], color=color, linestyle=":")
    below.set_ylabel("attitude [rad]")
    below.set_xlabel(r"$\xi = s/L$ [-]")
    middle.set_title(
        "expected standard deviation; dotted: without sensors", fontsize="medium", loc="left"
    )
    for axes in (middle, below):
        axes.set_xlim(0, 1)
        axes.set_axisbelow(True)
        axes.grid(color="0.9", which="major")
        for station in sorted({s.xi for s in placement.sensors}):
            axes.axvline(station, color="0.75", linewidth=0.8, zorder=0)
    below.legend(frameon=False, fontsize="small", ncols=3, loc="lower right")
    return figure


def _draw_wing(axes: Any, placement: Placement, stations: Array, curve: Array) -> None:
    axes.plot(*curve, color=WING_COLOR, linewidth=1.5, zorder=2)
    offered = sorted({xi for group in placement.candidate_stations for xi in group})
    at = _at(offered, stations, curve)
    axes.plot(
        *at, "o", color="white", markeredgecolor="0.4", markersize=4, zorder=3, label="candidates"
    )
    by_kind: dict[str, list[float]] = defaultdict(list)
    for sensor in placement.sensors:
        by_kind[sensor.prefix].append(sensor.xi)
    for symbol, color, (kind, where) in zip(cycle(MARKERS), cycle(COLORS), by_kind.items()):
        at = _at(where, stations, curve)
        axes.plot(*at, symbol, color=color, markersize=9, zorder=4, label=kind)
    numbers: dict[float, list[str]] = defaultdict(list)
    for i in placement.indices:
        for xi in dict.fromkeys(placement.candidate_stations[i]):
            numbers[xi].append(str(i))
    for xi, names in numbers.items():
        x, z = _at([xi], stations, curve)[:, 0]
        axes.annotate(
            ", ".join(names), (x, z), (0, 9), textcoords="offset points", ha="center", zorder=5
        )
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_title("sensors by number on the first shape", fontsize="medium", loc="left")
    axes.set_xlabel("along the root's x axis [m]")
    axes.set_ylabel("along its z axis [m]")
    axes.set_axisbelow(True)
    axes.grid(color="0.9")
    axes.legend(frameon=False, fontsize="small")
    axes.margins(0.06, 0.25)


def _at(xi: list[float], stations: Array, curve: Array) -> Array:
    """Points (2, k) of the curve."""
    return np.array([np.interp(xi, stations, row) for row in curve])
