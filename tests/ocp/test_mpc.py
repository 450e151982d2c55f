"""Predictive control of any model: against least squares, IPOPT on its own program, and C."""

from __future__ import annotations

import copy
import pickle
from dataclasses import replace
from itertools import product

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose

import curvcasadi as cc
from curvcasadi.export import export_c, run_check
from curvcasadi.lie import quaternion, so3
from curvcasadi.ocp.mpc import functions
from curvcasadi.reference_wings import hale_wing
from curvcasadi.symbolic.layout import Part
from tests.support.control_models import BODY, MASS, model

DT = 0.1
WING = hale_wing(2, 2, 1, grid=cc.Grid.lobatto(6))
KINEMATIC = cc.kinematic_model(WING, time_constant=0.5)
TIP = cc.pose_at(WING, np.array([0.02, -0.01, -0.05, 0.015, 0.01]), 1.0)
GOAL = {"position": TIP.position, "rotation": TIP.rotation}


def least_squares(x, before, gusts, goals, hold, weights, moves):
    """Inputs of the mass by the normal equations of its response, which is linear."""
    step = cc.rk4_step(MASS, DT)
    n = max(hold) + 1

    def residual(inputs):
        state, last, found = np.asarray(x, dtype=float), before, []
        for k, i in enumerate(hold):
            state = step(state, inputs[i], gusts[k]).full().ravel()
            load = MASS.output(state, inputs[i], gusts[k]).full().ravel()
            found += [*np.sqrt(weights) * (load - goals[:, k]), np.sqrt(moves) * (inputs[i] - last)]
            last = inputs[i]
        return np.array(found)

    rest = residual(np.zeros(n))
    response = np.column_stack([residual(one) - rest for one in np.eye(n)])
    return -np.linalg.lstsq(response, rest, rcond=None)[0]


@pytest.mark.parametrize("solver", ["rti", "sqp", "ipopt"])
@pytest.mark.parametrize("blocks", [None, (1, 2, 3)])
def test_a_linear_model_is_driven_by_the_least_squares_of_its_previewed_response(solver, blocks):
    hold = np.repeat(np.arange(3), (1, 2, 3)) if blocks else np.arange(6)
    mpc = cc.Mpc(
        MASS,
        dt=DT,
        horizon=6,
        blocks=blocks,
        outputs={"load": [3.0, 0.5]},
        moves={"force": 0.2},
        solver=solver,
        damping=0.0,
    )
    gusts = np.array([0.1, 0.4, -0.3, 0.2, 0.0, 0.1])
    goals = np.vstack([np.linspace(0, 0.2, 6), np.zeros(6)])
    mpc.reset(0.3)
    step = mpc.step([0.1, -0.2], reference={"load": goals}, preview={"gust": gusts})
    expected = least_squares([0.1, -0.2], 0.3, gusts, goals, hold, np.array([3.0, 0.5]), 0.2)
    assert step.success
    # The response is linear: one program solves it, to rounding or to IPOPT's tolerance.
    assert_allclose(step.plan[0], expected[hold], atol=1e-7 if solver == "ipopt" else 1e-9)
    assert_allclose(step.u, expected[:1], atol=1e-7 if solver == "ipopt" else 1e-9)


def by_opti(x, before, stages):
    """Inputs of the tip problem by multiple shooting in Opti: states are unknowns there."""
    opti, n = ca.Opti(), WING.basis.n
    states, inputs = opti.variable(n, stages + 1), opti.variable(n, stages)
    step, cost = cc.rk4_step(KINEMATIC, DT), 0
    opti.subject_to(states[:, 0] == x)
    last = before
    for k in range(stages):
        u, end = inputs[:, k], states[:, k + 1]
        opti.subject_to(end == step(states[:, k], u, np.zeros(n)))
        y = KINEMATIC.y.split(KINEMATIC.output(end, u, np.zeros(n)))
        turn = so3.log_error(ca.reshape(y["rotation"], 3, 3), ca.DM(TIP.rotation))
        cost += (ca.sumsqr(y["position"] - TIP.position) + ca.sumsqr(turn)) / 2
        cost += 1e-2 * ca.sumsqr(u - last) / 2
        opti.subject_to(opti.bounded(-0.06, y["curvature"], 0.06))
        opti.subject_to(opti.bounded(-0.05, KINEMATIC.xdot(states[:, k], u, np.zeros(n)), 0.05))
        opti.subject_to(opti.bounded(-0.1, u, 0.1))
        opti.subject_to(opti.bounded(-0.6 * DT, u - last, 0.6 * DT))
        last = u
    opti.minimize(cost)
    quiet = {"print_level": 0, "sb": "yes", "tol": 1e-11, "bound_relax_factor": 0.0}
    opti.solver("ipopt", {"print_time": False, "ipopt": quiet})
    return opti.solve().value(inputs)


