"""Quantities along the span: numbers, symbols, tables, and functions of xi = s/L."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from curvcasadi.symbolic.expressions import (
    AnyExpr,
    copied,
    expression,
    increasing_stations,
    is_numeric,
    numbers,
    own_fields,
    sequence,
)

#: (name, value) -> the value as it is used, or a ValueError that begins with the name.
Check: TypeAlias = Callable[[str, Any], Any]


@dataclass(frozen=True, eq=False)
class Piecewise:
    """A table of a quantity along the span: constant between stations, or linear.

    As many values as intervals make the quantity constant in each interval, as many values as
    stations make it linear between them. A station that stands twice in a linear table is a jump.

    Attributes
    ----------
    xi : array, shape (m + 1,)
        Stations s/L from 0 to 1, increasing.
    values : sequence
        Of m or m + 1 values, of any shape; numbers or symbols.
    """

    xi: Sequence[float]
    values: Sequence[Any]

    def __post_init__(self) -> None:
        name = type(self).__name__
        own_fields(self)
        xi = increasing_stations(f"{name}.xi", self.xi)
        sequence(f"{name}.values", self.values)
        self._check_number(name, len(xi))
        # What rounding alone made two stations is one; in a linear table inside the span, a jump.
        rounded = (np.diff(xi) == 0) & (np.diff(numbers(f"{name}.xi", self.xi)) != 0)
        if self.linear:
            before, after = [*(rounded & (xi[1:] == 1)), False], [False, *(rounded & (xi[1:] == 0))]
            kept = values = np.flatnonzero(~np.logical_or(before, after))
        else:
            values = np.flatnonzero(~rounded)
            kept = np.append(values, len(xi) - 1)
        _, times = np.unique(xi[kept], return_counts=True)
        if times.max() > 1 + (self.linear and times[0] == times[-1] == 1):
            raise ValueError(f"{name}.xi: expected increasing stations, found {xi.tolist()}")
        object.__setattr__(self, "xi", xi[kept])
        object.__setattr__(self, "values", tuple(self.values[int(k)] for k in values))

    def _check_number(self, name: str, stations: int) -> None:
        if len(self.values) not in (stations - 1, stations):
            raise ValueError(
                f"{name}.values: expected {stations - 1} values, one per interval, or {stations}, "
                f"one per station, found {len(self.values)}"
            )

    @property
    def linear(self) -> bool:
        """Whether the quantity is linear between its stations."""
        return len(self.values) == len(self.xi)

    @property
    def breaks(self) -> tuple[float, ...]:
        """Where the quantity or its slope jumps."""
        return tuple(dict.fromkeys(float(x) for x in np.asarray(self.xi)[1:-1]))

    def __call__(self, xi: float) -> Any:
        k = int(np.searchsorted(np.asarray(self.xi)[1:-1], xi, side="right"))
        if not self.linear:
            return self.values[k]
        left, right = (v if not is_numeric(v) else np.asarray(v) for v in self.values[k : k + 2])
        part = (xi - self.xi[k]) / (self.xi[k + 1] - self.xi[k])
        return left * (1 - part) + right * part


class Steps(Piecewise):
    """A quantity that is constant between jumps: for tables of section data.

    Attributes
    ----------
    xi : array, shape (m + 1,)
        Stations s/L from 0 to 1, increasing.
    values : sequence
        Of m values, one per interval, of any shape; numbers or symbols.
    """

    def _check_number(self, name: str, stations: int) -> None:
        if len(self.values) != stations - 1:
            raise ValueError(
                f"{name}.values: expected {stations - 1} values, one per interval, "
                f"found {len(self.values)}"
            )


@dataclass(frozen=True, eq=False)
class Along:
    """A quantity that may vary along the span, with what its values must fulfil.

    A number or symbol is checked at once; a function of xi where it is evaluated. It is itself a
    function of xi with `breaks`, as a field of a description may be.
    """

    name: str  #: of the quantity, which errors begin with
    source: Any  #: number, array, symbol, `Piecewise`, or a function of xi that may have `breaks`
    check: Check

    def __post_init__(self) -> None:
        if not self.varies:
            object.__setattr__(self, "source", self.check(self.name, copied(self.source)))

    @property
    def varies(self) -> bool:
        """Whether the quantity is a function of xi."""
        return callable(self.source)

    @property
    def value(self) -> Any:
        """The checked number or symbol, or this function of xi."""
        return self if self.varies else self.source

    @property
    def breaks(self) -> tuple[float, ...]:
        """Where the quantity jumps."""
        return breaks_of(self.source)

    def __call__(self, xi: float) -> Any:
        if not self.varies:
            return self.source
        return self.check(f"{self.name} at xi = {xi:g}", self.source(xi))


def is_table(value: Any) -> bool:
    """Whether a quantity is a table, mirrored or not, and smooth between its breaks."""
    while hasattr(value, "source"):
        value = value.source
    return isinstance(value, Piecewise)


def breaks_of(*sources: Any) -> tuple[float, ...]:
    """The `breaks` of all `sources` that have any, sorted."""
    return tuple(sorted({float(x) for source in sources for x in getattr(source, "breaks", ())}))


def mapped(value: Any, change: Callable[[Any], Any]) -> Any:
    """`change` of a quantity, at every station where it is a function of xi; None stays None."""
    if value is None or not callable(value):
        return None if value is None else change(value)
    return Along("", value, _Change(change))


@dataclass(frozen=True, eq=False)
class _Change:
    """What `mapped` makes of a value, as a `Check` that can be pickled."""

    change: Callable[[Any], Any]

    def __call__(self, name: str, value: Any) -> Any:
        return self.change(value)


def scalar(name: str, value: Any) -> AnyExpr:
    """`value` as an expression (1, 1)."""
    return expression(name, value, (1, 1))


def vector(name: str, value: Any) -> AnyExpr:
    """`value` as an expression (3, 1)."""
    return expression(name, value, (3, 1))
