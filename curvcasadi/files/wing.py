"""Wing files: a beam and its loads from TOML.

A wrong file is refused by a `ValueError` that says where, what was expected and what was found:
`path: [table] key: expected …, found …`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import MISSING, dataclass, fields
from pathlib import Path
from typing import Any

import casadi as ca

from curvcasadi.beam import families
from curvcasadi.beam.basis import CHANNELS, ChannelBasis
from curvcasadi.beam.beam import Beam
from curvcasadi.beam.grid import Grid
from curvcasadi.beam.pose import Pose
from curvcasadi.files import toml_reader as toml
from curvcasadi.files.loads import read_load
from curvcasadi.files.sections import read_body, read_section
from curvcasadi.lie import so3
from curvcasadi.symbolic.expressions import rotation_matrix

#: Families by their name in a wing file; their keys there are the fields of the class.
FAMILIES: dict[str, type] = {
    "legendre": families.Legendre,
    "monomial": families.Monomial,
    "chebyshev": families.Chebyshev,
    "bspline": families.BSpline,
    "cantilever_modes": families.CantileverModes,
    "piecewise_constant": families.PiecewiseConstant,
    "tabulated": families.Tabulated,
}

_LIMIT = toml.REAL | toml.list_of(toml.REAL, "a list of numbers")


@dataclass(frozen=True, eq=False, kw_only=True)
class WingFile:
    """What a wing file holds."""

    beam: Beam
    loads: tuple[Any, ...]  #: of `curvcasadi.loads.kinds`, in the order of the file


def load_beam(path: str | Path) -> Beam:
    """Beam of a wing file; see `load_wing`. Its loads are checked and left out."""
    return load_wing(path).beam


def load_wing(path: str | Path) -> WingFile:
    """Beam and loads of a wing file.

    TOML tables beam, basis and grid; optionally section, an array of bodies and one of loads. What
    `sensors_table.load_estimation` reads, sensors and estimation, may stand there, and is no matter
    here.

    Parameters
    ----------
    path : wing file; SI units, radians

    Raises
    ------
    ValueError
        If the file is not TOML, has an unknown key, lacks a key, or has a wrong value.
    OSError
        If it cannot be read.
    """
    return read_wing(toml.load_table(path))


def read_wing(file: toml.Table) -> WingFile:
    """Beam and loads of a wing file that was parsed."""
    if "beams" in file.content:
        raise file.error("expected a wing file, found an aircraft's, with [[beams]]")
    required = dict.fromkeys(("beam", "basis", "grid"), toml.table_of())
    optional = {"section": toml.table_of(), "bodies": toml.TABLES, "loads": toml.TABLES}
    optional |= {"sensors": toml.TABLES, "estimation": toml.table_of()}  # of load_estimation
    tables = file.read(required, optional)
    description: dict[str, Any] = {
        "basis": basis_of(file.table("basis")),
        "grid": grid_of(file.table("grid")),
        "section": read_section(file.table("section")) if "section" in tables else None,
        "bodies": tuple(read_body(table) for table in file.tables("bodies")),
    }
    beam = file.table("beam")
    description |= beam_values_of(beam)
    with beam.owning_errors():
        made = Beam(**description)
    return WingFile(beam=made, loads=tuple(read_load(table) for table in file.tables("loads")))


def beam_values_of(table: toml.Table) -> dict[str, Any]:
    values = table.read(
        {"length": toml.NUMBER},
        {
            "root": toml.table_of("position", "rotation"),
            "initial_curvature": toml.VECTOR | toml.table_of("xi", "values"),
            "weight_bounds": _LIMIT | toml.table_of("lower", "upper"),
        },
    )
    readers: dict[str, Callable[[toml.Table], Any]] = {
        "root": root_of,
        "initial_curvature": _initial_curvature,
        "weight_bounds": _weight_bounds,
    }
    for key, reader in readers.items():
        if isinstance(values.get(key), dict):
            values[key] = reader(table.table(key))
    return values


def basis_of(table: toml.Table) -> ChannelBasis:
    channels = table.read({}, dict.fromkeys(CHANNELS, toml.table_of("family", "n")))
    made = {channel: _family(table.table(channel)) for channel in channels}
    with table.owning_errors():
        return ChannelBasis(**made)


def _family(table: toml.Table) -> families.Family:
    name = table.one_of("family", tuple(FAMILIES))
    kinds = {"n": toml.WHOLE, "degree": toml.WHOLE, "xi": toml.NUMBERS, "values": toml.ROWS}
    keys = {field.name: field.default for field in fields(FAMILIES[name]) if field.init}
    values = table.read(
        {"family": toml.TEXT} | {key: kinds[key] for key in keys if keys[key] is MISSING},
        {key: kinds[key] for key in keys if keys[key] is not MISSING},
    )
    del values["family"]
    with table.owning_errors():
        family: families.Family = FAMILIES[name](**values)
    return family


def grid_of(table: toml.Table) -> Grid:
    kind = table.one_of("kind", ("uniform", "lobatto", "custom"))
    size = {"boundaries": toml.NUMBERS} if kind == "custom" else {"elements": toml.WHOLE}
    values = table.read(
        {"kind": toml.TEXT, **size},
        {"rule": toml.TEXT, "exponential": toml.TEXT, "max_angle": toml.NUMBER, "real": toml.TEXT},
    )
    with table.owning_errors():
        return Grid(**values)


def root_of(table: toml.Table) -> Pose:
    attitudes = {"rotation": toml.MATRIX, "rotation_vector": toml.VECTOR}
    values = table.read({"position": toml.VECTOR}, attitudes)
    given = [key for key in attitudes if key in values]
    if len(given) != 1:
        raise table.error(
            f"expected rotation or rotation_vector, found {'both' if given else 'neither'}"
        )
    with table.owning_errors():
        rotation = (
            rotation_matrix("rotation", values["rotation"])
            if "rotation" in values
            else so3.exp(ca.DM(values["rotation_vector"]))
        )
        return Pose(rotation=rotation, position=values["position"])


def _initial_curvature(table: toml.Table) -> families.Tabulated:
    """K_0 (3,) as a function of xi: linear between samples, with a break at each."""
    values = table.read({"xi": toml.NUMBERS, "values": toml.VECTORS})
    with table.owning_errors():
        return families.Tabulated(**values)


def _weight_bounds(table: toml.Table) -> tuple[Any, Any]:
    values = table.read({"lower": _LIMIT, "upper": _LIMIT})
    return values["lower"], values["upper"]
