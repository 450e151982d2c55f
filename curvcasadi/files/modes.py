"""Curvature bases from the modes of a finite-element model, sampled along a reference line.

A mode is a small displacement u(s) and a small rotation r(s) of the sections of a straight line, in
its local axes. To first order, with p' = R e_x (Eq. 4) and R = I + [r×],

    K = r',      u' = r × e_x = (0, r_z, −r_y).

The linear K(s), kept and added with weights, are good functions for large deflections (the modal
rotations idea): the rotations that follow from them are exact for any weights, not linear.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline

from curvcasadi.beam.basis import VectorBasis
from curvcasadi.files.csv_reader import CsvTable, load_csv
from curvcasadi.symbolic.expressions import Array, count, numbers, positive

DISPLACEMENTS = ("u_x", "u_y", "u_z")
ROTATIONS = ("r_x", "r_y", "r_z")
COLUMNS = ("mode", "s", *DISPLACEMENTS, *ROTATIONS)

#: Curvature times length over the amplitude below which a mode counts as one of a rigid body, and
#: the part of a curvature, over the largest, that must not follow from those of the other modes.
_NEGLIGIBLE = 1e-6


@dataclass(frozen=True, eq=False, kw_only=True)
class Modes:
    """M modes at N stations of a straight reference line, in its local axes."""

    stations: Array  #: s (N,) increasing, m, from the root, 0, to the tip
    displacements: Array  #: u (M, 3, N), m, or any other unit of amplitude
    rotations: Array  #: r (M, 3, N), rad, rotation vectors of the same amplitude
    labels: tuple[str, ...]  #: (M,)

    def __post_init__(self) -> None:
        s = numbers("Modes.stations", self.stations)
        if s.ndim != 1 or len(s) < 2 or s[0] != 0 or np.any(np.diff(s) <= 0):
            raise ValueError(
                f"Modes.stations: expected two or more increasing numbers from 0, found {s}"
            )
        object.__setattr__(self, "stations", s)
        shape = (len(self.labels), 3, len(s))
        for name in ("displacements", "rotations"):
            values = numbers(f"Modes.{name}", getattr(self, name))
            if values.shape != shape or not self.labels:
                raise ValueError(f"Modes.{name}: expected shape {shape}, found {values.shape}")
            object.__setattr__(self, name, values)
        for label, amplitude in zip(self.labels, _amplitudes(self), strict=True):
            if not amplitude > 0:
                raise ValueError(f"Modes: {label}: expected a mode that moves, found only zeros")


@dataclass(frozen=True, eq=False, kw_only=True)
class ModalBasis:
    """A curvature basis from modes, and how well it reproduces them."""

    basis: VectorBasis  #: the curvature of each mode, its largest magnitude at a station being 1
    labels: tuple[str, ...]  #: of the modes
    round_trip_error: Array  #: (n,) per mode, see `round_trip_error`


def modal_basis(
    modes: Modes | str | Path, n: int | None = None, *, length: float | None = None
) -> ModalBasis:
    """Curvature basis K = r' of the first `n` modes, from cubic splines through the rotations.

    Each function is a 3-vector along the span with the sign of its mode, scaled so that the largest
    magnitude of curvature at a station is 1; its slope jumps at no station.

    Parameters
    ----------
    modes : modes, or a CSV file of them as `load_modes` reads it
    n : number of modes; None takes all
    length : as of `load_modes`, for a file

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
    modes = _first(modes, len(modes.labels) if n is None else count("n", n))
    spline, span = _rotations(modes).derivative(), float(modes.stations[-1])
    sampled = spline(modes.stations)  # (N, n, 3)
    largest = np.linalg.norm(sampled, axis=2).max(axis=0)
    _check_curvatures(modes, sampled, largest)

    def functions(xi: float) -> Array:
        return np.asarray((spline(xi * span) / largest[:, None]).T)

    return ModalBasis(
        basis=VectorBasis(functions, len(modes.labels), labels=modes.labels),
        labels=modes.labels,
        round_trip_error=round_trip_error(modes),
    )


