"""Named CasADi Functions."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose

import curvcasadi as cc


def test_function_names_its_inputs_and_outputs(symbolic):
    q, L = symbolic.sym("q", 2), symbolic.sym("L")
    f = cc.function("area", {"q": q, "L": L}, {"sum": q[0] + q[1], "scaled": L * q})
    assert f.name() == "area"
    assert f.name_in() == ["q", "L"]
    assert f.name_out() == ["sum", "scaled"]
    got = f(q=[1, 2], L=3)
    assert_allclose(got["sum"], 3, rtol=0)
    assert_allclose(got["scaled"], [[3], [6]], rtol=0)


def test_function_takes_constant_outputs(symbolic):
    q = symbolic.sym("q")
    f = cc.function("f", {"q": q}, {"a": 2.0, "b": ca.DM([1, 2]), "c": np.eye(2)})
    a, b, c = f(0)
    assert_allclose(a, 2, rtol=0)
    assert_allclose(b, [[1], [2]], rtol=0)
    assert_allclose(c, np.eye(2), rtol=0)


def test_function_shares_common_subexpressions():
    q = ca.SX.sym("q")
    once = cc.function("f", {"q": q}, {"a": ca.sin(q) + 1})
    twice = cc.function("f", {"q": q}, {"a": ca.sin(q) + 1, "b": ca.sin(q) + 1})
    assert twice.n_instructions() == once.n_instructions() + 1  # one more output, no more work


def test_function_refuses_undeclared_symbols_by_name(symbolic):
    q, load = symbolic.sym("q"), symbolic.sym("load")
    with pytest.raises(ValueError, match=r"outputs\['x'\]: expected an expression of q; .*load"):
        cc.function("f", {"q": q}, {"x": q * load})


def test_function_tells_symbols_of_one_name_apart(symbolic):
    q, other = symbolic.sym("q"), symbolic.sym("q")
    with pytest.raises(ValueError, match=r"outputs\['x'\]"):
        cc.function("f", {"q": q}, {"x": other})


@pytest.mark.parametrize("value", [1.0, ca.DM(1), np.ones(2)], ids=str)
def test_function_refuses_inputs_that_are_numbers(value):
    with pytest.raises(ValueError, match=r"inputs\['q'\]: expected an SX or MX symbol, found"):
        cc.function("f", {"q": value}, {"x": 1.0})


def test_function_refuses_inputs_that_are_expressions(symbolic):
    q = symbolic.sym("q")
    with pytest.raises(ValueError, match=r"inputs\['q'\]: expected an SX or MX symbol"):
        cc.function("f", {"q": 2 * q}, {"x": q})


def test_function_refuses_to_mix_kinds():
    q = ca.SX.sym("q")
    with pytest.raises(ValueError, match=r"q is SX, .*outputs\['x'\].* is MX"):
        cc.function("f", {"q": q}, {"x": ca.MX.sym("x")})
