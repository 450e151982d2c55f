"""Covariances as U D Uᵀ: positive definite by construction, in single precision, too.

U is unit upper triangular, D diagonal and positive. A *factor* (N, N) is the upper triangular
matrix that holds U above its diagonal, and D on it. Every function here is one `casadi.Function`
of a few hundred operations, made to be called many times, so that generated C stays small.

G.J. Bierman, "Factorization Methods for Discrete Sequential Estimation", 1977: measurements one at
a time (chapter V), added noise (chapter VI, with the update of Agee and Turner).
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache, reduce
from operator import mul

import casadi as ca
import numpy as np

from curvcasadi.symbolic.expressions import AnyExpr, Array

_CSE = {"cse": True}

#: Residuals beyond it, SI, count as it: in single precision the square of a larger one over a
#: variance is no number, and what a flipped bit makes of a reading is larger.
_LARGEST = 1e15

#: A measurement depends on the state if that adds more than this to its variance.
_SEEN = 1e-9


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


def belief_of(factor: AnyExpr, error: AnyExpr) -> AnyExpr:
    """What measurements change, as a vector: nonzeros of the factor, by columns, and the error."""
    size = factor.nnz()
    return ca.vertcat(ca.sparsity_cast(factor, ca.Sparsity.dense(size)), error)


def split_belief(belief: AnyExpr, n: int) -> tuple[AnyExpr, AnyExpr]:
    """(factor, error) of a belief."""
    first = n * (n + 1) // 2
    return ca.sparsity_cast(belief[:first], ca.Sparsity.upper(n)), belief[first:]


@lru_cache(maxsize=64)
def measure(n: int, gate: float) -> ca.Function:
    """Bierman's update by a scalar measurement 0 = residual + slope · error + noise.

    With f = Uᵀ slope, v = D f, α_j = variance + Σ_{i≤j} f_i v_i, s = α_n and the innovation
    ν = −(residual + slope · error), for j from the first to the last:

        D_j ← D_j α_{j-1}/α_j,    U_ij ← U_ij − b_i f_j/α_{j-1},    b_i ← b_i + U_ij v_j,
        error ← error + b ν/s

    A measurement whose residual is NaN, or whose ν² exceeds gate² s, is one that depends on
    nothing: f = 0 leaves everything as it is, exactly.

    Returns
    -------
    casadi.Function
        (belief, the same again, row = (slope, residual), variance) -> belief, and ν/√s, 0 if NaN,
        with whether it was used. The belief is an input twice so that generated C reads it anew
        where it changes it, and holds none of it meanwhile.
    """
    size = n * (n + 1) // 2 + n
    belief, again = ca.SX.sym("belief", size), ca.SX.sym("again", size)
    row, variance = ca.SX.sym("row", n + 1), ca.SX.sym("variance")
    factor, error = split_belief(belief, n)
    f = [row[j] + sum(factor[i, j] * row[i] for i in range(j)) for j in range(n)]
    s = variance + sum(factor[j, j] * f[j] ** 2 for j in range(n))
    seen = ca.logic_or(row[n] < 0, row[n] >= 0)
    near = ca.if_else(row[n] ** 2 <= _LARGEST**2, row[n], _LARGEST * ca.sign(row[n]))
    innovation = -(ca.if_else(seen, near, 0) + ca.dot(row[:n], error))
    used = seen * (innovation**2 <= gate**2 * s)
    said = ca.vertcat(seen * innovation / ca.sqrt(s), used)
    f = [used * f_j for f_j in f]

    factor, error = split_belief(again, n)
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
    moved = error + ca.vertcat(*gain) * (innovation / alpha)
    arguments = [belief, again, row, variance]
    return ca.Function("ud_measure", arguments, [belief_of(new, moved), said], _CSE)


def measure_rows(
    belief: AnyExpr, rows: Sequence[AnyExpr], variances: Array, gate: float
) -> tuple[AnyExpr, list[AnyExpr]]:
    """`measure` by each of `rows` (n + 1, 1), one after another.

    Returns
    -------
    belief, and of each measurement ν/√s and whether it was used, (2, 1)
    """
    outcomes = []
    for row, variance in zip(rows, variances, strict=True):
        belief, outcome = measure(row.numel() - 1, gate)(belief, belief, row, variance)
        outcomes.append(outcome)
    return belief, outcomes


def measure_together(
    belief: AnyExpr, rows: Sequence[AnyExpr], variances: Array, gate: float
) -> tuple[AnyExpr, list[AnyExpr]]:
    """As `measure_rows`, but of rows that one gate lets through, each alone, all or none.

    The outcome of a row that is not used is that of the row alone.
    """
    judge = measure(rows[0].numel() - 1, gate)
    alone = [judge(belief, belief, *pair)[1] for pair in zip(rows, variances, strict=True)]
    together = reduce(mul, [outcome[1] for outcome in alone])
    missing = ca.vertcat(ca.DM.zeros(rows[0].numel() - 1), ca.sqrt(together - 1))
    belief, used = measure_rows(belief, [row + missing for row in rows], variances, np.inf)
    rejected = [ca.vertcat((1 - together) * one[0], 0) for one in alone]
    return belief, [one + other for one, other in zip(used, rejected, strict=True)]


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


def factor_of_columns(columns: ca.MX, d: ca.MX) -> ca.MX:
    """Factor (n, n) of W diag(d) Wᵀ, W = `columns` (n, m), of rank n.

    Weighted Gram–Schmidt on the rows of W as in `triangular`, by whole matrices, so that generated
    C loops (C.L. Thornton, "Triangular Covariance Factorizations for Kalman Filtering", 1976).
    """
    n, m = columns.shape
    f = _gram_schmidt(n, m)
    return f(columns, d)


@lru_cache(maxsize=64)
def _gram_schmidt(n: int, m: int) -> ca.Function:
    columns, d = ca.MX.sym("columns", n, m), ca.MX.sym("d", m)
    rows, found = ca.densify(columns.T), []  # row k of W is the column k
    for j in reversed(range(n)):
        row = rows[:, j]
        projections = (d * row).T @ rows  # of the rows up to j
        unit = projections[:j] / projections[j]
        found.append(ca.vertcat(unit.T, projections[j]))
        if j:
            rows = rows[:, :j] - row @ unit
    stacked = ca.vertcat(*reversed(found))
    factor = ca.sparsity_cast(stacked, ca.Sparsity.upper(n))
    return ca.Function("ud_factor", [columns, d], [factor], _CSE)


@lru_cache(maxsize=64)
def relieve(n: int, gate: float) -> ca.Function:
    """A belief with so much more doubt that a scalar measurement passes the gate, if `open`.

    With h, ν and s as in `measure`, b = P h and π = h · b: a sample with ν² > gate² s makes the
    prior wider in the one direction in which it is corrected, until ν is one standard deviation:

        P ← P + c b bᵀ,   c = (ν² − s)/π²

    Returns
    -------
    casadi.Function
        (belief, row, variance, open) -> belief, whether it was widened. It is not where `open` is
        zero, the sample is missing, passes the gate, or does not depend on the state.
    """
    size = n * (n + 1) // 2 + n
    belief, row = ca.SX.sym("belief", size), ca.SX.sym("row", n + 1)
    variance, is_open = ca.SX.sym("variance"), ca.SX.sym("open")
    factor, error = split_belief(belief, n)
    f = [row[j] + sum(factor[i, j] * row[i] for i in range(j)) for j in range(n)]
    v = [factor[j, j] * f[j] for j in range(n)]
    direction = [v[i] + sum(factor[i, j] * v[j] for j in range(i + 1, n)) for i in range(n)]
    prior = sum(a * b for a, b in zip(f, v, strict=True))
    seen = ca.logic_and(row[n] >= -_LARGEST, row[n] <= _LARGEST)
    innovation = -(ca.if_else(seen, row[n], 0) + ca.dot(row[:n], error))
    s = variance + prior
    depends = prior > _SEEN * variance
    far = ca.logic_and(ca.logic_and(innovation**2 > gate**2 * s, depends), seen)
    widen = ca.logic_and(is_open, far)
    scale = ca.if_else(depends, prior, 1)
    # In units of the prior deviation, so that single precision holds the square of an innovation.
    more = ca.if_else(widen, (innovation**2 - s) / scale, 0)
    along = ca.vertcat(*direction) / ca.sqrt(scale)
    widened = add_noise(n)(factor, along, more)
    return ca.Function(
        "ud_relieve", [belief, row, variance, is_open], [belief_of(widened, error), widen], _CSE
    )


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
