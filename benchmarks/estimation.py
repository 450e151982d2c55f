"""Shape filters: consistency, convergence, lost and wrong samples, and a million steps of C.

Wing: 16 m, six weights, 16 elements, clamped, under gravity. Four IMUs at a quarter, a half, three
quarters and the end of the span: gyros of 1e-4 rad/s/√Hz, accelerometers of 2e-3 m/s²/√Hz, 100 Hz.
"""

from __future__ import annotations

import subprocess
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
from scipy.optimize import brentq
from scipy.stats import chi2

import curvcasadi as cc
from benchmarks.table import Check, Table, checked
from curvcasadi.symbolic.expressions import Array, Real

DT = 0.01  #: s
RUNS = 200
STATIONS = (0.25, 0.5, 0.75, 1.0)
ROOT = cc.RootMotion(gravity=[0, 0, -9.81], magnetic_field=[2e-5, 0, -4e-5])
RATE = {"rate": 1 / DT}
GYROS = tuple(cc.RateGyro(xi=xi, noise_density=1e-4, **RATE) for xi in STATIONS)
ACCELEROMETERS = tuple(cc.Accelerometer(xi=xi, noise_density=2e-3, **RATE) for xi in STATIONS)
MAGNETOMETERS = tuple(cc.Magnetometer(xi=xi, noise_density=1e-8, **RATE) for xi in STATIONS)
IMUS = (*GYROS, *ACCELEROMETERS)
SLOW = (*ACCELEROMETERS, *MAGNETOMETERS)

#: The processes: the density of their noise, and what is not in the state.
MOVING: dict[str, Any] = {
    "process": "white_acceleration",
    "density": 0.01,
    "acceleration": 0.05,
    "root": ROOT,
}
CREEPING: dict[str, Any] = {
    "process": "random_walk",
    "density": 0.0005,
    "rate": 0.001,
    "acceleration": 0.01,
    "root": ROOT,
}


