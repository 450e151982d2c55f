"""The history of a flight as a figure."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np
from matplotlib.figure import Figure

from curvcasadi.control.simulation import Simulation
from curvcasadi.lie import quaternion
from curvcasadi.symbolic.expressions import Array, instance


def plot_flight(simulation: Simulation, title: str | None = None) -> Figure:
    """The history of a flight: speed, height, angles, load factor, inputs, and what the wings do.

    Parameters
    ----------
    simulation : Simulation
        Of an `aircraft_model` with all its outputs.
    title : str, optional
        Title; none unless given.

    Returns
    -------
    matplotlib.figure.Figure
        The figure; `save_figure` writes it.
    """
    instance("simulation", simulation, Simulation)
    names = [part.name for part in simulation.model.y.parts]
    missing = [name for name in ("height", "airspeed", "load_factor") if name not in names]
    if missing:
        raise ValueError(
            f"simulation: expected one of an aircraft_model with the outputs {missing}, found "
            f"{simulation.model!r}"
        )
    wings = [name.removeprefix("tip_position_") for name in names if name.startswith("tip_pos")]
    figure = Figure(figsize=(9.0, 8.0), layout="constrained")
    grid: Any = figure.subplots(4, 2, sharex=True)
    t = simulation.t

    def lines(axes: Any, label: str, rows: Sequence[tuple[str | None, Array]]) -> None:
        for name, values in rows:
            axes.plot(t, values, label=name, linewidth=1.2)
        axes.set_ylabel(label, fontsize="small")
        axes.grid(color="0.9")
        axes.tick_params(labelsize="small")
        if any(name for name, _ in rows):
            axes.legend(fontsize="x-small", frameon=False, loc="best")

    part = simulation.part
    start = part("position")[2, 0]
    degrees = {
        "angle of attack": part("angle_of_attack")[0],
        "sideslip": part("sideslip")[0],
    } | dict(zip(("roll", "pitch"), _roll_and_pitch(part("quaternion_wxyz")), strict=True))
    rates = part("twist")[:3]
    tips = [(w, -part(f"tip_position_{w}")[2]) for w in wings]
    bending = [(w, _grown(part(f"root_moment_{w}")[1])) for w in wings]
    lines(grid[0, 0], "airspeed [m/s]", [(None, part("airspeed")[0])])
    lines(grid[0, 1], "height gained [m]", [(None, part("height")[0] + start)])
    lines(grid[1, 0], "angles [deg]", [(k, np.degrees(v)) for k, v in degrees.items()])
    rate_rows = [(k, np.degrees(v)) for k, v in zip(("p", "q", "r"), rates, strict=True)]
    lines(grid[1, 1], "body rates [deg/s]", rate_rows)
    lines(grid[2, 0], "load factor of the body", [(None, part("load_factor")[0])])
    lines(grid[2, 1], "tips above the body [m]", tips)
    lines(grid[3, 0], "root bending $|M_y|$, grown by [N m]", bending)
    units = {p.name: p.unit for p in simulation.model.u.parts}
    angles = [(k, np.degrees(part(k)[0])) for k, unit in units.items() if unit == "rad"]
    lines(grid[3, 1], "deflections [deg]", angles)
    thrusts = [k for k, unit in units.items() if unit == "N"]
    if thrusts:
        beside = grid[3, 1].twinx()
        for name in thrusts:
            beside.plot(t, part(name)[0], "--", color="tab:red", linewidth=1.2, label=name)
        beside.set_ylabel("thrusts [N], dashed", fontsize="small", color="tab:red")
        beside.tick_params(labelsize="small")
    for axes in grid[-1]:
        axes.set_xlabel("time [s]")
    if title:
        figure.suptitle(title, fontsize="medium")
    return figure


def _grown(moment: Array) -> Array:
    """How much larger a moment is than at the start, in its direction there."""
    return np.asarray((moment - moment[0]) * (1.0 if moment[0] >= 0 else -1.0))


def _roll_and_pitch(quaternions: Array) -> tuple[Array, Array]:
    """Roll and pitch angle, rad, of attitudes as columns (4, T)."""
    down = np.array([quaternion.rotation(ca.DM(q)).full()[2] for q in quaternions.T])
    return np.arctan2(down[:, 1], down[:, 2]), -np.arcsin(np.clip(down[:, 0], -1, 1))
