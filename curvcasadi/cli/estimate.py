"""The command `curvcasadi estimate`: the shape of a wing from a log of its sensors."""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import chain as joined
from pathlib import Path
from typing import Any

from tqdm import tqdm

from curvcasadi.beam.basis import CHANNELS
from curvcasadi.beam.beam import Beam
from curvcasadi.cli.log_filter import LogFilter
from curvcasadi.estimation.ekf.consistency import summary
from curvcasadi.estimation.ekf.stream import Point, RowStepper, compiled, row_function
from curvcasadi.estimation.observability import unseen
from curvcasadi.files.estimation import EstimationFile, load_estimation
from curvcasadi.files.log import read_log
from curvcasadi.symbolic.expressions import Array

HELP = """\
The shape of a wing along a log of its sensors, by an extended Kalman filter.

wing.toml has, besides beam, basis and grid (ocp_examples/hale_wing_imus.toml is one):
  [[sensors]]              for each: kind, xi, and optionally name and bias
    rate_gyro, accelerometer, magnetometer    noise_density, rate (Hz); offset, mounting
    attitude                                  noise (rad); mounting
    strain_gauge, shear_gauge                 noise; the former with its offset = [y, z]
    marker, camera                            noise; offset; a camera with its pose
  [estimation]             process = "random_walk" or "white_acceleration", density; for gyros in a
                           random walk rate, for accelerometers acceleration and gravity; gate,
                           iterations, attitude, root_gyro_density, gyro_bias, bias_density,
                           magnetic_field, parent (pose), twist, twist_rate, root_inputs
  [estimation.deviation]   standard deviations at the start: q, q_dot, attitude, gyro_bias,
                           root_gyro_bias, as far as the filter has them; [estimation.mean] likewise

log.csv: the first line names the columns, in any order:
  time                     s, never decreasing; steps may differ. Other units by name: time_ms,
                           time_us, time_ns, as in "time [ms]". Lines of the same time are samples
                           of that time; one that only repeats the line before is left out
  <sensor>_<component>     a column for each value measured, in the sensor's unit: gyro_1_x,
                           gyro_1_y, ..., attitude_1_R_xx, ..., camera_1_u; strain_1. A sensor
                           without a name is called by its kind and its number among its kind. An
                           attitude is R_xx ... R_zz, or the quaternion attitude_1_q_w, _q_x, _q_y,
                           _q_z, scalar first, of the same rotation; so is the parent's
  root_omega_x, ...        what root_inputs of [estimation] asks for: root_omega_ and root_v_ (x, y,
                           z), root_omega_dot_, root_v_dot_, parent_position_, parent_R_ (xx ... zz)
An empty cell, or nan, is a missing sample: sensors may have different rates. Motion of the root
keeps its last value. A log is read line by line, whatever its length.

--out shape.csv: a line for each time of the log: time; q0, q1, ... (rad/m) and their standard
deviations std_q0, ...; q_dot0, ... and biases where the filter has them; tip_x, tip_y, tip_z (m,
parent axes) and std_tip_x, ...; the same for --stations, as xi_0.5_x, ...

A wrong line ends the command with an error; the output has what stands before it, as it has after
Ctrl-C. A last line that was cut off (no line end, too few cells, or half a number at the end) is
left out with a warning, and no error.

exit codes: 0; 2 after an error in the input; 130 after Ctrl-C.
"""


MOST_WAITING, BETWEEN_WRITES = 256, 0.5  #: lines that are written together; seconds between them


FIGURES = (".png", ".pdf", ".svg")


