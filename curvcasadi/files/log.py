"""Logs of sensors: CSV files of any length, read line by line.

Errors read `path: line 17, column gyro_1_y: expected …, found …`.
"""

from __future__ import annotations

import csv
import math
import reprlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from io import BufferedReader
from pathlib import Path
from typing import NamedTuple

from curvcasadi.files.csv_reader import CsvTable

LONGEST_LINE = 1 << 20  #: bytes; what holds no line ends is no log


class LogRow(NamedTuple):
    """A line of a log."""

    line: int  #: its number; 1 is the header
    end: int  #: bytes of the file up to here
    time: float  #: s
    values: list[float]  #: in the order of the columns asked for; NaN is a missing sample


@dataclass(frozen=True)
class _Log:
    path: Path
    header: list[str]
    order: list[int]  #: places of time and of the columns asked for
    size: int  #: bytes of the header

    def error(self, line: int, message: str, place: int | None = None) -> ValueError:
        column = "" if place is None else f", column {self.header[place]}"
        return ValueError(f"{self.path}: line {line}{column}: {message}")


def read_log(
    path: str | Path, columns: Sequence[str], warn: Callable[[str], None]
) -> Iterator[LogRow]:
    """Rows of a log; its first line names the columns: time, s, and `columns`, in any order.

    An empty cell, or nan, is a missing sample. Times increase from line to line. Empty lines count
    for nothing. The last line of a log that was cut off is left out with a warning: one without a
    line end, whose last number may lack digits, one with too few cells, and one whose last cell is
    no more than the beginning of a number.

    Parameters
    ----------
    columns : besides time
    warn : called with what a user should know

    Raises
    ------
    ValueError
        If the header lacks a column or has an unknown one; while iterating, for a wrong line, or if
        there is no sample.
    OSError
        If the file cannot be read.
    """
    path = Path(path)
    try:
        file = path.open("rb")
    except OSError as error:
        raise type(error)(f"{path}: expected a readable file, found: {error.strerror}") from None
    try:
        return _rows(file, _log(path, file.readline(LONGEST_LINE), ["time", *columns]), warn)
    except ValueError:
        file.close()
        raise


def _log(path: Path, raw: bytes, columns: list[str]) -> _Log:
    text = _text(path, 1, raw.removeprefix(b"\xef\xbb\xbf"))
    header = [name.strip() for name in _cells(text)]
    fault = CsvTable(path, header, []).faults(columns)
    if not text.strip():
        fault = "an empty line or file"
    elif all(_is_number(name) for name in header):
        fault = "only numbers"
    elif len(header) < len(columns) == len(text.split(";")):
        fault = "semicolons between them: write commas, and points in numbers"
    elif len(header) < len(columns) == len(text.split("\t")):
        fault = "tabs between them: write commas"
    if fault:
        raise ValueError(
            f"{path}: line 1: expected names of columns, found {fault}; all columns expected: "
            f"{','.join(columns)}"
        )
    return _Log(path, header, [header.index(name) for name in columns], len(raw))


def _rows(file: BufferedReader, log: _Log, warn: Callable[[str], None]) -> Iterator[LogRow]:
    before, line, end = -math.inf, 1, log.size
    with file:
        while raw := file.readline(LONGEST_LINE):
            line, end = line + 1, end + len(raw)
            if (fault := _cut(log, raw)) and not file.peek(1):
                if before == -math.inf:
                    raise log.error(line, f"{fault}, and no sample before")
                warn(
                    f"{log.path}: line {line}: {fault}; the last line is left out, as it seems cut "
                    "off: if it is whole, end it with a line end"
                )
                break
            text = _text(log.path, line, raw)
            if not text.strip():
                continue
            time, *values = _numbers(log, line, text)
            _check_time(log, line, time, before)
            before = time
            yield LogRow(line, end, time, values)
    if before == -math.inf:
        raise log.error(line + 1, "expected a sample, found the end of the file")


def _cut(log: _Log, raw: bytes) -> str:
    """What makes a line look cut off; nothing for one that does not."""
    if not raw.endswith(b"\n"):
        return "expected a line end, found none"
    if not raw.strip():
        return ""
    commas, last = raw.count(b","), raw[raw.rfind(b",") + 1 :].strip().decode("latin-1")
    if commas + 1 < len(log.header):
        return f"expected {len(log.header)} cells, found {commas + 1}"
    beginning = "nan".startswith(last.lower()) or _is_number(last + "0")
    if last and beginning and not _is_number(last):
        return f"expected a number at the end, found {last!r}"
    return ""


def _text(path: Path, line: int, raw: bytes) -> str:
    if len(raw) == LONGEST_LINE:
        raise ValueError(f"{path}: line {line}: expected a CSV file, found {len(raw)} bytes a line")
    try:
        text = raw.decode("utf-8")
    except UnicodeDecodeError as error:
        raise ValueError(
            f"{path}: line {line}: expected UTF-8 text, found the byte "
            f"0x{raw[error.start]:02x} as character {error.start + 1} of the line"
        ) from None
    if "\0" in text:
        raise ValueError(f"{path}: line {line}: expected text, found a zero byte")
    return text


def _cells(text: str) -> list[str]:
    return next(csv.reader([text]), []) if '"' in text else text.split(",")


def _numbers(log: _Log, line: int, text: str) -> list[float]:
    """Numbers of a line, in the order asked for."""
    cells = _cells(text)
    if len(cells) != len(log.header):
        raise log.error(line, f"expected {len(log.header)} cells, as in line 1, found {len(cells)}")
    try:
        numbers = [float(cells[k]) for k in log.order]
        plain = _is_plain(text)
    except ValueError:
        plain = False
    if not plain:
        numbers = [_number(log, line, k, cells[k].strip()) for k in log.order]
    if math.inf in numbers or -math.inf in numbers:
        place = log.order[[math.isinf(number) for number in numbers].index(True)]
        message = "expected a finite number, or an empty cell for a missing sample, found "
        raise log.error(line, f"{message}{cells[place].strip()!r}", place)
    return numbers


def _number(log: _Log, line: int, place: int, text: str) -> float:
    if not text:
        return math.nan
    if not _is_number(text):
        expected = "expected a number, or an empty cell for a missing sample"
        raise log.error(line, f"{expected}, found {reprlib.repr(text)}", place)
    return float(text)


def _is_plain(text: str) -> bool:
    """Whether what Python reads as a number is one in other programs, too: no 1_000, no digits of
    other scripts."""
    return text.isascii() and "_" not in text


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return _is_plain(text)


def _check_time(log: _Log, line: int, time: float, before: float) -> None:
    if not time > before:
        if math.isnan(time):
            raise log.error(line, "expected a time, s, found a missing one", log.order[0])
        found = f"found {time!r}: sort the lines by time, each time once"
        expected = f"expected above {before!r} s, the time of the sample before"
        raise log.error(line, f"{expected}, {found}", log.order[0])
