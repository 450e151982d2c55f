"""Wing files: a beam and its loads from TOML.

A wrong file is refused by a `ValueError` that says where, what was expected and what was found:
`path: [table] key: expected …, found …`.
"""

from __future__ import annotations

import inspect
import warnings
from collections.abc import Callable
from dataclasses import MISSING, dataclass, fields, replace
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from curvcasadi.aero import AerodynamicLoad, Flow, StripAerodynamics
from curvcasadi.beam import families
from curvcasadi.beam.basis import CHANNELS, Basis, ChannelBasis
from curvcasadi.beam.beam import Beam
from curvcasadi.beam.compliance import ComplianceBasis
from curvcasadi.beam.geometry import WingGeometry, wing_root
from curvcasadi.beam.grid import Grid
from curvcasadi.beam.pose import Pose
from curvcasadi.beam.section import Section
from curvcasadi.files import toml_reader as toml
from curvcasadi.files.aerodynamics import read_strips
from curvcasadi.files.loads import read_load
from curvcasadi.files.modes import modal_basis
from curvcasadi.files.sections import piecewise, read_body, read_section
from curvcasadi.files.toml_reader import Key, Keys
from curvcasadi.lie import so3
from curvcasadi.symbolic.expressions import rotation_matrix, rotation_vector

#: Families by their name in a wing file; their keys there are the fields of the class.
FAMILIES: dict[str, type] = {
    "legendre": families.Legendre,
    "monomial": families.Monomial,
    "chebyshev": families.Chebyshev,
    "bspline": families.BSpline,
    "cantilever_modes": families.CantileverModes,
    "free_tip": families.FreeTip,
    "piecewise_constant": families.PiecewiseConstant,
    "tabulated": families.Tabulated,
}
_FAMILY_KEYS = {
    "n": Key(toml.WHOLE, "number of functions, and of weights"),
    "degree": Key(toml.WHOLE, "degree of the piecewise polynomials"),
    "order": Key(toml.WHOLE, "order of the zero at the tip: 2 for bending, 1 for torsion"),
    "xi": Key(toml.NUMBERS, "stations s/L of the samples, increasing from 0 to 1"),
    "values": Key(toml.ROWS, "a row for each station, a column for each function"),
}


def _family_keys(name: str) -> Keys:
    """The fields of the class of a family, and its name."""
    entries = {field.name: field.default for field in fields(FAMILIES[name]) if field.init}
    summary = (inspect.getdoc(FAMILIES[name]) or "").partition("\n\n")[0].replace("\n", " ")
    return Keys(
        place=f'[basis.<channel>] with family = "{name}"',
        meaning=summary,
        required={
            "family": Key(toml.TEXT, f"`{name}`"),
            **{key: _FAMILY_KEYS[key] for key in entries if entries[key] is MISSING},
        },
        optional={key: _FAMILY_KEYS[key] for key in entries if entries[key] is not MISSING},
        describes=FAMILIES[name],
    )


#: What turns more from root to tip, rad, than a winglet is likely given in other units.
LARGEST_TURN = 1.7
_LIMIT = toml.REAL | toml.list_of(toml.REAL, "a list of numbers")

