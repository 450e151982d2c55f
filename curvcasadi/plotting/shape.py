"""Figures of deformed wings and aircraft."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from curvcasadi.aero.strip import StripAerodynamics
from curvcasadi.aircraft.parts import Aircraft, Wing
from curvcasadi.beam.beam import Beam, numeric_length
from curvcasadi.control.simulation import Simulation
from curvcasadi.ocp.targets import Target
from curvcasadi.plotting.arrows import LONGEST, load_arrows, with_mirror_images
from curvcasadi.plotting.content import HalfWing, half_wings, points_of, simulated
from curvcasadi.plotting.scene import (
    draw_legend_and_title,
    draw_loads,
    draw_rigid_parts,
    draw_targets,
    draw_undeformed,
    draw_wings,
    empty_scene,
    points_down,
)
from curvcasadi.symbolic.expressions import AnyExpr, Array


def plot_shape(
    wing: Beam | Wing | Aircraft,
    q: AnyExpr | Mapping[str, AnyExpr] | Simulation,
    *,
    both: bool = True,
    undeformed: bool = True,
    strips: StripAerodynamics | None = None,
    loads: Sequence[Any] = (),
    targets: Sequence[Target] = (),
    local_axes: bool = True,
    title: str | None = None,
    z_down: bool | None = None,
    exaggeration: float = 1.0,
    camera: tuple[float, float] | None = None,
) -> Figure:
    """The deformed wing or aircraft in three dimensions, beside the undeformed one.

    Parent axes, m. Where strips are known, surfaces have the chord of the wing; else a ribbon of
    constant width in the local x-y plane shows the twist. Arrows of local axes closer than a few
    percent of the length are left out.

    Parameters
    ----------
    wing : Beam, Wing or Aircraft
        What is drawn. Of an aircraft all half wings, rigid surfaces and centres of mass.
    q : array, shape (n,), mapping of str to array, or Simulation
        Weights, rad/m; of an aircraft by the name of each wing; of a simulation those at its end.
    both : bool
        Draw `mirror(beam)` with the same weights, too; an aircraft has its own half wings.
    undeformed : bool
        Draw the shape of zero weights in grey.
    strips : StripAerodynamics, optional
        Chord and aerodynamic centre of a beam; a `Wing` and an `Aircraft` have their own.
    loads : sequence of loads
        Loads on the beam, and their mirror images on its mirror image: each kind to its own scale,
        its largest value in the legend. Inertial axes are taken to be the parent's.
    targets : sequence of Target
        Where stations of the beam shall be.
    local_axes : bool
        Draw the local axes at stations of the grid.
    title : str, optional
        Title; the tip position unless given.
    z_down : bool, optional
        Turn the page so that the parent's z points down; unless given, where the local z axis of
        the root does: a right wing has its local z up (for a left wing alone, say it).
    exaggeration : float
        Scale of z over that of x and y; ticks show true values.
    camera : tuple of float, optional
        Elevation and azimuth of the view, degrees, as in `Axes3D.view_init`.

    Returns
    -------
    matplotlib.figure.Figure
        The figure; `save_figure` writes it.

    Raises
    ------
    ValueError
        If `shape_map` refuses `q`, or a load or a chord cannot be drawn.
    """
    wing, _, weights = simulated(wing, None, q)
    if isinstance(q, Simulation):
        flown = isinstance(weights, Mapping)
        weights = {key: w[-1] for key, w in weights.items()} if flown else weights[-1]
    aircraft = wing if isinstance(wing, Aircraft) else None
    if aircraft is not None and (loads or targets or strips is not None):
        raise ValueError("loads, targets, strips: expected with a Beam or Wing, found an Aircraft")
    wings = half_wings(wing, weights, None, both=both, strips=strips, names=["q"])
    first = wings[0]
    length = numeric_length(first.beam, "a figure")
    arrows = load_arrows(first.beam, first.history.weights[0], loads)
    arrows = with_mirror_images(arrows) if len(wings) > 1 else arrows
    points = [points_of(wings, aircraft, undeformed)]
    points += [(kind.points + kind.lengths(LONGEST * length)).T for kind in arrows]
    points += [t.position.full().T for t in targets if t.position is not None]
    down = points_down(wings, z_down)
    figure, axes = empty_scene(np.concatenate(points), down, exaggeration, camera)
    if undeformed:
        draw_undeformed(axes, wings)
    draw_wings(axes, wings, 0, local_axes)
    if aircraft is not None:
        draw_rigid_parts(axes, aircraft)
    draw_loads(axes, arrows, length)
    draw_targets(axes, first.beam, first.history.weights[0], targets)
    draw_legend_and_title(axes, _title(wings) if title is None else title)
    return figure


def _title(wings: Sequence[HalfWing]) -> str:
    tip: Array = wings[0].history.positions[0, :, -1]
    x, y, z = (f"{round(value, 2) + 0.0:.2f}" for value in tip)
    return f"deformed shape, tip at ({x}, {y}, {z}) m"
