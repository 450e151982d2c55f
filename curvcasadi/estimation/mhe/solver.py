"""Solver of a window of samples."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np

from curvcasadi.estimation.mhe.certificate import window_certificate
from curvcasadi.estimation.mhe.window import WindowProblem
from curvcasadi.solvers.certificate import Bounds
from curvcasadi.solvers.settings import SqpSettings
from curvcasadi.solvers.sqp import SHOOTING, GaussNewton, gauss_newton_sqp


def window_solver(problem: WindowProblem, settings: SqpSettings) -> GaussNewton:
    """Solver over the nodes, stacked.

    Parameters: x̄, the entries of the upper triangular M with MᵀM = P̄⁻¹, and `problem.data()`.
    """
    size, width = problem.size, problem.node.size
    window = ca.MX.sym("window", width * problem.nodes)
    mean, entries = ca.MX.sym("mean", size), ca.MX.sym("root", size * (size + 1) // 2)
    root = ca.MX(ca.Sparsity.upper(size), entries)
    data = problem.data()
    parameters = ca.veccat(mean, entries, *data.values())
    nodes, arguments = ca.vertsplit(window, width), problem.by_node(data)
    rows = problem.linear_rows()
    residuals = [problem.residual(s, *given) for s, given in zip(nodes, arguments, strict=True)]
    arrival = root @ (nodes[0][:size] - mean)
    objective = ca.sumsqr(ca.vertcat(arrival, rows @ window, *residuals)) / 2

    gram = _gram(problem)
    blocks = [gram(s, *given) for s, given in zip(nodes, arguments, strict=True)]
    blocks[0] += ca.diagcat(root.T @ root, ca.MX(width - size, width - size))
    hessian = ca.diagcat(*blocks) + rows.T @ rows
    stiffness = _largest(window, parameters, hessian, problem.typical())

    constraints, most = problem.limited_moves(nodes)
    lower, upper = (np.tile(side, problem.nodes) for side in problem.node.bounds)
    solver = gauss_newton_sqp(
        f"{problem.name}_solver",
        window,
        parameters,
        objective / stiffness,
        hessian / stiffness,
        constraints,
        Bounds(lower, upper, -most, most),
        nominal=(0, problem.typical()),
        real=problem.beam.grid.real,
        scaled=False,
        halvings=SHOOTING[problem.beam.grid.real],
        **vars(settings),
    )
    certificate = window_certificate(
        problem, solver.bounds, stiffness, settings.iterations is not None
    )
    return replace(solver, certificate=certificate)


def _largest(window: ca.MX, parameters: ca.MX, hessian: ca.MX, typical: ca.DM) -> float:
    """The largest diagonal entry of the Hessian at rest."""
    f = ca.Function("largest", [window, parameters], [ca.mmax(ca.diag(hessian))])
    return float(f(0, typical))


def _gram(problem: WindowProblem) -> ca.Function:
    """JᵀJ of the residual of one sample."""
    f = problem.residual
    symbols = [ca.MX.sym(key, *f.size_in(key)) for key in f.name_in()]
    jacobian = ca.jacobian(f(*symbols), symbols[0])
    return ca.Function(f"{problem.name}_gram", symbols, [jacobian.T @ jacobian])
