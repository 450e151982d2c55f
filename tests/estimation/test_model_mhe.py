"""Moving-horizon estimation on a control model: against Kalman, dense least squares, the filter."""

from __future__ import annotations

import re
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import minimize

import curvcasadi as cc
from benchmarks import model_flights
from curvcasadi.estimation.mhe.model_window import ModelWindow, _moved
from curvcasadi.export import run_check
from tests.estimation.test_model_ekf import (
    DT,
    GAUGE,
    GYRO,
    Kalman,
    aircraft_readings,
    flying,  # noqa: F401
    shaft,  # noqa: F401
)

WINDOW = 4
DENSITY, RETURNS = {"q_dot": 0.3, "gust": 0.2}, {"gust": 0.5}
DEVIATION, MEAN = {"q": 0.05, "q_dot": 0.2, "gust": 0.1}, {"q": [0.1, -0.05], "gust": 0.0}
#: Of the shaft, whose readings the oracle has: twist rate at the tip, a shear gauge, a weight.
SEEN = [0, 3, 4]


def process_of(model, **changes):
    return cc.ModelProcess(model=model, density=DENSITY, estimated=RETURNS, **changes)


def make(shaft, window=WINDOW, method="rk4", dt=DT, **changes):  # noqa: F811
    beam, model = shaft
    return cc.shape_mhe(
        beam,
        [GYRO, GAUGE],
        process=process_of(model, method=method),
        outputs={"q": 0.02},
        dt=dt,
        window=window,
        **changes,
    )


def samples(count, seed=4, lossy=True):
    """Readings (3,) of the oracle, with holes, and torques; and both as the estimator takes them"""
    rng = np.random.default_rng(seed)
    z, u = 0.1 * rng.normal(size=(count, 3)), 0.05 * rng.normal(size=count)
    z[rng.random(z.shape) < 0.2 * lossy] = np.nan
    rows = np.full((count, 6), np.nan)
    rows[:, SEEN] = z
    return z, u, [(row, {"u": torque}) for row, torque in zip(rows, u, strict=True)]


def filtered(oracle, start, z, u):
    """Kalman's filter: predicted and filtered states and covariances; the first is a prior."""
    x, P = start.state, start.arrival_covariance
    predicted, found = [], []
    for k in range(len(u)):
        if k:
            x = oracle.F @ x + oracle.by_input * u[k]
            P = oracle.F @ (P + oracle.noise) @ oracle.F.T + oracle.noise
        predicted.append((x, P))
        there = np.isfinite(z[k])
        H, R = oracle.H[there], oracle.R[np.ix_(there, there)]
        K = np.linalg.solve(H @ P @ H.T + R, H @ P).T
        left = np.eye(5) - K @ H
        x, P = x + K @ (z[k][there] - H @ x), left @ P @ left.T + K @ R @ K.T
        found.append((x, P))
    return predicted, found


def smoothed(oracle, predicted, found):
    """The smoother of Rauch, Tung and Striebel: states (5, count)."""
    states = [found[-1][0]]
    for k in reversed(range(len(found) - 1)):
        x, P = found[k]
        C = P @ oracle.F.T @ np.linalg.inv(predicted[k + 1][1])
        states.insert(0, x + C @ (states[0] - predicted[k + 1][0]))
    return np.column_stack(states)


# Linear models -----------------------------------------------------------------------------------


@pytest.mark.parametrize("method, dt", [("rk4", DT), ("implicit_midpoint", 10 * DT)])
def test_on_a_linear_model_sliding_windows_are_the_filter_of_kalman(shaft, method, dt):  # noqa: F811
    mhe = make(shaft, method=method, dt=dt)
    start = mhe.initial(DEVIATION, MEAN)
    oracle = Kalman(0.3, 0.2, 0.5, dt, method == "implicit_midpoint")
    z, u, given = samples(14)
    predicted, found = filtered(oracle, start, z, u)
    for k, at in enumerate(cc.run_mhe(mhe, start, given)):
        assert at.solved
        # Rounding, in a state of size 0.1; a program ends at 1e-4 of its tolerance.
        assert_allclose(at.state, found[k][0], atol=1e-10)
        if k >= WINDOW and k + 1 < len(u):
            mean, covariance = predicted[k - WINDOW + 1]
            assert_allclose(at.arrival_mean, mean, atol=1e-10)
            assert_allclose(at.arrival_covariance, covariance, atol=1e-10 * covariance.max())


