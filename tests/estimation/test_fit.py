"""Fits of a shape to sensors: optimum, covariance, χ², outliers, and what sensors do not see."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation
from scipy.stats import chi2, kstest, norm

import curvcasadi as cc
from curvcasadi.estimation.fit.gauss_newton import UNDEFINED, Linearization, minimize
from curvcasadi.reference_wings import RIGHT_WING_ROOT, hale_wing
from tests.support import oracle

WING = hale_wing(2, 2, 2)
HALF_DEGREE = np.deg2rad(0.5)
ATTITUDES = [cc.AttitudeSensor(xi=xi, noise=HALF_DEGREE) for xi in (0.25, 0.5, 0.75, 1.0)]
BENT = np.array([0.01, -0.005, -0.05, 0.02, 0.003, -0.001])
GRAVITY = cc.RootMotion(gravity=[0, 0, 9.81], magnetic_field=[2e-5, 0, 4e-5])
IMU = {"noise_density": 1e-3, "rate": 100.0}
STATIONS = (0.2, 0.4, 0.6, 0.8, 1.0)
CAMERA = cc.Pose(rotation=np.eye(3), position=[0.5, 2.0, -12.0])
#: Sets of sensors that see all six weights.
SETS = {
    "attitudes": ATTITUDES,
    "accelerometers": [cc.Accelerometer(xi=xi, **IMU) for xi in STATIONS],
    "magnetometers and accelerometers": [
        kind(xi=xi, **{**IMU, "noise_density": noise})
        for xi in STATIONS
        for kind, noise in ((cc.Magnetometer, 1e-8), (cc.Accelerometer, 1e-3))
    ],
    "gauges": [
        *(cc.ShearGauge(xi=xi, noise=1e-5) for xi in (0.1, 0.6, 0.9)),
        *(
            cc.StrainGauge(xi=xi, offset=offset, noise=1e-6)
            for xi in (0.1, 0.6, 0.9)
            for offset in ([0.1, 0.02], [-0.1, 0.02])
        ),
    ],
    "markers": [cc.Marker(xi=xi, offset=[0, 0.3, 0], noise=1e-3) for xi in STATIONS],
    "cameras": [
        cc.Camera(xi=xi, offset=[0, y, 0], pose=CAMERA, noise=1e-3)
        for xi in STATIONS
        for y in (-0.3, 0.3)
    ],
}


def readings(sensors, q, wing=WING):
    """Exact readings (m,) at rest."""
    rest = ca.DM.zeros(wing.basis.n)
    return cc.measure(sensors, wing, ca.DM(q), rest, root=GRAVITY).values.full().ravel()


def attitudes(q, wing=WING, sensors=ATTITUDES):
    """Exact attitudes (k, 3, 3) of the sensors."""
    return np.array([cc.pose_at(wing, q, s.xi).rotation.full() for s in sensors])


def noisy(exact, rng, scale=HALF_DEGREE):
    """Measurements of attitudes with noise on the right."""
    turned = exact @ Rotation.from_rotvec(rng.normal(scale=scale, size=(len(exact), 3))).as_matrix()
    return turned.transpose(0, 2, 1).ravel()


# The optimum -----------------------------------------------------------------------------------


@pytest.mark.parametrize("name", SETS)
def test_exact_readings_give_the_weights_from_straight(name):
    sensors = SETS[name]
    rest = None if max(s.order for s in sensors) == 0 else np.zeros(6)
    fit = cc.fit_shape(WING, sensors, readings(sensors, BENT), q_dot=rest, root=GRAVITY)
    # The iteration ends 1e-6 standard deviations from the optimum, which is the truth.
    assert np.max(np.abs(fit.q.full().ravel() - BENT) / fit.deviations) < 2e-6
    assert fit.rank == 6 and fit.unseen == () and fit.converged
    assert "e+" not in fit.message and fit.p_value > 0.999


@pytest.mark.parametrize("weight", [-0.04, 0.04, 0.07])
def test_thirty_percent_of_the_span_at_the_tip_are_found_from_straight(weight):
    truth = np.array([0.01, 0, weight, 0, 0, 0])
    tip = cc.shape_map(WING, truth).tip.position.full().ravel()
    assert abs(tip[2]) > 0.3 * 16
    fit = cc.fit_shape(WING, ATTITUDES, noisy(attitudes(truth), np.random.default_rng(1)))
    assert np.all(np.abs(fit.q.full().ravel() - truth) < 4 * fit.deviations)
    assert fit.p_value > 1e-3


def test_the_optimum_is_that_of_scipy_on_an_ode():
    """Poses by `solve_ivp`, logarithms by scipy: no code of the package in the oracle."""
    rng = np.random.default_rng(3)
    sensors = [
        cc.AttitudeSensor(xi=0.5, noise=0.02, mounting=oracle.rotation([0.3, 0.2, -0.9])),
        cc.Marker(xi=1.0, noise=0.05, offset=[0.1, 0.3, -0.2]),
        cc.StrainGauge(xi=0.3, offset=[0.1, -0.05], noise=1e-4),
        cc.StrainGauge(xi=0.3, offset=[-0.1, -0.05], noise=1e-4),
    ]
    wing = replace(WING, grid=cc.Grid.uniform(48, rule="magnus6"))
    measured = readings(sensors, BENT, wing)
    turned = measured[:9].reshape(3, 3, order="F") @ oracle.rotation(rng.normal(size=3) * 0.02)
    measured[:9] = turned.ravel(order="F")
    measured[9:] += rng.normal(size=5) * np.array([0.05] * 3 + [1e-4] * 2)
    fit = cc.fit_shape(wing, sensors, measured)

    def residual(q):
        def curvature(xi):
            return q.reshape(3, 2) @ [1.0, 2 * xi - 1]

        middle, tip = oracle.integrate(
            curvature,
            16.0,
            (0.5, 1.0),
            rotation=RIGHT_WING_ROOT.rotation.full(),
            position=np.zeros(3),
        )
        K = curvature(0.3)
        mounted = middle[0] @ sensors[0].mounting.full()
        return np.concatenate(
            [
                Rotation.from_matrix(turned.T @ mounted).as_rotvec() / 0.02,
                (tip[1] + tip[0] @ [0.1, 0.3, -0.2] - measured[9:12]) / 0.05,
                ([-0.05 * K[1] - 0.1 * K[2], -0.05 * K[1] + 0.1 * K[2]] - measured[12:]) / 1e-4,
            ]
        )

    found = least_squares(residual, np.zeros(6), x_scale=fit.deviations, xtol=1e-12, ftol=1e-12)
    # Standard deviations; the oracle's differences leave 1e-5 of them.
    assert np.max(np.abs(found.x - fit.q.full().ravel()) / fit.deviations) < 1e-4
    assert fit.chi_squared == pytest.approx(2 * found.cost, rel=1e-6)


def test_bounds_hold_and_the_optimum_within_them_is_that_of_scipy():
    sensors, narrow = SETS["gauges"], replace(WING, weight_bounds=0.03)
    fit = cc.fit_shape(narrow, sensors, readings(sensors, BENT))
    noise = cc.sensor_channels(sensors).noise

    def residual(q):
        return (readings(sensors, q) - readings(sensors, BENT)) / noise

    found = least_squares(residual, np.zeros(6), bounds=(-0.03, 0.03), xtol=1e-14, ftol=1e-14)
    # Gauges are linear in the weights; the interior method of the oracle stops short of the bound.
    assert_allclose(fit.q.full().ravel(), found.x, atol=1e-5)
    assert fit.active_bounds == ("out_of_plane: Legendre 0 at its lower bound -0.03 rad/m",)
    assert "held by a bound: out_of_plane: Legendre 0" in fit.message
    assert fit.degrees_of_freedom == 9 - 5


def test_the_prior_adds_its_information_and_pulls_to_its_mean():
    sensors = SETS["gauges"]
    mean, deviations = np.full(6, 0.01), np.array([1e-4, 1e-5, 1e-4, 1e-3, 1e-5, 1e-4])
    fit = cc.fit_shape(WING, sensors, readings(sensors, BENT), prior=(mean, deviations))
    expected = fit.information + np.diag(deviations**-2.0)
    posterior = np.linalg.solve(expected, fit.information @ BENT + mean / deviations**2)
    # Gauges are linear: one step, to 1e-6 standard deviations.
    assert np.max(np.abs(fit.q.full().ravel() - posterior) / fit.deviations) < 2e-6
    assert_allclose(fit.covariance, np.linalg.inv(expected), rtol=1e-9, atol=1e-20)
    assert fit.degrees_of_freedom == 9


@pytest.mark.parametrize("covariance", [0.02, [0.02] * 6, np.eye(6) * 4e-4])
def test_a_prior_is_a_deviation_deviations_or_a_covariance(covariance):
    fit = cc.fit_shape(
        WING, ATTITUDES[:1], readings(ATTITUDES[:1], BENT), prior=(np.zeros(6), covariance)
    )
    # One attitude at a quarter of the span sees three combinations; the prior holds the others.
    assert fit.rank == 3 and len(fit.unseen) == 3
    assert "the prior holds them" in fit.message
    assert 0.005 < np.max(fit.deviations) <= 0.02 * (1 + 1e-9)


# Covariance and χ² -----------------------------------------------------------------------------


@pytest.fixture(scope="module")
def loaded():
    return cc.solve_equilibrium(WING, [cc.Gravity([0, 0, 9.81])]).q.full().ravel()


@pytest.fixture(scope="module")
def fits(loaded):
    """400 fits of four attitude sensors of 0.5 degrees to the wing under 1 g."""
    rng, exact = np.random.default_rng(11), attitudes(loaded)
    return [cc.fit_shape(WING, ATTITUDES, noisy(exact, rng)) for _ in range(400)]


def test_errors_of_many_fits_are_as_predicted(fits, loaded):
    predicted = np.linalg.inv(cc.information_matrix(WING, ATTITUDES, loaded))
    errors = np.array([fit.q.full().ravel() for fit in fits]) - loaded
    ratio = np.std(errors, axis=0) / np.sqrt(np.diag(predicted))
    # 400 fits estimate a deviation to 3.5 %.
    assert np.all(np.abs(ratio - 1) < 0.1)
    assert np.all(np.abs(np.mean(errors, axis=0)) < 4 * np.std(errors, axis=0) / np.sqrt(400))
    # All six together: Σ errorᵀ P⁻¹ error is χ² of 2400.
    total = np.einsum("ij,jk,ik->", errors, np.linalg.inv(predicted), errors)
    assert 1e-3 < chi2.cdf(total, 2400) < 1 - 1e-3


def test_the_tip_scatters_as_predicted(fits, loaded):
    covariance = np.linalg.inv(cc.information_matrix(WING, ATTITUDES, loaded))
    predicted = cc.shape_deviations(WING, loaded, covariance, [1.0]).position[:, 0]
    weights = ca.horzcat(*(fit.q for fit in fits))
    tips, _ = cc.tip_function(WING).map(len(fits))(weights)
    assert_allclose(tips[:, 0].full(), fits[0].shape.tip.position.full(), atol=1e-12)
    assert np.all(np.abs(np.std(tips.full(), axis=1) / predicted - 1) < 0.1)


def test_p_values_are_uniform(fits):
    p_values = [fit.p_value for fit in fits]
    assert fits[0].degrees_of_freedom == 6
    # A wrong count of degrees of freedom gives 1e-20.
    assert kstest(p_values, "uniform").pvalue > 0.01


def test_wrong_noise_is_told():
    sensors = [replace(s, noise=HALF_DEGREE / 5) for s in ATTITUDES]
    fit = cc.fit_shape(WING, sensors, noisy(attitudes(BENT), np.random.default_rng(2)))
    assert fit.p_value < 1e-6
    assert "larger than the stated noise explains" in fit.message


def test_the_information_is_the_gauss_newton_matrix_of_ad():
    q, measured = ca.SX.sym("q", 6), ca.SX.sym("measured", 36)
    residual = cc.measurement_residual(ATTITUDES, WING, measured, q)
    slope = ca.Function("slope", [q, measured], [ca.jacobian(residual, q)])
    exact = readings(ATTITUDES, BENT)
    J = slope(BENT, exact).full() / HALF_DEGREE
    expected = J.T @ J
    found = cc.information_matrix(WING, ATTITUDES, BENT)
    assert_allclose(found, expected, rtol=0, atol=1e-11 * np.max(expected))
    fit = cc.fit_shape(WING, ATTITUDES, exact)
    assert_allclose(fit.information, expected, rtol=0, atol=1e-6 * np.max(expected))
    # Off the optimum the residual bends the derivative of the logarithm, in both alike.
    off = noisy(attitudes(BENT), np.random.default_rng(4), 0.3)
    fit = cc.fit_shape(WING, ATTITUDES, off)
    J = slope(fit.q, off).full() / HALF_DEGREE
    assert_allclose(fit.information, J.T @ J, rtol=0, atol=1e-11 * np.max(expected))


def test_residuals_have_names_units_and_two_scales():
    sensors = [*ATTITUDES, *SETS["gauges"]]
    measured = readings(sensors, BENT)
    measured[-1] += 3e-6
    fit = cc.fit_shape(WING, sensors, measured)
    noise = cc.sensor_channels(sensors).noise
    assert len(fit.residuals) == len(fit.channels.residual_labels) == 12 + 9
    assert_allclose(fit.normalized_residuals, fit.residuals / noise, rtol=1e-12)
    assert fit.chi_squared == pytest.approx(np.sum(fit.normalized_residuals**2))
    assert "strain_4" in str(fit) and "rad/m" in str(fit) and "attitude_1_x" in str(fit)


# Missing samples and outliers ------------------------------------------------------------------


def test_missing_samples_are_as_sensors_that_are_not_there():
    """Sensors 1 to 4 are attitudes of nine values each, the others gauges of one."""
    rng, sensors = np.random.default_rng(5), [*ATTITUDES, *SETS["gauges"]]
    measured = readings(sensors, BENT)
    measured[:36] = noisy(attitudes(BENT), rng)
    gappy = measured.copy()
    gappy[[4, 38]] = np.nan  # one entry of the first attitude, and a gauge
    fit = cc.fit_shape(WING, sensors, gappy)
    kept = [s for i, s in enumerate(sensors) if i not in (0, 6)]
    other = cc.fit_shape(WING, kept, np.delete(measured, [*range(9), 38]))
    assert_allclose(fit.q.full(), other.q.full(), atol=1e-12)
    assert_allclose(fit.covariance, other.covariance, rtol=1e-9, atol=1e-18)
    assert fit.degrees_of_freedom == other.degrees_of_freedom == 21 - 4 - 6
    assert np.flatnonzero(np.isnan(fit.residuals)).tolist() == [0, 1, 2, 14]
    assert np.isnan(fit.loss_weights["attitude_1"]) and "missing" in str(fit)


def test_readings_by_name_may_leave_sensors_out():
    exact = attitudes(BENT)
    fit = cc.fit_shape(WING, ATTITUDES, {f"attitude_{i + 1}": exact[i] for i in (3, 1)})
    assert_allclose(fit.q.full().ravel(), BENT, atol=1e-8)
    assert np.isnan(fit.loss_weights["attitude_1"])


def test_a_robust_loss_survives_outliers_that_squares_do_not(loaded):
    """Two of ten attitudes are random; 20 samples."""
    rng = np.random.default_rng(6)
    sensors = [cc.AttitudeSensor(xi=xi, noise=HALF_DEGREE) for xi in np.linspace(0.1, 1, 10)]
    exact = attitudes(loaded, sensors=sensors)
    predicted = np.linalg.inv(cc.information_matrix(WING, sensors, loaded))
    errors = {"squared": [], "huber": [], "cauchy": []}
    for _ in range(20):
        wrong = exact.copy()
        out = rng.choice(10, 2, replace=False)
        wrong[out] = exact[out] @ Rotation.from_rotvec(rng.normal(size=(2, 3))).as_matrix()
        measured = noisy(wrong, rng)
        for loss, found in errors.items():
            fit = cc.fit_shape(WING, sensors, measured, loss=loss)
            error = fit.q.full().ravel() - loaded
            found.append(np.sqrt(error @ np.linalg.solve(predicted, error) / 6))
        light = {name for name, weight in fit.loss_weights.items() if weight < 0.1}
        assert {f"attitude_{i + 1}" for i in out} <= light
        assert all(name in fit.message for name in light)
    rms = {loss: np.sqrt(np.mean(np.square(found))) for loss, found in errors.items()}
    # In predicted standard deviations of clean data; eight clean sensors alone would leave 1.12,
    # and those that the loss cannot replace, at the root and the tip, more.
    assert rms["cauchy"] < 1.5 and max(errors["cauchy"]) < 3
    assert np.median(errors["huber"]) < 2.5
    assert rms["squared"] > 10 and np.median(errors["squared"]) > 10


@pytest.mark.parametrize("loss", ["huber", "cauchy"])
def test_robust_losses_cost_little_where_there_are_no_outliers(loss, loaded):
    rng, exact = np.random.default_rng(7), attitudes(loaded)
    covariance = np.linalg.inv(cc.information_matrix(WING, ATTITUDES, loaded))
    errors = []
    for _ in range(100):
        fit = cc.fit_shape(WING, ATTITUDES, noisy(exact, rng), loss=loss)
        errors.append(fit.q.full().ravel() - loaded)
    efficiency = np.einsum("ij,jk,ik->", errors, np.linalg.inv(covariance), errors) / 600
    # 5 % by design; 600 squares scatter by 6 %.
    assert efficiency < 1.25


def test_a_very_wide_loss_is_least_squares():
    measured = noisy(attitudes(BENT), np.random.default_rng(8))
    squared = cc.fit_shape(WING, ATTITUDES, measured)
    for loss in ("huber", "cauchy"):
        wide = cc.fit_shape(WING, ATTITUDES, measured, loss=loss, loss_scale=1e6)
        # Both iterations end 1e-6 standard deviations from their optimum.
        assert np.max(np.abs((wide.q - squared.q).full().ravel()) / squared.deviations) < 1e-5


def test_the_scale_of_a_loss_gives_95_percent_efficiency():
    """E[ψ']²/E[ψ²] of a normal variable, by quadrature."""
    from curvcasadi.estimation.fit.losses import SCALES, Loss

    u = np.linspace(-12, 12, 200001)
    for name in ("huber", "cauchy"):
        psi = u * Loss(name, SCALES[name]).weight(np.abs(u))
        density = norm.pdf(u) * (u[1] - u[0])
        efficiency = np.sum(np.gradient(psi, u) * density) ** 2 / np.sum(psi**2 * density)
        assert efficiency == pytest.approx(0.95, abs=1e-3)
        value = Loss(name, SCALES[name]).value(np.abs(u))
        # ρ(u)' = 2 ψ: the weights are those of the cost.
        assert_allclose(np.gradient(value, u)[1:-1], 2 * psi[1:-1], atol=2e-4)


# What sensors do not see -----------------------------------------------------------------------


def test_gauges_at_mid_chord_do_not_see_torsion():
    gauges = [cc.StrainGauge(xi=xi, offset=[0, 0.05], noise=1e-6) for xi in (0.1, 0.3, 0.5, 0.7)]
    fit = cc.fit_shape(WING, gauges, readings(gauges, BENT))
    assert fit.rank == 2 and fit.degrees_of_freedom == 2
    names = ["torsion: Legendre 0", "torsion: Legendre 1"]
    names += ["in_plane: Legendre 0", "in_plane: Legendre 1"]
    assert fit.unseen == tuple(f"{name}: no reading changes with it" for name in names)
    assert "2 of 6 combinations of weights are seen; not seen by these sensors" in fit.message
    assert str(fit).count("not seen") == 4 + 1
    hidden = [0, 1, 4, 5]
    assert_allclose(fit.q.full().ravel()[hidden], 0, atol=1e-15)  # nothing is invented
    assert np.all(np.isinf(fit.deviations[hidden]))
    off_diagonal = fit.covariance[hidden][:, [2, 3]]
    assert np.all(np.isnan(off_diagonal))
    assert_allclose(fit.q.full().ravel()[2:4], BENT[2:4], atol=1e-9)
    assert np.all(np.isfinite(fit.covariance[2:4, 2:4]))


def test_what_is_not_seen_stays_where_it_started():
    guess = np.array([0.01, 0.02, 0, 0, 0.001, 0.002])
    gauges = [cc.StrainGauge(xi=xi, offset=[0, 0.05], noise=1e-6) for xi in (0.1, 0.7)]
    fit = cc.fit_shape(WING, gauges, readings(gauges, BENT), q_guess=guess)
    assert_allclose(fit.q.full().ravel()[[0, 1, 4, 5]], guess[[0, 1, 4, 5]], atol=1e-15)


def test_a_combination_that_is_not_seen_is_named():
    """One gauge sees K_y at its station: with P_1(2 xi − 1) = −0.6 there, 0.6 P_0 + P_1."""
    gauge = [cc.StrainGauge(xi=0.2, offset=[0, 0.05], noise=1e-6)]
    wing = replace(WING, basis=cc.ChannelBasis(out_of_plane=cc.Legendre(2)), weight_bounds=None)
    fit = cc.fit_shape(wing, gauge, [1e-4])
    (words,) = fit.unseen
    assert words == (
        "0.6 (out_of_plane: Legendre 0) + (out_of_plane: Legendre 1): no reading changes with it"
    )
    q = fit.q.full().ravel()
    # The shortest weights that explain the reading.
    assert_allclose(q, 1e-4 / 0.05 / 1.36 * np.array([1, -0.6]), rtol=1e-6)


def test_what_drowns_in_noise_is_not_seen_either():
    """Markers on the reference curve see torsion by what it turns out of the plane of bending."""
    markers = [cc.Marker(xi=xi, noise=1e-3) for xi in (0.3, 0.6, 1.0)]
    hardly = np.array([0, 0, 1e-4, 0, 0, 0])
    fit = cc.fit_shape(WING, markers, readings(markers, hardly))
    assert fit.rank == 4
    # Section axes that turn about the curve leave it alone: K_x = a with K_z = a s K_y, which two
    # weights in plane can follow, but not for the other torsion.
    assert fit.unseen == (
        "torsion: Legendre 0: no reading changes with it",
        "torsion: Legendre 1: the noise leaves it a standard deviation of 1.7 rad/m, "
        "above pi/L = 0.2 rad/m",
    )
    assert fit.deviations[1] > 1 and np.all(fit.deviations[2:4] < 1e-3)
    assert_allclose(fit.q.full().ravel()[:2], 0, atol=1e-9)
    bent = cc.fit_shape(WING, markers, readings(markers, [0, 0, -0.05, 0, 0, 0]))
    assert bent.rank == 5 and bent.deviations[1] < 0.01


def test_sensors_that_see_nothing_leave_everything():
    root = [cc.AttitudeSensor(xi=0, noise=0.01)]
    fit = cc.fit_shape(WING, root, readings(root, BENT))
    assert fit.rank == 0 and len(fit.unseen) == 6
    assert np.all(fit.q.full() == 0) and np.all(np.isinf(fit.deviations))
    deviations = cc.shape_deviations(WING, fit.q, fit.covariance, [0, 0.5])
    assert np.all(deviations.position[:, 0] == 0) and np.all(
        np.isinf(deviations.position[[0, 2], 1])
    )


# Refusals and failures -------------------------------------------------------------------------


def test_a_shape_beyond_the_grid_is_a_failure_with_its_fit():
    coarse = replace(WING, grid=cc.Grid.uniform(2, max_angle=0.3))
    measured = readings(ATTITUDES, BENT)
    with pytest.raises(cc.ConvergenceError, match="use more elements") as caught:
        cc.fit_shape(coarse, ATTITUDES, measured)
    assert_allclose(caught.value.result.q.full().ravel(), BENT, atol=1e-4)
    assert not cc.fit_shape(coarse, ATTITUDES, measured, throw=False).converged


def test_a_prior_of_one_weight_is_a_covariance_where_it_is_a_matrix():
    wing = replace(WING, basis=cc.ChannelBasis(out_of_plane=cc.Legendre(1)), weight_bounds=None)
    gauge, prior = cc.StrainGauge(xi=0.5, offset=[0.0, 0.1], noise=1e-3), ([0.0], [[0.01]])
    fit = cc.fit_shape(wing, [gauge], [0.002], prior=prior)
    assert_allclose(fit.q, [[0.02 / 1.01]], rtol=1e-9)  # rounding
    placed = cc.place_sensors(wing, [gauge], 1, shapes=[[0.0]], prior=[[0.01]])
    assert_allclose(placed.prior_weight_deviations, 0.1, rtol=1e-12)


def test_steps_do_not_lead_to_where_there_is_no_residual():
    """log q = 0 from 3, where the Gauss–Newton step is −3 log 3 < −3."""

    def linearize(q):
        if q[0] <= 0:
            return UNDEFINED
        residual = np.log(q)
        return Linearization(float(residual @ residual) / 2, residual, 1 / q[:, None], np.eye(1))

    free = (np.full(1, -np.inf), np.full(1, np.inf))
    found = minimize(linearize, np.array([3.0]), free, length=0.1)
    assert found.converged
    assert_allclose(found.q, 1, atol=1e-6)
    assert not minimize(linearize, np.array([-3.0]), free, length=0.1).converged


def test_a_missing_bearing_of_what_is_not_in_view_is_as_no_camera():
    both = cc.fit_shape(WING, [*ATTITUDES, BLIND], [*EXACT, np.nan, np.nan])
    assert_allclose(both.q, cc.fit_shape(WING, ATTITUDES, EXACT).q, atol=1e-9)


#: Looks up from 10 m above the root.
BLIND = cc.Camera(xi=0.0, noise=1e-3, pose=cc.Pose(rotation=np.eye(3), position=[0, 0, 10]))
EXACT = readings(ATTITUDES, BENT)
MISTAKES = {
    "no beam": (lambda: cc.fit_shape(None, ATTITUDES, EXACT), "beam: expected a Beam"),
    "no sensors": (lambda: cc.fit_shape(WING, [], []), "sensors: expected one or more"),
    "too few readings": (
        lambda: cc.fit_shape(WING, ATTITUDES, EXACT[:9]),
        "measurements: expected 36 values, those of attitude_1, attitude_2, .*; found 9",
    ),
    "infinite": (
        lambda: cc.fit_shape(WING, ATTITUDES, EXACT + np.inf),
        r"measurements\[0\]: expected finite numbers or NaN, found inf",
    ),
    "text": (lambda: cc.fit_shape(WING, ATTITUDES, "wing"), "measurements: expected numbers"),
    "all missing": (
        lambda: cc.fit_shape(WING, ATTITUDES, EXACT * np.nan),
        "measurements: expected one or more, found only missing samples",
    ),
    "no rotation": (
        lambda: cc.fit_shape(WING, ATTITUDES, 1.1 * EXACT),
        "measurements of attitude_1: expected orthonormal columns",
    ),
    "unknown name": (
        lambda: cc.fit_shape(WING, ATTITUDES, {"attitude_9": np.eye(3)}),
        "measurements: expected names among attitude_1, .*; found attitude_9",
    ),
    "named with the wrong size": (
        lambda: cc.fit_shape(WING, ATTITUDES, {"attitude_2": np.zeros(3)}),
        r"measurements\['attitude_2'\]: expected 9 values, found 3",
    ),
    "unknown loss": (
        lambda: cc.fit_shape(WING, ATTITUDES, EXACT, loss="l1"),
        "loss: expected one of 'squared', 'huber', 'cauchy'; found 'l1'",
    ),
    "scale of squares": (
        lambda: cc.fit_shape(WING, ATTITUDES, EXACT, loss_scale=2.0),
        "loss_scale: expected None with loss 'squared'",
    ),
    "negative scale": (
        lambda: cc.fit_shape(WING, ATTITUDES, EXACT, loss="huber", loss_scale=-1),
        "loss_scale: expected a number above zero",
    ),
    "prior without mean": (
        lambda: cc.fit_shape(WING, ATTITUDES, EXACT, prior=0.1),
        r"prior: expected a pair \(mean, covariance\)",
    ),
    "prior of the wrong size": (
        lambda: cc.fit_shape(WING, ATTITUDES, EXACT, prior=(np.zeros(6), [0.1, 0.2])),
        "prior covariance: expected a standard deviation, 6 of them or a covariance",
    ),
    "prior without spread": (
        lambda: cc.fit_shape(WING, ATTITUDES, EXACT, prior=(np.zeros(6), 0.0)),
        "prior covariance: expected standard deviations above zero",
    ),
    "indefinite prior": (
        lambda: cc.fit_shape(WING, ATTITUDES, EXACT, prior=(np.zeros(6), -np.eye(6))),
        "prior covariance: expected a positive definite matrix",
    ),
    "no rates": (
        lambda: cc.fit_shape(WING, SETS["accelerometers"], np.zeros(15), root=GRAVITY),
        "q_dot: expected shape .* zeros are a wing at rest",
    ),
    "no gravity": (
        lambda: cc.fit_shape(WING, SETS["accelerometers"], np.zeros(15), q_dot=np.zeros(6)),
        "RootMotion.gravity",
    ),
    "symbolic beam": (
        lambda: cc.fit_shape(replace(WING, length=ca.SX.sym("L")), ATTITUDES, EXACT),
        "Beam.length: sensors of a numeric beam expected",
    ),
    "camera that looks away": (
        lambda: cc.fit_shape(WING, [ATTITUDES[0], BLIND], [*EXACT[:9], 0.1, 0.1]),
        r"camera_1: expected the point before the camera, .* found it at \(.*, -10\) m where the "
        "fit starts",
    ),
    "camera that looks away from a shape": (
        lambda: cc.information_matrix(WING, [BLIND], np.zeros((2, 6))),
        r"camera_1: expected the point before the camera, .* -10\) m with shapes\[0\]",
    ),
    "camera that looks away from a candidate": (
        lambda: cc.place_sensors(WING, [*ATTITUDES, BLIND], 1, shapes=np.zeros(6), prior=0.1),
        "camera_1: expected the point before the camera",
    ),
    "guess of the wrong size": (
        lambda: cc.fit_shape(WING, ATTITUDES, EXACT, q_guess=np.zeros(5)),
        "q_guess: expected shape",
    ),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_mistakes_are_named(name):
    call, message = MISTAKES[name]
    with pytest.raises(ValueError, match=message):
        call()
