"""Quadrature over the stations of a grid, panel by panel."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Literal, NamedTuple

import numpy as np
from numpy.polynomial import legendre

from curvcasadi.symbolic.expressions import Array

GridKind = Literal["uniform", "lobatto", "custom"]


class Panel(NamedTuple):
    """Quadrature over the stations between two breaks; weights sum to its part of [0, 1]."""

    nodes: tuple[int, ...]  #: indices of the stations
    xi: Array  #: stations, the ends moved into the panel: at a jump each panel takes its own limit
    weights: Array


def panels_between(kind: GridKind, stations: Array, breaks: Sequence[float]) -> tuple[Panel, ...]:
    """Panels between the `breaks`, each of which is one of the `stations` (N + 1,).

    Gauss–Lobatto weights where `kind` is "lobatto" (exact for polynomials of degree 2 n − 1 of n
    elements), else weights of order 4, or less where a panel has fewer than three elements.
    """
    ends = np.searchsorted(stations, [0.0, *breaks, 1.0])
    return tuple(_panel(kind, np.arange(a, b + 1), stations[a : b + 1]) for a, b in pairwise(ends))


def _panel(kind: GridKind, nodes: Array, xi: Array) -> Panel:
    weights = _interpolatory_weights(xi) if kind == "lobatto" else _cubic_weights(xi)
    inside = np.clip(xi, np.nextafter(xi[0], 1), np.nextafter(xi[-1], 0))
    return Panel(tuple(int(k) for k in nodes), inside, weights)


def _interpolatory_weights(xi: Array) -> Array:
    """Weights that integrate the polynomial through all points; Gauss–Lobatto on such points."""
    n = len(xi)
    points = 2 * (xi - xi[0]) / (xi[-1] - xi[0]) - 1
    moments = np.zeros(n)
    moments[0] = 2  # of Legendre polynomials over [−1, 1]
    weights = np.linalg.solve(legendre.legvander(points, n - 1).T, moments)
    return np.asarray(weights * (xi[-1] - xi[0]) / 2)


def _cubic_weights(xi: Array) -> Array:
    """Weights of order 4: in each interval the cubic through the four nearest points."""
    weights = np.zeros(len(xi))
    for k in range(len(xi) - 1):
        first = int(np.clip(k - 1, 0, max(len(xi) - 4, 0)))
        nearest = np.arange(first, min(first + 4, len(xi)))
        left, right = xi[k], xi[k + 1]
        scaled = (xi[nearest] - left) / (right - left)
        moments = 1 / np.arange(1, len(nearest) + 1)
        powers = np.vander(scaled, increasing=True)
        weights[nearest] += (right - left) * np.linalg.solve(powers.T, moments)
    return weights


def lobatto_points(n: int) -> Array:
    """The n + 1 Gauss–Lobatto points on [0, 1]: the ends and the roots of P_n'."""
    interior = legendre.legroots(legendre.legder(np.eye(n + 1)[n])) if n > 1 else np.array([])
    points = np.concatenate([[-1.0], np.sort(np.real(interior)), [1.0]])
    return np.asarray((1 + (points - points[::-1]) / 2) / 2)  # exactly symmetric
