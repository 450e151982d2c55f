"""Figure of an estimation: tip and weights over time, with bands of three standard deviations."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from curvcasadi.symbolic.expressions import Array

BAND = 3.0  #: half width of the bands, standard deviations


def plot_estimate(
    series: Mapping[str, Array], tip: Mapping[str, str], weights: Mapping[str, Mapping[str, str]]
) -> Figure:
    """Estimates over time with bands of three standard deviations.

    On the left the position of the tip, an axes for each component; on the right the weights, an
    axes for each channel of the basis; below three standard deviations, on a logarithmic scale.

    Parameters
    ----------
    series : mapping of str to array, shape (T,)
        By name: time, s, and each quantity with its standard deviation std_<name>.
    tip : mapping of str to str
        Names in `series`, m, by what the legend calls them.
    weights : mapping of str to mapping of str to str
        The same of weights, rad/m, by what stands at their axes.

    Returns
    -------
    matplotlib.figure.Figure
        The figure; `save_figure` writes it.
    """
    rows = 1 + max(len(tip), len(weights))
    figure = Figure(figsize=(10.0, 0.9 + 1.7 * rows), layout="constrained")
    sides: Any = figure.subfigures(1, 2)
    left, right = sides
    left.suptitle(r"tip position, parent axes; bands: $\pm 3\sigma$", fontsize="medium")
    right.suptitle(r"curvature weights; bands: $\pm 3\sigma$", fontsize="medium")
    tips = {f"{label} [m]": {label: name} for label, name in tip.items()}
    _draw_column(left, series, tips, "m")
    _draw_column(right, series, {f"{name} [rad/m]": w for name, w in weights.items()}, "rad/m")
    return figure


def _draw_column(
    figure: Any, series: Mapping[str, Array], panels: Mapping[str, Mapping[str, str]], unit: str
) -> None:
    """Panels of estimates, and one of all their deviations."""
    names = [name for panel in panels.values() for name in panel.values()]
    colors = {name: f"C{k % 10}" for k, name in enumerate(names)}
    *all_axes, last = figure.subplots(len(panels) + 1, 1, sharex=True)
    for axes, (label, panel) in zip(all_axes, panels.items(), strict=True):
        _draw(axes, series, panel, colors)
        axes.set_ylabel(label)
        if len(panel) > 1:
            _legend(axes)
    for name in names:
        deviation = BAND * series[f"std_{name}"]
        if (deviation > 0).any():
            last.semilogy(series["time"], deviation, color=colors[name], linewidth=1.0)
    alone = [label for panel in panels.values() if len(panel) == 1 for label in panel]
    if alone:
        _legend(last, [axes.lines[0] for axes in all_axes if len(axes.lines) == 1], alone)
    last.set(ylabel=rf"$3\sigma$ [{unit}]", xlabel="time [s]")
    last.grid(color="0.9")


def _legend(axes: Any, *entries: Any) -> None:
    place = {"loc": "center left", "bbox_to_anchor": (1.0, 0.5)}
    axes.legend(*entries, **place, fontsize="small", frameon=False)


def _draw(
    axes: Any, series: Mapping[str, Array], names: Mapping[str, str], colors: Mapping[str, str]
) -> None:
    """Lines and bands; the height is that of the lines, and of bands that are not much wider."""
    time, lows, highs = series["time"], [], []
    for label, name in names.items():
        value, half = series[name], BAND * series[f"std_{name}"]
        color = colors[name]
        axes.plot(time, value, color=color, linewidth=1.2, label=label)
        axes.fill_between(time, value - half, value + half, color=color, alpha=0.25, linewidth=0)
        # A start that is hardly known has a band that would flatten all the rest.
        usual = 2.0 * np.nanmedian(half)
        lows.append(np.nanmin(value - np.minimum(half, usual)))
        highs.append(np.nanmax(value + np.minimum(half, usual)))
    if np.isfinite([*lows, *highs]).all() and max(highs) > min(lows):
        margin = 0.06 * (max(highs) - min(lows))
        axes.set_ylim(min(lows) - margin, max(highs) + margin)
    if time[-1] > time[0]:
        axes.set_xlim(time[0], time[-1])
    axes.grid(color="0.9")
