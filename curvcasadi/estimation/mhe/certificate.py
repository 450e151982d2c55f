"""Certificate of the estimate of a window, in standard deviations."""

from __future__ import annotations

import casadi as ca
import numpy as np

from curvcasadi.estimation.mhe.window import MOVES, WindowProblem
from curvcasadi.solvers.certificate import Bounds
from curvcasadi.symbolic.expressions import Real

#: Error of an estimate that is called solved, in standard deviations of what is known before.
#: In single precision the rounding of residuals alone leaves some 0.1 of the bound.
TOLERANCE: dict[Real, float] = {"double": 1e-4, "float": 0.3}


def _gradient(problem: WindowProblem) -> ca.Function:
    """(at, sample …, node) -> Jᵀ (residual + J (node − at)), linearized at `at`."""
    f = problem.residual
    symbols = [ca.MX.sym(key, *f.size_in(key)) for key in f.name_in()]
    node = ca.MX.sym("solution", problem.node.size)
    residual = f(*symbols)
    jacobian = ca.jacobian(residual, symbols[0])
    gradient = jacobian.T @ (residual + jacobian @ (node - symbols[0]))
    return ca.Function(f"{problem.name}_gradient", [*symbols, node], [gradient])


def window_certificate(
    problem: WindowProblem, bounds: Bounds, stiffness: float, linearized: bool
) -> ca.Function:
    """(solution, p, λ_x, λ_g[, at]) -> violation, stationarity.

    With the window as a function of ξ = M (x_0 − x̄), w_k = R (x_k − F x_{k−1}) and v = unknown/σ,
    which have unit variance before the samples, the objective is ½ |ξ, w, v|² and squares of
    residuals, so that its Gauss–Newton Hessian is at least the identity. Its gradient g there, with
    multipliers λ ≥ 0 of the limits, bounds the distance to the optimum, in standard deviations:

        |(ξ, w, v) − optimum| ≤ |g| + √(Σ λ slack)

    With g_k the gradient of residuals and limits by node k:

        λ_N = g_N,  λ_{k−1} = g_{k−1} + Fᵀ λ_k;   by w_k: w_k + R⁻ᵀ λ_k,   by ξ: ξ + M⁻ᵀ λ_0
    """
    size, width, n = problem.size, problem.node.size, problem.node.size * problem.nodes
    solution, at = ca.MX.sym("solution", n), ca.MX.sym("at", n)
    mean, entries = ca.MX.sym("mean", size), ca.MX.sym("root", size * (size + 1) // 2)
    root = ca.MX(ca.Sparsity.upper(size), entries)
    data = problem.data()
    nodes = ca.vertsplit(solution, width)
    constraints, _ = problem.limited_moves(nodes)
    lam_x, lam_g = ca.MX.sym("lam_x", n), ca.MX.sym("lam_g", constraints.shape[0])

    limits = stiffness * (lam_x + ca.jtimes(constraints, solution, lam_g, True))
    gradient = _gradient(problem)
    by_node = [
        gradient(point, *given, node) + limit
        for point, given, node, limit in zip(
            ca.vertsplit(at if linearized else solution, width),
            problem.by_node(data),
            nodes,
            ca.vertsplit(limits, width),
            strict=True,
        )
    ]
    transition, noise_root = (
        ca.sparsify(ca.DM(m)) for m in (problem.transition, problem.noise_root)
    )
    noise = ca.sparsify(ca.DM(np.linalg.inv(problem.noise_root)))
    deviations = ca.DM(problem.deviations)
    found = [
        node[size:, :] / deviations + deviations * g[size:, :]
        for node, g in zip(nodes, by_node, strict=True)
    ]
    adjoint = ca.MX(ca.DM.zeros(size))
    for k in reversed(range(problem.nodes)):
        adjoint = by_node[k][:size] + transition.T @ adjoint
        if k:
            driven = nodes[k][:size] - transition @ nodes[k - 1][:size]
            found.append(noise_root @ driven + noise.T @ adjoint)
    found.append(root @ (nodes[0][:size] - mean) + _transposed_solve(size)(root, adjoint))

    lower, upper = (
        ca.DM(np.concatenate(side)) for side in ((bounds.lbx, bounds.lbg), (bounds.ubx, bounds.ubg))
    )
    values, multipliers = ca.vertcat(solution, constraints), stiffness * ca.vertcat(lam_x, lam_g)
    idle = ca.MX(0)
    for sign, bound in ((1, upper), (-1, lower)):
        finite = [int(i) for i in np.flatnonzero(np.isfinite(bound.full()))]
        if finite:
            slack = ca.fmax(sign * (bound - values)[finite], 0)
            idle += ca.dot(ca.fmax(sign * multipliers[finite], 0), slack)
    # The Euclidean norm, as a maximum would overlook NaN.
    distance = ca.norm_2(ca.vertcat(*found)) + ca.sqrt(idle)
    unit = ca.DM(np.concatenate([np.ones(n), np.full(constraints.shape[0], 1 / MOVES)]))
    violation = ca.mmax(ca.vertcat(0, unit * (lower - values), unit * (values - upper)))
    return ca.Function(
        f"{problem.name}_certificate",
        [solution, ca.veccat(mean, entries, *data.values()), lam_x, lam_g, *([at] * linearized)],
        [violation, distance / TOLERANCE[problem.beam.grid.real]],
    )


def _transposed_solve(size: int) -> ca.Function:
    """(M upper triangular, b) -> M⁻ᵀ b, by substitution."""
    root, b = ca.SX.sym("root", ca.Sparsity.upper(size)), ca.SX.sym("b", size)
    y: list[ca.SX] = []
    for i in range(size):
        y.append((b[i] - sum(root[j, i] * y[j] for j in range(i))) / root[i, i])
    return ca.Function("transposed_solve", [root, b], [ca.vertcat(*y)], {"cse": True})
