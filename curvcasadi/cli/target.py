"""The command `curvcasadi target`: which weights bring a station to a pose."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from curvcasadi.beam.beam import Beam
from curvcasadi.cli.options import FIGURES, TABLES, output, station, vector
from curvcasadi.files import load_beam, write_shape
from curvcasadi.kinematics.history import shape_history
from curvcasadi.lie import so3
from curvcasadi.ocp.reach import ShapeResult, reach_shape
from curvcasadi.ocp.targets import Target
from curvcasadi.symbolic.expressions import rotation_vector

HELP = """\
The smoothest shape of a wing whose station --xi comes to a position and, with --turn, an attitude,
in the axes of the file's root. --turn is a rotation vector, rad, in parent axes, by which the
section turns from where it is on the unloaded wing.

The weights that are printed go into `curvcasadi shape --weights`; --out writes the shape as of that
command.

exit codes: 0; 2 after an error in the input; 3 if the target is out of reach: the message says by
how much.
"""


def add_parser(commands: Any) -> None:
    """Add the command to the subparsers of `argparse`."""
    parser = commands.add_parser(
        "target",
        help="weights that bring a station of a wing to a position",
        description=HELP,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("wing", type=Path, metavar="WING.toml", help="wing file")
    parser.add_argument(
        "--position", type=vector, required=True, metavar="X,Y,Z", help="m, parent axes"
    )
    parser.add_argument("--turn", type=vector, metavar="X,Y,Z", help="rad, parent axes")
    parser.add_argument("--xi", type=station, default=1.0, help="station s/L; default 1, the tip")
    parser.add_argument("--out", type=output(*TABLES), metavar="FILE.csv|FILE.npz", help="p and D")
    parser.add_argument(
        "--plot", type=output(*FIGURES), metavar="FILE.png", help="the wing and the target"
    )
    parser.add_argument("--half", action="store_true", help="figure without the mirror image")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Solve, print, and write what was asked for; returns the exit code."""
    beam = load_beam(arguments.wing)
    target = Target(
        xi=arguments.xi, position=arguments.position, rotation=_rotation(beam, arguments)
    )
    result = reach_shape(beam, [target])
    print(_table(arguments.xi, result))
    if arguments.out:
        write_shape(arguments.out, shape_history(beam, result.q.full().T))
    if arguments.plot:
        from curvcasadi import plotting  # matplotlib takes longer to load than a shape to compute

        figure = plotting.plot_shape(beam, result.q, both=not arguments.half, targets=[target])
        plotting.save_figure(figure, arguments.plot)
    for path in (arguments.out, arguments.plot):
        if path:
            print(f"wrote {path}")
    return 0


def _rotation(beam: Beam, arguments: argparse.Namespace) -> ca.DM | None:
    if arguments.turn is None:
        return None
    from curvcasadi.kinematics.shape import pose_at

    unloaded = pose_at(beam, np.zeros(beam.basis.n), arguments.xi).rotation
    rotation: ca.DM = so3.exp(rotation_vector("--turn", arguments.turn)) @ unloaded
    return rotation


def _table(xi: float, result: ShapeResult) -> str:
    rows = {
        f"missed at xi = {xi:g}": f"{float(result.distances[0]):.3g} m",
        "weights": ",".join(f"{weight:.9g}" for weight in result.q.full().ravel()),
    }
    return "\n".join(f"{name:<20} {value}" for name, value in rows.items())
