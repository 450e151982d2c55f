"""Coefficient functions of the exponentials on SO(3) and SE(3), as polynomials.

    c_k(x) = Σ_j (−x)^j / (2j + k)!,   x = θ²

c_1 = sin θ/θ, c_2 = (1 − cos θ)/θ², c_3 = (θ − sin θ)/θ³, and c_k = 1/k! − x c_{k+2}. They are
entire functions of θ²: a truncated series has no branch, no division and no root, so values and all
derivatives are right at θ = 0, in SX, MX and DM.
"""

from __future__ import annotations

from math import factorial, pi
from typing import Generic, NamedTuple

from curvcasadi.symbolic.expressions import Expr

#: Degree that is exact to rounding, third derivatives included, up to θ = π.
DEGREE = 15


def c(k: int, x: Expr, degree: int = DEGREE) -> Expr:
    """c_k(x), truncated after x^degree; Horner's scheme.

    Parameters
    ----------
    k : order of the coefficient function, at least 0
    x : squared angle, rad²
    degree : degree of the polynomial in x
    """
    if k < 0 or degree < 0:
        raise ValueError(f"k, degree: expected numbers not below zero, found {k}, {degree}")
    value = 0 * x + 1 / factorial(2 * degree + k)
    for j in reversed(range(degree)):
        value = 1 / factorial(2 * j + k) - x * value
    return value


class Coefficients(NamedTuple, Generic[Expr]):
    """c_1 … c_7 at one squared angle."""

    c1: Expr
    c2: Expr
    c3: Expr
    c4: Expr
    c5: Expr
    c6: Expr
    c7: Expr


def coefficients(x: Expr, degree: int = DEGREE) -> Coefficients[Expr]:
    """c_1 … c_7 at the squared angle `x` from two series: c_k = 1/k! − x c_{k+2}.

    The degree is that of c_2 and c_3. Horner's scheme passes c_7, c_5, c_3 on the way to c_1, and
    c_6, c_4 on that to c_2, so that all cost no more than the first two.
    """
    c6, c7 = c(6, x, max(degree - 2, 0)), c(7, x, max(degree - 2, 0))
    c4, c5 = 1 / 24 - x * c6, 1 / 120 - x * c7
    c2, c3 = 1 / 2 - x * c4, 1 / 6 - x * c5
    return Coefficients(1 - x * c3, c2, c3, c4, c5, c6, c7)


def slopes(coefficients: Coefficients[Expr]) -> list[Expr]:
    """dc_k/dx = (k c_{k+2} − c_{k+1})/2 for k = 1 … 5."""
    ck = coefficients
    return [(k * ck[k + 1] - ck[k]) / 2 for k in range(1, 6)]


#: (largest value of the first omitted term, largest relative error of the third derivative)
_TOLERANCES = {"double": (8e-18, 1e-12), "float": (1e-8, 1e-3)}


def degree_for(max_angle: float, real: str = "double") -> int:
    """Least degree of c_2 and c_3 for angles up to `max_angle`, rad, in `real` arithmetic.

    The first omitted term of c_2, θ^m/(m + 2)! with m = 2(degree + 1), stays below rounding, and so
    does its third derivative with respect to θ beside that of c_2, θ/30.
    """
    if not 0 < max_angle <= 2 * pi:
        raise ValueError(f"max_angle: expected an angle in (0, 2 π] rad, found {max_angle}")
    value_tolerance, derivative_tolerance = _TOLERANCES[real]
    degree = 1
    while True:
        m = 2 * (degree + 1)
        value = max_angle**m / factorial(m + 2)
        third = m * (m - 1) * (m - 2) * max_angle ** (m - 3) / factorial(m + 2)
        if value <= value_tolerance and third <= derivative_tolerance * max_angle / 30:
            return degree
        degree += 1
