"""Size and speed of the generated C, gcc on this machine."""

from __future__ import annotations

import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import casadi as ca

import curvcasadi as cc
from benchmarks.cost import ad_function
from benchmarks.table import Check, Table, checked, compared
from curvcasadi.beam.grid import RuleName
from curvcasadi.symbolic.expressions import Array
from tests.support.wing import wing

KIB = 1024
ELEMENTS = 32
NO_GCC = "gcc is not installed: no C was compiled (Debian: apt-get install gcc)."

#: Calls `tip` for ever longer, prints the least nanoseconds per call of several rounds.
_DRIVER = """
#include <stdio.h>
#include <time.h>
#include "tip.h"

static double now(void) {
  struct timespec t;
  clock_gettime(CLOCK_MONOTONIC, &t);
  return 1e9 * (double)t.tv_sec + (double)t.tv_nsec;
}

int main(void) {
  static casadi_real q[] = {WEIGHTS}, out[tip_SZ_RES][1024], w[tip_SZ_W + 1];
  static casadi_int iw[tip_SZ_IW + 1];
  const casadi_real *arg[tip_SZ_ARG];
  casadi_real *res[tip_SZ_RES];
  double best = 1e300;
  int round, call, k;
  for (round = 0; round < 9; ++round) {
    double start = now();
    for (call = 0; call < CALLS; ++call) {
      q[0] += 1e-9; /* no call is the one before */
      arg[0] = q;
      for (k = 0; k < tip_SZ_RES; ++k) res[k] = out[k];
      tip(arg, res, iw, w, 0);
    }
    start = (now() - start) / CALLS;
    if (start < best) best = start;
  }
  printf("%.3f\\n", best);
  return 0;
}
"""


@dataclass(frozen=True, kw_only=True)
class Compiled:
    """One Function "tip" as an object file of gcc, and its time per call."""

    text: int  #: bytes of code and constants (`size`)
    code: int  #: bytes of .text alone (`size -A`)
    work: int  #: doubles of work array
    seconds_of_gcc: float
    nanoseconds: float  #: per call; NaN if it was not run


def sizes() -> Table:
    """Pose and Jacobian in compact form."""
    title = f"Generated C: pose and 6 × 6 Jacobian, compact, {ELEMENTS} elements, gcc -Os"
    if not shutil.which("gcc"):
        return checked(title, [], (NO_GCC,))
    limits: dict[RuleName, bool] = {"magnus4": True, "midpoint": False, "magnus6": False}
    checks = [check for rule, counted in limits.items() for check in _size_checks(rule, counted)]
    return checked(
        title,
        checks,
        (
            "Text is code and constants (`size`), .text code alone (`size -A`); Legendre 2 a",
            "channel, 6 weights. A further element: the difference of 64 and 32 elements.",
        ),
    )


def _size_checks(rule: RuleName, counted: bool) -> list[Check]:
    small, large = (_compact(rule, n) for n in (ELEMENTS, 2 * ELEMENTS))
    slope = (large.text - small.text) / ELEMENTS
    rows = (
        ("text, KiB", small.text / KIB, 17.0, "{:.1f}"),
        (".text alone, KiB", small.code / KIB, 17.0, "{:.1f}"),
        ("work doubles", small.work, 450.0, "{:.0f}"),
        ("text of a further element, bytes", slope, 160.0, "{:.0f}"),
        (f"text of {2 * ELEMENTS} elements, KiB", large.text / KIB, None, "{:.1f}"),
    )
    return [
        Check(what=f"{rule}: {what}", value=value, form=form, high=high if counted else None)
        for what, value, high, form in rows
    ]


@lru_cache(maxsize=16)
def _compact(rule: RuleName, elements: int) -> Compiled:
    return compiled(cc.tip_function(wing(elements, rule, per_channel=2), jacobian=True), "-Os")


def against_ad() -> Table:
    """The structured Jacobian beside AD of the chain, in size, speed and time of gcc."""
    title = f"Generated C: pose and Jacobian of {ELEMENTS} magnus4 elements, 6 weights"
    if not shutil.which("gcc"):
        return checked(title, [], (NO_GCC,))
    beam = wing(ELEMENTS, per_channel=2)
    weights = 0.1 / (1.0 + ca.DM(range(6))).full().ravel()
    cases: tuple[tuple[str, Callable[[], ca.Function], str], ...] = (
        ("compact, structured", lambda: cc.tip_function(beam, jacobian=True), "-Os"),
        ("compact, structured", lambda: cc.tip_function(beam, jacobian=True), "-O2"),
        ("unrolled, structured", lambda: cc.tip_function(beam, "unrolled", jacobian=True), "-Os"),
        ("MX calls, AD", lambda: ad_function(beam, ca.MX), "-Os"),
        ("MX calls, AD", lambda: ad_function(beam, ca.MX), "-O2"),
        ("plain SX, AD", lambda: ad_function(beam, ca.SX), "-Os"),
    )
    results = [compiled(make(), flag, weights) for _, make, flag in cases]
    own = results[0]
    rows = [
        (
            f"{name}, {flag}",
            f"{r.text / KIB:.1f}",
            f"{r.work}",
            f"{r.text / own.text:.1f}",
            f"{r.nanoseconds / own.nanoseconds:.2f}",
            f"{r.seconds_of_gcc / own.seconds_of_gcc:.1f}",
        )
        for (name, _, flag), r in zip(cases, results, strict=True)
    ]
    headers = (
        "C",
        "text, KiB",
        "work doubles",
        "text, ratio",
        "time per call, ratio",
        "gcc, ratio",
    )
    notes = (
        "Ratios to the first row, of one run. AD rows give the (12, 6) derivative of position and",
        "rotation. Plain SX with AD is compiled at -Os alone, to save time.",
    )
    return compared(title, headers, rows, notes)


def compiled(function: ca.Function, flag: str, weights: Array | None = None) -> Compiled:
    """C of a Function "tip", compiled with the optimisation `flag`; run if weights are given."""
    with tempfile.TemporaryDirectory() as directory:
        folder = Path(directory)
        generator = ca.CodeGenerator("tip.c", {"with_header": True, "casadi_int": "int"})
        generator.add(function)
        generator.generate(f"{folder}/")
        start = time.perf_counter()
        _run(folder, "gcc", "-std=c99", flag, "-c", "tip.c", "-o", "tip.o")
        seconds = time.perf_counter() - start
        text = int(_run(folder, "size", "tip.o").splitlines()[1].split()[0])
        sections = dict(
            line.split()[:2]
            for line in _run(folder, "size", "-A", "tip.o").splitlines()[2:]
            if line
        )
        nanoseconds = float("nan") if weights is None else _time(folder, flag, weights)
        return Compiled(
            text=text,
            code=int(sections[".text"]),
            work=function.sz_w(),
            seconds_of_gcc=seconds,
            nanoseconds=nanoseconds,
        )


def _time(folder: Path, flag: str, weights: Array) -> float:
    driver = _DRIVER.replace("WEIGHTS", ", ".join(f"{x:.17g}" for x in weights))
    (folder / "driver.c").write_text(driver.replace("CALLS", "4000"))
    _run(folder, "gcc", "-std=gnu99", flag, "driver.c", "tip.o", "-o", "driver", "-lm")
    return float(_run(folder, "./driver"))


def _run(folder: Path, *command: str) -> str:
    """Standard output of a command, run in `folder`."""
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(f"{' '.join(command)} failed: {done.stderr}")
    return done.stdout
