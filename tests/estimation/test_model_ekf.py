"""Filters on a control model: against an independent Kalman filter, and on models that fly."""

from __future__ import annotations

import re
import warnings
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose

import curvcasadi as cc
from benchmarks import model_flights
from curvcasadi.estimation import ud
from curvcasadi.export import run_check
from tests.support import oracle

DT = 0.01
GJ, INERTIA, LENGTH = 30.0, 0.02, 2.0
GYRO = cc.RateGyro(xi=1.0, noise_density=2e-3, rate=1 / DT)
GAUGE = cc.ShearGauge(xi=0.3, noise=1e-3)


@pytest.fixture(scope="module")
def shaft():
    """A beam that only twists, so that its motion is linear, with a torque at the tip."""
    beam = cc.Beam(
        length=LENGTH,
        basis=cc.ChannelBasis(torsion=cc.Legendre(2)),
        grid=cc.Grid.lobatto(4),  # integrates the inertia exactly
        section=cc.Section(
            GJ=GJ, EI_y=1.0, EI_z=1.0, mass_per_length=1.0, inertia=np.diag([INERTIA, 1, 1])
        ),
    )
    torque, gust = ca.MX.sym("torque"), ca.MX.sym("gust")
    load = cc.PointMoment(xi=1.0, moment=ca.vertcat(torque + gust, 0, 0), frame="follower")
    model = cc.beam_model(beam, [load], {"torque": torque}, {"gust": gust}, damping=0.003)
    return beam, model


class Kalman:
    """A Kalman filter of the shaft from its equations: nothing of the package is used.

    The twist angle at ξ is θ = L Σ q_i ψ_i, ψ_i the integral of a Legendre function.
    """

    def __init__(self, density, gust_density, gust_time, dt=DT, implicit=False):
        nodes, weights = np.polynomial.legendre.leggauss(8)
        xi, w = (nodes + 1) / 2, weights / 2 * LENGTH
        phi, psi = self.functions(xi)
        mass = INERTIA * (psi * w) @ psi.T
        stiffness = GJ * (phi * w) @ phi.T
        A = np.zeros((5, 5))
        A[:2, 2:4] = np.eye(2)
        A[2:4, :2] = -np.linalg.solve(mass, stiffness)
        A[2:4, 2:4] = 0.003 * A[2:4, :2]
        by_torque = np.linalg.solve(mass, self.functions(np.ones(1))[1][:, 0])
        A[2:4, 4] = by_torque  # the gust is held within a step
        h, one = A * dt, np.eye(5)
        if implicit:  # the midpoint rule is Cayley's transform of a linear system
            F = np.linalg.solve(one - h / 2, one + h / 2)
            gain = dt * np.linalg.inv(one - h / 2)
        else:  # Runge–Kutta
            F = one + h + h @ h / 2 + h @ h @ h / 6 + h @ h @ h @ h / 24
            gain = dt * (one + h / 2 + h @ h / 6 + h @ h @ h / 24)
        self.by_input = gain @ np.r_[0, 0, by_torque, 0]
        F[4, 4] = np.exp(-dt / gust_time)
        self.F = F
        self.noise = dt / 2 * np.diag([0, 0, density**2, density**2, gust_density**2])
        tip, gauge = self.functions(np.ones(1))[1][:, 0], self.functions(np.full(1, 0.3))[0][:, 0]
        self.H = np.zeros((3, 5))
        self.H[0, 2:4], self.H[1, :2], self.H[2, 0] = tip, gauge, 1.0
        self.R = np.diag([GYRO.noise[0] ** 2, 1e-6, 4e-4])

    @staticmethod
    def functions(xi):
        """Legendre functions (2, m) of ξ, and L times their integrals from the root."""
        return np.array([xi**0, 2 * xi - 1]), LENGTH * np.array([xi, xi**2 - xi])

    def step(self, x, P, u, z):
        x = self.F @ x + self.by_input * u
        P = self.F @ (P + self.noise) @ self.F.T + self.noise
        there = np.isfinite(z)
        H, R = self.H[there], self.R[np.ix_(there, there)]
        S = H @ P @ H.T + R
        K = np.linalg.solve(S, H @ P).T
        left = np.eye(5) - K @ H
        return x + K @ (z[there] - H @ x), left @ P @ left.T + K @ R @ K.T


