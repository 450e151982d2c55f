"""The command `curvcasadi simulate`: a wing moves under its loads."""

from __future__ import annotations

import argparse
import warnings
from pathlib import Path
from typing import Any

import numpy as np

from curvcasadi.beam.beam import Beam
from curvcasadi.cli.options import ANIMATIONS, FIGURES, TABLES, output
from curvcasadi.control.simulation import Simulation
from curvcasadi.errors import ConvergenceError
from curvcasadi.files import load_scenario, simulate_scenario, write_simulation
from curvcasadi.files.loads import parse_load
from curvcasadi.files.scenario import METHODS, STARTS
from curvcasadi.kinematics.weights import exceeded_limit

HELP = """\
The motion of the wing of a file, clamped at its root, without air. It needs [section] with
stiffness, mass_per_length and, where there are weights of torsion, inertia. What moves it: the
loads of the file ([[loads]]) and of --load options, all of them constant, and
[[simulation.loads]], whose strength changes with time:

  [simulation]
  duration = 6.0               # s
  start = "equilibrium"        # or "unloaded", or the weights
  damping = 0.002              # s, structural: a mode of frequency w has the ratio damping w/2

  [[simulation.loads]]
  type = "point_force"
  xi = 1.0
  force = [0, 0, -100]         # N
  time = [0.0, 0.5, 1.0, 1.0]  # s; a time that stands twice is a jump
  factor = [0.0, 1.0, 1.0, 0.0]

or file = "push.csv" with the columns time and factor. The options below replace keys of
[simulation]; with --duration a file needs no such table.

outputs:
  --out m.csv, m.npz   a line for each sample: time, weights and rates, factors of loads (u_...),
                       position and rotation of the tip, curvatures, moment and force at the root
                       (y_...)
  --plot m.png         position of the tip and moment at the root over time
  --animate m.gif      the wing in motion, in real time

exit codes: 0; 2 after an error in the input; 3 if there is no equilibrium to start from, or a
step does not converge: what was reached is written.
"""


def add_parser(commands: Any) -> None:
    """Add the command to the subparsers of `argparse`."""
    parser = commands.add_parser(
        "simulate",
        help="motion of a wing under loads",
        description=HELP,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("wing", type=Path, metavar="WING.toml", help="wing file")
    parser.add_argument(
        "--load", action="append", default=[], metavar="TYPE KEY=VALUE ...", help="one more load"
    )
    parser.add_argument("--duration", type=_time, metavar="SECONDS", help="time that is simulated")
    parser.add_argument("--start", choices=STARTS, help="shape at time 0")
    parser.add_argument("--interval", type=_time, metavar="SECONDS", help="between samples: 0.02")
    parser.add_argument("--step", type=_time, metavar="SECONDS", help="of the integrator: 0.005")
    parser.add_argument("--method", choices=METHODS, help="integrator")
    parser.add_argument(
        "--newton", action="store_true", default=None, help="for steps that do not converge"
    )
    parser.add_argument("--damping", type=_number, metavar="SECONDS", help="of C = damping S")
    table, figure, film = output(*TABLES), output(*FIGURES), output(*ANIMATIONS)
    parser.add_argument("--out", type=table, metavar="FILE.csv|FILE.npz", help="the motion")
    parser.add_argument("--plot", type=figure, metavar="FILE.png", help="tip and root over time")
    parser.add_argument("--animate", type=film, metavar="FILE.gif|FILE.mp4", help="animation")
    parser.add_argument("--half", action="store_true", help="animation without the mirror image")
    parser.set_defaults(run=run)


def _number(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = np.nan
    if not np.isfinite(value):
        raise argparse.ArgumentTypeError(f"expected a number of seconds, found {text!r}")
    return value


def _time(text: str) -> float:
    value = _number(text)
    if value <= 0:
        raise argparse.ArgumentTypeError(f"expected a time above zero, s, found {text!r}")
    return value


def run(arguments: argparse.Namespace) -> int:
    """Simulate, print, and write what was asked for; returns the exit code."""
    keys = ("duration", "start", "interval", "step", "method", "newton", "damping")
    changes = {key: getattr(arguments, key) for key in keys if getattr(arguments, key) is not None}
    more = [parse_load(text, "--load") for text in arguments.load]
    scenario = load_scenario(arguments.wing, **changes, more_loads=more)
    failure = None
    try:
        motion = simulate_scenario(scenario, progress=arguments.progress)
    except ConvergenceError as error:
        motion, failure = error.result, error
    _warn_beyond_limits(scenario.beam, motion)
    print(_table(motion))
    if len(motion.t) > 1:
        _write(arguments, scenario.beam, motion)
    if failure is not None:
        raise failure
    return 0


def _write(arguments: argparse.Namespace, beam: Beam, motion: Simulation) -> None:
    if arguments.out:
        write_simulation(arguments.out, motion)
        print(f"wrote {arguments.out}")
    if arguments.plot or arguments.animate:
        from curvcasadi import plotting  # matplotlib takes longer to load than a motion to compute

        if arguments.plot:
            figure = plotting.plot_motion(motion, ("position", "root_moment"))
            plotting.save_figure(figure, arguments.plot)
            print(f"wrote {arguments.plot}")
        if arguments.animate:
            plotting.animate_shape(
                beam,
                None,
                motion,
                arguments.animate,
                both=not arguments.half,
                local_axes=False,
                progress=arguments.progress,
            )
            print(f"wrote {arguments.animate}")


def _warn_beyond_limits(beam: Beam, motion: Simulation) -> None:
    """Say when the motion first leaves what the beam is made for."""
    for time, q in zip(motion.t, motion.part("q").T, strict=True):
        limit = exceeded_limit(beam, q)
        if limit:
            warnings.warn(f"at t = {time:g} s the motion leaves a limit: {limit}", stacklevel=2)
            return


def _table(motion: Simulation) -> str:
    """Tip and root at the first and last sample, and where they are extreme."""
    position, moment = motion.part("position"), motion.part("root_moment")
    moved = np.linalg.norm(position - position[:, :1], axis=0)
    loaded = np.linalg.norm(moment, axis=0)
    last = len(motion.t) - 1
    rows = {"first": 0, "tip farthest": int(moved.argmax()), "root most": int(loaded.argmax())}
    lines = [
        f"{motion}; {motion.iterations:.2g} iterations a step on average",
        "tip position in parent axes, m; moment on the root in root axes, N m",
        f"{'':<14}{'time':>9}"
        + "".join(f" {f'p_{axis}':>9}" for axis in "xyz")
        + "".join(f" {f'M_{axis}':>11}" for axis in "xyz"),
    ]
    for name, k in {**rows, "last": last}.items():
        lines.append(
            f"{name:<14}{motion.t[k]:9.3f}"
            + "".join(f" {value:9.4f}" for value in position[:, k] + 0.0)
            + "".join(f" {value:11.5g}" for value in moment[:, k] + 0.0)
        )
    return "\n".join(lines)
