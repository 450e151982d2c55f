"""Wings in three dimensions: axes of equal scales, ribbons and arrows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from mpl_toolkits.mplot3d import proj3d
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from curvcasadi.beam.beam import Beam, numeric_length
from curvcasadi.beam.mirror import mirror
from curvcasadi.kinematics.history import ShapeHistory, shape_history
from curvcasadi.plotting.figures import AXIS_COLORS, CURVE_STATIONS, UNDEFORMED_COLOR, WING_COLOR
from curvcasadi.symbolic.expressions import Array

#: Sizes as fractions of the length: arrows of the local axes, ribbon, gap between two arrows.
ARROW, RIBBON, GAP = 0.07, 0.06, 0.06


def histories(
    beam: Beam,
    weights: Array,
    times: Array | None,
    both: bool,
    names: Sequence[str] | None = None,
) -> list[ShapeHistory]:
    """Shapes over time of a wing and, with `both`, of its mirror image."""
    numeric_length(beam, "a figure")
    stations = np.union1d(CURVE_STATIONS, beam.stations).tolist()
    wings = [beam, mirror(beam)] if both else [beam]
    return [shape_history(wing, weights, times, stations=stations, names=names) for wing in wings]


def undeformed_histories(beam: Beam, both: bool) -> list[ShapeHistory]:
    """Zero weights, which the weight bounds need not admit."""
    unbounded = replace(beam, weight_bounds=None)
    return histories(unbounded, np.zeros((1, beam.basis.n)), None, both)


def points_down(beam: Beam, z_down: bool | None) -> bool:
    """Whether the parent's z points down on the page: `z_down`, or as the root says."""
    return float(beam.root.rotation[2, 2]) < 0 if z_down is None else z_down


def empty_scene(histories: list[ShapeHistory], z_down: bool) -> tuple[Figure, Any]:
    """Empty axes of equal scale around all positions."""
    points = np.concatenate([h.positions.transpose(0, 2, 1).reshape(-1, 3) for h in histories])
    low, high = points.min(axis=0), points.max(axis=0)
    largest = np.max(high - low)
    middle, half = (low + high) / 2, np.maximum((high - low) / 2 + 0.06 * largest, 0.15 * largest)

    figure = Figure(figsize=(8.0, 4.6))
    axes: Any = figure.add_axes((0.0, 0.02, 1.0, 0.92), projection="3d", proj_type="ortho")
    for k, name in enumerate("xyz"):
        limits = (middle[k] - half[k], middle[k] + half[k])
        # Turning y and z, not z alone: half a turn about x, no mirror image.
        getattr(axes, f"set_{name}lim")(limits[::-1] if z_down and name != "x" else limits)
        ticks = MaxNLocator(nbins=max(2, round(8 * half[k] / half.max())))
        getattr(axes, f"{name}axis").set_major_locator(ticks)
        label = f"{name} [m]{', down' if z_down and name == 'z' else ''}"
        getattr(axes, f"set_{name}label")(label, labelpad=9 * half[k] / half.max())
    across = -160 if z_down else -20
    axes.view_init(elev=30, azim=-65 if half[0] > half[1] else across)
    _fill_figure(figure, axes, half)
    return figure, axes


def _fill_figure(figure: Figure, axes: Any, proportions: Array) -> None:
    """Zoom until the box fills the figure, up to a margin for labels.

    It then reaches beyond the square that matplotlib clips to: what is drawn has `clip_on=False`.
    """
    axes.set_box_aspect(proportions, zoom=1.0)
    figure.draw_without_rendering()
    limits = (axes.get_xlim(), axes.get_ylim(), axes.get_zlim())
    corners = np.array(np.meshgrid(*limits)).reshape(3, -1)
    x, y, _ = proj3d.proj_transform(*corners, axes.get_proj())
    extent = np.ptp(axes.transData.transform(np.column_stack([x, y])), axis=0)
    room = figure.get_size_inches() * figure.dpi * (0.74, 0.7)
    axes.set_box_aspect(proportions, zoom=float(np.min(room / extent)))


def draw_wings(axes: Any, beam: Beam, wings: list[ShapeHistory], sample: int) -> list[Any]:
    """Draw one sample of all half wings; labels only on the first."""
    length = numeric_length(beam, "a figure")
    arrows = np.isin(wings[0].stations, _spaced(beam.stations))
    artists: list[Any] = []
    for wing in wings:
        p, D = wing.positions[sample], wing.deformation_maps[sample]
        label = "_" if artists else ""
        artists.append(_draw_ribbon(axes, p, D[:, 1].T * (RIBBON * length / 2)))
        artists += axes.plot(
            *p, color=WING_COLOR, linewidth=1.5, label=f"{label}deformed", clip_on=False
        )
        for k, color in enumerate(AXIS_COLORS):
            directions = D[arrows, k].T * (ARROW * length)
            artists.append(
                axes.quiver(
                    *p[:, arrows],
                    *directions,
                    color=color,
                    linewidth=1.2,
                    arrow_length_ratio=0.25,
                    clip_on=False,
                    label=f"{label}local {'xyz'[k]}",
                )
            )
    return artists


def _draw_ribbon(axes: Any, positions: Array, half_width: Array) -> Any:
    front, back = (positions + half_width).T, (positions - half_width).T
    quads = np.stack([front[:-1], front[1:], back[1:], back[:-1]], axis=1)
    return axes.add_collection3d(
        Poly3DCollection(quads, facecolor="tab:blue", alpha=0.25, clip_on=False)
    )


def draw_undeformed(axes: Any, wings: list[ShapeHistory]) -> None:
    """Draw the undeformed curves in grey; a label only for the first."""
    for k, wing in enumerate(wings):
        axes.plot(
            *wing.positions[0],
            color=UNDEFORMED_COLOR,
            linestyle="--",
            clip_on=False,
            label="_undeformed" if k else "undeformed",
        )


def draw_legend(axes: Any) -> None:
    """Legend of what `draw_wings` and `draw_undeformed` drew, above the figure."""
    axes.figure.legend(
        *axes.get_legend_handles_labels(), loc="upper center", ncols=5, frameon=False
    )


def _spaced(stations: Array) -> list[float]:
    """Stations from the tip to the root that are not closer than GAP."""
    kept = [1.0]
    for xi in stations[::-1]:
        if kept[-1] - xi >= GAP:
            kept.append(float(xi))
    return kept
