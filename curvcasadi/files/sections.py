"""Tables of wing files for cross sections and bodies, and for what varies along the span.

With `xi`, m + 1 stations from 0 to 1, a key holds one value for the whole span, a list of m values,
each constant between two stations, or one of m + 1 values, linear between them.
"""

from __future__ import annotations

from collections.abc import Collection
from itertools import pairwise
from pathlib import Path
from typing import Any

from curvcasadi.beam.along import Piecewise
from curvcasadi.beam.section import (
    COUPLINGS,
    RIGIDITIES,
    Body,
    Section,
    condense_axial,
    symmetric,
)
from curvcasadi.files import toml_reader as toml
from curvcasadi.files.beamdyn import load_beamdyn_sections
from curvcasadi.files.sharpy import load_sharpy_sections
from curvcasadi.files.toml_reader import Key, Keys
from curvcasadi.symbolic.expressions import COINCIDENT

MATRIX_4 = toml.list_of(
    toml.list_of(toml.NUMBER, "4 finite numbers", 4), "4 rows of 4 finite numbers", 4
)
_RIGIDITIES = {
    "GJ": Key(toml.NUMBER, "torsional rigidity", "N m²"),
    "EI_y": Key(toml.NUMBER, "out-of-plane bending rigidity", "N m²"),
    "EI_z": Key(toml.NUMBER, "in-plane bending rigidity", "N m²"),
}
_COUPLINGS = {
    "coupling_xy": Key(toml.NUMBER, "torsion with out-of-plane bending", "N m²"),
    "coupling_xz": Key(toml.NUMBER, "torsion with in-plane bending", "N m²"),
    "coupling_yz": Key(toml.NUMBER, "out-of-plane with in-plane bending", "N m²"),
}
_MASS = {
    "mass_per_length": Key(toml.NUMBER, "needed for weight", "kg/m"),
    "inertia": Key(toml.MATRIX, "per length, about the centre of mass, local axes", "kg m"),
    "center_of_mass": Key(toml.VECTOR, "from the reference curve, local axes", "m"),
}
_STIFFNESS = {
    "stiffness": Key(
        toml.MATRIX | MATRIX_4,
        "symmetric matrix of K_x, K_y, K_z; or of the axial strain and these, which the axial "
        "force zero reduces",
        "N m²",
    )
}
_XI = {
    "xi": Key(
        toml.NUMBERS,
        "m + 1 stations from 0 to 1; every other key then holds one value for all, a list of m "
        "values, each constant between two stations, or of m + 1, linear between stations",
        default="constant along the span",
    )
}
SECTION = Keys(
    place="[section]",
    meaning="Stiffness and mass about the local axes, by rigidities.",
    required=_RIGIDITIES,
    optional={
        **_COUPLINGS,
        **_MASS,
        # Never read: with this key it is a section by matrix.
        "stiffness": Key(
            _STIFFNESS["stiffness"].kind, "instead of the rigidities", "N m²", "rigidities"
        ),
        **_XI,
    },
    describes=Section,
)
SECTION_BY_MATRIX = Keys(
    place="[section] with stiffness",
    meaning="The same by a full stiffness matrix.",
    required=_STIFFNESS,
    optional={**_MASS, **_XI},
    describes=Section,
)
BEAMDYN_SECTION = Keys(
    place="[section] with beamdyn",
    meaning="Sections of a blade file of BeamDyn, without shear and extension.",
    required={"beamdyn": Key(toml.TEXT, "blade file, its place relative to this file")},
    describes=load_beamdyn_sections,
)
SHARPY_SECTION = Keys(
    place="[section] with sharpy",
    meaning="Sections of a beam of a structural file of SHARPy, without shear and extension.",
    required={
        "sharpy": Key(toml.TEXT, "file case.fem.h5, its place relative to this file"),
        "beam": Key(toml.WHOLE, "number of the beam in the file"),
        "y": Key(toml.TEXT, "`leading_edge` or `trailing_edge`: where y of its axes B points"),
    },
    describes=load_sharpy_sections,
)
BODY = Keys(
    place="[[bodies]]",
    meaning="A rigid body fixed to a station.",
    required={
        "xi": Key(toml.NUMBER, "station s/L, 0 to 1"),
        "mass": Key(toml.NUMBER, "mass", "kg"),
    },
    optional={
        "inertia": Key(toml.MATRIX, "about its centre of mass, local axes", "kg m²"),
        "offset": Key(
            toml.VECTOR, "of its centre of mass from the reference curve, local axes", "m"
        ),
    },
    describes=Body,
)


