"""One element: rules, exponentials, and what an element costs."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.linalg import expm, logm

import curvcasadi as cc
from curvcasadi.kinematics import element
from curvcasadi.kinematics.rules import RULES as RULES_BY_NAME
from tests.support import oracle
from tests.support.oracle import CURLED_WEIGHTS, WING_LENGTH

RULES = list(RULES_BY_NAME)
ANGLES = [0.0, 1e-9, 1e-4, 0.0999, 0.1001, 0.5, 1.0]
AXIS = np.array([0.6, -0.48, 0.64])


def step(exponential, degree=9):
    """(θ, v) -> R_e, p_e."""
    theta, v = ca.SX.sym("theta", 3), ca.SX.sym("v", 3)
    out = element.advance(ca.SX.eye(3), ca.SX.zeros(3), (theta, v), exponential, degree)
    return ca.Function("step", [theta, v], [*out])


def element_pose(exponential, angle, v=(1.0, 0.1, -0.2)):
    R, p = step(exponential)(angle * AXIS, v)
    return R.full(), p.full()[:, 0]


# Rules -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", RULES)
def test_rules_are_consistent(name):
    rule = RULES_BY_NAME[name]
    W = np.array(rule.weights)
    # Moments of a constant: the first is its mean, the others vanish.
    assert_allclose(W.sum(axis=1), np.eye(len(W))[0], atol=1e-15)
    assert_allclose(np.array(rule.points) + np.array(rule.points)[::-1], 1, atol=1e-15)


@pytest.mark.parametrize("name", RULES)
def test_strain_has_the_order_of_the_rule(name):
    """The strain of one element against the logarithm of the ODE solution: error h^(order + 1)."""
    rule = RULES_BY_NAME[name]
    h, moments = ca.SX.sym("h"), ca.SX.sym("moments", 3, len(rule.weights))
    strain = ca.Function("strain", [h, moments], [ca.vertcat(*rule.strain(h, moments))])

    def curvature(xi):
        return np.array([0.6 + 0.5 * xi, -0.8 * np.cos(2 * xi), 0.7 * xi**2 - 0.3])

    errors, sizes = [], (0.8, 0.4, 0.2) if name == "magnus6" else (0.2, 0.1, 0.05)
    for size in sizes:
        K = np.array([curvature(0.5 + size * (x - 0.5)) for x in rule.points])
        got = strain(size, size * K.T @ np.array(rule.weights).T).full()[:, 0]
        pose = oracle.homogeneous(
            *oracle.integrate(lambda x, size=size: curvature(0.5 + size * (x - 0.5)), size)[0]
        )
        log = np.real(logm(pose))
        exact = np.array([log[2, 1], log[0, 2], log[1, 0], *log[:3, 3]])
        errors.append(np.linalg.norm(got - exact))
    orders = np.log2(np.array(errors)[:-1] / np.array(errors)[1:])
    # Symmetric rules: the local error is h^(order + 1), observed within 0.3.
    assert_allclose(orders, rule.order + 1, atol=0.3)


def test_fourth_order_strain_is_the_published_formula():
    h, K1, K2 = 0.7, np.array([0.3, -0.5, 0.2]), np.array([-0.1, 0.4, 0.6])
    rule = RULES_BY_NAME["magnus4"]
    hs, moments = ca.SX.sym("h"), ca.SX.sym("moments", 3, 2)
    strain = ca.Function("strain", [hs, moments], [*rule.strain(hs, moments)])
    theta, v = strain(h, h * np.column_stack([K1, K2]) @ np.array(rule.weights).T)
    c = np.sqrt(3) * h**2 / 12
    # Rounding.
    assert_allclose(theta.full()[:, 0], h / 2 * (K1 + K2) + c * np.cross(K1, K2), atol=1e-16)
    expected = h * np.array([1, 0, 0]) + c * np.cross(K1 - K2, [1, 0, 0])
    assert_allclose(v.full()[:, 0], expected, atol=1e-16)


# Exponentials ----------------------------------------------------------------------------------


@pytest.mark.parametrize("exponential", ["series", "rodrigues"])
@pytest.mark.parametrize("angle", ANGLES)
def test_exact_exponentials_equal_the_matrix_exponential(exponential, angle):
    R, p = element_pose(exponential, angle)
    pose = expm(oracle.twist_matrix([*(angle * AXIS), 1.0, 0.1, -0.2]))
    # Rounding; expm is good to 1e-15, and rodrigues divides it by 0.01 beyond 0.1 rad, times α.
    assert_allclose(R, pose[:3, :3], atol=3e-15)
    assert_allclose(p, pose[:3, 3], atol=3e-15)


@pytest.mark.parametrize("angle", [1.5, 3.0])
def test_rodrigues_holds_for_any_angle(angle):
    R, p = element_pose("rodrigues", angle)
    pose = expm(oracle.twist_matrix([*(angle * AXIS), 1.0, 0.1, -0.2]))
    assert_allclose(R, pose[:3, :3], atol=3e-15)  # rounding
    assert_allclose(p, pose[:3, 3], atol=3e-15)


def test_polynomials_degrade_gently_beyond_their_range():
    for angle, error in [(1.0, 1e-13), (np.pi / 2, 2e-10), (np.pi, 2e-5)]:
        R, _ = step("series", 6)(angle * AXIS, [1, 0, 0])
        # Degree 6 serves 0.5 rad; the first omitted terms bound the error beyond.
        assert_allclose(R, oracle.rotation(angle * AXIS), atol=error)


def test_rodrigues_has_right_derivatives_around_zero(symbolic):
    theta = symbolic.sym("theta", 3)
    v = ca.DM([1.0, 0.1, -0.2])
    parts = []
    for exponential in ("rodrigues", "series"):
        R, p = step(exponential, 15)(theta, v)
        entries = ca.vertcat(ca.vec(R), p)
        jacobian = ca.jacobian(entries, theta)
        parts.append([jacobian, ca.jacobian(ca.vec(jacobian), theta)])
    f = ca.Function("f", [theta], [part for pair in parts for part in pair])
    for angle in [*ANGLES, 0.1]:
        first, second, series_first, series_second = (part.full() for part in f(angle * AXIS))
        # Rounding, divided by θ² = 0.01 once for each derivative of the closed form.
        assert_allclose(first, series_first, atol=1e-13)
        assert_allclose(second, series_second, atol=1e-11)
    assert np.abs(f(0)[0].full()).max() == 1.0


@pytest.mark.parametrize(
    "exponential, rotation_order, position_order",
    [("small_angle_sine", 2, 2), ("small_angle", 2, 2)],
)
def test_approximations_have_their_order(exponential, rotation_order, position_order):
    errors = []
    for angle in (0.04, 0.02, 0.01):
        R, p = element_pose(exponential, angle)
        pose = expm(oracle.twist_matrix([*(angle * AXIS), 1.0, 0.1, -0.2]))
        errors.append([np.linalg.norm(R - pose[:3, :3]), np.linalg.norm(p - pose[:3, 3])])
    orders = np.log2(np.array(errors)[:-1] / np.array(errors)[1:])
    # The first omitted terms are b [θ×]² and d [θ×]² v, both of second order; the next is smaller
    # by 0.04 rad.
    assert_allclose(orders[:, 0], rotation_order, atol=0.02)
    assert_allclose(orders[:, 1], position_order, atol=0.02)


@pytest.mark.parametrize("angle", [0.05, 0.3])
def test_sine_approximation_is_equation_15(angle):
    R, p = element_pose("small_angle_sine", angle)
    hat = oracle.hat(AXIS)
    v = np.array([1.0, 0.1, -0.2])
    # Rounding.
    assert_allclose(R, np.eye(3) + np.sin(angle) * hat, atol=1e-15)
    assert_allclose(p, v + (1 - np.cos(angle)) / angle * hat @ v, atol=1e-15)


@pytest.mark.parametrize("angle", [0.05, 0.3])
def test_small_angle_approximation_is_first_order(angle):
    R, p = element_pose("small_angle", angle)
    hat = angle * oracle.hat(AXIS)
    v = np.array([1.0, 0.1, -0.2])
    assert_allclose(R, np.eye(3) + hat, atol=1e-16)  # rounding
    assert_allclose(p, v + hat @ v / 2, atol=1e-15)


@pytest.mark.parametrize(
    "exponential, defect",
    [("small_angle_sine", lambda a: np.sin(a) ** 2), ("small_angle", lambda a: a**2)],
)
def test_approximations_leave_the_rotation_group(exponential, defect):
    for angle in (0.05, 0.3):
        R, _ = element_pose(exponential, angle)
        # I + a [n×] has two singular values √(1 + a²): their square exceeds one by a².
        got = np.linalg.norm(R.T @ R - np.eye(3), 2)
        assert_allclose(got, defect(angle), rtol=1e-12)  # rounding beside 2.5e-3


@pytest.mark.parametrize("max_angle", [0.3, 1.0])
def test_grids_for_single_precision_are_as_good_as_single_precision(wing, max_angle):
    grid = cc.Grid.uniform(16, real="float", max_angle=max_angle)
    assert grid.degree < cc.Grid.uniform(16, max_angle=max_angle).degree
    coarse, exact = (
        cc.shape_map(beam, CURLED_WEIGHTS).tip for beam in (wing(16, grid=grid), wing(16))
    )
    # The polynomials are truncated at 1e-8; sixteen elements add up to 1e-6 L at most.
    assert_allclose(coarse.position, exact.position, atol=1e-6 * WING_LENGTH)
    assert_allclose(coarse.rotation, exact.rotation, atol=1e-6)


@pytest.mark.parametrize("exponential", ["small_angle_sine", "small_angle"])
def test_approximations_leave_the_rotation_group_along_a_wing(wing, exponential):
    R = cc.shape_map(wing(16, exponential=exponential), CURLED_WEIGHTS).tip.rotation.full()
    # Sixteen elements of some 0.1 rad: each adds 0.01.
    assert np.linalg.norm(R.T @ R - np.eye(3)) > 1e-2
    exact = cc.shape_map(wing(16), CURLED_WEIGHTS).tip.rotation.full()
    assert_allclose(exact.T @ exact, np.eye(3), atol=2e-14)  # rounding of sixteen products


@pytest.mark.parametrize("exponential", ["small_angle_sine", "small_angle"])
@pytest.mark.parametrize("name", ["body_jacobian", "body_jacobian_rate", "body_twist"])
def test_twists_refuse_exponentials_that_leave_the_group(wing, exponential, name):
    rates = () if name == "body_jacobian" else (np.ones(12),)
    with pytest.raises(ValueError, match=rf"Grid\.exponential: .*series.*found '{exponential}'"):
        getattr(cc, name)(wing(2, exponential=exponential), np.zeros(12), *rates)


@pytest.mark.parametrize("rule", RULES)
def test_rodrigues_and_series_give_the_same_wing(wing, rule):
    a, b = (
        cc.shape_map(wing(8, rule, exponential=name), CURLED_WEIGHTS).tip
        for name in ("series", "rodrigues")
    )
    # Rounding of 16 m in eight elements.
    assert_allclose(a.position, b.position, atol=3e-14)
    assert_allclose(a.rotation, b.rotation, atol=5e-15)


@pytest.mark.parametrize("angle", [0.0, 0.05, 0.2])
def test_jacobian_of_rodrigues_equals_that_of_the_series(angle):
    basis = cc.ChannelBasis(
        torsion=cc.Legendre(1), out_of_plane=cc.Legendre(1), in_plane=cc.Legendre(1)
    )
    a, b = (
        cc.body_jacobian(
            cc.Beam(length=1.0, basis=basis, grid=cc.Grid.uniform(1, exponential=name)),
            angle * AXIS,
        )
        for name in ("series", "rodrigues")
    )
    # The closed c_5 divides rounding by θ⁴ = 1e-4, and is multiplied by θ².
    assert_allclose(a, b, atol=1e-13)


# Cost ------------------------------------------------------------------------------------------


def nodes(beam, with_jacobian=False):
    q = ca.SX.sym("q", beam.basis.n)
    tip = cc.shape_map(beam, q).tip
    outputs = [tip.position, tip.rotation]
    if with_jacobian:
        f = cc.tip_function(beam, "unrolled", jacobian=True)
        return f.n_instructions()
    return ca.Function("f", [q], outputs, {"cse": True}).n_instructions()


def test_cost_is_affine_in_the_number_of_elements(wing):
    for with_jacobian in (False, True):
        once, twice = (nodes(wing(n), with_jacobian) for n in (32, 64))
        assert_allclose(twice, 2 * once, rtol=0.05)


def test_cost_is_affine_in_the_number_of_weights():
    counts = []
    for n in (2, 4, 6):
        family = cc.Legendre(n)
        basis = cc.ChannelBasis(torsion=family, out_of_plane=family, in_plane=family)
        beam = cc.Beam(length=WING_LENGTH, basis=basis, grid=cc.Grid.uniform(16))
        counts.append([nodes(beam), nodes(beam, with_jacobian=True)])
    steps = np.diff(counts, axis=0)
    # A constant function and a symmetric grid save a few products of the first weights.
    assert_allclose(steps[0], steps[1], rtol=0.15)


def test_forward_and_jacobian_stay_within_their_budget(wing):
    beam = wing(32)
    forward, with_jacobian = nodes(beam), nodes(beam, with_jacobian=True)
    assert forward <= 210 * 32
    assert with_jacobian <= 930 * 32
    q = ca.SX.sym("q", 12)
    tip = cc.shape_map(beam, q).tip
    pose = ca.vertcat(tip.position, ca.vec(tip.rotation))
    by_ad = ca.Function("f", [q], [pose, ca.jacobian(pose, q)], {"cse": True})
    assert with_jacobian <= 0.3 * by_ad.n_instructions()
