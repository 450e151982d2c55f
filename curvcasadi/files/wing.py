"""Wing files: a beam and its loads from TOML.

A wrong file is refused by a `ValueError` that says where, what was expected and what was found:
`path: [table] key: expected …, found …`.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from curvcasadi.aero import AerodynamicLoad, Flow, StripAerodynamics
from curvcasadi.beam.beam import Beam
from curvcasadi.files import toml_reader as toml
from curvcasadi.files.aerodynamics import read_strips
from curvcasadi.files.basis import basis_of, grid_of
from curvcasadi.files.beam import beam_values_of, doubt_initial_curvature
from curvcasadi.files.loads import read_load
from curvcasadi.files.sections import read_body, read_section
from curvcasadi.files.toml_reader import Key, Keys

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
        doubt_initial_curvature(beam, made)
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
