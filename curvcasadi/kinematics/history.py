"""Static simulation: the numeric shapes of a beam for constant or time-varying weights."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from curvcasadi.beam.beam import Beam
from curvcasadi.kinematics.shape import poses
from curvcasadi.kinematics.weights import checked_weights, element_angles
from curvcasadi.symbolic.expressions import Array, station
from curvcasadi.symbolic.functions import function


@dataclass(frozen=True, eq=False, kw_only=True)
class ShapeHistory:
    """Shapes of a beam at T samples and M stations, as arrays."""

    times: Array  #: (T,), s; where none were given, the numbers 0 … T − 1 of the samples
    weights: Array  #: q (T, n), rad/m
    stations: Array  #: xi (M,)
    positions: Array  #: p (T, 3, M), m, parent axes
    deformation_maps: Array  #: D (T, M, 3, 3), parent to local
    element_angles: Array  #: (T, N), rad, by which the elements of the grid turn


def shape_history(
    beam: Beam,
    weights: Array,
    times: Array | None = None,
    *,
    stations: Sequence[float] | None = None,
    names: Sequence[str] | None = None,
    progress: bool = False,
) -> ShapeHistory:
    """Shapes of `beam` for each row of `weights` (Eqs. 3–13).

    Parameters
    ----------
    weights : (T, n), rad/m; one vector (n,) counts as one row
    times : (T,), s, increasing; None numbers the samples
    stations : numeric xi (M,); default, the stations of the beam
    names : what errors call each row; default, weights[0], weights[1] …
    progress : shows a progress bar

    Raises
    ------
    ValueError
        If shapes disagree, times do not increase, or a row is one that `shape_map` refuses.
    """
    weights = np.atleast_2d(np.asarray(weights, dtype=float))
    if weights.ndim != 2 or weights.shape[1] != beam.basis.n or not len(weights):
        raise ValueError(f"weights: expected shape (T, {beam.basis.n}), found {weights.shape}")
    rows = [f"weights[{k}]" for k in range(len(weights))] if names is None else names
    xi = beam.stations if stations is None else np.array([station("stations", x) for x in stations])

    from tqdm import tqdm

    shape = _shape_function(beam, xi)
    samples = tqdm(weights, desc="shapes", unit="sample", disable=not progress)
    parts = [[value.full() for value in shape(q)] for q in samples]
    positions, rotations, squared = (np.stack(part) for part in zip(*parts, strict=True))
    angles = np.sqrt(squared[:, :, 0])
    _check(beam, weights, angles, rows)
    return ShapeHistory(
        times=_checked_times(times, len(weights)),
        weights=weights,
        stations=xi,
        positions=positions,
        # Columns of `rotations` are the local axes, station by station: rows of each D.
        deformation_maps=rotations.transpose(0, 2, 1).reshape(len(weights), len(xi), 3, 3),
        element_angles=angles,
    )


def _shape_function(beam: Beam, stations: Array) -> ca.Function:
    """q -> position (3, M), rotation (3, 3 M), squared angles of the elements (N, 1)."""
    q = ca.MX.sym("q", beam.basis.n)
    frames = poses(beam, checked_weights(beam, q), stations.tolist())
    outputs = {
        "position": ca.horzcat(*(frame.position for frame in frames)),
        "rotation": ca.horzcat(*(frame.rotation for frame in frames)),
        "squared_angles": element_angles(beam, q),
    }
    return function("shape_history", {"q": q}, outputs)


def _check(beam: Beam, weights: Array, angles: Array, names: Sequence[str]) -> None:
    """Leaves the verdict on rows that may break a bound to `checked_weights`."""
    lower, upper = beam.bounds
    within = np.all((weights >= lower) & (weights <= upper), axis=1)
    within &= np.all(angles <= beam.grid.max_angle, axis=1)
    for k in np.flatnonzero(~within).tolist():
        checked_weights(beam, weights[k], names[k])


def _checked_times(times: Array | None, samples: int) -> Array:
    if times is None:
        return np.arange(samples, dtype=float)
    times = np.asarray(times, dtype=float)
    if times.shape != (samples,):
        raise ValueError(f"times: expected shape ({samples},), found {times.shape}")
    if not np.all(np.isfinite(times)) or np.any(np.diff(times) <= 0):
        raise ValueError(f"times: expected increasing finite numbers, found {times.tolist()}")
    return times
