"""Symmetric positive definite systems by A = L D Lᵀ, without pivoting and square roots.

Rounding does not depend on the scale of the unknowns. A is given by its upper triangle, packed by
columns; so are its factors, the inverse of D in the place of the diagonal and Lᵀ above it.
"""

from __future__ import annotations

from functools import lru_cache

import casadi as ca

from curvcasadi.symbolic.expressions import AnyExpr


def upper_triangle(matrix: AnyExpr) -> AnyExpr:
    """Upper triangle of a matrix (n, n), packed by columns."""
    return ca.vertcat(*(matrix[: k + 1, k] for k in range(matrix.shape[0])))


@lru_cache(maxsize=64)
def ldl_factors(n: int) -> ca.Function:
    """(triangle of A) -> factors, (n (n + 1)/2, 1)."""
    triangle = ca.SX.sym("triangle", n * (n + 1) // 2)
    scaled = [[ca.SX(0)] * n for _ in range(n)]  # (L D)ᵀ
    factors = _unpacked(triangle, n)
    for j in range(n):
        for i in range(j + 1):
            for k in range(i):
                factors[i][j] -= factors[k][i] * scaled[k][j]
            scaled[i][j] = factors[i][j]
            if i < j:
                factors[i][j] *= factors[i][i]
        factors[j][j] = 1 / factors[j][j]
    packed = ca.vertcat(*(factors[i][j] for j in range(n) for i in range(j + 1)))
    return ca.Function("ldl_factors", [triangle], [packed], {"cse": True})


@lru_cache(maxsize=64)
def ldl_substitute(n: int, columns: int = 1) -> ca.Function:
    """(factors of A, B (n, columns)) -> A⁻¹ B."""
    packed, right = ca.SX.sym("factors", n * (n + 1) // 2), ca.SX.sym("B", n, columns)
    factors, x = _unpacked(packed, n), ca.vertsplit(right)
    for i in range(n):
        for k in range(i):
            x[i] -= factors[k][i] * x[k]
    x = [row * factors[i][i] for i, row in enumerate(x)]
    for i in reversed(range(n)):
        for k in range(i + 1, n):
            x[i] -= factors[i][k] * x[k]
    return ca.Function("ldl_substitute", [packed, right], [ca.vertcat(*x)], {"cse": True})


@lru_cache(maxsize=64)
def ldl_solve(n: int, columns: int = 1) -> ca.Function:
    """(triangle of A, B (n, columns)) -> A⁻¹ B."""
    triangle, right = ca.SX.sym("triangle", n * (n + 1) // 2), ca.SX.sym("B", n, columns)
    solution = ldl_substitute(n, columns)(ldl_factors(n)(triangle), right)
    return ca.Function("ldl_solve", [triangle, right], [solution], {"cse": True})


def _unpacked(packed: ca.SX, n: int) -> list[list[ca.SX]]:
    """Rows of the upper triangle."""
    return [
        [packed[j * (j + 1) // 2 + i] if i <= j else ca.SX(0) for j in range(n)] for i in range(n)
    ]
