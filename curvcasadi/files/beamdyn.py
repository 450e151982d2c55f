"""Section tables from blade files of BeamDyn."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from curvcasadi.beam.section_table import SectionTable
from curvcasadi.files.toml_reader import read_text
from curvcasadi.symbolic.expressions import Array

#: Local axes (x to the tip, y to the leading edge, z up) from BeamDyn's (x to the suction side,
#: y to the trailing edge, z to the tip).
_AXES = np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]])
_STATION = 1 + 36 + 36


def load_beamdyn_sections(path: str | Path) -> SectionTable:
    """Sections of a BeamDyn blade file, linear between its stations.

    The file has SI units; its matrices belong to (force, moment) in axes with x to the suction
    side, y to the trailing edge and z to the tip, turned by the blade's twist. The table is in the
    local axes of this package, those of a right wing whose upper side is the suction side: x to the
    tip, y to the leading edge, z up; `mirror` makes the left wing. Twist and length stand in
    BeamDyn's primary file and are not read: give the twist to `WingGeometry`, with the opposite
    sign where it is positive leading edge down, about −z.

    Parameters
    ----------
    path : str or Path
        Blade file, as bd_blade.inp.

    Returns
    -------
    SectionTable
        In local axes.

    Raises
    ------
    ValueError
        If the file is none, a number is missing or no number, or a matrix is not that of a section;
        names file and line.
    OSError
        If it cannot be read.
    """
    path = Path(path)
    lines = read_text(path).splitlines()
    total = _stations(path, lines)
    values = _numbers(path, lines)
    if len(values) != total * _STATION:
        raise ValueError(
            f"{path}: expected {_STATION} numbers for each of {total} stations below "
            f"'Distributed Properties', found {len(values)}"
        )
    stations = values.reshape(total, _STATION)
    stiffness, mass = (stations[:, k : k + 36].reshape(-1, 6, 6) for k in (1, 37))
    try:
        return SectionTable(
            xi=stations[:, 0], stiffness=_local(stiffness), mass=_local(mass), length=None
        )
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def _stations(path: Path, lines: list[str]) -> int:
    for number, line in enumerate(lines, start=1):
        first, *rest = line.split() or [""]
        if rest and rest[0].lower() == "station_total":
            if not first.isdigit() or int(first) < 2:
                raise ValueError(
                    f"{path}: line {number}: station_total: expected a whole number above 1, "
                    f"found {first}"
                )
            return int(first)
    raise ValueError(f"{path}: expected a blade file of BeamDyn, found no line of station_total")


def _numbers(path: Path, lines: list[str]) -> Array:
    """All numbers below the heading of the distributed properties."""
    headings = [k for k, line in enumerate(lines) if "distributed properties" in line.lower()]
    if not headings:
        raise ValueError(f"{path}: expected a heading 'Distributed Properties', found none")
    found: list[float] = []
    for number, line in enumerate(lines[headings[0] + 1 :], start=headings[0] + 2):
        for text in line.split():
            try:
                found.append(float(text.lower().replace("d", "e")))
            except ValueError:
                raise ValueError(
                    f"{path}: line {number}: expected numbers, found {text!r}"
                ) from None
    return np.array(found)


def _local(matrices: Array) -> Array:
    """Matrices of (force, moment) in BeamDyn's axes as those of (moment, force) in local ones."""
    zero = np.zeros((3, 3))
    turn = np.block([[zero, _AXES], [_AXES, zero]])
    return np.asarray(turn @ matrices @ turn.T)
