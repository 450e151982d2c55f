"""Geometry of wing files: the table `[beam]` with its root, angles, curvature and bounds."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np

from curvcasadi.beam import families
from curvcasadi.beam.beam import Beam
from curvcasadi.beam.geometry import WingGeometry, wing_root
from curvcasadi.beam.pose import Pose
from curvcasadi.files import toml_reader as toml
from curvcasadi.files.sections import piecewise
from curvcasadi.files.toml_reader import Key, Keys
from curvcasadi.lie import so3
from curvcasadi.symbolic.expressions import rotation_matrix, rotation_vector

#: What turns more from root to tip, rad, than a winglet is likely given in other units.
LARGEST_TURN = 1.7
_LIMIT = toml.REAL | toml.list_of(toml.REAL, "a list of numbers")

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


def beam_values_of(table: toml.Table) -> dict[str, Any]:
    """Fields of a `Beam` that stand in a table [beam]."""
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


def root_of(table: toml.Table) -> Pose:
    """Pose of a table [beam.root], by rotation, rotation vector or angles."""
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


def doubt_initial_curvature(table: toml.Table, beam: Beam) -> None:
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
