"""Flutter suppression and attitudes of a tip, from sensors, of wings that are not the model."""

from __future__ import annotations

import runpy
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.table import Check, Table, checked, compared

EXAMPLES = Path(__file__).parents[1] / "ocp_examples"
FLIGHTS = 20
#: Speeds over the flutter speed of each wing.
ABOVE = (1.05, 1.2)


def _example(name: str) -> dict[str, Any]:
    return runpy.run_path(str(EXAMPLES / f"{name}.py"))


def suppression() -> Table:
    """Swings that are left above the flutter speed."""
    example, checks = _example("flutter_suppression"), []
    for above in ABOVE:
        plant, found = example["simulate"](range(FLIGHTS), above)
        # A wing is damped where a tenth of what displaced it is left, the noise of the loop in it.
        displaced = example["DISPLACED"] * plant.beam.length
        closed, rest = (example["swings"](found[k]) for k in ("closed loop", "flaps at rest"))
        at = f"at {above:g} times the flutter speed"
        checks += [
            Check(
                what=f"{at}: wings that are not damped",
                value=int(np.sum(closed > displaced / 10)),
                high=0,
                form="{:.0f}",
            ),
            Check(what=f"{at}: swing of the tip, worst, m", value=closed.max(), form="{:.3f}"),
            Check(what=f"{at}: with flaps at rest, least, m", value=rest.min(), form="{:.3f}"),
        ]
    title = f"Flutter suppression from sensors, last 2 of 8 s, {FLIGHTS} wings"
    return checked(title, checks, ("Displaced by 2 % of the span, 0.32 m, at the tip.",))


def attitudes() -> Table:
    """Settling times of 10° steps of the tip."""
    example = _example("tip_attitude_tracking")
    rows, held = [], example["HELD"]
    for name, flights in example["simulate"](range(FLIGHTS)).items():
        times = example["settling"](flights)
        settled = int(np.sum(np.all(times < held, axis=0)))
        texts = [
            f"{np.median(step):.2f} / {step.max():.2f}" if settled == FLIGHTS else "–"
            for step in times
        ]
        rows.append((name, f"{settled} of {FLIGHTS}", *texts))
    return compared(
        f"10° steps of the tip at 20 m/s, from sensors, {FLIGHTS} wings",
        ("controller", "wings within 1°", "up, median / worst, s", "down, median / worst, s"),
        rows,
    )
