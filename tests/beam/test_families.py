"""Families of scalar functions against their definitions."""

from __future__ import annotations

import mpmath as mp
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.interpolate import CubicSpline
from scipy.special import eval_chebyt, eval_legendre

import curvcasadi as cc

STATIONS = [0.0, 1e-9, 0.123, 0.5, 0.77, 1.0]
COUNTED = [
    cc.Legendre,
    cc.Chebyshev,
    cc.Monomial,
    cc.PiecewiseConstant,
    cc.BSpline,
    cc.CantileverModes,
    cc.FreeTip,
]


@pytest.mark.parametrize("xi", STATIONS)
def test_polynomial_families_equal_their_definitions(xi):
    k = np.arange(6)
    # Recurrences of order six: rounding.
    assert_allclose(cc.Legendre(6)(xi), eval_legendre(k, 2 * xi - 1), atol=1e-14)
    assert_allclose(cc.Chebyshev(6)(xi), eval_chebyt(k, 2 * xi - 1), atol=1e-14)
    assert_allclose(cc.Monomial(6)(xi), [xi**j for j in k], rtol=1e-15)


@pytest.mark.parametrize("family", COUNTED)
def test_families_give_n_dimensionless_values_with_labels(family):
    f = family(5)
    assert f.n == 5
    assert len(set(f.labels)) == 5
    for xi in STATIONS:
        assert f(xi).shape == (5,)
        assert np.abs(f(xi)).max() <= 1 + 1e-12  # all are scaled to at most 1; rounding


@pytest.mark.parametrize("family", COUNTED)
@pytest.mark.parametrize("n", [0, -1, 2.0, True, "4", None])
def test_families_refuse_what_is_not_a_count(family, n):
    with pytest.raises(ValueError, match=rf"{family.__name__}\.n: expected a whole number.*found"):
        family(n)


def test_piecewise_constant_is_one_on_its_own_segment():
    f = cc.PiecewiseConstant(4)
    assert f.breaks == (0.25, 0.5, 0.75)
    for xi, segment in [(0, 0), (0.249, 0), (0.25, 1), (0.5, 2), (0.75, 3), (1, 3)]:
        assert_allclose(f(xi), np.eye(4)[segment], rtol=0)


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_bsplines_sum_to_one_and_are_clamped(degree):
    f = cc.BSpline(6, degree=degree)
    assert_allclose(f.breaks, np.arange(1, 6 - degree) / (6 - degree), rtol=1e-15)
    for xi in STATIONS:
        assert_allclose(f(xi).sum(), 1, rtol=1e-14)  # rounding
        assert f(xi).min() >= 0
    assert_allclose(f(0.0), np.eye(6)[0], atol=1e-15)
    assert_allclose(f(1.0), np.eye(6)[-1], atol=1e-15)


def test_bsplines_refuse_too_few_functions():
    with pytest.raises(ValueError, match=r"BSpline\.n: expected .* at least 4, found 3"):
        cc.BSpline(3)
    with pytest.raises(ValueError, match=r"BSpline\.degree: expected .* at least 0, found -1"):
        cc.BSpline(3, degree=-1)


def test_cantilever_modes_equal_the_closed_form():
    f = cc.CantileverModes(12)
    with mp.workdps(60):
        for k in range(12):
            beta = mp.findroot(
                lambda b: mp.cos(b) * mp.cosh(b) + 1, mp.pi * (k + 0.5) if k else mp.mpf(1.8751)
            )
            sigma = (mp.cosh(beta) + mp.cos(beta)) / (mp.sinh(beta) + mp.sin(beta))
            for xi in STATIONS:
                b = beta * mp.mpf(xi)
                expected = mp.cosh(b) + mp.cos(b) - sigma * (mp.sinh(b) + mp.sin(b))
                # Scaled to 1 at the root, where the closed form is 2. β up to 36 carries its
                # rounding into the cosine.
                assert_allclose(f(xi)[k], float(expected / 2), atol=2e-14)


