"""Moving-horizon estimation against Kalman filters, smoothers and dense least squares."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from itertools import pairwise

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import least_squares, lsq_linear
from scipy.spatial.transform import Rotation

import curvcasadi as cc
from curvcasadi.estimation.mhe.step import deviation_root, triangular_solve
from curvcasadi.estimation.samples import samples_function
from curvcasadi.export import export_c, run_check
from curvcasadi.reference_wings import hale_wing

DT, WINDOW = 0.05, 4
WING = hale_wing(1, 3, 1, grid=cc.Grid.lobatto(6))
FREE = replace(WING, weight_bounds=None)
N = WING.basis.n
DENSITY = np.array([0.02, 0.05, 0.04, 0.03, 0.01])
GAUGES = [
    cc.StrainGauge(xi=xi, offset=offset, noise=2e-4)
    for xi in (0.1, 0.5, 0.9)
    for offset in ((0.0, 0.06), (0.3, 0.02))
]
GAUGES.append(cc.ShearGauge(xi=0.4, noise=1e-3))
ATTITUDES = [cc.AttitudeSensor(xi=xi, noise=0.02) for xi in (0.3, 0.6, 1.0)]
MARKER = cc.Marker(xi=1.0, noise=0.01)
IMU = {"noise_density": 1e-3, "rate": 100.0}
PROCESSES = ("random_walk", "white_acceleration")
DEVIATION = {"random_walk": {"q": 0.02}, "white_acceleration": {"q": 0.02, "q_dot": 0.05}}


def truth(t):
    return 0.02 * np.sin(2 * t + np.arange(N)) * np.array([0.3, 1, 1, 1, 0.2])


def readings(sensors, q, q_dot=None, q_ddot=None, root=None):
    return cc.measure(sensors, FREE, *map(_dm, (q, q_dot, q_ddot)), root).values.full().ravel()


def _dm(value):
    return None if value is None else ca.DM(value)


def noisy(sensors, count, seed=0):
    """Samples (m, count) of the true motion."""
    random = np.random.default_rng(seed)
    samples = []
    for k in range(count):
        column = readings(sensors, truth(k * DT))
        at = 0
        for sensor in sensors:
            size = len(sensor.components)
            if isinstance(sensor, cc.AttitudeSensor):
                turn = Rotation.from_rotvec(sensor.noise * random.standard_normal(3)).as_matrix()
                R = column[at : at + 9].reshape(3, 3).T
                column[at : at + 9] = (R @ turn).T.ravel()
            else:
                column[at : at + size] += np.asarray(sensor.noise) * random.standard_normal(size)
            at += size
        samples.append(column)
    return np.column_stack(samples)


def make(sensors, process="random_walk", beam=FREE, window=WINDOW, density=DENSITY, **options):
    return cc.shape_mhe(
        beam, sensors, dt=DT, window=window, process=process, density=density, **options
    )


def started(process):
    """Mean and covariance before the first sample."""
    deviations = np.concatenate([np.full(N, value) for value in DEVIATION[process].values()])
    return np.zeros(deviations.size), np.diag(deviations**2)


def model_of(process, density=DENSITY):
    """F and Q of a step."""
    S = np.diag(density**2)
    if process == "random_walk":
        return np.eye(N), S * DT
    F = np.block([[np.eye(N), DT * np.eye(N)], [np.zeros((N, N)), np.eye(N)]])
    Q = np.block([[S * DT**3 / 3, S * DT**2 / 2], [S * DT**2 / 2, S * DT]])
    return F, Q


def linear_gauges(size):
    """H, offset and R of the gauges, from what they read at single weights."""
    zero = readings(GAUGES, np.zeros(N))
    H = 100 * np.column_stack([readings(GAUGES, 0.01 * e) - zero for e in np.eye(N)])
    R = np.diag(cc.sensor_channels(GAUGES).noise ** 2)
    return np.hstack([H, np.zeros((len(H), size - N))]), zero, R


def kalman(process, samples):
    """Textbook filter and Rauch–Tung–Striebel smoother: filtered, predicted, smoothed states."""
    F, Q = model_of(process)
    x, P = started(process)
    H, zero, R = linear_gauges(x.size)
    filtered, predicted = [], []
    for y in samples.T:
        predicted.append((x, P))
        there = np.isfinite(y)
        h = H[there]
        gain = P @ h.T @ np.linalg.inv(h @ P @ h.T + R[np.ix_(there, there)])
        x = x + gain @ (y[there] - zero[there] - h @ x)
        P = (np.eye(x.size) - gain @ h) @ P
        filtered.append((x, P))
        x, P = F @ x, F @ P @ F.T + Q
    predicted.append((x, P))
    smoothed = [filtered[-1][0]]
    for k in reversed(range(len(filtered) - 1)):
        x, P = filtered[k]
        C = P @ F.T @ np.linalg.inv(predicted[k + 1][1])
        smoothed.insert(0, x + C @ (smoothed[0] - predicted[k + 1][0]))
    return filtered, predicted, smoothed


def holes(samples, seed=1):
    lost = np.random.default_rng(seed).random(samples.shape) < 0.2
    return np.where(lost, np.nan, samples)


# Linear readings -------------------------------------------------------------------------------


@pytest.mark.parametrize("process", PROCESSES)
@pytest.mark.parametrize("lossy", [False, True])
def test_with_linear_readings_sliding_windows_are_the_kalman_filter(process, lossy):
    samples = noisy(GAUGES, 40)
    samples = holes(samples) if lossy else samples
    mhe = make(GAUGES, process)
    filtered, predicted, _ = kalman(process, samples)
    start = mhe.initial(DEVIATION[process])
    for k, at in enumerate(cc.run_mhe(mhe, start, samples.T)):
        assert at.solved
        assert at.time == pytest.approx(k * DT)
        # Weights are some 1e-2, their rates some 1e-1.
        assert_allclose(at.state, filtered[k][0], atol=1e-10)
        if k >= WINDOW:
            mean, covariance = predicted[k - WINDOW + 1]
            assert_allclose(at.arrival_mean, mean, atol=1e-10)
            assert_allclose(at.arrival_covariance, covariance, rtol=0, atol=1e-12)


@pytest.mark.parametrize("process", PROCESSES)
def test_states_of_a_window_are_those_of_the_smoother(process):
    samples = holes(noisy(GAUGES, 9))
    mhe = make(GAUGES, process, window=8)
    *_, last = cc.run_mhe(mhe, mhe.initial(DEVIATION[process]), samples.T)
    _, _, smoothed = kalman(process, samples)
    assert_allclose(last.states.T, smoothed, atol=1e-10)


def test_a_window_of_missing_samples_is_a_prediction():
    mhe = make(GAUGES, "white_acceleration")
    rate = 0.03 * np.ones(N)
    start = mhe.initial(DEVIATION["white_acceleration"], {"q": 0.01 * np.ones(N), "q_dot": rate})
    *_, last = cc.run_mhe(mhe, start, [np.full(len(GAUGES), np.nan)] * 7)
    assert last.solved
    assert_allclose(last.state, np.concatenate([0.01 + 6 * DT * rate, rate]), atol=1e-12)


# Nonlinear readings ----------------------------------------------------------------------------


def residual_of(sensors, q, measured):
    """Residuals over noise, by poses and scipy's logarithm; missing samples left out."""
    rows, at = [], 0
    positions, rotations = (m.full() for m in poses_of(tuple(s.xi for s in sensors))(q))
    for k, sensor in enumerate(sensors):
        values = measured[at : at + len(sensor.components)]
        at += len(sensor.components)
        if isinstance(sensor, cc.AttitudeSensor):
            if np.all(np.isfinite(values)):
                R = values.reshape(3, 3).T
                rotvec = Rotation.from_matrix(R.T @ rotations[:, 3 * k : 3 * k + 3]).as_rotvec()
                rows.append(rotvec / sensor.noise)
        else:
            error = (positions[:, k] - values) / sensor.noise
            rows.append(error[np.isfinite(values)])
    return np.concatenate([np.zeros(0), *rows])


