"""The checks that public functions make of their arguments."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose

from curvcasadi.lie import so3
from curvcasadi.symbolic.expressions import (
    choice,
    count,
    expression,
    increasing_stations,
    is_numeric,
    positive,
    rotation_matrix,
    same_kind,
    station,
    symmetric,
    unit_vector,
)
from tests.support import oracle


def test_expression_takes_flat_sequences_as_columns():
    for value in ([1, 2, 3], (1, 2, 3), np.array([1, 2, 3]), ca.DM([1, 2, 3]), [[1], [2], [3]]):
        got = expression("v", value, (3, 1))
        assert isinstance(got, ca.DM)
        assert_allclose(got, [[1], [2], [3]], rtol=0)


def test_expression_passes_symbols_through(symbolic):
    v = symbolic.sym("v", 3)
    assert expression("v", v, (3, 1)) is v


@pytest.mark.parametrize(
    "value, message",
    [
        ([1, 2], r"v: expected shape \(3, 1\), found \(2, 1\)"),
        (1.0, r"v: expected shape \(3, 1\), found \(1, 1\)"),
        ([[1, 2, 3]], r"v: expected shape \(3, 1\), found \(1, 3\)"),
        (ca.SX.sym("v"), r"v: expected shape \(3, 1\), found \(1, 1\)"),
        (ca.MX.sym("v", 1, 3), r"v: expected shape \(3, 1\), found \(1, 3\)"),
        ([1, np.nan, 3], r"v: expected finite numbers, found \[1\.0, nan, 3\.0\]"),
        ([1, np.inf, 3], r"v: expected finite numbers"),
        (ca.DM([1, 2, np.nan]), r"v: expected finite numbers"),
        ("abc", r"v: expected numbers, found 'abc'"),
        (None, r"v: expected"),
        (["1", "2", "3"], r"v: expected numbers, found"),
        ([True, False, True], r"v: expected numbers, found"),
        ([1, 2j, 3], r"v: expected numbers, found"),
        ([[1], [2, 3], [4]], r"v: expected numbers, found"),
        ([ca.SX.sym("a"), 1, 2], r"v: expected numbers, found"),
    ],
    ids=str,
)
def test_expression_names_what_it_expected_and_found(value, message):
    with pytest.raises(ValueError, match=message):
        expression("v", value, (3, 1))


def test_expression_fills_the_structural_zeros_of_a_sparse_number():
    got = expression("v", ca.DM.eye(3), (3, 3))
    assert got.nnz() == 9


def test_positive_takes_numbers_above_zero_and_symbols(symbolic):
    assert positive("L", np.array(2)) == 2.0
    assert isinstance(positive("L", ca.DM(2)), float)
    assert positive("L", 0, zero=True) == 0.0
    length = symbolic.sym("L")
    assert positive("L", length) is length


@pytest.mark.parametrize("value", [0, -1e-300, np.nan, np.inf, "1 m", [1, 2], None])
def test_positive_refuses_the_rest(value):
    with pytest.raises(ValueError, match=r"L: expected .*found"):
        positive("L", value)


@pytest.mark.parametrize("digits", [3, 4, 6])
def test_a_rotation_with_few_digits_becomes_the_nearest_rotation(digits):
    exact = oracle.rotation([0.4, -1.1, 2.0])
    rotation = rotation_matrix("R", exact.round(digits)).full()
    assert_allclose(rotation.T @ rotation, np.eye(3), atol=1e-14)  # rounding
    # The nearest rotation is no further from the exact one than twice the rounding of nine entries.
    assert np.linalg.norm(rotation - exact) <= 2 * 3 * 0.5 * 10**-digits


def test_an_exact_rotation_stays_as_it_is():
    exact = oracle.rotation([0.4, -1.1, 2.0])
    assert (rotation_matrix("R", exact).full() == exact).all()


@pytest.mark.parametrize("matrix", [np.eye(3) * 1.01, np.ones((3, 3)), np.zeros((3, 3))])
def test_what_misses_a_rotation_by_more_than_a_hundredth_is_refused(matrix):
    with pytest.raises(ValueError, match=r"R: expected orthonormal columns, to 0\.01; found"):
        rotation_matrix("R", matrix)
    with pytest.raises(ValueError, match=r"R: expected orthonormal .* up to .*: .* in degrees\?"):
        rotation_matrix("R", so3.exp(ca.DM([0, 90, 0])))
    with pytest.raises(ValueError, match=r"R: expected a right-handed frame, found the reflection"):
        rotation_matrix("R", -np.eye(3))


def test_a_direction_with_few_digits_gets_the_length_one():
    direction = unit_vector("d", [0.7071, 0.0, 0.7071]).full().ravel()
    assert_allclose(direction, [0.5**0.5, 0, 0.5**0.5], atol=1e-15)
    with pytest.raises(ValueError, match=r"d: expected a unit vector, found \[1.* of length 1.41"):
        unit_vector("d", [1, 0, 1])


def test_symmetric_means_to_rounding_of_the_largest_entry():
    matrix = np.array([[2.9e10, 4.4e7, 0.0], [4.4e7 * (1 + 1.5e-9), 1.9e10, 1.0], [0.0, 0.0, 9e8]])
    assert_allclose(symmetric("S", matrix), (matrix + matrix.T) / 2, rtol=1e-15)
    matrix[0, 1] *= 1.00001
    with pytest.raises(ValueError, match=r"S: expected a symmetric matrix, .* found 4\.40004e\+07"):
        symmetric("S", matrix)


@pytest.mark.parametrize("xi, end", [(1 + 2e-16, 1.0), (1 - 9e-13, 1.0), (-9e-13, 0.0), (5e-13, 0)])
def test_a_station_within_1e_minus_12_of_an_end_is_that_end(xi, end):
    assert station("xi", xi) == end


def test_increasing_stations_are_merged_within_1e_minus_12():
    values = [1e-14, 5e-13, 0.3, 0.3 + 9e-13, 0.7, 1 - 1e-13, 1 + 2e-16]
    stations = increasing_stations("xi", values)
    assert stations.tolist() == [0.0, 0.0, 0.3, 0.3, 0.7, 1.0, 1.0]


@pytest.mark.parametrize("xi", [-1e-9, 1 + 1e-9, np.nan, "tip", [0.1, 0.2], ca.SX.sym("x")])
def test_station_is_a_number_in_the_unit_interval(xi):
    with pytest.raises(ValueError, match=r"xi: expected .*found"):
        station("xi", xi)


@pytest.mark.parametrize("value", [0, -1, 1.0, True, None, "2"])
def test_count_is_a_whole_number(value):
    with pytest.raises(ValueError, match=r"n: expected a whole number of at least 1, found"):
        count("n", value)
    assert count("n", np.int64(3)) == 3


def test_choice_lists_the_options():
    with pytest.raises(ValueError, match=r"rule: expected one of 'a', 'b'; found 'c'"):
        choice("rule", "c", ("a", "b"))


def test_same_kind_names_both_symbols_that_do_not_mix():
    with pytest.raises(ValueError, match=r"SX or MX.*q is SX, length is MX"):
        same_kind(q=ca.SX.sym("q"), length=ca.MX.sym("L"), other=1.0)


def test_same_kind_is_dm_without_symbols():
    assert same_kind(q=ca.DM(1), length=2.0) is ca.DM
    assert same_kind(q=ca.DM(1), length=ca.MX.sym("L")) is ca.MX


def test_numbers_are_not_symbols():
    assert all(is_numeric(value) for value in (1, 1.0, [1], np.ones(3), ca.DM(1)))
    assert not any(is_numeric(kind.sym("a")) for kind in (ca.SX, ca.MX))
