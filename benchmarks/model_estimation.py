"""Estimators on a control model: consistency on the true model and another, recovery, windows."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

import curvcasadi as cc
from benchmarks.estimation import band
from benchmarks.model_flights import (
    ACCELERATION,
    AIRSPEED,
    DENSITY,
    DEVIATION,
    DT,
    GUST_TIME,
    PITCH,
    ROOT,
    RUNS,
    SENSORS,
    Flights,
    filtered,
    fly,
    make,
    make_mhe,
    model,
    simulate,
    wing,
)
from benchmarks.table import Check, Table, checked
from curvcasadi.symbolic.expressions import Array


def consistency() -> Table:
    """NEES and NIS of the filter on the true model, over their expectations."""
    process = model()
    runs = simulate(process, make(process, iterations=4), DEVIATION, steps=200)
    checks = []
    for name, values, dof in (("NEES", runs.nees, runs.size), ("NIS", runs.nis, runs.dof.mean())):
        low, high = band(dof, RUNS)
        ratio = values.mean(axis=1) / dof
        checks += [
            Check(
                what=f"{name}/{dof:.0f}, wing in a stream, gust estimated",
                value=float(ratio.mean()),
                form="{:.3f}",
                low=low,
                high=high,
            ),
            Check(
                what=f"{name}, steps whose average is within the band",
                value=100 * float(np.mean((ratio > low) & (ratio < high))),
                form="{:.0f} %",
            ),
        ]
    checks.append(Check(what="tip, m rms from 1 s on", value=rms(runs.tip[100:])))
    notes = (f"{RUNS} runs of 200 steps, the 95 % band of an average over the runs of one step.",)
    return checked("Consistency of the filter on a control model", checks, notes)


#: What a model may be wrong by: factors of stiffness and mass, airspeed less AIRSPEED, m/s.
TOLERANCES = ((0.9, 1.0, 0.0), (1.1, 1.0, 0.0), (1.0, 0.95, 0.0), (1.0, 1.05, 0.0),
              (1.0, 1.0, -1.0), (1.0, 1.0, 1.0))  # fmt: skip


def noise_of_model_errors(flights: Flights) -> tuple[dict[str, Array], Array]:
    """Densities by part, and deviations of q_ddot, that stand for what the model is wrong by.

    Along motions of the model the rates of others, one tolerance each, differ from its own by e(t).
    Independent tolerances add their mean squares, two signs of each halved; with τ the time in
    which the correlation of e falls to 1/e, white noise of the density s moves a state as much
    as e does in longer times:

        s = rms(e) √(2 τ),   q_ddot: rms(e)
    """
    nominal = model()
    steps, nx, runs = flights.x.shape
    n = wing().beam.basis.n
    x = flights.x.transpose(1, 0, 2).reshape(nx, -1)
    u, gust = np.repeat(flights.u, runs)[None], flights.gust.reshape(1, -1)

    def rates(of: cc.ControlModel, airspeed: float) -> Array:
        p = np.vstack([np.tile([[airspeed], [PITCH]], gust.size), gust])
        values = of.xdot.map(gust.size)(x, u, p).full()
        return np.asarray(values.reshape(nx, steps, runs)[n:])

    own = rates(nominal, AIRSPEED)
    errors = np.array(
        [rates(model(k, m), AIRSPEED + dv) - own for k, m, dv in TOLERANCES]
    ).transpose(1, 2, 0, 3).reshape(nx - n, steps, -1)  # fmt: skip
    square = np.mean(errors.reshape(nx - n, -1) ** 2, axis=1)
    size = np.sqrt(len(TOLERANCES) / 2 * square)
    density = size * np.sqrt(2 * DT * np.array([_correlation(e) for e in errors]))
    return {"q_dot": density[:n], "lag": density[n:]}, size[:n]


def _correlation(errors: Array) -> int:
    """Steps in which the correlation of errors (steps, runs) falls to 1/e, at most three quarters
    of them all."""
    steps, square = len(errors), np.mean(errors**2)
    for k in range(1, 3 * steps // 4):
        if np.mean(errors[k:] * errors[:-k]) < square / np.e:
            return k
    return 3 * steps // 4


def of_another_wing() -> Table:
    """The filter where the wing that flies is not the model's, by what its noise stands for."""
    nominal = model()
    flights = fly(model(0.9, 1.05), steps=200, airspeed=16.0)
    errors, q_ddot = noise_of_model_errors(fly(nominal, steps=200, runs=20, seed=5, native=False))
    before = {"density": DENSITY, "acceleration": ACCELERATION}
    checks = []
    for what, factor, airspeed in (
        ("none", 0.0, False),
        ("none, airspeed estimated", 0.0, True),
        ("by the rule", 1.0, False),
        ("by the rule, airspeed estimated", 1.0, True),
        ("twice the rule", 2.0, False),
    ):
        density: dict[str, Any] = dict(before["density"])  # type: ignore[call-overload]
        density |= {key: np.hypot(density[key], factor * e) for key, e in errors.items()}
        estimated: dict[str, float | None] = {"gust": GUST_TIME}
        deviation = dict(DEVIATION)
        if airspeed:
            density["airspeed"], estimated["airspeed"], deviation["airspeed"] = 0.1, None, 1.0
        process = cc.ModelProcess(
            model=nominal,
            density=density,
            estimated=estimated,
            acceleration=np.hypot(ACCELERATION, factor * q_ddot),
        )
        ekf = cc.shape_ekf(wing().beam, SENSORS, process=process, root=ROOT, iterations=4)
        runs = filtered(ekf, flights, deviation)
        checks += [
            Check(
                what=f"NEES/{runs.size} from 1 s on, noise for model errors: {what}",
                value=float(runs.nees[100:].mean() / runs.size),
                form="{:.2f}",
                high=2.0 if what == "by the rule" else None,
            ),
            Check(what=f"tip, {what}, m rms", value=rms(runs.tip[100:])),
        ]
    notes = (
        "The wing is 10 % softer and 5 % heavier, at 16 m/s where the filter believes 15.",
        "The rule: s = rms(e) √(2 τ) of differences of rates between models, see docs/estimation.",
    )
    return checked("Filter on the model of another wing", checks, notes)


