"""Figures of bases and deformed wings, and animations of time histories.

Figures are plain `matplotlib.figure.Figure`s: `figure.savefig(path)` writes them without a display.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.animation import FFMpegWriter, PillowWriter
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from mpl_toolkits.mplot3d import proj3d
from mpl_toolkits.mplot3d.art3d import Poly3DCollection
from tqdm import tqdm

from curvcasadi.beam.basis import CHANNELS, Basis
from curvcasadi.beam.beam import Beam, numeric_length
from curvcasadi.beam.mirror import mirror
from curvcasadi.kinematics.history import ShapeHistory, shape_history
from curvcasadi.symbolic.expressions import AnyExpr, Array

AXIS_COLORS = ("tab:red", "tab:green", "tab:blue")
WING_COLOR, UNDEFORMED_COLOR = "black", "0.6"
#: Sizes as fractions of the length: arrows of the local axes, ribbon, gap between two arrows.
ARROW, RIBBON, GAP = 0.07, 0.06, 0.06
CURVE_STATIONS = np.linspace(0.0, 1.0, 61)
LARGEST_FRAME_RATE = 25.0


def plot_basis(basis: Basis) -> Figure:
    """Basis functions over the span: for each curvature that they drive, one axes.

    Between two breaks each function has its own limits, so that jumps show as gaps.
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
    all_axes[-1].set_xlabel(r"$\xi = s/L$ [-]")
    all_axes[-1].set_xlim(0, 1)
    return figure


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
    wings = _histories(beam, weights, None, both, names=["q"])
    straight = _undeformed(beam, both) if undeformed else []
    figure, axes = _figure([*wings, *straight], _z_down(beam, z_down))
    _draw_undeformed(axes, straight)
    _draw(axes, beam, wings, 0)
    _legend(axes)
    return figure


def animate_shape(
    beam: Beam,
    times: Array | None,
    weights: Array,
    path: str | Path,
    *,
    both: bool = True,
    z_down: bool | None = None,
    progress: bool = True,
) -> None:
    """Write an animation of a time history, as GIF or MP4 by the extension of `path`.

    It plays in real time, at the samples' rate or 25 frames a second: where samples are closer, the
    one nearest to each frame is drawn. Samples without times play at 10 a second.

    Parameters
    ----------
    times : (T,), s, increasing, or None
    weights : (T, n), rad/m
    progress : shows a progress bar
    both, z_down : as for `plot_shape`

    Raises
    ------
    ValueError
        For another extension, fewer than two samples, weights that `shape_map` refuses, or an MP4
        where the program ffmpeg is missing.
    """
    writer_class = _writer_class(Path(path))
    weights = np.atleast_2d(np.asarray(weights, dtype=float))
    if len(weights) < 2:
        raise ValueError(f"weights: an animation needs two samples or more, found {len(weights)}")
    wings = _histories(beam, weights, times, both)
    straight = _undeformed(beam, both)
    figure, axes = _figure([*wings, *straight], _z_down(beam, z_down))
    _draw_undeformed(axes, straight)
    artists = _draw(axes, beam, wings, 0)
    _legend(axes)
    caption = axes.text2D(0.03, 0.9, "", transform=axes.transAxes)

    samples, rate = _frames(wings[0].times / (10 if times is None else 1))
    writer = writer_class(fps=rate)
    with writer.saving(figure, str(path), dpi=80):
        for k in tqdm(samples, desc=Path(path).name, unit="frame", disable=not progress):
            for artist in artists:
                artist.remove()
            artists = _draw(axes, beam, wings, k)
            caption.set_text(f"sample {k}" if times is None else f"t = {times[k]:.2f} s")
            writer.grab_frame()


def save_figure(figure: Figure, path: str | Path) -> None:
    """Write `figure` in the format that the extension of `path` names."""
    known = sorted(figure.canvas.get_supported_filetypes())
    if Path(path).suffix.lower().lstrip(".") not in known:
        raise ValueError(
            f"{path}: expected a file name that ends in one of {', '.join(known)}, "
            f"found {Path(path).suffix!r}"
        )
    try:
        figure.savefig(path, dpi=200)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def _writer_class(path: Path) -> Any:
    writers: dict[str, Any] = {".gif": PillowWriter, ".mp4": FFMpegWriter}
    if path.suffix.lower() not in writers:
        raise ValueError(
            f"{path}: expected a file name that ends in .gif or .mp4, "
            f"found {path.suffix or 'no ending'}"
        )
    writer_class = writers[path.suffix.lower()]
    if not writer_class.isAvailable():
        raise ValueError(
            f"{path}: expected the program ffmpeg, found none (Debian: apt-get install ffmpeg); "
            "a .gif needs no other program"
        )
    return writer_class


def _frames(times: Array) -> tuple[list[int], float]:
    """Samples to draw, and the frames a second that show them in real time."""
    duration = times[-1] - times[0]
    rate = min(LARGEST_FRAME_RATE, (len(times) - 1) / duration)
    instants = np.linspace(times[0], times[-1], 1 + max(1, round(duration * rate)))
    nearest = np.interp(instants, times, np.arange(len(times))).round().astype(int)
    return nearest.tolist(), float(rate)


def _histories(
    beam: Beam,
    weights: Array,
    times: Array | None,
    both: bool,
    names: Sequence[str] | None = None,
) -> list[ShapeHistory]:
    numeric_length(beam, "a figure")
    stations = np.union1d(CURVE_STATIONS, beam.stations).tolist()
    wings = [beam, mirror(beam)] if both else [beam]
    return [shape_history(wing, weights, times, stations=stations, names=names) for wing in wings]


def _undeformed(beam: Beam, both: bool) -> list[ShapeHistory]:
    """Zero weights, which the weight bounds need not admit."""
    unbounded = replace(beam, weight_bounds=None)
    return _histories(unbounded, np.zeros((1, beam.basis.n)), None, both)


def _z_down(beam: Beam, z_down: bool | None) -> bool:
    return float(beam.root.rotation[2, 2]) < 0 if z_down is None else z_down


def _figure(histories: list[ShapeHistory], z_down: bool) -> tuple[Figure, Any]:
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


def _draw(axes: Any, beam: Beam, wings: list[ShapeHistory], sample: int) -> list[Any]:
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


def _draw_undeformed(axes: Any, wings: list[ShapeHistory]) -> None:
    for k, wing in enumerate(wings):
        axes.plot(
            *wing.positions[0],
            color=UNDEFORMED_COLOR,
            linestyle="--",
            clip_on=False,
            label="_undeformed" if k else "undeformed",
        )


def _legend(axes: Any) -> None:
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