def read_varied(table: toml.Table, keys: Keys, varied: Collection[str]) -> dict[str, Any]:
    """`Table.read`, with `Piecewise` for those of the keys `varied` that hold a list over `xi`."""
    xi = table.content.get("xi")
    if xi is not None and toml.NUMBERS.accepts(xi):
        with table.owning_errors():
            Piecewise(xi, xi)
    intervals = len(xi) - 1 if isinstance(xi, list) else None
    kinds = {name: _along(keys.all[name].kind, intervals) for name in varied}
    values = table.read(keys.with_kinds(kinds))
    stations = values.pop("xi", [])
    with table.owning_errors():
        return {
            name: value if keys.all[name].kind.accepts(value) else Piecewise(stations, value)
            for name, value in values.items()
        }


def piecewise(table: toml.Table, keys: Keys) -> Piecewise:
    """A quantity along the span of a table {xi, values}."""
    values = table.read(keys)
    with table.owning_errors():
        return Piecewise(**values)


def _along(kind: toml.Kind, intervals: int | None) -> toml.Kind:
    if intervals is None:
        return kind
    each = (
        f"a list of {intervals} of these, one for each interval of xi, "
        f"or {intervals + 1}, one for each station"
    )
    constant, linear = (toml.list_of(kind, each, count) for count in (intervals, intervals + 1))
    return kind | toml.Kind(each, lambda value: constant.accepts(value) or linear.accepts(value))


def read_section(table: toml.Table) -> Section:
    """Section of a table: GJ, EI_y, EI_z and couplings, or stiffness; and mass; or of a file."""
    if "beamdyn" in table.content or "sharpy" in table.content:
        return _section_of_file(table)
    by_entries = [key for key in (*RIGIDITIES, *COUPLINGS) if key in table.content]
    if by_entries and "stiffness" in table.content:
        raise table.error(
            f"expected {', '.join(RIGIDITIES)} and couplings, or stiffness, "
            f"found stiffness and {', '.join(by_entries)}"
        )
    keys = SECTION_BY_MATRIX if "stiffness" in table.content else SECTION
    values = read_varied(table, keys, keys.all.keys() - {"xi"})
    with table.owning_errors():
        section = _section(values)
        _check(section)
    return section


def _section_of_file(table: toml.Table) -> Section:
    folder = Path(table.path).parent
    with table.owning_errors():
        if "beamdyn" in table.content:
            values = table.read(BEAMDYN_SECTION)
            return load_beamdyn_sections(folder / values["beamdyn"]).section
        values = table.read(SHARPY_SECTION)
        path = folder / values.pop("sharpy")
        return load_sharpy_sections(path, **values).section


def _section(values: dict[str, Any]) -> Section:
    if "stiffness" not in values:
        return Section(**values)
    stiffness = values.pop("stiffness")
    if isinstance(stiffness, Piecewise):
        stiffness = Piecewise(stiffness.xi, [_condensed(matrix) for matrix in stiffness.values])
    else:
        stiffness = _condensed(stiffness)
    return Section.from_stiffness(stiffness, **values)


def _condensed(stiffness: Any) -> Any:
    return condense_axial(stiffness) if len(stiffness) == 4 else stiffness


def _check(section: Section) -> None:
    """Every interval: `Section` itself looks at a function of xi where a model asks for it.

    What is linear in an interval is right in all of it if it is so at the middle and at both ends,
    which are looked at from within, as the value may jump there.
    """
    for left, right in pairwise((0.0, *section.breaks, 1.0)):
        middle = round((left + right) / 2, 12)
        last = 1.0 if right == 1.0 else right - COINCIDENT
        for xi in (middle, left, last):
            section.stiffness(xi)
            if section.mass_per_length is not None:
                section.mass_at(xi)
            if callable(section.inertia):
                symmetric(f"inertia at xi = {xi}", section.inertia(xi))


def read_body(table: toml.Table) -> Body:
    """Body of a table of the array bodies."""
    values = table.read(BODY)
    with table.owning_errors():
        return Body(**values)
