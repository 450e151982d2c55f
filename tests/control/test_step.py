"""One step of a control model: orders, symmetry, derivatives, and what it says of failure."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp

import curvcasadi as cc
from curvcasadi.lie import quaternion
from curvcasadi.reference_wings import hale_wing
from tests.support import models

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


PENDULUM_START = [1.0, 0.02, -0.5, 0.1, 0.3]
BODY_START = np.concatenate(
    [
        quaternion.exp(ca.DM([0.4, -0.3, 0.2])).full().ravel(),
        [1, 2, 3, 0.05, 0.8, -1.1, 0.6, 1.0, -0.5, 0.3, 0.2],
    ]
)


def _exact(model, x0, end, u=(), p=()):
    slope = lambda _, x: model.xdot(x, u, p).full().ravel()  # noqa: E731
    return solve_ivp(slope, (0, end), x0, "DOP853", rtol=1e-12, atol=1e-12).y[:, -1]


def _run(model, x0, end, steps, u=(), p=(), **options):
    step = cc.step_function(model, end / steps, **options)
    x, worst = ca.DM(x0), 0.0
    for _ in range(steps):
        x, residual = step(x, u, p)
        worst = max(worst, float(residual))
    assert worst < 1e-10
    return x.full().ravel()


@pytest.mark.parametrize("newton", [False, True])
def test_implicit_midpoint_has_order_two(newton):
    model = models.pendulum(stiffness=50.0, damping=0.4)
    exact = _exact(model, PENDULUM_START, 0.8, 0.4, 9.81)
    errors = [
        np.abs(
            _run(
                model, PENDULUM_START, 0.8, n, 0.4, 9.81, method="implicit_midpoint", newton=newton
            )
            - exact
        ).max()
        for n in (40, 80, 160)
    ]
    # The next order of a symmetric rule is four: rates within a tenth at 20 steps a period.
    assert_allclose(np.diff(np.log2(errors)), -2, atol=0.1)
    assert errors[-1] < 1e-3


@pytest.mark.parametrize("method, order", [("rk4", 4), ("implicit_midpoint", 2)])
def test_a_free_body_moves_with_the_order_of_the_method(method, order):
    model = models.rigid_body()
    exact = _exact(model, BODY_START, 0.6)
    errors = []
    for n in (30, 60, 120):
        end = _run(model, BODY_START, 0.6, n, method=method)
        errors.append(np.abs(end - exact).max())
        # Attitudes stay on the group, to rounding of a few operations a step.
        assert_allclose(np.linalg.norm(end[:4]), 1, rtol=1e-13)
    assert_allclose(np.diff(np.log2(errors)), -order, atol=0.2)


def test_implicit_midpoint_is_symmetric_in_time():
    """Forward, velocities flipped, and back: only the iteration's tolerance remains."""
    model = models.rigid_body()
    end = _run(model, BODY_START, 1.0, 50, method="implicit_midpoint")
    end[8:] *= -1
    back = _run(model, end, 1.0, 50, method="implicit_midpoint")
    back[8:] *= -1
    assert_allclose(back, BODY_START, atol=1e-9)


def test_implicit_midpoint_is_stable_where_runge_kutta_is_not():
    stiff = models.pendulum(stiffness=1e6, damping=10.0)  # 1 000 rad/s; RK4's limit is 2.8 ms
    x = _run(stiff, PENDULUM_START, 1.0, 100, 0.0, 9.81, method="implicit_midpoint")
    assert np.abs(x).max() < 25  # the stretch of 0.02 swings at up to 20/s, and is damped
    with pytest.warns(UserWarning, match=r"dt: steps of 0.01 s .* unstable, .* below 0.0028. s"):
        step = cc.step_function(stiff, 0.01)
    y = ca.DM(PENDULUM_START)
    for _ in range(100):
        y, _ = step(y, 0.0, 9.81)
    assert not np.abs(y.full()).max() < 1e6


