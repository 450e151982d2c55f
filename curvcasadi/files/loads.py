"""Loads from tables of wing files, and from the options of a command."""

from __future__ import annotations

import re
from typing import Any

from curvcasadi.files import toml_reader as toml
from curvcasadi.files.sections import read_varied
from curvcasadi.files.toml_reader import Key, Keys
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


_PLACE = {"xi": Key(toml.NUMBER, "station s/L, 0 to 1")}
_FRAME = {
    "frame": Key(
        toml.TEXT,
        "`dead`: fixed in inertial axes; `follower`: fixed in local axes, turns with the wing; "
        "`body`: fixed in parent axes",
    )
}
_OFFSET = {
    "offset": Key(_vector("m"), "of the point of action from the reference curve, local axes", "m")
}
_INTERVALS = {
    "xi": Key(
        toml.NUMBERS,
        "boundaries of m intervals, from 0 to 1, for a list of m values",
        default="one interval",
    )
}


def _keys(name: str, meaning: str, required: dict[str, Key], optional: dict[str, Key]) -> Keys:
    return Keys(
        place=f'[[loads]] with type = "{name}"',
        meaning=meaning,
        required={"type": Key(toml.TEXT, f"`{name}`"), **required},
        optional=optional,
        describes=LOAD_TYPES[name],
    )


#: Keys by the type of a load.
LOADS = {
    "gravity": _keys(
        "gravity",
        "Weight of the wing and its bodies.",
        {"acceleration": Key(_vector("m/s²"), "of a falling body, parent axes", "m/s²")},
        {},
    ),
    "point_force": _keys(
        "point_force",
        "A force at a station.",
        {**_PLACE, "force": Key(_vector("N"), "components in the axes of `frame`", "N")},
        {**_FRAME, **_OFFSET},
    ),
    "point_moment": _keys(
        "point_moment",
        "A moment at a station.",
        {**_PLACE, "moment": Key(_vector("N m"), "components in the axes of `frame`", "N m")},
        _FRAME,
    ),
    "distributed_force": _keys(
        "distributed_force",
        "A force per length, the same everywhere or for each interval.",
        {"force": Key(_vector("N/m"), "components in the axes of `frame`", "N/m")},
        {**_INTERVALS, **_FRAME, **_OFFSET},
    ),
    "distributed_moment": _keys(
        "distributed_moment",
        "A moment per length, the same everywhere or for each interval.",
        {"moment": Key(_vector("N"), "per length; components in the axes of `frame`", "N")},
        {**_INTERVALS, **_FRAME},
    ),
}


def read_load(table: toml.Table) -> Any:
    """Load of a table: its type, and the fields of that class of `curvcasadi.loads.kinds`.

    A distributed force or moment may differ from interval to interval of its `xi`.
    """
    name = table.one_of("type", tuple(LOAD_TYPES))
    keys = LOADS[name]
    if "xi" in keys.optional:
        values = read_varied(table, keys, {"force", "moment"} & keys.required.keys())
    else:
        values = table.read(keys)
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