@cache
def poses_of(stations):
    """Positions and rotations of the wing without bounds, as a Function of its weights."""
    return cc.pose_function("poses", FREE, stations)


def dense(sensors, process, measured, mean, covariance, bounds=np.inf):
    """The same problem as one dense least squares: states, one a row."""
    F, Q = model_of(process)
    before, step = (np.linalg.inv(np.linalg.cholesky(c)) for c in (covariance, Q))
    size, nodes = mean.size, measured.shape[1]

    def rows(z):
        x = z.reshape(nodes, size)
        drive = [step @ (b - F @ a) for a, b in pairwise(x)]
        read = [residual_of(sensors, a[:N], y) for a, y in zip(x, measured.T, strict=True)]
        return np.concatenate([before @ (x[0] - mean), *drive, *read])

    limit = np.tile(np.broadcast_to(bounds, size), nodes)
    options = {"xtol": 1e-14, "ftol": 1e-14, "gtol": 1e-12, "x_scale": "jac"}
    found = least_squares(rows, np.zeros(nodes * size), bounds=(-limit, limit), **options)
    return found.x.reshape(nodes, size)


@pytest.mark.parametrize("process", PROCESSES)
@pytest.mark.parametrize("lossy", [False, True])
def test_a_window_is_the_optimum_of_dense_least_squares(process, lossy):
    sensors = [*ATTITUDES, MARKER]
    samples = noisy(sensors, 3)
    if lossy:
        samples[4, 0] = samples[-1, 1] = np.nan  # an entry of an attitude, one of the marker
        samples[:, 2] = np.nan
    mhe = make(sensors, process, window=2)
    start = mhe.initial(DEVIATION[process])
    *_, last = cc.run_mhe(mhe, start, samples.T)
    expected = dense(sensors, process, samples, *started(process))
    assert last.solved
    # Of scipy, whose derivatives are differences.
    assert_allclose(last.states.T, expected, atol=1e-6)


