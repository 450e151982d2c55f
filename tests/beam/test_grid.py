"""Division of a beam into elements."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from numpy.testing import assert_allclose
from scipy.special import eval_legendre, roots_jacobi

import curvcasadi as cc
from curvcasadi.beam.quadrature import lobatto_points


def test_uniform_grid_has_equal_elements():
    assert_allclose(cc.Grid.uniform(5).stations(), np.linspace(0, 1, 6), rtol=1e-15)


@pytest.mark.parametrize(
    "n, points",
    [
        (1, [-1, 1]),
        (2, [-1, 0, 1]),
        (3, [-1, -np.sqrt(1 / 5), np.sqrt(1 / 5), 1]),
        (4, [-1, -np.sqrt(3 / 7), 0, np.sqrt(3 / 7), 1]),
    ],
)
def test_lobatto_points_have_their_known_values(n, points):
    # Tabulated Gauss–Lobatto points, moved to [0, 1]: rounding.
    assert_allclose(lobatto_points(n), (1 + np.array(points)) / 2, atol=1e-15)


@pytest.mark.parametrize("n", [2, 3, 8, 16, 33, 64])
def test_lobatto_points_are_the_ends_and_the_roots_of_the_derivative(n):
    interior, _ = roots_jacobi(n - 1, 1, 1)  # P_n' is proportional to the Jacobi polynomial (1, 1)
    points = lobatto_points(n)
    # Eigenvalues of a matrix of that size.
    assert_allclose(points, (1 + np.array([-1, *interior, 1])) / 2, atol=1e-14)
    assert_allclose(points + points[::-1], 1, rtol=0, atol=0)
    assert np.all(np.diff(points) > 0)


def test_lobatto_points_are_made_once_and_cannot_be_changed():
    assert lobatto_points(17) is lobatto_points(17)
    assert not lobatto_points(17).flags.writeable


def test_lobatto_points_of_many_elements_are_extrema_of_the_legendre_polynomial():
    n = 500
    x = 2 * lobatto_points(n) - 1
    slope = n * (eval_legendre(n - 1, x) - x * eval_legendre(n, x))  # (1 - x²) P_n'
    # A rounding of x, 1e-16, times the slope's own derivative, n (n + 1) P_n.
    assert np.abs(slope).max() <= 1e-16 * 10 * n * (n + 1)


def test_lobatto_points_integrate_polynomials_of_degree_2n_minus_1():
    n = 6
    points = lobatto_points(n)
    weights = 1 / (n * (n + 1) * eval_legendre(n, 2 * points - 1) ** 2)
    for power in range(2 * n):
        # Rounding of seven terms.
        assert_allclose(weights @ points**power, 1 / (power + 1), rtol=1e-14)
    # The rule's first error at degree 12 shows that the points are not better than Lobatto's.
    assert abs(weights @ points ** (2 * n) - 1 / (2 * n + 1)) > 1e-9


@pytest.mark.parametrize("kind", ["uniform", "lobatto"])
def test_every_break_is_a_boundary_and_panels_share_the_elements(kind):
    stations = getattr(cc.Grid, kind)(10).stations((0.2, 0.5))
    assert len(stations) == 11
    assert {0.0, 0.2, 0.5, 1.0} <= set(stations.tolist())
    assert np.all(np.diff(stations) > 0)
    inside = [np.sum((stations > a) & (stations <= b)) for a, b in [(0, 0.2), (0.2, 0.5), (0.5, 1)]]
    assert inside == [2, 3, 5]


def test_every_panel_gets_an_element_even_if_there_are_too_few():
    assert_allclose(cc.Grid.uniform(2).stations((0.1, 0.2, 0.3)), [0, 0.1, 0.2, 0.3, 1], rtol=0)


def test_lobatto_panels_are_lobatto_grids_of_their_own():
    stations = cc.Grid.lobatto(8).stations((0.5,))
    # Two panels of four elements: rounding.
    assert_allclose(stations[:5], lobatto_points(4) / 2, atol=1e-16)
    assert_allclose(stations[4:], 0.5 + lobatto_points(4) / 2, atol=2e-16)


def test_custom_grid_gains_the_breaks():
    grid = cc.Grid(boundaries=[0, 0.3, 1])
    assert_allclose(grid.stations((0.3, 0.6)), [0, 0.3, 0.6, 1], rtol=0)


def test_custom_grid_keeps_its_ends_exactly():
    stations = cc.Grid(boundaries=[0, 1e-13, 0.5, 1 - 1e-13, 1]).stations()
    assert (stations[0], stations[-1]) == (0.0, 1.0)


def test_custom_grid_keeps_a_break_exactly_beside_a_rounded_boundary():
    assert 1 / 3 in cc.Grid(boundaries=[0, 0.333333333333, 1]).stations((1 / 3,))


def test_grid_does_not_change_with_the_array_that_made_it():
    boundaries = np.array([0, 0.3, 1])
    grid = cc.Grid(boundaries=boundaries)
    boundaries[1] = 0.9
    assert_allclose(grid.stations(), [0, 0.3, 1], rtol=0)
    with pytest.raises(ValueError, match="read-only"):
        grid.boundaries[1] = 0.5


@pytest.mark.parametrize(
    "fields, message",
    [
        ({}, r"Grid\.boundaries: expected"),
        ({"boundaries": [0, 0.6, 0.5, 1]}, r"Grid\.boundaries: expected .*found \[0\.0, 0\.6"),
        ({"boundaries": [0, np.nan, 1]}, r"Grid\.boundaries: expected"),
        ({"boundaries": [0]}, r"Grid\.boundaries: expected increasing"),
        ({"boundaries": [[0, 1]]}, r"Grid\.boundaries: expected"),
        ({"boundaries": ["a", "b"]}, r"Grid\.boundaries: expected"),
        ({"boundaries": [0.1, 1]}, r"Grid\.boundaries: expected .*found \[0\.1"),
        ({"boundaries": [0, 0.9]}, r"Grid\.boundaries: expected .*0\.9"),
        ({"kind": "gauss", "elements": 3}, r"Grid\.kind: expected one of .*found 'gauss'"),
        ({"kind": "uniform"}, r"Grid\.elements: expected a whole number.*found None"),
        ({"boundaries": [0, 1], "elements": 4}, r"Grid\.elements: expected None .*found 4"),
        (
            {"kind": "uniform", "elements": 2, "boundaries": [0, 1]},
            r"Grid\.boundaries: expected None for kind 'uniform', found \[0, 1\]",
        ),
        ({"kind": "uniform", "elements": 0}, r"Grid\.elements: expected .*found 0"),
        ({"kind": "lobatto", "elements": 2.5}, r"Grid\.elements: expected .*found 2\.5"),
        ({"boundaries": [0, 1], "rule": "simpson"}, r"Grid\.rule: .*'magnus4'.*found 'simpson'"),
        ({"boundaries": [0, 1], "exponential": "x"}, r"Grid\.exponential: .*'series'.*found 'x'"),
        ({"boundaries": [0, 1], "real": "half"}, r"Grid\.real: expected .*found 'half'"),
        ({"boundaries": [0, 1], "max_angle": 0}, r"Grid\.max_angle: expected .*found 0"),
        ({"boundaries": [0, 1], "max_angle": 4}, r"Grid\.max_angle: expected .*found 4"),
        ({"boundaries": [0, 1], "max_angle": np.nan}, r"Grid\.max_angle: expected .*found nan"),
        ({"boundaries": [0, 1], "max_angle": "1"}, r"Grid\.max_angle: expected"),
    ],
)
def test_grid_refuses_bad_input(fields, message):
    with pytest.raises(ValueError, match=message):
        cc.Grid(**fields)


@settings(deadline=None, max_examples=50, derandomize=True)
@given(
    st.integers(1, 40),
    st.sets(st.integers(1, 99), max_size=6),
    st.sampled_from(["uniform", "lobatto"]),
)
def test_grids_with_breaks_increase_from_0_to_1_and_have_enough_elements(n, percents, kind):
    breaks = tuple(sorted(p / 100 for p in percents))
    stations = getattr(cc.Grid, kind)(n).stations(breaks)
    assert (stations[0], stations[-1]) == (0.0, 1.0)
    assert np.all(np.diff(stations) > 0)
    assert set(breaks) <= set(stations.tolist())
    assert len(stations) - 1 == max(n, len(breaks) + 1)


def test_boundaries_within_1e_minus_12_are_one():
    grid = cc.Grid(boundaries=[0, 0.5, 0.5 + 1e-13, 1 + 2e-16])
    np.testing.assert_array_equal(grid.stations(), [0, 0.5, 1])
