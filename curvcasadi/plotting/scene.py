"""Wings in three dimensions: axes of equal scales, surfaces and arrows."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from mpl_toolkits.mplot3d import proj3d
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from curvcasadi.aircraft.parts import Aircraft
from curvcasadi.beam.beam import Beam, numeric_length
from curvcasadi.kinematics.shape import pose_at
from curvcasadi.plotting.arrows import LONGEST, Arrows
from curvcasadi.plotting.content import HalfWing, corners
from curvcasadi.plotting.figures import AXIS_COLORS, UNDEFORMED_COLOR, WING_COLOR
from curvcasadi.symbolic.expressions import Array, positive

#: Sizes as fractions of the length: arrows of the local axes, gap between two arrows.
ARROW, GAP = 0.07, 0.06
LOAD_COLORS = ("tab:purple", "tab:orange", "tab:brown", "tab:pink", "tab:olive", "tab:cyan")
TARGET_COLOR, BODY_COLOR, TAIL_COLOR = "tab:red", "0.25", "tab:gray"


def points_down(wings: Sequence[HalfWing], z_down: bool | None) -> bool:
    """Whether the parent's z points down on the page: `z_down`, or as the first root says."""
    return float(wings[0].beam.root.rotation[2, 2]) < 0 if z_down is None else z_down


def empty_scene(
    points: Array,
    z_down: bool,
    exaggeration: float = 1.0,
    camera: tuple[float, float] | None = None,
) -> tuple[Figure, Any]:
    """Empty axes around points (k, 3), m, of equal scale up to the vertical `exaggeration`."""
    vertical = float(positive("exaggeration", exaggeration))
    low, high = points.min(axis=0), points.max(axis=0)
    seen = np.array([1.0, 1.0, vertical])  # scales on the page
    largest = np.max((high - low) * seen)
    room = 0.06 * largest / seen
    middle = (low + high) / 2
    half = np.maximum((high - low) / 2 + room, 0.15 * largest / seen)

    figure = Figure(figsize=(8.0, 5.0))
    axes: Any = figure.add_axes((0.0, 0.02, 1.0, 0.86), projection="3d", proj_type="ortho")
    shown = half * seen
    for k, name in enumerate("xyz"):
        limits = (middle[k] - half[k], middle[k] + half[k])
        # Turning y and z, not z alone: half a turn about x, no mirror image.
        getattr(axes, f"set_{name}lim")(limits[::-1] if z_down and name != "x" else limits)
        ticks = MaxNLocator(nbins=max(2, round(8 * shown[k] / shown.max())))
        getattr(axes, f"{name}axis").set_major_locator(ticks)
        label = f"{name} [m]"
        if name == "z":
            label += ", down" if z_down else ""
            label += f", scale × {vertical:g}" if vertical != 1 else ""
        getattr(axes, f"set_{name}label")(label, labelpad=9 * shown[k] / shown.max())
    across = -160 if z_down else -20
    elevation, azimuth = (30, -65 if half[0] > half[1] else across) if camera is None else camera
    axes.view_init(elev=elevation, azim=azimuth)
    _fill_figure(figure, axes, shown)
    return figure, axes


def _fill_figure(figure: Figure, axes: Any, proportions: Array) -> None:
    """Zoom until the box fills the figure, up to a margin for labels.

    It then reaches beyond the square that matplotlib clips to: what is drawn has `clip_on=False`.
    """
    axes.set_box_aspect(proportions, zoom=1.0)
    figure.draw_without_rendering()
    limits = (axes.get_xlim(), axes.get_ylim(), axes.get_zlim())
    box = np.array(np.meshgrid(*limits)).reshape(3, -1)
    x, y, _ = proj3d.proj_transform(*box, axes.get_proj())
    extent = np.ptp(axes.transData.transform(np.column_stack([x, y])), axis=0)
    room = figure.get_size_inches() * figure.dpi * (0.74, 0.68)
    axes.set_box_aspect(proportions, zoom=float(np.min(room / extent)))


def draw_wings(
    axes: Any, wings: Sequence[HalfWing], sample: int, local_axes: bool = True
) -> list[Any]:
    """Draw one sample of all half wings; labels only on the first."""
    artists: list[Any] = []
    for wing in wings:
        label = "_" if artists else ""
        artists += _draw_wing(axes, wing, sample, label, local_axes)
    return artists


def _draw_wing(axes: Any, wing: HalfWing, sample: int, label: str, local_axes: bool) -> list[Any]:
    length = numeric_length(wing.beam, "a figure")
    stations = wing.history.stations
    p, D = wing.history.positions[sample], wing.history.deformation_maps[sample]
    leading, trailing = wing.outline(wing.history, sample)
    artists: list[Any] = [_draw_surface(axes, leading, trailing)]
    artists += axes.plot(
        *p, color=WING_COLOR, linewidth=1.5, label=f"{label}deformed", clip_on=False
    )
    if wing.beam.bodies:
        at = np.searchsorted(stations, [body.xi for body in wing.beam.bodies])
        offsets = np.hstack([ca.DM(body.offset).full() for body in wing.beam.bodies])
        centers = p[:, at] + np.einsum("kij,ik->jk", D[at], offsets)
        artists += _draw_masses(axes, centers, f"{label}bodies")
    arrows = np.isin(stations, _spaced(wing.beam.stations))
    for k, color in enumerate(AXIS_COLORS if local_axes else ()):
        ends = (p[:, arrows], D[arrows, k].T * (ARROW * length))
        artists.append(_quiver(axes, *ends, color, f"{label}local {'xyz'[k]}"))
    return artists


