"""Weights of a beam: their checks, and the angles by which its elements turn."""

from __future__ import annotations

import casadi as ca
import numpy as np

from curvcasadi.beam.beam import Beam
from curvcasadi.kinematics import chain
from curvcasadi.symbolic.expressions import (
    AnyExpr,
    Array,
    expression,
    instance,
    is_numeric,
    same_kind,
)

#: Solvers meet bounds to a tolerance: numeric weights may exceed theirs by this fraction.
BOUND_SLACK = 1e-6


def checked_weights(beam: Beam, q: AnyExpr, name: str = "q") -> AnyExpr:
    """`q` (n, 1) for `beam`; numbers must respect the weight bounds and the largest element angle.

    Raises
    ------
    ValueError
        For a wrong shape, NaN, an SX that meets MX design symbols, weights outside
        `Beam.weight_bounds`, or an element that turns more than `Grid.max_angle`.
    """
    instance("beam", beam, Beam)
    q = expression(name, q, (beam.basis.n, 1))
    design = beam.design_symbols
    same_kind(**{name: q}, **design)
    if not is_numeric(q):
        return q
    lower, upper = beam.bounds
    values = q.full().ravel()
    lowest, highest = lower - BOUND_SLACK * np.abs(lower), upper + BOUND_SLACK * np.abs(upper)
    for i in np.flatnonzero((values < lowest) | (values > highest)):
        raise ValueError(
            f"{name}[{i}] ({beam.basis.labels[i]}): expected within Beam.weight_bounds "
            f"[{lower[i]:g}, {upper[i]:g}] rad/m, found {values[i]:g}"
        )
    if not design.keys() & {"Beam.length", "Beam.initial_curvature"}:
        _check_angles(beam, q, name)
    return q


def exceeded_limit(beam: Beam, q: Array | ca.DM) -> str:
    """Which limit of `checked_weights` numeric weights exceed, in words; empty if none."""
    try:
        checked_weights(beam, ca.DM(q))
    except ValueError as error:
        return str(error)
    return ""


def _check_angles(beam: Beam, q: ca.DM, name: str) -> None:
    largest = beam.grid.max_angle
    angles = np.sqrt(element_angles(beam, q).full().ravel())
    worst = int(np.argmax(angles))
    if angles[worst] > largest * (1 + BOUND_SLACK):
        a, b = beam.stations[worst : worst + 2]
        raise ValueError(
            f"{name}: expected every element to turn at most Grid.max_angle = {largest:g} rad, "
            f"found {angles[worst]:g} rad between xi = {a:g} and {b:g}; use more elements"
        )


def element_angles(beam: Beam, q: AnyExpr) -> AnyExpr:
    """Squared angles (N, 1), rad², of the elements; unchecked."""
    elements = chain.build(beam, (1.0,))
    angle = chain.squared_angle(elements.pattern).map(len(elements.data))
    return angle(ca.repmat(q, 1, len(elements.data)), ca.horzcat(*elements.data)).T
