"""A flight in motion: the aircraft as surfaces that move through the air."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from mpl_toolkits.mplot3d.art3d import Poly3DCollection
from tqdm import tqdm

from curvcasadi.aircraft.parts import Aircraft
from curvcasadi.control.simulation import Simulation
from curvcasadi.plotting.animation import frames, writer_for
from curvcasadi.plotting.figures import AXIS_COLORS
from curvcasadi.plotting.flight_page import write_page
from curvcasadi.plotting.flight_panels import BODY, TAIL, WING, Panel, extent, flight_panels
from curvcasadi.symbolic.expressions import instance

#: Camera of a GIF or MP4: elevation and azimuth, degrees.
CAMERA = (18.0, -140.0)


def animate_flight(
    aircraft: Aircraft,
    simulation: Simulation,
    path: str | Path,
    *,
    title: str | None = None,
    camera: tuple[float, float] = CAMERA,
    progress: bool = True,
) -> None:
    """Write an animation of a flight: GIF or MP4 by matplotlib, or an HTML page by plotly.

    The view flies along with the aircraft, north at its mean velocity over ground, and turns with
    nothing: attitude, height and the bending of the wings are those of the simulation, to scale.
    GIF and MP4 play in real time. The page is one file without any other; it has a slider for the
    time, and the mouse turns and zooms.

    Parameters
    ----------
    aircraft : Aircraft
        What flies.
    simulation : Simulation
        Of its `aircraft_model`.
    path : str or Path
        File to write: .gif, .mp4 or .html.
    title : str, optional
        Title; none unless given.
    camera : tuple of float
        Elevation and azimuth of the view of a GIF or MP4, degrees.
    progress : bool
        Show a progress bar.

    Raises
    ------
    ValueError
        For another extension, fewer than two samples, an MP4 where the program ffmpeg is missing,
        or a page where plotly is.
    """
    path = Path(path)
    instance("aircraft", aircraft, Aircraft)
    instance("simulation", simulation, Simulation)
    if len(simulation.t) < 2:
        raise ValueError(f"simulation: expected two samples or more, found {len(simulation.t)}")
    if path.suffix.lower() == ".html":
        write_page(path, flight_panels(aircraft, simulation), simulation, title)
        return
    writer_class = writer_for(path, (".gif", ".mp4", ".html"))
    panels = flight_panels(aircraft, simulation)
    figure, axes, history = _scene(panels, simulation, camera, title)
    samples, rate = frames(simulation.t)
    drawn: list[Any] = []
    marker = history.axvline(simulation.t[0], color="tab:red", linewidth=1.0)
    writer = writer_class(fps=rate)
    with writer.saving(figure, str(path), dpi=80):
        for k in tqdm(samples, desc=path.name, unit="frame", disable=not progress):
            for artist in drawn:
                artist.remove()
            drawn = [_draw(axes, panel, k) for panel in panels]
            marker.set_xdata([simulation.t[k]] * 2)
            axes.set_title(_caption(simulation, k), fontsize="medium", y=0.98)
            writer.grab_frame()


def _caption(simulation: Simulation, k: int) -> str:
    velocity = np.linalg.norm(simulation.part("twist")[3:, k])
    position = simulation.part("position")
    gained = position[2, 0] - position[2, k]
    words = f"t = {simulation.t[k]:5.2f} s    speed {velocity:5.2f} m/s    height {gained:+6.2f} m"
    return words.replace("-", "\N{MINUS SIGN}")


def _scene(
    panels: Sequence[Panel], simulation: Simulation, camera: tuple[float, float], title: str | None
) -> tuple[Figure, Any, Any]:
    """Axes of equal scales around all that moves, and below them the history of the tips."""
    low, high = extent(panels)
    figure = Figure(figsize=(8.0, 6.0))
    axes: Any = figure.add_axes((0.0, 0.30, 1.0, 0.64), projection="3d", proj_type="ortho")
    middle, half = (low + high) / 2, np.maximum((high - low) / 2, 0.04 * np.max(high - low)) * 1.05
    axes.set_xlim(middle[0] - half[0], middle[0] + half[0])
    axes.set_ylim(middle[1] + half[1], middle[1] - half[1])  # east to the right, north ahead
    axes.set_zlim(-middle[2] - half[2], -middle[2] + half[2])
    axes.set_box_aspect(half, zoom=1.25)
    axes.view_init(elev=camera[0], azim=camera[1])
    for name in "xyz":
        getattr(axes, f"{name}axis").set_major_locator(MaxNLocator(nbins=5))
    axes.set_xlabel("north [m]", fontsize="small")
    axes.set_ylabel("east [m]", fontsize="small")
    axes.set_zlabel("up [m]", fontsize="small")
    axes.tick_params(labelsize="x-small")
    history = figure.add_axes((0.10, 0.09, 0.86, 0.15))
    for k, panel in enumerate(panel for panel in panels if not panel.rigid):
        height = -(panel.front[:, 2, -1] - panel.front[:, 2, 0])
        history.plot(simulation.t, height, color=AXIS_COLORS[k % 3], label=panel.name)
    history.set_xlim(simulation.t[0], simulation.t[-1])
    history.set_xlabel("time [s]", fontsize="small")
    history.set_ylabel("tips above\nroots [m]", fontsize="small")
    history.tick_params(labelsize="x-small")
    history.grid(color="0.9")
    history.legend(fontsize="x-small", frameon=False, loc="upper right", ncols=3)
    if title:
        figure.suptitle(title, fontsize="medium", y=0.99)
    return figure, axes, history


def _draw(axes: Any, panel: Panel, k: int) -> Any:
    front, back = (edge[k].T * [1, 1, -1] for edge in (panel.front, panel.back))
    if np.array_equal(front, back):
        (line,) = axes.plot(*front.T, color=BODY, linewidth=2.5)
        return line
    quads = np.stack([front[:-1], front[1:], back[1:], back[:-1]], axis=1)
    color = TAIL if panel.rigid else WING
    return axes.add_collection3d(
        Poly3DCollection(quads, facecolor=color, edgecolor="0.35", linewidth=0.3, alpha=0.75)
    )
