"""Geometric feedback of attitudes: its closed form, its region of attraction, flaps."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp

import curvcasadi as cc
from curvcasadi.export import run_check
from curvcasadi.reference_wings import hale_wing
from tests.control.test_wing_model import flapped
from tests.support import oracle

TAU = 0.5


@pytest.fixture(scope="module")
def beam():
    return hale_wing(2, 3, 1, grid=cc.Grid.lobatto(8))


@pytest.fixture(scope="module")
def law(beam):
    return cc.attitude_law(beam, time_constant=TAU)


def angle(rotation, target):
    return np.arccos(np.clip((np.trace(target.T @ rotation) - 1) / 2, -1, 1))


def starts(beam, count):
    """Weights and targets of wings bent either way, errors from 10° to 120°, evenly."""
    rng, tip, found = np.random.default_rng(0), cc.tip_function(beam), []
    most = np.array([0.04, 0.04, 0.08, 0.06, 0.03, 0.01])
    edges = np.deg2rad(np.linspace(10, 120, count + 1))
    while len(found) < count:
        q, other = most * rng.uniform(-1, 1, (2, 6))
        target = tip(other)[1].full()
        error = angle(tip(q)[1].full(), target)
        if edges[len(found)] < error <= edges[len(found) + 1]:
            found.append((q, target, error))
    return found


def test_every_start_up_to_120_degrees_converges_on_the_lagging_wing(beam, law):
    tip, lag = cc.tip_function(beam), 0.1
    model = cc.kinematic_model(beam, time_constant=lag)
    step = cc.rk4_step(model, 0.05)
    converged = 0
    for q, target, _ in starts(beam, 20):
        for _ in range(100):
            q_dot, _, _ = law(q, target, np.zeros(3))
            command = np.clip(q + lag * q_dot.full()[:, 0], -0.15, 0.15)
            q = step(q, command, np.zeros(6)).full()[:, 0]
        converged += angle(tip(q)[1].full(), target) < np.deg2rad(0.1)
    assert converged == 20


def test_the_error_decays_by_its_closed_form(beam, law):
    # tan(θ/2) = tan(θ_0/2) exp(−t/τ), whatever shape the wing takes; an adaptive solver.
    tip = cc.tip_function(beam)
    for q, target, error in starts(beam, 3):

        def rate(t, q, target=target):
            return law(q, target, np.zeros(3))[0].full()[:, 0]

        end = solve_ivp(rate, (0, 1.0), q, rtol=1e-9, atol=1e-11).y[:, -1]
        expected = 2 * np.arctan(np.tan(error / 2) * np.exp(-1.0 / TAU))
        # The damping slows the least compliant direction by 1e-6 over its share of the compliance.
        assert_allclose(angle(tip(end)[1].full(), target), expected, rtol=1e-3)


def test_the_potential_never_grows_and_rests_at_180_degrees_alone(beam, law):
    tip, rng = cc.tip_function(beam), np.random.default_rng(1)
    for _ in range(20):
        q = 0.05 * rng.normal(size=6)
        target = oracle.rotation(rng.normal(size=3))
        q_dot, error, potential = (x.full()[:, 0] for x in law(q, target, np.zeros(3)))
        R = tip(q)[1].full()
        theta = angle(R, target)
        assert_allclose(np.linalg.norm(error), np.sin(theta), atol=1e-9)
        assert_allclose(potential, 1 - np.cos(theta), atol=1e-12)
        rate = error @ cc.body_jacobian(beam, q).full()[:3] @ q_dot
        assert rate < 0
    opposite = tip(np.zeros(6))[1].full() @ oracle.rotation([0, np.pi, 0])
    q_dot, _, potential = law(np.zeros(6), opposite, np.zeros(3))
    assert_allclose(potential, 2, atol=1e-12)
    assert_allclose(q_dot, 0, atol=1e-12)


def test_a_target_that_turns_is_followed(beam, law):
    tip, q = cc.tip_function(beam), np.zeros(6)
    start, omega = tip(q)[1].full(), np.array([0.05, 0.2, 0.0])
    dt = 0.02
    step = ca.Function("euler", [*(s := [ca.MX.sym("q", 6), ca.MX.sym("R", 3, 3)])],
                       [s[0] + dt * law(s[0], s[1], omega)[0]])  # fmt: skip
    for k in range(100):
        q = step(q, start @ oracle.rotation(omega * k * dt)).full()[:, 0]
    target = start @ oracle.rotation(omega * 100 * dt)
    assert angle(tip(q)[1].full(), target) < 0.002  # of 0.4 rad: steps of 0.004 rad


def test_a_wing_that_cannot_turn_about_every_axis_moves_as_it_can():
    beam = cc.Beam(
        length=4.0, basis=cc.ChannelBasis(out_of_plane=cc.Legendre(2)), grid=cc.Grid.uniform(4)
    )
    law = cc.attitude_law(beam, time_constant=TAU)
    for target in (oracle.rotation([0, -0.5, 0]), oracle.rotation([0.4, -0.5, 0.3])):

        def rate(t, q, target=target):
            return law(q, target, np.zeros(3))[0].full()[:, 0]

        end = solve_ivp(rate, (0, 8), [0, 0], rtol=1e-8, atol=1e-10).y[:, -1]
        _, error, _ = law(end, target, np.zeros(3))
        J = cc.body_jacobian(beam, end).full()[:3]
        assert_allclose(J.T @ error.full()[:, 0], 0, atol=1e-4)  # a minimum along what it can


@pytest.fixture(scope="module")
def flying():
    wing = flapped((2, 3, 0), 4)
    model = cc.wing_model(
        wing, density=0.0889, lag=cc.IndicialLag(poles=2, modes=2), outputs=("tip_rotation",)
    )
    p = {"airspeed": 20.0, "pitch": 0.03}
    flutter = cc.flutter(model, [18.0, 20.0], p={"pitch": 0.03})
    return wing.beam, model, flutter.equilibria[-1], p


def test_flaps_turn_the_tip_by_ten_degrees(flying):
    beam, model, x, p = flying
    feedback = cc.attitude_feedback(
        model, beam, x, None, p, time_constant=1.0, bounds=(-0.3, 0.3), authority=0.1
    )
    assert np.all(feedback.eigenvalues.real < 0)
    tip = cc.tip_function(beam)
    start = tip(x[:5])[1].full()
    # Bending by 10°, and what goes with it: the direction in which the flaps turn the tip.
    direction = np.linalg.svd(feedback.gain)[0][:, 0]
    target = start @ oracle.rotation(np.deg2rad(10) * direction)
    symbols = [ca.MX.sym(k, n) for k, n in (("x", model.x.size), ("z", 2), ("R", 9))]
    u, z, _, potential = feedback.step(
        tip(symbols[0][:5])[1], ca.reshape(symbols[2], 3, 3), symbols[1], 0.02
    )
    moved, _ = cc.step_function(model, 0.02, substeps=2)(symbols[0], u, [20.0, 0.03])
    step = ca.Function("loop", symbols, [moved, z, potential])
    z, history = np.zeros(2), []
    for _ in range(200):
        x, z, potential = (v.full()[:, 0] for v in step(x, z, target.ravel(order="F")))
        history.append(np.rad2deg(np.arccos(1 - potential[0])))
    assert history[0] > 9
    assert max(history[-25:]) < 1.0  # degrees; what is left is twist, which flaps hardly reach


def test_gains_follow_the_time_constant(flying):
    beam, model, x, p = flying
    slow, fast = (
        cc.attitude_feedback(model, beam, x, None, p, time_constant=tau) for tau in (50.0, 25.0)
    )
    assert_allclose(fast.integral, 2 * slow.integral, rtol=1e-12)
    assert_allclose(fast.proportional, 2 * slow.proportional, rtol=1e-12)
    # Where the loop is slow against the wing, its slowest root is 1/τ.
    root = slow.eigenvalues[np.argmin(np.abs(slow.eigenvalues))]
    assert_allclose(root, -1 / 50.0, rtol=0.02)
    with pytest.raises(ValueError, match="time_constant: expected one with which the loop is"):
        cc.attitude_feedback(model, beam, x, None, p, time_constant=1e-3)


def test_the_law_becomes_c(law, tmp_path):
    arguments = (np.full(6, 0.02), np.eye(3), [0.1, 0, 0])
    cc.export_c([law], tmp_path, reference_inputs={"attitude_law": [arguments]})
    assert run_check(tmp_path)["attitude_law"] < 1e-10


def test_a_station_that_no_weight_turns_is_refused(beam):
    with pytest.raises(ValueError, match="xi: expected a station that the weights turn, found 0"):
        cc.attitude_law(beam, time_constant=0.5, xi=0.0)


@pytest.mark.parametrize("field", ["time_constant", "damping"])
def test_numbers_are_above_zero(beam, field):
    with pytest.raises(ValueError, match=field):
        cc.attitude_law(beam, **{"time_constant": 0.5, field: 0.0})
