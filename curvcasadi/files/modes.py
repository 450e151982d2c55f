"""Modes of a finite-element model, from CSV files."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from curvcasadi.beam.modal import ModalBasis, Modes, basis_of_modes, spline
from curvcasadi.files.csv_reader import CsvTable, load_csv
from curvcasadi.symbolic.expressions import Array, positive

DISPLACEMENTS = ("u_x", "u_y", "u_z")
ROTATIONS = ("r_x", "r_y", "r_z")
COLUMNS = ("mode", "s", *DISPLACEMENTS, *ROTATIONS)


def modal_basis(
    modes: Modes | str | Path, n: int | None = None, *, length: float | None = None
) -> ModalBasis:
    """Curvature basis K = r' of the first `n` modes, from cubic splines through the rotations.

    Each function is a 3-vector along the span with the sign of its mode, scaled so that the largest
    magnitude of curvature at a station is 1; its slope jumps at no station.

    Parameters
    ----------
    modes : Modes, str or Path
        Modes, or a CSV file of them as `load_modes` reads it.
    n : int, optional
        Number of modes; all where None.
    length : float, optional
        As of `load_modes`, for a file.

    Returns
    -------
    ModalBasis
        The basis, and how well it reproduces the modes.

    Raises
    ------
    ValueError
        If `load_modes` refuses the file, there are fewer modes, a mode has no curvature (of a rigid
        body), or the curvature of one follows from those of the others.
    """
    if not isinstance(modes, Modes):
        modes = load_modes(modes, length=length)
    elif length is not None:
        raise ValueError("length: expected only with a file, found it with Modes")
    return basis_of_modes(modes, n)


def load_modes(path: str | Path, *, length: float | None = None) -> Modes:
    """Modes from a CSV file: a line for each mode and station.

    The first line names the columns mode, s, u_x, u_y, u_z, r_x, r_y, r_z, in any order: the name
    of a mode, arc length from the root, displacement, m, and rotation vector, rad, in the
    undeformed local axes (x to the tip, y to the leading edge, z up on a right wing). All modes
    have the same stations. A column of rotations may be empty: then r_y = −u_z', r_z = u_y', from
    cubic splines, and r_x = 0, since the displacements of a line do not determine its twist.

    Parameters
    ----------
    path : str or Path
        CSV file.
    length : float, optional
        Length, m; needed where s is xi, from 0 to 1. Where None, s is in m and ends at the tip.

    Returns
    -------
    Modes
        In local axes.

    Raises
    ------
    ValueError
        If columns are missing, a value is not a finite number, s does not increase from 0 to the
        tip, or stations differ from mode to mode; names file, line and column.
    OSError
        If the file cannot be read.
    """
    table = load_csv(path)
    found = table.header.faults(COLUMNS)
    if found:
        raise table.header.error(1, f"expected the columns {', '.join(COLUMNS)}, found {found}")
    texts = [table.row(k) for k in range(len(table.lines))]
    lines = _lines_by_mode(table, texts)
    _check_stations(table, texts, lines)
    blocks = np.array([*lines.values()])
    empty = {name for name in ROTATIONS if not any(row[name] for row in texts)}

    def values_of(names: tuple[str, ...]) -> Array:
        values = [
            [0.0 if name in empty else table.number(k, name, row[name]) for name in names]
            for k, row in enumerate(texts)
        ]
        return np.array(values)[blocks]  # (M, N, columns)

    stations = _in_metres(table, values_of(("s",))[0, :, 0], length)
    displacements = values_of(DISPLACEMENTS).transpose(0, 2, 1)
    rotations = values_of(ROTATIONS).transpose(0, 2, 1)
    slopes = spline(stations, displacements)(stations, 1).transpose(1, 2, 0)
    if "r_y" in empty:
        rotations[:, 1] = -slopes[:, 2]
    if "r_z" in empty:
        rotations[:, 2] = slopes[:, 1]
    return Modes(
        stations=stations,
        displacements=displacements,
        rotations=rotations,
        labels=tuple(f"mode {name}" for name in lines),
    )


def write_modes(path: str | Path, modes: Modes) -> None:
    """Writes modes as a CSV file that `load_modes` and wing files read, with every digit.

    Parameters
    ----------
    path : str or Path
        File to write.
    modes : Modes
        In local axes.
    """
    with Path(path).open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(COLUMNS)
        for label, u, r in zip(modes.labels, modes.displacements, modes.rotations, strict=True):
            name = label.removeprefix("mode ")
            for k, s in enumerate(modes.stations):
                writer.writerow([name, *map(repr, map(float, (s, *u[:, k], *r[:, k])))])


def _lines_by_mode(table: CsvTable, texts: list[dict[str, str]]) -> dict[str, list[int]]:
    """Rows of each mode, in the order of the file."""
    lines: dict[str, list[int]] = {}
    for k, row in enumerate(texts):
        if not row["mode"]:
            raise table.error(k, "mode", "expected the name of a mode, found ''")
        lines.setdefault(row["mode"], []).append(k)
    if not lines:
        raise table.header.error(2, "expected a station of a mode, found none")
    return lines


def _check_stations(
    table: CsvTable, texts: list[dict[str, str]], lines: dict[str, list[int]]
) -> None:
    first, *_ = lines
    expected = [table.number(k, "s", texts[k]["s"]) for k in lines[first]]
    for name, rows in lines.items():
        s = [table.number(k, "s", texts[k]["s"]) for k in rows]
        for i, k in enumerate(rows):
            if i == 0 and s[0] != 0:
                raise table.error(k, "s", f"expected 0, the root, first, found {s[0]:g}")
            if i > 0 and s[i] <= s[i - 1]:
                before = f"above {s[i - 1]:g}, the station of mode {name} before"
                raise table.error(k, "s", f"expected {before}, found {s[i]:g}")
            if i < len(expected) and s[i] != expected[i]:
                same = f"{expected[i]:g}, station {i + 1} of mode {first}, for mode {name}, too"
                raise table.error(k, "s", f"expected {same}, found {s[i]:g}")
        if len(s) != max(len(expected), 2):
            wanted = f"{len(expected)} stations as of mode {first}" if len(expected) > 1 else "more"
            raise table.error(rows[-1], "s", f"expected {wanted} for mode {name}, found {len(s)}")


def _in_metres(table: CsvTable, s: Array, length: float | None) -> Array:
    if length is None:
        return s
    length = float(positive("length", length))
    for tip in (1.0, length):
        if np.isclose(s[-1], tip, rtol=1e-6, atol=0):
            return s * (length / s[-1])
    raise table.error(
        len(table.lines) - 1, "s", f"expected 1 or {length:g} m, the tip, last, found {s[-1]:g}"
    )
