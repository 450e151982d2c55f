"""The command `curvcasadi export`: C for a flight computer from a wing file."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Any

from curvcasadi.cli.options import option
from curvcasadi.export.wing import write_wing_c
from curvcasadi.files import load_beam

HELP = """\
C99 for the wing of a file: `curv_tip`, tip pose and body Jacobian; `curv_shape_target`, the weights
that bring the tip to a position; `curv_tip_path_step`, one iteration of the predictive control that
keeps the tip on a path. `curv.h` in the folder says how to call them, `example/main.c` calls one,
and CMakeLists.txt builds the library and its self-test.
"""


def add_parser(commands: Any) -> None:
    """Add the command to the subparsers of `argparse`."""
    parser = commands.add_parser(
        "export",
        help="C for a flight computer",
        description=HELP,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("wing", type=Path, metavar="WING.toml", help="wing file")
    parser.add_argument("--out", type=Path, required=True, metavar="FOLDER", help="where to write")
    parser.add_argument(
        "--real", choices=("double", "float"), default="float", help="default: float"
    )
    parser.add_argument(
        "--max-angle", type=float, metavar="RAD", help="that one element may turn; of the file"
    )
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Write the C and print what each function needs; returns the exit code."""
    if arguments.out.exists() and not arguments.out.is_dir():
        raise ValueError(f"--out: expected a folder, found the file {arguments.out}")
    beam = load_beam(arguments.wing)
    grid = replace(beam.grid, real=arguments.real)
    if arguments.max_angle is not None:
        with option("--max-angle"):
            grid = replace(grid, max_angle=arguments.max_angle)
    manifest = write_wing_c(replace(beam, grid=grid), arguments.out)
    for name, function in manifest["functions"].items():
        sizes = function["buffers"]
        print(f"curv_{name}: {sizes['w']} {arguments.real}s and {sizes['iw']} ints of work")
    print(f"wrote {len(manifest['files'])} files in {arguments.out}")
    return 0
