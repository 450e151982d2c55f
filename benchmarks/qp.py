"""The quadratic-program solver of exported C on the library's own programs, and what steps cost."""

from __future__ import annotations

import re
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import replace
from functools import cache
from itertools import islice, product
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
from scipy.optimize import linprog
from tqdm import tqdm

import curvcasadi as cc
from benchmarks.native import KINDS, NativeFunction
from benchmarks.table import Check, Table, checked
from codegen import benchmark_functions, toolchain
from curvcasadi.lie import so3
from curvcasadi.solvers.gauss_newton import GaussNewton
from curvcasadi.solvers.qp import QP_TOLERANCES, QuadraticProgram, qp_source
from tests.support.native_qp import NativeQp
from tests.support.quadratic_programs import residuals

Programs = Iterator[QuadraticProgram]

SENSORS = (
    *(cc.StrainGauge(xi=xi, offset=(0.0, 0.06), noise=2e-4) for xi in (0.1, 0.4, 0.7)),
    cc.AttitudeSensor(xi=0.5, noise=0.02),
    cc.AttitudeSensor(xi=1.0, noise=0.02),
    cc.Marker(xi=1.0, noise=0.01),
)


@cache
def _beam(bound: float | None = 0.1) -> cc.Beam:
    """The wing of 6 weights whose solvers are measured on a target."""
    return replace(benchmark_functions.wing(8, rule="magnus4", real="double"), weight_bounds=bound)


def _along(problem: GaussNewton, x: Any, p: Any, solve: NativeQp) -> Programs:
    """The programs of full steps from x, those of the library's own solver."""
    lower, upper = problem.limits
    x = np.asarray(ca.DM(x).full().ravel())
    for _ in range(4):
        _, g, H, c, At = problem.linearization(x, p)
        here = np.concatenate([x, ca.DM(c).full().ravel()])
        program = QuadraticProgram(
            H=ca.triu2symm(H).full(),
            g=g.full().ravel(),
            A=At.full().T,
            lower=lower - here,
            upper=upper - here,
        )
        yield program
        result = solve(program)
        if result.status != "solved" or np.max(np.abs(result.x)) < 1e-6:
            return
        x = np.clip(x + result.x, lower[: problem.n], upper[: problem.n])


def _tip_path(stages: int, kind: str, solve: NativeQp) -> Programs:
    beam = _beam()
    n, tip = beam.basis.n, cc.tip_function(beam)
    bounds = {"rate_bound": 0.1, "curvature_bound": 0.06} if kind == "tight" else {}
    step: Any = cc.tip_path_step_function(
        cc.kinematic_model(beam, time_constant=0.25), dt=0.05, horizon=stages, **bounds
    )
    random = np.random.default_rng(stages)
    while True:
        x, goal = random.uniform(-0.02, 0.02, n), random.uniform(-0.05, 0.05, n)
        pose = [
            ca.repmat(part, 1, stages) for part in tip(x + 0.05 * goal if kind == "near" else goal)
        ]
        inputs = [x, np.zeros(n), x, *pose, np.zeros(2 * stages * n)]
        begin = step.solver.begin.call(inputs)
        yield from _along(step.solver.problem, *begin, solve)


def _shape_target(bound: float | None, curvature: float | None, solve: NativeQp) -> Programs:
    beam = replace(_beam(bound), grid=cc.Grid.uniform(16, max_angle=0.7))
    n, tip = beam.basis.n, cc.tip_function(beam)
    random = np.random.default_rng(7)
    target = cc.Target(xi=1.0, position=[15.0, 0, 3], rotation=np.eye(3), weight=1.0)
    options: dict[str, Any] = {"regularization": 1e-4, "curvature_bound": curvature}
    weighted: Any = cc.shape_target_function(beam, [target], **options)
    met: Any = cc.shape_target_function(beam, [replace(target, weight=None)], **options)
    while True:
        position, rotation = tip(random.uniform(-0.06, 0.06, n))
        for function in (weighted, met):
            begin = function.solver.begin.call([np.full(n, 0.005), position, rotation])
            yield from _along(function.solver.problem, *begin, solve)