@pytest.mark.parametrize("method, dt", [("rk4", DT), ("implicit_midpoint", DT * 10)])
def test_on_a_linear_model_it_is_the_filter_of_kalman(shaft, method, dt):
    # With ten times the step Runge–Kutta's method is unstable.
    beam, model = shaft
    process = cc.ModelProcess(
        model=model,
        density={"q_dot": 0.3, "gust": 0.2},
        estimated={"gust": 0.5},
        method=method,
    )
    ekf = cc.shape_ekf(beam, [GYRO, GAUGE], process=process, outputs={"q": 0.02}, gate=np.inf)
    start = ekf.initial({"q": 0.05, "q_dot": 0.2, "gust": 0.1}, {"q": [0.1, -0.05], "gust": 0.0})
    assert ekf.channels.labels == ("gyro_1_x", "gyro_1_y", "gyro_1_z", "shear_1", "q_0", "q_1")
    oracle = Kalman(0.3, 0.2, 0.5, dt, method == "implicit_midpoint")
    x, P = start.state, start.covariance
    rng = np.random.default_rng(4)
    samples, expected = [], []
    for k in range(30):
        z, u = 0.1 * rng.normal(size=3), 0.05 * rng.normal()
        z[rng.random(3) < 0.2] = np.nan
        x, P = oracle.step(x, P, u, z)
        expected.append((x, P))
        measured = np.array([z[0], np.nan, np.nan, z[1], z[2], np.nan])
        samples.append((dt * (k + 1), measured, {"u": u}))
    for found, (x, P) in zip(cc.run_ekf(ekf, start, samples), expected, strict=True):
        # Rounding, in a state of size 0.1 and over the largest variance.
        assert_allclose(found.state, x, atol=1e-10)
        assert_allclose(found.covariance, P, atol=1e-10 * np.abs(P).max())


# Long steps --------------------------------------------------------------------------------------


def test_a_step_beyond_stability_is_named_before_it_gives_wrong_numbers(shaft):
    beam, model = shaft
    gyro, given = replace(GYRO, rate=10.0), {"u": 0.0, "p": 0.0}
    words = r"steps of 0.1 s .* unstable, .* method='implicit_midpoint' or more substeps"
    with pytest.warns(UserWarning, match=f"process: at the rate of the sensors {words}"):
        ekf = cc.shape_ekf(beam, [gyro], process=model, density=0.3)
    start = ekf.initial({"q": 0.05, "q_dot": 0.2})
    near = [(0.01, np.zeros(3), given)]
    assert len(list(cc.run_ekf(ekf, start, near))) == 1
    with pytest.raises(
        ValueError, match=rf"samples\[1\].time: 0.1 s after the one before, {words}"
    ):
        list(cc.run_ekf(ekf, start, [*near, (0.11, np.zeros(3), given)]))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for changes in ({"substeps": 10}, {"method": "implicit_midpoint"}):
            process = cc.ModelProcess(model=model, density={"q_dot": 0.3}, **changes)
            ekf = cc.shape_ekf(beam, [gyro], process=process)
            (at,) = cc.run_ekf(ekf, start, [(0.1, np.zeros(3), given)])
            assert np.all(np.isfinite(at.covariance))


def test_predictions_over_no_time_change_nothing_and_by_implicit_steps_neither(shaft):
    beam, model = shaft
    process = cc.ModelProcess(model=model, density={"q_dot": 0.3}, method="implicit_midpoint")
    ekf = cc.shape_ekf(beam, [GAUGE], process=process)
    for q_dot in (0.0, 0.3):
        start = ekf.initial({"q": 0.05, "q_dot": 0.2}, {"q": [0.1, 0.0], "q_dot": 2 * [q_dot]})
        state, factor = ekf.predict(start.state, start.factor, 0.0, 0.1, 0.2)
        assert_allclose(state.full().ravel(), start.state, rtol=0)
        assert_allclose(ud.covariance_of(factor.full()), start.covariance, rtol=1e-13)
    _, factor = ekf.predict(start.state, start.factor, -0.01, 0.1, 0.2)
    assert np.isnan(factor.full()).any()


