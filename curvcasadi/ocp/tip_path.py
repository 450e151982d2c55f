"""Model predictive control of the tip along a path of poses, one step as a Function."""

from __future__ import annotations

import casadi as ca
import numpy as np

from curvcasadi.control.model import ControlModel, symbols_of
from curvcasadi.control.step import rk4_step
from curvcasadi.lie import so3
from curvcasadi.ocp.pose_error import attitude_error, position_error
from curvcasadi.ocp.targets import rotations_defect
from curvcasadi.solvers.certificate import TOLERANCES, Bounds, larger
from curvcasadi.solvers.embedded import EmbeddedSolver, solver_function
from curvcasadi.solvers.gauss_newton import GaussNewton
from curvcasadi.solvers.settings import SqpSettings, sqp_settings
from curvcasadi.solvers.stages import Stages
from curvcasadi.symbolic.expressions import (
    Array,
    Number,
    count,
    function_name,
    instance,
    numeric,
    positive,
)

#: Halvings of a step, at most, where it converges.
HALVINGS = 6
#: Of real-time iterations, m²/rad², over the larger weight of positions and attitudes:
#: `python -m benchmarks` shows how six wings follow a path with others.
DAMPING = 0.1


def tip_path_step_function(
    model: ControlModel,
    *,
    dt: float,
    horizon: int,
    position_weight: float = 1.0,
    attitude_weight: float = 1.0,
    move_weight: float = 1e-2,
    rate_bound: Number | None = None,
    curvature_bound: Number | None = None,
    iterations: int | None = None,
    max_iter: int = 100,
    damping: float | None = None,
    qp_solver: str = "own",
    settings: SqpSettings | None = None,
    name: str = "tip_path_step",
) -> ca.Function:
    """One step of a tip-path MPC: state and path in, input out.

    Minimizes over the inputs u_0 … u_{N−1} and states x_1 … x_N

        ½ Σ_k position_weight |p_k − p_d,k|² + attitude_weight |log(R_d,kᵀ R_k)|²
          + ½ Σ_k move_weight |u_k − u_{k−1}|²

    over the stages k = 1 … N of poses and 0 … N − 1 of inputs, subject to the model (Runge–Kutta 4,
    inputs held), the bounds in its layouts, |dx/dt| ≤ rate_bound at every stage and
    |K_x|, |K_y|, |K_z| ≤ curvature_bound at the model's stations. Gauss–Newton on the problem
    condensed to its inputs: states follow from them. It becomes self-contained C.

    Parameters
    ----------
    model : ControlModel
        With outputs position, rotation and curvature, such as `kinematic_model`.
    dt : float
        Length of a stage, s.
    horizon : int
        Number N of stages.
    position_weight, attitude_weight, move_weight : float
        1/m², 1/rad², m²/rad². One of the first two may be zero.
    rate_bound : float or array, shape (n,), optional
        rad/(m s), of all states or of each.
    curvature_bound : float or array, shape (3,), optional
        rad/m, of all components or of each.
    iterations : int, optional
        None to converge, 1 for a real-time iteration (one quadratic program, full step).
    max_iter : int
        Programs at most where it converges.
    damping : float, optional
        Weight of ½ Σ |u_k − guess_k|² in every program, m²/rad²: steps stay near the guess, and
        move along directions that the path hardly sees by little. A converged plan is the same
        with any. Unless given it is, with `iterations`, 0.1 m²/rad² times the larger of the weights
        of positions and attitudes, and 0 where it converges.
    qp_solver : str
        "own" becomes self-contained C; in Python it is CasADi's DAQP on the same numbers. Or
        another of CasADi's QP solvers, such as "qpoases", for Python alone.
    settings : SqpSettings, optional
        iterations, max_iter and qp_solver in one object, in place of these.
    name : str
        Name of the Function, also in generated C.

    Returns
    -------
    casadi.Function
        Inputs: x (n, 1), p (m, 1), u_previous, positions (3, N), m, and rotations (3, 3 N), local
        to parent, at the ends of the stages, and guess (the last one's plan, of which the inputs
        count; zeros at first). There is no input rotations where attitude_weight = 0. Outputs: u,
        the input to apply now; plan u_0, x_1, u_1, …, the guess for the next step, shifted by a
        stage; states (n, N + 1), along the model; violation (1, 1): the excess over bounds, or of a
        squared element angle over what is allowed, relative, over 1e-6 (`ControlModel.real` float:
        1e-5), or error of a rotation that is none over 1e-2; stationarity (1, 1): what is left of
        the optimality conditions, of the last program for a number of iterations, over 1e-8 (float:
        1e-6); distances (N, 1): m, by which the plan, a compromise of the weights, misses the path
        at the ends of the stages. At most 1 are violation and stationarity where `u` may be
        applied. Element angles of the states are checked,
        not kept, and those of inputs are not: bound the weights so that they are.
    """
    function_name("name", name)
    instance("model", model, ControlModel)
    stages = count("horizon", horizon)
    weights = [
        numeric("position_weight", positive("position_weight", position_weight, zero=True)),
        numeric("attitude_weight", positive("attitude_weight", attitude_weight, zero=True)),
        numeric("move_weight", positive("move_weight", move_weight)),
    ]
    solving = sqp_settings(settings, iterations=iterations, max_iter=max_iter, qp_solver=qp_solver)
    if damping is None:
        largest = max(float(weights[0]), float(weights[1]))
        damping = 0.0 if solving.iterations is None else DAMPING * largest
    if not any(float(weight) for weight in weights[:2]):
        raise ValueError("position_weight, attitude_weight: expected one above zero, found none")
    weights.append(numeric("damping", positive("damping", damping, zero=True)))
    limits = _Limits(model, rate_bound, curvature_bound)
    described = _stages(name, model, dt, stages, limits, weights)
    unit = 1 / _largest(described, _at_rest(model, stages, float(weights[1]) > 0))
    described = _stages(name, model, dt, stages, limits, [unit * float(w) for w in weights])
    lower, upper = (np.tile(side, stages) for side in model.u.bounds)
    problem = GaussNewton(
        name=f"{name}_solver",
        linearization=described.evaluate(f"{name}_linearization"),
        values=described.rollout(f"{name}_rollout"),
        bounds=Bounds(lower, upper, np.tile(limits.lower, stages), np.tile(limits.upper, stages)),
        real=model.real,
        halvings=HALVINGS,
        stages=described,
        **vars(solving),
    )
    begin, finish = _ends(name, model, stages, float(weights[1]) > 0)
    return solver_function(name, EmbeddedSolver(problem=problem, begin=begin, finish=finish))


