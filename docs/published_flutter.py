"""Draws docs/published_flutter.svg, flutter over published points.

To be run at the top of the repository, `python -m docs.published_flutter`: the cases are those of
`benchmarks.flutter`.
"""

from __future__ import annotations

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchmarks import flutter
from benchmarks.statics import case
from docs.published import BLUE, FOLDER, GREEN, HOLLOW, ORANGE, STYLE


def flutter_figure() -> Figure:
    """A panel each for the cases D10 B, D10 C, D15 and D16."""
    figure = Figure(figsize=(10.2, 5.8), layout="constrained")
    axes = figure.subplots(2, 2)
    panels = (by_load, by_angle, pazy, tang_dowell)
    for draw, ax in zip(panels, axes.flat, strict=True):
        draw(ax)
        ax.margins(x=0.02)
    return figure


def by_load(ax: Axes) -> None:
    """Case D10 B."""
    rows = case("D10")["reference"]["B_flutter_speed_vs_tip_load_N"]
    loads = rows["load"][::2]
    ax.plot(loads, [flutter.by_load(load).speed for load in loads], color=BLUE)
    ax.plot(rows["load"], rows["speed"], "o", color=BLUE, **HOLLOW, label="Patil 2001")
    ax.set(
        title="(a) Curved HALE wing, tip load",
        xlabel="upward tip load, N",
        ylabel="flutter speed, m/s",
    )
    ax.legend(loc="lower right")


def by_angle(ax: Axes) -> None:
    """Case D10 C."""
    rows = case("D10")["reference"]
    angles = np.linspace(0.75, 4.5, 16)
    found = [flutter.by_angle(float(angle)) for angle in angles]
    ax.plot(angles, [sweep.speed for sweep in found], color=BLUE, label="speed, m/s")
    ax.plot(angles, [sweep.frequency for sweep in found], color=ORANGE, label="frequency, rad/s")
    for name, unit, color in (("speed", "speed", BLUE), ("freq", "rad_s", ORANGE)):
        points = np.array([rows[f"C_flutter_{name}_vs_root_angle"][key] for key in ("deg", unit)])
        points = points[:, points[0] >= 0.62]
        ax.plot(*points, "o", color=color, **HOLLOW)
    ax.plot([], [], "o", color="black", **HOLLOW, label="Patil 2001")
    ax.set(title="(b) HALE wing in flight", xlabel="root angle, deg", ylabel="at flutter")
    ax.legend(loc="upper right")


def pazy(ax: Axes) -> None:
    """Case D15."""
    angles, onset = flutter.onsets()
    for suction, color, name in ((1.0, BLUE, "with suction"), (0.0, ORANGE, "lift on the chord")):
        speeds = [flutter.pazy_sweep(angle, suction).speed for angle in angles]
        ax.plot(speeds, angles, color=color, label=name)
    ax.plot(onset, angles, "o", color="black", **HOLLOW, label="UM/NAST (Riso & Cesnik)")
    ax.set(
        title="(c) Pazy wing, onset of the hump mode",
        xlabel="airspeed, m/s",
        ylabel="root angle, deg",
    )
    ax.legend(loc="upper right")


def tang_dowell(ax: Axes) -> None:
    """Case D16 at a root angle of 1 degree."""
    rows = case("D16")["reference"]["aeroelastic_frequencies_1deg_Arena_Lacarbonara"]
    found, _ = flutter.tang_dowell_sweep(1.0, tuple(rows["U"]))
    for name, color in (("torsion", BLUE), ("chord", ORANGE), ("flap", GREEN)):
        ax.plot(found.speeds, flutter.frequency(found, rows[name]), color=color, label=name)
        ax.plot(rows["U"], rows[name], "o", color=color, **HOLLOW)
    ax.plot([], [], "o", color="black", **HOLLOW, label="Arena & Lacarbonara 2013")
    ax.set(
        title="(d) Wing with a tip store, root at 1°",
        xlabel="airspeed, m/s",
        ylabel=r"$|\lambda|/2\pi$, Hz",
        ylim=(0, 32),
    )
    ax.legend(loc="upper right", ncols=2)


def main() -> None:
    with matplotlib.rc_context(STYLE):
        flutter_figure().savefig(FOLDER / "published_flutter.svg", metadata={"Date": None})


if __name__ == "__main__":
    main()
