"""Aircraft files: a flexible aircraft from TOML.

Tables: `[body]`; an array of `[[beams]]`, each with a name and the tables of a wing file within
(beam, basis, grid, section, bodies, loads) and `aerodynamics`, or with `mirror_of` and the name of
another; and optionally `[[surfaces]]`, `[[thrusts]]` and `[air]` with its density. Errors are those
of wing files: `path: [table] key: expected …, found …`.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from curvcasadi.aircraft.parts import Aircraft, LiftingSurface, RigidBody, Thrust, Wing, mirror_wing
from curvcasadi.beam.beam import Beam
from curvcasadi.files import toml_reader as toml
from curvcasadi.files.aerodynamics import read_strips
from curvcasadi.files.basis import basis_of, grid_of
from curvcasadi.files.beam import beam_values_of, root_of
from curvcasadi.files.loads import read_load
from curvcasadi.files.sections import read_body, read_section
from curvcasadi.files.toml_reader import Key, Keys
from curvcasadi.symbolic.expressions import positive

AIRCRAFT = Keys(
    place="an aircraft file",
    meaning="A rigid body with flexible wings, rigid lifting surfaces and thrusts. Positions are "
    "in body axes: x forward, y right, z down.",
    required={
        "body": Key(toml.table_of(), "the rigid body"),
        "beams": Key(toml.TABLES, "flexible half wings"),
    },
    optional={
        "surfaces": Key(toml.TABLES, "rigid lifting surfaces, such as a tail"),
        "thrusts": Key(toml.TABLES, "forces along fixed lines; trim finds their magnitude"),
        "air": Key(toml.table_of("density"), "for `curvcasadi trim`"),
    },
)
AIR = Keys(
    place="[air]",
    meaning="The air in which `curvcasadi trim` flies.",
    required={"density": Key(toml.NUMBER, "density", "kg/m³")},
)
BODY = Keys(
    place="[body]",
    meaning="What is rigid of the aircraft, without its wings.",
    required={
        "mass": Key(toml.NUMBER, "mass", "kg"),
        "position": Key(toml.VECTOR, "of its centre of mass, body axes", "m"),
    },
    optional={"inertia": Key(toml.MATRIX, "about its centre of mass, body axes", "kg m²")},
    describes=RigidBody,
)
WING = Keys(
    place="[[beams]]",
    meaning="A flexible half wing: the tables of a wing file within, such as [beams.beam].",
    required={
        "name": Key(toml.TEXT, "letters and digits"),
        "beam": Key(toml.table_of(), "as [beam] of a wing file"),
        "basis": Key(toml.table_of(), "as [basis]"),
        "grid": Key(toml.table_of(), "as [grid]"),
        "section": Key(toml.table_of(), "as [section]"),
        "aerodynamics": Key(toml.table_of(), "airfoil data"),
    },
    optional={
        "bodies": Key(toml.TABLES, "as [[bodies]]"),
        "loads": Key(toml.TABLES, "as [[loads]]; not the weight, which acts anyway"),
    },
)
MIRRORED = Keys(
    place="[[beams]] with mirror_of",
    meaning="The other half wing, the mirror image of one that is described.",
    required={"mirror_of": Key(toml.TEXT, "name of a wing without further loads")},
    optional={"name": Key(toml.TEXT, "letters and digits", default="<name>_mirrored")},
)
SURFACE = Keys(
    place="[[surfaces]]",
    meaning="A rigid lifting surface.",
    required={
        "name": Key(toml.TEXT, "a name"),
        "area": Key(toml.NUMBER, "area", "m²"),
        "pose": Key(toml.table_of("position", "rotation"), "of its axes, as [beam.root]"),
        "aerodynamics": Key(toml.table_of(), "airfoil data"),
    },
)
THRUST = Keys(
    place="[[thrusts]]",
    meaning="A force along a line that is fixed in the body.",
    optional={
        "name": Key(toml.TEXT, "of the input that is its magnitude, N"),
        "position": Key(toml.VECTOR, "of a point of the line, body axes", "m"),
        "direction": Key(toml.VECTOR, "unit vector, body axes"),
    },
    describes=Thrust,
)


def load_aircraft(path: str | Path) -> Aircraft:
    """Aircraft of an aircraft file.

    Parameters
    ----------
    path : str or Path
        Aircraft file; SI units, radians.

    Returns
    -------
    Aircraft
        The aircraft.

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
    file.read(AIRCRAFT)
    if not file.content["beams"]:
        raise file.error("beams: expected one or more, found none")
    parts: dict[str, Any] = {
        "body": _body(file.table("body")),
        "beams": _wings(file.tables("beams")),
        "surfaces": tuple(_surface(table) for table in file.tables("surfaces")),
        "thrusts": tuple(_thrust(table) for table in file.tables("thrusts")),
    }
    _check_names(file, [part.name for part in (*parts["thrusts"], *parts["surfaces"])])
    with file.owning_errors():
        return Aircraft(**parts)


