"""What do exported functions make of inputs that are wrong, or far from what is usual?

    python -m codegen.faults [--calls 1.0] [--seed 0] [--out out/faults]

Builds the functions of `codegen/faults/functions.py` for this machine, in both precisions and with
AddressSanitizer and UndefinedBehaviorSanitizer, calls them at random inputs, ordinary and strange,
solvers from rest and from far away, too, and prints how their calls ended. Fails where one crashes
or traps, writes its outputs in spite of a status, refuses or accepts what it should not, leaves
ordinary problems unsolved, or says OK to a result that is not right; and where two threads on their
own buffers disturb each other.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

import curvcasadi as cc
from codegen.faults import inputs as faulty
from codegen.faults.functions import CASES, REALS, Case, export
from curvcasadi.symbolic.expressions import BOUND_SLACK

CALLS_C = Path(__file__).with_name("calls.c")
STANDARD = ("-std=c99", "-D_POSIX_C_SOURCE=200809L")
MEMORY = (
    "-fsanitize=address,undefined,float-cast-overflow",
    "-fno-sanitize-recover=all",
    "-fno-omit-frame-pointer",
)
RACES = ("-fsanitize=thread",)
STATUSES = ("OK", "INFEASIBLE", "NOT_CONVERGED", "BAD_INPUT")
OK, BAD_INPUT = STATUSES.index("OK"), STATUSES.index("BAD_INPUT")
CHECKED = 300  #: calls of each function and precision whose results are compared
THREADED = 200  #: calls of each function by two threads
USUAL, HARD = "usual", "hard"  #: starts
HARD_CALLS = 0.2  #: of hard starts, over those of usual ones
SECONDS = 600  #: that a program may take


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """How the calls of one function ended."""

    case: Case
    starts: str  #: "usual" or "hard"
    real: str
    statuses: Any  #: of every call
    checked: int  #: results that were compared
    seconds: float
    slowest: float  #: of one call, s of processor time, sanitizers included
    wrong: list[str]


def build(sanitizers: Sequence[str], program: Path) -> Path:
    """`program`, that calls the functions of the export in its folder."""
    folder = program.parent
    run(
        [
            *("gcc", *STANDARD, "-O1", "-g"),
            *("-fno-var-tracking-assignments", *sanitizers, f"-I{folder}"),
            *(str(folder / "curv.c"), str(folder / "curv_functions.c"), str(CALLS_C)),
            *("-o", str(program), "-pthread", "-lm"),
        ]
    )
    return program


def cases_header(real: str) -> str:
    """A table of the functions, for calls.c."""
    lines, rows = [], []
    for case in CASES:
        f, name = case.exported(real).function, f"curv_{case.name}"
        sizes = [f.nnz_in(k) for k in range(f.n_in())]
        arguments = ", ".join(f"in[{k}]" for k in range(f.n_in()))
        lines += [
            f"static curv_status call_{case.name}(curv_real *const *in, void *work, void *out) {{",
            f"  return work ? {name}_with(work, {arguments}, out) : {name}({arguments}, out);",
            "}",
        ]
        rows.append(
            f'  {{"{case.name}", {f.n_in()}, {{{", ".join(map(str, sizes))}}}, '
            f"sizeof({name}_out), sizeof({name}_work), call_{case.name}}},"
        )
    return "\n".join([*lines, "static const function_case cases[] = {", *rows, "};", ""])


def bounds(case: Case) -> dict[str, tuple[Any, Any]]:
    """Of the inputs that hold weights with bounds."""
    return dict.fromkeys(case.weights, case.beam("double").bounds) if case.bounded else {}


def call_all(
    case: Case, real: str, program: Path, calls: int, seed: int, starts: str = USUAL
) -> Outcome:
    """Call one function `calls` times and judge what it says."""
    stream = starts.encode() if starts == HARD else b""
    random = np.random.default_rng([seed, *case.name.encode(), *stream])
    kinds, given = _inputs(case, real, random, calls, starts)
    every = max(1, calls // (8 * CHECKED))
    name = f"{case.name}_{starts}"
    written, results = program.with_name(f"{name}.in"), program.with_name(f"{name}.out")
    _write(written, given)
    begun = time.monotonic()
    said = run([str(program), case.name, str(calls), str(every), str(written), str(results)])
    seconds = time.monotonic() - begun
    statuses, rows, outputs = _read(results, case, real, calls, every)
    written.unlink()
    results.unlink()

    least = case.solved_hard if starts == HARD else case.solved
    wrong = _wrong_statuses(case, real, kinds, given, statuses, least)
    ok = [k for k, row in enumerate(rows) if statuses[row] == OK][:CHECKED]
    for k in ok:
        of_call = {key: values[rows[k]].astype(float) for key, values in given.items()}
        found = case.check(real, of_call, {key: v[k].astype(float) for key, v in outputs.items()})
        if found:
            kind = list(faulty.KINDS)[kinds[rows[k]]]
            wrong.append(f"OK, but {found} (call {rows[k]}, {kind})")
    return Outcome(
        case=case,
        starts=starts,
        real=real,
        statuses=statuses,
        checked=len(ok),
        seconds=seconds,
        slowest=float(said),
        wrong=wrong,
    )


def _inputs(case: Case, real: str, random: Any, calls: int, starts: str) -> tuple[Any, Any]:
    """Kinds and inputs of the calls; none of the hard starts goes wrong otherwise."""
    if starts == HARD:
        assert case.hard
        hard = case.hard(case.beam(real), random, calls)
        given = {key: np.asarray(values, dtype=REALS[real]) for key, values in hard.items()}
        return np.zeros(calls, dtype=int), given
    kinds = faulty.draw(random, calls)
    ordinary = case.ordinary(case.beam(real), random, calls)
    return kinds, faulty.spoil(random, kinds, ordinary, bounds(case), REALS[real])


def _write(path: Path, given: dict[str, Any]) -> None:
    np.ascontiguousarray(np.hstack([*given.values()])).tofile(path)


def _read(path: Path, case: Case, real: str, calls: int, every: int) -> tuple[Any, Any, Any]:
    """Statuses of all calls, the calls with outputs, and these by name."""
    f, kind = case.exported(real).function, np.dtype(REALS[real])
    sizes = [f.nnz_out(k) for k in range(f.n_out())]
    width = sum(sizes) * kind.itemsize
    rows = np.arange(0, calls, every)
    text = np.frombuffer(path.read_bytes(), dtype=np.uint8)
    places = np.arange(calls) + (np.arange(calls) + every - 1) // every * width
    outs = text[(places[rows] + 1)[:, None] + np.arange(width)]
    values = np.split(np.ascontiguousarray(outs).view(kind), np.cumsum(sizes)[:-1], axis=1)
    return text[places], rows, dict(zip(f.name_out(), values, strict=True))


def _wrong_statuses(
    case: Case, real: str, kinds: Any, given: Any, statuses: Any, least: float
) -> list[str]:
    """What is refused or accepted without reason, and too many problems left unsolved."""
    bad, unclear = faulty.bad(given, bounds(case)), np.zeros(len(statuses), dtype=bool)
    if not case.bounded:
        turned, rounding = _angles(case.beam(real), given[case.weights[0]])
        bad, unclear = bad | ~(turned <= 1), np.abs(turned - 1) <= rounding
    wrong = []
    refused = statuses == BAD_INPUT
    for what, of in (("refused good", refused & ~bad), ("accepted bad", ~refused & bad)):
        calls = np.flatnonzero(of & ~unclear)
        if calls.size:
            wrong.append(f"{what} input {calls.size} times, first in call {calls[0]}")
    solved = np.mean(statuses[(kinds == 0) & ~bad] == OK)
    if solved < least:
        wrong.append(f"solved {solved:.4f} of such problems, expected {least}")
    if not case.exported(real).is_solver and np.any((statuses != OK) & ~refused):
        wrong.append("a map has a status of solvers")
    return wrong


def _angles(beam: cc.Beam, q: Any) -> tuple[Any, Any]:
    """Largest squared angle of an element over what is allowed, and what rounding makes of that.

    An angle is h |Φ q|, midpoint curvatures times lengths: each of n products and sums, and some
    eight more operations up to the comparison, rounds by at most ε/2 of h |Φ| |q|.
    """
    limit = beam.grid.max_angle * (1 + BOUND_SLACK[beam.grid.real])  # as in Python and in C
    symbol = ca.MX.sym("q", beam.basis.n)
    largest = ca.mmax(cc.squared_element_angles(beam, symbol)) / limit**2
    function = ca.Function("angles", [symbol], [largest]).expand()
    q = q.astype(float)
    with np.errstate(over="ignore", invalid="ignore"):
        turned = function.map(len(q))(q.T).full().ravel()
        sizes = []
        for a, b in pairwise(beam.stations):
            curvatures = np.abs(q) @ np.abs(np.array(beam.basis((a + b) / 2))).T
            sizes.append((b - a) * beam.length * np.linalg.norm(curvatures, axis=1))
        roundings = (beam.basis.n + 8) * np.finfo(REALS[beam.grid.real]).eps
        return turned, roundings * (np.max(sizes, axis=0) / limit) ** 2


def call_by_threads(case: Case, real: str, program: Path) -> None:
    """Call one function by one thread, and by two at once on buffers of their own."""
    random = np.random.default_rng(1)
    ordinary = case.ordinary(case.beam(real), random, THREADED)
    written = program.with_name(f"{case.name}.threads")
    _write(written, {key: values.astype(REALS[real]) for key, values in ordinary.items()})
    run([str(program), case.name, str(THREADED), "threads", str(written)])
    written.unlink()


def run(command: Sequence[str]) -> str:
    """Output of a program.

    Raises
    ------
    RuntimeError
        If it fails, with the first lines that it said.
    """
    quiet = {"ASAN_OPTIONS": "detect_leaks=0", "TSAN_OPTIONS": "halt_on_error=1"}
    done = subprocess.run(
        command,
        capture_output=True,
        text=True,
        errors="replace",
        check=False,
        timeout=SECONDS,
        env={**os.environ, **quiet},
    )
    if done.returncode:
        said = "\n".join((done.stderr + done.stdout).strip().splitlines()[:12])
        raise RuntimeError(f"{' '.join(command[:3])} … ended with {done.returncode}:\n{said}")
    return done.stdout


def table(outcomes: Sequence[Outcome]) -> str:
    """One line a function and precision."""
    rows = [["function", "starts", "real", "calls", *STATUSES, "checked", "s", "slowest, ms"]]
    for x in outcomes:
        counts = [np.sum(x.statuses == k) for k in range(len(STATUSES))]
        cells = [len(x.statuses), *counts, x.checked, round(x.seconds), round(1e3 * x.slowest)]
        numbers = (f"{cell:,}".replace(",", " ") for cell in cells)
        rows.append([x.case.name, x.starts, x.real, *numbers])
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return "\n".join(
        "  ".join(
            cell.ljust(width) if i < 3 else cell.rjust(width)
            for i, (cell, width) in enumerate(zip(row, widths, strict=True))
        )
        for row in rows
    )


def faults(out: Path, calls: float, seed: int, pool: ThreadPoolExecutor) -> tuple[list, list[str]]:
    """(outcomes, what is wrong) of all functions in both precisions."""
    for real in REALS:
        export(real, out / real)
        (out / real / "cases.h").write_text(cases_header(real))
    programs = dict(
        zip(REALS, pool.map(lambda r: build(MEMORY, out / r / "memory"), REALS), strict=True)
    )
    racing = pool.submit(build, RACES, out / "float" / "races")
    tasks = {}
    for case in sorted(CASES, key=lambda case: "path" not in case.name):  # the longest first
        for starts, part in [(USUAL, 1.0), *([(HARD, HARD_CALLS)] if case.hard else [])]:
            for real in REALS:
                count = max(1, round(calls * part * case.calls))
                given = (case, real, programs[real], count, seed, starts)
                tasks[case, starts, real] = pool.submit(call_all, *given)
    wrong, outcomes = [], []
    for (case, starts, real), task in tasks.items():
        place = f"{case.name}, {starts} starts, {real}"
        try:
            outcome = task.result()
        except (RuntimeError, subprocess.TimeoutExpired) as error:
            wrong.append(f"{place}: {error}")
            continue
        outcomes.append(outcome)
        more = len(outcome.wrong) - 5
        wrong += [f"{place}: {line}" for line in outcome.wrong[:5]]
        wrong += [f"{place}: and {more} more"] if more > 0 else []
    for case in CASES:
        try:
            call_by_threads(case, "float", racing.result())
        except (RuntimeError, subprocess.TimeoutExpired) as error:
            wrong.append(f"{case.name}, two threads: {error}")
    return outcomes, wrong


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--calls", type=float, default=1.0, help="times the usual number of calls")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path("out/faults"), metavar="FOLDER")
    options = parser.parse_args()

    if shutil.which("gcc") is None:
        print("gcc is missing (Debian: apt-get install gcc)", file=sys.stderr)
        return 2
    with ThreadPoolExecutor(2) as pool:
        outcomes, wrong = faults(options.out, options.calls, options.seed, pool)
    print("Calls with ordinary and strange inputs, and how they ended:\n")
    print(table(outcomes))
    print("\n".join(["", "Wrong:", *wrong]) if wrong else "\nNo fault; two threads agree with one.")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
