"""The command `curvcasadi shape`: a wing of given weights."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from curvcasadi.beam.beam import Beam
from curvcasadi.cli.options import ANIMATIONS, FIGURES, TABLES, output
from curvcasadi.files import load_beam, load_weights, write_shape
from curvcasadi.kinematics.history import ShapeHistory, shape_history
from curvcasadi.lie import so3
from curvcasadi.symbolic.expressions import Array

HELP = """\
The shape of the beam of a wing file: its tip on the screen, positions and attitudes, figures.

weights (rad/m, in the order of the basis: torsion, out_of_plane, in_plane):
  --weights "0.01,0,0,-0.05,..."   constant; --weights=-0.1,0 where the first is negative
  --weights history.csv            a line for each sample; the first line names the columns
                                   q0, q1, ... and optionally time (s, increasing)
Without --weights all are zero.

outputs:
  --out p.csv     a line for each sample and station: time, xi, p_x, p_y, p_z (m, parent axes) and
                  D_11 ... D_33, the deformation map (parent to local axes) row by row
  --out p.npz     arrays time (T,), xi (M,), p (T, 3, M), D (T, M, 3, 3) and q (T, n)
Both are of the beam in the file only; figures draw its mirror image, too (not with --half).
Samples without a time are numbered 0, 1, 2, ...
"""


def add_parser(commands: Any) -> None:
    """Add the command to the subparsers of `argparse`."""
    parser = commands.add_parser(
        "shape",
        help="shape of a wing for constant or time-varying weights",
        description=HELP,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("wing", type=Path, metavar="WING.toml", help="wing file")
    parser.add_argument("--weights", metavar="NUMBERS|FILE.csv", help="constant or time-varying")
    table, figure, film = output(*TABLES), output(*FIGURES), output(*ANIMATIONS)
    parser.add_argument("--out", type=table, metavar="FILE.csv|FILE.npz", help="p and D")
    parser.add_argument(
        "--plot", type=figure, metavar="FILE.png", help="deformed wing; of a history, the last one"
    )
    parser.add_argument(
        "--animate", type=film, metavar="FILE.gif|FILE.mp4", help="animation of a history"
    )
    parser.add_argument("--basis-plot", type=figure, metavar="FILE.png", help="basis functions")
    parser.add_argument("--half", action="store_true", help="figures without the mirror image")
    parser.set_defaults(run=run)


class _Weights(NamedTuple):
    values: Array  #: (T, n), rad/m
    times: Array | None  #: (T,), s
    names: list[str]  #: what errors call each row
    is_history: bool


def _weights(argument: str | None, beam: Beam) -> _Weights:
    n = beam.basis.n
    if argument is None:
        return _Weights(np.zeros((1, n)), None, ["weights"], False)
    if argument.lower().endswith(".csv"):
        times, values = load_weights(argument, n, beam.basis.labels)
        names = [f"{argument}: line {k}: q" for k in range(2, len(values) + 2)]
        return _Weights(values, times, names, True)
    values = np.array([[_number(text) for text in argument.split(",")]])
    if values.shape[1] != n:
        labels = ", ".join(beam.basis.labels)
        raise ValueError(f"--weights: expected {n} numbers ({labels}), found {values.shape[1]}")
    return _Weights(values, None, ["--weights"], False)


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise ValueError(
            f"--weights: expected numbers separated by commas, or a file name that ends in .csv; "
            f"found {text!r}"
        ) from None


def run(arguments: argparse.Namespace) -> int:
    """Shapes of all samples: print, and write what was asked for; returns the exit code."""
    beam = load_beam(arguments.wing)
    weights = _weights(arguments.weights, beam)
    if arguments.animate and not weights.is_history:
        raise ValueError("--animate: expected --weights FILE.csv, found constant weights")
    progress = weights.is_history and arguments.progress
    history = shape_history(
        beam, weights.values, weights.times, names=weights.names, progress=progress
    )
    print(_table(beam, history))
    if arguments.out:
        write_shape(arguments.out, history)
    _figures(arguments, beam, weights)
    for path in (arguments.out, arguments.basis_plot, arguments.plot, arguments.animate):
        if path:
            print(f"wrote {path}")
    return 0


def _figures(arguments: argparse.Namespace, beam: Beam, weights: _Weights) -> None:
    if not (arguments.plot or arguments.basis_plot or arguments.animate):
        return
    from curvcasadi import plotting  # matplotlib takes longer to load than a shape to compute

    both = not arguments.half
    if arguments.basis_plot:
        plotting.save_figure(plotting.plot_basis(beam.basis), arguments.basis_plot)
    if arguments.plot:
        figure = plotting.plot_shape(beam, weights.values[-1], both=both)
        plotting.save_figure(figure, arguments.plot)
    if arguments.animate:
        plotting.animate_shape(
            beam,
            weights.times,
            weights.values,
            arguments.animate,
            both=both,
            progress=arguments.progress,
        )


def _table(beam: Beam, history: ShapeHistory) -> str:
    """Tip and largest element angle of the first and last sample and of the most bent one."""
    largest = history.element_angles.max(axis=1)
    rows = sorted({0, int(largest.argmax()), len(history.times) - 1})
    lines = [
        "tip position in parent axes, m; tip rotation against the root, rotation vector in root "
        "axes, deg;",
        "largest angle that one element turns, deg",
        f"{'time':>9} {'p_x':>10} {'p_y':>10} {'p_z':>10}"
        f" {'r_x':>9} {'r_y':>9} {'r_z':>9} {'angle':>8}",
    ]
    for k in rows:
        position = history.positions[k, :, -1]
        rotation = ca.DM(beam.root.rotation.T @ history.deformation_maps[k, -1].T)
        turn = np.degrees(so3.log(rotation).full().ravel())
        lines.append(
            f"{history.times[k]:9.3f} "
            + " ".join(f"{value:10.4f}" for value in position + 0.0)
            + "".join(f" {value:9.3f}" for value in turn + 0.0)
            + f" {np.degrees(largest[k]):8.3f}"
        )
    return "\n".join(lines)
