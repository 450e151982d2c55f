"""Lifting line of horseshoes: against Prandtl's equation, Biot and Savart's law, and symmetry."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import quad_vec

import curvcasadi as cc
from curvcasadi.aero import induced

HALF_SPAN = 8.0
SLOPE = 2 * np.pi


def prandtl(chord, terms=200):
    """Γ(ξ) of Prandtl's integral equation, half span 8 m, u = 1 m/s, by a sine series."""
    span = 2 * HALF_SPAN
    theta = np.arange(1, 2 * terms, 2) * np.pi / (4 * terms)
    odd = np.arange(1, 2 * terms, 2)
    mu = SLOPE * chord(np.cos(theta)) / (4 * span)
    matrix = np.sin(np.outer(theta, odd)) * (odd * mu[:, None] + np.sin(theta)[:, None])
    amplitudes = np.linalg.solve(matrix, mu * np.sin(theta))
    return lambda xi: 2 * span * np.sin(np.outer(np.arccos(xi), odd)) @ amplitudes


def rectangle(xi):
    return np.ones_like(xi)


def ellipse(xi):
    return 1.2 * np.sqrt(1 - xi**2)


def straight(line, length, chord, offset=0.0):
    """Γ at the control points of a straight wing along x in a stream along −y."""
    panels = induced.panels_of(line)
    corners, normals = np.zeros((3, line.panels + 1)), np.zeros((3, line.panels))
    corners[0], normals[2] = offset + length * panels.edges, 1
    of = induced.circulations(line.panels, line.image, tuple(panels.fractions))
    k = chord(panels.points) * SLOPE / 2
    found = of(corners, normals, [0, -1, 0], [1, 0, 0], k, np.ones(line.panels))
    return panels.points, found.full().ravel()


def total(line, points, circulation):
    xi, weights = np.polynomial.legendre.leggauss(60)
    xi = (1 + xi) / 2
    shapes = induced.circulation_shapes(line, points)
    return induced.circulation_shapes(line, xi) @ np.linalg.solve(shapes, circulation) @ weights / 2


@pytest.mark.parametrize(("chord", "limit"), [(rectangle, 1.5e-3), (ellipse, 4e-4)])
def test_lift_is_that_of_prandtls_equation(chord, limit):
    line = cc.LiftingLine(panels=6)
    points, found = straight(line, HALF_SPAN, chord)
    exact = prandtl(chord)
    xi, weights = np.polynomial.legendre.leggauss(200)
    expected = exact((1 + xi) / 2) @ weights / 2
    # What six panels leave: 1.2e-3 of a rectangular wing, 3e-4 of an elliptic one.
    assert_allclose(total(line, points, found), expected, rtol=limit)


def test_panels_converge_with_the_square_of_their_number():
    exact = prandtl(ellipse)
    errors = []
    for panels in (3, 6, 12):
        points, found = straight(cc.LiftingLine(panels=panels), HALF_SPAN, ellipse)
        errors.append(np.max(np.abs(found / exact(points) - 1)))
    assert_allclose([errors[0] / errors[1], errors[1] / errors[2]], 4, rtol=0.02)


def test_single_wing_is_two_halves():
    # The panels of a single wing with 2 N horseshoes are those of a half with N and its image.
    points, half = straight(cc.LiftingLine(panels=6), HALF_SPAN, rectangle)
    both, whole = straight(cc.LiftingLine(panels=12, image=False), 2 * HALF_SPAN, rectangle)
    assert_allclose(2 * both[6:] - 1, points, atol=1e-15)
    # The same sums in another order.
    assert_allclose(whole[6:], half, rtol=1e-12)
    assert_allclose(whole[:6], half[::-1], rtol=1e-12)


def test_line_goes_on_to_the_plane_of_symmetry():
    exact = prandtl(rectangle)
    offset = 0.5
    points, found = straight(cc.LiftingLine(panels=6), HALF_SPAN - offset, rectangle, offset)
    expected = exact((offset + (HALF_SPAN - offset) * points) / HALF_SPAN)
    # As without an offset, where the last panel of a rectangular wing is 5 % off.
    assert_allclose(found[:4], expected[:4], rtol=2e-3)
    assert_allclose(found, expected, rtol=5e-2)