def test_a_window_that_holds_all_data_is_the_batch_fit():
    sensors = [*ATTITUDES, MARKER]
    q = truth(0.3)
    samples = noisy(sensors, 4)
    samples = readings(sensors, q)[:, None] + (samples - noisy(sensors, 4, seed=3)) * 0.3
    for k in range(4):  # attitudes are rotations
        for i in range(3):
            u, _, v = np.linalg.svd(samples[9 * i : 9 * i + 9, k].reshape(3, 3))
            samples[9 * i : 9 * i + 9, k] = (u @ v).ravel()
    repeated = [replace(s, name=f"s{k}_{i}") for k in range(4) for i, s in enumerate(sensors)]
    fit = cc.fit_shape(FREE, repeated, samples.T.ravel(), prior=(np.zeros(N), 0.02))
    mhe = make(sensors, window=3, density=3e-5)
    *_, last = cc.run_mhe(mhe, mhe.initial({"q": 0.02}), samples.T)
    assert last.solved
    # The least-seen weight walks by 5e-7 rad/m; the error falls with the square of the density.
    assert_allclose(last.state, ca.DM(fit.q).full().ravel(), atol=1e-6)


@pytest.mark.parametrize("process", PROCESSES)
def test_gyros_and_accelerometers_are_used_with_what_they_read_besides(process):
    root = cc.RootMotion(gravity=[0, 0, 9.81])
    sensors = [cc.RateGyro(xi=1.0, **IMU), cc.Accelerometer(xi=0.7, **IMU)]
    random = np.random.default_rng(2)
    moves = [0.1 * random.standard_normal((3, N)) for _ in range(3)]
    moves = [(0.1 * q, q_dot, q_ddot) for q, q_dot, q_ddot in moves]
    samples = np.column_stack([readings(sensors, *move, root) for move in moves])
    rates = {"rate": 0.2} if process == "random_walk" else {}
    mhe = make(sensors, process, window=2, root=root, acceleration=0.3, **rates)
    *_, last = cc.run_mhe(mhe, mhe.initial(DEVIATION[process]), samples.T)
    assert last.solved

    F, Q = model_of(process)
    mean, covariance = started(process)
    before, step = (np.linalg.inv(np.linalg.cholesky(c)) for c in (covariance, Q))
    size, noise, width = mean.size, cc.sensor_channels(sensors).noise, 3 * N
    q, q_dot, q_ddot = (ca.SX.sym(name, N) for name in ("q", "q_dot", "q_ddot"))
    values = cc.measure(sensors, FREE, q, q_dot, q_ddot, root).values
    read = cc.function("read", {"q": q, "q_dot": q_dot, "q_ddot": q_ddot}, {"values": values})
    deviations = np.concatenate([np.full(2 * N - size, 0.2), np.full(N, 0.3)])

    def rows(z):
        x = z.reshape(3, width)
        drive = [step @ (b - F @ a) for a, b in zip(x[:-1, :size], x[1:, :size], strict=True)]
        errors = [
            (read(*np.split(a, 3)).full().ravel() - y) / noise
            for a, y in zip(x, samples.T, strict=True)
        ]
        spread = (x[:, size:] / deviations).ravel()
        return np.concatenate([before @ (x[0, :size] - mean), *drive, *errors, spread])

    found = least_squares(rows, np.zeros(3 * width), xtol=1e-14, ftol=1e-14, gtol=1e-12)
    # Of scipy, whose derivatives are differences; rates are some 1e-1.
    assert_allclose(last.states.T, found.x.reshape(3, width)[:, :size], atol=1e-5)


def test_the_arrival_marginalizes_what_else_a_sample_depends_on():
    # Of a random walk whose rates are free by ±10 rad/(m s), a gyro tells nothing.
    gyro = cc.RateGyro(xi=1.0, noise_density=1e-2, rate=100.0)
    random = np.random.default_rng(5)
    strains = noisy(GAUGES, 8)
    both = np.vstack([strains, random.standard_normal((3, 8))])
    alone = make(GAUGES)
    joint = make([*GAUGES, gyro], rate=10.0)
    pairs = zip(
        cc.run_mhe(alone, alone.initial({"q": 0.02}), strains.T),
        cc.run_mhe(joint, joint.initial({"q": 0.02}), both.T),
        strict=True,
    )
    for a, b in pairs:
        assert b.solved
        assert_allclose(b.state, a.state, atol=1e-6)
        assert_allclose(b.arrival_covariance, a.arrival_covariance, atol=1e-9)


def test_the_known_attitude_of_the_aircraft_comes_with_every_sample():
    samples = noisy(ATTITUDES, 6)
    mhe = make(ATTITUDES)
    moving = make(ATTITUDES, root_inputs=["attitude"])
    turns = [Rotation.from_rotvec([0.3 * k, -0.2, 0.1 * k]).as_matrix() for k in range(6)]
    turned = []
    for column, C in zip(samples.T, turns, strict=True):
        blocks = [C @ column[9 * i : 9 * i + 9].reshape(3, 3).T for i in range(3)]
        turned.append((np.concatenate([R.T.ravel() for R in blocks]), {"attitude": C}))
    start = mhe.initial({"q": 0.02})
    at_rest, in_flight = (
        list(cc.run_mhe(m, start, s)) for m, s in ((mhe, samples.T), (moving, turned))
    )
    for a, b in zip(at_rest, in_flight, strict=True):
        assert_allclose(b.states, a.states, atol=1e-9)