def test_a_window_that_holds_all_data_is_the_smoother(shaft):  # noqa: F811
    mhe = make(shaft, window=9)
    start = mhe.initial(DEVIATION, MEAN)
    z, u, given = samples(10)
    *_, last = cc.run_mhe(mhe, start, given)
    oracle = Kalman(0.3, 0.2, 0.5)
    assert_allclose(last.states, smoothed(oracle, *filtered(oracle, start, z, u)), atol=1e-10)


def test_on_a_linear_model_it_is_the_filter_on_the_model(shaft):  # noqa: F811
    beam, model = shaft
    mhe = make(shaft)
    ekf = cc.shape_ekf(
        beam, [GYRO, GAUGE], process=process_of(model), outputs={"q": 0.02}, gate=np.inf
    )
    _, _, given = samples(12, seed=5)
    clock = [(DT * k, *sample) for k, sample in enumerate(given)]
    pairs = zip(
        cc.run_mhe(mhe, mhe.initial(DEVIATION, MEAN), given),
        cc.run_ekf(ekf, ekf.initial(DEVIATION, MEAN), clock),
        strict=True,
    )
    for a, b in pairs:
        assert_allclose(a.state, b.state[:5], atol=1e-10)


def test_a_bounded_window_is_the_optimum_of_dense_least_squares(shaft):  # noqa: F811
    bounds = {"gust": (-0.02, 0.02), "q_dot": ([-0.15, -np.inf], [0.15, np.inf])}
    mhe = make(shaft, window=4, bounds=bounds)
    start = mhe.initial(DEVIATION, MEAN)
    z, u, given = samples(5, seed=1, lossy=False)
    oracle = Kalman(0.3, 0.2, 0.5)
    *_, last = cc.run_mhe(mhe, start, given)
    assert last.solved

    # States of the window, affine in what drives it, from the matrices of the oracle.
    G = np.sqrt(oracle.noise)[:, 2:]
    by = np.zeros((5, 5, 5 + 4 * 6))
    by[0, :, :5] = np.linalg.cholesky(start.arrival_covariance)
    x = [start.state]
    for k in range(1, 5):
        x.append(oracle.F @ x[-1] + oracle.by_input * u[k])
        by[k] = oracle.F @ by[k - 1]
        by[k, :, 6 * k - 1 : 6 * k + 5] = np.hstack([oracle.F @ G, G])
    whiten = np.diag(oracle.R) ** -0.5
    A = np.vstack([np.eye(29), *(whiten[:, None] * oracle.H @ rows for rows in by)])
    right = np.concatenate([np.zeros(29), ((z - np.array(x) @ oracle.H.T) * whiten).ravel()])
    limits = np.array([0.15, np.inf, 0.02])
    rows, middle = by[:, [2, 4]].reshape(10, 29), np.array(x)[:, [2, 4]].ravel()
    most = np.tile(limits[[0, 2]], 5)
    found = minimize(
        lambda w: np.sum((A @ w - right) ** 2) / 2,
        np.zeros(29),
        jac=lambda w: A.T @ (A @ w - right),
        method="SLSQP",
        constraints={
            "type": "ineq",
            "fun": lambda w: np.concatenate([most - middle - rows @ w, most + middle + rows @ w]),
            "jac": lambda w: np.vstack([-rows, rows]),
        },
        options={"ftol": 1e-16, "maxiter": 500},
    )
    expected = np.column_stack([one + part @ found.x for one, part in zip(x, by, strict=True)])
    sizes = np.abs(last.states[2:])
    assert np.sum(sizes[[0, 2]] > most[:2, None] * (1 - 1e-6)) >= 3  # active
    assert np.all(sizes < limits[:, None] * (1 + 1e-6))
    assert_allclose(last.states, expected, atol=1e-7)  # where SLSQP ends


def test_a_window_without_samples_is_the_motion_of_the_model(shaft):  # noqa: F811
    _, model = shaft
    mhe = make(shaft)
    start = mhe.initial(DEVIATION, {**MEAN, "q_dot": [0.3, 0.1], "gust": [0.2]})
    nothing = [(np.full(6, np.nan), {"u": 0.1 * k}) for k in range(8)]
    *_, last = cc.run_mhe(mhe, start, nothing)
    x, step = start.state, cc.rk4_step(model, DT)
    for k in range(1, 8):
        x = np.r_[step(x[:4], 0.1 * k, x[4]).full().ravel(), np.exp(-DT / 0.5) * x[4]]
    assert_allclose(last.state, x, atol=1e-12)