def _window(process: Any, window: int, solve: NativeQp) -> Programs:
    beam = _beam(0.03)
    n, order = beam.basis.n, 1 if process == "random_walk" else 2
    mhe: Any = cc.shape_mhe(
        beam, SENSORS, dt=0.05, window=window, process=process, density=0.03, rate_bound=0.05
    )
    start = mhe.initial({"q": 0.02, "q_dot": 0.05} if order == 2 else {"q": 0.02})
    random = np.random.default_rng(3)
    while True:
        q = random.uniform(-0.04, 0.04, n)
        read = cc.measure(SENSORS, replace(beam, weight_bounds=None), q).values.full().ravel()
        samples = read[:, None] + 1e-3 * random.standard_normal((read.size, window + 1))
        begin = mhe.step.solver.begin(
            arrival_mean=start.arrival_mean,
            arrival_factor=start.arrival_factor,
            measured=samples,
            guess=start.guess,
        )
        yield from _along(mhe.step.solver.problem, begin["start"], begin["parameters"], solve)


def feasible_sources(solve: NativeQp) -> dict[str, tuple[Programs, int]]:
    """Programs by what they are of, and how many are taken."""
    found: dict[str, tuple[Programs, int]] = {}
    for stages, kind in product((4, 8, 16), ("near", "far", "tight")):
        count = 40 if stages < 16 else 12
        found[f"tip path, {stages} stages, {kind}"] = _tip_path(stages, kind, solve), count
    for bound, curvature in product((0.1, None), (None, 0.05)):
        free = {True: "bounded", False: "free"}
        words = f"weights {free[bound is not None]}, curvatures {free[curvature is not None]}"
        found[f"shape target, {words}"] = _shape_target(bound, curvature, solve), 30
    for process, window in product(("random_walk", "white_acceleration"), (4, 8)):
        found[f"window of {window}, {process}"] = _window(process, window, solve), 20
    return found


def excess(program: QuadraticProgram) -> float:
    """Least t such that some x misses no limit by more than t: a linear program of HiGHS."""
    n = len(program.g)
    rows, upper, lower = np.vstack([np.eye(n), program.A]), program.upper, program.lower
    above, below = np.isfinite(upper) & (upper < 1e29), np.isfinite(lower) & (lower > -1e29)
    A = np.vstack([rows[above], -rows[below]])
    b = np.concatenate([upper[above], -lower[below]])
    A = np.hstack([A, -np.ones((len(A), 1))])
    cost = np.append(np.zeros(n), 1.0)
    limits = [(None, None)] * n + [(0, None)]
    found = linprog(
        cost, A, b, bounds=limits, method="highs", options={"primal_feasibility_tolerance": 1e-10}
    )
    return float(found.fun)


def contradicted(program: QuadraticProgram, random: np.random.Generator) -> QuadraticProgram | None:
    """The program with one more row, the sum of some, that lies beyond what their limits allow."""
    n = len(program.g)
    rows = np.vstack([np.eye(n), program.A])
    finite = np.flatnonzero(np.isfinite(program.lower) & np.isfinite(program.upper))
    if finite.size < 2:
        return None
    chosen = random.choice(finite, min(3, finite.size), replace=False)
    share = random.uniform(0.5, 1.5, len(chosen))
    row = share @ rows[chosen]
    beyond = share @ program.upper[chosen] + 1e-3 * np.abs(row).sum()
    return replace(
        program,
        A=np.vstack([program.A, row]),
        lower=np.append(program.lower, beyond),
        upper=np.append(program.upper, np.inf),
    )


def _judged(program: QuadraticProgram, solve: NativeQp, real: str) -> str:
    """How a program ended: right, or what is wrong."""
    rounded, tolerance = program.rounded(KINDS[real]), QP_TOLERANCES[real]
    result = solve(rounded)
    if result.status == "solved":
        miss, left, _ = residuals(rounded, result.x, result.lam)
        largest = float(np.max(np.diag(rounded.H)))
        size = largest + float(np.abs(result.lam).sum() + np.abs(rounded.g).max())
        is_right = miss <= 1.01 * tolerance.primal and left <= (
            tolerance.dual * largest + 8 * np.finfo(KINDS[real]).eps * size
        )
        return "solved" if is_right else "wrongly solved"
    least = excess(rounded)
    if result.status == "infeasible":
        return "infeasible" if least > 0 else "wrongly infeasible"
    return "not solved" if least <= tolerance.primal else "not proved"


@cache
def _dumped() -> dict[str, list[QuadraticProgram]]:
    with tempfile.TemporaryDirectory() as folder:
        solve = NativeQp.compiled(Path(folder), "double")
    sources = feasible_sources(solve)
    return {
        name: list(islice(programs, count))
        for name, (programs, count) in tqdm(sources.items(), desc="programs")
    }


