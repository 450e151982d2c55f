"""Simulations: what integrators give in a row, and what is refused."""

from __future__ import annotations

import warnings

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp

import curvcasadi as cc
from curvcasadi.control.signals import Course, within_bounds
from curvcasadi.control.stability import stable_step
from curvcasadi.lie import quaternion
from curvcasadi.reference_wings import hale_wing
from tests.support import models

START = {"configuration": [1.0, 0.02], "rates": [-0.5, 0.1], "lag": [0.3]}
TIMES = np.linspace(0, 1, 21)


@pytest.fixture(scope="module")
def pendulum():
    return models.pendulum(stiffness=100.0, damping=0.2)


@pytest.fixture(scope="module")
def exact(pendulum):
    slope = lambda _, x: pendulum.xdot(x, 0.4, 9.81).full().ravel()  # noqa: E731
    start = [1.0, 0.02, -0.5, 0.1, 0.3]
    return solve_ivp(slope, (0, 1), start, "DOP853", t_eval=TIMES, rtol=1e-12, atol=1e-12).y


@pytest.mark.parametrize(
    "method, dt, error",
    # RK4: (10 rad/s · 5 ms)⁴/120 a radian; midpoint: (10 · 1 ms)²/24 a radian times ten; cvodes:
    # its tolerance of 1e-8 over some tens of steps.
    [("rk4", 0.005, 1e-6), ("implicit_midpoint", 0.001, 1e-4), ("cvodes", None, 1e-6)],
)
def test_all_methods_find_the_motion(pendulum, exact, method, dt, error):
    options = {"u": [0.4], "p": {"gravity": 9.81}}
    result = cc.simulate(pendulum, START, TIMES, method=method, dt=dt, **options)
    assert result.success and result.x.shape == (5, 21)
    assert_allclose(result.x, exact, atol=error)
    assert_allclose(result.part("lag"), exact[4:], atol=error)
    assert_allclose(result.part("moment"), 0.4)
    assert "reached" in str(result) and "pendulum" in str(result)


def test_steps_in_a_row_are_those_of_the_step_function(pendulum):
    step = cc.step_function(pendulum, 0.05, method="implicit_midpoint", substeps=4)
    result = cc.simulate(
        pendulum, START, TIMES, u=0.4, p=9.81, method="implicit_midpoint", dt=0.0125
    )
    x = ca.DM(result.x[:, 0])
    for _ in range(20):
        x = step(x, 0.4, 9.81)[0]
    # Another guess: the tolerance of the iteration, eighty steps.
    assert_allclose(result.x[:, -1:], x, atol=1e-8)
    assert 2 <= result.iterations <= 6


def test_signals_are_held_from_time_to_time_or_taken_at_the_middle_of_steps(pendulum):
    columns = np.sin(TIMES)[None, :]
    held = cc.simulate(pendulum, START, TIMES, u=columns, p=[9.81])
    by_name = cc.simulate(pendulum, START, TIMES, u={"moment": columns}, p={"gravity": [9.81]})
    assert_allclose(held.x, by_name.x, rtol=0)
    assert_allclose(held.u, columns, rtol=0)
    step = cc.rk4_step(pendulum, 0.05)
    assert_allclose(
        held.x[:, [3]], step(held.x[:, 2], columns[0, 2], 9.81), rtol=1e-12
    )  # native code contracts nothing, but sums in another order
    smooth = cc.simulate(pendulum, START, TIMES, u=lambda t: [np.sin(t)], p=9.81)
    middle = cc.simulate(pendulum, START, TIMES, u=np.sin(TIMES + 0.025)[None, :], p=9.81)
    assert_allclose(smooth.x, middle.x, rtol=1e-12)


