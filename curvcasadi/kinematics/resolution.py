"""How many elements a beam needs: the paper's section 3.1."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise, product

import casadi as ca
import numpy as np

from curvcasadi.beam.beam import Beam, numeric_length
from curvcasadi.beam.grid import Grid
from curvcasadi.kinematics.pose_function import tip_function
from curvcasadi.kinematics.rules import rule_of
from curvcasadi.symbolic.expressions import Array, is_numeric, positive

#: Points per element at which curvature bounds are evaluated.
_POINTS = 9
#: Shapes at the corners of the weight box that a tip tolerance is checked on.
_CORNERS = 512
#: The tip tolerance that is promised, over the tip error that is estimated on the corners.
_SAFETY = 2.0
_MOST_ELEMENTS = 4096
#: Places between the bounds of a weight where the worst shape is looked for, one weight at a time.
_FRACTIONS = np.linspace(0, 1, 9)


def elements_for(
    beam: Beam, *, angle: float | None = None, tip_tolerance: float | None = None
) -> Grid:
    """Grid with as few elements as every shape within the beam's weight bounds allows.

    Parameters
    ----------
    beam : Beam
        With `weight_bounds`; kind, rule and exponential of its uniform or Lobatto grid are kept.
    angle : float, optional
        Largest angle of an element, rad: the paper's h max|K| ≤ angle. `Grid.max_angle` unless
        given.
    tip_tolerance : float, optional
        Largest error of the tip position, m, that the rule may leave. It is estimated against four
        times as many elements on the corners of the weight box (all 2^n, or 512 of them) and on 512
        shapes inside it, the worst of them improved one weight at a time, and kept below half of
        the tolerance.

    Returns
    -------
    Grid
        The grid of `beam` with another number of elements.

    Raises
    ------
    ValueError
        If a weight is unbounded, the length a symbol, the grid custom, or 4096 elements too few.
    """
    grid = beam.grid
    if grid.kind == "custom":
        raise ValueError(
            "Beam.grid: elements_for needs a uniform or Lobatto grid, found a custom one"
        )
    allowed = float(positive("angle", grid.max_angle if angle is None else angle))
    if allowed > grid.max_angle:
        raise ValueError(
            f"angle: expected at most Grid.max_angle = {grid.max_angle:g} rad, found {allowed:g}"
        )
    elements = _elements_for_angle(beam, allowed)
    if tip_tolerance is not None:
        tolerance = float(positive("tip_tolerance", tip_tolerance))
        elements = _elements_for_tip(beam, elements, tolerance)
    return replace(grid, elements=elements)


def largest_element_angles(beam: Beam) -> Array:
    """Bound (N,), rad, on the angles of the elements over all weights within `beam.bounds`.

    |θ| ≤ a (1 + a²/12)^½ with a = h max|K|: the second factor is a Magnus commutator.
    Infinite where a weight is unbounded.
    """
    length = numeric_length(beam, "a bound on element angles")
    stations = beam.stations
    largest = [
        max(_curvature_bound(beam, xi) for xi in np.linspace(a, b, _POINTS))
        for a, b in pairwise(stations)
    ]
    turned = length * np.diff(stations) * np.array(largest)
    return np.asarray(turned * np.sqrt(1 + turned**2 / 12))


def elements_that_may_exceed(beam: Beam) -> list[int]:
    """Elements that weights within `beam.bounds` may turn by more than `Grid.max_angle`."""
    within = largest_element_angles(beam) <= beam.grid.max_angle
    return [int(element) for element in np.flatnonzero(~within)]


def _curvature_bound(beam: Beam, xi: float) -> float:
    """Bound on |K(xi)|, rad/m, over all weights within `beam.bounds`."""
    phi = beam.basis(xi)
    with np.errstate(invalid="ignore"):  # 0 × ∞, where a function vanishes
        ends = np.stack([np.where(phi != 0, phi * side, 0.0) for side in beam.bounds])
    initial = beam.initial_curvature_at(xi)
    if not is_numeric(initial):
        raise ValueError(f"Beam.initial_curvature: expected numbers, found {initial}")
    k0 = initial.full().ravel()
    reach = np.maximum(np.abs(k0 + ends.max(0).sum(1)), np.abs(k0 + ends.min(0).sum(1)))
    return float(np.linalg.norm(reach))


def _elements_for_angle(beam: Beam, allowed: float) -> int:
    if not np.all(np.isfinite(beam.bounds)):
        raise ValueError(
            f"Beam.weight_bounds: elements_for needs finite bounds, found {beam.weight_bounds}"
        )
    elements = len(beam.breaks) + 1
    while elements <= _MOST_ELEMENTS:
        excess = np.max(largest_element_angles(_with_elements(beam, elements))) / allowed
        if excess <= 1:
            return elements
        elements = max(elements + 1, int(elements * min(excess, 2.0)))
    raise ValueError(f"angle: {_MOST_ELEMENTS} elements are too few for {allowed:g} rad")


def _elements_for_tip(beam: Beam, elements: int, tolerance: float) -> int:
    order = rule_of(beam.grid).order
    corners = _corners(beam)
    while elements <= _MOST_ELEMENTS:
        error = _SAFETY * _largest_tip_error(beam, elements, corners)
        if error <= tolerance:
            return elements
        elements = max(elements + 1, int(np.ceil(elements * (error / tolerance) ** (1 / order))))
    raise ValueError(f"tip_tolerance: {_MOST_ELEMENTS} elements are too few for {tolerance:g} m")


def _corners(beam: Beam) -> Array:
    """Corners (n, C) of the weight box, all of them or a fixed sample, and as many inside it.

    The largest error may lie inside: where a weight grows, the tip error may pass a maximum.
    """
    lower, upper = beam.bounds
    n = beam.basis.n
    random = np.random.default_rng(0)
    if 2**n <= _CORNERS:
        signs = np.array(list(product((False, True), repeat=n))).T
    else:
        signs = random.random((n, _CORNERS)) < 0.5
    inside = lower[:, None] + (upper - lower)[:, None] * random.random((n, _CORNERS))
    return np.hstack([np.where(signs, upper[:, None], lower[:, None]), inside])


def _largest_tip_error(beam: Beam, elements: int, corners: Array) -> float:
    """Largest distance, m, between the tips of `elements` and of four times as many, extrapolated.

    Four times: between breaks the elements are whole numbers, that twice as many may not change.
    """
    coarse = tip_function(_with_elements(beam, elements))
    fine = tip_function(_with_elements(beam, 4 * elements))

    def errors(weights: Array) -> Array:
        tips = [f.map(weights.shape[1])(ca.DM(weights))[0].full() for f in (coarse, fine)]
        return np.asarray(np.linalg.norm(tips[0] - tips[1], axis=0))

    lower, upper = beam.bounds
    found = errors(corners)
    worst, largest = corners[:, np.argmax(found)], float(found.max())
    while True:
        flipped = np.repeat(worst[:, None], len(worst) * _FRACTIONS.size, axis=1)
        rows = np.repeat(np.arange(len(worst)), _FRACTIONS.size)
        values = lower[:, None] + (upper - lower)[:, None] * _FRACTIONS
        flipped[rows, np.arange(rows.size)] = values.ravel()
        found = errors(flipped)
        if found.max() <= largest:
            break
        worst, largest = flipped[:, np.argmax(found)], float(found.max())
    return largest / (1 - 0.25 ** rule_of(beam.grid).order)


def _with_elements(beam: Beam, elements: int) -> Beam:
    return replace(beam, grid=replace(beam.grid, elements=elements))
