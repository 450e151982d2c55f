"""Animations of time histories."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.animation import FFMpegWriter, PillowWriter
from tqdm import tqdm

from curvcasadi.aero.strip import StripAerodynamics
from curvcasadi.aircraft.parts import Aircraft, Wing
from curvcasadi.beam.beam import Beam
from curvcasadi.control.simulation import Simulation
from curvcasadi.plotting.content import half_wings, points_of, simulated
from curvcasadi.plotting.scene import (
    draw_legend_and_title,
    draw_rigid_parts,
    draw_undeformed,
    draw_wings,
    empty_scene,
    points_down,
)
from curvcasadi.symbolic.expressions import Array

LARGEST_FRAME_RATE = 25.0


def animate_shape(
    wing: Beam | Wing | Aircraft,
    times: Array | None,
    weights: Array | Mapping[str, Array] | Simulation,
    path: str | Path,
    *,
    both: bool = True,
    strips: StripAerodynamics | None = None,
    local_axes: bool = True,
    title: str | None = None,
    z_down: bool | None = None,
    exaggeration: float = 1.0,
    camera: tuple[float, float] | None = None,
    progress: bool = True,
) -> None:
    """Write an animation of a time history, as GIF or MP4 by the extension of `path`.

    It plays in real time, at the samples' rate or 25 frames a second: where samples are closer, the
    one nearest to each frame is drawn. Samples without times play at 10 a second. Axes and camera
    stay fixed, and hold all samples.

    Parameters
    ----------
    wing : Beam, Wing or Aircraft
        What is drawn, in its parent or body axes.
    times : array, shape (T,), optional
        Increasing times, s; None for a simulation, which has its own.
    weights : array, shape (T, n), mapping of str to array, or Simulation
        Weights, rad/m, a row for each time; of an aircraft by the name of each wing.
    path : str or Path
        File to write.
    both : bool
        As for `plot_shape`, and so are the next six.
    strips : StripAerodynamics, optional
        Chord and aerodynamic centre of a beam.
    local_axes : bool
        Draw the local axes.
    title : str, optional
        Title; none unless given.
    z_down : bool, optional
        Turn the page so that the parent's z points down.
    exaggeration : float
        Scale of z over that of x and y.
    camera : tuple of float, optional
        Elevation and azimuth of the view, degrees.
    progress : bool
        Show a progress bar.

    Raises
    ------
    ValueError
        For another extension, fewer than two samples, weights that `shape_map` refuses, or an MP4
        where the program ffmpeg is missing.
    """
    writer_class = writer_for(Path(path))
    wing, times, weights = simulated(wing, times, weights)
    wings = half_wings(wing, weights, times, both=both, strips=strips)
    count = len(wings[0].history.times)
    if count < 2:
        raise ValueError(f"weights: an animation needs two samples or more, found {count}")
    aircraft = wing if isinstance(wing, Aircraft) else None
    points = points_of(wings, aircraft, True)
    figure, axes = empty_scene(points, points_down(wings, z_down), exaggeration, camera)
    draw_undeformed(axes, wings)
    artists = draw_wings(axes, wings, 0, local_axes)
    if aircraft is not None:
        draw_rigid_parts(axes, aircraft)
    draw_legend_and_title(axes, title)
    caption = axes.text2D(0.03, 0.9, "", transform=axes.transAxes)

    samples, rate = frames(wings[0].history.times / (10 if times is None else 1))
    writer = writer_class(fps=rate)
    with writer.saving(figure, str(path), dpi=80):
        for k in tqdm(samples, desc=Path(path).name, unit="frame", disable=not progress):
            for artist in artists:
                artist.remove()
            artists = draw_wings(axes, wings, k, local_axes)
            caption.set_text(f"sample {k}" if times is None else f"t = {times[k]:.2f} s")
            writer.grab_frame()


def writer_for(path: Path, known: Sequence[str] = (".gif", ".mp4")) -> Any:
    """The class of matplotlib's writer of a file; `known` are the endings that an error names."""
    writers: dict[str, Any] = {".gif": PillowWriter, ".mp4": FFMpegWriter}
    if path.suffix.lower() not in writers:
        raise ValueError(
            f"{path}: expected a file name that ends in {' or '.join(known)}, "
            f"found {path.suffix or 'no ending'}"
        )
    writer_class = writers[path.suffix.lower()]
    if not writer_class.isAvailable():
        raise ValueError(
            f"{path}: expected the program ffmpeg, found none (Debian: apt-get install ffmpeg); "
            "a .gif needs no other program"
        )
    return writer_class


def frames(times: Array) -> tuple[list[int], float]:
    """Samples to draw, and the frames a second that show them in real time."""
    duration = times[-1] - times[0]
    rate = min(LARGEST_FRAME_RATE, (len(times) - 1) / duration)
    instants = np.linspace(times[0], times[-1], 1 + max(1, round(duration * rate)))
    nearest = np.interp(instants, times, np.arange(len(times))).round().astype(int)
    return nearest.tolist(), float(rate)