def programs() -> Table:
    """Programs dumped from the library's own solvers, and the same made infeasible."""
    dumped = _dumped()
    random = np.random.default_rng(0)
    every = [program for found in dumped.values() for program in found]
    broken = [c for p in every[::4] if (c := contradicted(p, random)) is not None]
    checks = [
        Check(what="programs", value=len(every), form="{:.0f}", low=400),
        Check(what="infeasible ones", value=len(broken), form="{:.0f}", low=100),
    ]
    for real in KINDS:
        with tempfile.TemporaryDirectory() as folder:
            solve = NativeQp.compiled(Path(folder), real)
        counts = Counter(_judged(p, solve, real) for p in every)
        others = Counter(_judged(p, solve, real) for p in broken)
        rows = {
            "solved": (counts["solved"], None),
            "proved infeasible": (others["infeasible"], None),
            "feasible, not solved": (counts["not solved"] + counts["wrongly infeasible"], 0),
            "called solved, and are not": (counts["wrongly solved"] + others["solved"], 0),
            "infeasible, without a proof": (
                counts["not proved"] + others["not proved"] + others["not solved"],
                0,
            ),
        }
        for what, (value, high) in rows.items():
            checks.append(Check(what=f"{real}: {what}", value=value, form="{:.0f}", high=high))
    return checked("Quadratic programs of the library's own solvers", checks)


def size() -> Table:
    """Bytes of code of the solver on a Cortex-M4F in single precision."""
    title = "The quadratic-program solver on a Cortex-M4F, float"
    missing = toolchain.missing_tools()
    if missing:
        return checked(title, [], missing)
    with tempfile.TemporaryDirectory() as name:
        source, target = Path(name, "qp.c"), Path(name, "qp.o")
        prototype = (
            "int solve(const qp_problem *p, qp_real *x, qp_real *lam, int *side, qp_real *w,"
        )
        prototype += " int *set, int *changes)"
        source.write_text(
            f"#include <math.h>\n{qp_source('float')}\n{prototype};\n{prototype} {{\n"
            "  return (int)qp_solve(p, x, lam, side, w, set, changes);\n}\n"
        )
        toolchain.compile_c(source, target, "cortex-m4", real="float")
        printed = toolchain.run(["arm-none-eabi-size", str(target)])
    text = int(printed.splitlines()[1].split()[0])
    return checked(title, [Check(what="text, bytes", value=text, form="{:.0f}", high=5 * 1024)])


#: Hooks of the self-test that print every call.
_EVERY_CALL = """#include <stdio.h>
#include "measure.h"
#undef CHECK_END
#define CHECK_END(name) printf("call %lu\\n", (unsigned long)measure_end());
"""


def _starts(beam: cc.Beam, count: int) -> list[tuple[Any, ...]]:
    """States, and paths to poses elsewhere, without a plan."""
    random = np.random.default_rng(2)
    n, stages, tip = beam.basis.n, benchmark_functions.STAGES, cc.tip_function(beam)
    found = []
    for _ in range(count):
        x, goal = random.uniform(-0.005, 0.005, n), random.uniform(-0.03, 0.03, n)
        pose = [ca.repmat(part, 1, stages) for part in tip(goal)]
        found.append((x, np.zeros(n), x, *pose, np.zeros(2 * stages * n)))
    return found


def instructions(function: ca.Function, beam: cc.Beam, samples: list[Any]) -> list[int]:
    """Of a call at each of the samples, on an emulated Cortex-M4F; the first at rest."""
    cpu = "cortex-m4"
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        exported = cc.CFunction(function=function, tolerance=1.0)
        inputs = {function.name(): samples}
        cc.export_c([exported], folder, real="float", beam=beam, reference_inputs=inputs)
        (folder / "every_call.h").write_text(_EVERY_CALL)
        hooks = ['-DCHECK_HOOKS="every_call.h"', "-std=gnu99", f"-I{toolchain.CORTEX_M}"]
        objects = toolchain.startup(folder, cpu)
        for source in ("curv", "curv_functions", "check"):
            options = hooks if source == "check" else []
            target = folder / f"{source}.o"
            objects.append(
                toolchain.compile_c(folder / f"{source}.c", target, cpu, options=options)
            )
        program = folder / "check.elf"
        toolchain.link(objects, program, cpu)
        printed = toolchain.emulate(program, cpu)
    return [int(found) for found in re.findall(r"^call (\d+)$", printed, re.M)]


