"""Which bounds hold, in words."""

import numpy as np

from curvcasadi.solvers.active import active_bounds

INFINITE = np.array([np.inf, np.inf, np.inf])


def test_entries_at_a_bound_are_named_with_side_value_and_unit():
    bounds = np.array([-1.0, -2.0, -3.0]), np.array([1.0, 2.0, 3.0])
    found = active_bounds(
        ["a", "b", "c"], np.array([-1.0, 0.0, 3.0]), bounds, tolerance=1e-9, units=["m", "s", "N"]
    )
    assert found == {0: "a at its lower bound -1 m", 2: "c at its upper bound 3 N"}


def test_infinite_bounds_hold_nothing_and_add_nothing_to_the_margin():
    values = np.array([0.0, 1e6, -1e6])
    assert active_bounds("abc", values, (-INFINITE, INFINITE), tolerance=1e-4) == {}
    upper = np.array([1.0, np.inf, np.inf])
    near = np.array([1 - 2e-4, 0.0, 0.0])  # twice the tolerance from the only bound there is
    assert active_bounds("abc", near, (-INFINITE, upper), tolerance=1e-4) == {}
    near[0] = 1 - 0.5e-4
    assert active_bounds("abc", near, (-INFINITE, upper), tolerance=1e-4) == {
        0: "a at its upper bound 1"
    }


def test_a_bound_of_zero_holds_within_the_least_size():
    at = np.array([1e-6, 0.5, 0.5])
    bounds = np.zeros(3), INFINITE
    assert active_bounds("abc", at, bounds, tolerance=1e-5) == {}
    assert [*active_bounds("abc", at, bounds, tolerance=1e-5, least=1.0)] == [0]


def test_words_are_in_the_units_of_the_scales():
    bounds = np.array([-1.0, 0.0]), np.array([1.0, 2.0])
    found = active_bounds(
        ["rate", "force"],
        np.array([0.0, 2.0]),
        bounds,
        tolerance=1e-9,
        scales=np.array([1.0, 50.0]),
        units=["rad/s", "N"],
    )
    assert found == {1: "force at its upper bound 100 N"}
