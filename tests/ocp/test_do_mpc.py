"""The same tip-path problem in do-mpc gives the same inputs."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose

import curvcasadi as cc
from curvcasadi.lie import so3
from curvcasadi.reference_wings import hale_wing

do_mpc = pytest.importorskip("do_mpc")

TAU, DT, STAGES, STEPS = 0.5, 0.1, 5, 6
RATE, CURVATURE, MOVE = 0.03, 0.05, 1e-2
WING = hale_wing(2, 2, 1, grid=cc.Grid.lobatto(6))
MODEL = cc.kinematic_model(WING, time_constant=TAU)
GOAL = np.array([0.02, -0.01, -0.05, 0.015, 0.01])
#: IPOPT leaves 1e-8 of a bound (its bound_relax_factor): 5e-9 of an input of τ times the rate.
TOLERANCE = 2e-8


def _tip(time):
    """The path: weights that grow to the goal in 0.8 s."""
    return cc.pose_at(WING, GOAL * np.clip(time / 0.8, 0, 1), 1.0)


@pytest.fixture(scope="module")
def controller():
    """The controller of do-mpc: discrete time, parameters in time for the path."""
    n = WING.basis.n
    model = do_mpc.model.Model("discrete", "MX")
    x = model.set_variable("_x", "x", (n, 1))
    u = model.set_variable("_u", "u", (n, 1))
    position_d = model.set_variable("_tvp", "position", (3, 1))
    rotation_d = model.set_variable("_tvp", "rotation", (9, 1))
    end = cc.rk4_step(MODEL, DT)(x, u, np.zeros(n))
    model.set_rhs("x", end)
    y = MODEL.y.split(MODEL.output(x, np.zeros(n), np.zeros(n)))
    turn = so3.log_error(ca.reshape(y["rotation"], 3, 3), ca.reshape(rotation_d, 3, 3))
    model.set_expression("cost", (ca.sumsqr(y["position"] - position_d) + ca.sumsqr(turn)) / 2)
    model.set_expression("rate", MODEL.xdot(x, u, np.zeros(n)))
    # do-mpc looks at its constraints at the starts of stages, and not at the last end.
    later = MODEL.y.split(MODEL.output(end, np.zeros(n), np.zeros(n)))
    model.set_expression("curvature", later["curvature"])
    model.setup()

    mpc = do_mpc.controller.MPC(model)
    mpc.settings.n_horizon, mpc.settings.t_step, mpc.settings.n_robust = STAGES, DT, 0
    mpc.settings.store_full_solution = True
    mpc.settings.supress_ipopt_output()
    mpc.settings.nlpsol_opts.update({"ipopt.tol": 1e-11})
    # The stage cost at the first state is a constant; rterm holds the move's weight itself, ours
    # has ½ before it.
    mpc.set_objective(mterm=model.aux["cost"], lterm=model.aux["cost"])
    mpc.set_rterm(u=np.full((n, 1), MOVE / 2))
    for kind, layout in (("_x", MODEL.x), ("_u", MODEL.u)):
        for side, bound in zip(("lower", "upper"), layout.bounds, strict=True):
            mpc.bounds[side, kind, kind[1:]] = bound.reshape(-1, 1)
    for sign in (1, -1):
        mpc.set_nl_cons(f"rate_{sign + 1}", sign * model.aux["rate"], ub=RATE)
        mpc.set_nl_cons(f"curvature_{sign + 1}", sign * model.aux["curvature"], ub=CURVATURE)
    template = mpc.get_tvp_template()

    def path(time):
        for k in range(STAGES + 1):
            tip = _tip(time + k * DT)
            template["_tvp", k, "position"] = tip.position
            template["_tvp", k, "rotation"] = ca.vec(tip.rotation)
        return template

    mpc.set_tvp_fun(path)
    mpc.setup()
    return mpc


@pytest.mark.filterwarnings("ignore::FutureWarning")
def test_do_mpc_gives_the_same_inputs_and_plans_in_a_closed_loop(controller):
    n = WING.basis.n
    solver = cc.tip_path_step_function(
        MODEL,
        dt=DT,
        horizon=STAGES,
        move_weight=MOVE,
        rate_bound=RATE,
        curvature_bound=CURVATURE,
    )
    general = cc.Mpc(
        MODEL,
        dt=DT,
        horizon=STAGES,
        outputs={"position": 1.0, "rotation": 1.0},
        moves={"q_command": MOVE},
        bounds={"curvature": (-CURVATURE, CURVATURE)},
        rate_bounds={"q": RATE},
        solver="sqp",
    )
    step = cc.rk4_step(MODEL, DT)
    x, u, plan = np.zeros(n), np.zeros(n), np.zeros(solver.size1_in("guess"))
    controller.x0, controller.u0 = x, u
    controller.set_initial_guess()
    rates, curvatures = [], []
    for k in range(STEPS):
        tips = [_tip((k + 1 + i) * DT) for i in range(STAGES)]
        ours = solver(
            x=x,
            p=0,
            u_previous=u,
            positions=ca.horzcat(*(tip.position for tip in tips)),
            rotations=ca.horzcat(*(tip.rotation for tip in tips)),
            guess=plan,
        )
        theirs = controller.make_step(x.reshape(-1, 1)).ravel()
        u, plan = ours["u"].full().ravel(), ours["plan"]
        assert_allclose(u, theirs, atol=TOLERANCE)
        goals = {
            "position": ca.horzcat(*(tip.position for tip in tips)),
            "rotation": ca.horzcat(*(ca.vec(tip.rotation) for tip in tips)),
        }
        # 1e-6 of the range of the inputs, 0.3 rad/m.
        assert_allclose(general.step(x, reference=goals).u, theirs, atol=3e-7)
        later = plan.full().ravel().reshape(STAGES, 2 * n)[:-1, :n].T
        inputs = controller.data.prediction(("_u", "u"))[:, :, 0]
        assert_allclose(later, inputs[:, 1:], atol=TOLERANCE)
        states = controller.data.prediction(("_x", "x"))[:, :, 0]
        assert_allclose(ours["states"], states, atol=TOLERANCE)
        rates.append(np.abs((u - x) / TAU).max())
        curvatures.append(max(np.abs(WING.basis(xi) @ states).max() for xi in (0, 0.5, 1)))
        x = step(x, u, 0).full().ravel()
    # Both bounds hold the plans somewhere: the comparison covers them.
    assert_allclose(np.max(rates), RATE, rtol=1e-6)
    assert_allclose(np.max(curvatures), CURVATURE, rtol=1e-6)
