"""Eigenvectors of Nastran from OP2, F06 and punch files, by mode and grid point."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from curvcasadi.files.extras import needed
from curvcasadi.files.toml_reader import read_text
from curvcasadi.symbolic.expressions import Array

#: Translation and rotation (6,) in the grid point's displacement axes, by mode and grid point.
Vectors: TypeAlias = dict[int, dict[int, Array]]


def read_vectors(path: Path) -> Vectors:
    """Real eigenvectors of a file, whose kind its ending tells."""
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        raise ValueError(
            f"{path}: expected a file that ends with {', '.join(READERS)}, found {path.suffix!r}"
        )
    found = reader(path)
    if not found:
        raise ValueError(f"{path}: expected real eigenvectors, found none")
    return found


def _from_op2(path: Path) -> Vectors:
    op2: Any = needed("pyyeti.nastran.op2", "load_nastran_modes", "fem")
    with path.open("rb"):  # names the file where it cannot be read
        pass
    try:
        with op2.OP2(str(path)) as file:
            tables = (file.rdop2oug(name) for name in file.dbdct if "OUG" in name)
            table = next((found for found in tables if found is not None), None)
    except Exception as error:  # whatever the library meets in a file that is none
        raise ValueError(f"{path}: expected an OP2 file, found: {error}") from None
    if table is None:
        return {}
    grids = table.index.get_level_values("Node").to_numpy()
    whole, columns = table.to_numpy(dtype=float), table.columns.get_level_values(0)
    rows = {int(g): np.flatnonzero(grids == g) for g in np.unique(grids)}
    return {
        int(mode): {g: whole[at, k] for g, at in rows.items() if len(at) == 6}
        for k, mode in enumerate(columns)
    }


_F06_MODE = re.compile(r"R E A L   E I G E N V E C T O R   N O \.\s+(\d+)")


def _from_f06(path: Path) -> Vectors:
    """Tables headed by the number of the mode; a long one goes on under the same heading."""
    found: Vectors = {}
    mode = None
    for number, line in enumerate(read_text(path).splitlines(), start=1):
        heading = _F06_MODE.search(line)
        if heading:
            mode = int(heading[1])
        elif line.startswith("1"):  # a page ends
            mode = None
        elif mode is not None:
            fields = line.split()
            if len(fields) == 8 and fields[1] == "G":
                values = [_real(path, number, text) for text in fields[2:]]
                found.setdefault(mode, {})[int(fields[0])] = np.array(values)
    return found


_PUNCH_MODE = re.compile(r"\$EIGENVALUE\s*=.*MODE\s*=\s*(\d+)")


def _from_punch(path: Path) -> Vectors:
    """Blocks of lines with $; columns 73 to 80 are numbers of lines."""
    found: Vectors = {}
    mode, vectors, grid = None, False, None
    for number, whole in enumerate(read_text(path).splitlines(), start=1):
        line = whole[:72].rstrip()
        if line.startswith("$"):
            if line.startswith("$TITLE"):
                vectors, mode = False, None
            vectors = vectors or line.startswith("$EIGENVECTOR")
            heading = _PUNCH_MODE.match(line)
            mode = int(heading[1]) if heading else mode
        elif vectors and mode is not None:
            fields = line.split()
            if fields[0] == "-CONT-" and grid is not None:
                found[mode][grid][3:] = [_real(path, number, text) for text in _three(fields[1:])]
            elif len(fields) == 5 and fields[1] == "G":
                grid = int(fields[0])
                values = [_real(path, number, text) for text in fields[2:]]
                found.setdefault(mode, {})[grid] = np.array([*values, 0.0, 0.0, 0.0])
            else:
                grid = None
    return found


def _three(fields: list[str]) -> list[str]:
    return (fields + ["missing"] * 3)[:3]


def _real(path: Path, number: int, text: str) -> float:
    """A number as Fortran writes it; the letter of a three-digit exponent may be missing."""
    try:
        return float(re.sub(r"(?<=[\d.])([+-]\d+)$", r"e\1", text.lower().replace("d", "e")))
    except ValueError:
        raise ValueError(f"{path}: line {number}: expected a number, found {text!r}") from None


READERS: dict[str, Callable[[Path], Vectors]] = {
    ".op2": _from_op2,
    ".f06": _from_f06,
    ".pch": _from_punch,
    ".pun": _from_punch,
}