WING = Keys(
    place="a wing file",
    meaning="One beam, its loads, and what is needed to simulate it and to estimate its shape.",
    required={
        "beam": Key(toml.table_of(), "length, root and bounds"),
        "basis": Key(toml.table_of(), "the functions of which the curvature is made"),
        "grid": Key(toml.table_of(), "elements, and the rule within them"),
    },
    optional={
        "section": Key(toml.table_of(), "stiffness and mass; needed for equilibria"),
        "bodies": Key(toml.TABLES, "rigid bodies fixed to the wing"),
        "loads": Key(toml.TABLES, "forces, moments and gravity; `load_beam` leaves them out"),
        "aerodynamics": Key(toml.table_of(), "airfoil data, as [beams.aerodynamics]"),
        "airstream": Key(toml.table_of(), "the air that flows past the wing; needs aerodynamics"),
        "sensors": Key(toml.TABLES, "sensors on the wing, for `curvcasadi estimate`"),
        "estimation": Key(toml.table_of(), "the filter, for `curvcasadi estimate`"),
        "simulation": Key(toml.table_of("duration"), "a motion, for `curvcasadi simulate`"),
    },
)
AIRSTREAM = Keys(
    place="[airstream]",
    meaning="Air that flows past a wing at rest: its airloads are among the loads of the file.",
    required={
        "density": Key(toml.NUMBER, "density", "kg/m³"),
        "velocity": Key(
            toml.VECTOR, "of the wing through the air, parent axes: forward is [25, 0, 0]", "m/s"
        ),
    },
)
BEAM = Keys(
    place="[beam]",
    meaning="Geometry of the wing. The parent axes of a wing of an aircraft are its body axes.",
    required={"length": Key(toml.NUMBER, "arc length of the reference curve", "m")},
    optional={
        "root": Key(
            toml.table_of("position", "rotation"),
            "place and attitude of the local axes at xi = 0, parent axes",
            default="at the origin, local axes = parent axes",
        ),
        "geometry": Key(
            toml.table_of("position", "sweep", "dihedral", "twist"),
            "instead of root and initial_curvature: angles along the span",
            default="by root and initial_curvature",
        ),
        "initial_curvature": Key(
            toml.VECTOR | toml.table_of("xi", "values"),
            "curvature K_x, K_y, K_z of the unloaded wing, local axes",
            "rad/m",
            "straight",
        ),
        "weight_bounds": Key(
            _LIMIT | toml.table_of("lower", "upper"),
            "largest absolute value of every weight, or of each",
            "rad/m",
            "no bounds",
        ),
    },
    describes=Beam,
)
_ANGLE = toml.NUMBER | toml.table_of("xi", "values")
_GEOMETRY_ANGLES = {
    "sweep": Key(_ANGLE, "of the reference curve, positive tip aft; m values of a table", "rad"),
    "dihedral": Key(_ANGLE, "positive tip up; m values of a table", "rad"),
    "twist": Key(
        _ANGLE, "of the section, positive leading edge up; m + 1 values of a table", "rad"
    ),
}
GEOMETRY = Keys(
    place="[beam.geometry]",
    meaning="The unloaded wing by its angles in body axes. Sweep and dihedral are constant between "
    "stations, with kinks where they change; twist is linear between them.",
    optional={
        "side": Key(toml.TEXT, "`right` or `left`"),
        "position": Key(toml.VECTOR, "of the root, body axes", "m"),
        **_GEOMETRY_ANGLES,
        "kink": Key(toml.NUMBER, "share of the span over which a kink is bent"),
    },
    describes=WingGeometry,
)
GEOMETRY_TABLE = Keys(
    place="[beam.geometry.<angle>]",
    meaning="An angle that varies along the span.",
    required={
        "xi": Key(toml.NUMBERS, "m + 1 stations from 0 to 1"),
        "values": Key(toml.NUMBERS, "m values, or m + 1 of twist", "rad"),
    },
)
_ROOT_ANGLES = {
    "side": Key(
        toml.TEXT, "`right` or `left`; then the axes are those of a half wing", default="right"
    ),
    "sweep": Key(toml.NUMBER, "positive tip aft", "rad", "0"),
    "dihedral": Key(toml.NUMBER, "positive tip up", "rad", "0"),
    "incidence": Key(toml.NUMBER, "positive leading edge up", "rad", "0"),
}
ROOT = Keys(
    place="[beam.root]",
    meaning="A pose: a position, and a rotation, a rotation vector, or angles of a half wing.",
    optional={
        "position": Key(toml.VECTOR, "of the origin of the axes", "m", "the parent origin"),
        "rotation": Key(
            toml.MATRIX,
            "rotation matrix, whose columns are the local axes",
            default="by another key",
        ),
        "rotation_vector": Key(toml.VECTOR, "axis times angle", "rad", "by another key"),
        **_ROOT_ANGLES,
    },
)
INITIAL_CURVATURE = Keys(
    place="[beam.initial_curvature]",
    meaning="A curvature that varies along the span, linear between samples.",
    required={
        "xi": Key(toml.NUMBERS, "stations s/L of the samples, increasing from 0 to 1"),
        "values": Key(toml.VECTORS, "K_x, K_y, K_z at each station", "rad/m"),
    },
)
WEIGHT_BOUNDS = Keys(
    place="[beam.weight_bounds]",
    meaning="Bounds that are not symmetric: each one number for all weights, or one for each.",
    required={
        "lower": Key(_LIMIT, "lower bounds; -inf for none", "rad/m"),
        "upper": Key(_LIMIT, "upper bounds; inf for none", "rad/m"),
    },
)
BASIS = Keys(
    place="[basis]",
    meaning="A family of functions for each component of the curvature, which is its channel.",
    optional={
        name: Key(toml.table_of("family", "n"), meaning, default="no functions: K_0 stays")
        for name, meaning in zip(
            CHANNELS,
            ("functions of K_x", "functions of K_y, bending up and down", "functions of K_z"),
            strict=True,
        )
    }
    | {
        "kind": Key(
            toml.TEXT,
            "`channels`; or `compliance`: the functions are moments, curvature follows by the "
            "stiffness of [section], for a section that jumps; or `modal`",
            default="`channels`",
        )
    },
)
MODAL_BASIS = Keys(
    place='[basis] with kind = "modal"',
    meaning="The curvature of modes of a finite-element model.",
    required={
        "kind": Key(toml.TEXT, "`modal`"),
        "modes": Key(toml.TEXT, "CSV file of modes, its place relative to this file"),
    },
    optional={"n": Key(toml.WHOLE, "number of modes, the first ones", default="all")},
)
#: Keys of a channel by the name of its family.
FAMILY = {name: _family_keys(name) for name in FAMILIES}
GRID = Keys(
    place="[grid]",
    meaning="Elements along the span, and how each is integrated.",
    required={
        "kind": Key(toml.TEXT, "`uniform`, `lobatto` or `custom`"),
        "elements": Key(toml.WHOLE, "number of elements; not of a custom grid"),
    },
    optional={
        "rule": Key(toml.TEXT, "`trapezoid`, `midpoint`, `magnus4` or `magnus6`"),
        "exponential": Key(
            toml.TEXT, "`series`, or the paper's `rodrigues`, `small_angle_sine`, `small_angle`"
        ),
        "max_angle": Key(toml.NUMBER, "largest angle that one element may turn", "rad"),
        "real": Key(toml.TEXT, "arithmetic: `double` or `float`"),
    },
    describes=Grid,
)
CUSTOM_GRID = replace(
    GRID,
    place='[grid] with kind = "custom"',
    meaning="Elements between boundaries of your own.",
    required={
        "kind": GRID.required["kind"],
        "boundaries": Key(toml.NUMBERS, "stations s/L, increasing from 0 to 1"),
    },
)


