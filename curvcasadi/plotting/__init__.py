"""Figures and animations.

Figures are plain `matplotlib.figure.Figure`s: `figure.savefig(path)` writes them without a display.
"""

from curvcasadi.plotting.animation import animate_shape
from curvcasadi.plotting.basis import plot_basis
from curvcasadi.plotting.estimate import plot_estimate
from curvcasadi.plotting.figures import save_figure
from curvcasadi.plotting.flight import plot_flight
from curvcasadi.plotting.flight_animation import animate_flight
from curvcasadi.plotting.flutter import plot_flutter, plot_root_locus
from curvcasadi.plotting.modes import plot_modes
from curvcasadi.plotting.motion import plot_motion
from curvcasadi.plotting.placement import plot_placement
from curvcasadi.plotting.shape import plot_shape
from curvcasadi.plotting.trim import plot_trim

__all__ = [
    "animate_flight",
    "animate_shape",
    "plot_basis",
    "plot_estimate",
    "plot_flight",
    "plot_flutter",
    "plot_modes",
    "plot_motion",
    "plot_placement",
    "plot_root_locus",
    "plot_shape",
    "plot_trim",
    "save_figure",
]
