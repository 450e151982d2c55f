"""Checked reading of CSV: errors read `path: line 3, column q0: expected …, found …`."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from curvcasadi.files.toml_reader import read_text


@dataclass(frozen=True)
class CsvTable:
    """Texts of a CSV file; row k stands in line k + 2."""

    path: Path
    header: list[str]
    rows: list[list[str]]

    def row(self, k: int) -> dict[str, str]:
        """The texts of row `k` by column."""
        found = self.rows[k]
        if len(found) != len(self.header):
            raise ValueError(
                f"{self.path}: line {k + 2}: expected {len(self.header)} values "
                f"({', '.join(self.header)}), found {len(found)}"
            )
        return dict(zip(self.header, (text.strip() for text in found), strict=True))

    def error(self, k: int, column: str, message: str) -> ValueError:
        return ValueError(f"{self.path}: line {k + 2}, column {column}: {message}")

    def number(self, k: int, column: str, text: str) -> float:
        """`text`, which stands at row `k` of `column`, as a finite number."""
        try:
            value = float(text)
        except ValueError:
            value = np.nan
        if not np.isfinite(value):
            raise self.error(k, column, f"expected a finite number, found {text!r}")
        return value

    def faults(self, required: Sequence[str], optional: Sequence[str] = ()) -> str:
        """What is wrong with the header: columns missing, unknown or repeated; or nothing."""
        header = self.header
        missing = [name for name in required if name not in header]
        unknown = [name for name in header if name not in (*required, *optional)]
        repeated = sorted({name for name in header if header.count(name) > 1})
        found = {"no": missing, "the unknown": unknown, "twice": repeated}
        return "; ".join(f"{fault} {', '.join(names)}" for fault, names in found.items() if names)


def load_csv(path: str | Path) -> CsvTable:
    """The texts of a CSV file; its first line names the columns.

    Raises
    ------
    ValueError
        If the file is no text.
    OSError
        If it cannot be read.
    """
    path = Path(path)
    # Line by line: a line break within quotes would hide which line a row stands in.
    lines = [next(csv.reader([line]), []) for line in read_text(path).rstrip().splitlines()]
    header = [name.strip() for name in lines[0]] if lines else []
    return CsvTable(path, header, lines[1:])
