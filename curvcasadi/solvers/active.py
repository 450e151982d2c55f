"""Which bounds hold a result, in words."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from curvcasadi.symbolic.expressions import Array


def active_bounds(
    names: Sequence[str],
    values: Array,
    bounds: tuple[Array, Array],
    *,
    tolerance: float,
    least: float = 0.0,
    scales: Array | float = 1.0,
    units: Sequence[str] | None = None,
) -> dict[int, str]:
    """Entries at one of their bounds, in words, by index.

    Parameters
    ----------
    names : (n,)
        What the words call each entry.
    values : (n,)
        Within the bounds, or beyond them by rounding.
    bounds : lower and upper, (n,) each
        Infinite where there is none.
    tolerance : float
        Distance to a bound, over the size of the finite bounds of an entry, at which it holds.
    least : float
        Size that bounds have at least.
    scales : (n,)
        What one of `values` is in the units of the words.
    units : (n,)
        Units of the words, unless the names say them.

    Returns
    -------
    dict
        Such as `{2: "q[2] at its lower bound -0.1 rad/m"}`.
    """
    lower, upper = bounds
    sizes = sum(np.where(np.isfinite(side), np.abs(side), 0.0) for side in bounds)
    margins = tolerance * np.maximum(sizes, least)
    held = {
        "lower": (values - lower <= margins, lower),
        "upper": (upper - values <= margins, upper),
    }
    scales = np.broadcast_to(scales, values.shape)
    return {
        i: f"{names[i]} at its {side} bound {bound[i] * scales[i]:g} "
        f"{units[i] if units else ''}".rstrip()
        for side, (at, bound) in held.items()
        for i in np.flatnonzero(at).tolist()
    }
