"""Draws docs/published.svg, our results over published points: `python -m docs.published`.

To be run at the top of the repository: the cases are those of `benchmarks.statics`.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import casadi as ca
import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import curvcasadi as cc
from benchmarks.statics import UP, bend, case, pazy_sweep, rod, smith_wing, strip_load, tip
from curvcasadi.lie import quaternion
from curvcasadi.symbolic.expressions import Array

FOLDER = Path(__file__).parent
#: Colours that stay apart in print and for colour-blind readers (Okabe and Ito).
BLUE, ORANGE, GREEN = "#0072B2", "#D55E00", "#009E73"
STYLE: Any = {
    "svg.hashsalt": "curvcasadi",  # the same bytes at every run
    "font.size": 8,
    "axes.titlesize": 8.5,
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "legend.frameon": False,
    "legend.fontsize": 7.5,
    "lines.linewidth": 1.3,
    "lines.markersize": 4.5,
}
HOLLOW: dict[str, Any] = {"linestyle": "none", "markerfacecolor": "white", "zorder": 3}


def published_figure() -> Figure:
    """A panel each for the cases 02, 03, 04, 05, 10, D11, D04, D05 and D08."""
    figure = Figure(figsize=(10.2, 8.7), layout="constrained")
    axes = figure.subplots(3, 3)
    panels = (
        *(elastica, follower, dead_bend, follower_bend, pazy, smith),
        *(sine_loaded, spaghetti, bent_frequencies),
    )
    for draw, ax in zip(panels, axes.flat, strict=True):
        draw(ax)
        ax.margins(x=0.02)
    return figure


def elastica(ax: Axes) -> None:
    """Case 02."""
    loads = np.linspace(0, 10.5, 43)
    beam = rod((0, 10, 0))
    tips = _tips(beam, [[cc.PointForce(1.0, load * UP)] for load in loads])
    rows = case("02")["published_mattiasson_rows_read"]
    at = [row["PL2_EI"] for row in rows]
    ax.plot(loads, tips[2], color=BLUE, label="deflection")
    ax.plot(loads, 1 - tips[0], color=ORANGE, label="shortening")
    ax.plot(at, [r["w_over_L"] for r in rows], "o", color=BLUE, **HOLLOW)
    ax.plot(at, [r["u_over_L"] for r in rows], "o", color=ORANGE, **HOLLOW)
    ax.plot([], [], "o", color="black", **HOLLOW, label="Mattiasson 1981")
    ax.set(
        title="(a) Cantilever, dead tip force",
        xlabel="tip force $P L^2/EI$",
        ylabel="tip displacement / $L$",
        ylim=(0, 1),
    )
    ax.legend(loc="upper left", bbox_to_anchor=(0, 1.02))


def follower(ax: Axes) -> None:
    """Case 03: L = 100 and E I = 35e6 in the units of Simo and Vu-Quoc."""
    loads = 132e3 * np.linspace(0, 1, 67) ** 1.5
    beam = rod((0, 12, 0))
    scaled = loads * 100**2 / 35e6
    tips = 100 * _tips(beam, [[cc.PointForce(1.0, f * UP, "follower")] for f in scaled])
    digitised = case("03")["published_digitised_simo_vuquoc"]
    ax.plot(loads / 1e3, 100 - tips[0], color=BLUE, label="shortening $-u_x$")
    ax.plot(loads / 1e3, tips[2], color=ORANGE, label="deflection $u_z$")
    ax.plot(*np.transpose(digitised["minus_u1"]), "o", color=BLUE, **HOLLOW)
    ax.plot(*np.transpose(digitised["u3"]), "o", color=ORANGE, **HOLLOW)
    ax.plot([], [], "o", color="black", **HOLLOW, label="Simo & Vu-Quoc 1986")
    ax.set(
        title="(b) Cantilever, follower tip force, $L$ = 100",
        xlabel="tip force, 10$^3$ (consistent units)",
        ylabel="tip displacement (consistent units)",
    )
    ax.legend(loc="lower left")


def dead_bend(ax: Axes) -> None:
    """Case 04."""
    loads = np.linspace(0, 620, 32)
    tips = _tips(bend(), [[cc.PointForce(1.0, load * UP)] for load in loads])
    names = {
        "Bathe & Bolourchi 1979": ("s", 7, "Bathe"),
        "Simo & Vu-Quoc 1986": ("o", 4.5, "Simo"),
        "Crisfield 1990": ("^", 3, "Crisfield"),
    }
    start = 100 * np.array([np.sin(np.pi / 4), 1 - np.cos(np.pi / 4), 0])
    for k, (axis, color) in enumerate(zip("xyz", (BLUE, GREEN, ORANGE), strict=True)):
        ax.plot(loads, tips[k], color=color, label=f"${axis}$")
        for marker, size, author in names.values():
            rows = [r for r in case("04")["reference"]["published"] if author in r["who"]]
            points = [r.get("tip_position") or start + r["tip_displacement_xyz"] for r in rows]
            ax.plot(
                [r["F"] for r in rows],
                [p[k] for p in points],
                marker,
                ms=size,
                color=color,
                **HOLLOW,
            )
    for label, (marker, size, _) in names.items():
        ax.plot([], [], marker, ms=size, color="black", **HOLLOW, label=label)
    ax.set(
        title="(c) 45° bend of radius 100 in, dead tip force",
        xlabel="tip force, lb",
        ylabel="tip position, in",
        ylim=(0, 95),
    )
    ax.legend(ncols=2, loc="upper right")


def follower_bend(ax: Axes) -> None:
    """Case 05."""
    loads = np.linspace(0, 3000, 61)
    start = 100 * np.array([[np.sin(np.pi / 4)], [1 - np.cos(np.pi / 4)], [0]])
    tips = _tips(bend(), [[cc.PointForce(1.0, load * UP, "follower")] for load in loads]) - start
    digitised = case("05")["reference"]["published_digitised_simo_vuquoc"]
    for k, (axis, color) in enumerate(zip("xyz", (BLUE, GREEN, ORANGE), strict=True)):
        ax.plot(loads / 1e3, tips[k], color=color, label=f"${axis}$")
        force, moved = np.transpose(digitised[axis])
        ax.plot(force / 1e3, moved, "o", color=color, **HOLLOW)
    ax.plot([], [], "o", color="black", **HOLLOW, label="Simo & Vu-Quoc 1986")
    ax.set(
        title="(d) The same bend, follower tip force",
        xlabel="tip force, 10$^3$ lb",
        ylabel="tip displacement, in",
        ylim=(-80, 105),
    )
    ax.legend(ncols=2, loc="upper right")


def pazy(ax: Axes) -> None:
    """Case 10."""
    masses = np.linspace(0, 3.5, 36)
    for skin, color, name in (("skin1", BLUE, "with skin"), ("skin0", ORANGE, "without skin")):
        rows = case("10")["reference"][skin]
        ax.plot(masses, -pazy_sweep(skin, masses.tolist())[2], color=color, label=name)
        table = np.array(rows["umnast_beam"]["rows"])[::2]
        ax.plot(table[:, 0], -table[:, 1], "o", color=color, **HOLLOW)
        table = np.array(rows["experiment_technion"]["rows"])
        ax.plot(table[:, 0], -table[:, 1], "x", color=color, markersize=4)
    ax.plot([], [], "o", color="black", **HOLLOW, label="UM/NAST (Riso & Cesnik)")
    ax.plot(
        [], [], "x", color="black", markersize=4, linestyle="none", label="experiment (Technion)"
    )
    ax.set(
        title="(e) Pazy wing, mass at the tip midchord",
        xlabel="tip mass, kg",
        ylabel="tip deflection, % of semispan",
        ylim=(0, 56),
    )
    ax.legend(loc="lower right")


def smith(ax: Axes) -> None:
    """Case D11, the wing of Patil, Hodges and Cesnik at a root angle of 2 degrees over speed."""
    data = case("D11")["reference"]
    codes = data["AeroBeams_SMWSteady_2deg_g9.80665_ISA20km_EIip4e6"]
    speeds = np.linspace(0, max(codes["U"]), 31)
    beam = smith_wing(2.0, in_plane=4e6)
    weight = cc.Gravity([0, 0, -9.80665])
    tips = _tips(beam, [[strip_load(speed, 0.08803), weight] for speed in speeds])
    ax.plot(speeds, tips[2], color=BLUE, label="strip theory")
    ax.plot(codes["U"], codes["tip_z"], "o", color=BLUE, **HOLLOW, label="AeroBeams")
    plotted = data["Patil_2001_digitised_tip_z_vs_U"]["root_angle_2deg"]
    ax.plot(plotted["U"], plotted["tip_z"], "x", color="black", markersize=4, label="Patil 2001")
    ax.set(
        title="(f) 16 m wing under gravity, root at 2°",
        xlabel="airspeed, m/s",
        ylabel="tip height, m",
    )
    ax.legend(loc="upper left")


def sine_loaded(ax: Axes) -> None:
    """Case D04 with four weights: the force is 1000 sin(200 t) N."""
    data = case("D04")
    stiffness = data["section"]["EI_N_m2"]
    section = cc.Section(
        GJ=1.0,
        EI_y=stiffness,
        EI_z=stiffness,
        mass_per_length=data["section"]["mass_per_length_kg_m"],
    )
    beam = cc.Beam(
        length=1.0,
        basis=cc.ChannelBasis(out_of_plane=cc.Legendre(4)),
        grid=cc.Grid.lobatto(8),
        section=section,
    )
    push = ca.MX.sym("push")
    force = cc.PointForce(1.0, ca.vertcat(0, 0, push))
    model = cc.beam_model(beam, [force], inputs={"push": push}, outputs=["position"])
    motion = cc.simulate(
        model,
        None,
        np.linspace(0, 0.102, 511),
        u=lambda t: [1000 * np.sin(200 * t)],
        method="implicit_midpoint",
        dt=1e-4,
    )
    exact = data["reference"]
    ax.plot(1e3 * motion.t, 1e3 * motion.part("position")[2], color=BLUE, label="four weights")
    times, heights = (1e3 * np.array(exact[key]) for key in ("t_s", "tip_z_m"))
    ax.plot(times, heights, "o", color=BLUE, **HOLLOW, label="exact modal sum")
    ax.set(
        title="(g) Cantilever of 1 m, sine force at the tip",
        xlabel="time, ms",
        ylabel="tip height, mm",
        ylim=(-0.36, 0.48),
    )
    ax.legend(loc="upper left", ncols=2)


def spaghetti(ax: Axes) -> None:
    """Case D05 with eight weights: the pushed end of a free beam."""
    section = cc.Section(
        GJ=500, EI_y=100, EI_z=100, mass_per_length=1, inertia=np.diag([20, 10, 10])
    )
    beam = cc.Beam(
        length=10.0,
        basis=cc.ChannelBasis(out_of_plane=cc.Legendre(8)),
        grid=cc.Grid.lobatto(16),
        section=section,
        root=cc.Pose(rotation=[[0.6, 0, 0.8], [0, 1, 0], [-0.8, 0, 0.6]], position=[0, 0, 0]),
    )
    push = (cc.PointForce(1.0, [8, 0, 0]), cc.PointMoment(1.0, [0, 80, 0]))
    start, tips = None, []
    for loads, first, last in ((push, 0.0, 2.5), ((), 2.5, 7.5)):
        wing = cc.Wing(name="beam", beam=beam, loads=loads)
        alone = cc.Aircraft(body=cc.NoBody(), beams=(wing,))
        model = cc.aircraft_model(alone, density=0, gravity=0, outputs=["tip_position_beam"])
        times = np.linspace(first, last, 1 + round(40 * (last - first)))
        motion = cc.simulate(model, start, times, dt=0.0025)
        start = motion.x[:, -1]
        tips += [
            quaternion.rotation(ca.DM(x[:4])).full() @ tip + x[4:7]
            for x, tip in zip(motion.x.T, motion.y.T, strict=True)
        ]
    times = np.concatenate([np.linspace(0, 2.5, 101), np.linspace(2.5, 7.5, 201)])
    moved = np.array(tips) - tips[0]
    code = case("D05")["reference"]["AeroBeams_2D_tip"]
    for k, color, name, values in (
        (0, BLUE, "along x", ("u1_min", "u1_max", "u1_at_t7.5")),
        (2, ORANGE, "along z", ("u3_max", "u3_at_t7.5")),
    ):
        ax.plot(times, moved[:, k], color=color, label=name)
        instants = {"min": moved[:, k].argmin(), "max": moved[:, k].argmax(), "t7.5": -1}
        at = [times[instants[value.rpartition("_")[2]]] for value in values]
        ax.plot(at, [code[value] for value in values], "o", color=color, **HOLLOW)
    ax.plot([], [], "o", color="black", **HOLLOW, label="AeroBeams: extremes, end")
    ax.set(
        title="(h) Free flying beam, its pushed end",
        xlabel="time (consistent units)",
        ylabel="displacement (consistent units)",
        ylim=(-4, 15),
    )
    ax.legend(loc="upper left")


def bent_frequencies(ax: Axes) -> None:
    """Case D08: the HALE wing about shapes bent by a dead tip force."""
    section = cc.Section(
        GJ=1e4,
        EI_y=2e4,
        EI_z=4e6,
        mass_per_length=0.75,
        inertia=np.diag([0.1, 5e-4, 0.0995]),
    )
    families = {"torsion": 3, "out_of_plane": 5, "in_plane": 4}
    basis = cc.ChannelBasis(**{name: cc.Legendre(n) for name, n in families.items()})
    beam = cc.Beam(length=16.0, basis=basis, grid=cc.Grid.lobatto(16), section=section)
    heights, found, q = [], [], None
    for force in np.linspace(0, 40, 41):
        loads = [cc.PointForce(1.0, force * UP)]
        rest = cc.solve_equilibrium(beam, loads, q)
        q = rest.q
        heights.append(float(rest.shape.tip.position[2]))
        found.append(cc.natural_frequencies(beam, q, loads)[:5])
    ax.plot(heights, found, color=BLUE, lw=1)
    ax.plot([], [], color=BLUE, lw=1, label="twelve weights")
    published = case("D08")["reference"]
    for curve in published.values():
        if isinstance(curve, dict) and {"tip_z", "w"} <= set(curve):
            ax.plot(curve["tip_z"], curve["w"], "x", color="black", markersize=4)
    ax.plot([], [], "x", color="black", markersize=4, ls="none", label="Patil 2001")
    ax.set(
        title="(i) 16 m wing, frequencies about bent shapes",
        xlabel="tip height, m",
        ylabel="frequency, rad/s",
        ylim=(0, 60),
    )
    ax.legend(loc="upper left", ncols=2)


def _tips(beam: cc.Beam, loads: list[list[Any]]) -> Array:
    """Tip positions (3, loads), m."""
    return np.array([tip(beam, load) for load in loads]).T


def main() -> None:
    with matplotlib.rc_context(STYLE):
        published_figure().savefig(FOLDER / "published.svg", metadata={"Date": None})


if __name__ == "__main__":
    main()