def test_an_implicit_prediction_that_does_not_converge_is_no_number(stream):
    model, _ = stream
    process = cc.ModelProcess(
        model=model, density={"q_dot": 0.1, "lag": 0.1}, method="implicit_midpoint"
    )
    ekf = cc.shape_ekf(model_flights.wing().beam, model_flights.SENSORS[4:], process=process)
    names = [part.name for part in ekf.error_layout.parts]
    start = ekf.initial(dict.fromkeys(names, 0.01), {"q": [0.1, 0, 0, 0], "q_dot": 4 * [30.0]})
    given = {"u": 0.0, "p": [15.0, 0.03, 0.0]}
    state, _ = ekf.predict(start.state, start.factor, 2.0, *given.values())
    assert np.isnan(state.full()).any()
    with pytest.raises(cc.ConvergenceError, match=r"samples\[0\]: the prediction over 2 s"):
        list(cc.run_ekf(ekf, start, [(2.0, np.zeros(2), given)]))


def test_a_control_model_and_keywords_are_a_process(shaft):
    beam, model = shaft
    inputs = {"density": 0.3}
    short = cc.shape_ekf(beam, [GYRO], process=model, **inputs)
    long = cc.shape_ekf(beam, [GYRO], process=cc.ModelProcess(model=model, density={"q_dot": 0.3}))
    start = short.initial({"q": 0.05, "q_dot": 0.2})
    arguments = (start.state, start.factor, DT, 0.1, 0.2)
    for a, b in zip(short.predict(*arguments), long.predict(*arguments), strict=True):
        assert_allclose(a, b, atol=0)


@pytest.fixture(scope="module")
def stream():
    model = model_flights.model()
    return model, model_flights.make(model, iterations=4)


def test_readings_and_slopes_are_those_of_the_moving_wing(stream):
    # One update from a covariance that is tiny moves the state by P Hᵀ R⁻¹ (z − h): the slopes, by
    # central differences of the readings at the accelerations of the model.
    model, ekf = stream
    rng = np.random.default_rng(3)
    nx, n = model.x.size, model.second_order.velocities
    size = ekf.error_layout.size
    z = np.concatenate([0.02 * rng.normal(size=n), 0.05 * rng.normal(size=n), rng.normal(size=4)])
    u, known = 0.05, [15.0, 0.03]
    sensors, root = model_flights.SENSORS, model_flights.ROOT

    def read(z):
        q_ddot = model.xdot(z[:nx], u, [*known, z[nx]])[n : 2 * n]
        beam = model_flights.wing().beam
        return cc.measure(sensors, beam, z[:n], z[n : 2 * n], q_ddot, root).values.full()[:, 0]

    step = 1e-6
    H = np.column_stack(
        [(read(z + step * e) - read(z - step * e)) / 2 / step for e in np.eye(size)]
    )
    one = model_flights.make(model, iterations=1, recovery=0, gate=np.inf)
    P = 1e-14 * np.eye(size)
    noise = ekf.channels.noise
    S = H @ P @ H.T + np.diag(noise**2)
    # The doubt about the model's accelerations is noise that all accelerometers share.
    unknown = H_of_acceleration(model, z, u, known) * model_flights.ACCELERATION
    S += unknown @ unknown.T
    wanted = rng.normal(size=len(noise)) * noise
    moved = P @ H.T @ np.linalg.solve(S, wanted)
    found = one.update(z, ud.factor_of(P), read(z) + wanted, u, known)
    # Central differences are good to some 1e-7 of accelerations of 10 m/s².
    scale = np.abs(moved).max()
    assert_allclose((found[0].full()[:, 0] - z) / scale, moved / scale, atol=3e-3)


def H_of_acceleration(model, z, u, known):
    n, beam = model.second_order.velocities, model_flights.wing().beam

    def read(a):
        values = cc.measure(model_flights.SENSORS, beam, z[:n], z[n : 2 * n], a, model_flights.ROOT)
        return values.values.full()[:, 0]

    return np.column_stack([read(e) - read(np.zeros(n)) for e in np.eye(n)])


def test_errors_are_what_the_covariance_says(stream):
    model, ekf = stream
    runs = 12
    found = model_flights.simulate(
        model, ekf, model_flights.DEVIATION, steps=6, runs=runs, native=False
    )
    # 99.9 % of averages of `runs` numbers; `python -m benchmarks` has the 95 % of 200.
    for values, dof in ((found.nees, found.size), (found.nis, found.dof.mean())):
        width = 3.3 * np.sqrt(2 / (dof * runs))
        assert abs(values[-3:].mean() / dof - 1) < width


