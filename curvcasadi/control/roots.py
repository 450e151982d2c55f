"""Roots of linear models, and how they are followed from one model to the next.

A mode is followed by its left and right eigenvectors l and r, whose products

    |l_iᴴ r_j′| |l_j′ᴴ r_i| / (|l_iᴴ r_i| |l_j′ᴴ r_j′|)

are those of the identity if the two linear models are the same, in whatever units states have.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from curvcasadi.control.steady import Slopes
from curvcasadi.symbolic.expressions import Array

#: Growth Re λ/|λ| from which on an oscillation is flutter: undamped in-plane modes are none.
GROWTH = 1e-5
#: Of Im λ/|λ|: what is below does not oscillate.
OSCILLATING = 1e-6
#: Likeness of eigenvectors that settles which mode is which, whatever the roots say; what is left
#: of one is too little.
ALIKE = 0.9
#: Part of a change of weights by which it may differ from the drift; changes, relative and in
#: rad/m, that are no more than rounding.
ON_PATH, UNSEEN, SMALLEST = 0.5, 1e-6, 1e-10


class Point(NamedTuple):
    """The wing at one speed."""

    speed: float
    x: Array
    slopes: Slopes
    roots: Array  #: (nx,)
    left: Array  #: left eigenvectors, columns
    right: Array
    drift: Array  #: dx/dV of the steady state, (nx,)

    @property
    def growths(self) -> Array:
        """Re λ/|λ| of each root, −1 of those that do not oscillate."""
        size = np.maximum(np.abs(self.roots), np.finfo(float).tiny)
        return np.where(self.roots.imag > OSCILLATING * size, self.roots.real / size, -1.0)

    @property
    def growth(self) -> float:
        """Largest Re λ/|λ| of oscillations."""
        return float(np.max(self.growths, initial=-1.0))

    @property
    def growing(self) -> int:
        """The oscillation that grows most."""
        return int(np.argmax(self.growths))


def extrapolated(known: list[Point], speed: float) -> Array:
    """Polynomial through the states of the known speeds."""
    total = np.zeros_like(known[0].x)
    for i, point in enumerate(known):
        others = [other.speed for j, other in enumerate(known) if j != i]
        weight = np.prod([(speed - v) / (point.speed - v) for v in others])
        total += weight * point.x
    return total


def continues(before: Point, after: Point, n: int) -> bool:
    """Whether the weights, the first `n` of a state, go from one point to the other as they drift.

    What they do is compared to the mean of both drifts: on one path of equilibria the difference is
    of the third order in the step, between two paths of the size of the change.
    """
    change = (after.x - before.x)[:n]
    drift = (before.drift + after.drift)[:n] * (after.speed - before.speed) / 2
    size = float(np.linalg.norm(change))
    unseen = UNSEEN * max(float(np.linalg.norm(x[:n])) for x in (before.x, after.x)) + SMALLEST
    return size <= unseen or float(np.linalg.norm(change - drift)) <= ON_PATH * size


def summits(points: list[Point]) -> list[float]:
    """Speeds at which a mode may grow between points where it does not.

    Those are the summits of parabolas through three growths of a followed mode, where they are
    above what counts and the growths are not.
    """
    found = []
    for before, at, after in zip(points, points[1:], points[2:], strict=False):
        left, right = before.speed - at.speed, after.speed - at.speed
        for low, mid, high in zip(before.growths, at.growths, after.growths, strict=True):
            if min(low, mid, high) == -1.0 or not max(low, high) <= mid <= GROWTH:
                continue
            # growth = mid + slope v + bend v²
            slopes = (low - mid) / left, (high - mid) / right
            bend = (slopes[1] - slopes[0]) / (right - left)
            slope = slopes[0] - bend * left
            if bend < 0 and mid - slope**2 / (4 * bend) > GROWTH:
                found.append(at.speed - slope / (2 * bend))
    return found


def followed(before: Point, after: Point) -> tuple[Point, bool]:
    """`after` with the order of modes of `before`, and whether that order is beyond doubt.

    It is in doubt where eigenvectors of oscillations say another one than their roots do, or say
    little.
    """
    from scipy.optimize import linear_sum_assignment

    across = np.abs(before.left.conj().T @ after.right) * np.abs(before.right.T @ after.left.conj())
    own = [np.abs(np.sum(point.left.conj() * point.right, axis=0)) for point in (before, after)]
    tiny = np.finfo(float).tiny
    alike = np.minimum(across / np.maximum(np.multiply.outer(*own), tiny), 1.0)
    size = np.abs(before.roots)[:, None] + np.abs(after.roots)[None, :]
    apart = np.abs(before.roots[:, None] - after.roots[None, :]) / np.maximum(size, tiny)
    order = linear_sum_assignment(apart - alike)[1]
    ordered = reordered(after, order)
    oscillating = (before.growths > -1.0) & (ordered.growths > -1.0)
    likeness = alike[np.arange(len(order)), order]
    least = np.where(order == linear_sum_assignment(apart)[1], 1 - ALIKE, ALIKE)
    return ordered, bool(np.all(likeness[oscillating] >= least[oscillating]))


def reordered(point: Point, order: Any) -> Point:
    """The same point with its roots in another order."""
    return point._replace(
        roots=point.roots[order], left=point.left[:, order], right=point.right[:, order]
    )


def scaled(mode: Array, n: int) -> Array:
    """A mode whose largest weight, of the first `n` entries, is 1."""
    largest = mode[:n][np.argmax(np.abs(mode[:n]))]
    return np.asarray(mode / largest)
