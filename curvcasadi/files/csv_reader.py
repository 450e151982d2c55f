"""Checked reading of CSV: errors read `path: line 3, column q0: expected …, found …`."""

from __future__ import annotations

import csv
import math
import reprlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from curvcasadi.files.toml_reader import read_text

_SEPARATORS = {";": "semicolons", "\t": "tabs"}


@dataclass(frozen=True)
class CsvHeader:
    """The first line of a CSV file, by which the lines below it are read."""

    path: Path
    columns: list[str]

    @staticmethod
    def of(path: Path, text: str) -> CsvHeader:
        """The header that `text` is."""
        return CsvHeader(path, [name.strip() for name in cells(text)])

    def error(self, line: int, message: str, column: str = "") -> ValueError:
        """The error of a line, or of what stands there in a column."""
        where = f", column {column}" if column else ""
        return ValueError(f"{self.path}: line {line}{where}: {message}")

    def faults(self, required: Sequence[str], optional: Sequence[str] = ()) -> str:
        """What is wrong with the columns: missing, unknown or repeated ones; or nothing."""
        columns = self.columns
        missing = [name for name in required if name not in columns]
        unknown = [name for name in columns if name not in (*required, *optional)]
        repeated = sorted({name for name in columns if columns.count(name) > 1})
        found = {"no": missing, "the unknown": unknown, "twice": repeated}
        texts = [f"{fault} {', '.join(names)}" for fault, names in found.items() if names]
        if texts and len(columns) == 1 and (mark := _separator(columns[0])):
            texts.append(f"columns separated by {mark}, not by commas")
        return "; ".join(texts)

    def cells(self, line: int, text: str) -> list[str]:
        """The cells of a line, one for each column."""
        found = cells(text)
        if len(found) != len(self.columns):
            expected = f"{len(self.columns)} cells, as in line 1"
            raise self.error(line, f"expected {expected}, found {len(found)}")
        return found

    def number(self, line: int, column: str, text: str, *, missing: bool = False) -> float:
        """A cell as a finite number; with `missing` an empty one, or nan, is NaN."""
        text = text.strip()
        value = _number(text) if text else math.nan
        if math.isfinite(value) or (missing and text.lower() in ("", "nan", "+nan", "-nan")):
            return value
        also = ", or an empty cell for a missing sample" if missing else ""
        raise self.error(
            line, f"expected a finite number{also}, found {reprlib.repr(text)}", column
        )


@dataclass(frozen=True)
class CsvTable:
    """Texts of a CSV file; row k stands in line k + 2."""

    header: CsvHeader
    lines: list[str]

    def row(self, k: int) -> dict[str, str]:
        """The texts of row `k` by column."""
        found = self.header.cells(k + 2, self.lines[k])
        return dict(zip(self.header.columns, (text.strip() for text in found), strict=True))

    def error(self, k: int, column: str, message: str) -> ValueError:
        """The error of what stands at row `k` of `column`."""
        return self.header.error(k + 2, message, column)

    def number(self, k: int, column: str, text: str) -> float:
        """`text`, which stands at row `k` of `column`, as a finite number."""
        return self.header.number(k + 2, column, text)


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
    first, *lines = read_text(path).rstrip().splitlines() or [""]
    return CsvTable(CsvHeader.of(path, first), lines)


def cells(text: str) -> list[str]:
    """The cells of a line; none of an empty one."""
    return next(csv.reader([text]), []) if '"' in text or not text else text.split(",")


def is_plain(text: str) -> bool:
    """Whether what Python reads as a number is one in other programs, too: no 1_000, no digits of
    other scripts."""
    return text.isascii() and "_" not in text


def is_number(text: str) -> bool:
    """Whether a cell holds a number, nan and inf included."""
    return not math.isnan(_number(text)) or text.strip().lower().lstrip("+-") == "nan"


def _separator(text: str) -> str:
    """What separates the columns of a line without commas, in words; or nothing."""
    return next((name for mark, name in _SEPARATORS.items() if mark in text), "")


def _number(text: str) -> float:
    """A number; NaN for what is none."""
    try:
        return float(text) if is_plain(text) else math.nan
    except ValueError:
        return math.nan