def test_cantilever_modes_vanish_at_the_tip_with_their_slope():
    f = cc.CantileverModes(6)
    assert_allclose(f(0.0), 1, rtol=1e-14)
    assert_allclose(f(1.0), 0, atol=1e-14)
    slope = (f(1.0) - f(1 - 1e-6)) / 1e-6
    # The slope is zero and the second derivative is β², up to 300: half of that times 1e-6.
    assert_allclose(slope, 0, atol=5e-4)


def test_tabulated_interpolates_linearly_with_breaks_at_the_samples():
    f = cc.Tabulated([0, 0.3, 1], [[1, 2], [4, 2], [0, -2]])
    assert f.n == 2
    assert f.breaks == (0.3,)
    # Linear interpolation by hand.
    assert_allclose(f(0.15), [2.5, 2], rtol=1e-14)
    assert_allclose(f(0.65), [2, 0], atol=1e-14)


def test_tabulated_cubic_has_no_breaks_and_is_the_not_a_knot_spline():
    xi = np.linspace(0, 1, 9)
    values = np.column_stack([np.sin(3 * xi), np.exp(xi)])
    f = cc.Tabulated(xi, values, degree=3)
    assert f.breaks == ()
    spline = CubicSpline(xi, values, bc_type="not-a-knot")
    for station in STATIONS:
        assert_allclose(f(station), spline(station), atol=1e-14)  # rounding of a 9 × 9 solve


def test_tabulated_does_not_change_with_the_arrays_that_made_it():
    xi, values = np.array([0, 0.5, 1]), np.ones((3, 1))
    f = cc.Tabulated(xi, values)
    values[:] = 7
    xi[1] = 0.9
    assert_allclose(f(0.5), [1])
    assert f.breaks == (0.5,)


@pytest.mark.parametrize(
    "arguments, message",
    [
        (([0, 0.5, 0.4, 1], np.ones((4, 1))), r"Tabulated\.xi: expected .*increasing.*found"),
        (
            ([0, 0.5, 0.9], np.ones((3, 1))),
            r"Tabulated\.xi: expected increasing .*found \[0\.0, 0\.5, 0\.9",
        ),
        (
            ([0.1, 0.5, 1], np.ones((3, 1))),
            r"Tabulated\.xi: expected increasing .*found \[0\.1",
        ),
        (([0], np.ones((1, 1))), r"Tabulated\.xi: expected increasing"),
        (([0, np.nan, 1], np.ones((3, 1))), r"Tabulated\.xi: expected"),
        ((["a", "b"], np.ones((2, 1))), r"Tabulated\.xi: expected"),
        (([0, 1], np.ones(2)), r"Tabulated\.values: expected shape \(2, n\), found \(2,\)"),
        (([0, 1], np.ones((3, 1))), r"Tabulated\.values: expected shape \(2, n\), found \(3, 1\)"),
        (([0, 1], np.ones((2, 0))), r"Tabulated\.values: expected shape \(2, n\), found \(2, 0\)"),
        (([0, 1], [[0.0], [np.nan]]), r"Tabulated\.values: expected finite"),
        (([0, 1], np.ones((2, 1)), 2), r"Tabulated\.degree: expected one of 1, 3; found 2"),
        (([0, 0.5, 1], np.ones((3, 1)), 3), r"Tabulated\.xi: expected more than 3"),
    ],
)
def test_tabulated_refuses_bad_samples(arguments, message):
    with pytest.raises(ValueError, match=message):
        cc.Tabulated(*arguments)


def test_a_table_takes_stations_that_miss_the_ends_by_rounding():
    xi = np.append(0, np.cumsum(np.full(10, 0.3)) / 3.0)
    assert xi[-1] != 1  # but for rounding
    assert cc.Tabulated(xi, np.ones((11, 1))).xi[-1] == 1
    doubled = cc.Tabulated([0, 0.5, 0.5 + 1e-14, 1], [[0], [1], [1], [0]])
    assert doubled.breaks == (0.5,)
    with pytest.raises(ValueError, match=r"Tabulated\.values: expected one sample at xi = 0\.5, "):
        cc.Tabulated([0, 0.5, 0.5 + 1e-14, 1], [[0], [1], [2], [0]])
