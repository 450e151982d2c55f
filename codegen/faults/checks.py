"""Whether a result is right, by other means than those of the functions: none of their solvers, no
structured derivatives, none of their certificates.

Everything is computed in double precision on the unrolled pose, and differentiated by AD. What a
function promises is that its optimality conditions are met to `STATIONARITY`, in units of its
unknowns, and limits to `LIMIT`; here they may be three times as far off, as norms differ and single
precision rounds.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from math import sqrt
from typing import Any

import casadi as ca
import numpy as np
from scipy.optimize import nnls

import curvcasadi as cc
from codegen import benchmark_functions as benchmark
from curvcasadi.lie import so3
from curvcasadi.ocp.limits import regularizer_matrix

Arrays = dict[str, Any]

STATIONARITY = {"double": 1e-8, "float": 1e-4}
LIMIT = {"double": 1e-6, "float": 1e-5}
TARGET = {"double": 1e-6, "float": 1e-5}  #: of targets to be met, in lengths
ROUNDING = {"double": 1e-13, "float": 5e-6}  #: of a pose, over its largest entry
SLACK = 3
BOUND = 0.1  #: of the weights, rad/m
REGULARIZATION = 1e-6
POSITION_WEIGHT, ATTITUDE_WEIGHT, MOVE_WEIGHT = 1.0, 25.0, 1e-2
INPUT_WEIGHT, SOFT_WEIGHT, SOFT_BOUND = 1e-2, 10.0, 0.06
STAGES, DT, TIME_CONSTANT, RATE_BOUND = 2, 0.05, 0.25, 0.3


@cache
def _beam() -> cc.Beam:
    return benchmark.wing(real="double")


@cache
def _pose() -> ca.Function:
    """q -> position, rotation of the tip, without an attached Jacobian."""
    return cc.tip_function(_beam()).expand()


@cache
def _tip_derivatives() -> ca.Function:
    q = ca.SX.sym("q", _beam().basis.n)
    position, rotation = _pose()(q)
    return ca.Function(
        "tip", [q], [position, ca.jacobian(position, q), rotation, ca.jacobian(rotation, q)]
    )


def tip(real: str, inputs: Arrays, outputs: Arrays) -> str:
    position, rotation = _pose()(inputs["q"])
    return _different(real, outputs, position=position, rotation=rotation)


def tip_jacobian(real: str, inputs: Arrays, outputs: Arrays) -> str:
    position, by_q, rotation, rotation_by_q = (x.full() for x in _tip_derivatives()(inputs["q"]))
    turns = [rotation.T @ np.reshape(column, (3, 3), "F") for column in rotation_by_q.T]
    axes = [(t[2, 1] - t[1, 2], t[0, 2] - t[2, 0], t[1, 0] - t[0, 1]) for t in turns]
    jacobian = np.vstack([np.transpose(axes) / 2, rotation.T @ by_q])
    return _different(real, outputs, position=position, rotation=rotation, jacobian=jacobian)


def _different(real: str, outputs: Arrays, **expected: Any) -> str:
    for key, value in expected.items():
        right = np.ravel(ca.DM(value).full(), "F")
        off = np.max(np.abs(outputs[key] - right)) / max(1.0, np.max(np.abs(right)))
        if not off <= ROUNDING[real]:
            return f"{key} is {off:.1e} off"
    return ""


@cache
def _least_squares() -> ca.Function:
    """q, position -> gradient and Gauss–Newton Hessian of the weighted target, over its size."""
    q, goal = ca.SX.sym("q", _beam().basis.n), ca.SX.sym("goal", 3)
    error = (_pose()(q)[0] - goal) / _beam().length
    preference = REGULARIZATION * regularizer_matrix(_beam(), "smoothness")
    jacobian = ca.jacobian(error, q)
    hessian = jacobian.T @ jacobian + preference
    gradient = jacobian.T @ error + preference @ q
    size = ca.Function("size", [q], [ca.mmax(ca.diag(hessian))])(0)
    return ca.Function("least_squares", [q, goal], [gradient / size, hessian / size])


def shape_target(real: str, inputs: Arrays, outputs: Arrays) -> str:
    gradient = _least_squares()(outputs["q"], inputs["positions"])[0].full()
    return _distance(real, inputs, outputs) or _optimum(real, outputs["q"], gradient)


def free_shape_target(real: str, inputs: Arrays, outputs: Arrays) -> str:
    """Of a wing whose weights the angles of its elements limit alone."""
    q = outputs["q"]
    gradient = _least_squares()(q, inputs["positions"])[0].full().ravel()
    squares, slopes = (x.full() for x in _squared_angles()(q))
    limit = _beam().grid.max_angle ** 2
    reached = squares.ravel() > limit - SLACK * (STATIONARITY[real] + LIMIT[real])
    off = gradient
    if np.any(reached):
        off = nnls(slopes[reached].T, -gradient, maxiter=100 * q.size)[1]
    return (
        _distance(real, inputs, outputs)
        or _within(real, squares, -np.inf, limit)
        or _small(real, float(np.linalg.norm(off)))
    )


@cache
def _squared_angles() -> ca.Function:
    """q -> squared angles of the elements, their derivatives."""
    q = ca.MX.sym("q", _beam().basis.n)
    squares = cc.squared_element_angles(replace(_beam(), weight_bounds=None), q)
    angles = ca.Function("angles", [q], [squares]).expand()
    x = ca.SX.sym("q", _beam().basis.n)
    return ca.Function("squared_angles", [x], [angles(x), ca.jacobian(angles(x), x)])


def shape_target_step(real: str, inputs: Arrays, outputs: Arrays) -> str:
    guess, q = inputs["q_guess"], outputs["q"]
    gradient, hessian = (x.full() for x in _least_squares()(guess, inputs["positions"]))
    at_result = gradient.ravel() + hessian @ (q - guess)
    return _distance(real, inputs, outputs) or _optimum(real, q, at_result)


def shape_target_met(real: str, inputs: Arrays, outputs: Arrays) -> str:
    q = outputs["q"]
    missed = np.max(np.abs(_pose()(q)[0].full().ravel() - inputs["positions"])) / _beam().length
    if missed > TARGET[real] + ROUNDING[real]:
        return f"the target is missed by {missed:.1e} lengths"
    return _distance(real, inputs, outputs) or _within(real, q, -BOUND, BOUND)


def _distance(real: str, inputs: Arrays, outputs: Arrays) -> str:
    error = _pose()(outputs["q"])[0].full().ravel() - inputs["positions"]
    distance, said = np.linalg.norm(error), outputs["distances"][0]
    rounding = ROUNDING[real] * max(_beam().length, np.max(np.abs(inputs["positions"])))
    return "" if abs(distance - said) <= rounding else f"{said} m is {distance} m"


def _within(real: str, x: Any, lower: Any, upper: Any) -> str:
    excess = np.max(np.maximum(lower - x, x - upper), initial=0.0)
    return "" if excess <= SLACK * LIMIT[real] else f"a limit is exceeded by {excess:.1e}"


def _optimum(real: str, q: Any, gradient: Any) -> str:
    """The projected gradient, for bounds alone."""
    moved = np.clip(q - np.ravel(gradient), -BOUND, BOUND)
    # A gradient is known to rounding of its largest entry: targets may be 1e19 m away.
    off = np.linalg.norm(moved - q) - ROUNDING[real] * np.max(np.abs(gradient))
    return _within(real, q, -BOUND, BOUND) or _small(real, off)


def _small(real: str, off: float) -> str:
    limit = SLACK * STATIONARITY[real]
    return "" if off <= limit else f"optimality conditions are {off:.1e} off"


@cache
def _path_objective() -> ca.Function:
    """plan, u_previous, positions, rotations -> gradient, Gauss–Newton Hessian, over its size."""
    n = _beam().basis.n
    plan, u_previous = ca.SX.sym("plan", 2 * n * STAGES), ca.SX.sym("u_previous", n)
    positions = ca.SX.sym("positions", 3, STAGES)
    rotations = ca.SX.sym("rotations", 3, 3 * STAGES)
    pieces = ca.vertsplit(plan, n)
    parts, last = [], u_previous
    for k in range(STAGES):
        u, x = pieces[2 * k : 2 * k + 2]
        position, rotation = _pose()(x)
        turn = so3.log_error(rotation, rotations[:, 3 * k : 3 * k + 3])
        parts += [
            sqrt(POSITION_WEIGHT) * (position - positions[:, k]),
            sqrt(ATTITUDE_WEIGHT) * turn,
            sqrt(MOVE_WEIGHT) * (u - last),
        ]
        last = u
    errors = ca.vertcat(*parts)
    jacobian = ca.jacobian(errors, plan)
    hessian = jacobian.T @ jacobian
    arguments = [plan, u_previous, positions, rotations]
    at_rest = [ca.repmat(part, 1, STAGES) for part in _pose()(0)]
    largest = ca.Function("size", arguments, [ca.mmax(ca.diag(hessian))])(0, 0, *at_rest)
    return ca.Function("path", arguments, [jacobian.T @ errors / largest, hessian / largest])


def tip_path(real: str, inputs: Arrays, outputs: Arrays) -> str:
    return _path(real, inputs, outputs, steps=False)


def tip_path_step(real: str, inputs: Arrays, outputs: Arrays) -> str:
    return _path(real, inputs, outputs, steps=True)


def _path(real: str, inputs: Arrays, outputs: Arrays, *, steps: bool) -> str:
    n = _beam().basis.n
    inputs_of, states = _planned(outputs, n)
    if np.any(outputs["u"] != inputs_of[0]) or np.any(states[0] != inputs["x"]):
        return "u or the first state are not those of the plan"
    plan = np.hstack([inputs_of, states[1:]]).ravel()
    positions = inputs["positions"].reshape(3, STAGES, order="F")
    rotations = inputs["rotations"].reshape(3, 3 * STAGES, order="F")
    at = _rolled_out(inputs, n) if steps else plan
    gradient, hessian = _path_objective()(at, inputs["u_previous"], positions, rotations)
    gradient = gradient.full().ravel() + hessian.full() @ (plan - at)

    dynamics, model, rates, drift = _constraints(inputs, n)
    gaps = dynamics @ plan - model
    speeds = rates @ plan + drift
    limited = np.hstack([plan, speeds])
    limits = np.hstack([np.full(plan.size, BOUND), np.full(speeds.size, RATE_BOUND)])
    kept = _within(real, gaps, 0, 0) or _within(real, limited, -limits, limits)
    if kept:
        return kept
    rows = np.vstack([np.eye(plan.size), rates])
    reached = SLACK * (STATIONARITY[real] + LIMIT[real])
    columns = [
        *dynamics,
        *-dynamics,
        *rows[limited > limits - reached],
        *-rows[limited < -limits + reached],
    ]
    _, off = nnls(np.transpose(columns), -gradient, maxiter=100 * plan.size)
    return _small(real, off)


def _rolled_out(inputs: Arrays, n: int) -> Any:
    """Where a step linearizes: inputs of the guess within bounds, and the states they lead to."""
    dynamics, model, _, _ = _constraints(inputs, n)
    guess = np.clip(inputs["guess"].reshape(STAGES, 2, n), -BOUND, BOUND)
    is_state = np.tile(np.repeat([False, True], n), STAGES)
    at = np.where(is_state, 0.0, guess.ravel())
    at[is_state] = np.linalg.solve(dynamics[:, is_state], model - dynamics @ at)
    return at


def _planned(outputs: Arrays, n: int) -> tuple[Any, Any]:
    """Inputs u_0 … of the stages and states x_0 …; the plan of the next step lacks the first."""
    states = outputs["states"].reshape(STAGES + 1, n)
    following = outputs["plan"].reshape(STAGES, 2 * n)[: STAGES - 1, :n]
    return np.vstack([outputs["u"], following]), states


def _constraints(inputs: Arrays, n: int) -> tuple[Any, Any, Any, Any]:
    """dynamics @ plan = model, |rates @ plan + drift| ≤ bound: x' = (u + p − x)/τ, by RK4."""
    h = DT / TIME_CONSTANT
    stays = 1 - h + h**2 / 2 - h**3 / 6 + h**4 / 24
    width = 2 * n * STAGES
    dynamics, rates = np.zeros((2, STAGES, n, width))
    model, drift = np.zeros((2, STAGES, n))
    for k in range(STAGES):
        u, end = (np.eye(n, width, 2 * n * k + offset) for offset in (0, n))
        start = np.eye(n, width, 2 * n * k - n) if k else 0.0
        first = 0.0 if k else inputs["x"]
        dynamics[k] = end - stays * start - (1 - stays) * u
        model[k] = (1 - stays) * inputs["p"] + stays * first
        rates[k] = (u - start) / TIME_CONSTANT
        drift[k] = (inputs["p"] - first) / TIME_CONSTANT
    return dynamics.reshape(-1, width), model.ravel(), rates.reshape(-1, width), drift.ravel()


