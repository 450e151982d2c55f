"""Gust load alleviation in closed loop, from sensors, on wings that differ from the model."""

from __future__ import annotations

import runpy
from pathlib import Path

from benchmarks.table import Check, Table, checked

FILE = Path(__file__).parents[1] / "ocp_examples" / "gust_load_alleviation_from_sensors.py"
FLIGHTS = 20
#: Change of the peak, %, that each flight has to reach, by case.
MOST = {"small flaps, estimated gust": -20.0, "large flaps, preview": -70.0}


def from_sensors() -> Table:
    """The example, flown by many wings."""
    example = runpy.run_path(str(FILE))
    _, found = example["simulate"](range(FLIGHTS))
    checks = []
    for name, change in example["changes"](found).items():
        worst, mean = 100 * float(change.max()), 100 * float(change.mean())
        checks += [
            Check(what=f"{name}, worst, %", value=worst, high=MOST[name], form="{:.1f}"),
            Check(what=f"{name}, mean, %", value=mean, form="{:.1f}"),
        ]
    notes = ("Each flight against the open loop of its own wing; preview is an upper bound.",)
    title = f"Largest increment of the root moment in a gust, from sensors, {FLIGHTS} wings"
    return checked(title, checks, notes)