# Recovery ----------------------------------------------------------------------------------------


def shaft_run(shaft, offset, recovery, outlier_at=()):
    """Errors over deviations of a filter that thinks it knows the start, at each sample."""
    beam, model = shaft
    process = cc.ModelProcess(model=model, density={"q_dot": 0.05})
    gauges = [cc.ShearGauge(xi=xi, noise=1e-3) for xi in (0.1, 0.4, 0.8)]
    ekf = cc.shape_ekf(beam, [GYRO, *gauges], process=process, recovery=recovery)
    start = ekf.initial({"q": 1e-3, "q_dot": 1e-2})
    step = cc.rk4_step(model, DT)
    rng = np.random.default_rng(5)
    q, q_dot = ca.MX.sym("q", 2), ca.MX.sym("q_dot", 2)
    sensors = ekf.channels.sensors
    read = ca.Function("read", [q, q_dot], [cc.measure(sensors, beam, q, q_dot).values])
    x, truth, samples = np.r_[offset, 0, 0], [], []
    for k in range(100):
        w = 0.05 * np.sqrt(DT) * rng.normal(size=2)
        x = step(x + np.r_[0, 0, w], 0, 0).full()[:, 0]
        values = read(x[:2], x[2:]).full()[:, 0]
        values += ekf.channels.noise * rng.normal(size=len(values))
        values[3] += 0.5 * (k in outlier_at)
        truth.append(x)
        samples.append((DT * (k + 1), values, {"p": 0.0, "u": 0.0}))
    found = list(cc.run_ekf(ekf, start, samples))
    errors = [
        (at.state[:4] - x) / np.sqrt(np.diag(at.covariance))
        for at, x in zip(found, truth, strict=True)
    ]
    return np.array(errors), found, ekf


def test_a_filter_that_is_sure_of_a_wrong_start_recovers(shaft):
    locked, _, _ = shaft_run(shaft, [0.3, -0.2], recovery=0)
    assert np.abs(locked[-1]).max() > 50  # it believes its start, and no sensor
    errors, found, ekf = shaft_run(shaft, [0.3, -0.2], recovery=5)
    counters = np.array([ekf.part(at, "rejections") for at in found])
    assert counters.max() == 5
    assert np.all(counters[-50:] == 0)
    assert np.abs(errors[-50:]).max() < 4.5  # 200 normal numbers


def test_one_wrong_sensor_is_left_out_for_good(shaft):
    # One of three gauges fails at each sample: that is no majority, and its counter stays.
    errors, found, _ = shaft_run(shaft, [0, 0], recovery=5, outlier_at=range(100))
    assert all(at.used[3] == 0 for at in found)
    assert np.abs(errors).max() < 4.5


@pytest.mark.parametrize("process", ["random_walk", "white_acceleration"])
def test_a_filter_of_a_white_process_recovers_where_it_is_asked_to(process):
    # A wing at rest, thought straight: gauges, and attitude sensors, which are used as a whole.
    beam = cc.Beam(
        length=2.0,
        basis=cc.ChannelBasis(torsion=cc.Legendre(1), out_of_plane=cc.Legendre(2)),
        grid=cc.Grid.uniform(4),
    )
    sensors = [
        *(cc.AttitudeSensor(xi=xi, noise=0.01) for xi in (0.5, 1.0)),
        *(cc.StrainGauge(xi=xi, offset=[0, 0.05], noise=1e-4) for xi in (0.1, 0.6)),
    ]
    truth, deviation = np.array([0.2, -0.4, 0.1]), {"q": 1e-3, "q_dot": 1e-3}
    values = cc.measure(sensors, beam, truth).values.full()[:, 0]
    samples = [(DT * k, values) for k in range(1, 31)]
    for recovery, recovers in ((0, False), (5, True)):
        ekf = cc.shape_ekf(
            beam, sensors, process=process, density=1e-3, recovery=recovery, iterations=3
        )
        start = ekf.initial({p.name: deviation[p.name] for p in ekf.error_layout.parts})
        *_, last = cc.run_ekf(ekf, start, samples)
        assert bool(np.abs(ekf.part(last, "q") - truth).max() < 5e-3) == recovers
        assert ("rejections" in ekf.layout.slices) == recovers


