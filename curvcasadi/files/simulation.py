"""Files of simulations."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from curvcasadi.control.simulation import Simulation
from curvcasadi.symbolic.expressions import Array, instance


def write_simulation(path: str | Path, simulation: Simulation) -> None:
    """Write a simulation as CSV or NPZ, by the extension of `path`.

    A CSV file has a line for each time: `time`, s, and a column for each entry of each part: parts
    of the state by their names (q0, q1, ..., q_dot0, ...), those of inputs, parameters and outputs
    after `u_`, `p_` and `y_`. An NPZ file has `time` (T,) and an array (T, size) of each part, by
    the same names.

    Parameters
    ----------
    path : str or Path
        File to write.
    simulation : Simulation
        The motion.

    Raises
    ------
    ValueError
        If the extension is another one.
    """
    instance("simulation", simulation, Simulation)
    path = Path(path)
    parts = _parts(simulation)
    if path.suffix.lower() == ".npz":
        with path.open("wb") as file:
            np.savez(file, time=simulation.t, **parts)  # type: ignore[arg-type]
        return
    if path.suffix.lower() != ".csv":
        found = path.suffix or "no ending"
        raise ValueError(f"{path}: expected a file name that ends in .csv or .npz, found {found}")
    names = [f"{name}{i}" for name, values in parts.items() for i in range(values.shape[1])]
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(["time", *names])
        writer.writerows(np.column_stack([simulation.t, *parts.values()]).tolist())


def _parts(simulation: Simulation) -> dict[str, Array]:
    """Each part (T, size) by its name in a file."""
    model = simulation.model
    layouts = {
        "": (model.x, simulation.x),
        "u_": (model.u, simulation.u),
        "p_": (model.p, simulation.p),
        "y_": (model.y, simulation.y),
    }
    return {
        f"{prefix}{name}": values[rows].T
        for prefix, (layout, values) in layouts.items()
        for name, rows in layout.slices.items()
    }
