"""What the weights in a state are functions of: quantities along the span of a wing."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.polynomial import legendre

from curvcasadi.aero.air_states import StateParts
from curvcasadi.aero.lag_states import SpanFunctions
from curvcasadi.symbolic.expressions import Array

#: Gauss points for each interval between breaks, beyond the number of weights.
_MORE_POINTS = 4


class Span(Protocol):
    """Weights of a quantity along the span: values at stations are ``at(xi) @ weights``.

    Attributes
    ----------
    quantity : str
        What it is.
    rate : float or None
        Of the pole that a state of the air follows; None of everything else.
    size : int
        Number of weights.
    """

    @property
    def quantity(self) -> str: ...
    @property
    def rate(self) -> float | None: ...
    @property
    def size(self) -> int: ...
    @property
    def is_pointwise(self) -> bool:
        """Whether the weights are values at stations."""
        ...

    @property
    def points(self) -> tuple[Array, Array]:
        """Stations that resolve it, and the share of the span of each."""
        ...

    def at(self, xi: Array) -> Array:
        """Values at stations, stacked, by the weights."""
        ...


@dataclass(frozen=True, eq=False, kw_only=True)
class CurvatureSpan:
    """Curvature, or its rate, of weights of a basis."""

    quantity: str
    basis: Any  #: xi -> (3, n)
    rate: None = None

    @property
    def size(self) -> int:
        """Number of weights."""
        return int(self.basis.n)

    @property
    def is_pointwise(self) -> bool:
        """Weights are no values at stations."""
        return False

    @property
    def points(self) -> tuple[Array, Array]:
        """Gauss points between the breaks of the basis."""
        nodes, weights = legendre.leggauss(self.size + _MORE_POINTS)
        ends = np.array([0.0, *self.basis.breaks, 1.0])
        lengths = np.diff(ends)
        xi = ends[:-1, None] + lengths[:, None] * (1 + nodes) / 2
        return xi.ravel(), (lengths[:, None] * weights / 2).ravel()

    def at(self, xi: Array) -> Array:
        """K_x, K_y, K_z at each station."""
        return np.vstack([np.asarray(self.basis(float(x)), dtype=float) for x in xi])


def curvature_spans(basis: Any, wing: str = "") -> dict[str, tuple[Span, ...]]:
    """Spans of the parts q and q_dot of a beam, or of a wing of an aircraft, by their names."""
    suffix = f"_{wing}" if wing else ""
    return {
        f"{part}{suffix}": (CurvatureSpan(quantity=quantity, basis=basis),)
        for part, quantity in (("q", "curvature"), ("q_dot", "rate of curvature"))
    }


@dataclass(frozen=True, eq=False, kw_only=True)
class AirSpan:
    """States of the air that follow one pole: Legendre functions, or a state a station."""

    quantity: str
    rate: float
    functions: SpanFunctions
    stations: Array
    measures: Array

    @property
    def size(self) -> int:
        """Number of states."""
        return int(self.functions.values.shape[1])

    @property
    def is_pointwise(self) -> bool:
        """Whether there is a state for each station."""
        identity = np.eye(len(self.stations))
        return self.size == len(identity) and bool(np.array_equal(self.functions.values, identity))

    @property
    def points(self) -> tuple[Array, Array]:
        """The aerodynamic stations."""
        return self.stations, self.measures

    def at(self, xi: Array) -> Array:
        """Values at stations; between stations that have states of their own linear ones."""
        if self.is_pointwise:
            columns = [np.interp(xi, self.stations, one) for one in np.eye(len(self.stations))]
            return np.column_stack(columns)
        return np.asarray(legendre.legvander(2 * np.asarray(xi) - 1, self.size - 1), dtype=float)


def air_spans(states: StateParts) -> tuple[Span, ...]:
    """Spans of the states of an unsteady load, pole by pole."""
    xi, measures = np.array(states.stations, dtype=float).T
    groups = (
        ("lag of the circulation", states.lag, states.of_lag),
        ("entry into a gust", states.entry, states.of_entry),
    )
    return tuple(
        AirSpan(quantity=quantity, rate=rate, functions=functions, stations=xi, measures=measures)
        for quantity, rates, functions in groups
        for rate in rates
    )