# Bounds ----------------------------------------------------------------------------------------


def test_bounds_of_weights_and_rates_hold_and_matter():
    samples = noisy(GAUGES, 12)
    narrow = replace(WING, weight_bounds=0.012)
    start = make(GAUGES, "white_acceleration").initial(DEVIATION["white_acceleration"])
    most = {}
    for name, beam, rate_bound in (("free", FREE, None), ("kept", narrow, 0.02)):
        mhe = make(GAUGES, "white_acceleration", beam, rate_bound=rate_bound)
        found = list(cc.run_mhe(mhe, start, samples.T))
        assert all(at.solved for at in found)
        states = np.hstack([at.states for at in found])
        most[name] = np.abs(states[:N]).max(), np.abs(states[N:]).max()
    assert most["free"][0] > 0.015
    assert most["free"][1] > 0.025
    assert_allclose(most["kept"], [0.012, 0.02], rtol=1e-6)  # active, and kept


def test_a_bounded_window_is_the_optimum_of_dense_least_squares():
    sensors, bound = [*ATTITUDES, MARKER], 0.012
    samples = noisy(sensors, 3)
    mhe = make(sensors, beam=replace(WING, weight_bounds=bound), window=2)
    *_, last = cc.run_mhe(mhe, mhe.initial({"q": 0.02}), samples.T)
    expected = dense(sensors, "random_walk", samples, *started("random_walk"), bound)
    assert last.solved
    assert np.sum(np.abs(last.states) > bound - 1e-9) >= 3
    assert_allclose(last.states.T, expected, atol=2e-6)  # scipy keeps off the bounds


def test_a_random_walk_keeps_its_rate_bound_weight_by_weight():
    samples = noisy(GAUGES, 12)
    bounds = np.full(N, np.inf)
    bounds[1:3] = 0.02
    mhe = make(GAUGES, rate_bound=bounds)
    free = make(GAUGES)
    start = mhe.initial({"q": 0.02})
    rates, unbounded = (
        np.max(
            [np.abs(np.diff(at.states)).max(1) / DT for at in found if at.states.shape[1] > 1], 0
        )
        for found in (list(cc.run_mhe(m, start, samples.T)) for m in (mhe, free))
    )
    assert np.all(unbounded[1:3] > 0.05)
    assert_allclose(rates[1:3], 0.02, rtol=1e-6)  # active, and kept
    assert np.all(rates[[0, 3]] > 0.03)


@pytest.mark.parametrize("excess", [1.5, 3.0, 10.0])
def test_data_that_the_bounds_exclude_end_on_the_bounds_or_are_told(excess):
    bound = 0.01
    mhe = make(GAUGES, beam=replace(WING, weight_bounds=bound))
    y = readings(GAUGES, np.full(N, excess * bound))
    H, zero, R = linear_gauges(N)
    whiten = np.diag(np.diag(R) ** -0.5)
    _, Q = model_of("random_walk")
    drive = np.diag(np.diag(Q) ** -0.5)
    solved = 0
    for k, at in enumerate(cc.run_mhe(mhe, mhe.initial({"q": 0.02}), [y] * (WINDOW + 1))):
        nodes = k + 1
        steps = np.kron(np.diff(np.eye(nodes), axis=0), drive)
        rows = np.vstack([np.eye(N, nodes * N) / 0.02, steps, np.kron(np.eye(nodes), whiten @ H)])
        right = np.concatenate([np.zeros(N + len(steps)), np.tile(whiten @ (y - zero), nodes)])
        best = lsq_linear(rows, right, (-bound, bound), method="bvls", tol=1e-14).x
        assert np.mean(np.abs(best) > bound - 1e-9) > 0.5
        if at.solved:
            solved += 1
            # 1e-4 standard deviations of 0.02.
            assert_allclose(at.states.T.ravel(), best, atol=2e-6)
    assert solved == WINDOW + 1


# Missing samples -------------------------------------------------------------------------------


@pytest.mark.parametrize("entry", range(9))
def test_an_attitude_of_which_an_entry_is_missing_is_missing(entry):
    sensors = [*ATTITUDES, MARKER]
    samples = noisy(sensors, 6)
    part = samples.copy()
    part[9 + entry, 2:4] = np.nan
    whole = samples.copy()
    whole[9:18, 2:4] = np.nan
    mhe = make(sensors)
    start = mhe.initial({"q": 0.02})
    for a, b in zip(*(cc.run_mhe(mhe, start, s.T) for s in (part, whole)), strict=True):
        assert a.solved
        assert_allclose(a.states, b.states, rtol=0)  # the same arithmetic
        assert_allclose(a.arrival_factor, b.arrival_factor, rtol=0)


