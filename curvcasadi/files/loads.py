"""Loads from tables of wing files, and from the options of a command."""

from __future__ import annotations

import re
from typing import Any

from curvcasadi.files import toml_reader as toml
from curvcasadi.files.sections import read_steps
from curvcasadi.loads import kinds as loads

#: Loads by their type in a wing file; their keys there are the fields of the class.
LOAD_TYPES: dict[str, type] = {
    "gravity": loads.Gravity,
    "point_force": loads.PointForce,
    "point_moment": loads.PointMoment,
    "distributed_force": loads.DistributedForce,
    "distributed_moment": loads.DistributedMoment,
}


def _vector(unit: str) -> toml.Kind:
    return toml.list_of(toml.NUMBER, f"3 finite numbers in {unit}", 3)


_XI = {"xi": toml.NUMBER}
_FRAME = {"frame": toml.TEXT}
_OFFSET = {"offset": _vector("m")}
#: Keys of each type: those that it needs, and those that it may have.
_KEYS: dict[str, tuple[dict[str, toml.Kind], dict[str, toml.Kind]]] = {
    "gravity": ({"acceleration": _vector("m/s²")}, {}),
    "point_force": ({**_XI, "force": _vector("N")}, {**_FRAME, **_OFFSET}),
    "point_moment": ({**_XI, "moment": _vector("N m")}, _FRAME),
    "distributed_force": ({"force": _vector("N/m")}, {**_FRAME, **_OFFSET}),
    "distributed_moment": ({"moment": _vector("N")}, _FRAME),
}


def read_load(table: toml.Table) -> Any:
    """Load of a table: its type, and the fields of that class of `curvcasadi.loads.kinds`.

    A distributed force or moment may differ from interval to interval of its `xi`.
    """
    name = table.one_of("type", tuple(LOAD_TYPES))
    required, optional = _KEYS[name]
    required = {"type": toml.TEXT, **required}
    if name.startswith("distributed"):
        values = read_steps(table, required, optional, {"force", "moment"})
    else:
        values = table.read(required, optional)
    del values["type"]
    with table.owning_errors():
        return LOAD_TYPES[name](**values)


def parse_load(text: str, option: str) -> Any:
    """Load of a text such as "point_force xi=1 force=0,0,100 frame=dead".

    Parameters
    ----------
    option : what errors call the place of the text, such as --load
    """
    name, *pairs = re.sub(r"\s*([,=])\s*", r"\1", text).split() or [""]
    content: dict[str, Any] = {"type": name}
    table = toml.Table(f'{option} "{text}"', "", content)
    for pair in pairs:
        key, equals, value = pair.partition("=")
        if not equals or key in content:
            raise table.error(f"expected each key once, as key=value, found {pair!r}")
        content[key] = _value(value)
    return read_load(table)


def _value(text: str) -> float | list[float] | str:
    """Numbers where all entries are; else the text, which errors show."""
    try:
        values = [float(entry) for entry in text.split(",")]
    except ValueError:
        return text
    return values if len(values) > 1 else values[0]
