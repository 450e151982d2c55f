"""Weights of a beam: their checks, and the angles by which its elements turn."""

from __future__ import annotations

from functools import partial

import casadi as ca
import numpy as np

from curvcasadi.beam.beam import Beam
from curvcasadi.kinematics import chain
from curvcasadi.kinematics.numeric import evaluated
from curvcasadi.symbolic.expressions import (
    BOUND_SLACK,
    AnyExpr,
    Array,
    Real,
    expression,
    instance,
    is_numeric,
    same_kind,
)


def checked_weights(beam: Beam, q: AnyExpr, name: str = "q", *, angles: bool = True) -> AnyExpr:
    """`q` (n, 1) for `beam`; numbers must respect the weight bounds and the largest element angle.

    With `angles=False` the caller checks the angles, by `check_angles`.

    Raises
    ------
    ValueError
        For a wrong shape, NaN, an SX that meets MX design symbols, weights outside
        `Beam.weight_bounds`, or an element that turns more than `Grid.max_angle`.
    """
    instance("beam", beam, Beam)
    q = expression(name, q, (beam.basis.n, 1))
    same_kind(**{name: q}, **beam.design_symbols)
    if is_numeric(q) and beam.weight_bounds is not None:
        _check_bounds(beam, q, name)
    if angles:
        check_angles(beam, q, name)
    return q


def tolerated_bounds(beam: Beam, real: Real) -> tuple[Array, Array]:
    """Bounds of the weights with `BOUND_SLACK`, (n,) each: what a solver returns is within."""
    lower, upper = beam.bounds
    slack = BOUND_SLACK[real]
    widest = (slack * np.maximum(1, np.abs(side)) for side in (lower, upper))
    return lower - next(widest), upper + next(widest)


def exceeded_limit(beam: Beam, q: Array | ca.DM) -> str:
    """Which limit of `checked_weights` numeric weights exceed, in words; empty if none."""
    try:
        checked_weights(beam, ca.DM(q))
    except ValueError as error:
        return str(error)
    return ""


def _check_bounds(beam: Beam, q: ca.DM, name: str) -> None:
    lower, upper = beam.bounds
    lowest, highest = tolerated_bounds(beam, beam.grid.real)
    values = q.full().ravel()
    for i in np.flatnonzero((values < lowest) | (values > highest)):
        raise ValueError(
            f"{name}[{i}] ({beam.basis.labels[i]}): expected within Beam.weight_bounds "
            f"[{lower[i]:g}, {upper[i]:g}] rad/m, found {values[i]:g}"
        )


def check_angles(beam: Beam, q: AnyExpr, name: str = "q") -> None:
    """Refuse numeric weights by which an element turns more than `Grid.max_angle`."""
    if not is_numeric(q) or beam.design_symbols.keys() & {"Beam.length", "Beam.initial_curvature"}:
        return
    largest = beam.grid.max_angle
    angles = np.sqrt(element_angles(beam, q).full().ravel())
    worst = int(np.argmax(angles))
    if angles[worst] > largest * (1 + BOUND_SLACK[beam.grid.real]):
        a, b = beam.stations[worst : worst + 2]
        raise ValueError(
            f"{name}: expected every element to turn at most Grid.max_angle = {largest:g} rad, "
            f"found {angles[worst]:g} rad between xi = {a:g} and {b:g}; use more elements"
        )


def element_angles(beam: Beam, q: AnyExpr) -> AnyExpr:
    """Squared angles (N, 1), rad², of the elements; unchecked."""
    return evaluated(beam, "element angles", partial(chain.squared_angles, beam), q=q)