def steps() -> Table:
    """Largest over median instructions of real-time iterations from random starts."""
    beam, checks = benchmark_functions.FEW_ELEMENTS, []
    kinds: dict[str, Callable[[cc.Beam], list[ca.Function]]] = {
        "free": benchmark_functions.far_tip_path,
        "rates and curvatures bounded": benchmark_functions.bounded_tip_path,
    }
    missing = toolchain.missing_tools()
    if missing:
        return checked("Instructions of the tip-path step", [], missing)
    starts = _starts(beam, 1000)
    parts = [starts[k : k + 100] for k in range(0, len(starts), 100)]
    for kind, build in kinds.items():
        (function,) = build(beam)
        count = len(parts)
        with ThreadPoolExecutor(2) as pool:
            each = pool.map(instructions, [function] * count, [beam] * count, parts)
            found = [n for part in each for n in part]
        median = float(np.median(found))
        checks += [
            Check(what=f"{kind}: steps", value=len(found), form="{:.0f}"),
            Check(what=f"{kind}: median, million instructions", value=median / 1e6),
            Check(what=f"{kind}: largest, million instructions", value=max(found) / 1e6),
            Check(what=f"{kind}: largest over median", value=max(found) / median, high=4),
        ]
    return checked(
        "Instructions of the tip-path step from random starts, Cortex-M4F, float", checks
    )


def _random_wing(random: np.random.Generator, real: Any) -> cc.Beam:
    length = float(random.uniform(1, 20))
    kinds = [cc.Legendre, cc.Chebyshev, cc.FreeTip, lambda n: cc.BSpline(max(n, 4))]
    family = kinds[random.integers(len(kinds))]
    counts = random.integers(1, [4, 6, 4])
    names = ("torsion", "out_of_plane", "in_plane")
    basis = cc.ChannelBasis(**{k: family(int(c)) for k, c in zip(names, counts, strict=True)})
    sweep, dihedral = random.uniform(-0.6, 0.6), random.uniform(-0.2, 0.2)
    turn = [ca.DM([0, 0, sweep]), ca.DM([0, dihedral, 0])]
    rotation = so3.exp(turn[0]) @ so3.exp(turn[1])
    return cc.Beam(
        length=length,
        basis=basis,
        grid=cc.Grid.uniform(int(random.integers(6, 17)), real=real),
        root=cc.Pose(rotation=rotation, position=random.uniform(-1, 1, 3)),
        initial_curvature=random.uniform(-0.1, 0.1, 3) / length,
        weight_bounds=float(1.5 / length),
    )


def from_rest(seed: int, real: str) -> str:
    """Status of a shape target in reach, from weights of zero, of one wing."""
    random = np.random.default_rng([seed, 11])
    beam = _random_wing(random, real)
    n = beam.basis.n
    goal = random.uniform(-0.5, 0.5, n) / beam.length
    position = cc.tip_function(beam)(goal)[0]
    weight = 1.0 if seed % 2 else None
    target = cc.Target(xi=1.0, position=np.zeros(3), weight=weight)
    function = cc.shape_target_function(beam, [target], name="from_rest")
    if real == "double":
        found = function(q_guess=np.zeros(n), positions=position)
        met = float(found["violation"]) <= 1 and float(found["stationarity"]) <= 1
        return "OK" if met else "refused"
    sample = [np.full(n, 0.1 / beam.length), cc.tip_function(beam)(0.8 * goal)[0]]
    try:
        native = NativeFunction.compiled(function, beam, sample, optimization="-O0")
    except ValueError:
        return "refused"
    return native(np.zeros(n), position)[0]


def wings_from_rest(count: int = 1000) -> Table:
    """Shape targets in reach of random wings, solved from weights of zero."""
    checks = []
    for real in KINDS:
        with ProcessPoolExecutor(2) as pool:
            found = pool.map(from_rest, range(count), [real] * count, chunksize=8)
            counts = Counter(tqdm(found, total=count, desc=f"wings, {real}"))
        refused = count - counts["OK"]
        checks.append(Check(what=f"{real}: wings", value=count, form="{:.0f}"))
        checks.append(Check(what=f"{real}: refused", value=refused, form="{:.0f}", high=0))
    return checked("Shape targets in reach of random wings, from rest", checks)
