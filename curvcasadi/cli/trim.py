"""The command `curvcasadi trim`: a flexible aircraft in steady flight, level or turning."""

from __future__ import annotations

import argparse
import csv
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from curvcasadi.aircraft.parts import Aircraft
from curvcasadi.aircraft.trim import trim_sweep
from curvcasadi.aircraft.trim_problem import OBJECTIVES
from curvcasadi.aircraft.trim_result import TrimResult, turn_cells
from curvcasadi.aircraft.turn import Turn
from curvcasadi.cli.options import FIGURES, in_unit, option, output, quantity, steps
from curvcasadi.control.aircraft_model import aircraft_model
from curvcasadi.control.flight_modes import flight_modes, modes_table
from curvcasadi.errors import ConvergenceError
from curvcasadi.files.aircraft import read_aircraft, read_density
from curvcasadi.files.toml_reader import load_table
from curvcasadi.loads.kinds import STANDARD_GRAVITY
from curvcasadi.symbolic.text import table

HELP = """\
Steady flight of the aircraft of an aircraft file, level or turning: the angle of attack, the pitch
angle, the inputs (thrusts and deflections) and the shapes of the wings at which all balances.

conditions, in SI units and radians:
  --speed 25                       m/s; again for more speeds, or first:last:step, as 20:30:2
  --density 0.0889                 of the air, kg/m3
  --hold elevator=0.05             an input that is held, N or rad; all others are free
  --objective drag                 chooses where free inputs are more than the balances settle
  --free roll                      lets the aircraft bank, or sideslip; otherwise these are zero

turns and sideslip, of an aircraft with inputs that roll and yaw it; angles may be in degrees:
  --turn-rate 5deg/s               a coordinated turn, to the left below zero; or instead
  --bank 0.3, --bank=-17deg        by its bank angle,
  --turn-radius 250                by its radius, m,
  --load-factor 1.2                or by its load factor, to the right
  --sideslip 3deg                  sideslip that is held, in straight flight or in a turn
  --free sideslip                  in a turn without a rudder: any sideslip

outputs:
  --out trim.csv    a line for each speed: SI units, radians, root moments in root axes, balances
                    in body axes, weights of the wings (rad/m)
  --plot trim.png   the trimmed wings from behind, and the lift along their span

Of an aircraft whose [body] has inertia the modes of its flight are printed as well: phugoid, short
period, dutch roll, spiral, roll, and oscillations of the wings.

exit codes: 0; 2 after an error in the input; 3 if a speed cannot be trimmed: the message has what
does not balance, by how much, and which bounds hold.
"""


#: Options of a turn: unit, and what it is.
TURNS = {
    "turn-rate": ("rad/s", "rate of the heading, rad/s or deg/s"),
    "bank": ("rad", "bank angle, rad or deg"),
    "turn-radius": ("m", "radius of the path, m"),
    "load-factor": ("", "load factor"),
}


