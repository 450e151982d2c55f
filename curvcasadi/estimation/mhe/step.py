"""One step of moving-horizon estimation: a window solved, and what it leaves to the next."""

from __future__ import annotations

import casadi as ca
import numpy as np

from curvcasadi.estimation import ud
from curvcasadi.estimation.mhe.solver import window_solver
from curvcasadi.estimation.mhe.window import WindowProblem
from curvcasadi.estimation.process import predict_function
from curvcasadi.estimation.samples import samples_function
from curvcasadi.solvers.certificate import TOLERANCES
from curvcasadi.solvers.settings import SqpSettings


def arrival_function(problem: WindowProblem) -> ca.Function:
    """(x̄, factor of P̄, node_0, its sample) -> the same of the next window, filtered.

    The sample, linearized at the node, corrects x̄ and P̄ row by row; then a step of the process.
    The unknowns stand before the state, where leaving them out marginalizes.
    """
    f, size, other = problem.residual, problem.size, problem.node.size - problem.size
    mean, factor = ca.MX.sym("mean", size), ca.MX.sym("factor", ca.Sparsity.upper(size))
    symbols = [ca.MX.sym(key, *f.size_in(key)) for key in f.name_in()]
    node = symbols[0]
    state, unknown = node[:size, :], node[size:, :]
    residual = f(*symbols)
    slope = ca.jacobian(residual, node)
    rows = ca.densify(ca.horzcat(slope[:, size:], slope[:, :size]).T)

    both = ca.diagcat(ca.MX(ca.diag(ca.DM(problem.deviations**2))), factor)
    before = ca.project(both, ca.Sparsity.upper(both.shape[0]))
    belief = ud.belief_of(before, ca.vertcat(-unknown, mean - state))
    columns = ca.horzsplit(ca.vertcat(rows, residual.T))
    belief, _ = ud.measure_rows(belief, columns, np.ones(len(columns)), np.inf)
    after, error = ud.split_belief(belief, problem.node.size)
    predict = predict_function(f"{problem.name}_predict", problem.process)
    outputs = predict(state + error[other:], after[other:, other:], problem.dt)
    return ca.Function(
        f"{problem.name}_arrival", [mean, factor, *symbols], [*outputs], {"cse": True}
    )


def information_root(size: int) -> ca.Function:
    """factor of P = U D Uᵀ -> M = D^{-1/2} U⁻¹, upper triangular, with MᵀM = P⁻¹."""
    factor = ca.SX.sym("factor", ca.Sparsity.upper(size))
    root = ca.SX(factor.sparsity())
    for i in range(size):
        root[i, i] = 1 / ca.sqrt(factor[i, i])
        for j in range(i + 1, size):
            root[i, j] = -sum(root[i, k] * factor[k, j] for k in range(i, j))
    return ca.Function("information_root", [factor], [root], {"cse": True})


def step_function(problem: WindowProblem, settings: SqpSettings) -> ca.Function:
    """What `ShapeMhe.step` is."""
    size, nodes = problem.size, problem.nodes
    inputs = {
        "arrival_mean": ca.MX.sym("arrival_mean", size),
        "arrival_factor": ca.MX.sym("arrival_factor", ca.Sparsity.upper(size)),
        "measured": ca.MX.sym("measured", problem.channels.layout.size, nodes),
        "guess": ca.MX.sym("guess", problem.node.size, nodes),
    }
    known = {key: ca.MX.sym(key, r, c * nodes) for key, (r, c) in problem.known_shapes.items()}
    mean, factor, measured, guess = inputs.values()
    clean = samples_function(problem.sensors)
    pairs = [clean(sample) for sample in ca.horzsplit(measured)]
    samples, seen = (ca.horzcat(*columns) for columns in zip(*pairs, strict=True))
    data = {"samples": samples, "seen": seen, **known}

    solver = window_solver(problem, settings)
    root = information_root(size)(factor)
    parameters = ca.veccat(mean, root.nz[:], *data.values())
    found, violation, stationarity = solver(ca.vec(guess), parameters)
    window = ca.reshape(found, problem.node.size, nodes)
    states, last = window[:size, :], window[:, -1]
    after = arrival_function(problem)(mean, factor, window[:, 0], *problem.by_node(data)[0])
    ahead = ca.vertcat(ca.DM(ca.sparsify(ca.DM(problem.transition))) @ last[:size], last[size:, :])
    outputs = {
        "state": last[:size],
        "states": states,
        "arrival_mean_after": after[0],
        "arrival_factor_after": after[1],
        "guess_after": ca.horzcat(window[:, 1:], ahead),
        "violation": violation / TOLERANCES[problem.beam.grid.real].limit,
        "stationarity": stationarity,
    }
    arguments = {**inputs, **known}
    return ca.Function(
        problem.name, [*arguments.values()], [*outputs.values()], [*arguments], [*outputs]
    )
