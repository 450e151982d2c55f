"""Warnings of values whose size suggests another unit."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np

from curvcasadi.symbolic.expressions import is_numeric


def warn_of_size(name: str, value: Any, largest: float, unit: str, advice: str) -> None:
    """Warn of a number, or the values of a table, beyond `largest`; symbols are let be."""
    worst = float(np.max(np.abs(sizes(value)), initial=0.0))
    if worst > largest:
        warnings.warn(
            f"{name}: {worst:g} {unit} is implausibly large; {advice}", UserWarning, stacklevel=4
        )


def sizes(value: Any) -> Any:
    """Numbers (k,) of a number or a table; none of a symbol or another function."""
    values = getattr(value, "values", None) if callable(value) else value
    if values is None or callable(values) or not is_numeric(values):
        return np.zeros(0)
    try:
        return np.asarray(values, dtype=float).ravel()
    except (TypeError, ValueError):
        return np.zeros(0)