def wing(real: Real = "double") -> cc.Beam:
    two = cc.Legendre(2)
    return cc.Beam(
        length=16.0,
        basis=cc.ChannelBasis(torsion=two, out_of_plane=two, in_plane=two),
        grid=cc.Grid.uniform(16, max_angle=1.5, real=real),
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class Runs:
    """Monte Carlo runs, all at once: what was estimated against what was true."""

    nees: Array  #: (steps, runs)
    nis: Array  #: (steps, runs)
    dof: Array  #: (steps, runs)
    error: Array  #: of the estimate at the end, (runs, N)
    covariance: Array  #: of the estimate at the end, (runs, N, N)
    truth: Array  #: at the end, (N, runs)
    tip: Array  #: distance of the estimated tip from the true one, (steps, runs), m


def simulate(
    beam: cc.Beam,
    sensors: Sequence[Any],
    model: dict[str, Any],
    deviation: dict[str, float],
    *,
    steps: int,
    iterations: int,
    runs: int = RUNS,
    start: Array | None = None,
    first: tuple[int, int] = (0, 1),
    missing: float = 0.0,
    outliers: float = 0.0,
    seed: int = 0,
) -> Runs:
    """Truth from the process itself, from the prior or from `start`, and a filter of its samples.

    Parameters
    ----------
    start : true states at the start (N, runs); drawn from `deviation` where None
    first : number of steps at the start, and their iterations
    missing, outliers : shares of the samples; an outlier is off by 50 standard deviations or more
    """
    rng, n = np.random.default_rng(seed), beam.basis.n
    filters = [cc.shape_ekf(beam, sensors, iterations=k, **model) for k in (iterations, first[1])]
    steps_of = [(f.predict.map(runs), f.update.map(runs)) for f in filters]
    at = filters[0].initial(deviation)
    size = at.state.size
    spread = np.sqrt(np.diag(at.covariance))[:, None]
    state, factor = np.tile(at.state[:, None], runs), np.tile(at.factor, runs)
    x = at.state[:, None] + spread * rng.normal(size=(size, runs)) if start is None else start

    q, q_dot, q_ddot = (ca.MX.sym(key, n) for key in ("q", "q_dot", "q_ddot"))
    ideal = cc.measure(sensors, beam, q, q_dot, q_ddot, ROOT)
    read = ca.Function("read", [q, q_dot, q_ddot], [ideal.values]).map(runs)
    tip = cc.tip_function(beam).map(runs)
    noise = ideal.noise[:, None]
    moving = model["process"] == "white_acceleration"
    lower = np.linalg.cholesky([[DT**3 / 3, DT**2 / 2], [DT**2 / 2, DT]]) * model["density"]

    found: dict[str, list[Array]] = {key: [] for key in ("nees", "nis", "dof", "tip")}
    for k in range(steps):
        w = rng.normal(size=(2, n, runs))
        if moving:
            drift = (lower[0, 0] * w[0], lower[1, 0] * w[0] + lower[1, 1] * w[1])
            x = np.vstack([x[:n] + DT * x[n:] + drift[0], x[n:] + drift[1]])
            rates = x[n:]
        else:
            x = x + model["density"] * np.sqrt(DT) * w[0]
            rates = model["rate"] * rng.normal(size=(n, runs))
        values = read(x[:n], rates, model["acceleration"] * rng.normal(size=(n, runs))).full()
        values += noise * rng.normal(size=values.shape)
        wrong = rng.random(values.shape) < outliers
        sign = np.sign(rng.normal(size=values.shape))
        values += wrong * sign * (50 + 50 * rng.random(values.shape)) * np.maximum(noise, 0.02)
        values[rng.random(values.shape) < missing] = np.nan

        predict, update = steps_of[k < first[0]]
        state, factor = predict(state, factor, np.full((1, runs), DT))
        result = [value.full() for value in update(state, factor, values)]
        state, factor = result[:2]
        factors = factor.reshape(size, runs, size).transpose(1, 0, 2)
        d = np.einsum("rii->ri", factors)
        unit = np.triu(factors, 1) + np.eye(size)
        error = (state - x).T
        whitened = np.linalg.solve(unit, error[..., None])[..., 0]
        found["nees"].append((whitened**2 / d).sum(axis=1))
        found["nis"].append(result[4][0])
        found["dof"].append(result[5][0])
        tips = [tip(value[:n])[0].full() for value in (state, x)]
        found["tip"].append(np.linalg.norm(tips[0] - tips[1], axis=0))
    return Runs(
        **{key: np.array(values) for key, values in found.items()},
        error=error,
        covariance=np.einsum("rij,rj,rkj->rik", unit, d, unit),
        truth=x,
    )


def band(dof: float, runs: int) -> tuple[float, float]:
    """95 % of averages of `runs` χ² numbers, over their expectation."""
    low, high = chi2.ppf([0.025, 0.975], dof * runs) / (dof * runs)
    return float(low), float(high)


def consistency() -> Table:
    """NEES and NIS over their expectations."""
    checks = []
    for what, sensors, model, deviation in (
        ("white acceleration, four IMUs", IMUS, MOVING, {"q": 0.002, "q_dot": 0.02}),
        ("random walk, accelerometers and magnetometers", SLOW, CREEPING, {"q": 0.002}),
    ):
        runs = simulate(wing(), sensors, model, deviation, steps=100, iterations=3)
        size = len(runs.truth)
        for name, values, dof in (("NEES", runs.nees, size), ("NIS", runs.nis, runs.dof.mean())):
            low, high = band(dof, RUNS)
            ratio = values.mean(axis=1) / dof
            checks.append(
                Check(
                    what=f"{name}/{dof:.0f}, {what}",
                    value=float(ratio.mean()),
                    form="{:.3f}",
                    low=low,
                    high=high,
                )
            )
            checks.append(
                Check(
                    what=f"{name}, steps whose average is within the band",
                    value=100 * float(np.mean((ratio > low) & (ratio < high))),
                    form="{:.0f} %",
                )
            )
    notes = (f"{RUNS} runs of 100 steps, the 95 % band of an average over the runs of one step.",)
    return checked("Consistency of the filter", checks, notes)


def bent_start(beam: cc.Beam, displacement: float, runs: int, seed: int) -> Array:
    """States (12, runs) whose tips are `displacement` (m) away from that of the straight wing."""
    rng, tip = np.random.default_rng(seed), cc.tip_function(beam)
    straight = np.array([beam.length, 0, 0])
    states: list[list[float]] = []
    while len(states) < runs:
        direction = rng.normal(size=6) * [0.5, 0.5, 1, 1, 0.3, 0.3]

        def excess(scale: float, direction: Array = direction) -> float:
            position = tip(scale * direction)[0].full()[:, 0]
            return float(np.linalg.norm(position - straight)) - displacement

        largest = 0.1 / np.abs(direction).max()
        if excess(largest) < 0:
            continue
        scale = brentq(excess, 0, largest)
        states.append([*(scale * direction), *(0.02 * rng.normal(size=6))])
    return np.array(states).T


def tip_ratio(beam: cc.Beam, runs: Runs) -> Array:
    """Distance of the tip at the end over its standard deviation, √tr(J P Jᵀ), (runs,)."""
    n = beam.basis.n
    J = np.array([cc.body_jacobian(beam, q).full()[3:] for q in runs.truth[:n].T])
    variance = np.einsum("rij,rjk,rik->r", J, runs.covariance[:, :n, :n], J)
    ratio: Array = runs.tip[-1] / np.sqrt(variance)
    return ratio


def convergence() -> Table:
    """From a wing that is thought straight, and is bent by 30 % of its span at the tip."""
    beam = wing()
    runs = simulate(
        beam,
        IMUS,
        MOVING,
        {"q": 0.03, "q_dot": 0.02},
        steps=200,
        iterations=2,
        first=(10, 8),
        start=bent_start(beam, 0.3 * beam.length, RUNS, seed=3),
    )
    ratio = tip_ratio(beam, runs)
    checks = [
        Check(
            what=f"runs of {RUNS} within 3σ at the tip after 2 s",
            value=float(np.sum(ratio <= 3)),
            form="{:.0f}",
            low=RUNS,
        ),
        Check(what="worst distance of the tip after 2 s, m", value=float(runs.tip[-1].max())),
        Check(what="worst, in standard deviations", value=float(ratio.max())),
        Check(what="mean NEES/12 after 2 s", value=float(runs.nees[-1].mean()) / 12),
    ]
    notes = ("Eight iterations in the first ten updates, two in the others.",)
    return checked("Start 30 % of the span off at the tip, four IMUs", checks, notes)


def bad_data() -> Table:
    """20 % of the samples missing, 1 % gross outliers, against the same runs without."""
    beam = wing()
    arguments: dict[str, Any] = {"steps": 100, "iterations": 2}
    deviation = {"q": 0.002, "q_dot": 0.02}
    clean = simulate(beam, IMUS, MOVING, deviation, **arguments)
    bad = simulate(beam, IMUS, MOVING, deviation, missing=0.2, outliers=0.01, **arguments)
    rms = [float(np.sqrt(np.mean(runs.tip[20:] ** 2))) for runs in (clean, bad)]
    diverged = np.sum(tip_ratio(beam, bad) > 5)
    checks = [
        Check(what="error at the tip over that of clean data", value=rms[1] / rms[0], high=1.5),
        Check(what="error at the tip, clean data, m rms", value=rms[0]),
        Check(
            what=f"runs of {RUNS} that diverged (over 5σ at the tip)",
            value=float(diverged),
            form="{:.0f}",
            high=0,
        ),
    ]
    return checked("20 % of the samples missing, 1 % gross outliers", checks)


#: Runs a filter on periodic samples, a row a line: the state after every `EVERY` steps, and the
#: least entry of D, whose sign is that of the smallest eigenvalue of U D Uᵀ.
_DRIVER = """
#include <stdio.h>
#include "curv.h"
#include "samples.h"
int main(void) {
  static curv_ekf_predict_out predicted;
  static curv_ekf_update_out now;
  curv_real least;
  long step;
  int i, j, k;
  for (i = 0; i < STATE; ++i) now.state_after[i] = start[i];
  for (i = 0; i < FACTOR; ++i) now.factor_after[i] = start_factor[i];
  least = now.factor_after[0];
  for (step = 0; step < STEPS; ++step) {
    if (curv_ekf_predict(now.state_after, now.factor_after, period, &predicted)) return 1;
    if (curv_ekf_update(predicted.state_after, predicted.factor_after, samples[step % ROWS], &now))
      return 2;
    for (j = 0, k = 0; j < STATE; ++j, k += j + 1)
      if (!(now.factor_after[k] >= least)) least = now.factor_after[k];
    if ((step + 1) % EVERY == 0) {
      for (i = 0; i < STATE; ++i) printf("%.9g ", (double)now.state_after[i]);
      printf("%.9g\\n", (double)least);
    }
  }
  return 0;
}
"""


def in_c(real: Real, steps: int, every: int, folder: Path) -> Array:
    """What the driver prints of a filter exported in `real`: (steps / every, state and least D).

    A wing that flaps with a period of 10 s, so do its samples; 5 % of them are missing.
    """
    beam = wing(real)
    ekf = cc.shape_ekf(beam, IMUS, **MOVING)
    functions = [
        cc.CFunction(function=ekf.predict, tolerance=1e-3),
        cc.CFunction(function=ekf.update, missing=("measured",), tolerance=1e-3),
    ]
    samples, rest = _flapping(1000)
    at = ekf.initial({"q": 1e-3, "q_dot": 1e-2}, {"q": rest[:6], "q_dot": rest[6:]})
    inputs = {
        ekf.predict.name(): [(at.state, at.factor, DT)],
        ekf.update.name(): [(at.state, at.factor, np.nan_to_num(samples[:, 0]))],
    }
    cc.export_c(functions, folder, real=real, reference_inputs=inputs)
    upper = [at.factor[i, j] for j in range(12) for i in range(j + 1)]
    rows = ",\n".join("{" + ", ".join(map(_number, row)) + "}" for row in samples.T)
    (folder / "samples.h").write_text(
        f"#include <math.h>\n#define STATE 12\n#define FACTOR 78\n#define ROWS {samples.shape[1]}\n"
        f"#define STEPS {steps}L\n#define EVERY {every}\n"
        f"static const curv_real period = (curv_real){DT};\n"
        f"static const curv_real start[] = {{{', '.join(map(_number, at.state))}}};\n"
        f"static const curv_real start_factor[] = {{{', '.join(map(_number, upper))}}};\n"
        f"static const curv_real samples[][{len(samples)}] = {{\n{rows}}};\n"
    )
    (folder / "driver.c").write_text(_DRIVER)
    sources = ["driver.c", "curv.c", "curv_functions.c"]
    subprocess.run(
        ["gcc", "-std=c99", "-O1", *sources, "-o", "driver", "-lm"], cwd=folder, check=True
    )
    said = subprocess.run(["./driver"], cwd=folder, check=True, capture_output=True, text=True)
    return np.array([line.split() for line in said.stdout.splitlines()], dtype=float)


def _number(x: float) -> str:
    return "(curv_real)NAN" if np.isnan(x) else f"(curv_real){float(x)!r}"


def _flapping(rows: int) -> tuple[Array, Array]:
    """Samples (24, rows) of one period of a flapping wing, and its state at the start."""
    rng, n = np.random.default_rng(1), 6
    size = np.array([0.004, 0.002, 0.02, 0.01, 0.004, 0.002])
    turn = 2 * np.pi / (rows * DT) * np.array([1, 2, 1, 3, 2, 1])
    lag = rng.uniform(0, 2 * np.pi, n)
    q, q_dot, q_ddot = (ca.MX.sym(key, n) for key in ("q", "q_dot", "q_ddot"))
    ideal = cc.measure(IMUS, wing(), q, q_dot, q_ddot, ROOT)
    read = ca.Function("read", [q, q_dot, q_ddot], [ideal.values])

    def motion(t: Any) -> tuple[Array, Array, Array]:
        phase = np.outer(turn, np.atleast_1d(t)) + lag[:, None]
        a, b = size[:, None], turn[:, None]
        return a * np.sin(phase), a * b * np.cos(phase), -a * b**2 * np.sin(phase)

    values = read.map(rows)(*motion(DT * (1 + np.arange(rows)))).full()
    values += ideal.noise[:, None] * rng.normal(size=values.shape)
    values[rng.random(values.shape) < 0.05] = np.nan
    return values, np.concatenate(motion(0.0)[:2])[:, 0]


def single_precision(steps: int = 1_000_000) -> Table:
    """The filter exported in float against that in double, on the same samples."""
    every = max(steps // 1000, 1)
    with tempfile.TemporaryDirectory() as first, tempfile.TemporaryDirectory() as second:
        single = in_c("float", steps, every, Path(first))
        double = in_c("double", steps, every, Path(second))
    largest = np.abs(double[:, :-1]).max(axis=0)
    away = np.abs(single[:, :-1] - double[:, :-1]).max(axis=0)
    checks = [
        Check(what="least entry of D, float", value=float(single[-1, -1]), low=1e-30),
        Check(what="least entry of D, double", value=float(double[-1, -1]), low=1e-30),
        Check(what="q in float from that in double, rad/m", value=float(away[:6].max()), high=1e-3),
        Check(
            what="q_dot in float from that in double, rad/(m s)",
            value=float(away[6:].max()),
            high=1e-3,
        ),
        Check(what="the same over the largest of the part", value=float((away / largest).max())),
    ]
    notes = (f"{steps} steps on the host; P = U D Uᵀ is positive definite where all D are.",)
    return checked("Single precision", checks, notes)
