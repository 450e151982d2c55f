"""What options of several commands have in common."""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from curvcasadi.symbolic.expressions import Array

TABLES = (".csv", ".npz")
FIGURES = (".png", ".svg", ".pdf")
ANIMATIONS = (".gif", ".mp4")
#: Steps of a range that a command takes.
MOST_STEPS = 2000
#: Units that an option takes beside its SI unit, and how many of that each is.
_OTHER_UNITS = {"rad": {"deg": math.pi / 180}, "rad/s": {"deg/s": math.pi / 180}}


def output(*endings: str) -> Callable[[str], Path]:
    """The type of an option that names a file to write, checked before anything is computed."""

    def check(text: str) -> Path:
        path = Path(text)
        if path.suffix.lower() not in endings:
            raise argparse.ArgumentTypeError(
                f"expected a file name that ends in {' or '.join(endings)}, found {text!r}"
            )
        if path.is_dir() or not path.parent.is_dir():
            missing = "a folder" if path.is_dir() else f"no folder {path.parent}"
            raise argparse.ArgumentTypeError(f"expected a file to write, found {missing}")
        return path

    return check


def add_progress(parser: Any) -> None:
    """Add --no-progress; without a terminal there is no bar anyway."""
    parser.add_argument(
        "--no-progress",
        dest="progress",
        action="store_false",
        default=sys.stderr.isatty(),
        help="no progress bar",
    )


def in_unit(text: str, unit: str) -> float:
    """A finite number of `unit`, which may stand behind it, as may degrees for radians.

    Raises
    ------
    ValueError
        If there is no number, or another unit.
    """
    known = {"": 1.0, unit: 1.0, **_OTHER_UNITS.get(unit, {})}
    for name, factor in sorted(known.items(), key=lambda pair: -len(pair[0])):
        if text.strip().endswith(name):
            try:
                value = float(text.strip().removesuffix(name)) * factor
            except ValueError:
                break
            if math.isfinite(value):
                return value
            break
    others = "".join(f", or in {name} as 5{name}" for name in _OTHER_UNITS.get(unit, {}))
    expected = f"in {unit}{others}" if unit else "without a unit"
    raise ValueError(f"expected a number {expected}, found {text!r}")


def quantity(unit: str) -> Callable[[str], float]:
    """The type of an option that holds a number of `unit`: see `in_unit`."""

    def check(text: str) -> float:
        try:
            return in_unit(text, unit)
        except ValueError as error:
            raise argparse.ArgumentTypeError(str(error)) from None

    return check


@contextmanager
def option(name: str) -> Iterator[None]:
    """A constructor's error "Grid.max_angle: expected …" becomes one of the option `name`."""
    try:
        yield
    except ValueError as error:
        _, _, message = str(error).partition(": ")
        raise ValueError(f"{name}: {message}") from None


def steps(first: float, last: float, step: float) -> Array:
    """Numbers from `first` in steps of `step`, `last` included where a step ends there.

    Raises
    ------
    ValueError
        If they are more than `MOST_STEPS`.
    """
    count = (last - first) / step * (1 + 1e-9)
    if count > MOST_STEPS:
        raise ValueError(f"expected at most {MOST_STEPS} steps, found {count:.3g}")
    return np.asarray(first + step * np.arange(math.floor(count) + 1))


def vector(text: str) -> Array:
    """The type of an option that holds three numbers."""
    try:
        values = np.array([float(entry) for entry in text.split(",")])
    except ValueError:
        values = np.array([])
    if values.shape != (3,) or not np.all(np.isfinite(values)):
        raise argparse.ArgumentTypeError(f"expected three numbers x,y,z, found {text!r}")
    return values


def station(text: str) -> float:
    """The type of an option that holds a station s/L."""
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if not 0 <= value <= 1:
        raise argparse.ArgumentTypeError(f"expected a station s/L from 0 to 1, found {text!r}")
    return value
