"""Logs of sensors: CSV files of any length, read line by line.

Errors read `path: line 17, column gyro_1_y: expected …, found …`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from io import BufferedReader
from pathlib import Path
from typing import NamedTuple

from curvcasadi.files.csv_reader import CsvHeader, is_number, is_plain

LONGEST_LINE = 1 << 20  #: bytes; what holds no line ends is no log


class LogRow(NamedTuple):
    """A line of a log."""

    line: int  #: its number; 1 is the header
    end: int  #: bytes of the file up to here
    time: float  #: s
    values: list[float]  #: in the order of the columns asked for; NaN is a missing sample


class _Log(NamedTuple):
    header: CsvHeader
    order: list[int]  #: places of time and of the columns asked for
    size: int  #: bytes of the header


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
    header = CsvHeader.of(path, text)
    fault, found = header.faults(columns), header.columns
    if not text.strip():
        fault = "an empty line or file"
    elif all(map(is_number, found)):
        fault = "only numbers"
    elif len(found) < len(columns) == len(text.split(";")):
        fault = "semicolons between them: write commas, and points in numbers"
    elif len(found) < len(columns) == len(text.split("\t")):
        fault = "tabs between them: write commas"
    if fault:
        raise header.error(
            1,
            f"expected names of columns, found {fault}; all columns expected: {','.join(columns)}",
        )
    return _Log(header, [found.index(name) for name in columns], len(raw))


def _rows(file: BufferedReader, log: _Log, warn: Callable[[str], None]) -> Iterator[LogRow]:
    header, before, line, end = log.header, -math.inf, 1, log.size
    with file:
        while raw := file.readline(LONGEST_LINE):
            line, end = line + 1, end + len(raw)
            if (fault := _cut(raw, len(header.columns))) and not file.peek(1):
                if before == -math.inf:
                    raise header.error(line, f"{fault}, and no sample before")
                left_out = "the last line is left out, as it seems cut off"
                whole = "if it is whole, end it with a line end"
                warn(f"{header.error(line, fault)}; {left_out}: {whole}")
                break
            text = _text(header.path, line, raw)
            if not text.strip():
                continue
            time, *values = _numbers(log, line, text)
            _check_time(header, line, time, before)
            before = time
            yield LogRow(line, end, time, values)
    if before == -math.inf:
        raise header.error(line + 1, "expected a sample, found the end of the file")


def _cut(raw: bytes, columns: int) -> str:
    """What makes a line look cut off; nothing for one that does not."""
    if not raw.endswith(b"\n"):
        return "expected a line end, found none"
    if not raw.strip():
        return ""
    commas, last = raw.count(b","), raw[raw.rfind(b",") + 1 :].strip().decode("latin-1")
    if commas + 1 < columns:
        return f"expected {columns} cells, found {commas + 1}"
    beginning = "nan".startswith(last.lower()) or is_number(last + "0")
    if last and beginning and not is_number(last):
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


def _numbers(log: _Log, line: int, text: str) -> list[float]:
    """Numbers of a line, in the order asked for; NaN for missing samples."""
    cells = log.header.cells(line, text)
    try:
        numbers = [float(cells[k]) for k in log.order]
        plain = is_plain(text) and not any(map(math.isinf, numbers))
    except ValueError:
        plain = False
    if plain:
        return numbers
    names = log.header.columns
    return [log.header.number(line, names[k], cells[k], missing=True) for k in log.order]


def _check_time(header: CsvHeader, line: int, time: float, before: float) -> None:
    if not time > before:
        if math.isnan(time):
            raise header.error(line, "expected a time, s, found a missing one", "time")
        found = f"found {time!r}: sort the lines by time, each time once"
        expected = f"expected above {before!r} s, the time of the sample before"
        raise header.error(line, f"{expected}, {found}", "time")
