"""Model predictive control of the tip along a path of poses, one step as a Function."""

from __future__ import annotations

import casadi as ca
import numpy as np

from curvcasadi.control.model import ControlModel
from curvcasadi.control.step import rk4_step
from curvcasadi.lie import so3
from curvcasadi.ocp.targets import rotations_defect
from curvcasadi.solvers.certificate import TOLERANCES, Bounds, larger
from curvcasadi.solvers.settings import SqpSettings, sqp_settings
from curvcasadi.solvers.sqp import SHOOTING, gauss_newton_sqp
from curvcasadi.symbolic.expressions import (
    Array,
    Number,
    count,
    function_name,
    instance,
    numeric,
    positive,
)


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
    qp_solver: str = "qrqp",
    settings: SqpSettings | None = None,
    name: str = "tip_path_step",
) -> ca.Function:
    """One step of a tip-path MPC: state and path in, input out.

    Minimizes over the inputs u_0 … u_{N−1} and states x_1 … x_N

        ½ Σ_k position_weight |p_k − p_d,k|² + attitude_weight |log(R_d,kᵀ R_k)|²
          + ½ Σ_k move_weight |u_k − u_{k−1}|²

    over the stages k = 1 … N of poses and 0 … N − 1 of inputs, subject to the model (Runge–Kutta 4,
    inputs held), the bounds in its layouts, |dx/dt| ≤ rate_bound at every stage and
    |K_x|, |K_y|, |K_z| ≤ curvature_bound at the model's stations. Gauss–Newton `sqpmethod` and
    multiple shooting; with `qrqp` it becomes self-contained C.

    Parameters
    ----------
    model : with outputs position, rotation and curvature, such as `kinematic_model`
    dt, horizon : stage length, s, and number N of stages
    position_weight, attitude_weight, move_weight : 1/m², 1/rad², m²/rad²
    rate_bound : rad/(m s), one number or one per state; curvature_bound : rad/m, one or three
    iterations : None to converge, 1 for a real-time iteration (one quadratic program, full step)
    max_iter : programs at most where it converges
    qp_solver : "qrqp", which alone becomes self-contained C, or another of CasADi's for singular
        Hessians. Where many bounds hold at once, far from the path with rates at their bounds, one
        in ten single programs of `qrqp` fails, which the last two outputs tell: do not apply `u`
        then. "qpoases" does not fail there.
    settings : iterations, max_iter and qp_solver in one object, in place of these

    Returns
    -------
    casadi.Function
        Inputs: x (n, 1), p (m, 1), u_previous, positions (3, N), m, and rotations (3, 3 N), local
        to parent, at the ends of the stages, and guess (the last one's plan; zeros at first).
        There is no input rotations where attitude_weight = 0.
        Outputs: u, the input to apply now; plan, the guess for the next step, shifted by a stage;
        states (n, N + 1); violation (1, 1): the excess over bounds and of the model, or of a
        squared element angle over what is allowed, relative, over 1e-6 (`ControlModel.real` float:
        1e-5), or error of a rotation that is none over 1e-2; stationarity (1, 1): what is left of
        the optimality conditions, of the last program for a number of iterations, over 1e-8 (float:
        1e-6). At most 1 both, where `u` may be applied. Element angles of the states are checked,
        not kept, and those of inputs are not: bound the weights so that they are. Where its steps
        lead to what cannot be computed, after inputs out of all proportion, CasADi raises.
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
    if solving.qp_solver == "qrqp":
        _refuse_frozen(model)
    nx, nu = model.x.size, model.u.size
    step = rk4_step(model, dt)
    attitudes = float(weights[1]) > 0
    residual = _stage_residual(model, *np.sqrt(weights[:2]))

    x0, p, u_previous = (
        ca.MX.sym("x", nx),
        ca.MX.sym("p", model.p.size),
        ca.MX.sym("u_previous", nu),
    )
    positions = ca.MX.sym("positions", 3, stages)
    rotations = ca.MX.sym("rotations", 3, 3 * stages if attitudes else 0)
    plan = ca.MX.sym("plan", (nu + nx) * stages)
    inputs, ends = _unpack(plan, nu, nx, stages)
    starts = [x0, *ends[:-1]]

    wanted = [ca.horzsplit(positions), *([ca.horzsplit(rotations, 3)] if attitudes else [])]
    goals = [*zip(*wanted, strict=True)]
    errors = [residual(x, p, *goal) for x, goal in zip(ends, goals, strict=True)]
    moves = [u - last for u, last in zip(inputs, [u_previous, *inputs[:-1]], strict=True)]
    objective = ca.sumsqr(ca.vertcat(*errors)) / 2
    objective += weights[2] * ca.sumsqr(ca.vertcat(*moves)) / 2
    hessian = _hessian(residual, ends, p, goals, weights[2], nu)

    limits = _Limits(model, rate_bound, curvature_bound)
    gaps = [end - step(x, u, p) for x, u, end in zip(starts, inputs, ends, strict=True)]
    constraints = ca.vertcat(
        *gaps, *(limits.of(*at, p) for at in zip(starts, ends, inputs, strict=True))
    )
    parameters = ca.veccat(x0, p, u_previous, positions, rotations)
    stage_bounds = [
        np.concatenate(side) for side in zip(model.u.bounds, model.x.bounds, strict=True)
    ]
    lbx, ubx = (np.tile(side, stages) for side in stage_bounds)
    closed = np.zeros(nx * stages)
    lbg = np.concatenate([closed, *[limits.lower] * stages])
    ubg = np.concatenate([closed, *[limits.upper] * stages])
    solver = gauss_newton_sqp(
        f"{name}_solver",
        plan,
        parameters,
        objective,
        hessian,
        constraints,
        Bounds(lbx, ubx, lbg, ubg),
        nominal=(0, _at_rest(model, stages, attitudes)),
        real=model.real,
        halvings=SHOOTING[model.real],
        **vars(solving),
    )

    guess = ca.MX.sym("guess", plan.shape[0])
    best, violation, stationarity = solver(guess, parameters)
    applied, states = _unpack(best, nu, nx, stages)
    shifted = ca.vertcat(best[nu + nx :], best[-(nu + nx) :])
    turned = [model.angles(state) - 1 for state in states] if model.angles else []
    violation = larger(violation, ca.mmax(ca.vertcat(0, *turned)))
    violation = larger(violation / TOLERANCES[model.real].limit, rotations_defect(rotations))
    arguments = {"x": x0, "p": p, "u_previous": u_previous, "positions": positions}
    arguments |= ({"rotations": rotations} if attitudes else {}) | {"guess": guess}
    return ca.Function(
        name,
        [*arguments.values()],
        [applied[0], shifted, ca.horzcat(x0, *states), violation, stationarity],
        [*arguments],
        ["u", "plan", "states", "violation", "stationarity"],
    )


def _refuse_frozen(model: ControlModel) -> None:
    """`qrqp` cannot tell what holds a state that its bounds and those of its input hold."""
    frozen = [bool(np.any(lower == upper)) for lower, upper in (model.x.bounds, model.u.bounds)]
    if all(frozen):
        raise ValueError(
            "model: expected room between the bounds of every state and input, found some without: "
            "leave frozen weights out of the basis, or take qp_solver='qpoases'"
        )


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


def _stage_residual(
    model: ControlModel, position_scale: float, attitude_scale: float
) -> ca.Function:
    """Weighted pose error (6, 1) at the end of a stage: (x, p, position, rotation).

    Without a weight of attitudes it is that of the position, (3, 1): (x, p, position).
    """
    x, p = ca.MX.sym("x", model.x.size), ca.MX.sym("p", model.p.size)
    position, rotation = ca.MX.sym("position", 3), ca.MX.sym("rotation", 3, 3)
    y = model.y.split(model.output(x, ca.MX.zeros(model.u.size), p))
    distance = position_scale * (y["position"] - position)
    if not attitude_scale:
        return ca.Function("tip_error", [x, p, position], [distance])
    desired = so3.orthonormal(rotation)
    angle = attitude_scale * so3.log_error(ca.reshape(y["rotation"], 3, 3), desired)
    return ca.Function("tip_error", [x, p, position, rotation], [ca.vertcat(distance, angle)])


def _hessian(
    residual: ca.Function,
    ends: list[ca.MX],
    p: ca.MX,
    goals: list[tuple[ca.MX, ...]],
    move_weight: float,
    nu: int,
) -> ca.MX:
    """Gauss–Newton Hessian over u_0, x_1, u_1, x_2, …: poses stage by stage, moves between them."""
    x = ca.MX.sym("x", ends[0].shape[0])
    symbols = [ca.MX.sym(f"s{i}", *residual.size_in(i)) for i in range(1, residual.n_in())]
    jacobian = ca.jacobian(residual(x, *symbols), x)
    gram = ca.Function("tip_gauss_newton", [x, *symbols], [jacobian.T @ jacobian])
    blocks: list[ca.MX] = []
    for end, goal in zip(ends, goals, strict=True):
        blocks += [ca.MX(nu, nu), gram(end, p, *goal)]
    return ca.diagcat(*blocks) + move_weight * _moves_matrix(len(ends), nu, x.shape[0])


def _moves_matrix(stages: int, nu: int, nx: int) -> ca.DM:
    """Matrix of Σ |u_k − u_{k−1}|² over u_0, x_1, u_1, x_2, …"""
    size = (nu + nx) * stages
    difference = ca.DM(nu * stages, size)
    for k in range(stages):
        for i in range(nu):
            difference[k * nu + i, k * (nu + nx) + i] = 1
            if k:
                difference[k * nu + i, (k - 1) * (nu + nx) + i] = -1
    return difference.T @ difference


class _Limits:
    """Rates at a stage's start and curvatures at its end, with their bounds."""

    def __init__(
        self, model: ControlModel, rate_bound: Number | None, curvature_bound: Number | None
    ) -> None:
        self._model = model
        self._rates, rates = _spread("rate_bound", rate_bound, model.x.size)
        of_station, three = _spread("curvature_bound", curvature_bound, 3)
        stations = next(part.size for part in model.y.parts if part.name == "curvature") // 3
        self._curvatures = [3 * k + i for k in range(stations) for i in of_station]
        self.upper = np.concatenate([rates, np.tile(three, stations)])
        self.lower = -self.upper

    def of(self, start: ca.MX, end: ca.MX, u: ca.MX, p: ca.MX) -> ca.MX:
        """The bounded entries of one stage."""
        rates = self._model.xdot(start, u, p)[self._rates, :]
        y = self._model.y.split(self._model.output(end, u, p)) if self._curvatures else None
        return ca.vertcat(rates, y["curvature"][self._curvatures, :] if y else ca.MX(0, 1))


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