# Free flight -------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def flying():
    beam = replace(
        model_flights.wing().beam,
        basis=cc.ChannelBasis(out_of_plane=cc.Legendre(1)),
        grid=cc.Grid.lobatto(2),
    )
    body = cc.RigidBody(mass=50.0, center_of_mass=[0.1, 0, 0.2], inertia=np.diag([40.0, 30, 50]))
    wing = cc.Wing(name="right", beam=beam)
    aircraft = cc.Aircraft(body=body, beams=(wing, cc.mirror_wing(wing, "left")))
    model = cc.aircraft_model(aircraft, density=0, gravity=9.81)
    sensors = {
        "right": [
            cc.RateGyro(xi=0.0, noise_density=1e-3, rate=1 / DT),
            cc.Accelerometer(xi=0.0, noise_density=1e-2, rate=1 / DT),
            cc.AttitudeSensor(xi=0.0, noise=0.01),
            cc.Accelerometer(xi=1.0, noise_density=1e-2, rate=1 / DT, name="tip"),
        ],
        "left": [cc.Accelerometer(xi=1.0, noise_density=1e-2, rate=1 / DT, name="tip")],
    }
    ekf = cc.shape_ekf(
        aircraft,
        sensors,
        process=cc.ModelProcess(
            model=model,
            density={"twist": 0.02, "q_dot_right": 0.05, "q_dot_left": 0.05},
            substeps=1,
        ),
        outputs={"position": 0.1},
        root=cc.RootMotion(gravity=[0, 0, 9.81]),
        iterations=2,
    )
    return aircraft, model, ekf


def test_covariances_of_attitudes_move_on_the_group(flying):
    # A square root of the covariance, retracted, stepped and differenced: no derivative is shared.
    _, model, ekf = flying
    rng = np.random.default_rng(6)
    q = rng.normal(size=4)
    mean = {"quaternion_wxyz": q / np.linalg.norm(q), "q_right": -0.02, "q_left": -0.01}
    mean |= {"twist": [0.5, -0.3, 0.4, 5.0, 1.0, -1.0], "q_dot_right": 0.1}
    deviation = {part.name: 1e-3 * (1 + i) for i, part in enumerate(ekf.error_layout.parts)}
    start = ekf.initial(deviation, mean)
    state, factor = ekf.predict(start.state, start.factor, DT)
    nx, n = model.x.size, ekf.error_layout.size
    x = start.state[:nx]
    step = cc.rk4_step(model, DT)
    after = step(x, [], [])
    assert_allclose(state.full()[:nx], after.full(), rtol=1e-12)
    small = 1e-5
    columns = [
        cc.difference(model, after, step(cc.retract(model, x, sign * small * e), [], []))
        for e in np.eye(n)
        for sign in (1, -1)
    ]
    moved = np.hstack([c.full() for c in columns])
    F = (moved[:, ::2] - moved[:, 1::2]) / 2 / small
    noise = np.zeros(n)
    for name, density in (("twist", 0.02), ("q_dot_right", 0.05), ("q_dot_left", 0.05)):
        noise[ekf.error_layout.slices[name]] = density**2 * DT / 2
    expected = F @ (start.covariance + np.diag(noise)) @ F.T + np.diag(noise)
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    found = ud.covariance_of(factor.full())
    assert_allclose(found / scale, expected / scale, atol=1e-8)  # of the differences


def aircraft_readings(aircraft, model, ekf):
    """(x) -> what the sensors of the flying aircraft read, from its motion."""
    x = ca.MX.sym("x", model.x.size)
    parts, rates = model.x.split(x), model.x.split(model.xdot(x, [], []))
    values = []
    for wing, sensors in zip(
        aircraft.beams, (ekf.channels.sensors[:4], ekf.channels.sensors[4:5]), strict=True
    ):
        # Twists of the root, its axes: Rᵀ ω and Rᵀ (v − p × ω).
        R, p = wing.beam.root.rotation, wing.beam.root.position

        def at_root(twist, R=R, p=p):
            return ca.vertcat(R.T @ twist[:3], R.T @ (twist[3:] - ca.cross(p, twist[:3])))

        w, v = parts["quaternion_wxyz"][0], parts["quaternion_wxyz"][1:]
        columns = [e + 2 * ca.cross(v, w * e + ca.cross(v, e)) for e in ca.horzsplit(ca.DM.eye(3))]
        root = cc.RootMotion(
            pose=cc.Pose(rotation=ca.horzcat(*columns), position=parts["position"]),
            twist=at_root(parts["twist"]),
            twist_rate=at_root(rates["twist"]),
            gravity=[0, 0, 9.81],
        )
        motion = parts[f"q_{wing.name}"], parts[f"q_dot_{wing.name}"], rates[f"q_dot_{wing.name}"]
        values.append(cc.measure(sensors, wing.beam, *motion, root).values)
    return ca.Function("read", [x], [ca.vertcat(*values, parts["position"])])


