"""Models as a control engineer sees them: state x, input u, parameter p, output y."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from curvcasadi.symbolic.expressions import (
    Real,
)
from curvcasadi.symbolic.layout import Layout


@dataclass(frozen=True, eq=False, kw_only=True)
class ControlModel:
    """dx/dt = xdot(x, u, p), y = output(x, u, p), in SI units; bounds stand in the layouts."""

    name: str
    x: Layout
    u: Layout
    p: Layout
    y: Layout
    xdot: ca.Function  #: (x, u, p) -> xdot
    output: ca.Function  #: (x, u, p) -> y
    real: Real = "double"  #: arithmetic that it is made for, as in `Grid`
    #: (x) -> squared angles of elements over what they may turn, of those that the bounds of x do
    #: not keep from it
    angles: ca.Function | None = None
