"""Inputs that a function may meet and should not fall over: ordinary ones, and those gone wrong."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from curvcasadi.symbolic.expressions import BOUND_SLACK

#: Parts of the calls of each kind.
KINDS = {
    "ordinary": 0.4,
    "at bounds": 0.1,
    "slightly outside": 0.05,
    "one entry not finite": 0.1,
    "one entry out of range": 0.05,
    "some entries strange": 0.1,
    "any entry strange": 0.05,
    "far away": 0.1,
    "all 1e6 times too large": 0.05,
}


def draw(random: Any, calls: int) -> Any:
    """Kinds of `calls` calls, by their place in KINDS."""
    return random.choice(len(KINDS), calls, p=list(KINDS.values()))


def spoil(
    random: Any,
    kinds: Any,
    ordinary: Mapping[str, Any],
    bounds: Mapping[str, tuple[Any, Any]],
    kind: type,
) -> dict[str, Any]:
    """`ordinary` inputs, a call a row, gone wrong by their `kinds`; numbers of the type `kind`.

    Parameters
    ----------
    bounds : of the inputs that have any
    """
    inputs = {key: np.array(values, dtype=kind) for key, values in ordinary.items()}
    names = list(KINDS)
    one = {key: _one_entry(random, inputs)[key] for key in inputs}
    for key, values in inputs.items():
        lower, upper = (
            np.broadcast_to(np.asarray(side, dtype=kind), values.shape)
            for side in bounds.get(key, (-np.inf, np.inf))
        )
        bounded = key in bounds

        def of(name: str, part: Any = True) -> Any:
            chosen = (kinds == names.index(name))[:, None] & part
            return np.broadcast_to(chosen, values.shape)  # noqa: B023

        def put(where: Any, what: Any) -> None:
            values[where] = np.broadcast_to(what, values.shape)[where]  # noqa: B023

        side = np.where(random.random(values.shape) < 0.5, lower, upper)
        half = random.random(values.shape) < 0.5
        with np.errstate(over="ignore", invalid="ignore"):
            if bounded:
                put(of("at bounds", half), side)
                beyond = np.where(half, np.nextafter(side, 2 * side), kind(1.001) * side)
                put(of("slightly outside", one[key]), beyond)
            put(of("one entry not finite", one[key]), _pick(random, _not_finite(kind), values))
            put(of("one entry out of range", one[key]), _pick(random, _huge(kind), values))
            mild = [*_tiny(kind), *(() if bounded else _huge(kind))]
            some = random.random(values.shape) < 0.3
            put(of("some entries strange", some), _pick(random, mild, values))
            strange = [*_tiny(kind), *_huge(kind), *_not_finite(kind)]
            rarely = random.random(values.shape) < 3 / values.shape[1]
            put(of("any entry strange", rarely), _pick(random, strange, values))
            if not bounded:
                far = 10 ** random.uniform(-1, 4, (len(values), 1))
                turned = random.normal(size=values.shape)
                put(of("far away"), np.where(half[:, :1], values * far, turned * far))
            put(of("all 1e6 times too large"), values * kind(1e6))
    return inputs


def bad(inputs: Mapping[str, Any], bounds: Mapping[str, tuple[Any, Any]]) -> Any:
    """Which calls have an entry that is not finite, or weights beyond their bounds.

    Of a bound `BOUND_SLACK` is allowed, in Python and in C.
    """
    found = np.zeros(len(next(iter(inputs.values()))), dtype=bool)
    for key, values in inputs.items():
        found |= ~np.isfinite(values).all(axis=1)
        if key in bounds:
            slack = BOUND_SLACK["float" if values.dtype == np.float32 else "double"]
            lower, upper = (np.asarray(side, dtype=values.dtype) for side in bounds[key])
            lower = lower - slack * np.maximum(1, np.abs(lower))
            upper = upper + slack * np.maximum(1, np.abs(upper))
            found |= ~((values >= lower) & (values <= upper)).all(axis=1)
    return found


def _one_entry(random: Any, inputs: Mapping[str, Any]) -> dict[str, Any]:
    """Masks with one entry of each call set, in one of its inputs."""
    widths = [values.shape[1] for values in inputs.values()]
    calls = len(next(iter(inputs.values())))
    entries = np.arange(sum(widths)) == random.integers(sum(widths), size=(calls, 1))
    parts = np.split(entries, np.cumsum(widths)[:-1], axis=1)
    return dict(zip(inputs, parts, strict=True))


def _pick(random: Any, what: Any, like: Any) -> Any:
    return random.choice(np.array(what, dtype=like.dtype), like.shape)


def _not_finite(kind: type) -> tuple[Any, ...]:
    return (np.nan, np.inf, -np.inf)


def _huge(kind: type) -> tuple[Any, ...]:
    largest = np.finfo(kind).max
    return (largest, -largest, 1e30, -1e15, 1e6, np.sqrt(largest))


def _tiny(kind: type) -> tuple[Any, ...]:
    smallest = np.finfo(kind).smallest_subnormal
    return (0.0, -0.0, smallest, -smallest, np.finfo(kind).tiny / 3, np.finfo(kind).tiny)
