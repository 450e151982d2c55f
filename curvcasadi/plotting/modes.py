"""Figures of vibration modes."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from curvcasadi.dynamics import VibrationModes
from curvcasadi.symbolic.expressions import count, instance

#: What is drawn: the row of `VibrationModes.motions`, its title and its unit.
_PARTS = ((5, "out of plane", "m"), (4, "in plane", "m"), (0, "twist", "rad"))


def plot_modes(modes: VibrationModes, number: int = 5) -> Figure:
    """The lowest modes over the span: displacements and twist of the sections, in local axes.

    Each mode is scaled so that its largest displacement, m, or rotation, rad, is 1. Of modes that
    gyrate the real part is drawn.

    Parameters
    ----------
    modes : VibrationModes
        From `vibration_modes`.
    number : int
        How many modes are drawn, from the lowest.

    Returns
    -------
    matplotlib.figure.Figure
        One axes each for out-of-plane and in-plane displacement and for the twist.
    """
    instance("modes", modes, VibrationModes)
    shown = min(count("number", number), len(modes.frequencies))
    figure = Figure(figsize=(6.4, 6.0), layout="constrained")
    all_axes = figure.subplots(len(_PARTS), 1, sharex=True)
    for k in range(shown):
        motion = np.real(modes.motions[k])
        motion = motion / np.max(np.abs(motion))
        label = f"{modes.frequencies[k]:.4g} rad/s"
        for axes, (row, _, _) in zip(all_axes, _PARTS, strict=True):
            axes.plot(modes.stations, motion[row], label=label)
    for axes, (_, title, unit) in zip(all_axes, _PARTS, strict=True):
        axes.set_title(title, fontsize="medium")
        axes.set_ylabel(f"scaled [{unit}]")
        axes.grid(color="0.9")
    all_axes[0].legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), fontsize="small", frameon=False)
    all_axes[-1].set_xlabel(r"$\xi = s/L$ [-]")
    all_axes[-1].set_xlim(0, 1)
    return figure
