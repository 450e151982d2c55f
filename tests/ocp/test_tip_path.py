"""One step of a model predictive control of the tip."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose

import curvcasadi as cc
from curvcasadi.lie import so3
from curvcasadi.reference_wings import hale_wing

TAU, DT, STAGES = 0.5, 0.1, 4
RATE, CURVATURE = 0.02, 0.06
WING = hale_wing(grid=cc.Grid.lobatto(8))
MODEL = cc.kinematic_model(WING, time_constant=TAU)
STEP = cc.rk4_step(MODEL, DT)
GOAL = np.array([0.01, 0, 0, -0.03, 0.01, 0, 0, 0.005, 0])
BOUNDS = {"rate_bound": RATE, "curvature_bound": CURVATURE}


@pytest.fixture(scope="module")
def converged():
    return cc.tip_path_step_function(MODEL, dt=DT, horizon=STAGES, **BOUNDS)


@pytest.fixture(scope="module")
def real_time():
    return cc.tip_path_step_function(MODEL, dt=DT, horizon=STAGES, iterations=1, **BOUNDS)


def _path(weights, times):
    """Positions (3, N) and rotations (3, 3 N) of the tip at weights that grow to `weights`."""
    tips = [cc.pose_at(WING, np.clip(t, 0, 1) * np.asarray(weights), 1.0) for t in times]
    return {
        "positions": ca.horzcat(*(tip.position for tip in tips)),
        "rotations": ca.horzcat(*(tip.rotation for tip in tips)),
    }


def _held(weights, stages=STAGES):
    return _path(weights, np.ones(stages))


def _call(solver, path, x=None, p=0, u_previous=None, guess=0):
    x = np.zeros(9) if x is None else x
    u = x if u_previous is None else u_previous
    return solver(x=x, p=p, u_previous=u, guess=guess, **path)


def _independent(path, x0, u0, p=None, weights=(1.0, 1.0, 1e-2), rate=RATE, curvature=CURVATURE):
    """The same problem written stage by stage, solved by IPOPT: (inputs, states)."""
    opti = ca.Opti()
    U, X = opti.variable(9, STAGES), opti.variable(9, STAGES)
    tip = cc.tip_function(WING)
    p = ca.DM.zeros(9) if p is None else ca.DM(p)
    z = DT / TAU
    decay = 1 - z + z**2 / 2 - z**3 / 6 + z**4 / 24  # Runge–Kutta 4 of the lag
    cost, x, last = 0, ca.DM(x0), ca.DM(u0)
    for k in range(STAGES):
        u, end = U[:, k], X[:, k]
        opti.subject_to(end == decay * x + (1 - decay) * (u + p))
        opti.subject_to(opti.bounded(-rate, (u + p - x) / TAU, rate))
        opti.subject_to(opti.bounded(-0.15, u, 0.15))
        opti.subject_to(opti.bounded(-0.15, end, 0.15))
        for xi in (0, 0.25, 0.5, 0.75, 1):
            opti.subject_to(opti.bounded(-curvature, ca.DM(WING.basis(xi)) @ end, curvature))
        position, R = tip(end)
        R_d = path["rotations"][:, 3 * k : 3 * k + 3]
        cost += weights[0] * ca.sumsqr(position - path["positions"][:, k]) / 2
        cost += weights[1] * ca.sumsqr(so3.log_error(R, R_d)) / 2
        cost += weights[2] * ca.sumsqr(u - last) / 2
        x, last = end, u
    opti.minimize(cost)
    options = {"print_level": 0, "sb": "yes", "tol": 1e-11, "bound_relax_factor": 0.0}
    opti.solver("ipopt", {"print_time": False}, options)
    solution = opti.solve()
    return solution.value(U), solution.value(X)


def _inputs(result, stages=STAGES):
    """Inputs u_1 … of the plan, which is shifted by a stage."""
    plan = result["plan"].full().ravel().reshape(stages, 18)
    return np.column_stack([result["u"].full().ravel(), plan[:-1, :9].T])


@pytest.mark.parametrize("seed", range(4))
def test_the_plan_is_the_optimum_of_an_independent_solver(converged, seed):
    random = np.random.default_rng(seed)
    x, u, p = random.uniform(-0.005, 0.005, (3, 9))
    path = _held(random.uniform(-0.03, 0.03, 9))
    result = _call(converged, path, x=x, u_previous=u, p=p)
    U, X = _independent(path, x, u, p)
    # IPOPT stops at 1e-11 of a scaled gradient; inputs are seen by moves of weight 1e-2 alone.
    assert_allclose(_inputs(result), U, atol=1e-6)
    assert_allclose(result["states"].full()[:, 1:], X, atol=1e-6)


@pytest.mark.parametrize("iterations", [None, 1])
@pytest.mark.parametrize("bounds", [{}, BOUNDS], ids=["unbounded", "bounded"])
def test_the_tip_of_a_wing_of_a_single_weight_follows_its_path(iterations, bounds):
    beam = cc.Beam(
        length=16.0, basis=cc.ChannelBasis(out_of_plane=cc.Legendre(1)), grid=cc.Grid.uniform(8)
    )
    model = cc.kinematic_model(beam, time_constant=TAU)
    f = cc.tip_path_step_function(model, dt=DT, horizon=2, iterations=iterations, **bounds)
    goal = cc.pose_at(beam, [-0.011], 1.0)
    path = [ca.repmat(part, 1, 2) for part in (goal.position, goal.rotation)]
    result = f(x=-0.01, u_previous=-0.01, positions=path[0], rotations=path[1], guess=-0.01)
    assert float(result["violation"]) <= 1
    assert float(result["stationarity"]) <= 1
    assert float(result["states"][-1]) < -0.01  # towards the goal


def test_weights_of_which_none_follows_the_path_are_refused():
    beam = hale_wing(1, 1, 1, grid=cc.Grid.lobatto(4))
    model = cc.kinematic_model(beam, time_constant=0.5)
    weights = {"position_weight": 0.0, "attitude_weight": 0.0}
    with pytest.raises(ValueError, match="position_weight, attitude_weight: expected one above"):
        cc.tip_path_step_function(model, dt=0.1, horizon=2, **weights)


def test_a_state_that_is_lost_shows_in_the_certificate():
    beam = hale_wing(1, 1, 1, grid=cc.Grid.lobatto(4))
    model = cc.kinematic_model(beam, time_constant=0.5)
    step = cc.tip_path_step_function(model, dt=0.1, horizon=2, attitude_weight=0.0)
    for lost in (np.nan, np.inf, 1e200):
        found = step(x=[lost, 0, 0], p=0, u_previous=0, positions=0, guess=0)
        assert not float(found["violation"]) <= 1


def test_a_path_of_positions_alone_needs_no_rotations():
    beam = cc.Beam(
        length=16.0, basis=cc.ChannelBasis(out_of_plane=cc.Legendre(2)), grid=cc.Grid.uniform(8)
    )
    model = cc.kinematic_model(beam, time_constant=TAU)
    f = cc.tip_path_step_function(model, dt=DT, horizon=2, attitude_weight=0.0)
    assert "rotations" not in f.name_in() and "positions" in f.name_in()
    goal = cc.pose_at(beam, [-0.004, 0.002], 1.0).position
    result = f(x=0, u_previous=0, positions=ca.repmat(goal, 1, 2), guess=0)
    assert float(result["violation"]) <= 1 and float(result["stationarity"]) <= 1
    straight, reached = (
        float(ca.norm_2(cc.pose_at(beam, q, 1.0).position - goal))
        for q in (np.zeros(2), result["states"][:, -1])
    )
    assert reached < straight


def test_elements_that_turn_too_far_are_told():
    """Unbounded weights leave what the polynomials of an element are made for."""
    beam = cc.Beam(
        length=16, basis=cc.ChannelBasis(out_of_plane=cc.Legendre(3)), grid=cc.Grid.lobatto(16)
    )
    model = cc.kinematic_model(beam, time_constant=0.25)
    weights = {"position_weight": 1 / 256, "attitude_weight": 0.1, "move_weight": 2.56e-3}
    f = cc.tip_path_step_function(model, dt=0.05, horizon=4, iterations=1, damping=0.0, **weights)
    pose = cc.pose_at(beam, [-0.05, 0.05, 0], 1.0)
    path = {
        "positions": ca.repmat(pose.position, 1, 4),
        "rotations": ca.repmat(pose.rotation, 1, 4),
    }
    x = np.array([0.05, 0, 0])
    result = f(x=x, u_previous=x, guess=np.tile(x, 8), **path)
    q = ca.MX.sym("q", 3)
    angles = ca.Function("angles", [q], [cc.squared_element_angles(beam, q)]).map(5)
    assert np.max(angles(result["states"]).full()) > 1
    assert float(result["violation"]) > 1
    near = cc.pose_at(beam, 1.01 * x, 1.0)
    path = {
        "positions": ca.repmat(near.position, 1, 4),
        "rotations": ca.repmat(near.rotation, 1, 4),
    }
    result = f(x=x, u_previous=x, guess=np.tile(x, 8), **path)
    assert float(result["violation"]) <= 1


@pytest.mark.parametrize("iterations", [None, 1])
def test_frozen_weights_stay_where_they_are(iterations):
    lower, upper = np.full((2, 9), [[-0.1], [0.1]])
    lower[0] = upper[0] = 0
    model = cc.kinematic_model(replace(WING, weight_bounds=(lower, upper)), time_constant=TAU)
    solver = cc.tip_path_step_function(model, dt=DT, horizon=2, iterations=iterations)
    result = _call(solver, _held(GOAL, 2))
    assert float(result["violation"]) <= 1
    assert float(result["stationarity"]) <= 1
    assert_allclose(result["states"][0, :], 0, atol=1e-9)  # the primal tolerance of the program
    assert np.abs(result["u"].full()[1:]).max() > 1e-3


def test_weights_shape_the_optimum_as_in_the_formula():
    weights = (0.1, 3.0, 10.0)
    solver = cc.tip_path_step_function(
        MODEL,
        dt=DT,
        horizon=STAGES,
        position_weight=weights[0],
        attitude_weight=weights[1],
        move_weight=weights[2],
    )
    path, x = _path(0.3 * GOAL, [0.25, 0.5, 0.75, 1]), np.full(9, 0.002)
    u = np.full(9, 0.004)
    result = _call(solver, path, x=x, u_previous=u)
    U, _ = _independent(path, x, u, weights=weights, rate=np.inf, curvature=np.inf)
    assert_allclose(_inputs(result), U, atol=1e-6)  # IPOPT's 1e-11 of a scaled gradient


def test_the_first_state_is_given_and_the_others_obey_the_model(converged):
    x = np.full(9, 0.001)
    result = _call(converged, _held(GOAL), x=x, p=0.002)
    states, inputs = result["states"].full(), _inputs(result)
    assert_allclose(states[:, 0], x, rtol=0)
    for k in range(STAGES):
        end = STEP(states[:, k], inputs[:, k], np.full(9, 0.002)).full().ravel()
        assert_allclose(states[:, k + 1], end, atol=1e-9)  # the solver's primal tolerance


@pytest.mark.parametrize("seed", range(3))
def test_rates_curvatures_and_weights_keep_their_bounds(seed):
    random = np.random.default_rng(seed)
    wing = replace(WING, weight_bounds=0.012)
    model = cc.kinematic_model(wing, time_constant=TAU)
    solver = cc.tip_path_step_function(
        model, dt=DT, horizon=STAGES, rate_bound=0.05, curvature_bound=[0.01, 0.015, np.inf]
    )
    path = _held(random.uniform(-0.05, 0.05, 9))
    x = random.uniform(-0.002, 0.002, 9)
    result = _call(solver, path, x=x)
    states, inputs = result["states"].full(), _inputs(result)
    rates = (inputs - states[:, :-1]) / TAU
    K = np.stack([wing.basis(xi) @ states[:, 1:] for xi in (0, 0.25, 0.5, 0.75, 1)])
    slack = 1e-8  # the solver's primal tolerance of 1e-9 and rounding
    assert np.abs(rates).max() <= 0.05 + slack
    assert np.all(np.abs(K).max(axis=(0, 2))[:2] <= np.array([0.01, 0.015]) + slack)
    assert max(np.abs(states[:, 1:]).max(), np.abs(inputs).max()) <= 0.012 + slack
    assert float(result["violation"]) <= 1e-5  # of 1e-6: rounding
    # Each bound matters here.
    assert np.abs(inputs).max() > 0.012 - 1e-6


def test_rates_can_be_bounded_weight_by_weight():
    bounds = np.full(9, np.inf)
    bounds[3] = 0.004
    solver = cc.tip_path_step_function(MODEL, dt=DT, horizon=2, rate_bound=bounds)
    result = _call(solver, _held(GOAL, 2))
    rates = np.abs(result["u"].full().ravel() / TAU)
    assert_allclose(rates[3], 0.004, rtol=1e-6)  # active
    assert rates.max() > 0.01


@pytest.mark.parametrize("iterations", [None, 1])
def test_receding_horizon_brings_the_tip_onto_its_path(iterations):
    solver = cc.tip_path_step_function(
        MODEL, dt=DT, horizon=STAGES, iterations=iterations, rate_bound=0.1
    )
    x, u, plan = np.zeros(9), np.zeros(9), 0
    errors = []
    for k in range(25):
        path = _path(GOAL, (k + 1 + np.arange(STAGES)) / 12)
        result = _call(solver, path, x=x, u_previous=u, guess=plan)
        u, plan = result["u"].full().ravel(), result["plan"]
        x = STEP(x, u, 0).full().ravel()
        tip, goal = cc.pose_at(WING, x, 1.0), _path(GOAL, [(k + 1) / 12])
        errors.append(
            [
                float(ca.norm_2(tip.position - goal["positions"])),
                float(ca.norm_2(so3.log_error(tip.rotation, goal["rotations"]))),
            ]
        )
    # The path moves 5 m and 0.5 rad in 1.2 s and then holds; an integrator without disturbance
    # ends on it.
    assert np.max(errors) < 0.5
    assert np.all(np.array(errors[-1]) < 1e-3)


def test_real_time_iterations_follow_the_converged_ones(converged, real_time):
    x, u, plan = np.zeros(9), np.zeros(9), 0
    for k in range(8):
        path = _path(0.2 * GOAL, (k + 1 + np.arange(STAGES)) / 12)
        exact = _call(converged, path, x=x, u_previous=u, guess=plan)
        quick = _call(real_time, path, x=x, u_previous=u, guess=plan)
        # One quadratic program from the last plan: its error is of second order in what the path
        # moved since, some 1e-2 of an input of up to 1e-2 rad/m.
        assert_allclose(quick["u"], exact["u"], atol=1e-3)
        u, plan = exact["u"].full().ravel(), exact["plan"]
        x = STEP(x, u, 0).full().ravel()


@pytest.mark.parametrize("qp_solver", ["own", "qpoases"])
def test_a_real_time_iteration_keeps_linear_bounds_from_any_start(qp_solver):
    # Rates, curvatures and the lag are linear in the plan: one quadratic program meets them.
    exact = cc.tip_path_step_function(
        MODEL, dt=DT, horizon=STAGES, iterations=1, qp_solver=qp_solver, **BOUNDS
    )
    random = np.random.default_rng(0)
    for _ in range(20):
        x = random.uniform(-0.005, 0.005, 9)
        result = _call(exact, _held(random.uniform(-0.03, 0.03, 9)), x=x)
        assert float(result["violation"]) <= 1e-2  # 1e-8: rounding
        assert float(result["stationarity"]) <= 1


def test_miss_tells_bounds_that_cannot_be_kept(converged):
    # A disturbance that no rate-bounded command can hold, as commands are bounded by 0.15.
    result = _call(converged, _held(GOAL), p=1.0)
    assert float(result["violation"]) > 0.1


def test_the_attitude_error_is_on_the_group():
    # At 2 rad the gradient of the chordal error is sin θ, of the logarithm θ.
    solver = cc.tip_path_step_function(
        MODEL, dt=DT, horizon=STAGES, position_weight=0.0, move_weight=1.0
    )
    path = _held(np.zeros(9))
    turned = WING.root.rotation @ so3.exp(ca.DM([0.4, 1.9, -0.5]))
    path["rotations"] = ca.repmat(turned, 1, STAGES)
    result = _call(solver, path)
    U, _ = _independent(
        path, np.zeros(9), np.zeros(9), weights=(0, 1, 1.0), rate=np.inf, curvature=np.inf
    )
    assert_allclose(_inputs(result), U, atol=1e-6)  # IPOPT's 1e-11 of a scaled gradient


def test_the_plan_is_shifted_by_one_stage(converged):
    result = _call(converged, _held(GOAL))
    plan = result["plan"].full().ravel().reshape(STAGES, 18)
    states = result["states"].full()
    assert_allclose(plan[:-1, 9:].T, states[:, 2:], rtol=0)  # copies
    assert_allclose(plan[-1], plan[-2], rtol=0)


def test_the_solver_uses_the_structured_jacobian(converged, real_time):
    for solver in (converged, real_time):
        names = {f.name() for f in solver.find_functions()}
        assert "tip_pose" in names
        assert not [n for n in names if n.startswith(("fwd", "adj")) and "element" in n]


def test_inputs_and_outputs_have_their_shapes(converged):
    shapes = {name: converged.size_in(name) for name in converged.name_in()}
    assert shapes == {
        "x": (9, 1),
        "p": (9, 1),
        "u_previous": (9, 1),
        "positions": (3, STAGES),
        "rotations": (3, 3 * STAGES),
        "guess": (18 * STAGES, 1),
    }
    outputs = ["u", "plan", "states", "violation", "stationarity", "distances"]
    assert converged.name_out() == outputs


def test_a_plan_says_by_how_much_it_misses_the_path(converged):
    path = _path(GOAL, [0.2, 0.6, 1, 1])
    path["positions"] = path["positions"] + ca.DM([0.0, 0.3, 0.0])
    found = _call(converged, path)
    for k in range(STAGES):
        tip = cc.pose_at(WING, found["states"][:, k + 1], 1.0).position
        miss = ca.norm_2(tip - path["positions"][:, k])
        assert_allclose(found["distances"][k], miss, rtol=1e-12)  # rounding
        assert float(miss) > 0.1


@pytest.mark.parametrize(
    "arguments, message",
    [
        ({"horizon": 0}, r"horizon: expected a whole number of at least 1, found 0"),
        ({"horizon": 2.0}, r"horizon: expected a whole number of at least 1, found 2\.0"),
        ({"dt": -0.1}, r"dt: expected a number above zero, found -0\.1"),
        ({"dt": np.nan}, r"dt: expected finite numbers, found"),
        ({"position_weight": -1}, r"position_weight: expected a number not below zero, found -1"),
        ({"attitude_weight": np.inf}, r"attitude_weight: expected finite numbers, found"),
        ({"move_weight": 0}, r"move_weight: expected a number above zero, found 0"),
        ({"rate_bound": -1}, r"rate_bound: expected one or 9 numbers above zero, found -1"),
        ({"rate_bound": [1, 2]}, r"rate_bound: expected one or 9 numbers above zero, found"),
        ({"curvature_bound": np.nan}, r"curvature_bound: expected one or 3 numbers above zero"),
        ({"curvature_bound": ca.MX.sym("b")}, r"curvature_bound: expected one or 3 numbers"),
        ({"iterations": 0}, r"iterations: expected a whole number of at least 1, found 0"),
    ],
    ids=str,
)
def test_wrong_arguments_are_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        cc.tip_path_step_function(MODEL, **{"dt": DT, "horizon": 2, **arguments})


@pytest.mark.parametrize(
    "name", ["position_weight", "attitude_weight", "move_weight"], ids=lambda name: name
)
def test_symbols_are_refused_as_weights(name):
    with pytest.raises(ValueError, match=rf"{name}: expected .*found"):
        cc.tip_path_step_function(MODEL, dt=DT, horizon=2, **{name: ca.MX.sym("w")})
