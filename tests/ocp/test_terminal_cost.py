"""The regulator's cost behind the horizon: any horizon gives its input."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose

import curvcasadi as cc
from curvcasadi.export import export_c, run_check
from curvcasadi.lie import quaternion
from curvcasadi.symbolic.layout import Part
from tests.support.control_models import BODY, MASS, model

DT = 0.1
#: Far from the bounds of the force, which the regulator does not know.
START = np.array([0.05, -0.1])
REST = cc.linearize(MASS, [0.0, 0.0])
WEIGHTS = {"outputs": {"load": [3.0, 0.5]}, "inputs": {"force": 0.1}, "moves": {"force": 0.2}}


def regulator(weights, horizon):
    """Input of the mass by the recursion over `horizon` stages: START, 0.1 applied before."""
    step = cc.rk4_step(MASS, DT)
    A = np.column_stack([step(e, 0, 0).full().ravel() for e in np.eye(2)])
    b = step([0, 0], 1, 0).full().ravel()
    C, d = np.diag([1.0, 2.0]), np.array([0.5, 0.0])
    # Of (x, input before) and the input: errors at the end of a stage.
    A = np.block([[A, np.zeros((2, 1))], [np.zeros((1, 3))]])
    B = np.append(b, 1.0)[:, None]
    of_loads = np.sqrt(np.array(weights["outputs"]["load"]))[:, None]
    of_force, of_move = (np.sqrt(weights[key]["force"]) for key in ("inputs", "moves"))
    E = np.vstack([of_loads * np.column_stack([C @ A[:2], C @ b + d]), np.zeros((2, 4))])
    E[2, 3], E[3, 2:] = of_force, [-of_move, of_move]
    P = np.zeros((3, 3))
    for _ in range(horizon):
        H = E.T @ E + np.hstack([A, B]).T @ P @ np.hstack([A, B])
        K = np.linalg.solve(H[3:, 3:], H[3:, :3])
        P = H[:3, :3] - H[:3, 3:] @ K
    return float((-K @ np.append(START, 0.1))[0])


@pytest.mark.parametrize("horizon", [1, 2, 7, 30])
@pytest.mark.parametrize("moves", [0.2, 0.0])
def test_a_horizon_of_any_length_begins_with_the_input_of_the_regulator(horizon, moves):
    weights = {**WEIGHTS, "moves": {"force": moves}}
    mpc = cc.Mpc(MASS, dt=DT, horizon=horizon, damping=0.0, terminal=REST, **weights)
    mpc.reset(0.1)
    step = mpc.step(START)
    assert step.success
    # 1 000 stages: the slowest motion of the closed loop has then decayed to rounding.
    assert_allclose(step.u[0], regulator(weights, 1000), rtol=1e-9)
    free = cc.Mpc(MASS, dt=DT, horizon=horizon, damping=0.0, **weights)
    free.reset(0.1)
    assert_allclose(free.step(START).u[0], regulator(weights, horizon), rtol=1e-9)


@pytest.mark.parametrize("blocks", [(1, 2, 3), (3, 3)])
def test_inputs_that_are_held_end_with_the_same_cost(blocks):
    """By least squares over the stages and the factor of the cost, put together by hand."""
    mpc = cc.Mpc(MASS, dt=DT, horizon=6, blocks=blocks, damping=0.0, terminal=REST, **WEIGHTS)
    mpc.reset(0.1)
    found = mpc.step(START)
    costs = [_cost(mpc, found.plan[0] + e) for e in _held(blocks)]
    assert _cost(mpc, found.plan[0]) < min(costs)


def _held(blocks):
    rows = np.repeat(np.eye(len(blocks)), blocks, axis=1)
    return 1e-4 * np.vstack([rows, -rows])


def _cost(mpc, plan):
    step, x, last, cost = cc.rk4_step(MASS, DT), START, 0.1, 0.0
    for u in plan:
        x = step(x, u, 0).full().ravel()
        load = MASS.output(x, u, 0).full().ravel()
        cost += WEIGHTS["outputs"]["load"] @ load**2 + 0.1 * u**2 + 0.2 * (u - last) ** 2
        last = u
    return cost + _behind(x, last)


def _behind(x, last):
    """Cost of the regulator from an end, by a plan of 150 stages."""
    mpc = cc.Mpc(MASS, dt=DT, horizon=150, damping=0.0, **WEIGHTS)
    mpc.reset(last)
    plan, step, cost = mpc.step(x).plan[0], cc.rk4_step(MASS, DT), 0.0
    for u in plan:
        x = step(x, u, 0).full().ravel()
        load = MASS.output(x, u, 0).full().ravel()
        cost += WEIGHTS["outputs"]["load"] @ load**2 + 0.1 * u**2 + 0.2 * (u - last) ** 2
        last = u
    return cost


def test_attitudes_end_on_the_group():
    goal = quaternion.exp(ca.DM([0.0, np.pi / 2, 0.4])).full().ravel()
    rest = cc.linearize(BODY, {"attitude": goal})
    fields = {"dt": 0.2, "states": {"attitude": 5.0, "rate": 1.0}, "inputs": {"torque": 0.1}}
    # So near to the goal that the model is linear to 1e-8 of the input.
    start = cc.retract(BODY, goal.tolist() + [0.0] * 3, 1e-5 * np.array([1, -2, 1, 3, 1, 2]))
    inputs = [
        cc.Mpc(BODY, horizon=n, damping=0.0, solver="sqp", tolerance=1e-9, terminal=rest, **fields)
        .step(start.full().ravel())
        .u
        for n in (1, 5)
    ]
    assert_allclose(inputs[0], inputs[1], rtol=1e-4)
    long = cc.Mpc(BODY, horizon=60, damping=0.0, **fields)
    expected = long.step(start.full().ravel(), reference={"attitude": goal}).u
    assert_allclose(inputs[0], expected, rtol=1e-4)


def test_the_equilibrium_is_the_reference_unless_others_are_given():
    rest = cc.linearize(MASS, [0.1, 0.0], 0.4)
    mpc = cc.Mpc(MASS, dt=DT, horizon=3, terminal=rest, **WEIGHTS)
    assert_allclose(mpc.u_trim, 0.4)
    step = mpc.step([0.1, 0.0])
    # It is at rest there already.
    assert_allclose(step.plan, 0.4, atol=1e-9)
    assert_allclose(step.states, [[0.1] * 4, [0.0] * 4], atol=1e-9)
    with pytest.raises(ValueError, match="u_trim: force"):
        mpc.copy(bounds={"force": (-0.1, 0.1)})


@pytest.mark.parametrize("solver", ["rti", "sqp"])
def test_a_terminal_cost_becomes_c(solver, tmp_path):
    mpc = cc.Mpc(
        MASS, dt=DT, horizon=4, blocks=(1, 3), terminal=REST, solver=solver,
        bounds={"force": (-0.3, 0.3), "place": (-0.2, 0.2)}, soft={"place": 10.0}, **WEIGHTS,
    )  # fmt: skip
    x = np.array([0.15, 0.3])
    for _ in range(3):
        step = mpc.step(x)
        assert step.success
        x = step.states[:, 1]
    export_c([mpc], tmp_path)
    run_check(tmp_path)


def test_terminal_costs_that_do_not_exist_are_named():
    fields = {"dt": DT, "horizon": 2}
    with pytest.raises(ValueError, match="terminal: expected a LinearModel, found 'lqr'"):
        cc.Mpc(MASS, terminal="lqr", **fields, **WEIGHTS)
    with pytest.raises(ValueError, match=r"terminal: expected a linearization of .*mass"):
        cc.Mpc(replace(MASS, name="other"), terminal=REST, **fields, **WEIGHTS)
    with pytest.raises(ValueError, match=r"at an equilibrium, found .*speed\[0\], m/s, changes by"):
        cc.Mpc(MASS, terminal=cc.linearize(MASS, [0.1, 0.0]), **fields, **WEIGHTS)
    parts = {"x": [Part("place", 1, "m"), Part("way", 1, "m")], "u": [Part("speed", 1, "m/s")]}
    cart = model("cart", parts, lambda x, u, p: ca.vertcat(u, 0))
    with pytest.raises(ValueError, match="terminal: expected weights for which a linear regulator"):
        # Nothing moves the second part.
        cc.Mpc(cart, states={"place": 1.0, "way": 1.0}, inputs={"speed": 1.0},
               terminal=cc.linearize(cart, [0.0, 0.0]), **fields)  # fmt: skip
