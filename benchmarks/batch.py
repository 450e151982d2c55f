"""Batches of wings in vector lanes beside CasADi's map, JAX, the processor's limit, threads."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

import curvcasadi as cc
from benchmarks.alternatives import MISSING, TARGET
from benchmarks.contender import batch_weights
from benchmarks.fused import fused_operations, peak
from benchmarks.table import Table, compared
from benchmarks.timing import least
from curvcasadi.kinematics.pose_function import Form
from curvcasadi.symbolic.expressions import Array
from tests.support.strip_wings import hale
from tests.support.wing import elements_for, position_error, wing

NO_COMPILER = "g++ is missing: nothing was measured."
HEADERS = ("what", "measured", "asked for")
#: Wings of a batch; of one whose results stay in the cache; of one for two threads; gust cases.
BATCH, SMALL_BATCH, LARGE_BATCH, CASES = 10_000, 2_000, 100_000, 400
#: Step of the gust cases, s, and their number.
STEP, STEPS = 0.002, 250


def over_map() -> Table:
    """Time per wing over that of CasADi's `map` in the virtual machine."""
    title = f"Batches in vector lanes: {BATCH} wings, one core"
    if not shutil.which("g++"):
        return compared(title, HEADERS, [], (NO_COMPILER,))
    beam = wing(elements_for(TARGET, "magnus4"))
    weights = batch_weights(BATCH)
    rows = []
    forms: tuple[Form, ...] = ("compact", "unrolled")
    for what, jacobian, asked in (("pose", False, 50), ("pose and Jacobian", True, 60)):
        for form in forms:
            f = cc.tip_function(beam, form, jacobian=jacobian)
            before = _mapped_seconds(f, weights[:, :200])
            for real in ("double", "float"):
                ratio = before / _seconds(f, [weights], real)  # type: ignore[arg-type]
                rows.append(
                    (f"{what}, {form}, {real}: map over batch", f"{ratio:.0f}", f"≥ {asked}")
                )
    note = "The test wing at an error of 1e-6 L. Within one run; the batch is the last axis."
    return compared(title, HEADERS, rows, (note,))


def over_jax() -> Table:
    """Time per wing over that of hand-written JAX, both on one core."""
    title = f"Batches of {BATCH} wings, over hand-written JAX on one core"
    if not shutil.which("g++"):
        return compared(title, HEADERS, [], (NO_COMPILER,))
    if find_spec("jax") is None:
        return compared(title, HEADERS, [("JAX", MISSING, "")])
    elements = elements_for(TARGET, "magnus4")
    command = [sys.executable, "-m", "benchmarks.jax_rod", str(BATCH), str(elements)]
    folder = Path(__file__).parents[1]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=True)
    found = json.loads(done.stdout)
    weights, beam = batch_weights(BATCH), wing(elements)
    own = [
        _seconds(cc.tip_function(beam, jacobian=jacobian), [weights]) for jacobian in (False, True)
    ]
    tip = cc.compile_batch(cc.tip_function(beam), axis=-1)(batch_weights(3))[0][:, -1]
    rows = [
        ("pose: JAX over batch", f"{found['pose'] / own[0]:.0f}", "≥ 1.5"),
        ("pose and Jacobian: JAX over batch", f"{found['jacobian'] / own[1]:.0f}", "≥ 50"),
        ("tip error of JAX, L", f"{found['error']:.1e}", f"≤ {TARGET:g}"),
        ("tip error of the batch, L", f"{position_error(tip):.1e}", f"≤ {TARGET:g}"),
    ]
    notes = (
        f"Both: {elements} magnus4 elements, double precision. JAX: scan, vmap and jit, by",
        "components; its Jacobian is its forward mode. The batch: compact form, last axis.",
    )
    return compared(title, HEADERS, rows, notes)


def over_limit() -> Table:
    """Time over that of the fused multiply-adds alone at this machine's measured peak."""
    title = "Batches: time over the limit of fused multiply-adds"
    if not shutil.which("g++"):
        return compared(title, HEADERS, [], (NO_COMPILER,))
    beam, rate = wing(elements_for(TARGET, "magnus4")), peak()
    rows = []
    forms: tuple[Form, ...] = ("compact", "unrolled")
    for what, jacobian, size in (("pose", False, BATCH), ("pose and Jacobian", True, SMALL_BATCH)):
        count = fused_operations(cc.tip_function(beam, "unrolled", jacobian=jacobian))
        for form in forms:
            f = cc.tip_function(beam, form, jacobian=jacobian)
            once = _seconds(f, [batch_weights(size)])
            asked = "≤ 2 (1.4)" if form == "compact" or not jacobian else ""
            label = f"{what}, {form}: {count} operations a wing"
            rows.append((label, f"{once * rate / count:.2f}", asked))
    notes = (
        f"Peak: {rate / 1e9:.1f} billion fused multiply-adds a second, measured in the same run.",
        "Operations: lines of the unrolled C, a product and the sum that takes it counted as one.",
        f"Batches of {BATCH} poses; of {SMALL_BATCH} Jacobians, whose results stay in the cache.",
    )
    return compared(title, HEADERS, rows, notes)