def tip_control(**options):
    fields = {
        "outputs": {"position": 1.0, "rotation": 1.0},
        "moves": {"q_command": 1e-2},
        "bounds": {"q_command": (-0.1, 0.1), "curvature": (-0.06, 0.06)},
        "rate_bounds": {"q": 0.05, "q_command": 0.6},
        "dt": DT,
        "horizon": 4,
        "solver": "sqp",
    }
    return cc.Mpc(KINEMATIC, **{**fields, **options})


@pytest.mark.parametrize("options", [{}, {"qp_solver": "hpipm"}, {"solver": "ipopt"}], ids=str)
def test_converged_inputs_are_those_of_multiple_shooting_by_hand(options):
    mpc = tip_control(**options)
    x = np.array([0.01, 0.0, -0.02, 0.0, 0.0])
    mpc.reset(x)
    step = mpc.step(x, reference=GOAL)
    expected = by_opti(x, x, 4)
    assert step.success, step.message
    # 1e-6 of the range of the inputs, 0.2 rad/m: their objective is soft.
    assert_allclose(step.plan, expected, atol=2e-7)
    # Rates are bounded in every stage and curvatures in some: the comparison covers both.
    rates = (step.plan - step.states[:, :-1]) / 0.5
    assert_allclose(np.abs(rates).max(), 0.05, rtol=1e-6)


@pytest.mark.parametrize("solver", ["rti", "sqp"])
@pytest.mark.parametrize(
    "qp_solver", ["hpipm", "qpoases", "daqp", "qrqp", "osqp", "piqp", "proxqp"]
)
def test_all_solvers_of_programs_give_the_same_inputs(solver, qp_solver):
    own = tip_control(solver=solver, blocks=(1, 1, 2), soft={"curvature": 50.0})
    other = own.copy(qp_solver=qp_solver)
    x = np.array([0.01, 0.0, -0.02, 0.0, 0.0])
    for mpc in (own, other):
        mpc.reset(x)
    for _ in range(2):
        expected, found = (mpc.step(x, reference=GOAL) for mpc in (own, other))
        assert expected.success and found.success, found.message
        # 1e-6 of the range of the inputs, 0.2 rad/m.
        assert_allclose(found.plan, expected.plan, atol=2e-7)
        x = expected.states[:, 1]


@pytest.mark.parametrize(
    ("solver", "qp_solver"),
    [*product(["rti", "sqp"], ["own", "hpipm", "qpoases", "qrqp"]), ("ipopt", "own")],
)
def test_no_solver_leaves_a_step_without_an_input(solver, qp_solver):
    mpc = tip_control(
        solver=solver,
        qp_solver=qp_solver,
        bounds={"curvature": (-0.01, 0.01)},
        u_trim=np.full(5, 0.002),
        max_iter=20,
    )
    lost = mpc.step(np.array([0.0, 0.0, -0.1, 0.0, 0.0]), reference=GOAL)
    assert not lost.success and "the trimmed input is applied" in lost.message
    assert_allclose(lost.u, np.full(5, 0.002), rtol=0)
    assert mpc.step(np.zeros(5), reference=GOAL).success


def test_real_time_iterations_reach_the_converged_plan():
    converged, once = tip_control(), tip_control(solver="rti")
    steps = [once.step(np.zeros(5), reference=GOAL)]
    for _ in range(8):
        once._plan.applied = np.zeros(5)  # the same problem again: nothing was applied
        once._plan.inputs = steps[-1].plan
        steps.append(once.step(np.zeros(5), reference=GOAL))
    expected = converged.step(np.zeros(5), reference=GOAL)
    assert all(step.success for step in steps[2:])
    assert_allclose(steps[-1].plan, expected.plan, atol=1e-6)


def test_the_next_step_starts_from_the_shifted_plan():
    mpc = tip_control()
    first = mpc.step(np.zeros(5), reference=GOAL)
    # Without a new solution the plan goes on, then the trimmed input is applied.
    for k in range(1, 4):
        late = mpc.fallback("no sample")
        assert_allclose(late.u, first.plan[:, k], rtol=0)
        assert not late.success and "planned before" in late.message
    last = mpc.fallback("no sample")
    assert_allclose(last.u, np.zeros(5))
    assert "trimmed" in last.message and "no sample" in last.message


def test_soft_bounds_are_exceeded_by_the_reported_slack():
    mpc = tip_control(bounds={"curvature": (-0.01, 0.01)}, soft={"curvature": 50.0})
    x = np.array([0.0, 0.0, -0.03, 0.0, 0.0])
    mpc.reset(x)
    step = mpc.step(x, reference=GOAL)
    assert step.success, step.message
    curvatures = np.array(
        [
            KINEMATIC.y.split(KINEMATIC.output(end, 0, 0))["curvature"].full().ravel()
            for end in step.states[:, 1:].T
        ]
    )
    # The slack of a stage is the largest excess of its entries, as a smaller one is not enough and
    # a larger one costs more.
    excess = np.maximum(np.abs(curvatures) - 0.01, 0).max(axis=1)
    assert excess.min() > 1e-3
    assert_allclose(step.slack["curvature"], excess, atol=1e-7)


