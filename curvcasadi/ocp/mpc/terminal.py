"""Cost of what follows the horizon: the linear regulator's, without bounds.

About an equilibrium the stages are z_{k+1} = A z_k + B w_k with the errors E z_{k+1}, where z holds
the error state and the input before, w the input. What the infinite horizon after the last stage
costs is ½ zᵀ P z, with P of Riccati's equation,

    P = AᵀPA + Q − (AᵀPB + S) (R + BᵀPB)⁻¹ (BᵀPA + Sᵀ)

    Q = AᵀEᵀEA,   R = BᵀEᵀEB,   S = AᵀEᵀEB

so that without bounds, and as far as the model is linear, a plan of any horizon begins with the
input of the regulator.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from curvcasadi.control.error_state import difference
from curvcasadi.control.linearize import LinearModel
from curvcasadi.ocp.mpc.functions import ModelFunctions
from curvcasadi.ocp.mpc.problem import MpcProblem
from curvcasadi.ocp.mpc.terms import Terminal
from curvcasadi.symbolic.expressions import Array, instance

#: What an equilibrium may move by over a stage, of the state's largest entry or absolute.
_DRIFT = 1e-5
#: Residual of Riccati's equation, over the largest entry of its solution, that counts as none.
_RESIDUAL = 1e-6


def terminal_cost(problem: MpcProblem, functions: ModelFunctions, linear: LinearModel) -> Terminal:
    """The cost of an infinite horizon of the stages of a problem, about an equilibrium.

    Raises
    ------
    ValueError
        For a linearization of another model, away from an equilibrium, or with errors for which no
        regulator brings the model to rest.
    """
    model = problem.model
    if instance("terminal", linear, LinearModel).model is not model:
        raise ValueError(
            f"terminal: expected a linearization of {model!r}, found one of {linear.model!r}"
        )
    end = functions.step(linear.x, linear.u, linear.p)[0]
    drift = np.abs(difference(model, ca.DM(linear.x), end).full().ravel())
    worst = int(np.argmax(drift))
    if not drift[worst] <= _DRIFT * max(1.0, np.abs(linear.x).max()):
        raise ValueError(
            "terminal: expected a linearization at an equilibrium, found a state of which "
            f"{model.x.errors.labels[worst]}, changes by {drift[worst]:.2g} over a stage"
        )
    y = model.output(linear.x, linear.u, linear.p).full().ravel()
    n = model.x.errors.size + model.u.size
    A, B, E = _stage(problem, functions, linear, y)
    P = _riccati(A[:n, :n], B[:n], E @ A[:, :n], E @ B)
    values, vectors = np.linalg.eigh(P)
    kept = values > np.finfo(float).eps * n * values[-1]
    factor = np.sqrt(values[kept])[:, None] * vectors[:, kept].T
    return Terminal(x=linear.x, u=linear.u, y=y, factor=factor)


def _stage(
    problem: MpcProblem, functions: ModelFunctions, linear: LinearModel, y: Array
) -> tuple[Array, Array, Array]:
    """A and B of a stage, E of its errors, at rest."""
    stages, nu = problem.stages(functions), problem.model.u.size
    z = np.zeros(stages.nx)
    z[: linear.x.size + nu] = np.concatenate([linear.x, linear.u])
    w = np.zeros(stages.nu)
    w[:nu] = linear.u / problem.scale
    end, at, bt = stages.step(z, w, linear.p)
    _, E = stages.error(end, linear.p, problem.goal(linear.x, linear.u, y))
    return at.full().T, bt.full()[:nu].T, E.full()


def _riccati(A: Array, B: Array, EA: Array, EB: Array) -> Array:
    from scipy.linalg import solve_discrete_are

    Q, R, S = EA.T @ EA, EB.T @ EB, EA.T @ EB
    try:
        P = solve_discrete_are(A, B, Q, R, s=S)
        K = np.linalg.solve(R + B.T @ P @ B, B.T @ P @ A + S.T)
        left = np.abs(A.T @ P @ A + Q - (A.T @ P @ B + S) @ K - P).max()
        stable = np.abs(np.linalg.eigvals(A - B @ K)).max() < 1
        if stable and left <= _RESIDUAL * np.abs(P).max():
            return np.asarray((P + P.T) / 2)
    except (np.linalg.LinAlgError, ValueError):
        pass
    raise ValueError(
        "terminal: expected weights for which a linear regulator brings the model to rest, found "
        "none: no weighted output, state or input shows some motion that does not decay, no input "
        "reaches it, or an input is not weighed at all"
    )
