"""Files of weights and shapes: weights from CSV, positions and attitudes to CSV or NPZ."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from curvcasadi.files.csv_reader import CsvTable, load_csv
from curvcasadi.kinematics.history import ShapeHistory
from curvcasadi.symbolic.expressions import Array

#: Columns of a shape file: row-major, D_12 is the y component (parent axes) of the local x axis.
SHAPE_COLUMNS = (
    "time",
    "xi",
    *(f"p_{axis}" for axis in "xyz"),
    *(f"D_{row}{column}" for row in (1, 2, 3) for column in (1, 2, 3)),
)


def load_weights(
    path: str | Path, n: int, labels: Sequence[str] | None = None
) -> tuple[Array | None, Array]:
    """Time-varying weights from a CSV file.

    The first line names the columns, in any order: q0 … q{n−1}, rad/m, and optionally time, s. Each
    further line is one sample: row k of the result stands in line k + 2. A table of estimates, as
    `curvcasadi estimate --out` writes it with deviations std_q0 …, or of a simulation with rates
    q_dot0 …, may have further columns.

    Parameters
    ----------
    n : number of weights
    labels : what errors call the weights besides q0 …, such as `Basis.labels`

    Returns
    -------
    times : (T,), s, or None where the file has no such column
    weights : (T, n), rad/m

    Raises
    ------
    ValueError
        If a column is missing, repeated or unknown, a line has too few or too many values, a value
        is not a finite number, times do not increase, or there is no sample.
    OSError
        If the file cannot be read.
    """
    table = load_csv(path)
    names = [f"q{k}" for k in range(n)]
    _check_header(table, names, labels or [""] * n)
    columns = table.header.columns
    samples = np.array([_sample(table, names, k) for k in range(len(table.lines))])
    if not len(samples):
        raise table.header.error(2, f"expected a sample of {', '.join(columns)}, found none")
    times = samples[:, columns.index("time")] if "time" in columns else None
    if times is not None:
        _check_times(table, times)
    return times, samples[:, [columns.index(name) for name in names]]


def _sample(table: CsvTable, names: Sequence[str], k: int) -> list[float]:
    wanted = {"time", *names}
    return [
        table.number(k, column, text) if column in wanted else np.nan
        for column, text in table.row(k).items()
    ]


def _check_header(table: CsvTable, names: Sequence[str], labels: Sequence[str]) -> None:
    present = table.header.columns
    # What `estimate` and `write_simulation` write beside weights: where a table tells deviations or
    # rates, all else is its own.
    others = ([f"std_{name}" for name in names], [name.replace("q", "q_dot") for name in names])
    whole = any(set(columns) <= set(present) for columns in others)
    found = table.header.faults(names, present if whole else ["time"])
    if found:
        columns = ", ".join(
            f"{name} {label}".strip() for name, label in zip(names, labels, strict=True)
        )
        expected = f"{len(names)} columns of weights ({columns}) and optionally time"
        raise table.header.error(1, f"expected {expected}, found {found}")


def _check_times(table: CsvTable, times: Array) -> None:
    for k in np.flatnonzero(np.diff(times) <= 0).tolist():
        expected = f"expected above {times[k]:g} s, the time of the line before"
        raise table.error(k + 1, "time", f"{expected}, found {times[k + 1]:g}")


def write_shape(path: str | Path, history: ShapeHistory) -> None:
    """Write positions and deformation maps as CSV or NPZ, by the extension of `path`.

    A CSV file has a line for each sample and station, columns `SHAPE_COLUMNS`: time, s; xi; p, m,
    parent axes; D, parent to local, row by row, so that (D_11, D_12, D_13) is the local x axis in
    parent axes. An NPZ file has the arrays time (T,), xi (M,), p (T, 3, M), D (T, M, 3, 3) and
    q (T, n), rad/m.

    Raises
    ------
    ValueError
        If the extension is another one.
    """
    writers = {".csv": _write_csv, ".npz": _write_npz}
    suffix = Path(path).suffix.lower()
    if suffix not in writers:
        raise ValueError(
            f"{path}: expected a file name that ends in .csv or .npz, found {suffix or 'no ending'}"
        )
    writers[suffix](Path(path), history)


def _write_csv(path: Path, history: ShapeHistory) -> None:
    samples, stations = len(history.times), len(history.stations)
    columns = (
        np.repeat(history.times, stations),
        np.tile(history.stations, samples),
        history.positions.transpose(0, 2, 1).reshape(-1, 3),
        history.deformation_maps.reshape(-1, 9),
    )
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(SHAPE_COLUMNS)
        writer.writerows(np.column_stack(columns).tolist())


def _write_npz(path: Path, history: ShapeHistory) -> None:
    with path.open("wb") as file:
        np.savez(
            file,
            time=history.times,
            xi=history.stations,
            p=history.positions,
            D=history.deformation_maps,
            q=history.weights,
        )