def test_a_flying_aircraft_is_estimated_with_its_attitude(flying):
    aircraft, model, ekf = flying
    assert ekf.channels.labels[-6:-2] == ("left_tip_x", "left_tip_y", "left_tip_z", "position_0")
    rng = np.random.default_rng(7)
    deviation = {
        "quaternion_wxyz": 0.1, "position": 1.0, "q_right": 5e-3, "q_left": 5e-3,
        "twist": [*[0.05] * 3, *[0.5] * 3], "q_dot_right": 0.02, "q_dot_left": 0.02,
    }  # fmt: skip
    start = ekf.initial(deviation, {"twist": [0.3, 0.1, 0.2, 10.0, 0, 0]})
    spread = np.sqrt(np.diag(start.covariance))
    x = cc.retract(model, start.state[: model.x.size], spread * rng.normal(size=len(spread)))
    step, read = cc.rk4_step(model, DT), aircraft_readings(aircraft, model, ekf)
    noise = np.concatenate([ekf.channels.noise[:6], np.zeros(9), ekf.channels.noise[9:]])
    samples = []
    for k in range(40):
        x = step(x, [], [])
        z = read(x).full()[:, 0] + noise * rng.normal(size=len(noise))
        turn = oracle.rotation(0.01 * rng.normal(size=3))  # the noise of an attitude turns it
        z[6:15] = (z[6:15].reshape(3, 3).T @ turn).T.ravel()
        samples.append((DT * (k + 1), z))
    at = list(cc.run_ekf(ekf, start, samples))[-1]
    error = cc.difference(model, at.state[: model.x.size], x).full()[:, 0]
    nees = error @ np.linalg.solve(at.covariance, error)
    assert nees < 2.6 * len(error)  # 1e-4 of χ² numbers of 16
    assert np.linalg.norm(error[:3]) < 0.02  # rad, from 0.1


# C -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "real, method", [("double", "rk4"), ("float", "rk4"), ("double", "implicit_midpoint")]
)
def test_a_filter_on_a_model_is_exported(shaft, real, method, tmp_path):
    beam, model = shaft
    process = cc.ModelProcess(
        model=model,
        density={"q_dot": 0.3, "gust": 0.2},
        estimated={"gust": 0.5},
        method=method,
    )
    ekf = cc.shape_ekf(beam, [GYRO, GAUGE], process=process)
    start = ekf.initial({"q": 0.05, "q_dot": 0.2, "gust": 0.1}, {"q": [0.1, -0.05], "gust": 0.0})
    measured = [0.3, 0.0, 0.0, np.nan]
    steps = [
        cc.CFunction(function=ekf.predict, descriptions=ekf.descriptions["predict"]),
        cc.CFunction(
            function=ekf.update, descriptions=ekf.descriptions["update"], missing=("measured",)
        ),
    ]
    at = start.state, start.factor
    samples = {"ekf_predict": [(*at, DT, 0.1)], "ekf_update": [(*at, measured, 0.1)]}
    cc.export_c(steps, tmp_path, real=real, reference_inputs=samples)
    # Of the largest entries; in single precision of a factor that is well conditioned.
    differences = run_check(tmp_path)
    assert set(differences) == {"ekf_predict", "ekf_update"}
    assert max(differences.values()) < {"double": 1e-12, "float": 1e-4}[real]
    header = (tmp_path / "curv.h").read_text()
    assert "torque (1) SI" in header


# Biases, and what is refused ---------------------------------------------------------------------