def test_a_sensor_that_is_always_missing_is_none():
    sensors = [*ATTITUDES, MARKER]
    samples = noisy(sensors, 6)
    lost = samples.copy()
    lost[-3:] = np.nan
    mhe, fewer = make(sensors), make(ATTITUDES)
    start = mhe.initial({"q": 0.02})
    pairs = zip(
        cc.run_mhe(mhe, start, lost.T), cc.run_mhe(fewer, start, samples[:-3].T), strict=True
    )
    for a, b in pairs:
        assert_allclose(a.states, b.states, atol=1e-7)  # where iterations end


def test_nan_becomes_a_number_and_numbers_stay(evaluate):
    clean = samples_function([ATTITUDES[0], MARKER])
    turn = Rotation.from_rotvec([0.3, 0.2, -0.7]).as_matrix().ravel()
    y = np.array([*turn, -0.0, np.nan, -3.0])
    samples, seen = evaluate(lambda m: ca.vertcat(*clean(m)), y)[:12], clean(y)[1]
    assert_allclose(samples.ravel(), [*turn, 0, 0, -3], rtol=0)
    assert_allclose(seen.full().ravel(), [1, 1, 1, 1, 0, 1], rtol=0)
    y[4] = np.nan
    samples, seen = clean(y)
    assert_allclose(samples[:9].full().ravel(), np.eye(3).ravel(), rtol=0)
    assert_allclose(seen.full().ravel(), [0, 0, 0, 1, 0, 1], rtol=0)


@pytest.mark.parametrize("dead", [np.zeros(9), np.ones(9), -np.eye(3).ravel(), 1.02 * np.eye(3)])
def test_an_attitude_that_is_no_rotation_is_missing(dead):
    samples, seen = samples_function([ATTITUDES[0]])(np.ravel(dead))
    assert_allclose(samples.full().ravel(), np.eye(3).ravel(), rtol=0)
    assert_allclose(seen.full(), np.zeros((3, 1)), rtol=0)


@pytest.mark.parametrize("dead", [np.zeros(9), -np.eye(3).ravel(), [np.nan] + [1.0] * 8])
def test_a_run_reports_an_attitude_that_is_no_rotation_as_missing(dead):
    sensors = [*ATTITUDES, MARKER]
    samples, lost = noisy(sensors, 2), noisy(sensors, 2)
    samples[9:18, 1], samples[-1, 1] = dead, np.nan
    lost[9:18, 1] = lost[-1, 1] = np.nan
    mhe = make(sensors)
    start = mhe.initial({"q": 0.02})
    assert start.used.size == 0
    whole, found = cc.run_mhe(mhe, start, samples.T)
    assert_allclose(whole.used, np.ones(12), rtol=0)
    assert_allclose(found.used, [1, 1, 1, 0, 0, 0, 1, 1, 1, 1, 1, 0], rtol=0)
    *_, expected = cc.run_mhe(mhe, start, lost.T)
    assert_allclose(found.state, expected.state, rtol=0)  # the same arithmetic


@pytest.mark.parametrize("bearing", [[np.nan, np.nan], [0.1, 0.2]])
@pytest.mark.parametrize("position", [[0.0, 10.0, 0.0], [0.0, 0.0, 1e3]])
def test_what_a_camera_does_not_see_is_missing(position, bearing):
    pose = cc.Pose(rotation=np.eye(3), position=position)
    cameras = [cc.Camera(xi=xi, noise=1e-3, pose=pose) for xi in (0.0, 1.0)]
    mhe, fewer = make([*ATTITUDES, *cameras]), make(ATTITUDES)
    samples = noisy(ATTITUDES, 4)
    # The root stays in the plane of the camera, which the tip leaves.
    seen = np.vstack([samples, np.tile([*bearing, np.nan, np.nan], (4, 1)).T])
    start = mhe.initial({"q": 0.02})
    for a, b in zip(
        cc.run_mhe(mhe, start, seen.T), cc.run_mhe(fewer, start, samples.T), strict=True
    ):
        assert a.solved
        assert_allclose(a.states, b.states, atol=1e-7)  # where iterations end


# Structure -------------------------------------------------------------------------------------


def test_derivatives_are_the_structured_ones():
    for mhe in (make([*ATTITUDES, MARKER]), make(ATTITUDES, "white_acceleration", iterations=1)):
        names = {f.name() for f in mhe.step.find_functions()}
        assert "jac_mhe_residual" in names
        differentiated = [n for n in names if n.startswith(("fwd", "adj", "jac_"))]
        assert differentiated == ["jac_mhe_residual"]


