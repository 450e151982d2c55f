"""The command `curvcasadi info`: what a wing or aircraft file describes."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np

from curvcasadi.aero.outline import planform
from curvcasadi.aircraft.parts import Aircraft
from curvcasadi.beam.beam import Beam
from curvcasadi.dynamics import natural_frequencies
from curvcasadi.dynamics.inertia import total_mass
from curvcasadi.files.aircraft import read_aircraft
from curvcasadi.files.toml_reader import load_table
from curvcasadi.files.wing import read_wing
from curvcasadi.kinematics.shape import pose_at

#: Frequencies that are printed.
SHOWN = 6
HELP = """\
What the file of a wing or aircraft describes: length, root pose and unloaded tip, the weights in
their order, stiffness, mass, and, where there is inertia, the first natural frequencies of each
wing on its own, clamped, without air.
"""


def add_parser(commands: Any) -> None:
    """Add the command to the subparsers of `argparse`."""
    parser = commands.add_parser(
        "info",
        help="what a wing or aircraft file describes",
        description=HELP,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("file", type=Path, metavar="FILE.toml", help="wing or aircraft file")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Read and print; returns the exit code."""
    table = load_table(arguments.file)
    if "beams" in table.content:
        aircraft = read_aircraft(table)
        print(aircraft)
        for wing in aircraft.beams:
            print(f"\n{wing.name}: {_beam(wing.beam)}")
            if wing.strips is not None:
                print(f"  {'planform':<18} {planform(wing.beam, wing.strips)}")
        print(f"\nmass of all: {_total(aircraft):.6g} kg")
    else:
        wing_file = read_wing(table)
        print(_beam(wing_file.beam))
        print(f"  {'loads':<18} {len(wing_file.loads)} in the file")
    return 0


def _beam(beam: Beam) -> str:
    tip = pose_at(beam, np.zeros(beam.basis.n), 1.0)
    lines = [str(beam), f"  {'unloaded tip':<18} at {tip}"]
    if beam.section is not None or beam.bodies:
        lines.append(f"  {'mass':<18} {float(total_mass(beam)):.6g} kg")
    lines.append(f"  {'frequencies':<18} {_frequencies(beam)}")
    return "\n".join(lines)


def _frequencies(beam: Beam) -> str:
    """The first frequencies, or in words why there are none."""
    try:
        frequencies = natural_frequencies(beam)
    except ValueError as error:
        return f"none: {error}"
    shown = ", ".join(f"{value:.4g}" for value in frequencies[:SHOWN])
    return f"{shown} rad/s ({frequencies[0] / (2 * np.pi):.3g} Hz and up), clamped, straight"


def _total(aircraft: Aircraft) -> float:
    wings = sum(float(total_mass(wing.beam)) for wing in aircraft.beams)
    return float(aircraft.body.mass) + wings
