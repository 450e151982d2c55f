"""Figures of deformed wings."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from curvcasadi.beam.beam import Beam
from curvcasadi.plotting.scene import (
    draw_legend,
    draw_undeformed,
    draw_wings,
    empty_scene,
    histories,
    points_down,
    undeformed_histories,
)
from curvcasadi.symbolic.expressions import AnyExpr


def plot_shape(
    beam: Beam,
    q: AnyExpr,
    *,
    both: bool = True,
    undeformed: bool = True,
    z_down: bool | None = None,
) -> Figure:
    """The deformed wing in three dimensions, with the local axes at stations of the grid.

    Parent axes, m, equal scales. The ribbon lies in the local x-y plane and shows the twist; its
    width is no chord. Arrows closer than a few percent of the length are left out.

    Parameters
    ----------
    q : (n,) numbers, rad/m
    both : draws `mirror(beam)` with the same weights, too
    undeformed : draws the shape of zero weights in grey
    z_down : turns the page so that the parent's z points down; default, where the local z axis of
        the root does: a right wing has its local z up (for a left wing given by itself, say it)

    Raises
    ------
    ValueError
        If `shape_map` refuses `q`.
    """
    weights = np.asarray(q, dtype=float).reshape(1, -1)
    wings = histories(beam, weights, None, both, names=["q"])
    straight = undeformed_histories(beam, both) if undeformed else []
    figure, axes = empty_scene([*wings, *straight], points_down(beam, z_down))
    draw_undeformed(axes, straight)
    draw_wings(axes, beam, wings, 0)
    draw_legend(axes)
    return figure
