"""Run the benchmarks: `python -m benchmarks [--quick]`.

The exit status is non-zero if a counted requirement is not met; timings are not counted.
"""

from __future__ import annotations

import argparse
import os
import platform
import sys
from collections.abc import Callable
from importlib.metadata import PackageNotFoundError, version

from tqdm import tqdm

from benchmarks import (
    accuracy,
    air,
    alleviation,
    alternatives,
    batch,
    cost,
    dynamics,
    estimation,
    flight,
    flight_margin,
    flutter,
    generated_c,
    loops,
    model_estimation,
    motion,
    parallel,
    placement,
    predictive,
    qp,
    solver_cost,
    statics,
    tracking,
    waiting,
)
from benchmarks.table import Table

Section = Callable[[], Table]

#: Errors, node counts and bytes: all that is required.
COUNTED: tuple[Section, ...] = (
    accuracy.rules,
    accuracy.errors,
    cost.per_element,
    cost.growth,
    cost.against_the_trapezoid_rule,
    generated_c.sizes,
    accuracy.rotations,
    accuracy.closed_forms,
    accuracy.approximations,
    alternatives.straight_wing,
    statics.published,
    statics.cost,
    dynamics.nodes,
    dynamics.bytes_of_c,
    dynamics.frequencies,
    motion.energy,
    motion.free_flight,
    air.unsteady,
    flutter.bent_wings,
    flutter.turbulence,
    flight.trimmed,
    flight.turning,
    placement.fits,
    placement.placements,
    estimation.consistency,
    estimation.convergence,
    estimation.bad_data,
    estimation.single_precision,
    model_estimation.consistency,
    model_estimation.of_another_wing,
    model_estimation.recovery,
    model_estimation.windows,
    predictive.agreement,
    predictive.regulator,
    predictive.endless,
    alleviation.from_sensors,
    loops.suppression,
    alleviation.in_free_flight,
    flight_margin.margins,
    tracking.chosen,
    qp.programs,
    qp.size,
    qp.steps,
    solver_cost.against_qrqp,
    waiting.memory,
)
#: Times, which are never counted, and C that gcc takes long for.
TIMED: tuple[Section, ...] = (
    generated_c.against_ad,
    alternatives.side_by_side,
    parallel.many_weights,
    parallel.within_one_wing,
    batch.over_map,
    batch.over_jax,
    batch.over_limit,
    batch.threads,
    batch.gust_cases,
    tracking.shape_target_dampings,
    tracking.tip_path_dampings,
    qp.wings_from_rest,
    dynamics.times,
    motion.times,
    predictive.times,
    predictive.programs,
    loops.attitudes,
    waiting.ratios,
)


def main(arguments: list[str] | None = None) -> int:
    """Print the tables; 0 if every counted requirement is met."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="no timings, no C of AD Jacobians")
    quick = parser.parse_args(arguments).quick
    sections = COUNTED if quick else COUNTED + TIMED
    print(f"# curvcasadi benchmarks\n\n{_versions()}\n", flush=True)
    failures = requirements = 0
    with tqdm(sections, file=sys.stderr) as progress:
        for section in progress:
            progress.set_description(section.__name__.replace("_", " "))
            table = section()
            progress.clear()
            print(table.render(), end="\n\n", flush=True)
            failures += table.failures
            requirements += table.requirements
    print(f"{requirements - failures} of {requirements} requirements met.")
    return 1 if failures else 0


def _versions() -> str:
    packages = ("casadi", "numpy", "jax", "soromox")
    found = ", ".join(f"{name} {_version(name)}" for name in packages)
    return f"Python {platform.python_version()}, {found}; {os.cpu_count()} processor cores."


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "not installed"


if __name__ == "__main__":
    sys.exit(main())