def test_vortices_obey_biot_and_savart():
    point, start, end = np.array([0.3, 0.7, -0.4]), np.array([1.0, 0, 0.2]), np.array([2, 0.5, 0])
    direction = np.array([0.6, -0.8, 0])

    def element(position, tangent):
        arm = point - position
        return np.cross(tangent, arm) / (4 * np.pi * np.linalg.norm(arm) ** 3)

    bound, _ = quad_vec(lambda t: element(start + t * (end - start), end - start), 0, 1)
    trailing, _ = quad_vec(lambda t: element(start + t * direction, direction), 0, np.inf)
    assert_allclose(induced.bound_velocity(*map(ca.DM, (point, start, end))).full().ravel(), bound)
    found = induced.trailing_velocity(*map(ca.DM, (point, start, direction)))
    assert_allclose(found.full().ravel(), trailing, rtol=1e-6)  # of the infinite integral


def test_mirrored_line_has_the_same_influence():
    rng = np.random.default_rng(3)
    line = cc.LiftingLine(panels=4)
    panels = induced.panels_of(line)
    corners = np.zeros((3, 5))
    corners[0] = 6 * panels.edges
    corners += 0.2 * rng.standard_normal((3, 5)) * [[0], [1], [1]]
    normals = np.vstack([0.2 * rng.standard_normal((2, 4)), np.ones(4)])
    direction = np.array([0.1, -0.9, 0.3])
    of = induced.influence(4, True, tuple(panels.fractions))
    one = of(corners, normals, direction, [1, 0, 0]).full()
    flip = np.diag([-1.0, 1, 1])
    # The circulation of a mirrored wing runs the other way, from tip to root: −B; its normal
    # along local z points down: −B again.
    other = of(flip @ corners, -flip @ normals, flip @ direction, [1, 0, 0]).full()
    assert_allclose(other, one, rtol=1e-13, atol=1e-15)


def test_image_is_a_wing_of_its_own():
    rng = np.random.default_rng(5)
    line = cc.LiftingLine(panels=3)
    panels = induced.panels_of(line)
    corners = np.zeros((3, 4))
    corners[0] = 5 * panels.edges
    corners[1:, 1:] += 0.3 * rng.standard_normal((2, 3))
    flip = np.diag([-1.0, 1, 1])
    whole = np.hstack([(flip @ corners)[:, :0:-1], corners])
    direction, circulation = [0.0, -1, 0.1], np.array([2.0, 1.5, 0.7])
    point = np.array([0.4, -3.0, 0.6])
    plane = [1, 0, 0]
    half = induced.wake_velocity(3, True)
    pair = half(point, corners, direction, plane, circulation)
    pair += half(point, flip @ corners, direction, plane, -circulation)
    both = np.concatenate([circulation[::-1], circulation])
    single = induced.wake_velocity(6, False)(point, whole, direction, plane, both)
    assert_allclose(pair, single, rtol=1e-12)


def test_elimination_without_pivots_solves(evaluate):
    rng = np.random.default_rng(1)
    matrix, right = np.eye(5) * 3 + rng.uniform(-0.5, 0.5, (5, 5)), rng.uniform(size=5)
    found = evaluate(induced.unpivoted_solve, matrix, right)
    assert_allclose(found.ravel(), np.linalg.solve(matrix, right), rtol=1e-13)


def test_stations_and_panels_exchange_what_is_smooth():
    stations = (1 + np.polynomial.legendre.leggauss(6)[0]) / 2
    for image in (True, False):
        line = cc.LiftingLine(panels=6, image=image)
        maps = induced.span_maps(line, stations)
        panels = induced.panels_of(line)
        cubic = np.polynomial.Polynomial([0.3, -1, 2, 0.5])
        known = cubic(np.concatenate([[0], stations]))
        assert_allclose(maps.to_edges @ known, cubic(panels.edges), atol=1e-13)
        assert_allclose(maps.to_points @ known, cubic(panels.points), atol=1e-13)
        assert_allclose(maps.fitted @ cubic(stations), cubic(panels.points), atol=1e-13)
        shape = induced.circulation_shapes(line, panels.points)[:, 2]
        expected = induced.circulation_shapes(line, stations)[:, 2]
        assert_allclose(maps.back @ shape, expected, atol=1e-12)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"panels": 0}, "LiftingLine.panels"),
        ({"panels": 40}, "LiftingLine.panels: expected at most 24"),
        ({"frozen": "yes"}, "LiftingLine.frozen: expected a bool"),
        ({"image": 0}, "LiftingLine.image: expected a bool"),
        ({"plane": [0, 2, 0]}, "LiftingLine.plane"),
        ({"plane": [0, 1]}, "LiftingLine.plane"),
    ],
)
def test_bad_input_is_named(fields, message):
    with pytest.raises(ValueError, match=message):
        cc.LiftingLine(**fields)