@pytest.mark.parametrize("newton", [False, True])
def test_the_jacobian_of_an_implicit_step_is_that_of_the_implicit_function(newton):
    model = models.pendulum()
    step = cc.step_function(model, 0.05, method="implicit_midpoint", newton=newton)
    x, u, p = ca.MX.sym("x", 5), ca.MX.sym("u"), ca.MX.sym("p")
    slopes = [ca.jacobian(step(x, u, p)[0], by) for by in (x, u, p)]
    jacobian = ca.Function("J", [x, u, p], [ca.horzcat(*slopes)])
    names = {f.name() for f in jacobian.find_functions()}
    assert "jac_pendulum_step" in names
    assert not [name for name in names if name.startswith(("fwd", "adj")) and "loop" in name]
    at = np.array([*PENDULUM_START, 0.4, 9.81])
    h = 1e-6
    differences = [
        (step(*_split(at + h * e))[0] - step(*_split(at - h * e))[0]).full() / (2 * h)
        for e in np.eye(7)
    ]
    # Central differences: h² and the tolerance of the iteration over h.
    assert_allclose(jacobian(*_split(at)).full(), np.hstack(differences), atol=2e-8)


def _split(at):
    return at[:5], at[5], at[6]


def test_a_step_of_a_free_body_has_the_right_jacobian():
    model = models.rigid_body()
    step = cc.step_function(model, 0.02, method="implicit_midpoint")
    x = ca.MX.sym("x", 15)
    jacobian = ca.Function("J", [x], [ca.jacobian(step(x, [], [])[0], x)])(BODY_START).full()
    h = 1e-6
    differences = [
        (step(BODY_START + h * e, [], [])[0] - step(BODY_START - h * e, [], [])[0]).full() / (2 * h)
        for e in np.eye(15)
    ]
    assert_allclose(jacobian, np.hstack(differences), atol=2e-8)


def test_a_step_that_does_not_converge_says_so():
    model = models.pendulum()
    step = cc.step_function(model, 0.05, method="implicit_midpoint", iterations=2)
    assert float(step(PENDULUM_START, 0.4, 9.81)[1]) > 1e-10
    violent = [1.0, 0.02, 1e200, 1e200, 0.0]
    step = cc.step_function(model, 0.5, method="implicit_midpoint")
    assert not float(step(violent, 0.4, 9.81)[1]) <= 1e-10  # NaN or large, never success
    twice = cc.step_function(model, 1.0, method="implicit_midpoint", substeps=2)
    assert not float(twice(violent, 0.4, 9.81)[1]) <= 1e-10


def test_a_step_from_exact_rest_converges():
    model = models.pendulum()
    end, residual = cc.step_function(model, 0.05, method="implicit_midpoint")(np.zeros(5), 0, 0)
    assert float(residual) == 0
    assert_allclose(end, 0, atol=0)


def test_an_implicit_step_needs_inertia(lag):
    with pytest.raises(ValueError, match=r"method: 'implicit_midpoint' needs .* inertia, found"):
        cc.step_function(lag, 0.1, method="implicit_midpoint")


def test_unknown_methods_are_refused(lag):
    with pytest.raises(ValueError, match=r"method: expected one of 'rk4', .* found 'euler'"):
        cc.step_function(lag, 0.1, method="euler")
    with pytest.raises(ValueError, match=r"method: expected .* found 'variational', a method of"):
        cc.step_function(lag, 0.1, method="variational")


@pytest.mark.parametrize("make", [models.pendulum, models.rigid_body], ids=lambda f: f.__name__)
def test_the_residual_vanishes_along_motions(make):
    model = make()
    x = np.random.default_rng(5).normal(size=model.x.size)
    if model.name == "rigid_body":
        x[:4] /= np.linalg.norm(x[:4])
    u, p = np.full(model.u.size, 0.4), np.full(model.p.size, 9.81)
    residual = model.residual(x, model.xdot(x, u, p), u, p)
    assert model.residual.name_in() == ["x", "x_dot", "u", "p"]
    assert_allclose(residual, np.zeros((model.x.size, 1)), atol=1e-12)  # rounding of some 100
    moved = model.residual(x, model.xdot(x, u, p) + 1, u, p)
    assert np.abs(moved.full()).min() > 0.1


def test_midpoint_steps_become_c(tmp_path):
    step = cc.step_function(models.pendulum(), 0.05, method="implicit_midpoint")
    native = cc.compile_function(step)
    for at in (PENDULUM_START, np.zeros(5)):
        for ours, expected in zip(native(at, 0.4, 9.81), step(at, 0.4, 9.81), strict=True):
            assert_allclose(ours, expected, rtol=1e-12, atol=1e-14)