@pytest.mark.parametrize("loss", ["squared", "huber"])
def test_outliers_pull_at_squares_and_not_at_hubers_loss(shaft, loss):  # noqa: F811
    beam, model = shaft
    gauges = [cc.ShearGauge(xi=xi, noise=1e-3) for xi in (0.1, 0.4, 0.8)]
    mhe = cc.shape_mhe(beam, gauges, process=process_of(model), dt=DT, window=WINDOW, loss=loss)
    rng, step = np.random.default_rng(2), cc.rk4_step(model, DT)
    x, errors = np.array([0.1, -0.05, 0.1, 0.0]), []
    given, truth = [], []
    for k in range(30):
        values = cc.measure(gauges, beam, x[:2]).values.full()[:, 0]
        values += 1e-3 * rng.normal(size=3)
        values[k % 3] += (k % 4 == 0) * 0.5  # five hundred deviations
        if k % 5 == 0:
            values[(k + 1) % 3] = np.nan
        truth.append(x)
        given.append((values, {"u": 0.0}))
        x = step(x, 0.0, 0.0).full()[:, 0]
    found = list(cc.run_mhe(mhe, mhe.initial({**DEVIATION, "q": 0.02}, MEAN), given))
    assert all(at.solved for at in found)
    errors = [np.abs(at.state[:2] - x[:2]).max() for at, x in zip(found, truth, strict=True)]
    if loss == "huber":
        assert max(errors[5:]) < 4e-3  # of clean samples 1.5e-3
    else:
        assert max(errors[5:]) > 0.03


def test_the_loss_is_hubers_smoothed_and_the_arrival_has_its_gradient(shaft):  # noqa: F811
    mhe = make(shaft, loss="huber")
    error = mhe.step.solver.problem.stages.error
    r, kappa = np.array([0.0, 0.3, 5.0, 1e4]), 1.345
    window = ModelWindow(name="w", observation=None, nodes=2, dt=1.0, lower=r, upper=r, scale=kappa)
    value, slope = (v.full() for v in window.weighted(ca.DM(r), ca.DM(np.ones((4, 1)))))
    rho = kappa**2 * (np.sqrt(1 + (r / kappa) ** 2) - 1)
    assert_allclose(value[:, 0] * slope[:, 0], r / np.sqrt(1 + (r / kappa) ** 2), rtol=1e-12)
    # Of a stage: ½ r̃² is ρ of the residual without a loss.
    plain = make(shaft).step.solver.problem.stages.error
    rng = np.random.default_rng(0)
    at = [rng.normal(size=error.nnz_in(i)) for i in range(error.n_in())]
    at[3] = np.ones(error.nnz_in(3))
    residual, loss = (f(*at)[0].full()[:, 0] for f in (plain, error))
    rho = kappa**2 * (np.sqrt(1 + (residual / kappa) ** 2) - 1)
    assert_allclose(loss**2 / 2, rho, rtol=1e-9, atol=1e-12)


# The wing in a stream ----------------------------------------------------------------------------


@pytest.fixture(scope="module")
def stream():
    model = model_flights.model()
    return model, model_flights.fly(model, steps=24, runs=1, native=False, seed=1)


def test_on_a_wing_in_a_stream_it_is_as_good_as_the_filter(stream):
    model, flights = stream
    deviation = model_flights.DEVIATION
    mhe = model_flights.make_mhe(model, window=3)
    known = np.array([model_flights.AIRSPEED, model_flights.PITCH])
    found = list(cc.run_mhe(mhe, mhe.initial(deviation), flights.samples(0, known)))[1:]
    assert all(at.solved for at in found)
    ekf = model_flights.make(model, iterations=4)
    clock = [(DT * k, *sample) for k, sample in enumerate(flights.samples(0, known))]
    beside = list(cc.run_ekf(ekf, ekf.initial(deviation), clock))[1:]
    tip = cc.tip_function(model_flights.wing().beam)
    ours, theirs = (
        [
            float(ca.norm_2(tip(at.state[:4])[0] - tip(x)[0]))
            for at, x in zip(of, flights.x[:, :4, 0], strict=True)
        ]
        for of in (found, beside)
    )
    assert np.linalg.norm(ours) < 1.05 * np.linalg.norm(theirs)