def test_a_state_beyond_its_bounds_is_answered_with_a_usable_input():
    mpc = tip_control(bounds={"curvature": (-0.01, 0.01)}, u_trim=np.full(5, 0.002))
    step = mpc.step(np.array([0.0, 0.0, -0.1, 0.0, 0.0]), reference=GOAL)
    assert not step.success
    assert "no plan within the bounds" in step.message and "trimmed" in step.message
    assert_allclose(step.u, np.full(5, 0.002))
    # It recovers by itself.
    assert mpc.step(np.zeros(5), reference=GOAL).success


def test_a_refused_call_leaves_the_controller_as_it_was():
    mpc, other = tip_control(), tip_control()
    first = [controller.step(np.zeros(5), reference=GOAL).u for controller in (mpc, other)]
    assert_allclose(*first, rtol=0)
    with pytest.raises(ValueError, match="x: expected finite numbers"):
        mpc.step(np.full(5, np.nan), reference=GOAL)
    x = np.full(5, 0.001)
    assert_allclose(mpc.step(x, reference=GOAL).u, other.step(x, reference=GOAL).u, rtol=0)


TURNS = {"attitude": 1, "rotation": 1, "station_rotation": 2}


@pytest.mark.parametrize("name", TURNS)
def test_attitudes_are_linearized_on_the_group(name):
    tracked = {"states" if name == "attitude" else "outputs": {name: 2.0}}
    mpc = cc.Mpc(
        BODY, dt=0.2, horizon=3, inputs={"torque": 0.1}, damping=0.0, solver="sqp", **tracked
    )
    problem = mpc.function.solver.problem
    rng = np.random.default_rng(1)
    q = quaternion.exp(ca.DM([0.4, -0.9, 0.3]))
    goal = quaternion.exp(ca.DM([-0.2, 0.5, 1.0]))
    if name != "attitude":
        goal = ca.repmat(ca.vec(quaternion.rotation(goal)), TURNS[name])
    goals = ca.repmat(ca.vertcat(goal, ca.DM([0, 0, 0])), 1, 3)
    inputs = [ca.vertcat(q, 0.1, -0.3, 0.2), ca.DM(0, 3), ca.DM.zeros(3), goals, ca.DM.zeros(3, 3)]
    _, parameters = mpc.function.solver.begin.call(inputs)
    u = rng.normal(size=9) * 0.3

    def objective(at):
        return float(problem.linearization(at, parameters)[0])

    gradient = problem.linearization(u, parameters)[1].full().ravel()
    # Central differences at 1e-6: their rounding is 1e-10, the error of the rule 1e-12.
    numeric = [(objective(u + 1e-6 * e) - objective(u - 1e-6 * e)) / 2e-6 for e in np.eye(9)]
    assert_allclose(gradient, numeric, atol=2e-9)


def test_a_body_is_turned_to_an_attitude_beyond_all_euler_angles():
    mpc = cc.Mpc(
        BODY, dt=0.2, horizon=10, states={"attitude": 5.0, "rate": 1.0}, inputs={"torque": 0.1}
    )
    goal = quaternion.exp(ca.DM([0.0, np.pi / 2, 0.0])).full().ravel()
    step, x = cc.rk4_step(BODY, 0.2), np.array([1.0, 0, 0, 0, 0, 0, 0])
    for _ in range(40):
        found = mpc.step(x, reference={"attitude": goal})
        assert found.success, found.message
        x = step(x, found.u, []).full().ravel()
    assert_allclose(np.abs(x[:4] @ goal), 1.0, atol=1e-6)
    assert_allclose(x[4:], 0.0, atol=1e-3)


@pytest.fixture(scope="module")
def beam():
    """A beam with inertia that a force at the tip bends."""
    force = ca.MX.sym("force")
    wing = hale_wing(1, 2, 1, grid=cc.Grid.lobatto(3))
    load = cc.PointForce(xi=1.0, force=ca.vertcat(0, 0, force), frame="dead")
    return cc.beam_model(wing, loads=[load], inputs={"force": force}, damping=5e-3)


