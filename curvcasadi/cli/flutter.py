"""The command `curvcasadi flutter`: the speeds at which a wing flutters and diverges."""

from __future__ import annotations

import argparse
import csv
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from curvcasadi.aero import AerodynamicLoad, Flow, IndicialLag
from curvcasadi.aircraft.parts import Wing
from curvcasadi.cli.options import FIGURES, output, steps
from curvcasadi.control import Flutter, flutter, wing_model
from curvcasadi.files import load_wing
from curvcasadi.files.wing import WingFile
from curvcasadi.loads.kinds import Gravity
from curvcasadi.symbolic.expressions import Array, numbers
from curvcasadi.symbolic.text import table

#: Roots that are printed at each speed.
SHOWN = 4
HELP = """\
Flutter and divergence of the clamped wing of a wing file in level flow, about its own equilibrium
at each airspeed: unsteady strips with lag states, their apparent mass, and leading-edge suction.
The file has [section] with stiffness, mass and inertia, and [aerodynamics].

Of [airstream] the density and the angle of the velocity in the plane of symmetry are used, the
pitch of the wing; --density and --pitch stand in for them. Gravity of [[loads]] is weight; other
loads act as the file has them, unless --weight-only is set: loads that stand for lift would count
twice.

  curvcasadi flutter wing.toml --speed 15:40:1 --plot

outputs: the speeds, and at each speed the oscillations that are damped least, with their damping
ratio (negative where they grow) and frequency; --out writes all roots, 1/s; --plot draws growth and
frequency over the speed, --locus the roots in the complex plane.

exit codes: 0, also where nothing flutters; 2 after an error in the input, such as a first speed
beyond flutter; 3 if there is no equilibrium at a speed.
"""


