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
from curvcasadi.solvers.embedded import EmbeddedSolver, solver_function
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


def deviation_root(size: int) -> ca.Function:
    """factor of P = U D Uᵀ -> M⁻¹ = U D^½, upper triangular, with M⁻¹ M⁻ᵀ = P."""
    factor = ca.SX.sym("factor", ca.Sparsity.upper(size))
    root = ca.SX(factor.sparsity())
    for j in range(size):
        root[j, j] = ca.sqrt(factor[j, j])
        for i in range(j):
            root[i, j] = factor[i, j] * root[j, j]
    return ca.Function("deviation_root", [factor], [root], {"cse": True})


def step_function(problem: WindowProblem, settings: SqpSettings) -> ca.Function:
    """What `ShapeMhe.step` is."""
    size, nodes = problem.size, problem.nodes
    inputs = {
        "arrival_mean": ca.MX.sym("arrival_mean", size),
        "arrival_factor": ca.MX.sym("arrival_factor", ca.Sparsity.upper(size)),
        "measured": ca.MX.sym("measured", problem.channels.layout.size, nodes),
        "guess": ca.MX.sym("guess", problem.node.size, nodes),
    }
    known = problem.known_shapes.items()
    inputs |= {key: ca.MX.sym(key, r, c * nodes) for key, (r, c) in known}
    solver = EmbeddedSolver(
        problem=window_solver(problem, settings),
        begin=_begin(problem, inputs),
        finish=_finish(problem, inputs),
    )
    return solver_function(problem.name, solver)


def _begin(problem: WindowProblem, inputs: dict[str, ca.MX]) -> ca.Function:
    """The step's inputs -> those of the stages that lead along the guess, parameters."""
    size, width = problem.size, problem.node.size
    mean, factor, measured, guess, *motion = inputs.values()
    clean = samples_function(problem.sensors)
    pairs = [clean(sample) for sample in ca.horzsplit(measured)]
    samples, seen = (ca.horzcat(*columns) for columns in zip(*pairs, strict=True))
    root = deviation_root(size)(factor)
    drive, deviations = ca.DM(problem.drive), ca.DM(problem.deviations)
    transition = ca.sparsify(ca.DM(problem.transition))
    stages: list[ca.MX] = []
    expected, driven = mean, root
    for node in ca.horzsplit(guess):
        moved = triangular_solve(size)(driven, node[:size, :] - expected)
        stages.append(ca.vertcat(moved, node[size:, :] / deviations))
        expected, driven = transition @ node[:size, :], ca.MX(drive)
    nothing = ca.MX.zeros(width)
    parameters = [nothing, ca.MX(1), mean, root.nz[:], nothing, samples, seen, *motion]
    return ca.Function(
        f"{problem.name}_solver_begin",
        [*inputs.values()],
        [ca.vertcat(*stages), ca.veccat(*parameters)],
        [*inputs],
        ["start", "parameters"],
    )


def _finish(problem: WindowProblem, inputs: dict[str, ca.MX]) -> ca.Function:
    """The step's inputs and the solution -> the step's outputs."""
    size, width, nodes = problem.size, problem.node.size, problem.nodes
    mean, factor, measured, _, *motion = inputs.values()
    ends = ca.MX.sym("ends", width + 1, nodes + 1)
    window = ends[:width, 1:]
    states, last = window[:size, :], window[:, -1]
    first = [ca.horzsplit(part, part.shape[1] // nodes)[0] for part in motion]
    sample = samples_function(problem.sensors)(measured[:, 0])
    after = arrival_function(problem)(mean, factor, window[:, 0], *sample, *first)
    transition = ca.sparsify(ca.DM(problem.transition))
    ahead = ca.vertcat(transition @ last[:size, :], last[size:, :])
    violation, stationarity, before = (ca.MX.sym(key) for key in ("v", "s", "before"))
    outputs = {
        "state": last[:size, :],
        "states": states,
        "arrival_mean_after": after[0],
        "arrival_factor_after": after[1],
        "guess_after": ca.horzcat(window[:, 1:], ahead),
        "violation": violation / TOLERANCES[problem.beam.grid.real].limit,
        "stationarity": stationarity,
    }
    found = ca.MX.sym("found", width * nodes)
    return ca.Function(
        f"{problem.name}_solver_finish",
        [*inputs.values(), found, ends, violation, stationarity, before],
        [*outputs.values()],
        [*inputs, "found", "ends", "excess", "distance", "before"],
        [*outputs],
    )


def triangular_solve(size: int) -> ca.Function:
    """(R upper triangular, b) -> R⁻¹ b, by substitution."""
    root, b = ca.SX.sym("root", ca.Sparsity.upper(size)), ca.SX.sym("b", size)
    y = [ca.SX(0)] * size
    for i in reversed(range(size)):
        y[i] = (b[i] - sum(root[i, j] * y[j] for j in range(i + 1, size))) / root[i, i]
    return ca.Function("triangular_solve", [root, b], [ca.vertcat(*y)], {"cse": True})