def test_a_beam_with_inertia_is_brought_to_rest(beam):
    mpc = cc.Mpc(
        beam,
        dt=0.05,
        horizon=10,
        outputs={"position": 1.0},
        states={"q_dot": 0.1},
        moves={"force": 1e-6},
        bounds={"force": (-30.0, 30.0)},
        rate_bounds={"force": 300.0},
        compiled=False,
    )
    step = cc.step_function(beam, 0.05, method="implicit_midpoint")
    x = np.array([0.0, 0.01, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    goal = {"position": [0.0, 16.0, 0.0]}
    free, loads = x, []
    for _ in range(25):
        found = mpc.step(x, reference=goal)
        assert found.success, found.message
        loads.append(found.u[0])
        x = step(x, found.u, [])[0].full().ravel()
        free = step(free, 0, [])[0].full().ravel()
    heights = [beam.output(state, 0, [])[2] for state in (x, free)]
    assert abs(float(heights[0])) < 0.02 * abs(float(heights[1]))
    assert np.abs(np.diff(loads)).max() <= 300 * 0.05 + 1e-6
    assert np.abs(loads).max() <= 30


@pytest.mark.parametrize("limit", [None, 0.3])
def test_elements_turn_no_further_than_they_may(limit):
    beam = replace(WING, weight_bounds=None, grid=cc.Grid.uniform(4, max_angle=0.2))
    free = cc.kinematic_model(beam, time_constant=0.2)
    mpc = cc.Mpc(
        free,
        dt=DT,
        horizon=4,
        outputs={"position": 1.0},
        moves={"q_command": 1e-3},
        bounds={} if limit is None else {"element_angles": (0.0, limit)},
        solver="sqp",
    )
    step = mpc.step(np.zeros(5), reference={"position": [0.0, 13.0, -8.0]})
    assert step.success, step.message
    squares = [cc.squared_element_angles(beam, q).full() / 0.2**2 for q in step.states.T]
    assert_allclose(np.max(squares), limit or 1.0, rtol=1e-5)


def test_the_whole_controller_becomes_c(tmp_path):
    mpc = tip_control(
        blocks=(1, 1, 2),
        outputs={"position": 1.0},
        bounds={"q_command": (-0.1, 0.1), "curvature": (-0.02, 0.02)},
        soft={"curvature": 10.0},
    )
    x = np.zeros(5)
    for _ in range(3):
        step = mpc.step(x, reference={"position": TIP.position})
        assert step.success
        x = step.states[:, 1]
    export_c([mpc], tmp_path)
    # The check's own limit for solvers is 1e-6; the same operations differ by rounding alone.
    assert run_check(tmp_path)["mpc"] <= 1e-6


def test_a_loop_with_lost_and_bad_samples_has_a_usable_input_at_each_step():
    mpc = tip_control(
        bounds={"q_command": (-0.1, 0.1), "curvature": (-0.02, 0.02)},
        soft={"curvature": 10.0},
        rate_bounds={"q_command": 0.6},
        solver="rti",
    )
    rng, step, x = np.random.default_rng(0), cc.rk4_step(KINEMATIC, DT), np.zeros(5)
    outcomes = set()
    for k in range(120):
        measured = x + 1e-4 * rng.normal(size=5)
        measured[2] = np.nan if k % 7 == 3 else measured[2] - 0.12 * (k % 11 == 5)
        try:
            found = mpc.fallback("lost") if k % 10 > 6 else mpc.step(measured, reference=GOAL)
        except ValueError:
            found = mpc.fallback("refused")
        outcomes.add(found.message)
        assert np.all(np.abs(found.u) <= 0.1)
        x = step(x, found.u, 0.01 * rng.normal(size=5)).full().ravel()
    assert {"solved", "lost; the input planned before is applied"} <= outcomes
    assert "refused; the input planned before is applied" in outcomes


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"outputs": {"tip": 1.0}}, r"outputs: expected names among position, .*found 'tip'"),
        ({"outputs": {}}, "outputs: expected a weight above zero of an output"),
        ({"outputs": {"position": -1.0}}, r"outputs\['position'\]: expected weights of at least"),
        ({"outputs": {"position": [1.0, 2.0]}}, r"outputs\['position'\]: expected one weight or 3"),
        ({"outputs": {"position": np.nan}}, r"outputs\['position'\]: expected finite numbers"),
        ({"inputs": {"flap": 1.0}}, "inputs: expected names among q_command, found 'flap'"),
        ({"moves": {"q": 1.0}}, "moves: expected names among q_command, found 'q'"),
        ({"bounds": {"load": (0, 1)}}, "bounds: expected names among .*found 'load'"),
        ({"bounds": {"curvature": (1, -1)}}, r"bounds\['curvature'\]: expected lower ≤ upper"),
        ({"bounds": {"curvature": 1.0}}, r"bounds\['curvature'\]: expected a pair"),
        ({"bounds": {"curvature": (np.nan, 1)}}, r"bounds\['curvature'\]: .*found NaN"),
        ({"bounds": {"q_command": (1.0, 2.0)}}, r"bounds\['q_command'\]: .*the model's own"),
        ({"bounds": {"rotation": (-1, 1)}}, "bounds: expected a part that is no attitude"),
        ({"rate_bounds": {"flap": 1.0}}, "rate_bounds: expected names among .*found 'flap'"),
        ({"rate_bounds": {"q_command": -1.0}}, r"rate_bounds\['q_command'\]: expected one or 5"),
        ({"soft": {"position": 1.0}}, "soft: expected names with bounds, .*found 'position'"),
        ({"soft": {"q_command": 1.0}}, "soft: expected outputs or states, found the input"),
        ({"soft": {"curvature": 0.0}}, r"soft\['curvature'\]: expected a number above zero"),
        ({"horizon": 0}, "horizon: expected a whole number of at least 1, found 0"),
        ({"blocks": (1, 2)}, "blocks: expected lengths of sum 4"),
        ({"dt": 0.0}, "dt: expected a number above zero"),
        ({"solver": "newton"}, "solver: expected one of 'rti', 'sqp', 'ipopt'"),
        ({"qp_solver": "mine"}, "qp_solver: expected one of 'own', 'hpipm'"),
        (
            {"solver": "ipopt", "qp_solver": "hpipm"},
            "qp_solver: expected 'own', the default, with solver='ipopt', .*, found 'hpipm'",
        ),
        ({"u_trim": np.full(5, 0.5)}, r"u_trim: q_command\[0\], rad/m: expected within -0.1"),
        ({"blocks": 4}, "blocks: expected an Iterable, found 4"),
        ({"scales": {"flap": 1.0}}, "scales: expected names among q_command, found 'flap'"),
        ({"method": "euler"}, "method: expected one of 'rk4', 'implicit_midpoint'"),
        ({"method": "implicit_midpoint"}, "method: expected 'rk4' for 'kinematic', which has no"),
        ({"horizon": 2.5}, "horizon: expected a whole number of at least 1, found 2.5"),
        ({"blocks": (0, 4)}, "blocks: expected a whole number of at least 1, found 0"),
        ({"rate_bounds": {"q_command": (1.0, -1.0)}}, r"rate_bounds\['q_command'\]: .*lower ≤"),
        (
            {"bounds": {"position": (-np.inf, np.inf)}, "soft": {"position": 1.0}},
            "soft: expected finite bounds of 'position'",
        ),
        ({"outputs": {"position": 1.0}, "states": {"q": -1.0}}, r"states\['q'\]: expected weights"),
        ({"outputs": [1.0]}, "outputs: expected a mapping by name, found"),
        ({"terminal": np.eye(5)}, "terminal: expected a LinearModel"),
        ({"damping": -1.0}, "damping: expected a number not below zero"),
        ({"max_iter": 0}, "max_iter: expected a whole number of at least 1"),
        ({"scales": {"q_command": 1e4}}, r"scales\['q_command'\]: expected the size of an input"),
    ],
    ids=lambda value: str(value)[:40],
)
def test_contradictions_are_named(options, message):
    with pytest.raises(ValueError, match=message):
        tip_control(**options)