def windows() -> Table:
    """Moving-horizon estimation beside the filter: clean samples, bad ones, a wrong start."""
    process, runs, steps = model(), 6, 60
    known = np.array([AIRSPEED, PITCH])
    tip = cc.tip_function(wing().beam)
    mhe = make_mhe(process, window=5, loss="huber", compiled=True)
    squared = make_mhe(process, window=5, compiled=True)
    ekf = make(process, iterations=4)
    checks = []
    bad = {"missing": 0.1, "outliers": 0.02}
    for what, most, changes in (
        ("clean samples", 1.1, {}),
        ("10 % missing, 2 % outliers", 1.3, bad),
        ("wrong start", 1.0, {"offset": WRONG}),
    ):
        flights = fly(process, steps=steps, runs=runs, seed=3, **changes)  # type: ignore[arg-type]
        by_filter = filtered(ekf, flights, DEVIATION).tip
        for name, estimator in (("Huber's loss", mhe), ("squares", squared)):
            tips, solved = np.zeros((steps, runs)), 0
            for run in range(runs):
                start = estimator.initial(DEVIATION)
                found = list(cc.run_mhe(estimator, start, flights.samples(run, known)))[1:]
                solved += sum(at.solved for at in found)
                for k, at in enumerate(found):
                    miss = tip(at.state[:4])[0] - tip(flights.x[k, :4, run])[0]
                    tips[k, run] = float(ca.norm_2(miss))
            at = slice(20, 21) if changes == {"offset": WRONG} else slice(10, None)
            wanted = most if name == "Huber's loss" else None
            checks += [
                Check(
                    what=f"{what}: tip of windows with {name} over the filter's, rms",
                    value=rms(tips[at]) / rms(by_filter[at]),
                    form="{:.2f}",
                    high=wanted,
                ),
                Check(what="m rms", value=rms(tips[at])),
                Check(what="solved", value=100 * solved / (steps * runs), form="{:.1f} %"),
            ]
    notes = (
        f"{runs} flights of {steps} samples at 100 Hz, windows of 5 steps; from 0.1 s on.",
        "Wrong start: 0.2 s after it, from 5.5 m at the tip, believed to 0.5 mrad/m.",
    )
    return checked("Moving-horizon estimation on a control model", checks, notes)


def rms(values: Array) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(values**2)))


#: A start that is thought to be known well and is bent the wrong way, rad/m.
WRONG = np.array([0.01, 0.0, -0.04, 0.01])


def recovery() -> Table:
    """From a start that is wrong by many of its standard deviations, with and without recovery."""
    process = model()
    checks = []
    for what, count in (("with recovery", 10), ("without", 0)):
        ekf = make(process, iterations=4, recovery=count)
        runs = simulate(
            process, ekf, DEVIATION, steps=200, runs=50, offset=WRONG, missing=0.1, outliers=0.01
        )
        end = runs.tip[-1]
        checks.append(
            Check(
                what=f"worst tip error after 2 s of 50 runs, {what}, m",
                value=float(end.max()),
                high=0.05 if count else None,
            )
        )
        checks.append(Check(what=f"at the start, {what}, m", value=float(runs.tip[0].max())))
    return checked("Wrong start of twenty standard deviations, 1 % outliers", checks)
