"""Aircraft files: a flexible aircraft from TOML.

Tables: `[body]`; an array of `[[beams]]`, each with a name and the tables of a wing file within
(beam, basis, grid, section, bodies, loads) and `aerodynamics`, or with `mirror_of` and the name of
another; and optionally `[[surfaces]]`, `[[thrusts]]` and `[air]` with its density. Errors are those
of wing files: `path: [table] key: expected …, found …`.
"""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from curvcasadi.aero import ControlSurface, ExponentialTipLoss, StripAerodynamics
from curvcasadi.aero.strip import QUANTITIES, coefficients
from curvcasadi.aircraft.parts import Aircraft, LiftingSurface, RigidBody, Thrust, Wing, mirror_wing
from curvcasadi.beam.along import Steps
from curvcasadi.beam.beam import Beam
from curvcasadi.files import toml_reader as toml
from curvcasadi.files import wing as wing_file
from curvcasadi.files.loads import read_load
from curvcasadi.files.sections import read_body, read_section
from curvcasadi.symbolic.expressions import positive

_OPTIONAL = {"surfaces": toml.TABLES, "thrusts": toml.TABLES, "air": toml.table_of("density")}
#: Quantities of `StripAerodynamics` that have no default.
_REQUIRED = ("chord", "aerodynamic_center", "lift_slope")
_QUANTITY = toml.NUMBER | toml.table_of("xi", "values")
_FLAG = toml.Kind("true or false", lambda value: isinstance(value, bool))


def load_aircraft(path: str | Path) -> Aircraft:
    """Aircraft of an aircraft file.

    Parameters
    ----------
    path : aircraft file; SI units, radians

    Raises
    ------
    ValueError
        If the file is not TOML, has an unknown key, lacks a key, or has a wrong value.
    OSError
        If it cannot be read.
    """
    return read_aircraft(toml.load_table(path))


def read_aircraft(file: toml.Table) -> Aircraft:
    """Aircraft of an aircraft file that was parsed."""
    if "basis" in file.content:
        raise file.error("expected an aircraft file, found a wing's, with [basis]")
    file.read({"body": toml.table_of(), "beams": toml.TABLES}, _OPTIONAL)
    if not file.content["beams"]:
        raise file.error("beams: expected one or more, found none")
    parts: dict[str, Any] = {
        "body": _body(file.table("body")),
        "beams": _wings(_tables(file, "beams")),
        "surfaces": tuple(_surface(table) for table in _tables(file, "surfaces")),
        "thrusts": tuple(_thrust(table) for table in _tables(file, "thrusts")),
    }
    _check_names(file, [part.name for part in (*parts["thrusts"], *parts["surfaces"])])
    with file.owning_errors():
        return Aircraft(**parts)


def read_density(file: toml.Table) -> float | None:
    """Density of the air in the table [air] of an aircraft file, kg/m³; None without that table."""
    if "air" not in file.content:
        return None
    air = file.table("air")
    values = air.read({"density": toml.NUMBER})
    with air.owning_errors():
        return float(positive("density", values["density"]))


def _check_names(file: toml.Table, names: list[str]) -> None:
    """Rigid parts have their wrenches by name, beside the weight."""
    if len({"weight", *names}) <= len(names):
        raise file.error(
            "expected different names of surfaces and thrusts, and none of them weight; "
            f"found {', '.join(names)}"
        )


def _tables(table: toml.Table, key: str) -> list[toml.Table]:
    """`Table.tables` of an array within a table; errors name both."""
    prefix = f"{table.name}." if table.name else ""
    return [
        toml.Table(table.path, f"{prefix}{entry.name}", entry.content)
        for entry in table.tables(key)
    ]


def _body(table: toml.Table) -> RigidBody:
    """Rigid body; `position` is that of its centre of mass, m, body axes."""
    values = table.read({"mass": toml.NUMBER, "position": toml.VECTOR}, {"inertia": toml.MATRIX})
    with table.owning_errors():
        return RigidBody(center_of_mass=values.pop("position"), **values)


def _wings(tables: list[toml.Table]) -> tuple[Wing, ...]:
    """Wings in the order of the file; a mirror image may stand before its original."""
    originals = [table for table in tables if "mirror_of" not in table.content]
    made = {id(table): _wing(table) for table in originals}
    named = {wing.name: wing for wing in made.values()}
    return tuple(made[id(t)] if id(t) in made else _mirrored(t, named) for t in tables)