def test_attitudes_are_checked_by_the_name_of_the_argument():
    fields = {"dt": DT, "horizon": 2, "states": {"attitude": 1.0}, "inputs": {"torque": 1.0}}
    with pytest.raises(ValueError, match="rate_bounds: expected a part that is no attitude"):
        cc.Mpc(BODY, rate_bounds={"attitude": 1.0}, **fields)
    mpc, x = cc.Mpc(BODY, **fields), {"rate": np.zeros(3)}
    for wrong in (np.zeros(4), [2.0, 0, 0, 0], np.zeros((4, 2))):
        with pytest.raises(ValueError, match=r"reference\['attitude'\]: expected unit quaternions"):
            mpc.step(x, reference={"attitude": wrong})


def test_a_name_of_a_state_and_an_output_is_ambiguous():
    parts = {key: [Part("place", 1, "m")] for key in "xy"} | {"u": [Part("speed", 1, "m/s")]}
    twice = model("twice", parts, lambda x, u, p: u, lambda x, u, p: 10 * x)
    fields = {"dt": DT, "horizon": 2, "outputs": {"place": 1.0}}
    with pytest.raises(ValueError, match="bounds: expected a name of one part, found 'place'"):
        cc.Mpc(twice, bounds={"place": (-1, 1)}, **fields)
    with pytest.raises(ValueError, match="states: expected other names than those of outputs"):
        cc.Mpc(twice, states={"place": 1.0}, **fields)


def test_a_state_that_is_lost_is_not_taken_for_rest():
    with pytest.raises(ValueError, match=r"x: expected the state \(q .*found None"):
        tip_control().step(None)


#: How far bounds may be that only stand for none, and ranges that are narrow by rounding.
FAR, NARROW = 1e12, 1e-12


@pytest.mark.parametrize("solver", ["rti", "sqp", "ipopt"])
@pytest.mark.parametrize("far", [1.0, 1e3, 1e6, FAR])
def test_bounds_far_away_leave_the_near_one_as_it_is(solver, far):
    bounds = {"load": ([-far, -far], [0.02, far])}
    mpc = cc.Mpc(
        MASS, dt=DT, horizon=4, outputs={"load": 1.0}, inputs={"force": 1e-3}, bounds=bounds,
        solver=solver, compiled=False,
    )  # fmt: skip
    step = mpc.step([0.0, 0.0], reference={"load": [0.5, 0.0]})
    assert step.success
    ends = zip(step.states.T[1:], step.plan.T, strict=True)
    loads = [MASS.output(x, u, 0).full()[0, 0] for x, u in ends]
    assert max(loads) == pytest.approx(0.02, abs=1e-6)


