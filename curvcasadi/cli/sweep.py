"""The command `curvcasadi sweep`: gust encounters over speeds, gusts, stiffness and mass."""

from __future__ import annotations

import argparse
import csv
from pathlib import Path
from typing import Any

import numpy as np

from curvcasadi.cli.options import output
from curvcasadi.files.study import CASE_COLUMNS, RESULT_COLUMNS, load_study
from curvcasadi.symbolic.sweep import Sweep, sweep

HELP = """\
Every combination of airspeeds, gusts, stiffness and mass factors of a study file: the wing flies
level in steady flow, meets a 1 - cos gust, and the largest and smallest tip deflection and root
moments are kept. Cases of one stiffness and mass run at once in the lanes of vector registers.

  wing = "wing.toml"                    # with [section] and [aerodynamics]
  [cases]
  airspeeds = [20, 25, 30]              # m/s
  gust_lengths = [10, 20, 40]           # m
  gust_amplitudes = [2.0]               # m/s, upward
  stiffness_factors = [0.9, 1.0, 1.1]
  mass_factors = [1.0]
  [simulation]
  density = 1.225                       # kg/m3
  duration = 3.0                        # s
  step = 0.002                          # s, of the classical Runge-Kutta method

outputs:
  --out cases.csv   a line for each case: its numbers, tip_up_largest, tip_up_smallest (m, body
                    axes), root_moment_x_largest, ... (N m), and the error of a case that failed
  --record s.sqlite keeps finished cases: the same command goes on after an interruption

--scheduler ADDRESS hands the cases to the dask cluster there (extra: fleet).

exit codes: 0; 2 after an error in the input; 3 if cases failed: the others are written.
"""


def add_parser(commands: Any) -> None:
    """Add the command to the subparsers of `argparse`."""
    parser = commands.add_parser(
        "sweep",
        help="gust encounters over speeds, gusts, stiffness and mass",
        description=HELP,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("study", type=Path, metavar="STUDY.toml", help="study file")
    parser.add_argument("--out", type=output(".csv"), metavar="FILE.csv", help="all cases")
    parser.add_argument("--record", type=Path, metavar="FILE", help="file of finished cases")
    parser.add_argument("--scheduler", metavar="ADDRESS", help="of a dask cluster")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Run the cases, print the extremes, and write what was asked for; returns the exit code."""
    study = load_study(arguments.study)
    client = _client(arguments.scheduler) if arguments.scheduler else None
    result = sweep(
        study,
        study.cases,
        client,
        batched=True,
        record=arguments.record,
        progress=arguments.progress,
    )
    print(_table(result))
    if arguments.out:
        _write(arguments.out, result)
        print(f"wrote {arguments.out}")
    for i, error in list(result.errors.items())[:5]:
        print(f"case {i + 1} failed: {error}")
    return 3 if result.errors else 0


def _client(address: str) -> Any:
    try:
        from distributed import Client
    except ImportError as error:
        raise ValueError(
            '--scheduler needs dask.distributed: pip install "curvcasadi[fleet]"'
        ) from error
    return Client(address)


def _table(result: Sweep) -> str:
    """The extreme of each quantity, and the case that has it."""
    lines = [f"{len(result.results)} cases, {len(result.errors)} failed"]
    if len(result.errors) == len(result.results):
        return lines[0]
    values = result.array
    names = [name.replace("_factor", "") for name in CASE_COLUMNS]
    lines.append(f"{'':<24}{'value':>12}" + "".join(f"{name:>16}" for name in names))
    for column, name in enumerate(RESULT_COLUMNS):
        find = np.nanargmax if name.endswith("largest") else np.nanargmin
        case = int(find(values[:, column]))
        numbers = "".join(f"{number:16g}" for number in result.cases[case])
        lines.append(f"{name:<24}{values[case, column]:12.5g}{numbers}")
    return "\n".join(lines)


def _write(path: Path, result: Sweep) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow([*CASE_COLUMNS, *RESULT_COLUMNS, "error"])
        for i, case in enumerate(result.cases):
            numbers = [""] * len(RESULT_COLUMNS)
            if i not in result.errors:
                numbers = [repr(float(value)) for value in result.results[i]]
            writer.writerow([*case.tolist(), *numbers, result.errors.get(i, "")])
