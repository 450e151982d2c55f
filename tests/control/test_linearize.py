"""Linear models: against differences of the motion, in error states, and as others take them."""

from __future__ import annotations

import sys

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose

import curvcasadi as cc
from curvcasadi.lie import quaternion
from tests.support import models


@pytest.fixture(scope="module")
def body():
    return models.rigid_body()


@pytest.fixture(scope="module")
def state(body):
    random = np.random.default_rng(2)
    x = random.normal(size=body.x.size)
    x[:4] /= np.linalg.norm(x[:4])
    return x


def test_the_linear_model_moves_as_the_error_of_the_motion(body, state):
    """δ(t) of two neighbouring motions against (I + A h) δ(0), an order in h and one in δ apart."""
    linear = cc.linearize(body, state)
    random = np.random.default_rng(3)
    delta = random.normal(size=14)
    step = cc.rk4_step(body, 1e-3)
    ends = [
        step(cc.retract(body, ca.DM(state), ca.DM(sign * 1e-5 * delta)), [], []) for sign in (1, -1)
    ]
    centre = step(state, [], [])
    errors = [cc.difference(body, centre, end).full().ravel() for end in ends]
    growth = ((errors[0] - errors[1]) / 2e-5 - delta) / 1e-3
    scale = np.abs(linear.A @ delta).max()
    # Terms of order h A² δ remain: A h is about 0.02 at 10 rad/s.
    assert_allclose(growth, linear.A @ delta, atol=0.03 * scale)
    half = cc.rk4_step(body, 5e-4)
    ends = [
        half(cc.retract(body, ca.DM(state), ca.DM(sign * 1e-5 * delta)), [], []) for sign in (1, -1)
    ]
    centre = half(state, [], [])
    errors = [cc.difference(body, centre, end).full().ravel() for end in ends]
    finer = ((errors[0] - errors[1]) / 2e-5 - delta) / 5e-4
    assert_allclose(2 * finer - growth, linear.A @ delta, atol=1e-4 * scale)  # Richardson


def test_inputs_and_parameters_have_their_columns():
    pendulum = models.pendulum()
    x = [1.0, 0.02, -0.5, 0.1, 0.3]
    linear = cc.linearize(pendulum, x, [0.4], {"gravity": 9.81})
    h = 1e-6
    for column, change in ((linear.B, (h, 0)), (linear.B_p, (0, h))):
        ends = [pendulum.xdot(x, 0.4 + s * change[0], 9.81 + s * change[1]) for s in (1, -1)]
        assert_allclose(column, (ends[0] - ends[1]).full() / (2 * h), atol=1e-8)
    assert linear.A.shape == (5, 5) and linear.C.shape == (0, 5) and linear.D_p.shape == (0, 1)


def test_eigenvalues_of_a_hanging_pendulum():
    stiffness, gravity = 400.0, 9.81
    pendulum = models.pendulum(stiffness)
    stretch = gravity / stiffness
    linear = cc.linearize(pendulum, [0, stretch, 0, 0, 0], p=[gravity])
    # The lag's force (1/3 Hz) couples weakly into the swing: look at the stretch alone.
    stretching = linear.eigenvalues[np.argmax(linear.eigenvalues.imag)]
    assert_allclose(stretching, 1j * np.sqrt(stiffness), atol=1e-9)
    assert "eigenvalues" in str(linear)


def test_the_attitude_is_an_error_of_three_angles(body):
    at_rest = {"quaternion_wxyz": quaternion.exp(ca.DM([0.3, 0.2, -0.1])).full().ravel()}
    linear = cc.linearize(body, at_rest)
    assert linear.A.shape == (14, 14)
    assert_allclose(linear.A[:3, 7:10], np.eye(3), atol=1e-14)
    assert body.x.errors.labels[:3] == tuple(f"quaternion_wxyz[{i}], rad" for i in range(3))


def test_python_control_takes_it():
    control = pytest.importorskip("control")
    linear = cc.linearize(models.pendulum(), np.zeros(5), p=[9.81])
    system = linear.to_control()
    assert isinstance(system, control.StateSpace)
    assert_allclose(np.sort(system.poles().real), np.sort(linear.eigenvalues.real), atol=1e-9)


def test_without_python_control_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "control", None)
    linear = cc.linearize(models.pendulum(), np.zeros(5), p=[9.81])
    with pytest.raises(ImportError, match=r"pip install \"curvcasadi\[control\]\""):
        linear.to_control()


def test_matlab_files_hold_matrices_and_labels(tmp_path):
    from scipy.io import loadmat

    linear = cc.linearize(models.pendulum(), np.zeros(5), p=[9.81])
    linear.save_mat(tmp_path / "pendulum.mat")
    read = loadmat(tmp_path / "pendulum.mat")
    assert_allclose(read["A"], linear.A, rtol=0)
    assert read["inputs"].ravel()[0].item() == "moment[0], 1"


def test_wrong_states_are_refused(body):
    with pytest.raises(ValueError, match="x: expected 15 numbers, found"):
        cc.linearize(body, np.zeros(14))
    with pytest.raises(ValueError, match="x: expected the unit quaternion"):
        cc.linearize(body, np.zeros(15))


def test_retraction_and_difference_are_inverse(body, state, evaluate):
    delta = np.random.default_rng(8).normal(size=14)
    moved = evaluate(lambda x, d: cc.retract(body, x, d), state, delta)
    assert_allclose(np.linalg.norm(moved[:4]), 1, rtol=1e-14)
    back = evaluate(lambda x, y: cc.difference(body, x, y), state, moved)
    assert_allclose(back.ravel(), delta, atol=1e-13)


def test_states_off_the_group_are_refused(body, state):
    off = np.array(state, dtype=float).ravel()
    off[:4] *= 2
    zero = np.zeros(len(off) - 1)
    with pytest.raises(ValueError, match=r"x: expected the unit quaternion .* length 2"):
        cc.retract(body, off, zero)
    with pytest.raises(ValueError, match=r"y: expected the unit quaternion .* length 2"):
        cc.difference(body, ca.DM(state), off)
