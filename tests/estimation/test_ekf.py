"""Shape filters: consistency with the truth they assume, missing and wrong samples, C."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose

import curvcasadi as cc
from benchmarks import estimation
from curvcasadi.estimation import ud
from curvcasadi.lie import so3
from curvcasadi.sensors.readout import Readout
from tests.support import oracle

RNG = np.random.default_rng(2)
ROOT = cc.RootMotion(gravity=[0, 0, -9.81])
GYRO = cc.RateGyro(xi=1.0, noise_density=1e-4, rate=100)
ACCELEROMETER = cc.Accelerometer(xi=0.5, noise_density=2e-3, rate=100)
ATTITUDE = cc.AttitudeSensor(xi=1.0, noise=0.01)
MOVING = {"process": "white_acceleration", "density": 0.01, "acceleration": 0.05, "root": ROOT}


@pytest.fixture
def beam():
    return cc.Beam(
        length=4.0,
        basis=cc.ChannelBasis(torsion=cc.Legendre(1), out_of_plane=cc.Legendre(2)),
        grid=cc.Grid.uniform(4),
    )


@pytest.fixture
def one_weight():
    basis = cc.ChannelBasis(out_of_plane=cc.Legendre(1))
    return cc.Beam(length=4.0, basis=basis, grid=cc.Grid.uniform(4))


def random_covariance(n):
    square = RNG.normal(size=(n, n))
    return square @ square.T + 0.1 * np.eye(n)


def triangular(matrix):
    """A factor of numbers as a CasADi matrix without what is below its diagonal."""
    return ca.project(ca.DM(matrix), ca.Sparsity.upper(len(matrix)))


def symmetric_positive_definite(covariance):
    return np.array_equal(covariance, covariance.T) and np.linalg.eigvalsh(covariance)[0] > 0


# Factors ---------------------------------------------------------------------------------------


def test_a_factor_holds_its_covariance():
    P = random_covariance(6)
    factor = ud.factor_of(P)
    assert_allclose(ud.covariance_of(factor), P, rtol=1e-12)  # rounding
    assert not np.any(np.tril(factor, -1))


def test_scalar_measurements_are_the_update_of_kalman():
    n, rows = 6, 3
    P, H = random_covariance(n), RNG.normal(size=(rows, n))
    R, x, r = np.array([0.3, 0.1, 0.7]), RNG.normal(size=n), RNG.normal(size=rows)
    start = ud.belief_of(triangular(ud.factor_of(P)), x)
    stacked = ca.horzsplit(ca.DM(np.vstack([H.T, r])))
    belief, said = ud.measure_rows(start, stacked, R, np.inf)
    factor, error = ud.split_belief(belief, n)
    innovation, used = ca.horzsplit(ca.horzcat(*said).T)
    S = H @ P @ H.T + np.diag(R)
    K = P @ H.T @ np.linalg.inv(S)
    nu = -(r + H @ x)
    assert_allclose(error.full()[:, 0], x + K @ nu, rtol=1e-9)  # rounding
    assert_allclose(ud.covariance_of(factor.full()), P - K @ S @ K.T, atol=1e-12)  # rounding
    assert_allclose(ca.sumsqr(innovation), nu @ np.linalg.solve(S, nu), rtol=1e-11)  # rounding
    assert_allclose(used, np.ones((rows, 1)), atol=0)


@pytest.mark.parametrize("residual", [np.nan, 1e6, 1e308], ids=["missing", "outlier", "huge"])
def test_a_sample_that_is_not_used_changes_nothing(residual):
    n = 5
    belief = ud.belief_of(triangular(ud.factor_of(random_covariance(n))), RNG.normal(size=n))
    row = np.append(RNG.normal(size=n), residual)
    after, said = ud.measure(n, 5.0)(belief, belief, row, 0.1)
    assert_allclose(after, belief, atol=0)
    assert (float(said[0]) == 0) == np.isnan(residual)
    assert float(said[1]) == 0


def test_added_noise_adds_to_the_covariance():
    n = 5
    P, v = random_covariance(n), RNG.normal(size=n)
    factor = ud.add_noise(n)(ud.factor_of(P), v, 0.4).full()
    assert_allclose(ud.covariance_of(factor), P + 0.4 * np.outer(v, v), rtol=1e-10)  # rounding


# Prediction ------------------------------------------------------------------------------------


def test_white_acceleration_is_discretized_exactly(beam):
    ekf = cc.shape_ekf(beam, [GYRO], process="white_acceleration", density=0.3)
    start = ekf.initial({"q": 0.2, "q_dot": 0.1}, {"q_dot": [1, 2, 3]})
    dt = 0.25
    state, factor = ekf.predict(start.state, start.factor, dt)
    F = np.kron([[1, dt], [0, 1]], np.eye(3))
    Q = 0.09 * np.kron([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]], np.eye(3))
    assert_allclose(state.full()[:, 0], F @ start.state, rtol=1e-15)
    expected = F @ start.covariance @ F.T + Q
    assert_allclose(ud.covariance_of(factor.full()), expected, rtol=1e-12, atol=1e-15)


def test_two_short_predictions_are_a_long_one(beam):
    ekf = cc.shape_ekf(beam, [GYRO], process="white_acceleration", density=0.3)
    start = ekf.initial({"q": 0.2, "q_dot": 0.1})
    half = ekf.predict(*ekf.predict(start.state, start.factor, 0.1), 0.1)
    whole = ekf.predict(start.state, start.factor, 0.2)
    covariances = [ud.covariance_of(x[1].full()) for x in (half, whole)]
    assert_allclose(*covariances, rtol=1e-12, atol=1e-15)  # rounding


def attitude_filter(beam, **options):
    return cc.shape_ekf(
        beam,
        [ATTITUDE, GYRO],
        process="white_acceleration",
        density=1e-3,
        attitude=True,
        root_gyro_density=0.02,
        gyro_bias=True,
        bias_density=0.01,
        root=ROOT,
        root_inputs=["twist"],
        **options,
    )


def test_the_attitude_error_goes_on_as_the_attitude_does(beam):
    """Φ by differences of two attitudes and biases that turn with the same measured rate."""
    ekf = attitude_filter(beam)
    rate, dt, bias = np.array([0.6, -1.0, 0.4]), 0.1, np.array([0.1, 0.2, -0.1])
    start = ekf.initial(
        {"attitude": 0.1, "q": 0.1, "q_dot": 0.1, "gyro_bias": 0.1, "root_gyro_bias": 0.1},
        {"attitude": oracle.rotation([0.3, 0.2, -0.7]), "root_gyro_bias": bias},
    )

    def end(phi, b):
        C = start.state[:9].reshape(3, 3).T @ oracle.rotation(phi)
        state = np.concatenate([C.T.ravel(), start.state[9:-3], bias + b])
        after = ekf.predict(state, start.factor, dt, rate)[0].full()[:9, 0]
        return after.reshape(3, 3).T

    d, nominal = 1e-6, end(np.zeros(3), np.zeros(3))
    columns = []
    for k in range(6):
        step = np.eye(6)[k] * d
        columns.append(so3.log(ca.DM(nominal.T @ end(step[:3], step[3:]))).full()[:, 0] / d)
    F = np.array(columns).T
    both = [0, 1, 2, -3, -2, -1]
    P = start.covariance[np.ix_(both, both)]
    got = ud.covariance_of(ekf.predict(start.state, start.factor, dt, rate)[1].full())
    expected = F @ P @ F.T + 0.02**2 * dt * np.eye(3)
    assert_allclose(got[:3, :3], expected, atol=1e-7)  # differences
    assert_allclose(nominal.T @ nominal, np.eye(3), atol=1e-14)  # rounding


def test_a_filter_finds_attitude_and_biases(beam):
    """Still wing, turning root: an attitude sensor, and gyros with biases."""
    ekf = attitude_filter(beam)
    C, rate = oracle.rotation([0.1, -0.1, 0.2]), np.array([0.2, 0.3, -0.1])
    bias, root_bias = np.array([0.02, -0.03, 0.01]), np.array([-0.02, 0.01, 0.03])
    start = ekf.initial(
        {"attitude": 0.3, "q": 1e-4, "q_dot": 1e-3, "gyro_bias": 0.05, "root_gyro_bias": 0.05}
    )

    def log():
        for k in range(1, 600):
            attitude = C @ oracle.rotation(0.01 * k * rate)
            measured = np.concatenate([attitude.T.ravel(), rate + bias])
            known = np.concatenate([rate + root_bias, np.zeros(3)])
            yield 0.01 * k, measured, {"rate": rate + root_bias, "twist": known}

    *_, end = cc.run_ekf(ekf, start, log())
    for name, true in (("gyro_bias", bias), ("root_gyro_bias", root_bias)):
        deviation = np.sqrt(np.diag(ekf.covariance(end, name)))
        assert np.all(np.abs(ekf.part(end, name) - true) < 3 * deviation), name
        assert deviation.max() < 0.025, name
    R = ekf.part(end, "attitude").reshape(3, 3).T
    assert_allclose(R, C @ oracle.rotation(0.01 * 599 * rate), atol=0.02)  # of 0.01 rad, averaged


# Readings --------------------------------------------------------------------------------------


@pytest.mark.parametrize("root", [{}, {"twist": RNG.normal(size=6), "twist_rate": np.ones(6)}])
@pytest.mark.parametrize("speed", [0.0, 1.0])
def test_short_derivatives_lack_what_is_quadratic_in_the_rates_alone(beam, root, speed):
    """residual_q of an accelerometer is exact where q_dot = 0, everything else everywhere."""
    motion = cc.RootMotion(gravity=[0.3, 0.2, 9.8], **root)
    inputs, n = ("q", "q_dot", "q_ddot"), 3
    offset = {"offset": [0.1, 0.2, -0.3], "mounting": oracle.rotation([0.3, 0.2, -0.9])}
    sensor = cc.Accelerometer(xi=0.6, noise_density=1, rate=1, **offset)
    exact = cc.measurement_function("exact", [sensor], beam, inputs, motion)
    q, q_dot, q_ddot = (ca.MX.sym(key, n) for key in inputs)
    measured = ca.MX.sym("measured", 3)
    readout = Readout.of([sensor], beam, q, q_dot, None, motion)
    name = readout.channels.layout.parts[0].name
    [rows] = readout.rows({name: measured}, dict.fromkeys(inputs, n), q_ddot)
    rows = ca.horzcat(*rows).T
    slope, residual = rows[:, :-1], rows[:, -1] + rows[:, 2 * n : 3 * n] @ q_ddot
    short = ca.Function("short", [q, q_dot, q_ddot, measured], [residual, slope])
    at = [0.2 * RNG.normal(size=n), speed * RNG.normal(size=n), RNG.normal(size=n), np.ones(3)]
    _, *expected = exact(*at)
    found, slopes = (value.full() for value in short(*at))
    expected_slopes = ca.horzcat(*expected[1:]).full()
    columns = slice(0 if speed == 0 else n, None)
    assert_allclose(found, expected[0].full(), atol=1e-13)  # rounding
    assert_allclose(slopes[:, columns], expected_slopes[:, columns], atol=1e-12)  # rounding
    assert (np.abs(slopes[:, :n] - expected_slopes[:, :n]).max() > 1e-3) == bool(speed)


# Updates ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("sensors", "model", "deviation"),
    [
        (estimation.IMUS, estimation.MOVING, {"q": 0.001, "q_dot": 0.01}),
        (estimation.SLOW, estimation.CREEPING, {"q": 0.001}),
    ],
    ids=["white acceleration", "random walk"],
)
def test_errors_are_what_the_covariance_says(sensors, model, deviation):
    runs = 40
    found = estimation.simulate(
        estimation.wing(), sensors, model, deviation, steps=25, iterations=3, runs=runs
    )
    # 99.9 % of averages of `runs` numbers; `estimation.consistency` has the 95 % of 200.
    for values, dof in ((found.nees, len(found.truth)), (found.nis, found.dof.mean())):
        width = 3.3 * np.sqrt(2 / (dof * runs))
        assert abs(values[-10:].mean() / dof - 1) < width


def test_a_filter_recovers_from_a_wrong_start():
    beam = estimation.wing()
    found = estimation.simulate(
        beam,
        estimation.IMUS,
        estimation.MOVING,
        {"q": 0.03, "q_dot": 0.02},
        steps=60,
        iterations=2,
        first=(10, 8),
        runs=8,
        start=estimation.bent_start(beam, 0.3 * beam.length, 8, seed=3),
    )
    assert np.all(estimation.tip_ratio(beam, found) < 3)
    assert found.tip[-1].max() < 0.1  # m, from 4.8


def test_lost_and_wrong_samples_do_no_harm():
    arguments = {"steps": 30, "iterations": 2, "runs": 10}
    model, deviation = estimation.MOVING, {"q": 0.001, "q_dot": 0.01}
    wing = estimation.wing()
    clean = estimation.simulate(wing, estimation.IMUS, model, deviation, **arguments)
    bad = estimation.simulate(
        wing, estimation.IMUS, model, deviation, missing=0.2, outliers=0.01, **arguments
    )
    assert np.sqrt(np.mean(bad.tip**2) / np.mean(clean.tip**2)) < 1.5
    assert 0.7 * 24 < bad.dof.mean() < 0.8 * 24


def test_without_samples_an_update_changes_nothing(beam):
    sensors = [GYRO, ACCELEROMETER, ATTITUDE]
    ekf = cc.shape_ekf(beam, sensors, iterations=2, **MOVING)
    start = ekf.initial({"q": 0.1, "q_dot": 0.1}, {"q": [0.01, 0.02, 0.03]})
    (after,) = cc.run_ekf(ekf, start, [(0.0, np.full(15, np.nan))])
    assert_allclose(after.state, start.state, atol=1e-17)
    assert_allclose(after.covariance, start.covariance, rtol=1e-12)
    assert np.all(np.isnan(after.innovation))
    assert after.dof == 0


def test_an_outlier_is_seen_and_not_used(beam):
    ekf = cc.shape_ekf(beam, [GYRO], process="white_acceleration", density=0.1)
    start = ekf.initial({"q": 0.1, "q_dot": 0.01})
    (after,) = cc.run_ekf(ekf, start, [(0.01, [0.0, 40.0, np.nan])])
    assert_allclose(after.used, [1, 0, 0], atol=0)
    assert abs(after.innovation[1]) > 5
    assert np.isnan(after.innovation[2])


def test_an_attitude_without_one_of_its_numbers_is_missing(beam):
    ekf = cc.shape_ekf(beam, [ATTITUDE], process="random_walk", density=0.1)
    start = ekf.initial({"q": 0.1})
    rotation = np.eye(3).ravel()
    rotation[4] = np.nan
    (after,) = cc.run_ekf(ekf, start, [(0.0, rotation)])
    assert after.dof == 0
    assert_allclose(after.state, start.state, atol=0)


@pytest.mark.parametrize("dead", [np.zeros(9), np.ones(9), -np.eye(3).ravel(), 1.02 * np.eye(3)])
def test_an_attitude_that_is_no_rotation_is_missing(beam, dead):
    ekf = cc.shape_ekf(beam, [ATTITUDE], process="random_walk", density=0.1)
    start = ekf.initial({"q": 0.1}, {"q": [0.1, 0.02, 0.0]})
    (after,) = cc.run_ekf(ekf, start, [(0.0, np.ravel(dead))])
    assert after.dof == 0
    assert np.all(np.isnan(after.innovation))
    assert_allclose(after.state, start.state, atol=0)


#: Places of a camera, looking along z, that does not see the tip of a straight wing of 4 m.
BLIND = {
    "the tip in its plane": [0.0, 10.0, 0.0],
    "the tip in its centre": [4.0, 0.0, 0.0],
    "the tip behind it": [4.0, 0.0, 10.0],
    "the tip at its edge": [0.0, 0.0, -1e-9],
}


@pytest.mark.parametrize("bearing", [[np.nan, np.nan], [0.1, 0.2]])
@pytest.mark.parametrize("position", BLIND.values(), ids=BLIND)
def test_what_a_camera_does_not_see_changes_nothing(beam, position, bearing):
    camera = cc.Camera(xi=1.0, noise=1e-3, pose=cc.Pose(rotation=np.eye(3), position=position))
    walk = {"process": "random_walk", "density": 0.1}
    both, alone = (cc.shape_ekf(beam, s, **walk) for s in ([ATTITUDE, camera], [ATTITUDE]))
    turn = oracle.rotation(np.array([0.0, -0.05, 0.0])).T.ravel()
    start = alone.initial({"q": 0.1})
    (found,) = cc.run_ekf(both, start, [(0.1, [*turn, *bearing])])
    (expected,) = cc.run_ekf(alone, start, [(0.1, turn)])
    assert_allclose(found.state, expected.state, rtol=0)  # the same arithmetic
    assert_allclose(found.factor, expected.factor, rtol=0)
    assert_allclose(found.used, [1, 1, 1, 0, 0], rtol=0)
    assert np.isnan(found.innovation[3:]).all()
    assert np.isfinite(found.innovation[:3]).all()
    assert found.dof == 3


def test_wrong_samples_and_starts_are_named(beam):
    options = {"process": "random_walk", "density": 0.1}
    ekf = cc.shape_ekf(beam, [ATTITUDE], root_inputs=["attitude"], **options)
    start, good = ekf.initial({"q": 0.1}), np.eye(3).ravel()
    known = {"attitude": np.eye(3)}
    with pytest.raises(ValueError, match="time: expected finite numbers"):
        ekf.initial({"q": 0.1}, time=np.nan)
    for sample, message in (
        ((np.inf, good, known), r"samples\[0\].time: expected finite numbers"),
        (3.0, r"samples\[0\]: expected \(time, measured\)"),
        ((0.0, {"a": 1}, known), r"samples\[0\].measured: expected numbers"),
        ((0.0, "text", known), r"samples\[0\].measured: expected numbers"),
        ((0.0, [*good[:8], np.inf], known), r"samples\[0\].measured\[8\]: expected finite numbers"),
        ((0.0, good, [1]), r"samples\[0\].inputs: expected values by name"),
        ((0.0, good, {"attitude": np.ones((3, 3))}), r"attitude'\]: expected orthonormal"),
    ):
        with pytest.raises(ValueError, match=message):
            next(cc.run_ekf(ekf, start, [sample]))
    for other, message in (
        (start._replace(state=np.zeros(2)), r"start: expected an estimate of this filter, state"),
        (start._replace(factor=np.eye(2)), r"start: expected an estimate of this filter, factor"),
        (start._replace(state=np.full(3, np.nan)), r"start\.state: expected finite numbers"),
        (start._replace(factor=np.full((3, 3), np.inf)), r"start\.factor: expected finite numbers"),
        (start._replace(time=np.nan), r"start\.time: expected finite numbers, found nan"),
        (start._replace(factor=np.diag([1, 0, 1])), r"start\.factor\[1, 1\]: .* above zero, .* 0"),
        (
            start._replace(factor=np.diag([1, 1, -1])),
            r"start\.factor\[2, 2\]: .* zero, .* found -1",
        ),
        (start._replace(factor=np.tri(3)), r"start\.factor\[1, 0\]: .*upper triangular.*found 1"),
        ((0.0, np.zeros(3), np.eye(3)), r"start: expected an Estimate, found \(0\.0"),
    ):
        with pytest.raises(ValueError, match=message):
            next(cc.run_ekf(ekf, other, [(0.0, good, known)]))
    with pytest.raises(ValueError, match="samples: expected a sequence of samples, found None"):
        next(cc.run_ekf(ekf, start, None))
    for other in (None, start):
        with pytest.raises(ValueError, match=r"ekf: expected a ShapeEkf, found"):
            next(cc.run_ekf(other, start, [(0.0, good, known)]))


def test_a_start_lies_within_the_bounds_of_the_wing(beam):
    options = {"process": "random_walk", "density": 0.1}
    bounded = cc.shape_ekf(replace(beam, weight_bounds=0.5), [ATTITUDE], **options)
    bounded.initial({"q": 0.1}, {"q": [0, 0.5, 0]})
    with pytest.raises(ValueError, match=r"mean\['q'\]\[1\] .*weight_bounds \[-0\.5, 0\.5\] rad/m"):
        bounded.initial({"q": 0.1}, {"q": [0, 0.6, 0]})
    with pytest.raises(ValueError, match=r"mean\['q'\]: expected every element to turn at most"):
        cc.shape_ekf(beam, [ATTITUDE], **options).initial({"q": 0.1}, {"q": [5, 5, 5]})


def test_symbols_where_a_run_needs_numbers_are_named(beam, symbolic):
    options = {"process": "random_walk", "density": 0.1}
    ekf = cc.shape_ekf(beam, [ATTITUDE], root_inputs=["attitude"], **options)
    start, good = ekf.initial({"q": 0.1}), np.eye(3).ravel()
    x = symbolic.sym("x")
    for sample, message in (
        ((x, good, {"attitude": np.eye(3)}), r"samples\[0\].time: expected numbers"),
        ((0.0, x, {"attitude": np.eye(3)}), r"samples\[0\].measured: expected numbers"),
        ((0.0, [x, *good[1:]], {"attitude": np.eye(3)}), r"samples\[0\].measured: expected num"),
        ((0.0, good, {"attitude": symbolic.sym("C", 3, 3)}), r"inputs\['attitude'\]: expected num"),
    ):
        with pytest.raises(ValueError, match=message):
            next(cc.run_ekf(ekf, start, [sample]))
    for arguments, message in (
        (({"q": x},), r"deviation\['q'\]: expected numbers, found the symbol x"),
        (
            ({"q": 0.1}, {"q": symbolic.sym("q", 3)}),
            r"mean\['q'\]: expected numbers, found the sym",
        ),
    ):
        with pytest.raises(ValueError, match=message):
            ekf.initial(*arguments)
    with pytest.raises(ValueError, match="time: expected numbers, found the symbol x"):
        ekf.initial({"q": 0.1}, time=x)


def test_a_covariance_that_is_not_symmetric_is_refused_however_small(beam):
    ekf = cc.shape_ekf(beam, [GYRO], process="white_acceleration", density=0.1)
    covariance = 1e-10 * np.array([[1.0, 0.5, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    with pytest.raises(ValueError, match=r"deviation\['q'\]: expected a symmetric matrix"):
        ekf.initial({"q": covariance, "q_dot": 0.1})


def test_an_attitude_sample_may_be_a_matrix(beam):
    ekf = cc.shape_ekf(beam, [ATTITUDE], process="random_walk", density=0.1)
    start, R = ekf.initial({"q": 0.1}), oracle.rotation([0.01, 0.02, -0.01])
    (by_columns,), (matrix,) = (
        cc.run_ekf(ekf, start, [(0.0, values)]) for values in (R.T.ravel(), R)
    )
    assert matrix.dof == 3
    assert_allclose(matrix.state, by_columns.state, rtol=0)


def test_samples_of_different_rates_are_taken_as_they_come(beam):
    """An attitude every tenth step is an update with its rows alone."""
    ekf = cc.shape_ekf(beam, [GYRO, ATTITUDE], process="white_acceleration", density=0.1)
    start = ekf.initial({"q": 0.1, "q_dot": 0.1})
    gyro, none = [0.0] * 3, [np.nan] * 9
    log = [(0.01 * k, [*gyro, *(np.eye(3).ravel() if k % 10 == 0 else none)]) for k in range(21)]
    dof = [at.dof for at in cc.run_ekf(ekf, start, log)]
    assert dof == [6 if k % 10 == 0 else 3 for k in range(21)]


def test_a_time_stamp_that_goes_back_is_refused(beam):
    ekf = cc.shape_ekf(beam, [GYRO], process="white_acceleration", density=0.1)
    start = ekf.initial({"q": 0.1, "q_dot": 0.1}, time=3.0)
    log = [(3.0, np.zeros(3)), (2.9, np.zeros(3))]
    with pytest.raises(ValueError, match=r"samples\[1\].time: expected at least 3 s.*found 2.9 s"):
        list(cc.run_ekf(ekf, start, log))


def test_the_covariance_of_the_shape_is_that_of_its_points(beam):
    ekf = cc.shape_ekf(beam, [GYRO], process="white_acceleration", density=0.1)
    start = ekf.initial({"q": 1e-4, "q_dot": 0.1}, {"q": [0.1, 0.2, -0.1]})
    P = ekf.covariance(start, "q")
    found = cc.shape_deviations(beam, ekf.part(start, "q"), P, [0.5, 1.0]).position
    draws = start.state[:3, None] + 1e-4 * RNG.normal(size=(3, 4000))
    tips = cc.tip_function(beam).map(4000)(draws)[0].full()
    assert_allclose(found[:, 1], tips.std(axis=1), rtol=0.05)  # 1/√8000, four times
    assert np.all(found[1:, 0] < found[1:, 1])


# Refusals and C --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"process": "brownian"}, "process: expected one of"),
        ({"density": -1.0}, "density: expected a number above zero"),
        (
            {"root_gyro_density": [1, 2], "attitude": True, "root_inputs": ["twist", "twist_rate"]},
            "root_gyro_density: expected 1 number, found 2",
        ),
        ({"density": [1.0, 2.0]}, "density: expected 1 number or 3, found 2"),
        ({"acceleration": None}, "acceleration: expected"),
        (
            {"process": "random_walk"},
            r"rate: expected the standard deviation of q_dot, rad/\(m s\)",
        ),
        ({"gate": 0.0}, "gate: expected a number above zero"),
        ({"iterations": 0}, "iterations: expected a whole number"),
        ({"root_inputs": ["speed"]}, "root_inputs: expected names among"),
        (
            {"attitude": True, "root_inputs": ["twist", "twist_rate"]},
            "root_gyro_density: expected the noise of the gyro at the root, rad/√s",
        ),
        (
            {"attitude": True, "root_gyro_density": 1e-3, "root_inputs": ["position"]},
            "root_inputs: expected 'twist', and for accelerometers 'twist_rate'",
        ),
        ({"gyro_bias": True}, "bias_density: expected"),
        ({"attitude": True, "root_gyro_density": 1e-3, "root_inputs": ["attitude"]}, "attitude"),
    ],
)
def test_wrong_arguments_are_refused(beam, options, message):
    with pytest.raises(ValueError, match=message):
        cc.shape_ekf(beam, [GYRO, ACCELEROMETER], **{**MOVING, **options})


def test_symbols_are_named(beam):
    options = {"process": "random_walk", "density": 0.1}
    with pytest.raises(ValueError, match=r"Beam.length: expected numbers in a filter"):
        cc.shape_ekf(replace(beam, length=ca.SX.sym("L")), [ATTITUDE], **options)
    biased = replace(ATTITUDE, bias=ca.SX.sym("b", 3))
    with pytest.raises(ValueError, match=r"sensors\[0\].bias: expected numbers in a filter"):
        cc.shape_ekf(beam, [biased], **options)
    with pytest.raises(ValueError, match=r"sensors\[0\].bias: expected numbers in a filter"):
        cc.shape_mhe(beam, [biased], dt=0.1, window=2, **options)


def test_gyros_on_a_wing_of_unknown_attitude_need_the_twist(beam):
    with pytest.raises(
        ValueError, match=r"root_inputs: expected 'twist' where .*gyros and acc.*also read"
    ):
        cc.shape_ekf(
            beam,
            [GYRO],
            process="white_acceleration",
            density=1,
            attitude=True,
            root_gyro_density=1e-3,
        )


def test_rows_of_an_attitude_stand_or_fall_together(beam):
    ekf = cc.shape_ekf(beam, [ATTITUDE, GYRO], process="white_acceleration", density=0.1)
    start = ekf.initial({"q": 1e-3, "q_dot": 0.1})
    samples = [np.append(oracle.rotation([0, 0, z]).T.ravel(), np.zeros(3)) for z in (1.0, 0.01)]
    wrong, right = (next(cc.run_ekf(ekf, start, [(0.0, values)])) for values in samples)
    assert_allclose(wrong.used, [0, 0, 0, 1, 1, 1], atol=0)
    assert np.abs(wrong.innovation[:3]).max() > 5
    gyro_alone = np.append(np.full(9, np.nan), np.zeros(3))
    (expected,) = cc.run_ekf(ekf, start, [(0.0, gyro_alone)])
    assert_allclose(wrong.state, expected.state, atol=1e-17)
    assert_allclose(wrong.factor, expected.factor, rtol=1e-12)  # rounding
    open_gate = cc.shape_ekf(
        beam, [ATTITUDE, GYRO], process="white_acceleration", density=0.1, gate=np.inf
    )
    (same,) = cc.run_ekf(open_gate, start, [(0.0, samples[1])])
    assert_allclose(right.state, same.state, atol=1e-15)
    assert_allclose(right.innovation, same.innovation, rtol=1e-9, atol=1e-12)
    assert right.dof == 6


def test_labels_of_sensors_differ():
    gauge = cc.StrainGauge(xi=0.5, offset=[0, 0.1], noise=1e-3, name="a_x")
    with pytest.raises(ValueError, match="sensors: expected different labels, found 'a_x' twice"):
        cc.sensor_channels([gauge, replace(GYRO, name="a")])


def test_inputs_and_outputs_are_described(beam):
    ekf = attitude_filter(beam)
    for key, f in (("predict", ekf.predict), ("update", ekf.update)):
        words = ekf.descriptions[key]
        assert set(words) == {*f.name_in(), *f.name_out()}
        cc.CFunction(function=f, descriptions=words)
    assert "attitude_1_R_xx 1" in words["measured"]
    assert words["state"].startswith("attitude (9) 1, q (3) rad/m")
    options = {"process": "random_walk", "density": 0.1, "root_inputs": ["twist"]}
    mhe = cc.shape_mhe(beam, [ATTITUDE], dt=0.1, window=2, **options)
    cc.CFunction(function=mhe.step, descriptions=mhe.descriptions, missing=("measured",))
    assert set(mhe.descriptions) == {*mhe.step.name_in(), *mhe.step.name_out()}


def test_a_start_names_what_is_missing(beam):
    ekf = cc.shape_ekf(beam, [GYRO], process="white_acceleration", density=0.1)
    with pytest.raises(ValueError, match="deviation: expected values by name of a part"):
        ekf.initial(0.1)
    with pytest.raises(ValueError, match="name: expected one of 'q', 'q_dot'; found 'x'"):
        ekf.part(ekf.initial({"q": 0.1, "q_dot": 0.1}), "x")
    with pytest.raises(ValueError, match="deviation: expected 'q_dot'"):
        ekf.initial({"q": 0.1})
    with pytest.raises(ValueError, match=r"deviation\['q'\]: expected a positive definite"):
        ekf.initial({"q": np.zeros((3, 3)), "q_dot": 1.0})


@pytest.mark.parametrize("form", [np.atleast_2d, lambda x: [[x]]])
def test_of_one_weight_a_matrix_is_a_covariance(one_weight, form):
    ekf = cc.shape_ekf(one_weight, [GYRO], process="white_acceleration", density=0.1)
    start = ekf.initial({"q": form(0.04), "q_dot": 0.2})
    assert_allclose(start.covariance, 0.04 * np.eye(2), rtol=1e-15)


def test_one_weight_is_estimated_from_one_gauge(one_weight):
    gauge = cc.StrainGauge(xi=0.5, offset=[0.0, 0.1], noise=1e-3)
    ekf = cc.shape_ekf(one_weight, [gauge], process="random_walk", density=0.1)
    (after,) = cc.run_ekf(ekf, ekf.initial({"q": 0.1}), [(0.0, [0.002])])
    # Prior 0.01², reading 0.1 q: both known to the same 0.01 of the gauge against 0.1.
    assert_allclose(after.state, [0.02 / (1 + 0.01)], rtol=1e-12)


@pytest.mark.parametrize("process", ["random_walk", "white_acceleration"])
def test_a_step_back_in_time_is_nan_and_none_at_all_is_exact(beam, process):
    ekf = cc.shape_ekf(beam, [ATTITUDE], process=process, density=0.3)
    start = ekf.initial(dict.fromkeys([part.name for part in ekf.layout.parts], 0.1))
    _, same = ekf.predict(start.state, start.factor, 0.0)
    assert_allclose(same.full(), start.factor, rtol=0)
    assert np.any(np.isnan(ekf.predict(start.state, start.factor, -1e-3)[1].full()))


def test_in_single_precision_the_covariance_stays_positive_definite(tmp_path):
    table = estimation.single_precision(steps=2000)
    assert table.failures == 0, table.render()