# Attitudes ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("first", [0.0, 1.0])
def test_slopes_of_a_stage_are_those_on_the_group(flying, first):  # noqa: F811
    aircraft, model, _ = flying
    mhe = flying_mhe(aircraft, model)
    step = mhe.step.solver.problem.stages.step
    rng, h = np.random.default_rng(3), 1e-5
    nx, nd, nw = mhe.layout.size, mhe.error_layout.size, step.nnz_in(1)
    q, w, entries = (
        rng.normal(size=4),
        rng.normal(size=nw),
        rng.uniform(0.005, 0.01, step.nnz_in(2)),
    )
    z = np.concatenate([q / np.linalg.norm(q), 0.1 * rng.normal(size=nx - 4)])
    others = np.r_[np.zeros(step.nnz_in(0) - nx - 1), first]

    def end(change):
        start = cc.retract(model, z, change[:nd])
        return step(ca.vertcat(start, others), w + change[nd:], entries)[0][:nx]

    middle = end(np.zeros(nd + nw))
    columns = [
        (cc.difference(model, middle, end(e)) - cc.difference(model, middle, end(-e))) / (2 * h)
        for e in h * np.eye(nd + nw)
    ]
    _, a, b = (value.full() for value in step(np.r_[z, others], w, entries))
    slopes = np.hstack([a.T[:nd, :nd], b.T[:nd]])
    # Of differences, over slopes of up to some hundreds.
    assert_allclose(slopes, ca.horzcat(*columns).full(), atol=1e-7 * (1 + np.abs(slopes).max()))
    assert_allclose(float(ca.norm_2(middle[:4])), 1, rtol=1e-12)


def test_moving_by_nothing_changes_nothing(flying):  # noqa: F811
    _, model, _ = flying
    z, step = ca.MX.sym("z", model.x.size), ca.MX.sym("step", model.x.errors.size)
    f = ca.Function("f", [z, step], [*_moved(model.x, z, step)])
    start = np.r_[1, 0, 0, 0, np.zeros(model.x.size - 4)]
    end, by_z, by_step = (value.full() for value in f(start, 0))
    assert_allclose(end[:, 0], start, rtol=0)
    assert_allclose(by_z, np.eye(model.x.errors.size), rtol=0)
    assert_allclose(by_step, np.eye(model.x.errors.size), rtol=0)


def flying_mhe(aircraft, model, **changes):
    sensors = {
        "right": [
            cc.RateGyro(xi=0.0, noise_density=1e-3, rate=1 / DT),
            cc.Accelerometer(xi=0.0, noise_density=1e-2, rate=1 / DT),
            cc.AttitudeSensor(xi=0.0, noise=0.01),
            cc.Accelerometer(xi=1.0, noise_density=1e-2, rate=1 / DT, name="tip"),
        ],
        "left": [cc.Accelerometer(xi=1.0, noise_density=1e-2, rate=1 / DT, name="tip")],
    }
    density = {"twist": 0.02, "q_dot_right": 0.05, "q_dot_left": 0.05}
    return cc.shape_mhe(
        aircraft,
        sensors,
        process=cc.ModelProcess(model=model, density=density),
        outputs={"position": 0.1},
        root=cc.RootMotion(gravity=[0, 0, 9.81]),
        dt=DT,
        window=3,
        **changes,
    )


def test_a_flying_aircraft_is_estimated_with_its_attitude(flying):  # noqa: F811
    aircraft, model, ekf = flying
    mhe = flying_mhe(aircraft, model)
    rng = np.random.default_rng(7)
    deviation = {
        "quaternion_wxyz": 0.1, "position": 1.0, "q_right": 5e-3, "q_left": 5e-3,
        "twist": [*[0.05] * 3, *[0.5] * 3], "q_dot_right": 0.02, "q_dot_left": 0.02,
    }  # fmt: skip
    start = mhe.initial(deviation, {"twist": [0.3, 0.1, 0.2, 10.0, 0, 0]})
    spread = np.sqrt(np.diag(start.arrival_covariance))
    x = cc.retract(model, start.state, spread * rng.normal(size=len(spread)))
    step, read = cc.rk4_step(model, DT), aircraft_readings(aircraft, model, ekf)
    given = []
    for _ in range(12):
        z = read(x).full()[:, 0]
        noise = np.concatenate([ekf.channels.noise[:6], np.zeros(9), ekf.channels.noise[9:]])
        given.append(z + noise * rng.normal(size=len(z)))
        last = x
        x = step(x, [], [])
    found = list(cc.run_mhe(mhe, start, given))
    assert all(at.solved for at in found)
    error = cc.difference(model, found[-1].state, last).full()[:, 0]
    assert np.linalg.norm(error[:3]) < 0.02  # rad, from 0.1
    assert np.linalg.norm(error[3:6]) < 0.15  # m, from 1
    assert_allclose(np.linalg.norm(found[-1].states[:4], axis=0), 1, rtol=1e-12)


