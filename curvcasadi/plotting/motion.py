"""Figure of a simulation: parts of state, output, input over time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from matplotlib.figure import Figure

from curvcasadi.control.simulation import Simulation
from curvcasadi.plotting.figures import AXIS_COLORS
from curvcasadi.symbolic.expressions import instance, sequence

#: What the components of a vector are called.
_COMPONENTS = ("x", "y", "z")
#: Outputs of `beam_model` and `kinematic_model` that are those of the tip.
OF_TIP = ("position", "rotation")


def plot_motion(
    simulation: Simulation, parts: Sequence[str] = ("position",), title: str | None = None
) -> Figure:
    """Parts of a simulation over time, one axes for each.

    Parameters
    ----------
    simulation : Simulation
        As `simulate` returns it.
    parts : sequence of str
        Names of parts of state, output, input or parameter, as for `Simulation.part`.
    title : str, optional
        Title; none unless given.

    Returns
    -------
    matplotlib.figure.Figure
        The figure; `save_figure` writes it.

    Raises
    ------
    ValueError
        If there is no such part, or none is named.
    """
    instance("simulation", simulation, Simulation)
    names = sequence("parts", parts)
    if not names:
        raise ValueError("parts: expected one or more names, found none")
    values = {name: simulation.part(name) for name in names}
    figure = Figure(figsize=(6.4, 0.8 + 1.9 * len(names)), layout="constrained")
    all_axes: Any = figure.subplots(len(names), 1, sharex=True, squeeze=False)[:, 0]
    for axes, (name, rows) in zip(all_axes, values.items(), strict=True):
        vector = len(rows) == len(_COMPONENTS)
        labels = _COMPONENTS if vector else [str(i) for i in range(len(rows))]
        colors = AXIS_COLORS if vector else [f"C{i % 10}" for i in range(len(rows))]
        for label, color, row in zip(labels, colors, rows, strict=True):
            axes.plot(simulation.t, row, color=color, linewidth=1.2, label=label)
        axes.set_ylabel(f"{_name(simulation, name)} [{_unit(simulation, name)}]")
        axes.grid(color="0.9")
        if len(rows) > 1:
            axes.legend(
                loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize="small", frameon=False
            )
    all_axes[-1].set_xlabel("time [s]")
    all_axes[-1].set_xlim(simulation.t[0], max(simulation.t[-1], simulation.t[0] + 1e-9))
    if title:
        figure.suptitle(title, fontsize="medium")
    return figure


def _name(simulation: Simulation, name: str) -> str:
    """A part in words: outputs of a beam without a place are those of its tip."""
    outputs = {part.name for part in simulation.model.y.parts}
    words = name.replace("_", " ")
    return f"tip {words}" if name in outputs and name in OF_TIP else words


def _unit(simulation: Simulation, name: str) -> str:
    model = simulation.model
    layouts = (model.x, model.y, model.u, model.p)
    unit = next(part.unit for layout in layouts for part in layout.parts if part.name == name)
    return "-" if unit == "1" else unit
