"""Predictive control: time beside its linearizations, agreement, a loop that never stops."""

from __future__ import annotations

import shutil
import time
from typing import Any

import casadi as ca
import numpy as np

import curvcasadi as cc
from benchmarks.generated_c import NO_GCC
from benchmarks.table import Check, Table, checked, compared
from curvcasadi.lie import so3
from curvcasadi.reference_wings import hale_wing
from curvcasadi.symbolic.expressions import Array

DT, STAGES = 0.05, 20
AIR = np.array([20.0, np.radians(3.0)])
FLAPS = ("inner", "outer")
STEPS = 10_000
#: Numbers of stages, and the largest input of a linear model.
HORIZONS, LARGEST = (20, 80, 160), 0.3


def _wing_model() -> cc.ControlModel:
    """The HALE wing in a stream: 9 weights, two poles, 24 states, two flaps."""
    controls = tuple(
        cc.ControlSurface(name=name, start=start, end=end, lift=3.5, moment=-0.6)
        for name, start, end in zip(FLAPS, (0.2, 0.6), (0.6, 0.95), strict=True)
    )
    strips = cc.StripAerodynamics(
        chord=1.0, aerodynamic_center=0.25, lift_slope=2 * np.pi, controls=controls
    )
    return cc.wing_model(
        cc.Wing(name="right", beam=hale_wing(grid=cc.Grid.lobatto(8)), strips=strips),
        density=0.0889,
        lag=cc.IndicialLag(poles=2, modes=3),
        damping=2e-3,
        outputs=["tip_position"],
    )


def _wing_control(model: cc.ControlModel, solver: Any) -> cc.Mpc:
    return cc.Mpc(
        model,
        dt=DT,
        horizon=STAGES,
        outputs={"tip_position": 1.0},
        inputs=dict.fromkeys(FLAPS, 0.3),
        moves=dict.fromkeys(FLAPS, 0.5),
        bounds=dict.fromkeys(FLAPS, (-0.26, 0.26)),
        rate_bounds=dict.fromkeys(FLAPS, 1.05),
        solver=solver,
    )


def times() -> Table:
    """A real-time iteration and a converged warm step over the linearizations of their stages."""
    title = f"Predictive control of the HALE wing, 24 states, 2 flaps, {STAGES} stages"
    columns = ("what", "ratio", "asked for")
    if not shutil.which("gcc"):
        return compared(title, columns, [], (NO_GCC,))
    model = _wing_model()
    trim = cc.flutter(model, np.array([20.0, 21.0]), p={"pitch": AIR[1]}).equilibria[0]
    goal = {"tip_position": model.output(trim, np.zeros(2), AIR)}
    step = cc.compile_function(cc.step_function(model, DT, method="implicit_midpoint", newton=True))
    slopes = step.jacobian()

    def linearized(x: Array) -> float:
        start = time.perf_counter()
        for _ in range(STAGES):
            end = step(x, np.zeros(2), AIR)
            slopes(x, np.zeros(2), AIR, *end)
        return time.perf_counter() - start

    rows = []
    for what, solver, most in (
        ("real-time iteration", "rti", "≤ 4"),
        ("converged warm step", "sqp", "≤ 20"),
    ):
        control, x, ratios = _wing_control(model, solver), trim * 1.0, []
        x[:9] *= 1.1
        for k in range(24):
            once = linearized(x)
            start = time.perf_counter()
            found = control.step(x, AIR, goal)
            if k >= 4:  # warm
                ratios.append((time.perf_counter() - start) / once)
            x = step(x, found.u, AIR)[0].full().ravel()
        rows.append((what, f"{float(np.median(ratios)):.1f}", most))
    return compared(title, columns, rows)


