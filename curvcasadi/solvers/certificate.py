"""What counts as a solution: bounds, and tolerances of each number format."""

from __future__ import annotations

from typing import NamedTuple

import casadi as ca

from curvcasadi.symbolic.expressions import BOUND_SLACK, Number, Real


class Tolerances(NamedTuple):
    """What counts as zero in a number format, in units of x (the objective is scaled so)."""

    step: float  #: of Newton's steps, at which they end
    stationarity: float  #: of the optimality conditions of a solution that is called one
    decrement: float  #: of a residual that a Newton step would still take away
    limit: float  #: by which a solution may exceed a limit
    flat: float  #: curvature beside which that of the objective is none


TOLERANCES: dict[Real, Tolerances] = {
    "double": Tolerances(1e-10, 1e-8, 1e-6, BOUND_SLACK["double"], 1e-12),
    "float": Tolerances(3e-6, 1e-6, 1e-4, BOUND_SLACK["float"], 1e-6),
}


class Bounds(NamedTuple):
    """Numbers: lbx ≤ x ≤ ubx, lbg ≤ constraints ≤ ubg."""

    lbx: Number
    ubx: Number
    lbg: Number
    ubg: Number


def larger(a: ca.MX, b: ca.MX) -> ca.MX:
    """The larger of two numbers, and NaN if one is, which `fmax` would overlook."""
    return (a + b + ca.fabs(a - b)) / 2