def test_momentum_and_energy_of_a_free_body():
    body = models.rigid_body()
    attitude = quaternion.exp(ca.DM([0.4, -0.3, 0.2])).full().ravel()
    start = {"quaternion_wxyz": attitude, "s": 0.05, "twist": [0.8, -1.1, 0.6, 1, -0.5, 0.3]}
    result = cc.simulate(body, start, np.linspace(0, 2, 3), method="rk4", dt=0.002)
    first, last = (models.momentum(result.x[:, k]) for k in (0, -1))
    # RK4 at 10 rad/s and 2 ms: (0.02)⁴/120 a radian over twenty of them.
    assert_allclose(last[0], first[0], atol=1e-7)
    assert abs(last[1] - first[1]) < 1e-7
    assert_allclose(np.linalg.norm(result.part("quaternion_wxyz"), axis=0), 1, rtol=1e-14)
    assert_allclose(result.part("position")[:, 0], 0, atol=0)


def test_a_simulation_that_diverges_keeps_what_it_had():
    stiff = models.pendulum(stiffness=1e6)
    remedy = r"take 'implicit_midpoint', or steps below 0.00.* s, as"
    with (
        pytest.raises(
            cc.ConvergenceError, match=rf"steps of 0.05 s .* not finite: {remedy}"
        ) as error,
        pytest.warns(UserWarning, match=rf"simulate: steps of 0.05 s .* unstable, .*{remedy}"),
    ):
        cc.simulate(stiff, START, np.linspace(0, 10, 201), u=[0.0], p=[9.81])
    result = error.value.result
    assert not result.success and 1 < len(result.t) < 201
    assert result.x.shape[1] == result.y.shape[1] == len(result.t)
    assert np.all(np.isfinite(result.x))
    assert_allclose(result.t, np.linspace(0, 10, 201)[: len(result.t)])


def test_an_implicit_step_that_is_too_long_is_named():
    fast = {**START, "rates": [300.0, 5.0]}
    with pytest.raises(cc.ConvergenceError, match=r"did not converge .*newton=True"):
        cc.simulate(models.pendulum(), fast, [0, 0.5, 1.0], p=9.81, method="implicit_midpoint")


@pytest.mark.parametrize(
    "change, message",
    [
        ({"x0": [1, 2]}, r"x0: expected 5 numbers, found"),
        ({"x0": {"angle": 1}}, r"x0: expected parts among \['configuration', .*found 'angle'"),
        ({"x0": [np.nan] * 5}, r"x0: expected finite numbers"),
        ({"times": [0]}, r"times: expected at least two times, found 1"),
        ({"times": [0, 1, 1]}, r"times: expected increasing times, s, found 1 after 1"),
        ({"times": [0, np.nan]}, r"times: expected finite numbers"),
        ({"dt": 0}, r"dt: expected a number above zero"),
        ({"dt": -1}, r"dt: expected a number above zero"),
        ({"method": "euler"}, r"method: expected one of 'rk4'"),
        ({"u": [1, 2, 3]}, r"u: expected 1 numbers or columns \(1, 21\)"),
        ({"u": {"torque": 1}}, r"u: expected parts among \['moment'\], found 'torque'"),
        ({"u": lambda t: [1, 2]}, r"u\(0.025\): expected 1 numbers"),
        ({"p": {"gravity": "down"}}, r"p\['gravity'\]: expected numbers"),
        ({"tolerance": 0.0, "method": "implicit_midpoint"}, r"tolerance: expected a number above"),
    ],
    ids=lambda value: "-".join(value) if isinstance(value, dict) else "",
)
def test_wrong_arguments_are_refused_by_name(pendulum, change, message):
    arguments = {"x0": START, "times": TIMES, "u": [0.4], "p": [9.81], **change}
    x0, times = arguments.pop("x0"), arguments.pop("times")
    with pytest.raises(ValueError, match=message):
        cc.simulate(pendulum, x0, times, **arguments)


def test_a_quaternion_off_the_group_is_refused():
    with pytest.raises(ValueError, match=r"x0: expected the unit quaternion .* length 2"):
        cc.simulate(models.rigid_body(), {"quaternion_wxyz": [2, 0, 0, 0]}, [0, 1])


