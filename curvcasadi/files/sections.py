"""Tables of wing files for cross sections and bodies, and for what varies along the span in steps.

With `xi`, boundaries of m intervals from 0 to 1, a key holds one value for the whole span or a list
of m values, one for each interval.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from itertools import pairwise
from typing import Any

from curvcasadi.beam.along import Steps
from curvcasadi.beam.section import (
    COUPLINGS,
    RIGIDITIES,
    Body,
    Section,
    condense_axial,
    symmetric,
)
from curvcasadi.files import toml_reader as toml

MATRIX_4 = toml.list_of(
    toml.list_of(toml.NUMBER, "4 finite numbers", 4), "4 rows of 4 finite numbers", 4
)
#: Stiffness by rigidities and couplings, or by one symmetric matrix: of K_x, K_y, K_z, or of the
#: axial strain and these, which `condense_axial` reduces.
STIFFNESS = {"stiffness": toml.MATRIX | MATRIX_4}
MASS = {
    "mass_per_length": toml.NUMBER,
    "inertia": toml.MATRIX,
    "center_of_mass": toml.VECTOR,
}


def read_steps(
    table: toml.Table,
    required: Mapping[str, toml.Kind],
    optional: Mapping[str, toml.Kind],
    stepped: Collection[str],
) -> dict[str, Any]:
    """`Table.read`, with `Steps` for those of the keys `stepped` that hold a list over `xi`."""
    xi = table.content.get("xi")
    if xi is not None and toml.NUMBERS.accepts(xi):
        with table.owning_errors():
            Steps(xi, xi[1:])
    intervals = len(xi) - 1 if isinstance(xi, list) else None

    def varied(kinds: Mapping[str, toml.Kind]) -> dict[str, toml.Kind]:
        return {
            key: _per_interval(kind, intervals) if key in stepped else kind
            for key, kind in kinds.items()
        }

    values = table.read(varied(required), {**varied(optional), "xi": toml.NUMBERS})
    boundaries = values.pop("xi", [])
    kinds = {**required, **optional}
    return {
        key: value if kinds[key].accepts(value) else Steps(boundaries, value)
        for key, value in values.items()
    }


def _per_interval(kind: toml.Kind, intervals: int | None) -> toml.Kind:
    if intervals is None:
        return kind
    each = f"a list of {intervals} of these, one for each interval of xi"
    return kind | toml.list_of(kind, each, intervals)


def read_section(table: toml.Table) -> Section:
    """Section of a table: GJ, EI_y, EI_z and couplings, or stiffness; and mass."""
    by_entries = [key for key in (*RIGIDITIES, *COUPLINGS) if key in table.content]
    if by_entries and "stiffness" in table.content:
        raise table.error(
            f"expected {', '.join(RIGIDITIES)} and couplings, or stiffness, "
            f"found stiffness and {', '.join(by_entries)}"
        )
    rigidities = dict.fromkeys(RIGIDITIES, toml.NUMBER)
    others = {**dict.fromkeys(COUPLINGS, toml.NUMBER), **MASS, **STIFFNESS}
    if "stiffness" in table.content:
        values = read_steps(table, STIFFNESS, MASS, {*STIFFNESS, *MASS})
    else:
        values = read_steps(table, rigidities, others, {*rigidities, *others})
    with table.owning_errors():
        section = _section(values)
        _check(section)
    return section


def _section(values: dict[str, Any]) -> Section:
    if "stiffness" not in values:
        return Section(**values)
    stiffness = values.pop("stiffness")
    if isinstance(stiffness, Steps):
        stiffness = Steps(stiffness.xi, [_condensed(matrix) for matrix in stiffness.values])
    else:
        stiffness = _condensed(stiffness)
    return Section.from_stiffness(stiffness, **values)


def _condensed(stiffness: Any) -> Any:
    return condense_axial(stiffness) if len(stiffness) == 4 else stiffness


def _check(section: Section) -> None:
    """Every interval: `Section` itself looks at a function of xi where a model asks for it."""
    for left, right in pairwise((0.0, *section.breaks, 1.0)):
        xi = round((left + right) / 2, 12)
        section.stiffness(xi)
        if section.mass_per_length is not None:
            section.mass_at(xi)
        if callable(section.inertia):
            symmetric(f"inertia at xi = {xi}", section.inertia(xi))


def read_body(table: toml.Table) -> Body:
    """Body of a table of the array bodies."""
    values = table.read(
        {"xi": toml.NUMBER, "mass": toml.NUMBER},
        {"inertia": toml.MATRIX, "offset": toml.VECTOR},
    )
    with table.owning_errors():
        return Body(**values)
