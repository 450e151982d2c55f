"""Tables in markdown: rows of counted requirements, or a comparison."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite

#: Headers of a table of requirements.
HEADERS = ("what", "value", "required", "")


@dataclass(frozen=True, kw_only=True)
class Check:
    """A measured value, and the range that it has to be in; without a range, information."""

    what: str
    value: float
    form: str = "{:.3g}"  #: how numbers of this row are written
    low: float | None = None
    high: float | None = None

    @property
    def counted(self) -> bool:
        return self.low is not None or self.high is not None

    @property
    def failed(self) -> bool:
        if not self.counted:
            return False
        low_missed = self.low is not None and self.value < self.low
        high_missed = self.high is not None and self.value > self.high
        return low_missed or high_missed or not isfinite(self.value)

    def cells(self) -> tuple[str, str, str, str]:
        verdict = ("FAIL" if self.failed else "ok") if self.counted else ""
        return self.what, self.form.format(self.value), self._required(), verdict

    def _required(self) -> str:
        low, high = (None if x is None else self.form.format(x) for x in (self.low, self.high))
        if low and high:
            return f"{low} to {high}"
        return f"≥ {low}" if low else f"≤ {high}" if high else ""


@dataclass(frozen=True, kw_only=True)
class Table:
    """Rows of text under a title; `failures` counts the requirements that are not met."""

    title: str
    headers: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    notes: tuple[str, ...] = ()
    failures: int = 0
    requirements: int = 0

    def render(self) -> str:
        lines = [self.headers, *self.rows]
        widths = [max(len(line[k]) for line in lines) for k in range(len(self.headers))]
        rule = "|" + "|".join("-" * (width + 2) for width in widths) + "|"
        body = [_line(line, widths) for line in lines]
        parts = [f"## {self.title}", "", body[0], rule, *body[1:]]
        if self.notes:
            parts += ["", *self.notes]
        return "\n".join(parts)


def checked(title: str, checks: Sequence[Check], notes: Sequence[str] = ()) -> Table:
    """Table of what, value, required, ok or FAIL."""
    return Table(
        title=title,
        headers=HEADERS,
        rows=tuple(check.cells() for check in checks),
        notes=tuple(notes),
        failures=sum(check.failed for check in checks),
        requirements=sum(check.counted for check in checks),
    )


def compared(
    title: str, headers: Sequence[str], rows: Sequence[Sequence[str]], notes: Sequence[str] = ()
) -> Table:
    """Table without requirements."""
    return Table(
        title=title,
        headers=tuple(headers),
        rows=tuple(tuple(row) for row in rows),
        notes=tuple(notes),
    )


def _line(cells: Sequence[str], widths: Sequence[int]) -> str:
    padded = (cell.ljust(width) for cell, width in zip(cells, widths, strict=True))
    return "| " + " | ".join(padded) + " |"
