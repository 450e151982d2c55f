"""Section tables from structural files of SHARPy."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from curvcasadi.beam.section_table import SectionTable
from curvcasadi.files.extras import needed
from curvcasadi.symbolic.expressions import Array

_DATA = {
    "coordinates": (None, 3),
    "connectivities": (None, None),
    "beam_number": (None,),
    "elem_stiffness": (None,),
    "elem_mass": (None,),
    "stiffness_db": (None, 6, 6),
    "mass_db": (None, 6, 6),
}
_Y = {"leading_edge": 1.0, "trailing_edge": -1.0}


def load_sharpy_sections(path: str | Path, *, beam: int, y: str) -> SectionTable:
    """Sections of one beam of a SHARPy structural file, constant in each element.

    The file has SI units; its matrices belong to (force, moment) in SHARPy's material axes B, with
    x along the beam as its nodes are numbered, and z up on either wing. So y is to the leading edge
    on a right wing, as in the local axes of this package, and to the trailing edge on a left wing,
    whose local z is down here: the matrices are then turned by half a turn about x. Twist and
    lumped masses are not read.

    Parameters
    ----------
    path : str or Path
        Structural file, as case.fem.h5.
    beam : int
        Number of the beam, as in `beam_number`; its elements form a line from the root to the tip.
    y : str
        Where y of the material axes points: "leading_edge" or "trailing_edge".

    Returns
    -------
    SectionTable
        In local axes, with the length along the nodes.

    Raises
    ------
    ImportError
        If h5py is not installed: ``pip install "curvcasadi[fem]"``.
    ValueError
        If the file is none, lacks data, or the elements of the beam form no line.
    OSError
        If it cannot be read.
    """
    path = Path(path)
    if y not in _Y:
        raise ValueError(f"y: expected one of {', '.join(_Y)}, found {y!r}")
    data = _read(path)
    elements = np.flatnonzero(data["beam_number"] == beam)
    if not len(elements):
        numbers = sorted({int(k) for k in data["beam_number"]})
        raise ValueError(f"{path}: expected a beam {beam} among {numbers}, found none")
    _check_line(path, data["connectivities"][elements][:, :2], beam)
    lengths = _lengths(data["coordinates"], data["connectivities"][elements])
    length = float(lengths.sum())
    turn = np.diag([1.0, _Y[y], _Y[y]])
    matrices = {
        name: _local(data[f"{name}_db"][data[f"elem_{name}"][elements].astype(int)], turn)
        for name in ("stiffness", "mass")
    }
    try:
        return SectionTable(
            xi=np.r_[0.0, np.cumsum(lengths)[:-1] / length, 1.0], length=length, **matrices
        )
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def _read(path: Path) -> dict[str, Array]:
    h5py = needed("h5py", "load_sharpy_sections", "fem")
    with path.open("rb"):  # names the file where it cannot be read
        pass
    try:
        file: Any = h5py.File(path, "r")
    except OSError:
        raise ValueError(f"{path}: expected an HDF5 file, found another") from None
    with file:
        missing = [name for name in _DATA if name not in file]
        if missing:
            raise ValueError(
                f"{path}: expected a structural file of SHARPy, found no {', '.join(missing)}"
            )
        data = {name: np.asarray(file[name][()]) for name in _DATA}
    for name, shape in _DATA.items():
        found = data[name].shape
        if len(found) != len(shape) or any(
            n not in (None, m) for n, m in zip(shape, found, strict=True)
        ):
            wanted = ", ".join("any" if n is None else str(n) for n in shape)
            raise ValueError(f"{path}: {name}: expected shape ({wanted}), found {found}")
    return data


def _check_line(path: Path, ends: Array, beam: int) -> None:
    """Whether elements follow one another, by the nodes at their ends."""
    for k in range(1, len(ends)):
        before, first = int(ends[k - 1, 1]), int(ends[k, 0])
        if first != before:
            raise ValueError(
                f"{path}: connectivities: expected element {k + 1} of beam {beam} to begin at node "
                f"{before}, the end of the one before, found node {first}"
            )


def _lengths(coordinates: Array, connectivities: Array) -> Array:
    """Lengths of elements along their nodes, which are first, last and, where given, middle."""
    order = [0, *range(2, connectivities.shape[1]), 1]
    nodes = coordinates[connectivities[:, order].astype(int)]
    return np.asarray(np.linalg.norm(np.diff(nodes, axis=1), axis=2).sum(axis=1))


def _local(matrices: Array, turn: Array) -> Array:
    """Matrices of (force, moment) as those of (moment, force), turned about x."""
    zero = np.zeros((3, 3))
    whole = np.block([[zero, turn], [turn, zero]])
    return np.asarray(whole @ matrices @ whole.T)
