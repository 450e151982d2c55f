"""Covariances as U D Uᵀ: positive definite by construction, in single precision, too.

U is unit upper triangular, D diagonal and positive. A *factor* (N, N) is the upper triangular
matrix that holds U above its diagonal, and D on it. Every function here is one `casadi.Function`
of a few hundred operations, made to be called many times, so that generated C stays small.

G.J. Bierman, "Factorization Methods for Discrete Sequential Estimation", 1977: measurements one at
a time (chapter V), added noise (chapter VI, with the update of Agee and Turner).
"""

from __future__ import annotations

from functools import lru_cache

import casadi as ca
import numpy as np

from curvcasadi.expressions import Array

_CSE = {"cse": True}


def factor_of(covariance: Array) -> Array:
    """Factor (N, N) of a positive definite `covariance` (N, N)."""
    lower = np.linalg.cholesky(covariance[::-1, ::-1])
    upper = lower[::-1, ::-1]  # P = upper upperᵀ
    scale = np.diag(upper)
    factor: Array = upper / scale
    np.fill_diagonal(factor, scale**2)
    return factor


def covariance_of(factor: Array) -> Array:
    """P = U D Uᵀ, (N, N), of a factor."""
    d = np.diag(factor)
    unit = np.triu(factor, 1) + np.eye(len(d))
    covariance: Array = (unit * d) @ unit.T
    return covariance


@lru_cache(maxsize=64)
def innovate(n: int, gate: float) -> ca.Function:
    """The innovation of a scalar measurement 0 = residual + row · error + noise.

    With f = Uᵀ row, s = variance + Σ D_j f_j² and the innovation ν = −(residual + row · error). A
    measurement that is not `seen`, or whose ν² exceeds gate² s, is one that depends on nothing:
    with f = 0 `correct` leaves everything as it is, exactly.

    Returns
    -------
    casadi.Function
        (error (n, 1), factor, row (n, 1), residual, variance, seen) -> f or zeros, ν, ν/√s (0 if
        not seen), and whether it was used.
    """
    error, row = ca.SX.sym("error", n), ca.SX.sym("row", n)
    factor = ca.SX.sym("factor", ca.Sparsity.upper(n))
    residual, variance, seen = (ca.SX.sym(key) for key in ("residual", "variance", "seen"))
    f = [row[j] + sum(factor[i, j] * row[i] for i in range(j)) for j in range(n)]
    s = variance + sum(factor[j, j] * f[j] ** 2 for j in range(n))
    innovation = -(residual + ca.dot(row, error))
    used = seen * (innovation**2 <= gate**2 * s)
    arguments = [error, factor, row, residual, variance, seen]
    outputs = [used * ca.vertcat(*f), innovation, seen * innovation / ca.sqrt(s), used]
    return ca.Function("ud_innovate", arguments, outputs, _CSE)


@lru_cache(maxsize=64)
def correct(n: int) -> ca.Function:
    """Bierman's measurement update: (factor, f, variance, error, ν) -> factor, error.

    With v = D f and α_j = variance + Σ_{i≤j} f_i v_i, for j from the first to the last:

        D_j ← D_j α_{j-1}/α_j,    U_ij ← U_ij − b_i f_j/α_{j-1},    b_i ← b_i + U_ij v_j,
        error ← error + b ν/α_n
    """
    factor, f = ca.SX.sym("factor", ca.Sparsity.upper(n)), ca.SX.sym("f", n)
    error, innovation = ca.SX.sym("error", n), ca.SX.sym("innovation")
    variance = ca.SX.sym("variance")
    new = ca.SX(factor.sparsity())
    gain: list[ca.SX] = []
    alpha = variance
    for j in range(n):
        v = factor[j, j] * f[j]
        before, alpha = alpha, alpha + f[j] * v
        slope = f[j] / before
        for i in range(j):
            new[i, j] = factor[i, j] - gain[i] * slope
            gain[i] += factor[i, j] * v
        new[j, j] = factor[j, j] * (before / alpha)
        gain.append(v)
    error_after = error + ca.vertcat(*gain) * (innovation / alpha)
    arguments = [factor, f, variance, error, innovation]
    return ca.Function("ud_correct", arguments, [new, error_after], _CSE)


@lru_cache(maxsize=64)
def measure_rows(n: int, rows: int, gate: float) -> ca.Function:
    """Scalar measurements with the rows of a slope (rows, n), one after another.

    (error, factor, slope', residual, variance, seen) -> error, factor, ν/√s and used (rows, 1), of
    the slope transposed. MX: calls of `innovate` and `correct`, which are two so that neither holds
    the factor for long; as one they took twice the code.
    """
    error, slope = ca.MX.sym("error", n), ca.MX.sym("slope", n, rows)
    factor = ca.MX.sym("factor", ca.Sparsity.upper(n))
    residual, variance, seen = (ca.MX.sym(key, rows) for key in ("residual", "variance", "seen"))
    arguments = [error, factor, slope, residual, variance, seen]
    said = []
    for k in range(rows):
        f, innovation, *found = innovate(n, gate)(
            error, factor, slope[:, k], residual[k], variance[k], seen[k]
        )
        factor, error = correct(n)(factor, f, variance[k], error, innovation)
        said.append(found)
    outputs = [error, factor, *(ca.vertcat(*x) for x in zip(*said, strict=True))]
    return ca.Function("ud_measure_rows", arguments, outputs, _CSE)


def measure(n: int, gate: float) -> ca.Function:
    """`measure_rows` of one row, (n, 1)."""
    return measure_rows(n, 1, gate)


@lru_cache(maxsize=64)
def add_noise(n: int) -> ca.Function:
    """(factor, direction (n, 1), variance) -> factor of P + variance · direction directionᵀ.

    For j from the last to the first (Agee and Turner), with a and c the remaining direction and
    variance:

        D_j ← D_j + c a_j²,   β = c a_j/D_j (new),   c ← c D_j (old)/D_j (new),
        a_i ← a_i − a_j U_ij,   U_ij ← U_ij + β a_i
    """
    factor = ca.SX.sym("factor", ca.Sparsity.upper(n))
    direction, variance = ca.SX.sym("direction", n), ca.SX.sym("variance")
    a, c = list(ca.vertsplit(direction)), variance
    new = ca.SX(factor.sparsity())
    for j in reversed(range(n)):
        d = factor[j, j] + c * a[j] ** 2
        new[j, j] = d
        beta = c * a[j] / d
        c = c * (factor[j, j] / d)
        for i in range(j):
            a[i] = a[i] - a[j] * factor[i, j]
            new[i, j] = factor[i, j] + beta * a[i]
    return ca.Function("ud_add_noise", [factor, direction, variance], [new], _CSE)


def triangular(rows: list[ca.SX], d: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Unit upper triangular U (k, k) and D (k, 1) with U D Uᵀ = W diag(d) Wᵀ.

    Weighted Gram–Schmidt on the rows of W, from the last: sums of squares, no differences.
    """
    k = len(rows)
    unit, found = ca.SX.eye(k), ca.SX.zeros(k)
    rows = list(rows)
    for j in reversed(range(k)):
        weighted = rows[j] * d.T
        found[j] = ca.dot(rows[j], weighted)
        for i in range(j):
            unit[i, j] = ca.dot(rows[i], weighted) / found[j]
            rows[i] = rows[i] - unit[i, j] * rows[j]
    return unit, found