def add_parser(commands: Any) -> None:
    """Add the command to the subparsers of `argparse`."""
    parser = commands.add_parser(
        "estimate",
        help="shape of a wing along a log of its sensors",
        description=HELP,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("wing", type=Path, metavar="WING.toml", help="wing file with sensors")
    parser.add_argument("log", type=Path, metavar="LOG.csv", help="what the sensors measured")
    parser.add_argument("--out", type=Path, required=True, metavar="FILE.csv", help="estimates")
    parser.add_argument("--plot", type=Path, metavar="FILE.png", help="tip and weights over time")
    parser.add_argument(
        "--stations", metavar="XI,XI,...", help="further stations s/L whose positions are written"
    )
    parser.add_argument(
        "--compile",
        action="store_true",
        help="compile the filter with gcc: takes seconds, then ten times as fast",
    )
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Estimate line by line, write, and print a summary; returns the exit code."""
    points = [Point("tip", 1.0), *_stations(arguments.stations)]
    _check_paths(arguments)
    wing = load_estimation(arguments.wing)
    warnings: list[str] = []
    rows = read_log(arguments.log, [*wing.columns.inputs, *wing.columns.values], warnings.append)
    first = next(rows)
    row = row_function(wing.ekf, points)
    function = compiled(row.function) if arguments.compile else row.function
    estimation = LogFilter(
        arguments.log, wing, RowStepper(function, wing.start), row.columns, first
    )
    code = 0
    began = time.perf_counter()
    try:
        with _lines(arguments.out) as write, _progress(arguments) as show:
            write(",".join(("time", *row.columns)))
            with _latest(write) as write_last:
                for at in joined([first], rows):
                    write_last(at.time, estimation.step(at))
                    show(at.end)
    except KeyboardInterrupt:
        warnings.append(f"interrupted: the log was read up to {estimation.time:g} s")
        code = 130
    except ValueError as error:
        raise ValueError(
            f"{error}\nsamples before that line: {estimation.count}, estimates of all of them in "
            f"{arguments.out}"
        ) from None
    seconds = time.perf_counter() - began
    print(summary(estimation.tally, estimation.count, estimation.time - first.time))
    print(_not_seen(wing), end="")
    if estimation.outside:
        print(
            f"weights are outside weight_bounds in {estimation.outside} samples, first "
            f"{estimation.left}: estimates are wrong there, or bounds too narrow"
        )
    print(f"\n{estimation.count / seconds:.0f} samples a second")
    print(f"wrote {arguments.out}")
    if not estimation.tally.seen.any():
        warnings.append(f"{arguments.log}: no cell has a sample; estimates are a prediction")
    if arguments.plot:
        _plot(arguments.plot, wing.beam, estimation.history.series)
        print(f"wrote {arguments.plot}")
    for warning in warnings:
        print(f"curvcasadi: warning: {warning}", file=sys.stderr)
    return code


def _not_seen(wing: EstimationFile) -> str:
    """What the sensors do not see of the weights, a line each; or nothing."""
    q = wing.start.state[wing.ekf.layout.slices["q"]]
    words = unseen(wing.beam, wing.sensors, q, wing.root)
    if not words:
        return ""
    first = "\nof the shape at the start, at rest, the sensors do not see in one sample:\n"
    return first + "".join(f"  {text}\n" for text in words)


def _stations(text: str | None) -> list[Point]:
    """Points of --stations."""
    points = []
    for entry in text.split(",") if text else []:
        try:
            xi = float(entry)
        except ValueError:
            xi = math.nan
        if not 0 <= xi <= 1:
            raise ValueError(
                f"--stations: expected numbers from 0 to 1 separated by commas, found {entry!r}"
            )
        points.append(Point(f"xi_{entry.strip()}", xi))
    if len({point.xi for point in points}) < len(points):
        raise ValueError(f"--stations: expected each station once, found {text}")
    return points


def _check_paths(arguments: argparse.Namespace) -> None:
    """What would else fail after the whole log, or destroy it."""
    for option, endings in (("out", (".csv",)), ("plot", FIGURES)):
        path = getattr(arguments, option)
        if path is None:
            continue
        if path.suffix.lower() not in endings:
            raise ValueError(
                f"--{option} {path}: expected a file name that ends in {' or '.join(endings)}"
            )
        if path.is_dir():
            raise ValueError(f"--{option} {path}: expected a file name, found a directory")
        if not path.parent.is_dir():
            raise ValueError(
                f"--{option} {path}: expected an existing directory {path.parent}, found none: "
                "make it first"
            )
        for given in (arguments.wing, arguments.log):
            if path.exists() and given.exists() and path.samefile(given):
                raise ValueError(
                    f"--{option} {path}: expected another file than the input {given}, which would "
                    "be overwritten"
                )


@contextmanager
def _lines(path: Path) -> Iterator[Callable[[str], None]]:
    """Writes lines to a file, in blocks of whole ones, so that a file never ends within one."""
    waiting: list[str] = []
    written = time.monotonic()

    with path.open("wb", buffering=0) as file:

        def write_all() -> None:
            nonlocal written
            # Forgotten before they are written: none comes twice if this is interrupted.
            block = "".join(waiting).encode()
            waiting.clear()
            try:
                while block:
                    block = block[file.write(block) :]
            except OSError as error:
                raise type(error)(error.errno, error.strerror, str(path)) from None
            written = time.monotonic()

        def write(line: str) -> None:
            waiting.append(f"{line}\n")
            if len(waiting) >= MOST_WAITING or time.monotonic() > written + BETWEEN_WRITES:
                write_all()

        try:
            yield write
        finally:
            write_all()


@contextmanager
def _latest(write: Callable[[str], None]) -> Iterator[Callable[[float, str], None]]:
    """Writes, of lines of the same time, the last one."""
    waiting: list[tuple[float, str]] = []

    def write_last(time: float, line: str) -> None:
        if waiting and waiting[0][0] != time:
            write(waiting.pop()[1])
        waiting[:] = [(time, line)]

    try:
        yield write_last
    finally:
        for _, line in waiting:
            write(line)


@contextmanager
def _progress(arguments: argparse.Namespace) -> Iterator[Callable[[int], Any]]:
    """A bar of the bytes read, on a terminal."""
    total = arguments.log.stat().st_size or None  # none of a pipe
    hidden = not arguments.progress
    with tqdm(desc="estimate", total=total, unit="B", unit_scale=True, disable=hidden) as bar:
        yield lambda end: bar.update(end - bar.n)


def _plot(path: Path, beam: Beam, series: dict[str, Array]) -> None:
    from curvcasadi import plotting  # matplotlib takes longer to load than a short log

    tip = {f"${axis}$": f"tip_{axis}" for axis in "xyz"}
    weights: dict[str, dict[str, str]] = {}
    for k, label in enumerate(beam.basis.labels):
        channel = next((c for c in CHANNELS if label.startswith(c)), "weights")
        weights.setdefault(channel.replace("_", "-"), {})[f"$q_{{{k}}}$"] = f"q{k}"
    plotting.save_figure(plotting.plot_estimate(series, tip, weights), path)
