"""Rows that sensors contribute to an estimate."""

from __future__ import annotations

from dataclasses import dataclass

from curvcasadi.symbolic.expressions import AnyExpr, Array


@dataclass(frozen=True, eq=False, kw_only=True)
class Rows:
    """Linearized rows of one sensor: 0 = residual + slope · (unknowns, error) + noise."""

    shared: bool  #: whether they depend on unknowns
    together: bool  #: whether a gate lets all through or none
    rows: list[AnyExpr]  #: (unknowns + error + 1, 1) each: slope, residual
    variance: Array  #: (r,)
