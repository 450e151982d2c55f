"""Gauss quadrature along the span, as fine as what is integrated asks for.

Panels end at the breaks and knots of basis and section. A panel is halved until 8 and 16 Gauss
points agree on it, so that the error is below `TOLERANCE` of the integral whatever the family, the
table or the function of the section; what no number of points integrates is refused.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from itertools import pairwise
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.polynomial import legendre

from curvcasadi.symbolic.expressions import COINCIDENT, Array

#: Largest error of an integral, over its diagonal: of entry (i, j) over √(I_ii I_jj).
TOLERANCE = 1e-11
#: Panels of equal length at least, where nothing tells between which points a function is smooth:
#: what is narrower than some 1/250 of the span then needs breaks.
UNKNOWN = 16
_MOST_HALVINGS, _NARROWEST = 300, 1e-13
_COARSE, _FINE = legendre.leggauss(8), legendre.leggauss(16)


#: (P,) stations -> (P, n, n) matrices.
Integrand: TypeAlias = Callable[[Array], Array]


class Resolved(NamedTuple):
    """Gauss points that integrate a function over [0, 1]."""

    xi: Array  #: (P,)
    weights: Array  #: (P,), their sum is 1


def resolved_points(
    name: str, integrand: Integrand, knots: Iterable[float], least: int = 1
) -> Resolved:
    """Gauss points that integrate a symmetric matrix (n, n) to `TOLERANCE`.

    Parameters
    ----------
    name : str
        Of what is integrated, in words, for errors.
    integrand : function
        Stations (P,) in (0, 1) to positive semidefinite matrices (P, n, n).
    knots : iterable of float
        Stations between which it is smooth.
    least : int
        Panels of equal length at least, between which a panel ends, too.

    Raises
    ------
    ValueError
        If halving panels does not resolve it: the message has the station.
    """
    ends = np.unique(np.concatenate([np.linspace(0, 1, least + 1), [*knots]]))
    ends = np.append(ends[:-1][np.diff(ends) > COINCIDENT], 1.0)
    waiting = [_panel(integrand, left, right) for left, right in pairwise(ends)]
    size = np.sqrt(np.diag(np.sum([panel.integral for panel in waiting], axis=0)))
    scale = np.outer(size, size)
    done, halvings = [], 0
    while waiting:
        panel = waiting.pop()
        if np.all(panel.error <= TOLERANCE * scale):  # that of 16 points is far smaller
            done.append(panel)
            continue
        middle = (panel.left + panel.right) / 2
        halvings += 1
        if halvings > _MOST_HALVINGS or panel.right - panel.left < _NARROWEST:
            raise ValueError(
                f"{name}: expected functions of xi that can be integrated, found one that no panel "
                f"near xi = {middle:g} resolves; give the stations where it jumps as breaks"
            )
        halves = (panel.left, middle), (middle, panel.right)
        waiting += [_panel(integrand, *half) for half in halves]
    done.sort(key=lambda panel: panel.left)
    nodes, weights = _FINE
    half = np.array([(panel.right - panel.left) / 2 for panel in done])
    start = np.array([panel.left for panel in done])
    xi = start[:, None] + half[:, None] * (1 + nodes)
    return Resolved(xi.ravel(), np.outer(half, weights).ravel())


class _Panel(NamedTuple):
    left: float
    right: float
    integral: Array
    error: Array


def _panel(integrand: Integrand, left: float, right: float) -> _Panel:
    half = (right - left) / 2
    values = integrand(left + half * (1 + np.concatenate([_COARSE[0], _FINE[0]])))
    coarse = half * np.tensordot(_COARSE[1], values[: _COARSE[1].size], 1)
    fine = half * np.tensordot(_FINE[1], values[_COARSE[1].size :], 1)
    return _Panel(left, right, fine, np.abs(fine - coarse))