def programs() -> Table:
    """HPIPM on the stages over the condensed program, of a model that costs nothing."""
    title = "Real-time iterations of a linear model, 24 states, 2 inputs: HPIPM on the stages"
    x, model = np.random.default_rng(1).normal(size=24), _linear_model()
    own = cc.Mpc(
        model,
        dt=DT,
        horizon=HORIZONS[0],
        states={"state": 1.0},
        inputs={"input": 0.3},
        moves={"input": 0.5},
        rate_bounds={"input": 1.0},
    )
    rows = []
    for horizon in HORIZONS:
        controls = [own.copy(horizon=horizon, qp_solver=key) for key in ("own", "hpipm")]
        plans, times = [], np.zeros((8, 2))
        for row in times:
            for j, control in enumerate(controls):
                control.reset()
                start = time.perf_counter()
                plans.append(control.step(x).plan)
                row[j] = time.perf_counter() - start
        ratio = np.median(times[2:, 1] / times[2:, 0])
        off = np.abs(plans[-1] - plans[-2]).max() / (2 * LARGEST)
        rows.append((f"{horizon} stages", f"{ratio:.2f}", f"{off:.0e}"))
    columns = ("horizon", "time over that of the condensed program", "difference, over the range")
    return compared(title, columns, rows)


def _linear_model() -> cc.ControlModel:
    random, n = np.random.default_rng(0), 24
    A, B = 0.1 * random.normal(size=(n, n)) - np.eye(n), random.normal(size=(n, 2))
    x, u, p = ca.SX.sym("x", n), ca.SX.sym("u", 2), ca.SX.sym("p", 0)
    return cc.ControlModel(
        name="linear",
        x=cc.Layout((cc.Part("state", n, "1"),)),
        u=cc.Layout((cc.Part("input", 2, "1", -LARGEST, LARGEST),)),
        p=cc.Layout(()),
        y=cc.Layout(()),
        xdot=ca.Function("linear_xdot", [x, u, p], [ca.DM(A) @ x + ca.DM(B) @ u]),
        output=ca.Function("linear_output", [x, u, p], [ca.SX(0, 1)]),
    )


def regulator() -> Table:
    """The first input of a horizon of any length with a terminal cost, over the range of inputs."""
    model = _wing_model()
    trim = cc.flutter(model, np.array([20.0, 21.0]), p={"pitch": AIR[1]}).equilibria[0]
    fields = {
        "dt": DT,
        "outputs": {"tip_position": 1.0},
        "inputs": dict.fromkeys(FLAPS, 0.3),
        "moves": dict.fromkeys(FLAPS, 0.5),
    }
    rest, x = cc.linearize(model, trim, np.zeros(2), AIR), trim.copy()
    x[:9] *= 1 + 1e-4  # so near that the model is linear
    inputs = [
        cc.Mpc(model, horizon=horizon, terminal=rest, **fields).step(x, AIR).u
        for horizon in (1, 5, 20, 60)
    ]
    goal = {"tip_position": model.output(trim, np.zeros(2), AIR)}
    long = cc.Mpc(model, horizon=60, **fields).step(x, AIR, goal).u
    size = np.abs(long).max()
    return checked(
        "The HALE wing in a stream, no bound reached, against 60 stages without a terminal cost",
        [
            Check(
                what=f"first input of horizon {horizon}, which ends on the cost of the regulator",
                value=float(np.abs(found - long).max() / size),
                high=1e-5,
            )
            for horizon, found in zip((1, 5, 20, 60), inputs, strict=True)
        ],
    )


def agreement() -> Table:
    """Converged inputs of the same program by others, over the range of the inputs."""
    beam = hale_wing(2, 2, 1, grid=cc.Grid.lobatto(6))
    model, x = cc.kinematic_model(beam, time_constant=0.5), np.array([0.01, 0, -0.02, 0, 0])
    goal = cc.pose_at(beam, [0.02, -0.01, -0.05, 0.015, 0.01], 1.0)
    plans = {
        key: cc.Mpc(
            model,
            dt=0.1,
            horizon=5,
            outputs={"position": 1.0, "rotation": 1.0},
            inputs={"q_command": 1e-2},
            bounds={"q_command": (-0.1, 0.1)},
            rate_bounds={"q": 0.05},
            solver="ipopt" if key == "IPOPT" else "sqp",
            qp_solver="hpipm" if key == "HPIPM" else "own",
        )
        .step(x, reference={"position": goal.position, "rotation": goal.rotation})
        .plan
        for key in ("own", "HPIPM", "IPOPT")
    }
    others = {key: plans[key] for key in ("HPIPM", "IPOPT")}
    notes = []
    try:
        others["rockit"] = _by_rockit(model, x, goal)
    except ImportError:
        notes.append('rockit is not installed: pip install "curvcasadi[compare]".')
    checks = [
        Check(
            what=f"largest difference from {name}, over the range of the inputs",
            value=float(np.abs(plan - plans["own"]).max()) / 0.2,
            high=1e-6,
        )
        for name, plan in others.items()
    ]
    return checked("Inputs of the tip problem, 5 stages, bounds and rates active", checks, notes)