@cache
def _prediction() -> ca.Function:
    """v, x, p, u_previous, goals -> gradient over the objective's size, limited, its Jacobian.

    v holds the inputs over their bound, then the slacks over theirs. `limited` are inputs, slacks
    and states, then the curvatures less and plus their slack.
    """
    beam, n = _beam(), _beam().basis.n
    v, x, before = ca.SX.sym("v", (n + 1) * STAGES), ca.SX.sym("x", n), ca.SX.sym("before", n)
    p, goals = ca.SX.sym("p", n, STAGES), ca.SX.sym("goals", 3 + n, STAGES)
    slacks, state, last = v[n * STAGES :], x, before
    errors, states, over, under = [sqrt(SOFT_WEIGHT) * SOFT_BOUND * slacks], [], [], []
    shape = np.vstack([beam.basis(xi) for xi in (0.0, 0.5, 1.0)])
    for k in range(STAGES):
        u = BOUND * v[k * n : (k + 1) * n]
        h = DT / TIME_CONSTANT
        stays = 1 - h + h**2 / 2 - h**3 / 6 + h**4 / 24
        state = stays * state + (1 - stays) * (u + p[:, k])
        errors += [
            sqrt(POSITION_WEIGHT) * (_pose()(state)[0] - goals[:3, k]),
            sqrt(INPUT_WEIGHT) * (u - goals[3:, k]),
            sqrt(MOVE_WEIGHT) * (u - last),
        ]
        bent, last = ca.DM(shape) @ state / SOFT_BOUND, u
        states.append(state / BOUND)
        over.append(bent - slacks[k])
        under.append(bent + slacks[k])
    residual = ca.vertcat(*errors)
    jacobian = ca.jacobian(residual, v)
    limited = ca.vertcat(v, *states, *over, *under)
    arguments = [v, x, p, before, goals]
    largest = ca.mmax(ca.diag(jacobian.T @ jacobian))
    size = ca.Function("size", arguments, [largest])(0, 0, 0, 0, 0)
    return ca.Function(
        "prediction",
        arguments,
        [jacobian.T @ residual / size, limited, ca.jacobian(limited, v), ca.vertcat(*states)],
    )


