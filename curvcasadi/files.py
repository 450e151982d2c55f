"""Files: beams from TOML, weights from CSV, shapes to CSV or NPZ.

A wrong file is refused by a `ValueError` that says where, what was expected and what was found:
`path: [table] key: expected …, found …`, or `path: line 3, column q0: expected …, found …`.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Sequence
from dataclasses import MISSING, fields
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from curvcasadi import families
from curvcasadi import toml_table as toml
from curvcasadi.basis import CHANNELS, ChannelBasis
from curvcasadi.beam import Beam
from curvcasadi.expressions import Array, rotation_matrix
from curvcasadi.grid import Grid
from curvcasadi.lie import so3
from curvcasadi.pose import Pose
from curvcasadi.section import RIGIDITIES, Section
from curvcasadi.shape_history import ShapeHistory

#: Families by their name in a wing file; their keys there are the fields of the class.
FAMILIES: dict[str, type] = {
    "legendre": families.Legendre,
    "monomial": families.Monomial,
    "chebyshev": families.Chebyshev,
    "bspline": families.BSpline,
    "cantilever_modes": families.CantileverModes,
    "piecewise_constant": families.PiecewiseConstant,
    "tabulated": families.Tabulated,
}

#: Columns of a shape file: row-major, D_12 is the y component (parent axes) of the local x axis.
SHAPE_COLUMNS = (
    "time",
    "xi",
    *(f"p_{axis}" for axis in "xyz"),
    *(f"D_{row}{column}" for row in (1, 2, 3) for column in (1, 2, 3)),
)

_LIMIT = toml.REAL | toml.list_of(toml.REAL, "a list of numbers")


def load_beam(path: str | Path) -> Beam:
    """Beam of a wing file: TOML tables beam, basis, grid and, optionally, section.

    Parameters
    ----------
    path : wing file; SI units, radians

    Raises
    ------
    ValueError
        If the file is not TOML, has an unknown key, lacks a key, or has a wrong value.
    OSError
        If it cannot be read.
    """
    file = toml.load_table(path)
    required = dict.fromkeys(("beam", "basis", "grid"), toml.table_of())
    tables = file.read(required, {"section": toml.table_of()})
    description: dict[str, Any] = {
        "basis": _basis(file.table("basis")),
        "grid": _grid(file.table("grid")),
        "section": _section(file.table("section")) if "section" in tables else None,
    }
    beam = file.table("beam")
    description |= _beam_values(beam)
    with beam.owning_errors():
        return Beam(**description)


def _beam_values(table: toml.Table) -> dict[str, Any]:
    values = table.read(
        {"length": toml.NUMBER},
        {
            "root": toml.table_of("position", "rotation"),
            "initial_curvature": toml.VECTOR | toml.table_of("xi", "values"),
            "weight_bounds": _LIMIT | toml.table_of("lower", "upper"),
        },
    )
    readers: dict[str, Callable[[toml.Table], Any]] = {
        "root": _root,
        "initial_curvature": _initial_curvature,
        "weight_bounds": _weight_bounds,
    }
    for key, reader in readers.items():
        if isinstance(values.get(key), dict):
            values[key] = reader(table.table(key))
    return values


def _basis(table: toml.Table) -> ChannelBasis:
    channels = table.read({}, dict.fromkeys(CHANNELS, toml.table_of("family", "n")))
    made = {channel: _family(table.table(channel)) for channel in channels}
    with table.owning_errors():
        return ChannelBasis(**made)


def _family(table: toml.Table) -> families.Family:
    name = table.one_of("family", tuple(FAMILIES))
    kinds = {"n": toml.WHOLE, "degree": toml.WHOLE, "xi": toml.NUMBERS, "values": toml.ROWS}
    keys = {field.name: field.default for field in fields(FAMILIES[name]) if field.init}
    values = table.read(
        {"family": toml.TEXT} | {key: kinds[key] for key in keys if keys[key] is MISSING},
        {key: kinds[key] for key in keys if keys[key] is not MISSING},
    )
    del values["family"]
    with table.owning_errors():
        family: families.Family = FAMILIES[name](**values)
    return family


def _grid(table: toml.Table) -> Grid:
    kind = table.one_of("kind", ("uniform", "lobatto", "custom"))
    size = {"boundaries": toml.NUMBERS} if kind == "custom" else {"elements": toml.WHOLE}
    values = table.read(
        {"kind": toml.TEXT, **size},
        {"rule": toml.TEXT, "exponential": toml.TEXT, "max_angle": toml.NUMBER, "real": toml.TEXT},
    )
    with table.owning_errors():
        return Grid(**values)


def _section(table: toml.Table) -> Section:
    values = table.read(dict.fromkeys(RIGIDITIES, toml.NUMBER), {"mass_per_length": toml.NUMBER})
    with table.owning_errors():
        return Section(**values)


def _root(table: toml.Table) -> Pose:
    attitudes = {"rotation": toml.MATRIX, "rotation_vector": toml.VECTOR}
    values = table.read({"position": toml.VECTOR}, attitudes)
    given = [key for key in attitudes if key in values]
    if len(given) != 1:
        raise table.error(
            f"expected rotation or rotation_vector, found {'both' if given else 'neither'}"
        )
    with table.owning_errors():
        rotation = (
            rotation_matrix("rotation", values["rotation"])
            if "rotation" in values
            else so3.exp(ca.DM(values["rotation_vector"]))
        )
        return Pose(rotation=rotation, position=values["position"])


def _initial_curvature(table: toml.Table) -> families.Tabulated:
    """K_0 (3,) as a function of xi: linear between samples, with a break at each."""
    values = table.read({"xi": toml.NUMBERS, "values": toml.VECTORS})
    with table.owning_errors():
        return families.Tabulated(**values)


def _weight_bounds(table: toml.Table) -> tuple[Any, Any]:
    values = table.read({"lower": _LIMIT, "upper": _LIMIT})
    return values["lower"], values["upper"]


def load_weights(
    path: str | Path, n: int, labels: Sequence[str] | None = None
) -> tuple[Array | None, Array]:
    """Time-varying weights from a CSV file.

    The first line names the columns, in any order: q0 … q{n−1}, rad/m, and optionally time, s. Each
    further line is one sample: row k of the result stands in line k + 2.

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
    path = Path(path)
    names = [f"q{k}" for k in range(n)]
    # Line by line: a line break within quotes would hide which line a sample stands in.
    lines = [next(csv.reader([line]), []) for line in toml.read_text(path).rstrip().splitlines()]
    header = [name.strip() for name in lines[0]] if lines else []
    _check_header(path, header, names, labels or [""] * n)
    samples = np.array([_sample(path, k, header, row) for k, row in enumerate(lines[1:], start=2)])
    if not len(samples):
        raise ValueError(f"{path}: line 2: expected a sample of {', '.join(header)}, found none")
    times = samples[:, header.index("time")] if "time" in header else None
    if times is not None:
        _check_times(path, times)
    return times, samples[:, [header.index(name) for name in names]]


