"""Weights of the stations: what a load or a mass along the span is integrated with."""

from __future__ import annotations

from math import log2

import numpy as np
import pytest
from numpy.testing import assert_allclose

import curvcasadi as cc

CUSTOM = np.array([0, 0.05, 0.2, 0.3, 0.45, 0.5, 0.7, 0.8, 0.95, 1])


def integral(grid, f, breaks=()):
    """∫ f over [0, 1]: the sum over the stations of each panel."""
    return sum(panel.weights @ [f(xi) for xi in panel.xi] for panel in grid.panels(breaks))


def custom(refinements):
    """The uneven grid, each element halved `refinements` times."""
    boundaries = CUSTOM
    for _ in range(refinements):
        middles = (boundaries[1:] + boundaries[:-1]) / 2
        boundaries = np.sort(np.concatenate([boundaries, middles]))
    return cc.Grid(boundaries=boundaries)


@pytest.mark.parametrize("elements", [1, 2, 3, 7, 16])
def test_lobatto_weights_are_exact_to_degree_2n_minus_1(elements):
    grid = cc.Grid.lobatto(elements)
    for degree in range(2 * elements):
        got = integral(grid, lambda xi, degree=degree: xi**degree)
        assert_allclose(got, 1 / (degree + 1), rtol=1e-13)  # rounding
    # Not one degree further: the error of the next Legendre polynomial does not vanish.
    top = 2 * elements
    assert abs(integral(grid, lambda xi: (2 * xi - 1) ** top) - 1 / (top + 1)) > 1e-10


@pytest.mark.parametrize(
    "grid", [cc.Grid.uniform(3), cc.Grid.uniform(8), cc.Grid(boundaries=CUSTOM)]
)
def test_other_weights_are_exact_for_cubics(grid):
    for degree in range(4):
        got = integral(grid, lambda xi, degree=degree: xi**degree)
        assert_allclose(got, 1 / (degree + 1), rtol=1e-14)


@pytest.mark.parametrize("make", [lambda k: cc.Grid.uniform(8 * 2**k), custom], ids=["u", "c"])
def test_other_weights_have_order_four(make):
    exact = (np.exp(3) - 1) / 3
    coarse, fine = (abs(integral(make(k), lambda xi: np.exp(3 * xi)) - exact) for k in (4, 5))
    # The two end intervals pull the observed order below four on coarser grids.
    assert_allclose(log2(coarse / fine), 4, atol=0.15)


@pytest.mark.parametrize("breaks", [(), (0.37,), (0.2, 0.21, 0.9)], ids=str)
@pytest.mark.parametrize(
    "grid",
    [cc.Grid.lobatto(9), cc.Grid.uniform(9), cc.Grid(boundaries=CUSTOM)],
    ids=["lobatto", "uniform", "custom"],
)
def test_weights_of_a_panel_sum_to_its_length(grid, breaks):
    panels = grid.panels(breaks)
    edges = np.array([0, *breaks, 1])
    assert_allclose([panel.weights.sum() for panel in panels], np.diff(edges), rtol=1e-13)
    stations = grid.stations(breaks)
    for panel in panels:
        assert_allclose(panel.xi, stations[list(panel.nodes)], atol=1e-15)
    # Neighbours share the station at their break, and every station is in a panel.
    assert [a.nodes[-1] for a in panels[:-1]] == [b.nodes[0] for b in panels[1:]]
    assert {k for panel in panels for k in panel.nodes} == set(range(len(stations)))


@pytest.mark.parametrize(
    "grid",
    [cc.Grid.lobatto(9), cc.Grid.uniform(12), cc.Grid(boundaries=CUSTOM)],
    ids=["lobatto", "uniform", "custom"],
)
def test_each_panel_takes_its_own_limit_at_a_jump(grid):
    steps = cc.Steps([0, 0.3, 0.7, 1], [1.0, -5.0, 2.0])
    got = integral(grid, steps, steps.breaks)
    assert_allclose(got, 0.3 - 5 * 0.4 + 2 * 0.3, rtol=1e-13)
    # Without the breaks a jump within an element costs about half of it.
    assert abs(integral(cc.Grid.uniform(11), steps) - got) > 0.01


@pytest.mark.parametrize("elements", [1, 2])
def test_panels_of_few_elements_take_the_order_that_they_can(elements):
    grid = cc.Grid.uniform(elements)
    for degree in range(elements + 1):
        got = integral(grid, lambda xi, degree=degree: xi**degree)
        assert_allclose(got, 1 / (degree + 1), rtol=1e-14)


def test_lobatto_weights_are_positive():
    for elements in (1, 5, 20, 64):
        (panel,) = cc.Grid.lobatto(elements).panels()
        assert np.all(panel.weights > 0)


@pytest.mark.parametrize("grid", [cc.Grid.uniform(9), cc.Grid.lobatto(9)], ids=["u", "lobatto"])
def test_weights_of_a_symmetric_grid_are_symmetric(grid):
    (panel,) = grid.panels()
    assert_allclose(panel.weights, panel.weights[::-1], rtol=1e-13)  # rounding
