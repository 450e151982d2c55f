"""Bases and grids of wing files: the tables `[basis]`, `[basis.<channel>]` and `[grid]`."""

from __future__ import annotations

import inspect
from dataclasses import MISSING, fields, replace
from pathlib import Path

from curvcasadi.beam import families
from curvcasadi.beam.basis import CHANNELS, Basis, ChannelBasis
from curvcasadi.beam.compliance import ComplianceBasis
from curvcasadi.beam.grid import Grid
from curvcasadi.beam.section import Section
from curvcasadi.files import toml_reader as toml
from curvcasadi.files.modes import modal_basis
from curvcasadi.files.toml_reader import Key, Keys

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
    """Grid of a table [grid]."""
    kind = table.one_of("kind", ("uniform", "lobatto", "custom"))
    values = table.read(CUSTOM_GRID if kind == "custom" else GRID)
    with table.owning_errors():
        return Grid(**values)