def _stages(
    name: str, model: ControlModel, dt: float, count: int, limits: _Limits, weights: list[Number]
) -> Stages:
    """The problem for weights of positions, attitudes, moves and damping."""
    position, attitude, move, damping = (float(weight) for weight in weights)
    return Stages(
        count=count,
        error=_stage_error(f"{name}_stage_error", model, position**0.5, attitude**0.5),
        step=_stage_step(f"{name}_stage_step", model, dt),
        limits=limits.function(f"{name}_stage_limits"),
        move_weight=move,
        damping=damping,
    )


def _largest(stages: Stages, parameters: ca.DM) -> float:
    """Largest diagonal entry of the Hessian at rest, by which the objective is scaled."""
    at_rest = stages.evaluate("at_rest")(x=0, p=parameters)
    return float(ca.mmax(ca.diag(at_rest["hessian"])))


def _ends(
    name: str, model: ControlModel, stages: int, attitudes: bool
) -> tuple[ca.Function, ca.Function]:
    """What the solver begins from, and what is made of its solution."""
    nx, nu = model.x.size, model.u.size
    inputs = {
        "x": ca.MX.sym("x", nx),
        "p": ca.MX.sym("p", model.p.size),
        "u_previous": ca.MX.sym("u_previous", nu),
        "positions": ca.MX.sym("positions", 3, stages),
        **({"rotations": ca.MX.sym("rotations", 3, 3 * stages)} if attitudes else {}),
        "guess": ca.MX.sym("guess", (nu + nx) * stages),
    }
    guess = ca.vertcat(*_unpack(inputs["guess"], nu, nx, stages)[0])
    rotations = inputs.get("rotations", ca.MX(3, 0))
    proper = [_orthonormal()(part) for part in ca.horzsplit(rotations, 3)] if attitudes else []
    begin = ca.Function(
        f"{name}_solver_begin",
        [*inputs.values()],
        [guess, ca.veccat(*[*inputs.values()][:4], *proper)],
        [*inputs],
        ["start", "parameters"],
    )
    found, states = ca.MX.sym("found", nu * stages), ca.MX.sym("states", nx, stages + 1)
    violation, stationarity, before = (ca.MX.sym(key) for key in ("v", "s", "before"))
    applied, ends = ca.vertsplit(found, nu), ca.horzsplit(states)[1:]
    plan = ca.vertcat(*(part for pair in zip(applied, ends, strict=True) for part in pair))
    shifted = ca.vertcat(plan[nu + nx :], plan[-(nu + nx) :])
    turned = [model.angles(state) - 1 for state in ends] if model.angles else []
    excess = larger(violation, ca.mmax(ca.vertcat(0, *turned)))
    excess = larger(excess / TOLERANCES[model.real].limit, rotations_defect(rotations))
    distance, goals = _distance(model), ca.horzsplit(inputs["positions"])
    misses = [distance(x, inputs["p"], goal) for x, goal in zip(ends, goals, strict=True)]
    distances = ca.vertcat(*misses)
    finish = ca.Function(
        f"{name}_solver_finish",
        [*inputs.values(), found, states, violation, stationarity, before],
        [applied[0], shifted, states, excess, stationarity, distances],
        [*inputs, "found", "end_states", "excess", "distance", "before"],
        ["u", "plan", "states", "violation", "stationarity", "distances"],
    )
    return begin, finish


