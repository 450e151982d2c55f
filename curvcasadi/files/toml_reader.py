"""Checked reading of TOML: what each key must hold, and errors that name the file and the key."""

from __future__ import annotations

import difflib
import math
import re
import reprlib
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any


@dataclass(frozen=True)
class Kind:
    """What a key holds."""

    expected: str
    accepts: Callable[[Any], bool]

    def __or__(self, other: Kind) -> Kind:
        return Kind(
            f"{self.expected} or {other.expected}",
            lambda value: self.accepts(value) or other.accepts(value),
        )


def list_of(item: Kind, expected: str, length: int | None = None) -> Kind:
    """A list of `length` items; by default of any number of them."""

    def accepts(value: Any) -> bool:
        right_length = isinstance(value, list) and length in (None, len(value))
        return right_length and all(item.accepts(element) for element in value)

    return Kind(expected, accepts)


TEXT = Kind("a text", lambda value: isinstance(value, str))
WHOLE = Kind("a whole number", lambda value: type(value) is int)
REAL = Kind("a number", lambda value: type(value) in (int, float))
NUMBER = Kind("a finite number", lambda value: REAL.accepts(value) and math.isfinite(value))
NUMBERS = list_of(NUMBER, "a list of finite numbers")
VECTOR = list_of(NUMBER, "3 finite numbers", 3)
MATRIX = list_of(VECTOR, "3 rows of 3 finite numbers", 3)
VECTORS = list_of(VECTOR, "a list of rows of 3 finite numbers")
ROWS = Kind(
    "a list of equally long rows of finite numbers",
    lambda value: list_of(NUMBERS, "").accepts(value) and len({len(row) for row in value}) == 1,
)


TABLES = Kind(
    "tables",
    lambda value: isinstance(value, list) and all(isinstance(entry, dict) for entry in value),
)


def table_of(*keys: str) -> Kind:
    """A table; errors mention `keys`, which `Table.read` checks."""
    expected = f"a table of {', '.join(keys)}" if keys else "a table"
    return Kind(expected, lambda value: isinstance(value, dict))


@dataclass(frozen=True)
class Table:
    """A table of a TOML file; its errors read `path: [table] key: expected …, found …`."""

    path: Path | str  #: the file, or the option of a command that holds the keys
    name: str  #: dotted, a number behind the name of an array; empty for the file itself
    content: dict[str, Any]

    def error(self, message: str) -> ValueError:
        return ValueError(f"{self.path}: {f'[{self.name}] ' if self.name else ''}{message}")

    def read(
        self, required: Mapping[str, Kind], optional: Mapping[str, Kind] | None = None
    ) -> dict[str, Any]:
        """The values by key, each of its kind.

        Raises
        ------
        ValueError
            For an unknown key, a required one that is missing, or a value of another kind.
        """
        kinds = {**required, **(optional or {})}
        for key in self.content:
            if key not in kinds:
                raise self.error(
                    f"{key}: expected one of the keys {', '.join(kinds)}; "
                    f"found an unknown key, nearest to {_nearest(key, kinds)}"
                )
        for key, kind in kinds.items():
            missing = key not in self.content
            if key in required if missing else not kind.accepts(self.content[key]):
                raise self._mismatch(key, kind.expected)
        return {key: self.content[key] for key in kinds if key in self.content}

    def one_of(self, key: str, options: Sequence[str]) -> str:
        """The text of `key`, one of `options`."""
        value = self.content.get(key)
        if value not in options:
            raise self._mismatch(key, f"one of {', '.join(options)}")
        return str(value)

    def table(self, key: str) -> Table:
        """The table at `key`."""
        return Table(self.path, f"{self.name}.{key}".lstrip("."), self.content[key])

    def tables(self, key: str) -> list[Table]:
        """The tables of the array at `key`, `[[key]]` in the file: none where it is missing."""
        entries = self.content.get(key, [])
        return [Table(self.path, f"{key} {k}", entry) for k, entry in enumerate(entries, start=1)]

    @contextmanager
    def owning_errors(self) -> Iterator[None]:
        """A constructor's error "Grid.rule: expected …" becomes one of this table's key."""
        try:
            yield
        except ValueError as error:
            raise self.error(re.sub(r"^(Section |[A-Z]\w*(\.|: ))", "", str(error))) from None

    def _mismatch(self, key: str, expected: str) -> ValueError:
        found = reprlib.repr(self.content[key]) if key in self.content else "no such key"
        return self.error(f"{key}: expected {expected}, found {found}")


def load_table(path: str | Path) -> Table:
    """The whole of a TOML file.

    Raises
    ------
    ValueError
        If the file is not TOML; names the line.
    OSError
        If it cannot be read.
    """
    path = Path(path)
    try:
        return Table(path, "", tomllib.loads(read_text(path)))
    except tomllib.TOMLDecodeError as error:
        raise ValueError(f"{path}: expected TOML, found: {error}") from None


def read_text(path: Path) -> str:
    """The text of a UTF-8 file; errors name the file."""
    try:
        return path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise ValueError(f"{path}: expected UTF-8 text, found: {error}") from None
    except OSError as error:
        raise type(error)(f"{path}: expected a readable file, found: {error.strerror}") from None


def _nearest(key: str, known: Mapping[str, Kind]) -> str:
    names = {name.lower(): name for name in known}
    return names[difflib.get_close_matches(key.lower(), names, n=1, cutoff=0.0)[0]]
