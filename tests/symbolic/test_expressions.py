"""The checks that public functions make of their arguments."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose

from curvcasadi.symbolic.expressions import (
    choice,
    count,
    expression,
    is_numeric,
    positive,
    rotation_matrix,
    same_kind,
    station,
)


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


def test_rotation_matrix_is_checked_to_1e_minus_6():
    nearly = np.eye(3) + 4e-7
    assert_allclose(rotation_matrix("R", nearly), nearly, rtol=0)
    with pytest.raises(ValueError, match=r"R: expected orthonormal columns"):
        rotation_matrix("R", np.eye(3) + 1e-5)


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