def drift(x0, solver, **options):
    """A step of a place that is moved by its speed, the input, towards 0.1 m."""
    integrator = model(
        "drift",
        {"x": [Part("at", 1, "m")], "u": [Part("speed", 1, "m/s")], "y": [Part("place", 1, "m")]},
        lambda x, u, p: u,
        lambda x, u, p: x,
    )
    chosen = {"solver": "sqp", "qp_solver": "hpipm"} if solver == "hpipm" else {"solver": solver}
    fields = {"outputs": {"place": 1.0}, "inputs": {"speed": 1e-3}, "dt": DT, **options}
    return cc.Mpc(integrator, **fields, **chosen).step([x0], reference={"place": 0.1})


@pytest.mark.parametrize("solver", ["sqp", "hpipm", "ipopt"])
@pytest.mark.parametrize("horizon", [1, 2, 4])
def test_one_input_of_one_stage_or_more_without_any_bound(solver, horizon):
    speeds = np.tril(np.ones((horizon, horizon))) * DT
    normal = speeds.T @ speeds + 1e-3 * np.eye(horizon)
    expected = np.linalg.solve(normal, speeds.T @ np.full(horizon, 0.1 - 0.7))
    step = drift(0.7, solver, horizon=horizon)
    assert step.success, step.message
    assert_allclose(step.plan[0], expected, atol=1e-7)
    held = drift(0.7, solver, horizon=horizon, blocks=(horizon,))
    length = speeds.sum(axis=1)
    expected = length @ np.full(horizon, -0.6) / (length @ length + 1e-3 * horizon)
    assert held.success, held.message
    assert_allclose(held.plan[0], expected, atol=1e-7)


@pytest.mark.parametrize("solver", ["rti", "sqp", "hpipm", "ipopt"])
def test_soft_bounds_that_are_kept_change_nothing(solver):
    options = {"horizon": 3, "damping": 0.0}
    free = drift(0.2, solver, **options)
    soft = drift(0.2, solver, bounds={"place": (-0.3, 0.3)}, soft={"place": 5.0}, **options)
    assert soft.success, soft.message
    assert_allclose(soft.plan, free.plan, atol=1e-7)
    assert_allclose(soft.slack["place"], 0.0, atol=1e-9)


@pytest.mark.parametrize("solver", ["rti", "sqp", "hpipm", "ipopt"])
def test_the_excess_over_a_soft_bound_is_that_of_its_weight(solver):
    """One stage: ½ (y - 0.1)² + ½ 5 (y - 0.3)² + ½ w u², y = 1 + DT u, of which y > 0.3."""
    bounds = {"place": (-0.3, 0.3), "speed": (-2.0, 2.0)}
    step = drift(1.0, solver, horizon=1, bounds=bounds, soft={"place": 5.0})
    assert step.success, step.message
    assert_allclose(step.u, -2.0, atol=1e-7)  # with w = 1e-3 the bound of the input holds it
    assert_allclose(step.slack["place"], 0.5, atol=1e-6)
    step = drift(1.0, solver, horizon=1, inputs={"speed": 1.0}, bounds=bounds, soft={"place": 5.0})
    speed = -DT * (0.9 + 5 * 0.7) / (1 + 6 * DT**2)
    assert step.success, step.message
    assert_allclose(step.u, speed, atol=1e-7)
    assert_allclose(step.slack["place"], 0.7 + DT * speed, atol=1e-7)


@pytest.mark.parametrize("solver", ["rti", "sqp", "ipopt"])
def test_inputs_bounded_far_away_are_those_without_bounds(solver):
    free = model(
        "free_mass",
        {
            "x": [Part("place", 1, "m"), Part("speed", 1, "m/s")],
            "u": [Part("force", 1, "N")],
            "y": [Part("load", 1, "m")],
        },
        lambda x, u, p: ca.vertcat(x[1], u),
        lambda x, u, p: x[0],
    )
    plans = [
        cc.Mpc(
            free, dt=DT, horizon=4, outputs={"load": 1.0}, inputs={"force": 1e-4},
            bounds=bounds, solver=solver, compiled=False,
        ).step([1.0, -0.5])
        for bounds in ({}, {"force": (-FAR, FAR)}, {"force": (-FAR, 50.0)})
    ]  # fmt: skip
    for step in plans:
        assert step.success
        # A real-time iteration keeps steps short by its damping, 1e-8 of squared scaled inputs.
        assert_allclose(step.plan, plans[0].plan, rtol=1e-3 if solver == "rti" else 1e-6)


@pytest.mark.parametrize("solver", ["rti", "sqp"])
def test_a_factor_of_all_weights_changes_no_plan(solver):
    goals = {"load": [0.2, 0.0]}
    plans = []
    for factor in (1.0, 1e-3, 1e-9):
        mpc = cc.Mpc(
            MASS, dt=DT, horizon=4, outputs={"load": factor}, inputs={"force": 1e-2 * factor},
            solver=solver, compiled=False,
        )  # fmt: skip
        step = mpc.step([0.1, 0.0], reference=goals)
        assert step.success
        plans.append(step.plan)
    assert_allclose(plans[1:], [plans[0]] * 2, rtol=1e-5)