@pytest.mark.parametrize("process", PROCESSES)
def test_the_hessian_is_that_of_gauss_and_newton(process):
    """Of the whole window, 1 + Σ JᵀJ by what drives it, from differences of residuals."""
    sensors = [*ATTITUDES, MARKER]
    mhe = make(sensors, process, window=2)
    functions = {f.name(): f for f in mhe.step.solver.problem.linearization.find_functions()}
    functions |= {"mhe_solver_linearization": mhe.step.solver.problem.linearization}
    residual = functions["mhe_residual"]
    random = np.random.default_rng(0)
    F, Q = model_of(process)
    n = len(F)
    B, M = (
        np.linalg.cholesky(Q[::-1, ::-1])[::-1, ::-1],
        np.triu(random.uniform(0.01, 0.02, (n, n))),
    )
    y, seen = noisy(sensors, 3), np.ones((residual.numel_in(2), 3))
    seen[4, 1] = 0
    mean, u = 0.01 * random.standard_normal(n), 0.1 * random.standard_normal(3 * n)

    def rows(u):
        x, found = mean + M @ u[:n], [u]
        for k in range(3):
            x = F @ x + B @ u[n * k : n * k + n] if k else x
            found.append(residual(x, y[:, k], seen[:, k]).full().ravel())
        return np.concatenate(found)

    J = np.column_stack([(rows(u + e) - rows(u - e)) / 2e-5 for e in 1e-5 * np.eye(3 * n)])
    entries = np.array(ca.project(ca.DM(M), ca.Sparsity.upper(n)).nonzeros())
    parameters = [np.zeros(n), [1], mean, entries, np.zeros(n), y.T.ravel(), seen.T.ravel()]
    f, g, H = functions["mhe_solver_linearization"](u, np.concatenate(parameters))[:3]
    H, expected = ca.triu2symm(H).full(), J.T @ J
    unit = np.trace(expected) / np.trace(H)
    assert_allclose(unit * H, expected, atol=1e-8 * np.abs(expected).max())  # of differences
    assert_allclose(unit * float(f), rows(u) @ rows(u) / 2, rtol=1e-7)
    assert_allclose(unit * g.full().ravel(), J.T @ rows(u), atol=1e-7 * np.abs(J.T @ rows(u)).max())


@pytest.mark.parametrize("process", PROCESSES)
def test_the_certificate_bounds_the_distance_to_the_optimum(process):
    """Linear readings: one program is exact; here none at all, from guesses of known distances."""
    mhe = make(GAUGES, process)
    samples = noisy(GAUGES, WINDOW + 1)
    start = mhe.initial(DEVIATION[process])
    *_, last = cc.run_mhe(mhe, start, samples.T)
    solver = mhe.step.solver
    problem = solver.problem
    begin = solver.begin(
        arrival_mean=start.arrival_mean,
        arrival_factor=start.arrival_factor,
        measured=samples,
        guess=last.states,
    )
    optimum, p = begin["start"], begin["parameters"]
    random = np.random.default_rng(4)
    for size in (1e-5, 1e-4, 1e-2):
        # Inputs have unit variance before the samples.
        off = size * random.standard_normal(optimum.shape)
        _, g, H, c, At = problem.linearization(optimum + off, p)
        nothing = np.zeros(problem.n + problem.m)
        reached = ca.vertcat(optimum + off, c)
        stationarity = problem.distance(*map(ca.MX, (H, g, At, reached, nothing)))
        found = float(ca.evalf(stationarity)) * 1e-4
        assert found >= np.linalg.norm(off) * (1 - 1e-3)  # the optimum's own error
        assert found > 1e-4


def test_an_unfinished_iteration_is_not_called_solved():
    sensors = [*ATTITUDES, MARKER]
    samples = noisy(sensors, WINDOW + 1)
    mhe = make(sensors, max_iter=1)
    *_, last = cc.run_mhe(mhe, mhe.initial({"q": 0.02}), samples.T)
    assert not last.solved


def test_the_deviation_root_is_that_of_the_covariance():
    random = np.random.default_rng(0)
    factor = np.triu(random.standard_normal((6, 6)), 1) + np.diag(random.uniform(0.1, 2, 6))
    U, D = np.triu(factor, 1) + np.eye(6), np.diag(factor)
    root = deviation_root(6)(ca.project(ca.DM(factor), ca.Sparsity.upper(6))).full()
    assert_allclose(root @ root.T, (U * D) @ U.T, rtol=1e-12)
    assert_allclose(np.tril(root, -1), 0, rtol=0)
    b = random.standard_normal(6)
    assert_allclose(root @ triangular_solve(6)(root, b).full().ravel(), b, atol=1e-12)


def test_the_step_is_called_with_symbols():
    samples = noisy(ATTITUDES, WINDOW + 1)
    mhe = make(ATTITUDES)
    start = mhe.initial({"q": 0.02})
    measured = ca.MX.sym("measured", *samples.shape)
    arguments = [start.arrival_mean, start.arrival_factor, measured, start.guess]
    outer = ca.Function("outer", [measured], [mhe.step.call(arguments)[0]])
    arguments[2] = samples
    assert_allclose(outer(samples), mhe.step.call(arguments)[0], rtol=0)


