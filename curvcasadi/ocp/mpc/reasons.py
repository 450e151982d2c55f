"""Why the plan of a step does not count, in words."""

from __future__ import annotations

import numpy as np

from curvcasadi.ocp.mpc.problem import RESIDUAL
from curvcasadi.ocp.mpc.solver import MpcSolver
from curvcasadi.symbolic.expressions import Array


def unsolved(violation: float, stationarity: float, tolerance: float) -> str:
    """Why there is no plan."""
    if not (np.isfinite(violation) and np.isfinite(stationarity)):
        return "the motion along the plan is not finite"
    if violation > 1:
        return (
            "no plan within the bounds found: the last one tried exceeds them by "
            f"{violation * tolerance:.2g} of half their range"
        )
    return f"not converged: {stationarity:.2g} times the tolerance from the optimality conditions"


def raised(error: RuntimeError) -> str:
    """What a solver raised."""
    return f"the solver gave up: {str(error).strip().splitlines()[-1]}"


def exceeded(
    solver: MpcSolver, states: Array, plan: Array, parameters: Array, violation: float
) -> str:
    """Why a plan of a solved program does not count."""
    if solver.problem.is_implicit:
        step = solver.functions.step
        residuals = [
            float(step(states[:, k], plan[:, k], parameters[:, k])[1]) for k in range(plan.shape[1])
        ]
        worst = int(np.argmax(residuals))
        if not residuals[worst] <= RESIDUAL:
            return (
                f"the model's step over stage {worst} does not converge, its residual is "
                f"{residuals[worst]:.1g}; use a shorter dt or more substeps"
            )
    excess = violation * solver.tolerance
    return f"bounds exceeded along the plan by {excess:.2g} of half their range"