def test_unknown_parts_of_a_result_are_named(pendulum):
    result = cc.simulate(pendulum, START, [0, 0.1], p=9.81)
    with pytest.raises(ValueError, match=r"name: expected one of \['configuration', .*found 'q'"):
        result.part("q")


def test_inputs_beyond_their_bounds_are_refused_and_degrees_are_named():
    layout = cc.Layout((cc.Part("flap", 1, "rad"), cc.Part("pull", 1, "N", 0.0, 10.0)))
    for value, words in (
        (
            [5.0, 0.0],
            r"u: flap\[0\], rad: expected within -1.5708 to 1.5708, found 5 .* 0.08727 rad",
        ),
        ([0.1, -1.0], r"u: pull\[0\], N: expected within 0 to 10, found -1 at t = 2 s$"),
    ):
        signal = within_bounds("u", layout, Course(lambda k, t, x=value: np.array(x), False))
        with pytest.raises(ValueError, match=words):
            signal(0, 2.0)
    at_bound = within_bounds(
        "u", layout, Course(lambda k, t: np.array([0.1, 10.0 * (1 + 1e-9)]), False)
    )
    assert at_bound(0, 0.0)[1] > 10  # what a solver returns


def test_a_model_without_inertia_has_no_implicit_steps():
    lag = cc.kinematic_model(hale_wing(1, 1, 1), time_constant=1e-3)
    command, remedy = [0.0, 0.1, 0.0], r"take steps below 0.00279 s, as .* 1000 rad/s$"
    with (
        pytest.raises(cc.ConvergenceError, match=r"the state is not finite: take shorter steps$"),
        pytest.warns(UserWarning, match=remedy),
    ):
        cc.simulate(lag, None, np.linspace(0, 200, 201), u=command)


def test_steps_that_let_a_mode_grow_warn_before_it_overflows():
    # Two steps of a motion of 0.1 rad: nothing is infinite, and all is wrong.
    fast, start = models.pendulum(stiffness=1e6), {**START, "rates": [0.0, 0.0]}
    limit, frequency = stable_step(fast, np.zeros(5), np.zeros(1), np.array([9.81]))
    assert_allclose(limit * frequency, np.sqrt(8), rtol=1e-9)  # of an undamped mode
    given = {"u": [0.0], "p": [9.81]}
    with pytest.warns(UserWarning, match=r"simulate: steps of .* are unstable, .*'implicit_midpo"):
        cc.simulate(fast, start, [0, 2.1 * limit], dt=1.05 * limit, **given)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        cc.simulate(fast, start, [0, 2 * limit], dt=0.99 * limit, **given)


@pytest.fixture(scope="module")
def whip():
    """A rod with elements that may turn by a tenth of a radian."""
    section = cc.Section(GJ=1.0, EI_y=1.0, EI_z=1.0, mass_per_length=1.0)
    basis = cc.ChannelBasis(out_of_plane=cc.Legendre(2))
    grid = cc.Grid.lobatto(4, max_angle=0.1)
    return cc.beam_model(cc.Beam(length=1.0, basis=basis, grid=grid, section=section))


def test_a_start_that_turns_elements_too_far_is_refused(whip):
    with pytest.raises(ValueError, match=r"x0: expected every element to turn at most .* found"):
        cc.simulate(whip, {"q": [30.0, 0.0]}, [0, 0.1])


def test_a_motion_that_turns_elements_too_far_warns(whip):
    with pytest.warns(UserWarning, match=r"from t = 0.0.* s on elements turn by up to"):
        result = cc.simulate(whip, {"q_dot": [20.0, 0.0]}, np.linspace(0, 0.05, 6), dt=1e-3)
    assert result.success


def test_simulations_check_their_inputs():
    model = cc.kinematic_model(hale_wing(1, 1, 1), time_constant=1.0)
    with pytest.raises(ValueError, match=r"u: q_command\[0\], rad/m: expected within"):
        cc.simulate(model, None, [0.0, 0.1], u=[1.0, 0, 0])