def _distance(model: ControlModel) -> ca.Function:
    """(x, p, position) -> distance of the tip to it, m."""
    x, p = ca.MX.sym("x", model.x.size), ca.MX.sym("p", model.p.size)
    goal = ca.MX.sym("position", 3)
    if model.pose is not None:
        position = model.pose.call([x])[0]
    else:
        position = model.y.split(model.output(x, ca.MX.zeros(model.u.size), p))["position"]
    return ca.Function("tip_distance", [x, p, goal], [ca.norm_2(position - goal)])


def _orthonormal() -> ca.Function:
    """A rotation matrix of few digits -> the rotation that it means."""
    rotation = ca.SX.sym("rotation", 3, 3)
    return ca.Function("orthonormal", [rotation], [so3.orthonormal(rotation)], {"cse": True})


def _at_rest(model: ControlModel, stages: int, attitudes: bool) -> ca.DM:
    """Parameters (x, p, u_previous, positions, rotations) of a path that stays where x = 0 is."""
    x, u, p = (ca.DM.zeros(part.size) for part in (model.x, model.u, model.p))
    y = model.y.split(model.output(x, u, p))
    rotations = ca.repmat(y["rotation"], stages) if attitudes else ca.DM(0, 1)
    return ca.DM(ca.vertcat(x, p, u, ca.repmat(y["position"], stages), rotations))


def _unpack(plan: ca.MX, nu: int, nx: int, stages: int) -> tuple[list[ca.MX], list[ca.MX]]:
    """(inputs, stage ends) of a plan u_0, x_1, u_1, x_2, …"""
    pieces = ca.vertsplit(plan, np.cumsum([0, *[nu, nx] * stages]).tolist())
    return pieces[0::2], pieces[1::2]


