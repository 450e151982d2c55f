"""The tables of the page on file formats, from the keys by which the package reads files."""

from __future__ import annotations

import importlib
import inspect
import re
from collections.abc import Iterator
from types import ModuleType
from typing import Any

import casadi as ca
import numpy as np

from curvcasadi.files.toml_reader import Key, Keys

#: Modules that read tables, by the file in which these stand.
MODULES = {
    "Wing files": ("wing", "beam", "basis", "sections", "loads"),
    "Motion in a wing file": ("scenario", "timed_load"),
    "Sensors and filter in a wing file": ("sensors", "estimation"),
    "Study files": ("study",),
    "Aircraft files": ("aircraft", "aerodynamics"),
}


def page() -> str:
    """Markdown: for each file its tables, for each table its keys."""
    parts = []
    for title, names in MODULES.items():
        parts.append(f"## {title}\n")
        for name in names:
            parts += map(table, tables_of(importlib.import_module(f"curvcasadi.files.{name}")))
    return "\n".join(parts)


def tables_of(module: ModuleType) -> Iterator[Keys]:
    """The descriptions of tables at the top of a module, in their order."""
    for value in vars(module).values():
        for keys in value.values() if isinstance(value, dict) else [value]:
            if isinstance(keys, Keys):
                yield keys


def table(keys: Keys) -> str:
    """A heading, a sentence, and a row for each key."""
    lines = [f"### {_heading(keys.place)}", "", keys.meaning, ""]
    lines += ["| key | holds | unit | default | meaning |", "|---|---|---|---|---|"]
    for name, key in keys.all.items():
        default = "required" if name in keys.required else _default(keys, name)
        cells = (f"`{name}`", _holds(key), key.unit, default, key.meaning)
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join([*lines, ""])


def _heading(place: str) -> str:
    """The place, its table as code: `[grid]` with kind = "custom"."""
    return re.sub(r"\[+[\w.<>]+\]+", r"`\g<0>`", place[0].upper() + place[1:])


def _holds(key: Key) -> str:
    """What a key holds, without the unit, which has a column."""
    expected = key.kind.expected.removesuffix(f" in {key.unit}").removesuffix(f", {key.unit}")
    return expected.replace("finite ", "")


def _default(keys: Keys, name: str) -> str:
    if keys.optional[name].default:
        return keys.optional[name].default
    value = keys.default(name)
    return "none" if value is None or value is inspect.Parameter.empty else _shown(value)


def _shown(value: Any) -> str:
    """A default as it would stand in a file."""
    if isinstance(value, bool):
        return f"`{str(value).lower()}`"
    if isinstance(value, str):
        return f'`"{value}"`'
    array = np.squeeze(value.full() if isinstance(value, ca.DM) else np.asarray(value, dtype=float))
    if array.ndim == 2 and np.array_equal(array, np.eye(len(array))):
        return "the identity"
    if array.ndim == 2 and not array.any():
        return "zero"
    if array.ndim == 0:
        return f"`{array.item():g}`"
    return f"`[{', '.join(f'{entry:g}' for entry in array)}]`"
