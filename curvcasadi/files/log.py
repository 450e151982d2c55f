"""Logs of sensors: CSV files of any length, read line by line.

Errors read `path: line 17, column gyro_1_y: expected …, found …`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from io import BufferedReader
from pathlib import Path
from typing import NamedTuple

from curvcasadi.files.attitudes import Attitudes, attitudes
from curvcasadi.files.csv_reader import CsvHeader, is_number, is_plain
from curvcasadi.files.times import doubt, impossible, seconds, time_column, unit_of

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
    attitudes: Attitudes  #: of the columns beside time


def read_log(
    path: str | Path, columns: Sequence[str], warn: Callable[[str], None]
) -> Iterator[LogRow]:
    """Rows of a log; its first line names the columns: a time and `columns`, in any order.

    The time is one of `TIME_COLUMNS`, whose name says its unit. In place of the nine columns
    <name>_R_xx … of an attitude there may be four of a quaternion, <name>_q_w, _q_x, _q_y, _q_z.
    An empty cell, or nan, is a missing sample. Times never decrease: lines of the same time, as
    loggers write them for several sensors, are samples of that time, and a line that repeats the
    one before in every cell is left out, with a warning at the end. Empty lines count for nothing.
    The last line of a log that was cut off is left out with a warning: one without a line end,
    whose last number may lack digits, one with too few cells, and one whose last cell is no more
    than the beginning of a number.

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
        return _rows(file, _log(path, file.readline(LONGEST_LINE), columns), warn)
    except ValueError:
        file.close()
        raise


def _log(path: Path, raw: bytes, wanted: Sequence[str]) -> _Log:
    text = _text(path, 1, raw.removeprefix(b"\xef\xbb\xbf"))
    header = CsvHeader.of(path, text)
    turned = attitudes(wanted, header.columns)
    columns = [time_column(header.columns), *turned.columns]
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
    return _Log(header, [found.index(name) for name in columns], len(raw), turned)


def _rows(file: BufferedReader, log: _Log, warn: Callable[[str], None]) -> Iterator[LogRow]:
    header, before, line, end = log.header, -math.inf, 1, log.size
    last, count, repeated = "", 0, 0
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
            shown, *values = _numbers(log, line, text)
            name = header.columns[log.order[0]]
            _check_time(header, name, line, shown, before)
            if count == 1 and shown > before and (words := doubt(name, before, shown)):
                warn(f"{header.path}: line {line}, {words}")
            if shown == before and text.strip() == last:
                repeated += 1
                continue
            before, last, count = shown, text.strip(), count + 1
            try:
                values = log.attitudes.matrices(values)
            except ValueError as error:
                raise ValueError(f"{header.path}: line {line}, {error}") from None
            yield LogRow(line, end, shown * seconds(name), values)
    if repeated:
        warn(f"{header.path}: left out {repeated} lines that repeat the line before")
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
            f"0x{raw[error.start]:02x} as character {error.start + 1} of the line; "
            "save the file as UTF-8"
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


def _check_time(header: CsvHeader, name: str, line: int, time: float, before: float) -> None:
    if not time >= before:
        unit = unit_of(name)
        if math.isnan(time):
            raise header.error(line, f"expected a time, {unit}, found a missing one", name)
        expected = f"expected no less than {before!r} {unit}, the time of the sample before"
        raise header.error(line, f"{expected}, found {time!r}: sort the lines by time", name)
    if fault := impossible(name, time):
        raise header.error(line, fault, name)
