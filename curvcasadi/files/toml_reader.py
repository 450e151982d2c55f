"""Checked reading of TOML: what each key must hold, and errors that name the file and the key."""

from __future__ import annotations

import difflib
import inspect
import math
import re
import reprlib
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import MISSING, dataclass, field, fields, is_dataclass, replace
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
FLAG = Kind("true or false", lambda value: isinstance(value, bool))
WHOLE = Kind("a whole number", lambda value: type(value) is int)
REAL = Kind("a number", lambda value: type(value) in (int, float))
NUMBER = Kind("a finite number", lambda value: REAL.accepts(value) and math.isfinite(value))
NUMBERS = list_of(NUMBER, "a list of finite numbers")
ONE_OR_EACH = NUMBER | NUMBERS
VECTOR = list_of(NUMBER, "3 finite numbers", 3)
VECTOR_6 = list_of(NUMBER, "6 finite numbers", 6)
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
class Key:
    """A key of a table: what it must hold, and what the reader of the manual needs to know."""

    kind: Kind
    meaning: str  #: a phrase; the file formats of the manual are made of these
    unit: str = ""
    default: str = ""  #: in words, where it is not that of what the table describes


@dataclass(frozen=True, eq=False, kw_only=True)
class Keys:
    """The keys of one kind of table: both what `Table.read` accepts and what the manual lists."""

    place: str  #: the table as it stands in a file, such as [beam]
    meaning: str  #: sentences
    required: Mapping[str, Key] = field(default_factory=dict)
    optional: Mapping[str, Key] = field(default_factory=dict)
    describes: Callable[..., Any] | None = None  #: what has these defaults: a class or a function

    @property
    def all(self) -> dict[str, Key]:
        """Required and optional keys."""
        return {**self.required, **self.optional}

    def default(self, name: str) -> Any:
        """Default of an optional key, as the class or function has it; None where there is none."""
        if self.optional[name].default or self.describes is None:
            return self.optional[name].default or None
        if is_dataclass(self.describes):
            for entry in fields(self.describes):
                if entry.name == name and entry.default_factory is not MISSING:
                    return entry.default_factory()
        parameter = inspect.signature(self.describes).parameters.get(name)
        return None if parameter is None else parameter.default

    def with_kinds(self, kinds: Mapping[str, Kind]) -> Keys:
        """The same keys, some of which hold another kind."""

        def changed(keys: Mapping[str, Key]) -> dict[str, Key]:
            return {
                name: replace(key, kind=kinds[name]) if name in kinds else key
                for name, key in keys.items()
            }

        return replace(self, required=changed(self.required), optional=changed(self.optional))


@dataclass(frozen=True)
class Table:
    """A table of a TOML file; its errors read `path: [table] key: expected …, found …`."""

    path: Path | str  #: the file, or the option of a command that holds the keys
    name: str  #: dotted, a number behind the name of an array; empty for the file itself
    content: dict[str, Any]

    def error(self, message: str) -> ValueError:
        return ValueError(f"{self.path}: {f'[{self.name}] ' if self.name else ''}{message}")

    def read(self, keys: Keys) -> dict[str, Any]:
        """The values by key, each of its kind.

        Raises
        ------
        ValueError
            For an unknown key, a required one that is missing, or a value of another kind.
        """
        known = keys.all
        for name in self.content:
            if name not in known:
                raise self.error(
                    f"{name}: expected one of the keys {', '.join(known)}; "
                    f"found an unknown key, nearest to {_nearest(name, known)}"
                )
        for name, key in known.items():
            missing = name not in self.content
            if name in keys.required if missing else not key.kind.accepts(self.content[name]):
                raise self._mismatch(name, key.kind.expected)
        return {name: self.content[name] for name in known if name in self.content}

    def one_of(self, key: str, options: Sequence[str]) -> str:
        """The text of `key`, one of `options`."""
        value = self.content.get(key)
        if value not in options:
            raise self._mismatch(key, f"one of {', '.join(options)}")
        return str(value)

    def table(self, key: str) -> Table:
        """The table at `key`."""
        return Table(self.path, self._dotted(key), self.content[key])

    def tables(self, key: str) -> list[Table]:
        """The tables of the array at `key`, `[[key]]` in the file: none where it is missing."""
        entries = self.content.get(key, [])
        return [
            Table(self.path, f"{self._dotted(key)} {k}", entry)
            for k, entry in enumerate(entries, start=1)
        ]

    def _dotted(self, key: str) -> str:
        return f"{self.name}.{key}".lstrip(".")

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
        line = 1 + error.object.count(b"\n", 0, error.start)
        raise ValueError(
            f"{path}: line {line}: expected UTF-8 text, found the byte "
            f"0x{error.object[error.start]:02x}; save the file as UTF-8"
        ) from None
    except OSError as error:
        raise type(error)(f"{path}: expected a readable file, found: {error.strerror}") from None


def _nearest(key: str, known: Mapping[str, Key]) -> str:
    names = {name.lower(): name for name in known}
    return names[difflib.get_close_matches(key.lower(), names, n=1, cutoff=0.0)[0]]