def test_small_weights_are_damped_alike_in_c(tmp_path):
    mpc = cc.Mpc(
        MASS, dt=DT, horizon=2, outputs={"load": 1e-9}, inputs={"force": 1e-11}, compiled=False
    )
    assert mpc.step([0.1, 0.0]).success
    export_c([mpc], tmp_path)
    run_check(tmp_path)


@pytest.mark.parametrize("solver", ["rti", "sqp"])
def test_ranges_that_are_narrow_by_rounding_are_kept(solver):
    mpc = cc.Mpc(
        MASS, dt=DT, horizon=4, outputs={"load": 1.0}, solver=solver, compiled=False,
        bounds={"force": (1.0, 1.0 + NARROW), "speed": (-10.0, 10.0)},
    )  # fmt: skip
    assert mpc.step([0.0, 0.0]).u == pytest.approx([1.0])
    mpc = cc.Mpc(
        MASS, dt=DT, horizon=2, outputs={"load": 1.0}, solver=solver, compiled=False,
        bounds={"speed": (0.1, 0.1 + NARROW)},
    )  # fmt: skip
    step = mpc.step([0.0, 0.1])
    assert step.success
    assert_allclose(step.states[1], 0.1, rtol=1e-8)


@pytest.mark.parametrize("bound", [(-0.02, 0.02), (0.0, 0.02)])
def test_ipopt_ends_on_bounds_of_inputs_with_success(bound):
    mpc = tip_control(solver="ipopt", bounds={"q_command": bound})
    step = mpc.step(np.zeros(5), reference=GOAL)
    assert step.success
    assert np.any(np.isclose(step.plan, 0.02, rtol=0, atol=1e-7))


@pytest.mark.parametrize("solver", ["rti", "sqp", "ipopt"])
@pytest.mark.parametrize("x", [1e20, 1e154, 1e300])
def test_a_state_from_which_the_motion_is_not_finite_is_answered(solver, x):
    mpc = tip_control(solver=solver)
    step = mpc.step(np.full(5, x), reference=GOAL)
    assert not step.success and "trimmed" in step.message
    assert_allclose(step.u, mpc.u_trim, rtol=0)
    # As if there had been no such call: the plan from a measured state is the first one.
    after, first = (control.step(np.zeros(5), reference=GOAL) for control in (mpc, tip_control()))
    if solver == "sqp":
        assert_allclose(after.plan, first.plan, atol=1e-6)


def test_a_program_without_a_plan_within_its_bounds_says_so():
    mpc = tip_control(bounds={"position": (100.0, 200.0)})
    step = mpc.step(np.zeros(5), reference=GOAL)
    assert not step.success
    assert step.message.startswith("no plan within the bounds found")


@pytest.mark.parametrize(
    ("call", "message"),
    [
        ({"reference": {"load": 1.0}}, "reference: expected names among .*found 'load'"),
        ({"reference": {"position": [1.0, 2.0]}}, r"reference\['position'\]: expected 3 numbers"),
        ({"reference": {"position": [np.inf, 0, 0]}}, r"reference\['position'\]: expected finite"),
        ({"reference": {"rotation": np.zeros((3, 3))}}, r"reference\['rotation'\]: expected ortho"),
        ({"reference": {"rotation": np.ones(9)}}, r"reference\['rotation'\]: expected ortho"),
        ({"reference": {"rotation": np.zeros((9, 4))}}, r"reference\['rotation'\]: expected ortho"),
        ({"preview": {"wind": 1.0}}, "preview: expected names among disturbance, found 'wind'"),
        ({"reference": {"position": np.zeros((4, 3))}}, r"reference\['position'\]: expected 3 num"),
        ({"reference": [0.0, 0.0, 0.0]}, "reference: expected a Mapping"),
        ({"p": {"disturbanc": 0.0}}, r"p: expected parts among \['disturbance'\], found"),
        ({"p": np.zeros(4)}, "p: expected 5 numbers"),
        ({"preview": {"disturbance": np.zeros((5, 2))}}, r"preview\['disturbance'\]: expected 5"),
        ({"p": np.full(5, np.nan)}, "p: expected finite numbers"),
    ],
    ids=lambda value: str(value)[:40],
)
def test_bad_calls_are_named(call, message):
    with pytest.raises(ValueError, match=message):
        tip_control().step(np.zeros(5), **call)


def test_copies_have_plans_of_their_own_and_share_what_is_compiled():
    first, x = tip_control(), np.zeros(5)
    alike, softer = first.copy(), first.copy(moves={"q_command": 1.0}, solver="rti")
    before = alike.step(x, reference=GOAL).plan
    first.step(x, reference=GOAL)
    first.step(np.full(5, 0.01), reference=GOAL)
    alike.reset()
    assert_allclose(alike.step(x, reference=GOAL).plan, before, rtol=0)
    assert alike.function is first.function
    # Other weights are another controller: as one that is made of them.
    expected = tip_control(moves={"q_command": 1.0}, solver="rti").step(x, reference=GOAL)
    assert_allclose(softer.step(x, reference=GOAL).plan, expected.plan, rtol=0)


