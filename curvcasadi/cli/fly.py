"""The command `curvcasadi fly`: an aircraft in free flight, through a gust."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from curvcasadi.aero.gust import GustField, OneMinusCosine, frozen_gust
from curvcasadi.aero.turbulence import Turbulence
from curvcasadi.aircraft.trim import trim
from curvcasadi.cli.options import FIGURES, TABLES, output
from curvcasadi.control.aircraft_model import aircraft_model
from curvcasadi.control.simulation import Simulation, simulate
from curvcasadi.control.trimmed_state import trimmed_state
from curvcasadi.errors import ConvergenceError
from curvcasadi.files import write_simulation
from curvcasadi.files.aircraft import read_aircraft, read_density
from curvcasadi.files.scenario import MOST_SAMPLES
from curvcasadi.files.toml_reader import load_table
from curvcasadi.loads.kinds import STANDARD_GRAVITY
from curvcasadi.symbolic.expressions import AnyExpr

HELP = """\
Free flight of the aircraft of an aircraft file, whose [body] and sections have inertia: it is
trimmed, and then left alone, with the inputs of the trim, through a gust that stands in the air.

gusts, upward, in m/s and m; they are met by every strip where it is:
  --gust amplitude=2,length=60                    1-cosine, from `start` m ahead (default 20)
  --gust amplitude=2,length=60,start=100,side=right   one that only the right (or left) wing meets
  --turbulence intensity=1,scale=500,seed=3       Dryden turbulence, vertical; it grows to its
                                                  intensity over the first 50 m

outputs:
  --out f.csv, f.npz     a line for each sample: states, inputs (u_...), outputs (y_...)
  --plot f.png           speed, height, angles, rates, load factor, tips, root moments, inputs
  --animate f.gif        the aircraft as surfaces, in real time; .mp4; or .html, one page with a
                         slider for the time that turns with the mouse (needs plotly)

exit codes: 0; 2 after an error in the input; 3 if the speed cannot be trimmed, or a step of the
simulation does not converge: what was reached is written.
"""
#: What an option of a gust holds, and what it has unless given.
GUST = {"amplitude": None, "length": None, "start": "20", "side": "both"}
TURBULENCE = {"intensity": None, "scale": None, "seed": "0"}
#: Over which turbulence grows, m.
RAMP = 50.0


def add_parser(commands: Any) -> None:
    """Add the command to the subparsers of `argparse`."""
    parser = commands.add_parser(
        "fly",
        help="free flight of a flexible aircraft through a gust",
        description=HELP,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("aircraft", type=Path, metavar="AIRCRAFT.toml", help="aircraft file")
    parser.add_argument("--speed", type=_positive, required=True, metavar="V", help="m/s")
    parser.add_argument("--density", type=_positive, help="kg/m3; unless it stands in the file")
    parser.add_argument("--gravity", type=_positive, default=STANDARD_GRAVITY, help="m/s2")
    wind = parser.add_mutually_exclusive_group()
    wind.add_argument("--gust", metavar="KEY=VALUE,...", help="1-cosine gust")
    wind.add_argument("--turbulence", metavar="KEY=VALUE,...", help="continuous turbulence")
    parser.add_argument("--duration", type=_positive, default=10.0, metavar="S", help="default: 10")
    parser.add_argument(
        "--interval", type=_positive, default=0.04, metavar="S", help="between samples: 0.04"
    )
    parser.add_argument(
        "--step", type=_positive, default=0.01, metavar="S", help="of the integrator: 0.01"
    )
    parser.add_argument("--out", type=output(*TABLES), metavar="FILE.csv|FILE.npz", help="samples")
    parser.add_argument("--plot", type=output(*FIGURES), metavar="FILE.png", help="history")
    film = output(".gif", ".mp4", ".html")
    parser.add_argument("--animate", type=film, metavar="FILE.gif|.mp4|.html", help="animation")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Trim, fly, print, and write what was asked for; returns the exit code."""
    file = load_table(arguments.aircraft)
    aircraft = read_aircraft(file)
    density = arguments.density or read_density(file)
    if density is None:
        raise ValueError(
            f"--density: expected kg/m3 here or as density under [air] of {arguments.aircraft}, "
            "found neither"
        )
    gust = _gust(arguments)
    start = trim(
        aircraft, speed=arguments.speed, density=density, gravity=arguments.gravity, throw=True
    )
    model = aircraft_model(aircraft, density=density, gravity=arguments.gravity, gust=gust)
    x, u = trimmed_state(model, start, {"time": 0.0} if gust else None)
    if arguments.duration > MOST_SAMPLES * arguments.interval:
        raise ValueError(
            f"--duration: expected at most {MOST_SAMPLES} intervals of {arguments.interval:g} s, "
            f"found {arguments.duration:g} s"
        )
    times = np.arange(0, arguments.duration + arguments.interval / 2, arguments.interval)
    failure = None
    try:
        motion = simulate(
            model,
            x,
            times,
            u=u,
            method="implicit_midpoint",
            dt=arguments.step,
            progress=arguments.progress,
        )
    except ConvergenceError as error:
        motion, failure = error.result, error
    print(f"{motion}; trimmed at {arguments.speed:g} m/s, density {density:g} kg/m3")
    print(_extremes(motion))
    if len(motion.t) > 1:
        _write(arguments, aircraft, motion)
    if failure is not None:
        raise failure
    return 0