def read_density(file: toml.Table) -> float | None:
    """Density of the air in the table [air] of an aircraft file, kg/m³; None without that table."""
    if "air" not in file.content:
        return None
    air = file.table("air")
    values = air.read(AIR)
    with air.owning_errors():
        return float(positive("density", values["density"]))


def _check_names(file: toml.Table, names: list[str]) -> None:
    """Rigid parts have their wrenches by name, beside the weight."""
    if len({"weight", *names}) <= len(names):
        raise file.error(
            "expected different names of surfaces and thrusts, and none of them weight; "
            f"found {', '.join(names)}"
        )


def _body(table: toml.Table) -> RigidBody:
    """Rigid body; `position` is that of its centre of mass, m, body axes."""
    values = table.read(BODY)
    with table.owning_errors():
        return RigidBody(center_of_mass=values.pop("position"), **values)


def _wings(tables: list[toml.Table]) -> tuple[Wing, ...]:
    """Wings in the order of the file; a mirror image may stand before its original."""
    originals = [table for table in tables if "mirror_of" not in table.content]
    made = {id(table): _wing(table) for table in originals}
    named = {wing.name: wing for wing in made.values()}
    return tuple(made[id(t)] if id(t) in made else _mirrored(t, named) for t in tables)


def _wing(table: toml.Table) -> Wing:
    values = table.read(WING)
    strips = read_strips(table.table("aerodynamics"))
    beam, loads = _beam(table), tuple(_load(entry) for entry in table.tables("loads"))
    with table.owning_errors():
        return Wing(name=values["name"], beam=beam, strips=strips, loads=loads)


def _beam(table: toml.Table) -> Beam:
    section = read_section(table.table("section"))
    values = beam_values_of(table.table("beam"))
    description = {
        "basis": basis_of(table.table("basis"), section, values["length"]),
        "grid": grid_of(table.table("grid")),
        "section": section,
        "bodies": tuple(read_body(entry) for entry in table.tables("bodies")),
        **values,
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
    values = table.read(MIRRORED)
    source = table.one_of("mirror_of", tuple(originals) or ("no beam",))
    if originals[source].loads:
        raise table.error(
            f"mirror_of: expected a beam without loads, which have no mirror image; found {source}"
        )
    with table.owning_errors():
        return mirror_wing(originals[source], values.get("name", f"{source}_mirrored"))


def _surface(table: toml.Table) -> LiftingSurface:
    values = table.read(SURFACE)
    pose, strips = root_of(table.table("pose")), read_strips(table.table("aerodynamics"))
    with table.owning_errors():
        return LiftingSurface(name=values["name"], area=values["area"], pose=pose, strips=strips)


def _thrust(table: toml.Table) -> Thrust:
    values = table.read(THRUST)
    with table.owning_errors():
        return Thrust(**values)
