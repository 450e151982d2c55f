"""Shape targets as one Function, solved by sequential quadratic programming: exportable as C."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from curvcasadi.beam.beam import Beam
from curvcasadi.ocp.limits import Regularizer, regularizer_matrix, shape_limits
from curvcasadi.ocp.targets import (
    Residuals,
    Target,
    checked_problem,
    residuals,
    rest_values,
    rotations_defect,
)
from curvcasadi.solvers.certificate import TOLERANCES, Bounds, larger
from curvcasadi.solvers.settings import SqpSettings, sqp_settings
from curvcasadi.solvers.sqp import gauss_newton_sqp
from curvcasadi.symbolic.expressions import Number, Real, function_name, positive

#: (weight of the preference in the objective, the same in the Hessian), stage by stage. From a
#: stronger preference, which leads to the right valley, to ever weaker ones, with which multipliers
#: converge along directions that the targets hardly see, and to none: a last step onto the targets.
#: Twice the weight in the Hessian damps Gauss–Newton, which does not know the curvature of the
#: constraint.
_STAGES: dict[Real, tuple[tuple[float, float], ...]] = {
    "double": ((1e-3, 1e-3), (1e-4, 2e-4), (1e-5, 2e-5), (1e-6, 2e-6), (1e-7, 2e-7), (0.0, 1e-9)),
    "float": ((1e-3, 1e-3), (1e-4, 2e-4), (0.0, 3e-8)),
}
_PREFERENCE_ONLY = ((1.0, 1.0),)


def shape_target_function(
    beam: Beam,
    targets: Sequence[Target],
    *,
    name: str = "shape_target",
    curvature_bound: Number | None = None,
    regularizer: Regularizer = "smoothness",
    regularization: float = 1e-8,
    iterations: int | None = None,
    max_iter: int = 100,
    qp_solver: str = "own",
    settings: SqpSettings | None = None,
) -> ca.Function:
    """`reach_shape` as one Function, which becomes self-contained C.

    The unweighted targets e(q) = 0, over xi² for positions and xi for attitudes, are met by the
    method of multipliers: with y ← y + e, each stage minimizes

        ½ |e|² + y·e + a (½ Σ weight (|Δp|²/L² + |Δφ|²) + ½ regularization qᵀ W q)

    by Gauss–Newton `sqpmethod`, within the bounds of `reach_shape`; a falls to zero.
    One solver serves all stages, so that generated C holds it once. Redundant targets are no
    obstacle. It follows one guess into one valley: `reach_shape` tries several, and finds the
    nearest shape to unreachable targets, which this need not. Where every target is weighted there
    is one stage.

    Parameters
    ----------
    beam : Beam
        Beam with numeric fields.
    targets : sequence of Target
        Stations and kinds; their numbers arrive as inputs.
    name : str
        Name of the Function, also in generated C.
    curvature_bound, regularizer : optional
        As of `reach_shape`.
    regularization : float
        As of `reach_shape`. Where every target is weighted, Gauss–Newton converges slowly if
        residuals stay: for targets that may be out of reach take 1e-4, and 1e-3 with `iterations`,
        whose full steps wander with less.
    iterations : int, optional
        None to converge; k for k quadratic programs with full steps, from the last solution as
        guess, where every target is weighted.
    max_iter : int
        Iterations of one stage at most; there are six stages (with `Grid(real="float")` three), or
        one.
    qp_solver : str
        "qrqp", which alone becomes self-contained C; where curvature bounds or element angles are
        active it may give up, and `violation` says so: "qpoases" does not. Without weight bounds
        that keep the elements within their angle, these are constraints, which cost much.
    settings : SqpSettings, optional
        Values of iterations, max_iter and qp_solver in one object, in place of these.

    Returns
    -------
    casadi.Function
        Inputs: q_guess (n, 1), rad/m; positions (3, P), m, if any; rotations (3, 3 R), if any; in
        the order of `targets`. Outputs: q (n, 1), rad/m; distances (P, 1), m; angles (R, 1), rad;
        violation (1, 1): the largest error of an unweighted target over its tolerance, or excess
        over a limit of weights, curvature (rad/m) or squared element angle (rad²) over 1e-6 (float:
        1e-5), or error of a target's rotation that is none over 1e-3, at most 1 where all is kept;
        stationarity (1, 1): what is left of the optimality conditions (of the last programs, for
        `iterations`) over 1e-8 rad/m (float: 1e-6), and what a Newton step would still take from
        the residual over 1e-6 (float: 1e-4), at most 1 where it converged. It does not raise, but
        for NaN inputs, or where its steps lead to what cannot be computed: check both. From an
        exactly straight guess a target on the beam's axis has no gradient: guess a slight bend.
    """
    function_name("name", name)
    targets = checked_problem(beam, targets)
    solving = sqp_settings(settings, iterations=iterations, max_iter=max_iter, qp_solver=qp_solver)
    positive("regularization", regularization)
    q = ca.MX.sym("q", beam.basis.n)
    limits = shape_limits(beam, q, curvature_bound)
    problem = residuals(beam, targets, q)
    constrained = len(problem.tolerances) > 0
    weighted = problem.weighted.numel() > 0
    preference = regularizer_matrix(beam, regularizer) * (regularization if weighted else 1.0)

    values = ca.veccat(problem.positions, problem.rotations)
    # An inner station moves less than the tip: as it is, its error would yield to the preference.
    to_meet = problem.to_meet / ca.DM(problem.leverages)
    multipliers = ca.MX.sym("multipliers", to_meet.numel())
    in_objective, in_hessian = ca.MX.sym("a"), ca.MX.sym("b")
    parameters = ca.vertcat(values, multipliers, in_objective, in_hessian)
    objective = ca.sumsqr(to_meet) / 2 + ca.dot(multipliers, to_meet)
    objective += in_objective * (ca.sumsqr(problem.weighted) + q.T @ preference @ q) / 2
    jacobian, weighted_jacobian = (ca.jacobian(part, q) for part in (to_meet, problem.weighted))
    hessian = jacobian.T @ jacobian
    hessian += in_hessian * (weighted_jacobian.T @ weighted_jacobian + preference)
    if solving.iterations is not None and constrained:
        raise ValueError(
            "iterations: expected None, or a weight for every target (least squares): targets to "
            "be met take several stages"
        )
    at_rest = rest_values(beam, targets)
    solver = gauss_newton_sqp(
        name + "_stage",
        q,
        parameters,
        objective,
        hessian,
        limits.expression,
        Bounds(*beam.bounds, limits.lower, limits.upper),
        nominal=(0, ca.vertcat(at_rest, ca.DM.zeros(multipliers.shape), 1, 1)),
        real=beam.grid.real,
        residual_unit=max([1.0, *(np.sqrt(t.weight) for t in targets if t.weight is not None)]),
        scaled=beam.grid.real == "float" or not constrained,
        **vars(solving),
    )

    guess = ca.MX.sym("q_guess", beam.basis.n)
    best, y = guess, ca.MX.zeros(*multipliers.shape)
    error = ca.Function(name + "_error", [q, values], [to_meet])
    weight = None
    excess, left = [], []
    for a, b in _STAGES[beam.grid.real] if constrained else _PREFERENCE_ONLY:
        y = y * (a / weight) if weight else y
        stage = solver(best, ca.vertcat(values, y, a, b))
        best = stage.x
        y, weight = y + error(best, values), a
        excess.append(stage.violation)
        left.append(stage.stationarity)
    outputs = ca.Function(
        name + "_outcome", [q, values], [problem.distances, problem.angles, _miss(problem)]
    )
    distances, angles, miss = outputs(best, values)
    limit = TOLERANCES[beam.grid.real].limit
    inputs = {"q_guess": guess, "positions": problem.positions, "rotations": problem.rotations}
    used = {key: symbol for key, symbol in inputs.items() if symbol.numel()}
    results = {
        "q": best,
        "distances": distances,
        "angles": angles,
        "violation": larger(miss, excess[-1] / limit),
        "stationarity": larger(left[-1], left[max(len(left) - 2, 0)]),
    }
    kept = {key: value for key, value in results.items() if value.numel()}
    return ca.Function(name, [*used.values()], [*kept.values()], [*used], [*kept])


def _miss(problem: Residuals) -> ca.MX:
    """Largest error of a target to be met over its tolerance, or of a rotation that is none."""
    errors = ca.fabs(problem.to_meet) / problem.tolerances
    return ca.mmax(ca.vertcat(rotations_defect(problem.rotations), errors))
