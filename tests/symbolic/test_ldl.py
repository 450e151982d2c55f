"""Factors of positive definite matrices."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose

from curvcasadi.symbolic.ldl import ldl_factors, ldl_solve, ldl_substitute, upper_triangle


@pytest.mark.parametrize("n", [1, 2, 7])
def test_solutions_are_those_of_numpy_whatever_the_scale(n):
    rng = np.random.default_rng(n)
    root = rng.normal(size=(n, n + 2))
    scale = np.diag(10.0 ** np.linspace(0, 9, n))
    matrix = scale @ (root @ root.T) @ scale
    right = rng.normal(size=(n, 3))
    # Unknowns scaled back: the rounding is that of the well-scaled matrix.
    expected = np.linalg.solve(root @ root.T, np.linalg.solve(scale, right))
    triangle = upper_triangle(ca.DM(matrix))
    for found in (
        ldl_solve(n, 3)(triangle, right),
        ldl_substitute(n, 3)(ldl_factors(n)(triangle), right),
    ):
        assert_allclose(scale @ found.full(), expected, rtol=1e-10, atol=1e-12)
