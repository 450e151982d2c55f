"""Actuators follow commands with a lag, at a limited rate, between limits."""

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import curvcasadi as cc

FLAPS = cc.Actuators(lag=0.02, rate=[1.0, 5.0], lower=-0.25, upper=0.3)


@pytest.mark.parametrize("dt", [0.001, 0.05, 0.6])
def test_they_follow_their_differential_equation(dt):
    start, command = np.array([0.1, -0.2]), np.array([0.29, 0.4])

    def rate(t, u):
        return np.clip((np.clip(command, -0.25, 0.3) - u) / 0.02, [-1, -5], [1, 5])

    exact = solve_ivp(rate, (0, dt), start, rtol=1e-10, atol=1e-12, max_step=1e-3).y[:, -1]
    # The kink of the rate costs the integrator its order, not its tolerance.
    np.testing.assert_allclose(FLAPS.follow(start, command, dt), exact, atol=1e-8)


def test_two_steps_are_one():
    start, command = np.zeros((3, 2)), np.array([[0.3, 0.3], [-0.2, 0.01], [0.0, -1.0]])
    once = FLAPS.follow(start, command, 0.3)
    twice = FLAPS.follow(FLAPS.follow(start, command, 0.17), command, 0.13)
    np.testing.assert_allclose(twice, once, atol=1e-15)
    np.testing.assert_array_equal(FLAPS.follow(start, command, 0.0), start)


def test_without_limits_they_are_a_lag():
    found = cc.Actuators(lag=0.1).follow([0.0], [2.0], 0.1)
    assert found == pytest.approx(2 * (1 - np.exp(-1)))


@pytest.mark.parametrize(
    ("mistake", "words"),
    [
        (lambda: cc.Actuators(lag=0.0), "Actuators.lag: expected a number above zero"),
        (lambda: cc.Actuators(lag=ca.SX.sym("lag")), "Actuators.lag: expected numbers"),
        (lambda: cc.Actuators(lag=0.1, rate=ca.SX.sym("r")), "Actuators.rate: expected numbers"),
        (lambda: cc.Actuators(lag=0.1, upper={}), "Actuators.upper: expected numbers"),
        (lambda: cc.Actuators(lag=0.1, rate=0), "Actuators.rate: expected rates above zero"),
        (lambda: cc.Actuators(lag=0.1, rate=np.nan), "Actuators.rate: expected finite numbers"),
        (lambda: cc.Actuators(lag=0.1, lower=1, upper=0), "Actuators.lower: expected at most"),
        (lambda: FLAPS.follow([0, 0], [np.nan, 0], 0.1), "command: expected finite numbers"),
        (lambda: FLAPS.follow([0, 0, 0], [0, 0], 0.1), "u, command: expected shapes that fit"),
        (lambda: FLAPS.follow([0, 0], [0, 0], -0.1), "dt: expected a time of at least zero"),
    ],
)
def test_mistakes_are_named(mistake, words):
    with pytest.raises(ValueError, match=words):
        mistake()
