"""The file of a sweep: results that are there already."""

from __future__ import annotations

import hashlib
import pickle
import sqlite3
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any


@dataclass(frozen=True, eq=False)
class Record:
    """A database with a row for each finished case; what was written outlives the process."""

    database: sqlite3.Connection

    @staticmethod
    def open(path: str | Path, function: Callable[..., Any], rows: Sequence[Any]) -> Record:
        """The record at `path`, a new one where there is none.

        Raises
        ------
        ValueError
            If the file is no record, or that of another function or of other cases.
        """
        try:
            database = sqlite3.connect(path)
            with database:
                database.execute("CREATE TABLE IF NOT EXISTS sweep (what TEXT, digest TEXT)")
                database.execute(
                    "CREATE TABLE IF NOT EXISTS results (i INTEGER UNIQUE, value BLOB)"
                )
                before = dict(database.execute("SELECT what, digest FROM sweep"))
                own = {"cases": _digest(rows), "function": _digest(function)}
                if not before:
                    database.executemany("INSERT INTO sweep VALUES (?, ?)", own.items())
        except sqlite3.DatabaseError as error:
            raise ValueError(
                f"record: expected the file of a sweep, found {path}: {error}"
            ) from None
        for what, digest in before.items():
            if digest != own[what]:
                raise ValueError(
                    f"record: expected the file of this sweep, found other {what} in {path}; "
                    "name another file, or remove it"
                )
        return Record(database)

    @property
    def results(self) -> dict[int, Any]:
        """Results by the index of their case."""
        rows = self.database.execute("SELECT i, value FROM results")
        return {i: pickle.loads(value) for i, value in rows}

    def keep(self, results: Mapping[int, Any]) -> None:
        """Write results."""
        with self.database:
            self.database.executemany(
                "INSERT OR REPLACE INTO results VALUES (?, ?)",
                [(i, pickle.dumps(value)) for i, value in results.items()],
            )


def _digest(value: Any) -> str:
    """What tells functions and cases apart; of a function that does not pickle, its name."""
    try:
        content = pickle.dumps(value)
    except (pickle.PicklingError, AttributeError, TypeError):
        content = (
            f"{getattr(value, '__module__', '')}.{getattr(value, '__qualname__', '')}".encode()
        )
    return hashlib.sha256(content).hexdigest()