def add_parser(commands: Any) -> None:
    """Add the command to the subparsers of `argparse`."""
    parser = commands.add_parser(
        "flutter",
        help="flutter and divergence of a wing",
        description=HELP,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("wing", type=Path, metavar="WING.toml", help="wing file")
    parser.add_argument(
        "--speed",
        type=speeds,
        required=True,
        metavar="FIRST:LAST:STEP",
        help="airspeeds, m/s; the wing is stable at the first",
    )
    parser.add_argument("--density", type=float, metavar="RHO", help="of the air, kg/m3")
    parser.add_argument("--pitch", type=float, metavar="ANGLE", help="of the root, rad, nose-up")
    parser.add_argument(
        "--weight-only", action="store_true", help="leave out [[loads]] other than gravity"
    )
    parser.add_argument(
        "--damping",
        type=float,
        default=0.0,
        metavar="BETA",
        help="of the structure, s: the stiffness times BETA, a ratio of BETA omega/2; default 0",
    )
    parser.add_argument(
        "--poles", type=int, choices=(2, 3, 4), default=3, help="of the lag; default 3"
    )
    parser.add_argument("--out", type=output(".csv"), metavar="FILE.csv", help="all roots")
    for name, meaning in (("plot", "growth and frequency"), ("locus", "root locus")):
        parser.add_argument(
            f"--{name}",
            nargs="?",
            type=output(*FIGURES),
            const=Path(f"flutter{'' if name == 'plot' else '_locus'}.png"),
            metavar="FILE.png",
            help=f"{meaning}; flutter{'' if name == 'plot' else '_locus'}.png unless named",
        )
    parser.set_defaults(run=run)


def speeds(text: str) -> Array:
    """The type of the option --speed: FIRST:LAST:STEP."""
    try:
        first, last, step = (float(part) for part in text.split(":"))
    except ValueError:
        first = last = step = np.nan
    if not (first > 0 and step > 0 and last > first and np.isfinite(last)):
        raise argparse.ArgumentTypeError(
            f"expected FIRST:LAST:STEP in m/s, such as 15:40:1, found {text!r}"
        )
    try:
        inside = steps(first, last, step)
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{error} in {text!r}") from None
    return inside if len(inside) > 1 else np.array([first, last])


def run(arguments: argparse.Namespace) -> int:
    """Sweep, print, and write what was asked for; returns the exit code."""
    wing = load_wing(arguments.wing)
    density, pitch = _air(arguments, wing)
    gravity, loads = _weight(arguments.wing, wing)
    if wing.strips is None:
        raise ValueError(f"{arguments.wing}: expected a table [aerodynamics], found none")
    model = wing_model(
        Wing(
            name="wing",
            beam=wing.beam,
            strips=wing.strips,
            loads=() if arguments.weight_only else loads,
        ),
        density=density,
        gravity=gravity,
        lag=IndicialLag(poles=arguments.poles, modes=3),
        damping=arguments.damping,
        outputs=(),
    )
    named = replace(model, name=arguments.wing.stem)
    found = flutter(named, arguments.speed, p={"pitch": pitch})
    print(_table(found))
    print(found)
    if arguments.out:
        _write(arguments.out, found)
    if arguments.plot or arguments.locus:
        from curvcasadi import plotting

        for path, draw in (
            (arguments.plot, plotting.plot_flutter),
            (arguments.locus, plotting.plot_root_locus),
        ):
            if path:
                plotting.save_figure(draw(found), path)
    for path in (arguments.out, arguments.plot, arguments.locus):
        if path:
            print(f"wrote {path}")
    return 0 if found.success else 3


def _air(arguments: argparse.Namespace, wing: WingFile) -> tuple[float, float]:
    """Density and pitch: of the options, or of the airstream of the file."""
    flows = [load.flow for load in wing.loads if isinstance(load, AerodynamicLoad)]
    density, pitch = arguments.density, arguments.pitch
    if density is None:
        if not flows:
            raise ValueError(
                f"{arguments.wing}: expected a table [airstream] or the option --density, "
                "found none"
            )
        density = float(flows[0].density)
    if pitch is None:
        pitch = _pitch(arguments.wing, flows[0]) if flows else 0.0
    return density, pitch


def _pitch(path: Path, flow: Flow) -> float:
    forward, right, down = numbers("velocity", flow.velocity).ravel()
    if right != 0 or forward <= 0:
        raise ValueError(
            f"{path}: [airstream] velocity: expected a forward velocity in the plane of symmetry, "
            f"body axes, found [{forward:g}, {right:g}, {down:g}]; --pitch stands in for it"
        )
    return float(np.arctan2(down, forward))


def _weight(path: Path, wing: WingFile) -> tuple[float, tuple[Any, ...]]:
    """Gravity, m/s², and the other loads."""
    accelerations = [
        numbers("acceleration", load.acceleration).ravel()
        for load in wing.loads
        if isinstance(load, Gravity)
    ]
    total = np.sum([np.zeros(3), *accelerations], axis=0)
    if np.any(total[:2] != 0) or total[2] < 0:
        raise ValueError(
            f"{path}: [[loads]] acceleration: expected gravity along z, which is down, found "
            f"[{', '.join(f'{x:g}' for x in total)}]"
        )
    others = tuple(x for x in wing.loads if not isinstance(x, (Gravity, AerodynamicLoad)))
    return float(total[2]), others


def _table(found: Flutter) -> str:
    """At each speed the oscillations that are damped least."""
    rows = []
    for speed, roots, ratios in zip(found.speeds, found.roots, found.damping_ratios, strict=True):
        moving = np.flatnonzero(roots.imag > 1e-6 * np.abs(roots))
        least = moving[np.argsort(ratios[moving])][:SHOWN]
        row = {"speed [m/s]": f"{speed:g}"}
        for i in range(SHOWN):
            row[f"damping [%] {i + 1}"] = f"{100 * ratios[least[i]]:.3g}" if i < len(least) else ""
            hertz = roots[least[i]].imag / (2 * np.pi) if i < len(least) else 0.0
            row[f"[Hz] {i + 1}"] = f"{hertz:.4g}" if i < len(least) else ""
        rows.append(row)
    return table(rows)


def _write(path: Path, found: Flutter) -> None:
    number = found.roots.shape[1]
    header = ["speed", *(f"{part}_{i}" for i in range(number) for part in ("real", "imag"))]
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(header)
        for speed, roots in zip(found.speeds, found.roots, strict=True):
            parts = np.column_stack([roots.real, roots.imag]).ravel()
            writer.writerow([repr(float(x)) for x in (speed, *parts)])