def add_parser(commands: Any) -> None:
    """Add the command to the subparsers of `argparse`."""
    parser = commands.add_parser(
        "trim",
        help="steady flight of a flexible aircraft, level or turning",
        description=HELP,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("aircraft", type=Path, metavar="AIRCRAFT.toml", help="aircraft file")
    parser.add_argument(
        "--speed", action="append", required=True, metavar="V|FIRST:LAST:STEP", help="m/s"
    )
    parser.add_argument("--density", type=float, help="kg/m3; unless it stands in the file")
    parser.add_argument("--gravity", type=float, default=STANDARD_GRAVITY, help="m/s2")
    parser.add_argument("--hold", action="append", default=[], metavar="NAME=VALUE", help="N, rad")
    parser.add_argument("--free", action="append", default=[], choices=("sideslip", "roll"))
    turns = parser.add_mutually_exclusive_group()
    for name, (unit, words) in TURNS.items():
        turns.add_argument(
            f"--{name}", type=quantity(unit), metavar=unit.upper() or "N", help=f"turn: {words}"
        )
    parser.add_argument("--sideslip", type=quantity("rad"), metavar="RAD", help="sideslip, held")
    parser.add_argument("--objective", choices=OBJECTIVES, help="what to make least")
    parser.add_argument("--out", type=output(".csv"), metavar="FILE.csv", help="table")
    parser.add_argument("--plot", type=output(*FIGURES), metavar="FILE.png", help="trimmed wings")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Trim at every speed, print, and write what was asked for; returns the exit code."""
    speeds = [speed for text in arguments.speed for speed in _speeds(text)]
    file = load_table(arguments.aircraft)
    aircraft = read_aircraft(file)
    if arguments.density is None:
        arguments.density = read_density(file)
    if arguments.density is None:
        raise ValueError(
            f"--density: expected kg/m3 here or as density under [air] of {arguments.aircraft}, "
            "found neither"
        )
    turn = _turn(arguments)
    try:
        results = trim_sweep(
            aircraft,
            speeds,
            density=arguments.density,
            gravity=arguments.gravity,
            free=arguments.free,
            sideslip=arguments.sideslip,
            turn=turn,
            inputs=_held(arguments.hold, aircraft),
            objective=arguments.objective,
            progress=len(speeds) > 1 and arguments.progress,
        )
    except ValueError as error:
        raise ValueError(_by_options(str(error))) from None
    trimmed = [result for result in results if result.trimmed]
    if trimmed:
        print(f"density {arguments.density:g} kg/m3, gravity {arguments.gravity:g} m/s2\n")
        print(f"{_flight_table(results)}\n\n{_wing_table(results)}\n")
        print(_modes(aircraft, trimmed, arguments.density, arguments.gravity))
        _write(arguments, aircraft, results)
    missed = [result for result in results if not result.trimmed]
    if missed:
        raise ConvergenceError(_by_options("\n".join(r.message for r in missed)), missed[0])
    return 0


def _modes(
    aircraft: Aircraft, trimmed: Sequence[TrimResult], density: float, gravity: float
) -> str:
    """The modes of every trimmed flight, of an aircraft that has the inertia that they need."""
    if aircraft.body.inertia is None:
        return "no flight modes: [body] has no inertia"
    try:
        model = aircraft_model(aircraft, density=density, gravity=gravity, outputs=())
    except ValueError as error:
        return f"no flight modes: {error}"
    flights, missed = [], []
    for result in trimmed:
        try:
            flights.append(flight_modes(model, result))
        except ConvergenceError as error:
            missed.append(f"no flight modes at {result.speed:g} m/s: {error}")
    words = (
        "modes of the flight with unsteady strips: eigenvalues, and the times in which they halve "
        f"or double\n{modes_table(flights)}"
    )
    return "\n".join([*([words] if flights else []), *missed])


def _by_options(message: str) -> str:
    """A message of `trim` with the options of the command in place of the arguments."""
    options = {
        "`inputs`": "--hold",
        "inputs[": "--hold [",
        "`free`": "--free",
        "an objective": "--objective",
        "free: expected": "--free: expected",
        "sideslip: expected": "--sideslip: expected",
        "Turn.load_factor:": "--load-factor:",
        "RigidBody.inertia: expected": "inertia under [body]: expected",
    }
    for argument, name in options.items():
        message = message.replace(argument, name)
    return message


def _turn(arguments: argparse.Namespace) -> Turn | None:
    """The turn that one of the options asks for."""
    for name in TURNS:
        value = getattr(arguments, name.replace("-", "_"))
        if value is not None:
            with option(f"--{name}"):
                return Turn(**{name.removeprefix("turn-").replace("-", "_"): value})
    return None


def _speeds(text: str) -> list[float]:
    """Speeds of an option: one, or those from first to last, both included."""
    try:
        numbers = [float(part) for part in text.split(":")]
    except ValueError:
        numbers = []
    if len(numbers) not in (1, 3) or not all(math.isfinite(v) and v > 0 for v in numbers):
        raise ValueError(
            f"--speed: expected a speed in m/s, or first:last:step, all above zero; found {text!r}"
        )
    if len(numbers) == 1:
        return numbers
    first, last, step = numbers
    if last < first:
        raise ValueError(f"--speed: expected first:last:step with first <= last; found {text!r}")
    try:
        return list(steps(first, last, step))
    except ValueError as error:
        raise ValueError(f"--speed: {error} in {text!r}") from None


def _held(options: Sequence[str], aircraft: Aircraft) -> dict[str, float]:
    """Inputs that are held, by name."""
    held: dict[str, float] = {}
    known = ", ".join(aircraft.inputs) or "none"
    for text in options:
        name, _, value = (part.strip() for part in text.partition("="))
        if name not in aircraft.inputs or name in held:
            raise ValueError(f"--hold: expected each of the inputs {known} once; found {text!r}")
        unit = aircraft.inputs[name]
        try:
            held[name] = in_unit(value, unit)
        except ValueError:
            degrees = ", or in deg as 5deg" if unit == "rad" else ""
            raise ValueError(
                f"--hold: expected {name}=a number in {unit}{degrees}; found {text!r}"
            ) from None
    return held


def _flight_table(results: Sequence[TrimResult]) -> str:
    """A row for each speed: angles, inputs, and the largest force and moment that are left."""
    rows = []
    for result in results:
        row = {"V [m/s]": f"{result.speed:.5g}"}
        angles = {"alpha": result.angle_of_attack, "pitch": result.pitch}
        turning = any(r.turn_rate for r in results)
        if not turning and any(r.sideslip or r.roll for r in results):
            angles |= {"sideslip": result.sideslip, "roll": result.roll}
        row |= {f"{name} [deg]": f"{np.degrees(value):.3f}" for name, value in angles.items()}
        row |= turn_cells(result) if turning else {}
        for name, value in result.inputs.items():
            thrust = result.input_units[name] == "N"
            row[f"{name} [{'N' if thrust else 'deg'}]"] = (
                f"{value if thrust else np.degrees(value):.3f}"
            )
        left = np.abs(list(result.balances.values()))
        row["drag [N]"] = f"{result.drag:.3f}"
        row["unbalanced [N]"] = f"{left[:3].max():.1e}"
        row["unbalanced [N m]"] = f"{left[3:].max():.1e}"
        row["state"] = result.message if result.trimmed else "not trimmed"
        row["held by"] = "; ".join(result.active_bounds) or "-"
        rows.append(row)
    return (
        f"angles and inputs; largest force and moment that do not balance, body axes\n{table(rows)}"
    )


def _wing_table(results: Sequence[TrimResult]) -> str:
    """A row for each speed and wing: tip, moments at the root, and what is left of equilibrium."""
    rows = []
    for result in results:
        for name in result.shapes:
            row = {"V [m/s]": f"{result.speed:.5g}", "wing": name}
            row["tip height [m]"] = f"{result.tip_height(name):.4f}"
            moments = result.root_loads[name][:3]
            row |= {
                f"M_{axis} [N m]": f"{moment + 0.0:.2f}"
                for axis, moment in zip("xyz", moments, strict=True)
            }
            row["residual [N m2]"] = f"{result.equilibrium_residuals[name]:.1e}"
            rows.append(row)
    return (
        "tips above the roots, along -z of the body; moments on the body at the roots, root axes:\n"
        "torsion, out-of-plane and in-plane bending\n"
        f"{table(rows)}"
    )


def _write(
    arguments: argparse.Namespace, aircraft: Aircraft, results: Sequence[TrimResult]
) -> None:
    if arguments.out:
        with arguments.out.open("w", newline="", encoding="utf-8") as file:
            records = [_record(result) for result in results]
            writer = csv.DictWriter(file, list(records[0]))
            writer.writeheader()
            writer.writerows(records)
    if arguments.plot:
        from curvcasadi import plotting  # matplotlib takes longer to load than a trim to compute

        trimmed = [result for result in results if result.trimmed]
        plotting.save_figure(plotting.plot_trim(aircraft, trimmed), arguments.plot)
    for path in (arguments.out, arguments.plot):
        if path:
            print(f"wrote {path}")


def _record(result: TrimResult) -> dict[str, Any]:
    """A line of the CSV file; SI units, radians."""
    angles = ("angle_of_attack", "pitch", "sideslip", "roll", "flight_path")
    record: dict[str, Any] = {"speed": result.speed, "trimmed": int(result.trimmed)}
    record |= {name: getattr(result, name) for name in angles}
    record |= {"turn_rate": result.turn_rate, "load_factor": result.load_factor}
    record |= {f"input_{name}": value for name, value in result.inputs.items()}
    record |= {"drag": result.drag, "strain_energy": result.strain_energy}
    names = [f"unbalanced_{kind}_{axis}" for kind in ("force", "moment") for axis in "xyz"]
    record |= dict(zip(names, result.balances.values(), strict=True))
    for wing, q in result.q.items():
        moments = zip("xyz", result.root_loads[wing][:3], strict=True)
        record[f"{wing}_tip_height"] = result.tip_height(wing)
        record |= {f"{wing}_root_moment_{axis}": float(moment) for axis, moment in moments}
        record[f"{wing}_residual"] = result.equilibrium_residuals[wing]
        record |= {f"{wing}_q{k}": float(weight) for k, weight in enumerate(q.full().ravel())}
    return record