@dataclass(frozen=True, eq=False, kw_only=True)
class WingFile:
    """What a wing file holds.

    Attributes
    ----------
    beam : Beam
        The wing.
    loads : tuple of loads
        In the order of the file; after them the airloads of its airstream.
    strips : StripAerodynamics or None
        Airfoil data.
    """

    beam: Beam
    loads: tuple[Any, ...]
    strips: StripAerodynamics | None = None


def load_beam(path: str | Path) -> Beam:
    """Beam of a wing file; its loads are checked and left out.

    Parameters
    ----------
    path : str or Path
        Wing file; SI units, radians.

    Returns
    -------
    Beam
        The wing.
    """
    return load_wing(path).beam


def load_wing(path: str | Path) -> WingFile:
    """Beam and loads of a wing file.

    The file has the tables beam, basis and grid, and optionally section, bodies and loads. The
    tables sensors and estimation may stand there, too, which `load_estimation` reads, and
    simulation, which `load_scenario` reads.

    Parameters
    ----------
    path : str or Path
        Wing file; SI units, radians.

    Returns
    -------
    WingFile
        Beam and loads.

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
    tables = file.read(WING)
    section = read_section(file.table("section")) if "section" in tables else None
    description: dict[str, Any] = {
        "grid": grid_of(file.table("grid")),
        "section": section,
        "bodies": tuple(read_body(table) for table in file.tables("bodies")),
    }
    beam = file.table("beam")
    description |= beam_values_of(beam)
    description["basis"] = basis_of(file.table("basis"), section, description["length"])
    with beam.owning_errors():
        made = Beam(**description)
    if "initial_curvature" in beam.content:
        _doubt_initial_curvature(beam, made)
    loads = [read_load(table) for table in file.tables("loads")]
    strips = read_strips(file.table("aerodynamics")) if "aerodynamics" in tables else None
    if "airstream" in tables:
        loads.append(_airload(file, strips))
    return WingFile(beam=made, loads=tuple(loads), strips=strips)


def _airload(file: toml.Table, strips: StripAerodynamics | None) -> AerodynamicLoad:
    if strips is None:
        raise file.error("airstream: expected a table [aerodynamics] beside it, found none")
    table = file.table("airstream")
    values = table.read(AIRSTREAM)
    with table.owning_errors():
        return AerodynamicLoad(strips=strips, flow=Flow(**values))


def beam_values_of(table: toml.Table) -> dict[str, Any]:
    values = table.read(BEAM)
    readers: dict[str, Callable[[toml.Table], Any]] = {
        "root": root_of,
        "initial_curvature": _initial_curvature,
        "weight_bounds": _weight_bounds,
    }
    for key, reader in readers.items():
        if isinstance(values.get(key), dict):
            values[key] = reader(table.table(key))
    if "geometry" in values:
        for key in ("root", "initial_curvature"):
            if key in values:
                raise table.error(f"geometry: expected no {key} beside it, found both")
        geometry = _geometry(table.table("geometry"), values["length"])
        del values["geometry"]
        values |= {"root": geometry.root, "initial_curvature": geometry.initial_curvature}
    return values


def basis_of(table: toml.Table, section: Section | None, length: float) -> Basis:
    """Basis of a table [basis], for a wing of `section` and length."""
    if table.content.get("kind") == "modal":
        return _modal_basis(table, length)
    values = table.read(BASIS)
    kind = (
        table.one_of("kind", ("channels", "compliance", "modal"))
        if "kind" in values
        else "channels"
    )
    made = {channel: _family(table.table(channel)) for channel in CHANNELS if channel in values}
    with table.owning_errors():
        if kind == "channels":
            return ChannelBasis(**made)
        if section is None:
            raise ValueError("kind: expected a table [section] for 'compliance', found none")
        return ComplianceBasis(section, **made)


def _modal_basis(table: toml.Table, length: float) -> Basis:
    for channel in CHANNELS:
        if channel in table.content:
            raise table.error(f"{channel}: expected no channels with 'modal', found one")
    values = table.read(MODAL_BASIS)
    with table.owning_errors():
        path = Path(table.path).parent / values["modes"]
        return modal_basis(path, values.get("n"), length=length).basis


def _family(table: toml.Table) -> families.Family:
    name = table.one_of("family", tuple(FAMILIES))
    values = table.read(FAMILY[name])
    del values["family"]
    with table.owning_errors():
        family: families.Family = FAMILIES[name](**values)
    return family


def grid_of(table: toml.Table) -> Grid:
    kind = table.one_of("kind", ("uniform", "lobatto", "custom"))
    values = table.read(CUSTOM_GRID if kind == "custom" else GRID)
    with table.owning_errors():
        return Grid(**values)


def root_of(table: toml.Table) -> Pose:
    values = table.read(ROOT)
    angles = {key: value for key, value in values.items() if key in _ROOT_ANGLES}
    position = values.get("position", (0.0, 0.0, 0.0))
    given = [key for key in ("rotation", "rotation_vector") if key in values]
    if len(given) + bool(angles) != 1:
        found = ", ".join([*given, *angles]) or "none of them"
        raise table.error(
            "expected rotation, rotation_vector, or side, sweep, dihedral and incidence; "
            f"found {found}"
        )
    with table.owning_errors():
        if angles:
            return wing_root(position=position, **angles)
        rotation = (
            rotation_matrix("rotation", values["rotation"])
            if "rotation" in values
            else so3.exp(rotation_vector("rotation_vector", values["rotation_vector"]))
        )
        return Pose(rotation=rotation, position=position)


def _geometry(table: toml.Table, length: float) -> WingGeometry:
    values = table.read(GEOMETRY)
    for name in _GEOMETRY_ANGLES:
        if isinstance(values.get(name), dict):
            values[name] = piecewise(table.table(name), GEOMETRY_TABLE)
    with table.owning_errors():
        return WingGeometry(length=length, **values)


def _initial_curvature(table: toml.Table) -> families.Tabulated:
    """K_0 (3,) as a function of xi: linear between samples, with a break at each."""
    values = table.read(INITIAL_CURVATURE)
    with table.owning_errors():
        return families.Tabulated(**values)


def _doubt_initial_curvature(table: toml.Table, beam: Beam) -> None:
    """Warn of an unloaded wing that turns so far that its curvature is likely no curvature."""
    stations = np.linspace(0, 1, 201)
    curvature = np.hstack([ca.DM(beam.initial_curvature_at(xi)).full() for xi in stations])
    turned = float(np.mean(np.linalg.norm(curvature, axis=0)) * beam.length)
    if turned > LARGEST_TURN:
        warnings.warn(
            f"{table.path}: [{table.name}] initial_curvature: the unloaded wing turns by "
            f"{np.degrees(turned):.0f} degrees from root to tip; curvature is in rad/m, the slope "
            "of twist. Angles along the span go to [beam.geometry] twist, in rad",
            stacklevel=2,
        )


def _weight_bounds(table: toml.Table) -> tuple[Any, Any]:
    values = table.read(WEIGHT_BOUNDS)
    return values["lower"], values["upper"]