def test_biases_are_estimated_beside_the_shape(shaft):
    beam, model = shaft
    sensors = [
        GYRO,
        cc.Accelerometer(xi=1.0, noise_density=1e-2, rate=1 / DT, offset=[0, 0.1, 0]),
        *(cc.ShearGauge(xi=xi, noise=1e-3) for xi in (0.1, 0.6)),
    ]
    root = cc.RootMotion(gravity=[0, 0, -9.81])
    ekf = cc.shape_ekf(
        beam, sensors, process=model, density=0.05, root=root, gyro_bias=True,
        accelerometer_bias=True, bias_density=1e-6,
    )  # fmt: skip
    deviation = {"q": 0.01, "q_dot": 0.05, "gyro_bias": 0.05, "accelerometer_bias": 0.3}
    start = ekf.initial(deviation)
    bias = np.array([0.04, -0.06, 0.03, 0.3, -0.2, 0.4])
    x, u = ca.MX.sym("x", 4), ca.MX.sym("u")
    motion = x[:2], x[2:], model.xdot(x, u, 0)[2:]
    read = ca.Function("read", [x, u], [cc.measure(sensors, beam, *motion, root).values])
    step, rng = cc.rk4_step(model, DT), np.random.default_rng(8)
    truth, samples = np.array([0.01, -0.01, 0.05, 0.05]), []
    for k in range(80):
        w = 0.05 * np.sqrt(DT) * rng.normal(size=2)
        torque = 0.05 * np.sin(5 * k * DT)
        truth = step(truth + np.r_[0, 0, w], torque, 0).full()[:, 0]
        z = read(truth, torque).full()[:, 0] + ekf.channels.noise * rng.normal(size=8)
        z[:6] += bias
        samples.append((DT * (k + 1), z, {"u": torque, "p": 0.0}))
    *_, last = cc.run_ekf(ekf, start, samples)
    found = np.concatenate([ekf.part(last, key) for key in ("gyro_bias", "accelerometer_bias")])
    deviations = np.sqrt(np.diag(last.covariance))[4:]
    assert np.all(deviations < 0.2 * np.repeat([0.05, 0.3], 3))
    assert np.abs((found - bias) / deviations).max() < 4.0


def test_what_a_filter_on_a_model_needs(shaft):
    beam, model = shaft
    lagging = cc.kinematic_model(beam, time_constant=0.1)
    accelerometer = [cc.Accelerometer(xi=1.0, noise_density=1e-2, rate=1 / DT)]
    gravity = cc.RootMotion(gravity=[0, 0, -9.81])
    process = cc.ModelProcess(model=model, density={"q_dot": 0.1})
    other = replace(beam, basis=cc.ChannelBasis(torsion=cc.Legendre(3)))
    for message, arguments in {
        "density: expected the density": {"process": model},
        "density: expected None beside": {"process": process, "density": 1.0},
        "density: expected one of": {"process": model, "density": {"lag": 0.1}},
        "estimated: expected one of": {"process": replace(process, estimated={"wind": None})},
        "density: expected one of 'gust'": {"process": replace(process, estimated={"gust": 1.0})},
        "rate: expected none": {"process": process, "rate": 1.0},
        "outputs: expected one of": {"process": process, "outputs": {"height": 1.0}},
        "gyro_bias: expected a sensor": {
            "sensors": [GAUGE], "process": process, "gyro_bias": True,
        },
        "sensors: expected a model with inertia": {
            "sensors": accelerometer, "process": lagging, "density": 0.1, "root": gravity,
        },
        "process: expected a model whose state": {"beam": other, "process": process},
        "recovery: expected a whole number": {"process": process, "recovery": -1},
        "outputs: expected None": {"process": "random_walk", "density": 1.0, "outputs": {"q": 1.0}},
    }.items():  # fmt: skip
        with pytest.raises(ValueError, match=re.escape(message)):
            cc.shape_ekf(**{"beam": beam, "sensors": [GAUGE], **arguments})


def test_sensors_of_an_aircraft_are_given_by_wing(flying):
    aircraft, model, _ = flying
    process = cc.ModelProcess(model=model, density={"twist": 0.1})
    for message, sensors in {
        "sensors: expected sensors by name": [GAUGE],
        "sensors: expected one of 'right', 'left'": {"tail": [GAUGE]},
        "sensors: expected one or more": {"right": []},
    }.items():
        with pytest.raises(ValueError, match=message):
            cc.shape_ekf(aircraft, sensors, process=process)
    ekf = cc.shape_ekf(aircraft, {"right": [GAUGE]}, process=process)
    with pytest.raises(ValueError, match="expected a unit quaternion"):
        ekf.initial(
            {part.name: 1.0 for part in ekf.error_layout.parts}, {"quaternion_wxyz": [1, 1, 0, 0]}
        )
