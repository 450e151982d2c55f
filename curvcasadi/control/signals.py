"""States, times and signals as users give them, checked."""

from __future__ import annotations

from collections.abc import Callable, Container, Mapping
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from curvcasadi.symbolic.expressions import Array, Number, numbers
from curvcasadi.symbolic.layout import Layout, Part

#: An input or parameter over time: numbers (n,) that are held, columns (n, T) of which each is held
#: from its time to the next, values by part, or a function of the time, s. None is zero of inputs,
#: the nominal value of parameters.
Signal: TypeAlias = Number | Mapping[str, Number] | Callable[[float], Number] | None
#: What a quaternion's length may differ from 1 before it is refused; it is normalized then.
LENGTH_TOLERANCE = 1e-6
#: What an input may be beyond its bounds, relative to them or absolute.
BOUND_TOLERANCE = 1e-6


def stacked(name: str, layout: Layout, value: Number | Mapping[str, Number] | None) -> Array:
    """A vector (layout.size,) from numbers or parts by name.

    Parts that a mapping leaves out are zero, attitudes the identity. Quaternions are normalized.

    Raises
    ------
    ValueError
        If a part is unknown, a size is wrong, or a quaternion is far from unit length.
    """
    if value is None or isinstance(value, Mapping):
        given = {} if value is None else value
        _known(name, layout, given)
        pieces = [
            _column(f"{name}[{part.name!r}]", part.size, given[part.name])
            if part.name in given
            else _neutral(part)
            for part in layout.parts
        ]
        vector = np.concatenate([np.zeros(0), *pieces])
    else:
        vector = _column(name, layout.size, value)
    for part in layout.parts:
        if part.attitude:
            rows = layout.slices[part.name]
            length = float(np.linalg.norm(vector[rows]))
            if abs(length - 1) > LENGTH_TOLERANCE:
                raise ValueError(
                    f"{name}: expected the unit quaternion {part.name}, "
                    f"found one of length {length:g}"
                )
            vector[rows] /= length
    return vector


def two_sides(name: str, pair: Any, size: int) -> tuple[Array, Array]:
    """Bounds (size,) of a pair (lower, upper) of numbers or arrays, infinite ones allowed."""
    try:
        low, high = (np.asarray(side, dtype=float) for side in pair)
        sides = [np.array(np.broadcast_to(side, (size,))) for side in (low, high)]
    except (TypeError, ValueError):
        raise ValueError(
            f"{name}: expected a pair (lower, upper) of numbers or arrays ({size},), found {pair!r}"
        ) from None
    lower, upper = sides
    if np.any(np.isnan(lower)) or np.any(np.isnan(upper)):
        raise ValueError(f"{name}: expected numbers, found NaN in {pair!r}")
    if np.any(lower > upper):
        raise ValueError(f"{name}: expected lower ≤ upper, found {pair!r}")
    if np.any(lower == np.inf) or np.any(upper == -np.inf):
        raise ValueError(f"{name}: expected bounds that a number can meet, found {pair!r}")
    return lower, upper


def with_nominal(name: str, layout: Layout, value: Any, elsewhere: Container[str] = ()) -> Any:
    """Parameters by name with the nominal values of those that are not given.

    Anything but a mapping or None holds all parameters, and comes back as it is. Those that are
    `elsewhere` need no value.

    Raises
    ------
    ValueError
        If a part is unknown, or one without a nominal value is not given; all of these are named.
    """
    if not (value is None or isinstance(value, Mapping)):
        return value
    given = {key: part for key, part in (value or {}).items() if part is not None}
    _known(name, layout, given)
    left = [part for part in layout.parts if part.name not in given and part.name not in elsewhere]
    missing = [part for part in left if part.nominal is None]
    if missing:
        names = ", ".join(f"{part.name} ({part.unit})" for part in missing)
        hint = ", ".join(f"{part.name!r}: …" for part in missing)
        raise ValueError(
            f"{name}: expected {names}, which the model has no nominal value of, found none; give "
            f"{name}={{{hint}}}"
        )
    nominal = {part.name: np.broadcast_to(numbers(name, part.nominal), part.size) for part in left}
    return {**nominal, **given}


def increasing(name: str, times: Number, what: str = "times, s") -> Array:
    """At least two numbers (T,) that increase; `what` they are stands in errors."""
    grid = numbers(name, times)
    if grid.ndim > 2 or (grid.ndim == 2 and 1 not in grid.shape):
        raise ValueError(f"{name}: expected a list of {what}, found shape {grid.shape}")
    grid = grid.ravel()
    if grid.size < 2:
        raise ValueError(
            f"{name}: expected at least two {what.partition(',')[0]}, found {grid.size}"
        )
    behind = np.flatnonzero(np.diff(grid) <= 0)
    if behind.size:
        k = int(behind[0])
        raise ValueError(
            f"{name}: expected increasing {what}, found {grid[k + 1]:g} after {grid[k]:g}"
        )
    return grid


