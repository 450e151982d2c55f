"""Figures and animations."""

from curvcasadi.plotting.placement import plot_placement
from curvcasadi.plotting.shape import animate_shape, plot_basis, plot_shape, save_figure

__all__ = ["animate_shape", "plot_basis", "plot_placement", "plot_shape", "save_figure"]
