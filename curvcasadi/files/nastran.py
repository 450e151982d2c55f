"""Modes of a Nastran model along a line of its grid points."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from curvcasadi.beam.modal import Modes
from curvcasadi.files.extras import needed
from curvcasadi.files.nastran_vectors import read_vectors
from curvcasadi.symbolic.expressions import Array, numbers, positive

#: Distance from the line, over its length, from which grid points do not lie on it.
_STRAIGHT = 1e-4


def load_nastran_modes(
    bdf: str | Path,
    vectors: str | Path,
    *,
    grids: Sequence[int],
    leading_edge: Sequence[float],
    length_unit: float,
) -> Modes:
    """Modes of a Nastran model along grid points on a straight reference line.

    GRID and CORD2R, CORD2C and CORD2S entries of the bulk data say where the grid points are and in
    which axes they move; eigenvectors are turned from these axes to the local axes of the line.

    Parameters
    ----------
    bdf : str or Path
        Bulk data, with the files that it includes.
    vectors : str or Path
        Real eigenvectors: an OP2 (32 bits), F06 or punch file, by its ending.
    grids : sequence of int
        Identifiers of the grid points, from the root to the tip.
    leading_edge : array, shape (3,)
        Direction to the leading edge, basic axes: with the direction of the line, x, it makes y.
    length_unit : float
        Unit of length of the model, m: 0.001 for one in mm.

    Returns
    -------
    Modes
        In local axes, m and rad; rotations are those of the grid points.

    Raises
    ------
    ImportError
        If pyyeti is not installed: ``pip install "curvcasadi[fem]"``.
    ValueError
        If a file is none of its kind, a grid point is missing, or they lie on no straight line.
    OSError
        If a file cannot be read.
    """
    bdf, vectors = Path(bdf), Path(vectors)
    unit = float(positive("length_unit", length_unit))
    places, axes = _grid_points(bdf, [int(g) for g in grids])
    stations, local = _line(places, leading_edge)
    with _print_options():
        found = read_vectors(vectors)
    missing = [g for g in grids if any(g not in mode for mode in found.values())]
    if missing:
        raise ValueError(
            f"{vectors}: expected all grid points of the line, found none of "
            f"{', '.join(map(str, missing))}"
        )
    moved = np.array([[mode[g] for g in grids] for mode in found.values()])  # (M, N, 6)
    turns = local.T @ axes.transpose(0, 2, 1)  # displacement axes to basic to local
    u, r = (np.einsum("nij,mnj->min", turns, moved[..., k : k + 3]) for k in (0, 3))
    return Modes(
        stations=stations * unit,
        displacements=u * unit,
        rotations=r,
        labels=tuple(f"mode {number}" for number in found),
    )


def _grid_points(path: Path, grids: list[int]) -> tuple[Array, Array]:
    """Places (N, 3), basic axes, and axes of displacement (N, 3, 3) from basic ones, in rows."""
    with path.open("rb"):  # names the file where it cannot be read
        pass
    with _print_options():
        bulk: Any = needed("pyyeti.nastran.bulk", "load_nastran_modes", "fem")
        n2p: Any = needed("pyyeti.nastran.n2p", "load_nastran_modes", "fem")
        try:
            cards = bulk.rdcards(str(path), "grid", return_var="list") or []
            table, _ = bulk.bulk2uset(str(path))
            rigid = n2p.rbgeom_uset(table)
        except Exception as error:  # whatever the library meets in a file that is none
            raise ValueError(f"{path}: expected bulk data of Nastran, found: {error}") from None
    for card in cards:
        for text in (value for value in card[:6] if isinstance(value, str) and value.strip()):
            raise ValueError(f"{path}: GRID {card[0]}: expected numbers, found {text!r}")
    identifiers = table.index.get_level_values("id").to_numpy()
    missing = [g for g in grids if g not in identifiers]
    if len(grids) < 2 or missing:
        raise ValueError(
            f"grids: expected two or more grid points of {path}, found "
            f"{', '.join(map(str, missing)) or grids}"
        )
    rows = [int(np.flatnonzero(identifiers == g)[0]) for g in grids]
    places = np.array([table.iloc[row, 1:4].to_numpy(dtype=float) for row in rows])
    return places, np.array([rigid[row : row + 3, :3] for row in rows])


def _line(places: Array, leading_edge: Sequence[float]) -> tuple[Array, Array]:
    """Stations (N,) on the line from the first to the last place, and its local axes in columns."""
    along = places[-1] - places[0]
    length = np.linalg.norm(along)
    forward = numbers("leading_edge", leading_edge)
    if forward.shape != (3,):
        raise ValueError(f"leading_edge: expected shape (3,), found {forward.shape}")
    if not length > 0:
        raise ValueError("grids: expected a line from root to tip, found the same place twice")
    x = along / length
    y = forward - x * (x @ forward)
    if not np.linalg.norm(y) > 1e-3 * np.linalg.norm(forward):
        raise ValueError(
            f"leading_edge: expected a direction across the line {x}, found {leading_edge}"
        )
    y /= np.linalg.norm(y)
    stations = (places - places[0]) @ x
    off = np.linalg.norm(places - places[0] - np.outer(stations, x), axis=1).max()
    if off > _STRAIGHT * length:
        raise ValueError(
            f"grids: expected grid points on a straight line, found one {off / length:.3g} of its "
            "length beside it"
        )
    return stations, np.column_stack([x, y, np.cross(x, y)])


@contextmanager
def _print_options() -> Iterator[None]:
    """Keeps how numpy prints arrays, which the library changes when it is imported."""
    options = np.get_printoptions()
    try:
        yield
    finally:
        np.set_printoptions(**options)
