"""Loads that change with time: the tables `[[simulation.loads]]` of wing files.

Errors are those of wing files: `path: [table] key: expected …, found …`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from curvcasadi.beam.along import mapped
from curvcasadi.files import toml_reader as toml
from curvcasadi.files.csv_reader import load_csv
from curvcasadi.files.loads import read_load
from curvcasadi.files.toml_reader import Key, Keys
from curvcasadi.symbolic.expressions import Array

#: Fields of loads that a factor scales.
_STRENGTHS = ("acceleration", "force", "moment")

COURSE = Keys(
    place="[[simulation.loads]]",
    meaning="A load as [[loads]] has it, whose force, moment or acceleration is multiplied by a "
    "factor over time. Beside the keys of the load:",
    optional={
        "time": Key(
            toml.NUMBERS, "times, increasing; one that stands twice is a jump", "s", "by file"
        ),
        "factor": Key(
            toml.NUMBERS,
            "factor at each time; linear between them, constant before and after",
            default="by file",
        ),
        "file": Key(
            toml.TEXT,
            "CSV file with the columns `time` (s) and `factor`, beside the wing file",
            default="by time and factor",
        ),
    },
)


@dataclass(frozen=True, eq=False, kw_only=True)
class TimedLoad:
    """A load whose strength changes with time.

    Attributes
    ----------
    load : load
        The load at a factor of one.
    times : array, shape (m,)
        Increasing times, s.
    factors : array, shape (m,)
        Factors at these times; linear between them, constant before and after.
    """

    load: Any
    times: Array
    factors: Array

    def factor(self, time: float) -> float:
        """Factor at a time.

        Parameters
        ----------
        time : float
            Time, s.

        Returns
        -------
        float
            Factor of the load.
        """
        return float(np.interp(time, self.times, self.factors))

    def scaled(self, factor: Any) -> Any:
        """The load times a factor.

        Parameters
        ----------
        factor : float or MX symbol
            Factor of the load.

        Returns
        -------
        load
            Of the same kind.
        """
        (name,) = (name for name in _STRENGTHS if hasattr(self.load, name))
        value = mapped(getattr(self.load, name), lambda strength: factor * ca.vertcat(strength))
        return replace(self.load, **{name: value})


def read_timed(table: toml.Table) -> TimedLoad:
    """A load of [[simulation.loads]], and its factors over time."""
    own = {key: value for key, value in table.content.items() if key in COURSE.all}
    rest = {key: value for key, value in table.content.items() if key not in COURSE.all}
    course = toml.Table(table.path, table.name, own).read(COURSE)
    load = read_load(toml.Table(table.path, table.name, rest))
    if set(course) not in ({"time", "factor"}, {"file"}):
        found = ", ".join(course) or "none of them"
        raise table.error(f"expected time and factor, or file, found {found}")
    if "file" in course:
        times, factors = _read_course(Path(table.path).parent / course["file"])
    else:
        times, factors = course["time"], course["factor"]
    if len(times) != len(factors) or not len(times):
        raise table.error(f"factor: expected {len(times)} numbers, found {len(factors)}")
    for before, after in pairwise(times):
        if after < before:
            raise table.error(
                f"time: expected increasing times, s, found {after:g} after {before:g}"
            )
    return TimedLoad(load=load, times=np.array(times), factors=np.array(factors))


def _read_course(path: Path) -> tuple[list[float], list[float]]:
    csv = load_csv(path)
    fault = csv.header.faults(["time", "factor"])
    if fault:
        raise csv.header.error(1, f"expected the columns time and factor, found {fault}")
    rows = [csv.row(k) for k in range(len(csv.lines))]
    if not rows:
        raise csv.header.error(2, "expected a line of time and factor, found none")
    times, factors = (
        [csv.number(k, name, row[name]) for k, row in enumerate(rows)]
        for name in ("time", "factor")
    )
    for k, (before, after) in enumerate(pairwise(times), start=1):
        if after < before:
            raise csv.error(k, "time", f"expected at least {before:g} s, found {after:g}")
    return times, factors
