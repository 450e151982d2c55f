"""The window of samples as a problem in stages, whose inputs have unit variance beforehand.

A stage ends at a sample. Its input (w, v) drives the state and is what else the sample depends on:

    x_0 = x̄ + M⁻¹ w_0,   x_k = F x_{k−1} + B w_k,   unknown_k = σ v_k,   M⁻¹ M⁻ᵀ = P̄,  B Bᵀ = Q

so that the objective is ½ Σ |w_k|² + |v_k|² + |residual/noise|². Its Hessian is at least the
identity whatever the units, and what a Newton step would still take from the objective bounds the
distance to the optimum in standard deviations.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from curvcasadi.estimation.mhe.window import WindowProblem
from curvcasadi.estimation.samples import samples_function
from curvcasadi.solvers.certificate import TOLERANCES, Bounds
from curvcasadi.solvers.gauss_newton import GaussNewton
from curvcasadi.solvers.settings import SqpSettings
from curvcasadi.solvers.stages import Stages
from curvcasadi.symbolic.expressions import Array, Real

#: Error of an estimate that is called solved, in its standard deviations. In single precision
#: the rounding of residuals alone leaves some 0.1 of the bound.
TOLERANCE: dict[Real, float] = {"double": 1e-4, "float": 0.3}


def window_solver(problem: WindowProblem, settings: SqpSettings) -> GaussNewton:
    """Solver over the inputs of all stages.

    Parameters: the state before the first stage (zeros, 1), (x̄, entries of M⁻¹), zeros, and data of
    all samples. States: the node of each sample, and 1 before the first.
    """
    real = problem.beam.grid.real
    limits, lower, upper = _limits(problem)
    whole = _stages(problem, limits, 1.0)
    at_rest = whole.evaluate("at_rest")(x=0, p=_typical(problem))
    unit = 1 / float(ca.mmax(ca.diag(at_rest["hessian"])))
    stages = _stages(problem, limits, unit)
    bounds = Bounds(-ca.inf, ca.inf, np.tile(lower, problem.nodes), np.tile(upper, problem.nodes))
    return GaussNewton(
        name=f"{problem.name}_solver",
        linearization=stages.evaluate(f"{problem.name}_linearization"),
        values=stages.rollout(f"{problem.name}_rollout"),
        bounds=bounds,
        real=real,
        residual_unit=unit**0.5 * TOLERANCE[real] / TOLERANCES[real].decrement,
        flat=0.0,
        stationarity=0.0,
        stages=stages,
        **vars(settings),
    )


def _stages(problem: WindowProblem, limits: ca.Function, unit: float) -> Stages:
    return Stages(
        count=problem.nodes,
        error=_error(problem, unit**0.5),
        step=_step(problem),
        limits=limits,
        move_weight=0.0,
        input_weight=unit,
    )


def _step(problem: WindowProblem) -> ca.Function:
    """((node, is_first), input, (x̄, M⁻¹)) -> the same at the next sample, its slopes transposed."""
    size, width = problem.size, problem.node.size
    state, u = ca.MX.sym("state", width + 1), ca.MX.sym("input", width)
    p = ca.MX.sym("p", size + size * (size + 1) // 2)
    root = ca.MX(ca.Sparsity.upper(size), p[size:, :])
    first = state[width]
    F, B = (ca.sparsify(ca.DM(m)) for m in (problem.transition, problem.drive))
    driven = first * root + (1 - first) * B
    end = first * p[:size, :] + (1 - first) * (F @ state[:size, :]) + driven @ u[:size, :]
    sigma = ca.diag(ca.DM(problem.deviations))
    node = ca.vertcat(end, sigma @ u[size:, :])
    by_input = ca.vertcat(ca.diagcat(driven, sigma), ca.MX(1, width))
    rest = width + 1 - size
    by_state = ca.diagcat((1 - first) * F, ca.MX(rest, rest))
    return ca.Function(
        f"{problem.name}_stage_step",
        [state, u, p],
        [ca.vertcat(node, 0), by_state.T, by_input.T],
    )


def _error(problem: WindowProblem, scale: float) -> ca.Function:
    """((node, is_first), p, sample …) -> residual times `scale`, and its slope."""
    f, size = problem.residual, problem.size
    state = ca.MX.sym("state", problem.node.size + 1)
    p = ca.MX.sym("p", size + size * (size + 1) // 2)
    node = ca.MX.sym("node", problem.node.size)
    data = [ca.MX.sym(key, *shape) for key, shape in problem.data_shapes().items()]
    residual = f(node, *data)
    at = ca.Function("at", [node, *data], [residual, ca.jacobian(residual, node)])
    value, slope = at(state[:-1, :], *data)
    slope = ca.horzcat(ca.densify(slope), ca.MX.zeros(value.numel()))
    return ca.Function(
        f"{problem.name}_stage_error", [state, p, *data], [scale * value, scale * slope]
    )


def _limits(problem: WindowProblem) -> tuple[ca.Function, Array, Array]:
    """(start, input, end, p) -> bounded entries and moves of a stage, their slopes; the limits."""
    size, width = problem.size, problem.node.size
    start, end = (ca.MX.sym(key, width + 1) for key in ("start", "end"))
    u, p = ca.MX.sym("input", width), ca.MX.sym("p", size + size * (size + 1) // 2)
    lower, upper = problem.node.bounds
    bounded = np.flatnonzero(np.isfinite(lower) | np.isfinite(upper)).tolist()
    moved = np.flatnonzero(np.isfinite(problem.moves)).tolist()
    choose = ca.DM.eye(width + 1)
    ends = ca.sparsify(choose[bounded + moved, :])
    starts = ca.sparsify(ca.vertcat(ca.DM(len(bounded), width + 1), choose[moved, :]))
    # No move leads to the first sample.
    kept = ca.vertcat(ca.DM.ones(len(bounded)), ca.repmat(1 - start[width], len(moved)))
    values = kept * (ends @ end - starts @ start)
    slopes = ca.horzcat(-ca.diag(kept) @ starts, ca.MX(values.numel(), width), ca.diag(kept) @ ends)
    most = problem.moves[moved]
    return (
        ca.Function(f"{problem.name}_stage_limits", [start, u, end, p], [values, slopes.T]),
        np.concatenate([lower[bounded], -most]),
        np.concatenate([upper[bounded], most]),
    )


def _typical(problem: WindowProblem) -> ca.DM:
    """Parameters with all samples there, and P̄ what drives the state over the window."""
    absent = ca.DM.nan(problem.channels.layout.size)
    samples, seen = samples_function(problem.sensors)(absent)
    motion = [
        ca.DM.eye(3) if key == "attitude" else ca.DM(*shape)
        for key, shape in problem.known_shapes.items()
    ]
    parts = [ca.repmat(ca.densify(m), 1, problem.nodes) for m in (samples, seen + 1, *motion)]
    width, size = problem.node.size, problem.size
    root = ca.DM(problem.nodes**0.5 * problem.drive)
    entries = ca.project(root, ca.Sparsity.upper(size)).nz[:]
    nothing = ca.DM.zeros(width)
    begin = [nothing, ca.DM(1), ca.DM.zeros(size), entries, nothing]
    return ca.DM(ca.veccat(*begin, *parts))
