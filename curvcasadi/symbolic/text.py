"""Values as text on a screen: numbers, symbols and functions in a line, descriptions, tables."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from curvcasadi.symbolic.expressions import Number, is_numeric

WIDTH = 100  #: of a line at most
_LONGEST_SYMBOL = 40
_MOST_ENTRIES = 60  #: of an array that is written out
_PLAIN: Any = {"float_kind": lambda x: f"{x:.5g}", "int": str}


def shown(value: Any, unit: str = "") -> str:
    """A physical quantity in words: numbers with their unit, symbols by name.

    A function of xi is shown by its values at the root and the tip.
    """
    if value is None:
        return "none"
    if callable(value) and is_numeric(value):
        ends = (shown(value(xi), unit) for xi in (0.0, 1.0))
        return "{} at the root, {} at the tip".format(*ends)
    return f"{_plain(value)} {unit}".rstrip()


def _plain(value: Number) -> str:
    if not is_numeric(value):
        text = " ".join(str(value).split())
        size = "x".join(map(str, value.shape))
        return text if len(text) <= _LONGEST_SYMBOL else f"{size} symbolic expression"
    array = np.squeeze(np.asarray(value, dtype=object if _holds_symbols(value) else float))
    if array.dtype == object:
        return f"[{', '.join(map(_plain, array.ravel()))}]"
    if array.ndim == 0:
        return f"{float(array):.5g}"
    array = np.where(array == 0, 0.0, array)  # no minus sign before a zero
    return np.array2string(
        array,
        separator=", ",
        threshold=_MOST_ENTRIES,
        max_line_width=10 * WIDTH,
        formatter=_PLAIN,
    ).replace("\n", "")


def _holds_symbols(value: Any) -> bool:
    return isinstance(value, (list, tuple)) and not all(map(is_numeric, value))


def grouped(labels: Iterable[str]) -> str:
    """Labels in a line, those that differ by a number at their end together."""
    groups: dict[str, list[str]] = {}
    for label in labels:
        stem, number = re.fullmatch(r"(.*?)(\d*)", label, re.DOTALL).groups()  # type: ignore[union-attr]
        groups.setdefault(stem, []).append(number)
    return ", ".join(
        stem + (numbers[0] if len(numbers) == 1 else f"{numbers[0]} to {numbers[-1]}")
        for stem, numbers in groups.items()
    )


def described(title: str, rows: Mapping[str, str]) -> str:
    """A title, and below it names and values in two columns, broken to the width of a screen."""
    width = max((len(name) for name in rows), default=0) + 4
    lines = textwrap.wrap(title, WIDTH, subsequent_indent="  ", break_on_hyphens=False)
    for name, value in rows.items():
        first, rest = f"  {name:<{width - 2}}", " " * width
        for part in value.split("\n"):
            lines += textwrap.wrap(
                part, WIDTH, initial_indent=first, subsequent_indent=rest, break_on_hyphens=False
            )
            first = rest
    return "\n".join(lines)


def table(rows: Sequence[Mapping[str, str]]) -> str:
    """Rows of texts below the names of their columns, flush right; all rows have the same names."""
    if not rows:
        return ""
    widths = {key: max(len(key), *(len(row[key]) for row in rows)) for key in rows[0]}
    lines = [dict(zip(widths, widths, strict=True)), *rows]
    return "\n".join(
        "  ".join(line[key].rjust(width) for key, width in widths.items()) for line in lines
    )
