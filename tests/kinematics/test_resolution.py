"""How many elements a beam needs: the paper's section 3.1."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose

import curvcasadi as cc
from curvcasadi.kinematics.resolution import largest_element_angles
from curvcasadi.reference_wings import hale_wing

RULES = ("trapezoid", "midpoint", "magnus4", "magnus6")
KINDS = ("uniform", "lobatto")


def _grid(kind, rule="magnus4", **options):
    return getattr(cc.Grid, kind)(1, rule=rule, **options)


def _wing(kind, rule, bound):
    return replace(hale_wing(grid=_grid(kind, rule)), weight_bounds=bound)


def _planar(bound, family=None, grid=None, **fields):
    """A beam of 10 m that bends and twists with functions of one family."""
    family = family or cc.Legendre(1)
    return cc.Beam(
        length=10.0,
        basis=cc.ChannelBasis(torsion=family, out_of_plane=family),
        grid=grid or cc.Grid.uniform(1),
        weight_bounds=bound,
        **fields,
    )


def _weights(beam, samples, seed):
    """Random weights within the bounds, and as many corners of their box."""
    random = np.random.default_rng(seed)
    lower, upper = (side[:, None] for side in beam.bounds)
    inside = lower + (upper - lower) * random.random((beam.basis.n, samples))
    corners = np.where(random.random(inside.shape) < 0.5, lower, upper)
    return np.hstack([inside, corners])


def _tips(beam, weights):
    return cc.tip_function(beam).map(weights.shape[1])(weights)[0].full()


def _tip_errors(beam, weights):
    """Distances, m, to the tips on a grid of four times as many magnus6 elements."""
    elements = 4 * max(32, len(beam.stations) - 1)
    fine = replace(beam, grid=cc.Grid.uniform(elements, rule="magnus6"))
    return np.linalg.norm(_tips(beam, weights) - _tips(fine, weights), axis=0)


def _angles(beam, weights):
    q = ca.MX.sym("q", beam.basis.n)
    squared = ca.Function("angles", [q], [cc.squared_element_angles(beam, q)])
    return np.sqrt(squared.map(weights.shape[1])(weights).full())


@pytest.mark.parametrize("bound", [0.02, 0.06])
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("rule", RULES)
def test_the_tip_tolerance_holds_on_random_shapes_and_corners(rule, kind, bound):
    tolerance = 5e-2 if rule in ("trapezoid", "midpoint") else 1e-4
    beam = _wing(kind, rule, bound)
    grid = cc.elements_for(beam, tip_tolerance=tolerance)
    assert (grid.kind, grid.rule) == (kind, rule)
    fitted = replace(beam, grid=grid)
    # The reference is at least (4 · 32/17)⁶ times closer than the coarsest magnus4 grid.
    assert np.max(_tip_errors(fitted, _weights(beam, 300, seed=1))) <= tolerance


@pytest.mark.parametrize("rule", ["midpoint", "magnus4"])
def test_the_tip_tolerance_needs_its_elements(rule):
    beam, tolerance = _wing("uniform", rule, 0.05), 1e-3
    n = cc.elements_for(beam, tip_tolerance=tolerance).elements
    # Half as many are too few: the estimate is above the error by its safety factor of two only,
    # and the error falls by four or sixteen.
    half = replace(beam, grid=replace(beam.grid, elements=n // 2))
    assert np.max(_tip_errors(half, _weights(beam, 300, seed=2))) > tolerance


@pytest.mark.parametrize(
    "family", [cc.BSpline(5), cc.BSpline(8), cc.Tabulated([0, 0.4, 1], [[0], [1], [0.5]])]
)
@pytest.mark.parametrize("rule", ["midpoint", "magnus4"])
def test_the_tip_tolerance_holds_on_bases_with_breaks(family, rule):
    # With one element asked for, a break makes two: twice as many as one is no finer grid.
    beam = _planar(0.1, family, _grid("uniform", rule))
    tolerance = 1e-3
    fitted = replace(beam, grid=cc.elements_for(beam, tip_tolerance=tolerance))
    assert np.max(_tip_errors(fitted, _weights(beam, 200, seed=3))) <= tolerance


def test_the_tip_tolerance_holds_with_initial_curvature_and_lopsided_bounds():
    beam = _planar((-0.01, 0.12), cc.Legendre(3), initial_curvature=lambda x: [0.05, 0.1 * x, 0.1])
    fitted = replace(beam, grid=cc.elements_for(beam, tip_tolerance=1e-4))
    assert np.max(_tip_errors(fitted, _weights(beam, 300, seed=4))) <= 1e-4


@pytest.mark.parametrize("exponential", ["rodrigues", "small_angle_sine", "small_angle"])
def test_the_tip_tolerance_holds_with_the_approximate_exponentials(exponential):
    grid = _grid("uniform", "midpoint", exponential=exponential)
    beam = replace(hale_wing(grid=grid), weight_bounds=0.02)
    fitted = replace(beam, grid=cc.elements_for(beam, tip_tolerance=0.5))
    assert np.max(_tip_errors(fitted, _weights(beam, 200, seed=5))) <= 0.5


@pytest.mark.parametrize("angle", [0.15, 0.5])
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("rule", RULES)
def test_no_shape_within_the_bounds_turns_an_element_beyond_the_angle(rule, kind, angle):
    beam = _wing(kind, rule, 0.15)
    fitted = replace(beam, grid=cc.elements_for(beam, angle=angle))
    assert np.max(_angles(fitted, _weights(beam, 300, seed=6))) <= angle


@pytest.mark.parametrize(
    "family",
    [cc.Legendre(12), cc.Chebyshev(9), cc.Monomial(6), cc.BSpline(7), cc.PiecewiseConstant(5)],
    ids=lambda family: type(family).__name__,
)
def test_the_angle_holds_for_every_family(family):
    beam = _planar(0.1, family)
    fitted = replace(beam, grid=cc.elements_for(beam, angle=0.4))
    assert np.max(_angles(fitted, _weights(beam, 300, seed=7))) <= 0.4


@pytest.mark.parametrize("rule", ["magnus4", "magnus6"])
def test_the_angle_holds_where_the_axis_of_curvature_turns(rule):
    def turning(xi):
        return np.array([[0], [np.cos(6 * np.pi * xi)], [np.sin(6 * np.pi * xi)]])

    beam = replace(_planar(0.3, grid=_grid("uniform", rule)), basis=cc.VectorBasis(turning, 1))
    fitted = replace(beam, grid=cc.elements_for(beam, angle=0.9))
    assert np.max(_angles(fitted, np.array([[-0.3, 0.3]]))) <= 0.9


def test_the_default_angle_is_the_largest_of_the_grid_so_that_every_shape_is_accepted():
    beam = replace(hale_wing(grid=cc.Grid.lobatto(1, max_angle=0.6)), weight_bounds=0.15)
    fitted = replace(beam, grid=cc.elements_for(beam))
    for q in _weights(beam, 20, seed=8).T:
        cc.shape_map(fitted, q)  # raises if an element turns too far


@pytest.mark.parametrize("bound", [0.07, 0.31, 0.83])
def test_constant_curvature_needs_the_elements_of_the_paper(bound):
    # h max|K| ≤ angle with |K| = √2 bound; the margin a²/24 for commutators adds one at most.
    beam, angle = _planar(bound), 0.37
    paper = int(np.ceil(10 * np.sqrt(2) * bound / angle))
    assert paper <= cc.elements_for(beam, angle=angle).elements <= paper + 1


@pytest.mark.parametrize("angle", [0.1, 0.45, 1.0])
def test_one_element_less_would_exceed_the_bound_on_the_angles(angle):
    beam = _wing("uniform", "magnus4", 0.1)
    n = cc.elements_for(beam, angle=angle).elements
    bounds = [
        np.max(largest_element_angles(replace(beam, grid=replace(beam.grid, elements=k))))
        for k in (n, n - 1)
    ]
    assert bounds[0] <= angle < bounds[1]


def test_a_beam_that_cannot_bend_needs_one_element():
    assert cc.elements_for(_planar(0.0), tip_tolerance=1e-9).elements == 1


def test_the_bound_on_element_angles_is_tight_for_constant_curvature():
    beam = _planar(0.05, grid=cc.Grid.uniform(4))
    turned = 2.5 * 0.05 * np.sqrt(2)
    # Its margin for commutators is a²/24 = 0.13 %.
    assert_allclose(largest_element_angles(beam), turned, rtol=2e-3)
    assert np.all(largest_element_angles(beam) >= turned)
    unbounded = largest_element_angles(replace(beam, weight_bounds=None))
    assert np.all(np.isposinf(unbounded))


@pytest.mark.parametrize(
    "arguments, message",
    [
        ({"angle": 0}, r"angle: expected a number above zero, found 0"),
        ({"angle": np.nan}, r"angle: expected finite numbers, found"),
        ({"angle": 1.1}, r"angle: expected at most Grid\.max_angle = 1 rad, found 1\.1"),
        ({"angle": 1e-6}, r"angle: 4096 elements are too few"),
        ({"tip_tolerance": -1}, r"tip_tolerance: expected a number above zero, found -1"),
        ({"tip_tolerance": [1, 2]}, r"tip_tolerance: expected shape \(1, 1\), found \(2, 1\)"),
        ({"tip_tolerance": 1e-18}, r"tip_tolerance: 4096 elements are too few"),
    ],
    ids=str,
)
def test_wrong_demands_are_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        cc.elements_for(hale_wing(grid=cc.Grid.uniform(1)), **arguments)


@pytest.mark.parametrize("demand", [{}, {"tip_tolerance": 1e-3}], ids=["angle", "tip"])
@pytest.mark.parametrize(
    "fields, message",
    [
        ({"weight_bounds": None}, r"Beam\.weight_bounds: elements_for needs finite bounds, found"),
        ({"weight_bounds": (-np.inf, 1.0)}, r"Beam\.weight_bounds: elements_for needs finite"),
        ({"length": ca.SX.sym("L")}, r"Beam\.length: .* needs a number, found the symbol L"),
        ({"initial_curvature": ca.MX.sym("K0", 3)}, r"Beam\.initial_curvature: expected numbers"),
        ({"grid": cc.Grid(boundaries=[0, 1])}, r"Beam\.grid: .*uniform or Lobatto.*custom"),
    ],
    ids=["unbounded", "half-bounded", "length", "initial_curvature", "custom"],
)
def test_beams_without_numbers_to_go_by_are_refused(fields, message, demand):
    with pytest.raises(ValueError, match=message):
        cc.elements_for(replace(hale_wing(), **fields), **demand)


def test_a_tip_tolerance_holds_inside_the_box_of_the_weights():
    # A clothoid: its tip error passes a maximum below the largest weight.
    clothoid = cc.VectorBasis(lambda xi: np.array([[0.0], [xi], [0.0]]), 1)
    beam = cc.Beam(length=1.0, basis=clothoid, grid=cc.Grid.uniform(8), weight_bounds=(0.0, 8.3))
    tolerance = 4.64e-6
    grids = cc.elements_for(beam, tip_tolerance=tolerance), cc.Grid.uniform(500)
    tips = [cc.tip_function(replace(beam, grid=grid)) for grid in grids]
    for weight in np.linspace(0, 8.3, 42):
        coarse, fine = (tip([weight])[0].full() for tip in tips)
        assert np.linalg.norm(coarse - fine) <= tolerance