def predictive(real: str, inputs: Arrays, outputs: Arrays) -> str:
    n = _beam().basis.n
    later = outputs["plan"].reshape(STAGES, n)[: STAGES - 1].ravel()
    v = np.hstack([outputs["u"], later]) / BOUND
    v = np.hstack([v, outputs["slack"] / SOFT_BOUND])
    p = inputs["p"].reshape(n, STAGES, order="F")
    goals = inputs["reference"].reshape(3 + n, STAGES, order="F")
    found = _prediction()(v, inputs["x"], p, inputs["u_previous"], goals)
    gradient, limited, slopes, states = (value.full() for value in found)
    missed = np.max(np.abs(BOUND * states.ravel() - outputs["states"][n:]))
    if missed > ROUNDING[real]:
        return f"states are {missed:.1e} off"
    bounded, soft = 2 * n * STAGES, len(limited) - (2 * n + 1) * STAGES
    upper = np.ones(len(limited))
    upper[n * STAGES : (n + 1) * STAGES] = np.inf
    upper[-soft // 2 :] = np.inf
    lower = -np.ones(len(limited))
    lower[n * STAGES : (n + 1) * STAGES] = 0
    lower[bounded + STAGES : bounded + STAGES + soft // 2] = -np.inf
    kept = _within(real, limited.ravel(), lower, upper)
    if kept:
        return kept
    near = SLACK * (STATIONARITY[real] + LIMIT[real])
    columns = [*slopes[limited.ravel() > upper - near], *-slopes[limited.ravel() < lower + near]]
    off = np.linalg.norm(gradient)
    if columns:
        off = nnls(np.transpose(columns), -gradient.ravel(), maxiter=100 * v.size)[1]
    # A gradient is known to rounding of its largest entry: goals may be 1e19 m away.
    return _small(real, float(off) - ROUNDING[real] * float(np.max(np.abs(gradient))))


@cache
def _potential() -> ca.Function:
    """q, force -> gradient of strain energy − force · tip, and the elastic part of it."""
    q, force = ca.SX.sym("q", _beam().basis.n), ca.SX.sym("force", 3)
    elastic = ca.gradient(cc.strain_energy(_beam(), q), q)
    total = elastic - ca.gradient(ca.dot(force, _pose()(q)[0]), q)
    slightly = ca.Function("stiffness", [q], [ca.mmax(ca.diag(ca.jacobian(elastic, q)))])(0)
    bend = 1e-3 / _beam().length * slightly
    return ca.Function("potential", [q, force], [total, elastic, bend])


def equilibrium(real: str, inputs: Arrays, outputs: Arrays) -> str:
    total, elastic, bend = (x.full().ravel() for x in _potential()(outputs["q"], inputs["force"]))
    largest = max(*np.abs(elastic), *np.abs(elastic - total), *bend)
    off = np.linalg.norm(total) / largest
    return _within(real, outputs["q"], -BOUND, BOUND) or _small(real, off)
