"""Quadrature over the stations of a grid, panel by panel."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from itertools import pairwise
from typing import Literal, NamedTuple

import numpy as np
from numpy.polynomial import legendre

from curvcasadi.symbolic.expressions import Array

#: Five steps of Newton's method were enough for all n up to 1000.
_NEWTON_STEPS = 10

#: Fewest elements of a panel along which loads and masses are integrated.
LEAST_ELEMENTS = 3
#: From this many elements, neighbours of which differ by this factor at most, the cubics through
#: their stations leave no more than the poses do.
_MANY, _EVEN = 4, 2.0

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
    weights = _interpolatory_weights if kind == "lobatto" else _cubic_weights
    spans = ((range(int(a), int(b) + 1), stations[a : b + 1]) for a, b in pairwise(ends))
    return tuple(_panel(nodes, xi, weights(xi)) for nodes, xi in spans)


def divided_panels(stations: Array, breaks: Sequence[float]) -> tuple[Array, tuple[Panel, ...]]:
    """Stations and panels whose weights have order 4 or more however few the elements are.

    Panels of at least four elements, neighbours of which are alike, are those of `panels_between`.
    In others every element is divided at its Gauss–Lobatto points, into two, or into three where it
    is alone in its panel, and the weights are those of Lobatto's rule within the elements, all
    positive.
    """
    ends = np.searchsorted(stations, [0.0, *breaks, 1.0])
    points, panels, first = [], [], 0
    for xi in (stations[a : b + 1] for a, b in pairwise(ends)):
        lengths = np.diff(xi)
        ratios = lengths[1:] / lengths[:-1]
        if len(lengths) >= _MANY and np.all((ratios < _EVEN) & (ratios > 1 / _EVEN)):
            weights = _cubic_weights(xi)
        else:
            xi, weights = _divided(xi, LEAST_ELEMENTS if len(lengths) == 1 else 2)
        panels.append(_panel(range(first, first + len(xi)), xi, weights))
        points.append(xi[:-1])
        first += len(xi) - 1
    return np.concatenate([*points, stations[-1:]]), tuple(panels)


def _divided(xi: Array, pieces: int) -> tuple[Array, Array]:
    """Gauss–Lobatto points of every element, and their weights."""
    points = lobatto_points(pieces)
    inner = xi[:-1, None] + np.diff(xi)[:, None] * points[:-1]
    divided, weights = np.append(inner.ravel(), xi[-1]), np.zeros(pieces * (len(xi) - 1) + 1)
    for k, length in enumerate(np.diff(xi)):
        weights[k * pieces : (k + 1) * pieces + 1] += length * _interpolatory_weights(points)
    return divided, weights


def _panel(nodes: range, xi: Array, weights: Array) -> Panel:
    inside = np.clip(xi, np.nextafter(xi[0], 1), np.nextafter(xi[-1], 0))
    return Panel(tuple(nodes), inside, weights)


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


@lru_cache(maxsize=256)
def lobatto_points(n: int) -> Array:
    """The n + 1 Gauss–Lobatto points on [0, 1], read-only: the ends and the roots of P_n'.

    Newton's method from the Chebyshev–Lobatto points, all roots at once, in three to five steps of
    O(n²). With (1 − x²) P_n' = n (P_n−1 − x P_n), whose derivative is −n (n + 1) P_n, a step is

        x ← x − (x P_n − P_n−1)/((n + 1) P_n).
    """
    x = -np.cos(np.pi * np.arange(n + 1) / n)
    for _ in range(_NEWTON_STEPS):
        before, value = np.ones(n + 1), x.copy()  # P_0 and P_1
        for k in range(2, n + 1):
            before, value = value, ((2 * k - 1) * x * value - (k - 1) * before) / k
        step = (x * value - before) / ((n + 1) * value)
        x -= step
        if np.max(np.abs(step)) <= 4 * np.finfo(float).eps:
            break
    points = np.asarray((1 + (x - x[::-1]) / 2) / 2)  # exactly symmetric
    points[[0, -1]] = 0.0, 1.0
    points.setflags(write=False)
    return points