@pytest.mark.parametrize("iterations, error", [(1, 1e-3), (2, 5e-5), (3, 1e-5)])
def test_real_time_iterations_follow_the_converged_ones(iterations, error):
    samples = noisy([*ATTITUDES, MARKER], 20)
    samples[:9, 4:7] = samples[-1, 9:12] = np.nan
    exact, quick = (make([*ATTITUDES, MARKER], iterations=i) for i in (None, iterations))
    start = exact.initial({"q": 0.02})
    for a, b in zip(*(cc.run_mhe(m, start, samples.T) for m in (exact, quick)), strict=True):
        assert b.solved
        # From the window before; its noise moves a shape by some 1e-3, the truth by 2e-3.
        assert_allclose(b.state, a.state, atol=error)


def test_inputs_and_outputs_have_their_shapes():
    step = make(GAUGES, "white_acceleration", root_inputs=["twist"]).step
    assert {name: step.size_in(name) for name in step.name_in()} == {
        "arrival_mean": (2 * N, 1),
        "arrival_factor": (2 * N, 2 * N),
        "measured": (len(GAUGES), WINDOW + 1),
        "guess": (2 * N, WINDOW + 1),
        "twist": (6, WINDOW + 1),
    }
    assert {name: step.size_out(name) for name in step.name_out()} == {
        "state": (2 * N, 1),
        "states": (2 * N, WINDOW + 1),
        "arrival_mean_after": (2 * N, 1),
        "arrival_factor_after": (2 * N, 2 * N),
        "guess_after": (2 * N, WINDOW + 1),
        "violation": (1, 1),
        "stationarity": (1, 1),
    }


# C ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("real", ["double", "float"])
@pytest.mark.parametrize("process", PROCESSES)
def test_the_step_compiles_and_agrees(tmp_path, real, process):
    sensors = [*ATTITUDES, MARKER, GAUGES[0]]
    beam = replace(WING, grid=cc.Grid.lobatto(6, real=real), weight_bounds=0.018)
    mhe = make(sensors, process, beam, rate_bound=0.05)
    at = mhe.initial(DEVIATION[process])
    samples = noisy(sensors, 9)
    samples[13, 3] = samples[-2, 5] = samples[-1, 6] = np.nan
    samples[:, 7] = np.nan
    found = [at, *cc.run_mhe(mhe, at, samples.T)]
    assert all(one.solved for one in found)
    given = []
    for k in range(WINDOW, 9):
        before, window = found[k], samples[:, k - WINDOW : k + 1]
        given.append([before.arrival_mean, before.arrival_factor, window, before.guess])
    functions = [cc.CFunction(function=mhe.step, missing=("measured",))]
    export_c(functions, tmp_path, real=real, reference_inputs={"mhe": given})
    # The certificate is right in C, too: the check compares the status of every call.
    assert max(run_check(tmp_path, optimization="-O0").values()) <= (
        1e-9 if real == "double" else 1e-4
    )


# Arguments -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "arguments, message",
    [
        ({"dt": 0}, r"dt: expected a number above zero, found 0"),
        ({"dt": ca.MX.sym("dt")}, r"dt: expected numbers, found the symbol"),
        ({"window": 0}, r"window: expected a whole number of at least 1, found 0"),
        ({"process": "walk"}, r"process: expected one of 'random_walk', 'white_acceleration'"),
        ({"density": -1}, r"density: expected one or 5 numbers above zero, found -1"),
        ({"density": [1, 2]}, r"density: expected one or 5 numbers above zero, found \[1, 2\]"),
        ({"density": np.inf}, r"density: expected one or 5 numbers above zero, found inf"),
        ({"rate_bound": 0}, r"rate_bound: expected one or 5 numbers above zero, found 0"),
        ({"rate_bound": ca.SX.sym("b")}, r"rate_bound: expected one or 5 numbers above zero"),
        ({"root_inputs": ["speed"]}, r"root_inputs: expected names among attitude, position"),
        ({"iterations": 0}, r"iterations: expected a whole number of at least 1, found 0"),
        ({"name": "1"}, r"name: expected letters"),
        (
            {"qp_solver": "none"},
            r"qp_solver: expected 'own' or a QP solver of CasADi, found 'none'",
        ),
        ({"qp_solver": None}, r"qp_solver: expected 'own' or a QP solver of CasADi, found None"),
        ({"sensors": []}, r"sensors: expected one or more"),
        (
            {"sensors": [cc.RateGyro(xi=1, **IMU)]},
            r"rate: expected one or 5 numbers above zero \(rad/\(m s\), of.*None",
        ),
        ({"beam": None}, r"beam: expected a Beam, found None"),
    ],
    ids=str,
)
def test_wrong_arguments_are_refused(arguments, message):
    given = {
        "beam": WING,
        "sensors": GAUGES,
        "dt": DT,
        "window": 2,
        "process": "random_walk",
        "density": DENSITY,
    }
    given |= arguments
    with pytest.raises(ValueError, match=message):
        cc.shape_mhe(given.pop("beam"), given.pop("sensors"), **given)


def test_one_weight_is_estimated_from_one_gauge():
    beam = replace(FREE, basis=cc.ChannelBasis(out_of_plane=cc.Legendre(1)))
    gauge = cc.StrainGauge(xi=0.5, offset=[0.0, 0.1], noise=1e-3)
    mhe = make([gauge], beam=beam, density=0.1)
    (at,) = cc.run_mhe(mhe, mhe.initial({"q": [[0.01]]}), [[0.002]])
    assert at.solved
    assert_allclose(at.state, [0.02 / 1.01], rtol=1e-6)  # where iterations end