def _positive(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = np.nan
    if not 0 < value < np.inf:
        raise argparse.ArgumentTypeError(f"expected a number above zero, found {text!r}")
    return value


def _entries(name: str, text: str, known: dict[str, str | None]) -> dict[str, str]:
    """Values of an option by key."""
    found: dict[str, str] = {}
    for part in text.split(","):
        key, _, value = (piece.strip() for piece in part.partition("="))
        if key not in known or key in found or not value:
            raise ValueError(f"{name}: expected each of {', '.join(known)} once; found {part!r}")
        found[key] = value
    missing = [key for key, default in known.items() if default is None and key not in found]
    if missing:
        raise ValueError(f"{name}: expected {' and '.join(missing)}, found {text!r}")
    return {**{key: default for key, default in known.items() if default is not None}, **found}


def _number(name: str, values: dict[str, str], key: str) -> float:
    try:
        value = float(values[key])
    except ValueError:
        value = np.nan
    if not np.isfinite(value):
        raise ValueError(f"{name}: expected a number for {key}, found {values[key]!r}")
    return value


def _gust(arguments: argparse.Namespace) -> GustField | None:
    """The gust of the options as a field in the air."""
    if arguments.gust:
        values = _entries("--gust", arguments.gust, GUST)
        amplitude, length, start = (
            _number("--gust", values, key) for key in ("amplitude", "length", "start")
        )
        if length <= 0:
            raise ValueError(f"--gust: expected a length above zero, m, found {length:g}")
        sides = {"both": 0.0, "right": 1.0, "left": -1.0}
        if values["side"] not in sides:
            raise ValueError(f"--gust: expected side=both, right or left, found {values['side']!r}")
        wave = OneMinusCosine(amplitude=amplitude, duration=length, start=start)
        return _on_side(frozen_gust(wave, 1.0), sides[values["side"]])
    if not arguments.turbulence:
        return None
    values = _entries("--turbulence", arguments.turbulence, TURBULENCE)
    intensity, scale, seed = (
        _number("--turbulence", values, key) for key in ("intensity", "scale", "seed")
    )
    speed = arguments.speed
    model = Turbulence(intensity=intensity, scale=scale, speed=speed)
    duration = round(3 * arguments.duration / _SAMPLE) * _SAMPLE
    history = model.sample(duration=duration, dt=_SAMPLE, seed=int(seed))

    def profile(time: AnyExpr) -> AnyExpr:
        grown = ca.fmax(0, ca.fmin(1, speed * time / RAMP))
        return grown**2 * (3 - 2 * grown) * history(time)

    return frozen_gust(profile, speed)


#: Interval of the samples of turbulence, s.
_SAMPLE = 0.02


def _on_side(gust: GustField, side: float) -> GustField:
    """A gust that ends at the plane of symmetry, over a metre, and acts on one side of it."""
    if not side:
        return gust

    def velocity(position: AnyExpr, time: AnyExpr) -> AnyExpr:
        return gust(position, time) * (1 + ca.tanh(2 * side * position[1])) / 2

    return GustField(velocity)


def _extremes(motion: Simulation) -> str:
    """What was least and greatest of the body and the root moments."""
    position = motion.part("position")
    rows = {
        "airspeed [m/s]": motion.part("airspeed")[0],
        "height gained [m]": position[2, 0] - position[2],
        "angle of attack [deg]": np.degrees(motion.part("angle_of_attack")[0]),
        "load factor of the body": motion.part("load_factor")[0],
    }
    for part in motion.model.y.parts:
        if part.name.startswith("root_moment_"):
            wing = part.name.removeprefix("root_moment_")
            rows[f"root M_y of {wing} [N m]"] = motion.part(part.name)[1]
    lines = [f"{'':<28}{'start':>12}{'least':>12}{'at':>9}{'greatest':>12}{'at':>9}{'end':>12}"]
    for name, row in rows.items():
        low, high = int(row.argmin()), int(row.argmax())
        lines.append(
            f"{name:<28}{row[0] + 0.0:12.4f}{row[low]:12.4f}{motion.t[low]:9.2f}"
            f"{row[high]:12.4f}{motion.t[high]:9.2f}{row[-1]:12.4f}"
        )
    return "\n".join(lines)


def _write(arguments: argparse.Namespace, aircraft: Any, motion: Simulation) -> None:
    if arguments.out:
        write_simulation(arguments.out, motion)
    if arguments.plot or arguments.animate:
        from curvcasadi import plotting  # matplotlib takes longer to load than a flight to compute

        if arguments.plot:
            plotting.save_figure(plotting.plot_flight(motion), arguments.plot)
        if arguments.animate:
            plotting.animate_flight(
                aircraft, motion, arguments.animate, progress=arguments.progress
            )
    for path in (arguments.out, arguments.plot, arguments.animate):
        if path:
            print(f"wrote {path}")
