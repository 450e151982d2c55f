"""The command `curvcasadi equilibrium`: a wing finds its shape under loads."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from curvcasadi.beam.beam import Beam
from curvcasadi.cli.options import FIGURES, TABLES, output
from curvcasadi.files import load_wing, write_shape
from curvcasadi.files.loads import parse_load
from curvcasadi.kinematics.history import shape_history
from curvcasadi.lie import so3
from curvcasadi.statics.balance import root_wrench
from curvcasadi.statics.energy import strain_energy
from curvcasadi.statics.equilibrium import Equilibrium, solve_equilibrium

HELP = """\
The shape at which the elastic moments of a wing balance its loads: those of the wing file
([[loads]]), of --load options, and of the air where
the file has [aerodynamics] (chord, aerodynamic_center, lift_slope, ...) and [airstream] (density,
velocity of the wing through the air). The section is one with stiffness, of [section].

loads, in SI units, a type and key=value pairs; frame=dead (default) is fixed in inertial axes,
frame=follower in the local axes of the section, frame=body in parent axes:
  --load "gravity acceleration=0,0,9.81"               m/s2; body axes have z down
  --load "point_force xi=1 force=0,0,-100 frame=dead"  N; optionally offset=x,y,z (m, local axes)
  --load "point_moment xi=1 moment=0,50,0"             N m
  --load "distributed_force force=0,0,-20"             N/m along the span; optionally offset=
  --load "distributed_moment moment=2,0,0"             N m per m

outputs: as of `curvcasadi shape`, whose --weights takes the weights that are printed.

exit codes: 0; 2 after an error in the input; 3 if the loads cannot be balanced: the message has the
part of them up to which an equilibrium was found.
"""


def add_parser(commands: Any) -> None:
    """Add the command to the subparsers of `argparse`."""
    parser = commands.add_parser(
        "equilibrium",
        help="shape of a wing under loads",
        description=HELP,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("wing", type=Path, metavar="WING.toml", help="wing file")
    parser.add_argument(
        "--load", action="append", default=[], metavar="TYPE KEY=VALUE ...", help="one more load"
    )
    parser.add_argument("--out", type=output(*TABLES), metavar="FILE.csv|FILE.npz", help="p and D")
    parser.add_argument("--plot", type=output(*FIGURES), metavar="FILE.png", help="deformed wing")
    parser.add_argument("--half", action="store_true", help="figure without the mirror image")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Solve, print, and write what was asked for; returns the exit code."""
    wing = load_wing(arguments.wing)
    beam, loads = wing.beam, [*wing.loads, *(parse_load(t, "--load") for t in arguments.load)]
    if not loads:
        raise ValueError(
            f"{arguments.wing}: expected [[loads]], [airstream] or the option --load, found none"
        )
    found = solve_equilibrium(beam, loads)
    print(_table(beam, loads, found))
    if arguments.out:
        write_shape(arguments.out, shape_history(beam, found.q.full().T))
    if arguments.plot:
        from curvcasadi import plotting  # matplotlib takes longer to load than a shape to compute

        figure = plotting.plot_shape(
            beam,
            found.q,
            both=not arguments.half,
            loads=loads,
            strips=wing.strips,
            local_axes=False,  # arrows are those of the loads
        )
        plotting.save_figure(figure, arguments.plot)
    for path in (arguments.out, arguments.plot):
        if path:
            print(f"wrote {path}")
    return 0


def _table(beam: Beam, loads: Sequence[Any], found: Equilibrium) -> str:
    tip, root = found.shape.tip, beam.root
    turn = np.degrees(so3.log(root.rotation.T @ tip.rotation).full())
    stations = found.shape.stations
    elastic = ca.horzcat(*(ca.DM(beam.basis(xi)) @ found.q for xi in stations))
    magnitudes = np.linalg.norm(elastic.full(), axis=0)
    most = int(magnitudes.argmax())
    moment, force = ca.vertsplit(root_wrench(beam, found.q, loads), [0, 3, 6])
    moment = root.rotation.T @ (moment - ca.cross(root.position, force))
    energy = float(strain_energy(beam, found.q))
    rows = {
        "loads": str(len(loads)),
        "load steps": str(found.load_steps),
        "Newton iterations": str(found.iterations),
        "tip position": f"{_numbers(tip.position, '10.4f')}  m, parent axes",
        "tip rotation": f"{_numbers(turn, '10.4f')}  deg, rotation vector in root axes",
        "largest curvature": f"{magnitudes[most]:.6g} rad/m at xi = {stations[most]:g}, of the "
        "elastic part K − K_0",
        "strain energy": f"{energy:.6g} J",
        "root moment": f"{_numbers(moment, '10.6g')}  N m, of the loads, about the root, root axes",
        "residual": f"{found.residual_norm:.1e} N m2, largest entry of S q - Q",
        "weights": ",".join(f"{weight:.9g}" for weight in found.q.full().ravel()),
    }
    return "\n".join(f"{name:<18} {value.strip()}" for name, value in rows.items())


def _numbers(values: Any, form: str) -> str:
    shown = [float(f"{value:{form}}") for value in ca.DM(values).full().ravel()]
    return " ".join(f"{value + 0.0:{form}}" for value in shown)  # no minus sign before a zero