def _by_rockit(model: cc.ControlModel, x: Array, goal: cc.Pose) -> Array:
    """Inputs of the tip problem by multiple shooting in rockit."""
    import rockit

    ocp = rockit.Ocp(t0=0, T=0.5)
    state, command = ocp.state(model.x.size), ocp.control(model.u.size)
    rate = model.xdot(state, command, np.zeros(model.p.size))
    ocp.set_der(state, rate)
    y = model.y.split(model.output(state, command, np.zeros(model.p.size)))
    turn = so3.log_error(ca.reshape(y["rotation"], 3, 3), ca.DM(goal.rotation))
    error = ca.sumsqr(y["position"] - goal.position) + ca.sumsqr(turn)
    # The first state is given: what it costs is a constant.
    ocp.add_objective(ocp.sum(error, include_last=True) / 2)
    ocp.add_objective(ocp.sum(1e-2 * ca.sumsqr(command)) / 2)
    ocp.subject_to(ocp.at_t0(state) == x)
    ocp.subject_to(-0.05 <= (rate <= 0.05), include_last=False)
    ocp.subject_to(-0.1 <= (command <= 0.1), include_last=False)
    quiet = {"print_level": 0, "sb": "yes", "tol": 1e-11, "bound_relax_factor": 0.0}
    ocp.solver("ipopt", {"print_time": False, "ipopt": quiet})
    ocp.method(rockit.MultipleShooting(N=5, M=1, intg="rk"))
    _, inputs = ocp.solve().sample(command, grid="control")
    return np.asarray(inputs)[:5].T  # the last one again at the end


def endless() -> Table:
    """A loop that answers refused and failed calls with the plan, then with the trimmed input."""
    wing = hale_wing(1, 2, 1, grid=cc.Grid.lobatto(3))
    model = cc.kinematic_model(wing, time_constant=0.5)
    goal = {"position": cc.pose_at(wing, [0.01, -0.03, 0.01, 0.005], 1.0).position}
    control = cc.Mpc(
        model,
        dt=0.1,
        horizon=5,
        outputs={"position": 1.0},
        moves={"q_command": 1e-2},
        bounds={"q_command": (-0.1, 0.1), "curvature": (-0.02, 0.02)},
        rate_bounds={"q_command": 0.5},
        soft={"curvature": 10.0},
    )
    rng, step, x = np.random.default_rng(0), cc.rk4_step(model, 0.1), np.zeros(4)
    counts = dict.fromkeys(("unusable", "refused", "lost", "unsolved"), 0)
    for _ in range(STEPS):
        measured, kind = x + 1e-4 * rng.normal(size=4), rng.uniform()
        if kind < 0.1:
            measured[rng.integers(4)] = np.nan
        elif kind < 0.2:  # far beyond what the soft bounds allow
            measured += rng.choice([-1.0, 1.0], 4) * 0.12
        if kind > 0.9:
            counts["lost"] += 1
            found = control.fallback("lost sample")
        else:
            try:
                found = control.step(measured, reference=goal)
                counts["unsolved"] += not found.success
            except ValueError:
                counts["refused"] += 1
                found = control.fallback("refused")
        counts["unusable"] += not np.all(np.abs(found.u) <= 0.1)
        x = step(x, found.u, 0.01 * rng.normal(size=4)).full().ravel()
    return checked(
        f"A loop of {STEPS} steps: a tenth of NaN, a tenth lost, a tenth beyond soft bounds",
        [
            Check(
                what="steps without a usable input",
                value=counts["unusable"],
                high=0,
                form="{:.0f}",
            ),
            Check(what="samples lost", value=counts["lost"], form="{:.0f}"),
            Check(what="calls refused", value=counts["refused"], form="{:.0f}"),
            Check(what="calls answered by a plan", value=counts["unsolved"], form="{:.0f}"),
        ],
    )