def _wing(table: toml.Table) -> Wing:
    keys = ("beam", "basis", "grid", "section", "aerodynamics")
    required = {"name": toml.TEXT, **dict.fromkeys(keys, toml.table_of())}
    values = table.read(required, {"bodies": toml.TABLES, "loads": toml.TABLES})
    strips = _strips(table.table("aerodynamics"))
    beam, loads = _beam(table), tuple(_load(entry) for entry in _tables(table, "loads"))
    with table.owning_errors():
        return Wing(name=values["name"], beam=beam, strips=strips, loads=loads)


def _beam(table: toml.Table) -> Beam:
    description = {
        "basis": wing_file.basis_of(table.table("basis")),
        "grid": wing_file.grid_of(table.table("grid")),
        "section": read_section(table.table("section")),
        "bodies": tuple(read_body(entry) for entry in _tables(table, "bodies")),
        **wing_file.beam_values_of(table.table("beam")),
    }
    with table.table("beam").owning_errors():
        return Beam(**description)


def _load(table: toml.Table) -> Any:
    """A further load of a wing: not its weight, which is there anyway."""
    if table.content.get("type") == "gravity":
        raise table.error(
            "type: expected a load other than the weight, which acts in flight anyway; "
            "found 'gravity'"
        )
    return read_load(table)


def _mirrored(table: toml.Table, originals: dict[str, Wing]) -> Wing:
    """The other half wing, by default named after its original."""
    values = table.read({"mirror_of": toml.TEXT}, {"name": toml.TEXT})
    source = table.one_of("mirror_of", tuple(originals) or ("no beam",))
    if originals[source].loads:
        raise table.error(
            f"mirror_of: expected a beam without loads, which have no mirror image; found {source}"
        )
    with table.owning_errors():
        return mirror_wing(originals[source], values.get("name", f"{source}_mirrored"))


def _strips(table: toml.Table) -> StripAerodynamics:
    """Airfoil data: numbers, or a value for each interval of a table's `xi`."""
    varied = [key for key in QUANTITIES if isinstance(table.content.get(key), dict)]
    values = table.read(
        dict.fromkeys(_REQUIRED, _QUANTITY),
        {
            **dict.fromkeys([key for key in QUANTITIES if key not in _REQUIRED], _QUANTITY),
            "upper_side": toml.WHOLE,
            "tip_loss": toml.table_of("decay"),
            "controls": toml.TABLES,
        },
    )
    values |= {key: _steps(table.table(key)) for key in varied}
    if "tip_loss" in values:
        values["tip_loss"] = _tip_loss(table.table("tip_loss"))
    values["controls"] = tuple(_control(entry) for entry in _tables(table, "controls"))
    with table.owning_errors():
        strips = StripAerodynamics(**values)
        for left, right in pairwise((0.0, *strips.breaks, 1.0)):
            coefficients(strips, round((left + right) / 2, 12), {})
    return strips


def _steps(table: toml.Table) -> Steps:
    values = table.read({"xi": toml.NUMBERS, "values": toml.NUMBERS})
    with table.owning_errors():
        return Steps(**values)


def _tip_loss(table: toml.Table) -> ExponentialTipLoss:
    values = table.read({"decay": toml.NUMBER})
    with table.owning_errors():
        return ExponentialTipLoss(**values)


def _control(table: toml.Table) -> ControlSurface:
    values = table.read(
        {"name": toml.TEXT, "lift": toml.NUMBER},
        {**dict.fromkeys(("moment", "drag", "start", "end"), toml.NUMBER), "antisymmetric": _FLAG},
    )
    with table.owning_errors():
        return ControlSurface(**values)


def _surface(table: toml.Table) -> LiftingSurface:
    values = table.read(
        {
            "name": toml.TEXT,
            "area": toml.NUMBER,
            "pose": toml.table_of("position", "rotation"),
            "aerodynamics": toml.table_of(),
        }
    )
    pose, strips = wing_file.root_of(table.table("pose")), _strips(table.table("aerodynamics"))
    with table.owning_errors():
        return LiftingSurface(name=values["name"], area=values["area"], pose=pose, strips=strips)


def _thrust(table: toml.Table) -> Thrust:
    values = table.read({}, {"name": toml.TEXT, "position": toml.VECTOR, "direction": toml.VECTOR})
    length = np.linalg.norm(values.get("direction", [1.0]))
    if abs(length - 1) > 1e-6:
        raise table.error(
            f"direction: expected a unit vector, found {values['direction']} of length {length:g}"
        )
    with table.owning_errors():
        return Thrust(**values)