def threads() -> Table:
    """Two threads over one."""
    title = f"Batches: two threads over one, {LARGE_BATCH} wings"
    if not shutil.which("g++"):
        return compared(title, HEADERS, [], (NO_COMPILER,))
    f = cc.tip_function(wing(elements_for(TARGET, "magnus4")))
    weights = [batch_weights(LARGE_BATCH)]
    ratio = _seconds(f, weights) / _seconds(f, weights, threads=2)
    note = f"On a machine of {os.cpu_count()} processors; it has to be idle."
    return compared(title, HEADERS, [("pose: speed-up", f"{ratio:.2f}", "≥ 1.8")], (note,))


def gust_cases() -> Table:
    """A gust envelope as a batch over the same cases one by one, both native on one core."""
    title = f"Gust envelope: {CASES} cases of {STEPS} steps, 8 weights, 6 lag states, one core"
    if not shutil.which("g++"):
        return compared(title, HEADERS, [], (NO_COMPILER,))
    lag, entry = cc.IndicialLag(poles=2, modes=2), cc.GustEntry(kind="lag", modes=2)
    model = cc.wing_model(hale((2, 4, 2), 8), density=0.0889, lag=lag, damping=1e-3, gust=entry)
    step = cc.rk4_step(model, STEP, substeps=2)
    x, p = np.zeros((CASES, model.x.size)), _cases(model)

    run = cc.compile_function(step.mapaccum(STEPS), derivatives=0)
    buffer, evaluate = run.buffer()
    inputs = [np.zeros(model.x.size), np.zeros(0), np.zeros(p.shape[2] * STEPS)]
    end = np.zeros(model.x.size * STEPS)
    for i in (0, 2):
        buffer.set_arg(i, memoryview(inputs[i]))
    buffer.set_res(0, memoryview(end))
    singles = [np.ascontiguousarray(p[:, case]).ravel() for case in range(CASES)]

    def one_by_one() -> Array:
        states = np.empty_like(x)
        for case, values in enumerate(singles):
            inputs[2][:] = values
            evaluate()
            states[case] = end[-model.x.size :]
        return states

    expected, before = one_by_one(), least(one_by_one, 4.0)
    rows = []
    for real, asked in (("double", "≥ 5 (8)"), ("float", "")):
        together = _gust_batch(step, x, p, real)
        error = np.abs(together() - expected).max() / np.abs(expected).max()
        label = f"single runs in double precision over the batch, {real} (differs by {error:.0e})"
        rows.append((label, f"{before / least(together, 2.0):.1f}", asked))
    note = (
        "Classical Runge–Kutta steps of 1 ms, gusts held over 2 ms. Single runs: all steps of a "
        "case in one native call."
    )
    return compared(title, HEADERS, rows, (note,))


def _gust_batch(step: ca.Function, x: Array, p: Array, real: Any) -> Callable[[], Array]:
    """All steps of all cases; returns the last states."""
    batch = cc.compile_batch(step, real)
    kind = {"double": np.float64, "float": np.float32}[real]
    start, parameters = x.astype(kind), p.astype(kind)

    def run() -> Array:
        state = start.copy()
        for values in parameters:
            batch(state, np.zeros(0), values, out=[state])
        return state

    return run


def _cases(model: cc.ControlModel) -> Array:
    """Parameters (steps, cases, np): gusts of 20 lengths at 20 speeds."""
    speed, length = np.meshgrid(np.linspace(18, 28, 20), np.linspace(5, 60, 20), indexing="ij")
    times = STEP * np.arange(STEPS)
    parts = {
        "airspeed": np.broadcast_to(speed.ravel(), (STEPS, CASES)),
        "pitch": np.full((STEPS, CASES), 0.03),
        "gust": [
            [float(cc.OneMinusCosine(amplitude=2.0, duration=d / v)(t))
             for v, d in zip(speed.ravel(), length.ravel(), strict=True)]
            for t in times
        ],
    }  # fmt: skip
    return np.stack([np.asarray(parts[part.name], dtype=float) for part in model.p.parts], axis=2)


def _seconds(
    f: ca.Function, arrays: Sequence[Array], real: Any = "double", threads: int = 1
) -> float:
    """Seconds per wing of a batch that is the last axis, its results in arrays that are there."""
    batch = cc.compile_batch(f, real, axis=-1)
    kind = {"double": np.float64, "float": np.float32}[real]
    inputs = [np.ascontiguousarray(array, dtype=kind) for array in arrays]
    found = batch(*inputs)
    out = list(found) if isinstance(found, tuple) else [found]
    return least(lambda: batch(*inputs, out=out, threads=threads), 1.0) / inputs[0].shape[-1]


def _mapped_seconds(f: ca.Function, weights: Array) -> float:
    """Seconds per wing of CasADi's `map`, called with matrices that are there."""
    mapped, values = f.map(weights.shape[1]), ca.DM(weights)
    return least(lambda: mapped.call([values])) / weights.shape[1]