def _stage_error(
    name: str, model: ControlModel, position_scale: float, attitude_scale: float
) -> ca.Function:
    """(x, p, position, rotation) -> weighted pose error (6, 1) at a stage's end, and its slope.

    Without a weight of attitudes the error is that of the position, (3, 1): (x, p, position).
    """
    x, p = ca.MX.sym("x", model.x.size), ca.MX.sym("p", model.p.size)
    goals = [ca.MX.sym("position", 3), *([ca.MX.sym("rotation", 3, 3)] if attitude_scale else [])]
    if model.pose is not None:
        position, rotation, jacobian = model.pose.call([x])
        error, slope = position_error(x.numel())(position, rotation, jacobian, goals[0])
        error, slope = position_scale * error, position_scale * slope
        if attitude_scale:
            turned, by_x = attitude_error(x.numel())(rotation, jacobian, goals[1])
            error = ca.vertcat(error, attitude_scale * turned)
            slope = ca.vertcat(slope, attitude_scale * by_x)
        return ca.Function(name, [x, p, *goals], [error, slope])
    y = model.y.split(model.output(x, ca.MX.zeros(model.u.size), p))
    error = position_scale * (y["position"] - goals[0])
    if attitude_scale:
        turned = so3.log_error(ca.reshape(y["rotation"], 3, 3), goals[1])
        error = ca.vertcat(error, attitude_scale * turned)
    return ca.Function(name, [x, p, *goals], [error, ca.densify(ca.jacobian(error, x))])


def _stage_step(name: str, model: ControlModel, dt: float) -> ca.Function:
    """(x, u, p) -> end of the stage, and its transposed slopes by x and u."""
    x, u, p = symbols_of(model)
    end = rk4_step(model, dt)(x, u, p)
    return ca.Function(name, [x, u, p], [end, ca.jacobian(end, x).T, ca.jacobian(end, u).T])


class _Limits:
    """Rates at a stage's start, curvatures and states at its end, with their bounds."""

    def __init__(
        self, model: ControlModel, rate_bound: Number | None, curvature_bound: Number | None
    ) -> None:
        self._model = model
        self._rates, rates = _spread("rate_bound", rate_bound, model.x.size)
        of_station, three = _spread("curvature_bound", curvature_bound, 3)
        stations = next(part.size for part in model.y.parts if part.name == "curvature") // 3
        self._curvatures = [3 * k + i for k in range(stations) for i in of_station]
        least, most = model.x.bounds
        self._states = np.flatnonzero(np.isfinite(least) | np.isfinite(most)).tolist()
        both = np.concatenate([rates, np.tile(three, stations)])
        self.upper = np.concatenate([both, most[self._states]])
        self.lower = np.concatenate([-both, least[self._states]])

    def function(self, name: str) -> ca.Function:
        """(x, u, x_end, p) -> the bounded entries, and their transposed slope by (x, u, x_end)."""
        model = self._model
        x, u, p = symbols_of(model)
        end = ca.MX.sym("end", model.x.size)
        rates = model.xdot(x, u, p)[self._rates, :]
        y = model.y.split(model.output(end, u, p)) if self._curvatures else None
        curvatures = y["curvature"][self._curvatures, :] if y else ca.MX(0, 1)
        values = ca.vertcat(rates, curvatures, end[self._states, :])
        slopes = ca.horzcat(*(ca.jacobian(values, part) for part in (x, u, end)))
        return ca.Function(name, [x, u, end, p], [values, slopes.T])


def _spread(name: str, bound: Number | None, n: int) -> tuple[list[int], Array]:
    """Indices of the finite ones of `n` bounds, and these bounds."""
    if bound is None:
        return [], np.zeros(0)
    try:
        bounds = np.array(np.broadcast_to(np.asarray(bound, dtype=float), (n,)))
    except (TypeError, ValueError):
        bounds = np.full(n, np.nan)
    if not np.all(bounds > 0):
        raise ValueError(f"{name}: expected one or {n} numbers above zero, found {bound!r}")
    finite = np.flatnonzero(np.isfinite(bounds))
    return [int(i) for i in finite], bounds[finite]