def round_trip_error(modes: Modes) -> Array:
    """What is lost from modes to linear curvatures and back, (M,), relative.

    The curvatures are integrated to r = r(0) + ∫ K ds and u = u(0) + ∫ r × e_x ds. The error is the
    largest difference of a component of u/L or r at a station over the largest of all of these: of
    the splines' order where the line is inextensible and unshearable, and otherwise the part of the
    mode that stretches or shears it.
    """
    s, span = modes.stations, float(modes.stations[-1])
    rotations = _rotations(modes)
    curvatures = rotations.derivative()
    turned = rotations(0.0) + curvatures.antiderivative()(s)  # (N, M, 3)
    swept = rotations.antiderivative()(s)
    moved = modes.displacements[:, :, 0] + np.stack(
        [np.zeros_like(swept[..., 0]), swept[..., 2], -swept[..., 1]], axis=-1
    )
    given_u, given_r = (v.transpose(2, 0, 1) for v in (modes.displacements, modes.rotations))
    difference = np.maximum(np.abs(moved - given_u) / span, np.abs(turned - given_r))
    return np.asarray(difference.max(axis=(0, 2)) / _amplitudes(modes))


def load_modes(path: str | Path, *, length: float | None = None) -> Modes:
    """Modes from a CSV file: a line for each mode and station.

    The first line names the columns mode, s, u_x, u_y, u_z, r_x, r_y, r_z, in any order: the name
    of a mode, arc length from the root, displacement, m, and rotation vector, rad, in the
    undeformed local axes (x to the tip, y to the leading edge, z up on a right wing). All modes
    have the same stations. A column of rotations may be empty: then r_y = −u_z', r_z = u_y', from
    cubic splines, and r_x = 0, since a line's displacements do not tell its twist.

    Parameters
    ----------
    length : m; needed where s is xi, from 0 to 1. None: s is in m and ends at the tip

    Raises
    ------
    ValueError
        If columns are missing, a value is not a finite number, s does not increase from 0 to the
        tip, or stations differ from mode to mode; names file, line and column.
    OSError
        If the file cannot be read.
    """
    table = load_csv(path)
    found = table.faults(COLUMNS)
    if found:
        columns = ", ".join(COLUMNS)
        raise ValueError(f"{path}: line 1: expected the columns {columns}, found {found}")
    texts = [table.row(k) for k in range(len(table.rows))]
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
    slopes = _spline(stations, displacements)(stations, 1).transpose(1, 2, 0)
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


def _lines_by_mode(table: CsvTable, texts: list[dict[str, str]]) -> dict[str, list[int]]:
    """Rows of each mode, in the order of the file."""
    lines: dict[str, list[int]] = {}
    for k, row in enumerate(texts):
        if not row["mode"]:
            raise table.error(k, "mode", "expected the name of a mode, found ''")
        lines.setdefault(row["mode"], []).append(k)
    if not lines:
        raise ValueError(f"{table.path}: line 2: expected a station of a mode, found none")
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
        len(table.rows) - 1, "s", f"expected 1 or {length:g} m, the tip, last, found {s[-1]:g}"
    )


def _spline(stations: Array, values: Array) -> CubicSpline:
    """Through values (M, 3, N), as a function of s with values (…, M, 3)."""
    return CubicSpline(stations, values.transpose(2, 0, 1), bc_type="not-a-knot")


def _first(modes: Modes, n: int) -> Modes:
    if n > len(modes.labels):
        raise ValueError(f"n: expected at most {len(modes.labels)}, the modes given, found {n}")
    return Modes(
        stations=modes.stations,
        displacements=modes.displacements[:n],
        rotations=modes.rotations[:n],
        labels=modes.labels[:n],
    )


def _rotations(modes: Modes) -> CubicSpline:
    return _spline(modes.stations, modes.rotations)


def _amplitudes(modes: Modes) -> Array:
    """The largest of u/L and r of each mode, (M,)."""
    scaled = np.abs(modes.displacements) / modes.stations[-1]
    return np.asarray(np.maximum(scaled, np.abs(modes.rotations)).max(axis=(1, 2)))


def _check_curvatures(modes: Modes, sampled: Array, largest: Array) -> None:
    n, span = len(largest), modes.stations[-1]
    for label, curvature, amplitude in zip(modes.labels, largest, _amplitudes(modes), strict=False):
        if not curvature * span > _NEGLIGIBLE * amplitude:
            raise ValueError(
                f"{label}: expected a mode that bends or twists the line, found curvatures of at "
                f"most {curvature:.3g} rad/m"
            )
    scaled = (sampled / largest[:, None]).transpose(0, 2, 1).reshape(-1, n)
    own = np.zeros(n)  # what the columns before leave of each
    triangle = np.linalg.qr(scaled, mode="r")
    own[: len(triangle)] = np.abs(np.diag(triangle))
    for k in np.flatnonzero(own <= _NEGLIGIBLE * np.linalg.norm(scaled, axis=0)):
        raise ValueError(
            f"{modes.labels[k]}: expected a curvature of its own, found one that follows from the "
            "modes before"
        )