@dataclass(frozen=True)
class Course:
    """A signal as a function of the interval that holds a time, and the time."""

    value: Callable[[int, float], Array]
    held: bool  #: whether it is the same at all times of an interval

    def __call__(self, k: int, t: float) -> Array:
        return self.value(k, t)


def is_clock(layout: Layout) -> bool:
    """Whether one of the parts is the time."""
    return any(part.name == "time" and part.unit == "s" for part in layout.parts)


def with_time(layout: Layout, value: Signal) -> Signal:
    """Parameters whose part "time", s, is the time, unless they say otherwise."""
    if not is_clock(layout) or not (value is None or isinstance(value, Mapping)):
        return value
    given = {} if value is None else value
    return {"time": lambda time: time, **given}


def over_time(name: str, layout: Layout, value: Signal, times: Array) -> Course:
    """The course of a signal over intervals between `times`.

    Raises
    ------
    ValueError
        If a part is unknown, a size is wrong, or a function does not give numbers of its size.
    """
    if isinstance(value, Mapping):
        _known(name, layout, value)
        parts = [
            _part_over_time(f"{name}[{part.name!r}]", part.size, value.get(part.name), times)
            for part in layout.parts
        ]
        return Course(
            lambda k, t: np.concatenate([np.zeros(0), *(part(k, t) for part in parts)]),
            all(part.held for part in parts),
        )
    return _part_over_time(name, layout.size, value, times)


def within_bounds(name: str, layout: Layout, signal: Course) -> Course:
    """The same signal, which raises a ValueError where it leaves the bounds of its parts.

    Angles without bounds may not be beyond ±π/2, as degrees are.
    """
    lower, upper = (side.copy() for side in layout.bounds)
    units = [part.unit for part in layout.parts for _ in range(part.size)]
    angles = np.array([unit == "rad" for unit in units], dtype=bool)
    lower[angles & np.isinf(lower)], upper[angles & np.isinf(upper)] = -np.pi / 2, np.pi / 2
    # What a solver returns may be beyond a bound by its tolerance.
    room = BOUND_TOLERANCE * np.maximum(1.0, np.where(np.isfinite(upper), np.abs(upper), 1.0))

    def checked(k: int, t: float) -> Array:
        value = signal(k, t)
        outside = np.flatnonzero((value < lower - room) | (value > upper + room))
        if outside.size:
            i = int(outside[0])
            hint = f"; {value[i]:g} degrees are {np.deg2rad(value[i]):.4g} rad" if angles[i] else ""
            when = "" if np.isnan(t) else f" at t = {t:g} s"
            raise ValueError(
                f"{name}: {layout.labels[i]}: expected within {lower[i]:g} to {upper[i]:g}, "
                f"found {value[i]:g}{when}{hint}"
            )
        return value

    return Course(checked, signal.held)


def held_within_bounds(
    name: str, layout: Layout, value: Number | Mapping[str, Number] | None
) -> Array:
    """As `stacked`, of inputs or parameters that stay within their bounds."""
    vector = stacked(name, layout, value)
    return within_bounds(name, layout, Course(lambda k, t: vector, True))(0, np.nan)


def _part_over_time(name: str, size: int, value: Signal, times: Array) -> Course:
    if value is None:
        zero = np.zeros(size)
        return Course(lambda k, t: zero, True)
    if callable(value):
        return Course(lambda k, t: _column(f"{name}({t:g})", size, value(t)), False)
    array = numbers(name, value)
    if (array.size == size and array.ndim < 2) or array.shape == (size, 1):
        held = array.ravel()
        return Course(lambda k, t: held, True)
    if array.shape == (size, len(times)) or (size == 1 and array.shape == (len(times),)):
        columns = array.reshape(size, -1)
        return Course(lambda k, t: columns[:, k], True)
    raise ValueError(
        f"{name}: expected {size} numbers or columns ({size}, {len(times)}), one per time; "
        f"found shape {array.shape}"
    )


def _known(name: str, layout: Layout, given: Mapping[str, Number]) -> None:
    known = [part.name for part in layout.parts]
    for part in given:
        if part not in known:
            raise ValueError(f"{name}: expected parts among {known}, found {part!r}")


def _column(name: str, size: int, value: Number) -> Array:
    array = numbers(name, value)
    if array.size != size or array.ndim > 2 or (array.ndim == 2 and 1 not in array.shape):
        raise ValueError(f"{name}: expected {size} numbers, found shape {array.shape}")
    return array.ravel()


def _neutral(part: Part) -> Array:
    return np.array([1.0, 0, 0, 0]) if part.attitude else np.zeros(part.size)
