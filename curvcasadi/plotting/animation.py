"""Animations of time histories."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.animation import FFMpegWriter, PillowWriter
from tqdm import tqdm

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
from curvcasadi.symbolic.expressions import Array

LARGEST_FRAME_RATE = 25.0


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
    wings = histories(beam, weights, times, both)
    straight = undeformed_histories(beam, both)
    figure, axes = empty_scene([*wings, *straight], points_down(beam, z_down))
    draw_undeformed(axes, straight)
    artists = draw_wings(axes, beam, wings, 0)
    draw_legend(axes)
    caption = axes.text2D(0.03, 0.9, "", transform=axes.transAxes)

    samples, rate = _frames(wings[0].times / (10 if times is None else 1))
    writer = writer_class(fps=rate)
    with writer.saving(figure, str(path), dpi=80):
        for k in tqdm(samples, desc=Path(path).name, unit="frame", disable=not progress):
            for artist in artists:
                artist.remove()
            artists = draw_wings(axes, beam, wings, k)
            caption.set_text(f"sample {k}" if times is None else f"t = {times[k]:.2f} s")
            writer.grab_frame()


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
