"""Strictly convex quadratic programs, and the C that solves them on a target."""

from __future__ import annotations

from dataclasses import dataclass
from importlib.resources import files
from typing import NamedTuple

import numpy as np

from curvcasadi.symbolic.expressions import Array


class QpTolerances(NamedTuple):
    """What the solver counts as zero."""

    reach: float  #: largest |x_i| that a proof of infeasibility regards where x has no limit
    primal: float  #: by which a limit may be missed
    dual: float  #: of stationarity and multipliers over the largest diagonal entry of H


#: For unknowns of the size of curvatures, rad/m, with the objective in any unit.
QP_TOLERANCES = {
    "double": QpTolerances(1e4, 1e-9, 1e-10),
    "float": QpTolerances(1e2, 2e-6, 1e-6),
}

#: Macros that the template needs, by type: rounding, and what is left of a dependent normal.
_CONSTANTS = {
    "double": {"QP_EPS": "2.220446e-16", "QP_DEPENDENT": "1e-20", "QP_SQRT": "sqrt"},
    "float": {"QP_EPS": "1.1920929e-7f", "QP_DEPENDENT": "1e-10f", "QP_SQRT": "sqrtf"},
}


@dataclass(frozen=True, eq=False, kw_only=True)
class QuadraticProgram:
    """min ½ xᵀHx + gᵀx subject to lower ≤ (x, A x) ≤ upper, in numbers.

    Attributes
    ----------
    H : array, shape (n, n)
        Symmetric and positive definite.
    g : array, shape (n,)
        Gradient at zero.
    A : array, shape (m, n)
        Rows, of which the solver stores what is not zero.
    lower, upper : array, shape (n + m,)
        Limits of x, then of A x; infinite where there is none, the same where it is an equality.
    """

    H: Array
    g: Array
    A: Array
    lower: Array
    upper: Array

    @property
    def size(self) -> tuple[int, int]:
        """Unknowns and rows."""
        return len(self.g), len(self.A)

    def tolerances(self, real: str) -> QpTolerances:
        """Of the solver in a precision."""
        return QP_TOLERANCES[real]

    def rounded(self, kind: type[np.floating]) -> QuadraticProgram:
        """The program with the numbers that another precision makes of its own."""
        parts = (self.H, self.g, self.A, self.lower, self.upper)
        names = ("H", "g", "A", "lower", "upper")
        return QuadraticProgram(
            **{k: v.astype(kind).astype(float) for k, v in zip(names, parts, strict=True)}
        )


def qp_source(real: str, name: str | None = None) -> str:
    """C of the solver with its type, by another name of it, and constants; it needs `math.h`."""
    text = files("curvcasadi.solvers").joinpath("templates/qp.c").read_text()
    macros = "".join(f"#define {key} {value}\n" for key, value in _CONSTANTS[real].items())
    return f"typedef {name or real} qp_real;\n{macros}{text}"