# C, and what is refused --------------------------------------------------------------------------


@pytest.mark.parametrize("real", ["double", "float"])
def test_the_step_is_exported(shaft, real, tmp_path):  # noqa: F811
    beam, model = shaft
    beam = replace(beam, grid=replace(beam.grid, real=real))
    torque, gust = ca.MX.sym("torque"), ca.MX.sym("gust")
    load = cc.PointMoment(xi=1.0, moment=ca.vertcat(torque + gust, 0, 0), frame="follower")
    model = cc.beam_model(beam, [load], {"torque": torque}, {"gust": gust}, damping=0.003)
    mhe = make((beam, model), window=2, bounds={"q_dot": (-0.25, 0.25)}, loss="huber")
    _, _, given = samples(5, seed=3)
    found = [mhe.initial(DEVIATION, MEAN)]
    found += cc.run_mhe(mhe, found[0], given)
    assert all(at.solved for at in found)
    calls = []
    for k in (2, 3, 4):
        before, window = found[k], given[k - 2 : k + 1]
        measured = np.column_stack([row for row, _ in window])
        torques = np.array([[inputs["u"] for _, inputs in window]])
        calls.append([before.arrival_mean, before.arrival_factor, measured, before.guess, torques])
    function = cc.CFunction(function=mhe.step, descriptions=mhe.descriptions, missing=("measured",))
    cc.export_c([function], tmp_path, real=real, reference_inputs={"mhe": calls})
    differences = run_check(tmp_path, optimization="-O0")
    assert max(differences.values()) <= {"double": 1e-9, "float": 1e-3}[real]


def test_what_an_estimator_on_a_model_needs(shaft):  # noqa: F811
    beam, model = shaft
    good = {"process": process_of(model), "dt": DT, "window": 2}
    for message, changes in {
        "rate: expected none with a control model": {"rate": 1.0},
        "rate_bound: expected none with a control model": {"rate_bound": 1.0},
        "density: expected the density": {"process": model},
        "density: expected None beside": {"density": 1.0},
        "dt: steps of 0.1 s of Runge–Kutta's method are unstable": {"dt": 0.1},
        "bounds: expected one of 'q', 'q_dot', 'gust'": {"bounds": {"flap": (0, 1)}},
        "bounds['gust']: expected lower ≤ upper": {"bounds": {"gust": (1, 0)}},
        "bounds['gust']: expected a pair": {"bounds": {"gust": 1}},
        "bounds: expected": {"bounds": 3},
        "loss: expected one of 'squared', 'huber'": {"loss": "cauchy"},
        "gyro_bias: expected a sensor": {"gyro_bias": True},
        "loss: expected none without": {"process": "random_walk", "density": 1.0, "loss": "huber"},
        "bounds: expected none without": {"process": "random_walk", "density": 1.0, "bounds": {}},
        "compiled: expected none without": {
            "process": "random_walk", "density": 1.0, "compiled": True,
        },
    }.items():  # fmt: skip
        with pytest.raises(ValueError, match=re.escape(message)):
            cc.shape_mhe(beam, [GAUGE], **{**good, **changes})
    mhe = make(shaft, window=2)
    start = mhe.initial(DEVIATION, MEAN)
    with pytest.raises(ValueError, match=r"samples\[0\].inputs: expected \['u'\], found \[\]"):
        next(cc.run_mhe(mhe, start, [np.zeros(6)]))
    with pytest.raises(ValueError, match=r"deviation: expected 'gust'"):
        mhe.initial({"q": 1.0, "q_dot": 1.0})


def test_a_sample_out_of_all_proportion_leaves_the_estimate_as_it_was(shaft):  # noqa: F811
    mhe = make(shaft, window=2)
    _, _, given = samples(4)
    given[1] = (np.full(6, 1e300), {"u": 0.0})
    found = list(cc.run_mhe(mhe, mhe.initial(DEVIATION, MEAN), given))
    assert not found[1].solved
    assert np.all(np.isfinite(found[-1].state))
