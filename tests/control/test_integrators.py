"""One Runge–Kutta step of a control model."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp

import curvcasadi as cc
from curvcasadi.reference_wings import hale_wing

RANDOM = np.random.default_rng(0)
COMMAND, DISTURBANCE, START = RANDOM.uniform(-0.1, 0.1, (3, 9))


@pytest.fixture(scope="module")
def lag():
    """First-order lag of 0.7 s of the weights of the published wing."""
    return cc.kinematic_model(hale_wing(), time_constant=0.7)


def _pendulum():
    """A nonlinear model with an input and a parameter: x'' = −p sin x − u x'."""
    x, u, p = ca.MX.sym("x", 2), ca.MX.sym("u"), ca.MX.sym("p")
    slope = ca.vertcat(x[1], -p * ca.sin(x[0]) - u * x[1])
    return cc.ControlModel(
        name="pendulum",
        x=cc.Layout((cc.Part("x", 2, "1"),)),
        u=cc.Layout((cc.Part("u", 1, "1"),)),
        p=cc.Layout((cc.Part("p", 1, "1"),)),
        y=cc.Layout(()),
        xdot=ca.Function("xdot", [x, u, p], [slope], ["x", "u", "p"], ["xdot"]),
        output=ca.Function("output", [x, u, p], [ca.MX(0, 1)], ["x", "u", "p"], ["y"]),
    )


def _error(model, dt, exact, **options):
    step = cc.rk4_step(model, dt, **options)
    return np.abs(step(START, COMMAND, DISTURBANCE).full().ravel() - exact).max()


def _exponential(t, tau=0.7):
    """q(t) = q_end + (q_0 − q_end) exp(−t/τ)."""
    end = COMMAND + DISTURBANCE
    return end + (START - end) * np.exp(-t / tau)


def test_the_lag_is_an_exponential(lag):
    # Order 4: (dt/τ)⁵/120 of 0.3 rad/m at dt/τ = 0.014.
    assert _error(lag, 0.01, _exponential(0.01)) < 0.3 * (0.01 / 0.7) ** 5 / 100


def test_the_step_has_order_four(lag):
    steps = np.array([0.4, 0.2, 0.1])
    local = [_error(lag, dt, _exponential(dt)) for dt in steps]
    substeps = [_error(lag, 0.8, _exponential(0.8), substeps=n) for n in (4, 8, 16)]
    # One step leaves dt⁵, a fixed time in n steps dt⁴; the next order moves these rates by 0.2.
    assert_allclose(np.diff(np.log2(local)), -5, atol=0.2)
    assert_allclose(np.diff(np.log2(substeps)), -4, atol=0.2)


def test_a_nonlinear_model_agrees_with_another_integrator():
    model, dt = _pendulum(), 0.3
    slope = lambda _, x: model.xdot(x, 0.4, 9.81).full().ravel()  # noqa: E731
    exact = solve_ivp(slope, (0, dt), [1.0, -0.5], "DOP853", rtol=1e-12, atol=1e-12).y[:, -1]
    errors = [
        np.abs(cc.rk4_step(model, dt, substeps=n)([1.0, -0.5], 0.4, 9.81).full().ravel() - exact)
        for n in (8, 16, 32)
    ]
    orders = np.diff(np.log2(np.max(errors, axis=1)))
    assert abs(orders[-1] + 4) < 0.1  # the rate tends to 4
    assert np.max(errors[-1]) < 1e-7  # (dt/32)⁴ times derivatives of some ten


def test_substeps_are_steps_in_a_row(lag):
    whole, half = cc.rk4_step(lag, 0.2, substeps=2), cc.rk4_step(lag, 0.1)
    twice = half(half(START, COMMAND, DISTURBANCE), COMMAND, DISTURBANCE)
    # The same operations in the same order.
    assert_allclose(whole(START, COMMAND, DISTURBANCE), twice, rtol=1e-15)


def test_the_step_names_its_inputs_and_output(lag):
    step = cc.rk4_step(lag, 0.1)
    assert (step.name_in(), step.name_out()) == (["x", "u", "p"], ["x_next"])


@pytest.mark.parametrize("dt", [0.0, -0.1, np.nan, np.inf, [0.1, 0.2], "0.1", ca.MX.sym("dt")])
def test_wrong_steps_are_refused(lag, dt):
    with pytest.raises(ValueError, match=r"dt: expected .*, found"):
        cc.rk4_step(lag, dt)


@pytest.mark.parametrize("substeps", [0, -1, 1.5, True])
def test_wrong_substeps_are_refused(lag, substeps):
    with pytest.raises(ValueError, match=r"substeps: expected a whole number of at least 1, found"):
        cc.rk4_step(lag, 0.1, substeps=substeps)
