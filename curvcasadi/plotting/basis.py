"""Figures of basis functions."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from matplotlib.figure import Figure

from curvcasadi.beam.basis import CHANNELS, Basis


def plot_basis(basis: Basis) -> Figure:
    """Basis functions over the span: for each curvature that they drive, one axes.

    Between two breaks each function has its own limits, so that jumps show as gaps.

    Parameters
    ----------
    basis : Basis
        Basis of a beam.

    Returns
    -------
    matplotlib.figure.Figure
        The figure; `save_figure` writes it.
    """
    breaks = (0.0, *basis.breaks, 1.0)
    panels = [np.linspace(np.nextafter(a, b), np.nextafter(b, a), 101) for a, b in pairwise(breaks)]
    xi = np.concatenate([[*panel, np.nan] for panel in panels])
    nothing = np.full((3, basis.n), np.nan)
    values = np.array([nothing if np.isnan(x) else basis(x) for x in xi])
    driven = [row for row in range(3) if np.nanmax(np.abs(values[:, row])) > 0]

    height = max(1.9, 0.2 * basis.n / len(driven))  # room for the legends
    figure = Figure(figsize=(6.4, 1.0 + height * len(driven)), layout="constrained")
    all_axes = figure.subplots(len(driven), 1, sharex=True, squeeze=False)[:, 0]
    for axes, row in zip(all_axes, driven, strict=True):
        for k, label in enumerate(basis.labels):
            if np.nanmax(np.abs(values[:, row, k])) > 0:
                axes.plot(xi, values[:, row, k], label=label)
        axes.set_title(f"{CHANNELS[row].replace('_', '-')}, $K_{'xyz'[row]}$", fontsize="medium")
        axes.set_ylabel("value [-]")
        axes.grid(color="0.9")
        axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize="small", frameon=False)
    figure.suptitle(f"{basis.n} basis functions", fontsize="medium")
    all_axes[-1].set_xlabel(r"$\xi = s/L$ [-]")
    all_axes[-1].set_xlim(0, 1)
    return figure
