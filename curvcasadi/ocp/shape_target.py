"""Shape targets as one Function, solved by sequential quadratic programming: exportable as C."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

from curvcasadi.beam import Beam
from curvcasadi.expressions import Number, count, positive
from curvcasadi.ocp.sqp import gauss_newton_sqp
from curvcasadi.ocp.targets import (
    Regularizer,
    Residuals,
    Target,
    checked_problem,
    regularizer_matrix,
    residuals,
    shape_limits,
)

#: (weight of the preference in the objective, the same in the Hessian), stage by stage. From a
#: strong preference, which leads to the right valley, to a weak one, and to none: a last step onto
#: the targets, along the directions that they see. Twice the weight in the Hessian damps
#: Gauss–Newton, which does not know the curvature of the constraint.
_STAGES = ((1e-2, 1e-2), (1e-3, 2e-3), (1e-4, 2e-4), (1e-4, 2e-4), (0.0, 1e-8))
_PREFERENCE_ONLY = ((1.0, 1.0),)


def shape_target_function(
    beam: Beam,
    targets: Sequence[Target],
    *,
    name: str = "shape_target",
    curvature_bound: Number | None = None,
    regularizer: Regularizer = "smoothness",
    regularization: float = 1e-8,
    max_iter: int = 30,
) -> ca.Function:
    """`reach_shape` as one Function: q_guess, positions, rotations -> q, distances, angles, miss.

    The unweighted targets e(q) = 0 are met by the method of multipliers: with y ← y + e, each stage
    minimizes

        ½ |e|² + y·e + a (½ Σ weight (|Δp|²/L² + |Δφ|²) + ½ regularization qᵀ W q)

    by Gauss–Newton `sqpmethod` with `qrqp`, within the bounds of `reach_shape`; a falls to zero.
    One solver serves all stages, so that generated C holds it once. Redundant targets are no
    obstacle, and of unreachable ones it comes near the nearest.

    Parameters
    ----------
    targets : stations and kinds; their numbers arrive as inputs
    max_iter : iterations of one stage; there are five, or one where every target is weighted

    Returns
    -------
    casadi.Function
        Inputs: q_guess (n, 1), rad/m; positions (3, P), m, if any; rotations (3, 3 R), if any; in
        the order of `targets`. Outputs: q (n, 1), rad/m; distances (P, 1), m; angles (R, 1), rad;
        miss (1, 1): the largest error of an unweighted target over its tolerance, at most 1 where
        they are met. It never raises: check `miss`. From an exactly straight guess a target on
        the beam's axis has no gradient: guess a slight bend.
    """
    targets = checked_problem(beam, targets)
    count("max_iter", max_iter)
    positive("regularization", regularization)
    q = ca.MX.sym("q", beam.basis.n)
    limits = shape_limits(beam, q, curvature_bound)
    problem = residuals(beam, targets, q)
    constrained = len(problem.tolerances) > 0
    weighted = problem.weighted.numel() > 0
    preference = regularizer_matrix(beam, regularizer) * (regularization if weighted else 1.0)

    values = ca.veccat(problem.positions, problem.rotations)
    multipliers = ca.MX.sym("multipliers", problem.to_meet.numel())
    in_objective, in_hessian = ca.MX.sym("a"), ca.MX.sym("b")
    parameters = ca.vertcat(values, multipliers, in_objective, in_hessian)
    objective = ca.sumsqr(problem.to_meet) / 2 + ca.dot(multipliers, problem.to_meet)
    objective += in_objective * (ca.sumsqr(problem.weighted) + q.T @ preference @ q) / 2
    jacobian, weighted_jacobian = (
        ca.jacobian(part, q) for part in (problem.to_meet, problem.weighted)
    )
    hessian = jacobian.T @ jacobian
    hessian += in_hessian * (weighted_jacobian.T @ weighted_jacobian + preference)
    solver = gauss_newton_sqp(
        name + "_stage", q, parameters, objective, hessian, limits.expression, max_iter=max_iter
    )

    lower, upper = beam.bounds
    bounds = {"lbx": lower, "ubx": upper, "lbg": limits.lower, "ubg": limits.upper}
    guess = ca.MX.sym("q_guess", beam.basis.n)
    best, y = ca.fmin(ca.fmax(guess, lower), upper), ca.MX.zeros(*multipliers.shape)
    error = ca.Function(name + "_error", [q, values], [problem.to_meet])
    weight = None
    for a, b in _STAGES if constrained else _PREFERENCE_ONLY:
        y = y * (a / weight) if weight else y
        best = solver(x0=best, p=ca.vertcat(values, y, a, b), **bounds)["x"]
        y, weight = y + error(best, values), a
    outputs = ca.Function(
        name + "_outcome", [q, values], [problem.distances, problem.angles, _miss(problem)]
    )
    distances, angles, miss = outputs(best, values)
    inputs = {"q_guess": guess, "positions": problem.positions, "rotations": problem.rotations}
    used = {key: symbol for key, symbol in inputs.items() if symbol.numel()}
    results = {"q": best, "distances": distances, "angles": angles, "miss": miss}
    kept = {key: value for key, value in results.items() if value.numel()}
    return ca.Function(name, [*used.values()], [*kept.values()], [*used], [*kept])


def _miss(problem: Residuals) -> ca.MX:
    if not len(problem.tolerances):
        return ca.MX(0)
    return ca.norm_inf(problem.to_meet / problem.tolerances)
