"""Weighted nonlinear least squares within bounds, in what the data see."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from curvcasadi.symbolic.expressions import Array

#: Largest step of a weight times the length, rad.
_LARGEST_STEP = 1.5
_ITERATIONS = 60
#: Reduction that a step promises and that counts as none: 1e-6 standard deviations squared, and
#: rounding of the cost.
_NOTHING, _ROUNDING = 1e-12, 1e-14
#: Part of the promised reduction that a step has to bring.
_SUFFICIENT = 1e-3
_FIRST_DAMPING = 1e-4
#: Reduction that may be left, 1e-3 standard deviations squared, where rounding hides the descent.
_LITTLE = 1e-6


@dataclass(frozen=True, eq=False)
class Linearization:
    """A point of ½ Σ ρ(residual²), with rows weighted by √ρ'."""

    cost: float
    residual: Array  #: (m,), weighted
    slope: Array  #: (m, n), weighted
    seen: Array  #: orthonormal columns (n, rank) that steps are taken in


#: Where there is no residual.
UNDEFINED = Linearization(np.inf, np.zeros(0), np.zeros((0, 0)), np.zeros((0, 0)))


@dataclass(frozen=True, eq=False)
class Minimum:
    """Where the iteration ended."""

    q: Array  #: (n,)
    cost: float
    converged: bool
    iterations: int


def minimize(
    linearize: Callable[[Array], Linearization],
    start: Array,
    bounds: tuple[Array, Array],
    length: float,
) -> Minimum:
    """Gauss–Newton within `bounds`, each step of least norm in what is seen.

    A step that does not bring a part of what it promises is repeated with Levenberg's damping,
    and no step changes a weight by more than 1.5 rad over the length.
    """
    q = np.clip(start, *bounds)
    at, damping = linearize(q), 0.0
    if at is UNDEFINED:
        return Minimum(q, at.cost, False, 0)
    for iteration in range(_ITERATIONS):
        step = _step(at, (bounds[0] - q, bounds[1] - q), damping)
        bend = length * np.max(np.abs(step))
        step = step * min(1.0, _LARGEST_STEP / bend) if bend else step
        change = at.slope @ step
        promised = float(-change @ at.residual - change @ change / 2)
        if promised <= _NOTHING + _ROUNDING * at.cost:
            return Minimum(q, at.cost, damping == 0 or _stalled(at, bounds, q), iteration)
        trial = np.clip(q + step, *bounds)
        there = linearize(trial)
        if at.cost - there.cost >= _SUFFICIENT * promised:
            q, at = trial, there
            damping = damping / 10 if damping > _FIRST_DAMPING else 0.0
        else:
            damping = max(10 * damping, _FIRST_DAMPING)
    return Minimum(q, at.cost, False, _ITERATIONS)


def _stalled(at: Linearization, bounds: tuple[Array, Array], q: Array) -> bool:
    """Whether the undamped step, too, promises little."""
    change = at.slope @ _step(at, (bounds[0] - q, bounds[1] - q), 0.0)
    return bool(-change @ at.residual - change @ change / 2 <= _LITTLE)


def _step(at: Linearization, room: tuple[Array, Array], damping: float) -> Array:
    """argmin |residual + slope s|² + damping |slope|² |s|², s in what is seen and within `room`."""
    n = at.slope.shape[1]
    size = np.linalg.norm(at.slope)
    reduced = at.slope @ at.seen
    damped = np.sqrt(damping) * size * np.eye(reduced.shape[1])
    right = np.concatenate([-at.residual, np.zeros(len(damped))])
    s = at.seen @ np.linalg.lstsq(np.vstack([reduced, damped]), right, rcond=None)[0]
    if np.all(s >= room[0]) and np.all(s <= room[1]):
        return np.asarray(s)
    hidden = np.eye(n) - at.seen @ at.seen.T
    stack = np.vstack([at.slope @ (np.eye(n) - hidden), damped @ at.seen.T, size * hidden])
    right = np.concatenate([right, np.zeros(n)])
    from scipy.optimize import lsq_linear

    # Bounds with no room between them are opened by rounding, which lsq_linear asks for.
    lower = np.minimum(room[0], -1e-15)
    upper = np.maximum(room[1], 1e-15)
    found = lsq_linear(stack, right, (lower, upper), method="bvls")
    return np.clip(found.x, *room)