def test_wrong_samples_and_starts_are_refused():
    mhe = make(GAUGES, root_inputs=["twist"])
    start = mhe.initial({"q": 0.02})
    good = np.zeros(7)
    for sample, message in (
        (np.zeros(6), r"samples\[0\].measured: expected 7 values, found 6"),
        (
            np.full(7, np.inf),
            r"samples\[0\].measured\[0\]: expected finite numbers or NaN, found inf",
        ),
        (good, r"samples\[0\].inputs: expected \['twist'\], found \[\]"),
        ((good, 3), r"samples\[0\].inputs: expected values by name, found 3"),
        ((*good,), r"samples\[0\]: expected measured or \(measured, inputs\), found \("),
        ((good, {"twist": [1, 2]}), r"samples\[0\].inputs\['twist'\]: expected shape \(6, 1\)"),
        (
            (good, {"twist": ca.MX.sym("t", 6)}),
            r"inputs\['twist'\]: expected numbers, found the sym",
        ),
        (
            [ca.SX.sym("y"), *good[1:]],
            r"samples\[0\].measured: expected numbers, found the symbol y",
        ),
    ):
        with pytest.raises(ValueError, match=message):
            next(cc.run_mhe(mhe, start, [sample]))
    for deviation, mean, message in (
        ({}, None, r"deviation: expected 'q', rad/m; not found"),
        ({"q": -1}, None, r"deviation\['q'\]: expected standard deviations above zero"),
        ({"q": 1, "p": 1}, None, r"deviation: expected one of 'q'; found 'p'"),
        ({"q": 1}, {"q": [1]}, r"mean\['q'\]: expected shape \(5, 1\)"),
        ({"q": 1}, {"q": [9] * N}, r"mean\['q'\]: expected every element to turn at most"),
        ({"q": 1}, {"p": 1}, r"mean: expected one of 'q'; found 'p'"),
        ({"q": ca.SX.sym("s")}, None, r"deviation\['q'\]: expected numbers, found the symbol s"),
        ({"q": 1}, {"q": ca.MX.sym("m", N)}, r"mean\['q'\]: expected numbers, found the symbol m"),
    ):
        with pytest.raises(ValueError, match=message):
            mhe.initial(deviation, mean)


@pytest.mark.parametrize("process", PROCESSES)
def test_starts_of_another_estimator_are_refused(process):
    mhe = make(GAUGES, process)
    start = mhe.initial(DEVIATION[process])
    size = start.state.size
    for other, message in (
        ({"arrival_mean": np.zeros(2)}, rf"arrival_mean of shape \({size},\); found \(2,\)"),
        ({"arrival_factor": np.eye(2)}, rf"arrival_factor of shape \({size}, {size}\); found"),
        ({"guess": start.guess[:, 1:]}, rf"guess of shape \({size}, 5\); found \({size}, 4\)"),
        ({"time": np.zeros(2)}, r"time of shape \(\); found \(2,\)"),
        ({"arrival_mean": np.full(size, np.nan)}, r"start\.arrival_mean: expected finite numbers"),
        ({"arrival_factor": np.full((size, size), np.inf)}, r"start\.arrival_factor: expected fin"),
        ({"guess": np.full_like(start.guess, np.nan)}, r"start\.guess: expected finite numbers"),
        ({"time": np.nan}, r"start\.time: expected finite numbers, found nan"),
        ({"arrival_factor": 0 * start.arrival_factor}, r"start\.arrival_factor\[0, 0\]: .* zero"),
        ({"arrival_factor": np.tri(size)}, r"start\.arrival_factor\[1, 0\]: .*upper triangular"),
    ):
        with pytest.raises(ValueError, match=message):
            next(cc.run_mhe(mhe, start._replace(**other), [np.zeros(7)]))
    with pytest.raises(ValueError, match="start: expected a WindowEstimate, found None"):
        next(cc.run_mhe(mhe, None, [np.zeros(7)]))
    with pytest.raises(ValueError, match="samples: expected a sequence of samples, found None"):
        next(cc.run_mhe(mhe, start, None))
    with pytest.raises(ValueError, match="mhe: expected a ShapeMhe, found None"):
        next(cc.run_mhe(None, start, [np.zeros(7)]))


def test_what_cannot_be_computed_leaves_the_estimate_as_it_was():
    """A stream outlives a reading out of all proportion."""
    sensors = [*ATTITUDES, MARKER]
    mhe = make(sensors, beam=WING)
    at = mhe.initial(DEVIATION["random_walk"])
    samples = noisy(sensors, 6)
    wild = samples.copy()
    wild[-1, 2] = 1e300
    found = [*cc.run_mhe(mhe, at, wild.T)]
    assert not found[2].solved
    assert np.all(np.isfinite(found[2].state))
    assert found[-1].time == 5 * DT
