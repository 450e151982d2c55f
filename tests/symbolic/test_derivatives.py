"""Structured derivatives that are attached to Functions."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose

import curvcasadi as cc
from curvcasadi.reference_wings import hale_wing
from curvcasadi.symbolic.derivatives import with_jacobian


def marked(symbolic, **options):
    """(a, b) -> y (2, 1), z, with derivatives that AD would not give: 10 and on."""
    a, b = symbolic.sym("a", 2), symbolic.sym("b", 2)
    outputs = {
        "y": ca.vertcat(ca.sumsqr(a) + ca.sum1(b), ca.sum1(a) * ca.sumsqr(b)),
        "z": ca.sumsqr(a),
    }
    slopes = {"y": ca.DM([[10, 11, 12, 13], [20, 21, 22, 23]])}
    return with_jacobian("marked", {"a": a, "b": b}, outputs, slopes, **options), a, b


def called(expression, by):
    """Names of the Functions in d expression/d by."""
    derivative = ca.Function("d", [by], [ca.jacobian(expression, by)], {"allow_free": True})
    return {f.name() for f in derivative.find_functions()}


def test_derivatives_of_what_calls_the_function_are_the_attached_ones():
    f, *_ = marked(ca.SX)
    x = ca.MX.sym("x", 2)
    y, _ = f(2 * x, ca.MX(ca.DM([1, 1])))
    names = called(3 * y, x)
    assert "jac_marked" in names
    assert not [name for name in names if name.startswith(("fwd", "adj"))]
    slope = ca.Function("d", [x], [ca.jacobian(3 * y, x)])([1, 2])
    assert_allclose(slope, 6 * np.array([[10, 11], [20, 21]]), rtol=0)


def test_the_attached_derivative_stays_where_the_symbols_of_the_definition_are_used():
    f, a, b = marked(ca.MX)
    y, _ = f(a, b)
    assert "jac_marked" in called(y, a)
    slope = ca.Function("d", [a, b], [ca.jacobian(y, b)])([1, 2], [3, 4])
    assert_allclose(slope, [[12, 13], [22, 23]], rtol=0)


def test_outputs_without_slopes_have_no_derivative_and_say_so_by_nan(symbolic):
    f, *_ = marked(symbolic)
    x = ca.MX.sym("x", 2)
    _, z = f(x, ca.MX(ca.DM([1, 1])))
    assert np.all(np.isnan(ca.Function("d", [x], [ca.jacobian(z, x)])([1, 2]).full()))


def test_held_inputs_have_no_derivative(symbolic):
    a, b = symbolic.sym("a"), symbolic.sym("b")
    f = with_jacobian("f", {"a": a, "b": b}, {"y": a * b}, {"y": 7 * b}, held=("b",))
    x = ca.MX.sym("x")
    slope = ca.Function("d", [x], [ca.jacobian(f(x, x), x)])
    assert float(slope(3)) == 21


@pytest.mark.parametrize("slope", [ca.DM.zeros(1, 2), ca.DM.zeros(2, 1), 0.0], ids=str)
def test_slopes_of_the_wrong_shape_are_refused(symbolic, slope):
    a = symbolic.sym("a", 2)
    with pytest.raises(ValueError, match=r"slopes\['y'\]: expected shape \(2, 2\), found"):
        with_jacobian("f", {"a": a}, {"y": a}, {"y": slope})


def test_jacobian_functions_take_the_inputs_of_their_function_and_its_structured_jacobian():
    tip = cc.tip_function(hale_wing())
    derivatives = cc.jacobian_function(tip)
    assert derivatives.name() == "jacobian_tip"
    assert derivatives.name_in() == ["q"]
    names = {f.name() for f in derivatives.find_functions()}
    assert "jac_tip" in names
    # The pose itself is not computed, and nothing is differentiated by AD.
    assert not [n for n in names if n == "element_pose" or n.startswith(("fwd", "adj"))]
    q = np.random.default_rng(0).uniform(-0.03, 0.03, 9)
    expected = tip.jacobian()(q, 0, 0)
    for found, block in zip(derivatives(q), expected, strict=True):
        assert_allclose(found, block, rtol=0)


def test_jacobian_functions_of_implicit_functions_evaluate_them():
    x, p = ca.MX.sym("x"), ca.MX.sym("p")
    root = ca.rootfinder("root", "fast_newton", {"x": x, "p": p, "g": x**2 - p})
    f = ca.Function("f", [p], [root(1, p)], ["p"], ["y"])
    assert_allclose(cc.jacobian_function(f, "slope")(4.0), 0.25, rtol=1e-12)  # of the root