def _quiver(axes: Any, start: Array, along: Array, color: str, label: str) -> Any:
    return axes.quiver(
        *start,
        *along,
        color=color,
        linewidth=1.2,
        arrow_length_ratio=0.25,
        clip_on=False,
        label=label,
    )


def _draw_surface(axes: Any, front: Array, back: Array, color: str = "tab:blue") -> Any:
    front, back = front.T, back.T
    quads = np.stack([front[:-1], front[1:], back[1:], back[:-1]], axis=1)
    return axes.add_collection3d(Poly3DCollection(quads, facecolor=color, alpha=0.3, clip_on=False))


def _draw_masses(axes: Any, centers: Array, label: str) -> list[Any]:
    drawn: list[Any] = axes.plot(
        *centers, "o", color=BODY_COLOR, markersize=6, label=label, clip_on=False
    )
    return drawn


def draw_undeformed(axes: Any, wings: Sequence[HalfWing]) -> None:
    """Draw the undeformed curves in grey, and outlines where chords are known; one label."""
    style: dict[str, Any] = {"color": UNDEFORMED_COLOR, "clip_on": False}
    for k, wing in enumerate(wings):
        curve = wing.undeformed.positions[0]
        label = "_undeformed" if k else "undeformed"
        axes.plot(*curve, linestyle="--", label=label, **style)
        if wing.has_chord:
            leading, trailing = wing.outline(wing.undeformed, 0)
            outline = np.hstack([leading, trailing[:, ::-1], leading[:, :1]])
            axes.plot(*outline, linewidth=0.8, label="_outline", **style)


def draw_rigid_parts(axes: Any, aircraft: Aircraft) -> None:
    """Draw tails and the body's centre of mass; grey lines join what is fixed to the body."""
    center = aircraft.body.center_of_mass.full()
    joined = [wing.beam.root.position.full() for wing in aircraft.beams]
    joined += [surface.pose.position.full() for surface in aircraft.surfaces]
    for point in joined:
        line = np.hstack([center, point])
        axes.plot(*line, color=UNDEFORMED_COLOR, linewidth=2.5, label="_joined", clip_on=False)
    for k, surface in enumerate(aircraft.surfaces):
        front, back = corners(surface)[:, :2], corners(surface)[:, [3, 2]]
        drawn = _draw_surface(axes, front, back, TAIL_COLOR)
        drawn.set_label("_surface" if k else "rigid surfaces")
    if float(aircraft.body.mass):
        _draw_masses(axes, center, "centre of mass of the body")


def draw_loads(axes: Any, arrows: Sequence[Arrows], length: float) -> None:
    """Draw loads as arrows, each kind in its colour and to its own scale."""
    for k, kind in enumerate(arrows):
        along = kind.lengths(LONGEST * length)
        _quiver(axes, kind.points, along, LOAD_COLORS[k % len(LOAD_COLORS)], kind.label)


def draw_targets(axes: Any, beam: Beam, q: Array, targets: Sequence[Any]) -> None:
    """Draw where stations shall be, each joined with where it is; attitudes as three arrows."""
    for k, target in enumerate(targets):
        label = "_target" if k else "target"
        at = pose_at(beam, q, target.xi).position.full()
        point = at if target.position is None else target.position.full()
        style: dict[str, Any] = {"color": TARGET_COLOR, "clip_on": False}
        axes.plot(*np.hstack([at, point]), linestyle=":", label="_missed", **style)
        axes.plot(*point, "*", markersize=11, label=label, **style)
        if target.rotation is not None:
            size = 1.6 * ARROW * numeric_length(beam, "a figure")
            for j, color in enumerate(AXIS_COLORS):
                along = target.rotation.full()[:, [j]] * size
                _quiver(axes, point, along, color, "_target axis")


def draw_legend_and_title(axes: Any, title: str | None) -> None:
    """Title and, below it, the legend of what was drawn."""
    figure = axes.figure
    if title:
        figure.suptitle(title, y=0.985, fontsize="medium")
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(
        handles,
        labels,
        loc="upper center",
        bbox_to_anchor=(0.5, 0.955 if title else 1.0),
        ncols=5 if sum(map(len, labels)) < 80 else 3,
        fontsize="small",
        frameon=False,
    )


def _spaced(stations: Array) -> list[float]:
    """Stations from the tip to the root that are not closer than GAP."""
    kept = [1.0]
    for xi in stations[::-1]:
        if kept[-1] - xi >= GAP:
            kept.append(float(xi))
    return kept
