"""Random quadratic programs whose feasibility is known, and judges of their solutions."""

from __future__ import annotations

import numpy as np

from curvcasadi.solvers.qp import QuadraticProgram

KINDS = ("plain", "duplicate", "dependent", "no interior", "infeasible", "ill-conditioned", "equal")
BOX = 0.1


def random_program(random, kind, kind_of_number=float, *, n=None, m=None):
    """A program of a kind in numbers of a precision, and whether it is feasible.

    A feasible one has a point within its limits, up to the rounding of A x.
    """
    n = int(random.integers(1, 25)) if n is None else n
    m = int(random.integers(0, 60)) if m is None else m
    rank = max(1, n // 2) if kind == "ill-conditioned" else n
    J = random.normal(size=(rank, n))
    least = 1e-6 if kind == "ill-conditioned" else 1e-2
    H = J.T @ J / n + least * np.eye(n)
    H /= np.max(np.diag(H))
    A = random.normal(size=(m, n)) * (random.random((m, n)) < 0.3)
    if kind == "duplicate":
        A[m // 2 :] = A[: m - m // 2]
    if kind == "dependent":
        few = min(3, n)
        A = np.round(random.normal(size=(m, few))) @ np.round(random.normal(size=(few, n)))
    A = A.astype(kind_of_number).astype(float)
    point = random.uniform(-BOX, BOX, n).astype(kind_of_number).astype(float)
    lower, upper = np.full(n, -BOX), np.full(n, BOX)
    value = A @ point
    below, above = value - random.uniform(0, 0.05, m), value + random.uniform(0, 0.05, m)
    if kind == "no interior":
        below[: m // 2] = value[: m // 2]
        lower[: n // 2] = point[: n // 2]
    if kind == "equal":
        some = min(m, max(1, n // 3))
        below[:some] = above[:some] = value[:some]
    is_feasible = kind != "infeasible" or m == 0
    if not is_feasible:
        below[0] = np.abs(A[0]).sum() * BOX + 0.02
        above[0] = below[0] + 1
    g = random.normal(size=n) * 10 ** random.uniform(-2, 0.5)
    program = QuadraticProgram(
        H=H,
        g=g,
        A=A,
        lower=np.concatenate([lower, below]),
        upper=np.concatenate([upper, above]),
    )
    return program.rounded(kind_of_number), is_feasible


def residuals(program, x, lam):
    """(largest miss of a limit, stationarity, complementarity) in double precision."""
    x, lam = np.asarray(x, float), np.asarray(lam, float)
    n = len(x)
    values = np.concatenate([x, program.A @ x])
    miss = np.max(np.abs(values - np.clip(values, program.lower, program.upper)), initial=0.0)
    left = program.H @ x + program.g + lam[:n] + program.A.T @ lam[n:]
    slack = np.where(lam > 0, program.upper - values, values - program.lower)
    idle = np.minimum(np.abs(lam), np.maximum(slack, 0))
    return miss, np.max(np.abs(left)), np.max(idle, initial=0.0)