def _check_header(
    path: Path, header: Sequence[str], names: Sequence[str], labels: Sequence[str]
) -> None:
    missing = [name for name in names if name not in header]
    unknown = [name for name in header if name not in (*names, "time")]
    repeated = sorted({name for name in header if header.count(name) > 1})
    faults = {"no": missing, "the unknown": unknown, "twice": repeated}
    found = "; ".join(f"{fault} {', '.join(faulty)}" for fault, faulty in faults.items() if faulty)
    if found:
        columns = ", ".join(
            f"{name} {label}".strip() for name, label in zip(names, labels, strict=True)
        )
        raise ValueError(
            f"{path}: line 1: expected {len(names)} columns of weights ({columns}) and optionally "
            f"time, found {found}"
        )


def _sample(path: Path, line: int, header: Sequence[str], row: Sequence[str]) -> list[float]:
    if len(row) != len(header):
        raise ValueError(
            f"{path}: line {line}: expected {len(header)} values ({', '.join(header)}), "
            f"found {len(row)}"
        )
    return [
        _finite(f"{path}: line {line}, column {name}", text)
        for name, text in zip(header, row, strict=True)
    ]


def _finite(place: str, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = np.nan
    if not np.isfinite(value):
        raise ValueError(f"{place}: expected a finite number, found {text.strip()!r}")
    return value


def _check_times(path: Path, times: Array) -> None:
    for k in np.flatnonzero(np.diff(times) <= 0):
        raise ValueError(
            f"{path}: line {k + 3}, column time: expected above {times[k]:g} s, the time of the "
            f"line before, found {times[k + 1]:g}"
        )


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
