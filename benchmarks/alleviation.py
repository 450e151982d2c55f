"""Gust load alleviation in closed loop, from sensors, on wings that differ from the model."""

from __future__ import annotations

import runpy
from pathlib import Path

import numpy as np

from benchmarks.table import Check, Table, checked

EXAMPLES = Path(__file__).parents[1] / "ocp_examples"
FILE = EXAMPLES / "gust_load_alleviation_from_sensors.py"
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


#: Aircraft in free flight, and what each has to keep: change of height, m; of the root moment, %.
AIRCRAFT, HEIGHT, MOMENT = 10, 1.0, -20.0


def in_free_flight() -> Table:
    """The example in free flight, flown by many aircraft."""
    example = runpy.run_path(str(EXAMPLES / "free_flight_mpc.py"))
    small = example["flyer"]("model", **example["MODEL"])
    mpc, filtered = example["make_mpc"](small), example["make_filter"](small)
    found = []
    for seed in range(AIRCRAFT):
        plant = example["Plant"](seed)
        flights = example["simulate"](plant, small, mpc, *filtered, seed, native=True)
        found.append([example["peaks"](flight) for flight in flights.values()])
    heights, moments = np.moveaxis(np.array(found), -1, 0)  # (aircraft, flights) each
    changes = 100 * (moments / moments[:, :1] - 1)
    checks = [Check(what="trimmed controls: height, worst, m", value=float(heights[:, 0].max()))]
    for k, (name, most, relief) in enumerate(
        (("true state and gust", None, None), ("EKF", HEIGHT, MOMENT)), start=1
    ):
        height, change = heights[:, k], changes[:, k]
        checks += [
            Check(what=f"{name}: height, worst, m", value=float(height.max()), high=most),
            Check(what=f"{name}: height, mean, m", value=float(height.mean())),
            Check(
                what=f"{name}: root moment, worst, %",
                value=float(change.max()),
                high=relief,
                form="{:.1f}",
            ),
            Check(what=f"{name}: root moment, mean, %", value=float(change.mean()), form="{:.1f}"),
        ]
    notes = ("Each flight against trimmed controls of its own aircraft.",)
    title = f"Free flight through a gust: largest changes, {AIRCRAFT} aircraft"
    return checked(title, checks, notes)