def test_weights_change_without_another_compilation(beam, monkeypatch):
    compiled = []
    compile_function = functions.compile_function
    monkeypatch.setattr(
        functions, "compile_function", lambda f: compiled.append(f.name()) or compile_function(f)
    )
    mpc = cc.Mpc(beam, dt=0.05, horizon=2, outputs={"position": 1.0}, moves={"force": 1e-6})
    goal = {"position": [0.0, 16.0, 0.0]}
    x = np.array([0.0, 0.01, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    first = mpc.step(x, reference=goal)
    assert len(compiled) == 2  # the step and the outputs
    other = mpc.copy(moves={"force": 1e-3}, horizon=3).step(x, reference=goal)
    assert len(compiled) == 2
    assert abs(other.u[0]) < abs(first.u[0])


def test_a_parameter_without_a_nominal_value_is_asked_for():
    part = Part("airspeed", 1, "m/s")
    parts = {"x": [Part("place", 1, "m")], "u": [Part("speed", 1, "m/s")], "p": [part]}
    boat = model(
        "boat", parts | {"y": [Part("way", 1, "m")]}, lambda x, u, p: u + p, lambda x, u, p: x
    )
    mpc = cc.Mpc(boat, dt=DT, horizon=3, outputs={"way": 1.0}, inputs={"speed": 1e-3})
    for given in (None, {}):
        with pytest.raises(
            ValueError, match=r"p: expected airspeed \(m/s\), which the model has no"
        ):
            mpc.step([1.0], given)
    expected = mpc.step([1.0], {"airspeed": 2.0}).u
    for call in (
        {"p": [2.0]},
        {"preview": {"airspeed": 2.0}},
        {"preview": {"airspeed": [2, 2, 2]}},
    ):
        mpc.reset()
        assert_allclose(mpc.step([1.0], **call).u, expected, rtol=0)
    # A gust that is not given is none.
    still = cc.Mpc(MASS, dt=DT, horizon=3, outputs={"load": 1.0}, inputs={"force": 0.1})
    expected = still.step([0.1, 0.0], [0.0]).u
    still.reset()
    assert_allclose(still.step([0.1, 0.0]).u, expected, rtol=0)


@pytest.mark.parametrize(
    "options", [{"solver": "ipopt"}, {"qp_solver": "hpipm"}, {"qp_solver": "daqp"}], ids=str
)
def test_solvers_without_c_name_the_ones_with_it(options, tmp_path):
    mpc = tip_control(**options)
    with pytest.raises(ValueError, match=r"functions: 'mpc' holds a part .*'own'"):
        export_c([mpc], tmp_path)
    # The advice is good.
    export_c([mpc.copy(solver="sqp", qp_solver="own")], tmp_path)


def test_a_pickle_goes_on_where_the_controller_was():
    mpc, x = tip_control(), np.zeros(5)
    mpc.step(x, reference=GOAL)
    other, fresh = pickle.loads(pickle.dumps(mpc)), copy.deepcopy(mpc)
    planned = mpc.fallback().u
    assert_allclose(other.fallback().u, planned, rtol=0)
    assert_allclose(fresh.fallback().u, mpc.u_trim, rtol=0)
    assert np.abs(planned).max() > 1e-3


def test_the_time_goes_on_over_the_stages():
    parts = {"x": [Part("place", 1, "m")], "u": [Part("speed", 1, "m/s")]}
    parts |= {"p": [Part("time", 1, "s")], "y": [Part("way", 1, "m")]}
    tide = model("tide", parts, lambda x, u, p: u + ca.sin(5 * p), lambda x, u, p: x)
    mpc = cc.Mpc(tide, dt=DT, horizon=5, outputs={"way": 1.0}, inputs={"speed": 1e-3})
    found = mpc.step([1.0], {"time": 0.3}).plan
    middles = 0.3 + DT * np.array([0.5, 1.5, 2.5, 3.5, 4.5])
    mpc.reset()
    assert_allclose(mpc.step([1.0], preview={"time": middles}).plan, found, rtol=0)
    assert np.ptp(np.sin(5 * middles)) > 0.1


def test_a_later_change_of_what_was_given_changes_no_copy():
    weights = np.array([3.0, 0.5])
    outputs, bounds = {"load": weights}, {"force": [-1.0, 1.0]}
    mpc = cc.Mpc(MASS, dt=DT, horizon=3, outputs=outputs, inputs={"force": 1e-3}, bounds=bounds)
    expected = mpc.step([0.1, 0.0]).plan
    weights[:], outputs["none"], bounds["force"][1] = 0.0, 1.0, -0.9
    assert_allclose(mpc.copy().step([0.1, 0.0]).plan, expected, rtol=1e-12)
    assert_allclose(mpc.copy(max_iter=9).step([0.1, 0.0]).plan, expected, rtol=1e-12)
