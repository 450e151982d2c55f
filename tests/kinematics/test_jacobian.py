"""Twists and Jacobians against AD of the chain, finite motions and the compatibility condition."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from numpy.testing import assert_allclose

import curvcasadi as cc
from tests.support import oracle
from tests.support.oracle import CURLED_WEIGHTS

RULES = ["trapezoid", "midpoint", "magnus4", "magnus6"]
RATE = 0.3 * np.sin(1.0 + np.arange(12))
ROOT = cc.Pose(rotation=oracle.rotation([0.4, -1.2, 0.8]), position=[0.3, 1.0, -0.2])
STATIONS = [0.2, 0.47, 1.0]  # on and off a grid of five


def initial(xi):
    return np.array([0.01 * xi, -0.02, 0.005 * xi**2])


def jacobian_by_ad(beam, q, xi):
    """Body Jacobian from derivatives of the pose of the unrolled chain."""
    pose = cc.pose_at(beam, q, xi)
    R, columns = pose.rotation, []
    for i in range(beam.basis.n):
        dR = ca.reshape(ca.jacobian(ca.vec(R), q[i]), 3, 3)
        angular = R.T @ dR
        linear = R.T @ ca.jacobian(pose.position, q[i])
        columns.append(ca.vertcat(angular[2, 1], angular[0, 2], angular[1, 0], linear))
    return ca.horzcat(*columns)


def assert_relative(got, expected, tolerance):
    """Angular and linear rows have different units: each to `tolerance` of its largest entry."""
    got, expected = np.array(got), np.array(expected)
    assert got.shape == expected.shape
    for rows in (slice(0, 3), slice(3, 6)):
        scale = max(np.abs(expected[rows]).max(), 1e-300)
        assert_allclose(got[rows], expected[rows], rtol=0, atol=tolerance * scale)


# Body Jacobian ---------------------------------------------------------------------------------


@pytest.mark.parametrize("xi", STATIONS)
@pytest.mark.parametrize("rule", RULES)
def test_body_jacobian_equals_ad_of_the_chain(wing, rule, xi):
    beam = wing(5, rule, root=ROOT, initial_curvature=initial)
    q = ca.SX.sym("q", 12)
    f = ca.Function("f", [q], [cc.body_jacobian(beam, q, xi), jacobian_by_ad(beam, q, xi)])
    for weights in (CURLED_WEIGHTS, np.zeros(12)):
        got, expected = f(weights)
        # Both are exact; rounding, 1e-13 is asked for.
        assert_relative(got, expected, 1e-13)


def test_body_jacobian_with_rodrigues_equals_ad(wing):
    beam = wing(5, exponential="rodrigues")
    q = ca.SX.sym("q", 12)
    f = ca.Function("f", [q], [cc.body_jacobian(beam, q), jacobian_by_ad(beam, q, 1.0)])
    for weights in (CURLED_WEIGHTS, np.zeros(12)):
        # The closed forms divide rounding by θ², of 0.01 at least.
        assert_relative(*f(weights), 1e-12)


def test_body_jacobian_of_coupled_and_broken_bases_equals_ad():
    def function(xi):
        return np.array([[0.5, xi], [-1, xi**2], [0.2, 1 - xi]])

    piecewise = cc.ChannelBasis(torsion=cc.PiecewiseConstant(2), in_plane=cc.PiecewiseConstant(3))
    for basis in (cc.VectorBasis(function, 2), piecewise):
        beam = cc.Beam(length=6.0, basis=basis, grid=cc.Grid.lobatto(5), initial_curvature=initial)
        q = ca.SX.sym("q", basis.n)
        for xi in (0.4, 1.0):
            pair = [cc.body_jacobian(beam, q, xi), jacobian_by_ad(beam, q, xi)]
            f = ca.Function("f", [q], pair)
            assert_relative(*f(0.1 * np.cos(np.arange(basis.n))), 1e-13)  # rounding


def test_body_jacobian_of_the_mirrored_wing_equals_ad(wing):
    beam = cc.mirror(wing(4, root=ROOT, initial_curvature=initial))
    q = ca.SX.sym("q", 12)
    f = ca.Function("f", [q], [cc.body_jacobian(beam, q, 0.6), jacobian_by_ad(beam, q, 0.6)])
    assert_relative(*f(CURLED_WEIGHTS), 1e-13)  # rounding


def test_body_jacobian_does_not_depend_on_the_root(wing):
    a, b = (
        cc.body_jacobian(wing(4, root=root), CURLED_WEIGHTS) for root in (ROOT, cc.Pose.identity())
    )
    assert_allclose(a, b, rtol=0, atol=0)


@pytest.mark.parametrize("name", ["body_jacobian", "body_jacobian_rate", "body_twist"])
def test_twists_and_jacobians_agree_in_all_kinds(wing, evaluate, name):
    beam = wing(4)
    arguments = [CURLED_WEIGHTS] if name == "body_jacobian" else [CURLED_WEIGHTS, RATE]
    f = getattr(cc, name)
    got = evaluate(lambda *a: f(beam, *a, xi=0.6), *arguments)
    assert_relative(got, f(beam, *arguments, xi=0.6), 1e-14)  # the same operations


@pytest.mark.parametrize("name", ["body_jacobian", "body_jacobian_rate", "body_twist"])
def test_nothing_moves_at_the_root(wing, kind, name):
    q = CURLED_WEIGHTS if kind is ca.DM else kind.sym("q", 12)
    rates = () if name == "body_jacobian" else (RATE,)
    value = ca.evalf(getattr(cc, name)(wing(4), q, *rates, xi=0.0))
    assert value.shape == ((6, 1) if name == "body_twist" else (6, 12))
    assert_allclose(value, 0, atol=0)


def test_jacobian_of_the_straight_wing_is_known():
    basis = cc.ChannelBasis(
        torsion=cc.Legendre(1), out_of_plane=cc.Legendre(1), in_plane=cc.Legendre(1)
    )
    beam = cc.Beam(length=4.0, basis=basis, grid=cc.Grid.uniform(3))
    L = 4.0
    # K_y bends towards −z, K_z towards +y, each by L²/2.
    expected = [[L, 0, 0], [0, L, 0], [0, 0, L], [0, 0, 0], [0, 0, L**2 / 2], [0, -(L**2) / 2, 0]]
    assert_allclose(cc.body_jacobian(beam, [0, 0, 0]), expected, atol=1e-14)  # rounding


def test_derivatives_of_the_jacobian_are_finite_and_right_at_the_straight_wing(wing, symbolic):
    q = symbolic.sym("q", 12)
    beam = wing(3)
    J = cc.body_jacobian(beam, q)
    f = ca.Function("f", [q], [ca.jacobian(ca.vec(J), q)])
    rate = f(0).full().reshape(12, 6, 12).transpose(1, 0, 2) @ RATE
    assert_relative(rate, cc.body_jacobian_rate(beam, np.zeros(12), RATE), 1e-13)  # rounding


# Rate of the Jacobian --------------------------------------------------------------------------


@pytest.mark.parametrize("xi", STATIONS)
@pytest.mark.parametrize("rule", RULES)
def test_body_jacobian_rate_equals_ad(wing, rule, xi):
    beam = wing(5, rule, initial_curvature=initial)
    q, q_dot = ca.SX.sym("q", 12), ca.SX.sym("q_dot", 12)
    J = jacobian_by_ad(beam, q, xi)
    by_ad = ca.reshape(ca.jtimes(ca.vec(J), q, q_dot), 6, 12)
    f = ca.Function("f", [q, q_dot], [cc.body_jacobian_rate(beam, q, q_dot, xi), by_ad])
    for weights in (CURLED_WEIGHTS, np.zeros(12)):
        # Second derivatives of the whole chain lose a digit more than first ones.
        assert_relative(*f(weights, RATE), 1e-12)


# Twist -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("xi", STATIONS)
@pytest.mark.parametrize("rule", RULES)
def test_body_twist_is_the_jacobian_times_the_rate(wing, rule, xi):
    beam = wing(5, rule, root=ROOT, initial_curvature=initial)
    twist = cc.body_twist(beam, CURLED_WEIGHTS, RATE, xi)
    expected = cc.body_jacobian(beam, CURLED_WEIGHTS, xi) @ RATE
    assert_relative(twist, expected, 1e-13)  # rounding


@pytest.mark.parametrize("xi", STATIONS)
def test_body_twist_with_a_root_twist_is_the_motion_of_the_composed_pose(wing, xi):
    root_twist = np.array([0.5, -0.3, 0.8, 2.0, -1.0, 0.7])

    def pose(t):
        root = oracle.homogeneous(ROOT.rotation.full(), ROOT.position.full()) @ oracle.expm(
            t * oracle.twist_matrix(root_twist)
        )
        moved = cc.Pose(rotation=root[:3, :3], position=root[:3, 3])
        station = cc.pose_at(wing(5, root=moved), CURLED_WEIGHTS + t * RATE, xi)
        return oracle.homogeneous(station.rotation.full(), station.position.full())

    d = 1e-3
    coefficients = {-3: -1, -2: 9, -1: -45, 1: 45, 2: -9, 3: 1}
    rate = sum(c * pose(k * d) for k, c in coefficients.items())
    expected = oracle.body_twist_of(pose(0), rate / (60 * d))
    got = cc.body_twist(wing(5, root=ROOT), CURLED_WEIGHTS, RATE, xi, root_twist=root_twist)
    # Central differences of order six: (1e-3 times rates of 10 rad/s)^6, and rounding of 10 m / d.
    assert_allclose(got.full()[:, 0], expected, atol=3e-10)


def test_twist_of_the_root_is_the_root_twist(wing):
    root_twist = np.arange(1.0, 7.0)
    got = cc.body_twist(wing(4), CURLED_WEIGHTS, RATE, 0.0, root_twist=root_twist)
    assert_allclose(got.full()[:, 0], root_twist, rtol=0)


@pytest.mark.parametrize("with_root", [False, True])
def test_rates_are_compatible_with_curvature_rates(wing, with_root):
    """dOmega/ds = dK/dt + Omega × K along the span."""
    beam = wing(128, "magnus6")
    root_twist = np.array([0.5, -0.3, 0.8, 2.0, -1.0, 0.7]) if with_root else None
    exact = oracle.integrate(oracle.curled_curvature, 16.0)[0][1]
    tip = cc.shape_map(beam, CURLED_WEIGHTS).tip.position.full()[:, 0]
    assert np.linalg.norm(tip - exact) < 1e-12 * 16  # the grid resolves the shape

    def omega(xi):
        twist = cc.body_twist(beam, CURLED_WEIGHTS, RATE, xi, root_twist=root_twist)
        return twist.full()[:3, 0]

    d = 0.01
    coefficients = {1: 4 / 5, 2: -1 / 5, 3: 4 / 105, 4: -1 / 280}
    for xi in (0.1, 0.43, 0.9):
        slope = sum(c * (omega(xi + k * d) - omega(xi - k * d)) for k, c in coefficients.items())
        slope = slope / (d * 16.0)
        K, K_dot = oracle.curled_curvature(xi), oracle.wing_curvature(xi, RATE)
        # Differences of order eight: rounding 1e-14/d, and d^8 times the ninth derivative, some
        # (16 m × 0.2 rad/m)^9 / 630, leave 1e-11; 1e-9 is asked for.
        assert_allclose(slope, K_dot + np.cross(omega(xi), K), atol=1e-9)


def test_strain_of_the_pose_is_the_curvature_and_the_tangent(wing):
    """T' = T ξ^ with ξ = (K, e_x), along the span."""
    beam = wing(128, "magnus6")
    d = 0.01

    def pose(xi):
        station = cc.pose_at(beam, CURLED_WEIGHTS, xi)
        return oracle.homogeneous(station.rotation.full(), station.position.full())

    for xi in (0.1, 0.43, 0.9):
        coefficients = {1: 4 / 5, 2: -1 / 5, 3: 4 / 105, 4: -1 / 280}
        slope = sum(c * (pose(xi + k * d) - pose(xi - k * d)) for k, c in coefficients.items())
        strain = oracle.body_twist_of(pose(xi), slope / (d * 16.0))
        # As above.
        assert_allclose(strain, [*oracle.curled_curvature(xi), 1, 0, 0], atol=1e-9)


# Symbols in the beam ---------------------------------------------------------------------------


def test_twists_of_a_beam_of_symbolic_length_and_curvature(symbolic):
    length, k0 = symbolic.sym("L"), symbolic.sym("k0", 3)
    basis = cc.ChannelBasis(out_of_plane=cc.Legendre(2), torsion=cc.Legendre(1))
    beam = cc.Beam(length=length, basis=basis, grid=cc.Grid.uniform(4), initial_curvature=k0)
    q, q_dot = [0.05, -0.1, 0.04], [1.0, 0.5, -0.3]
    root_twist = np.arange(6.0)
    outputs = [
        cc.body_jacobian(beam, q, 0.6),
        cc.body_jacobian_rate(beam, q, q_dot, 0.6),
        cc.body_twist(beam, q, q_dot, 0.6, root_twist=root_twist),
    ]
    f = ca.Function("f", [length, k0], outputs)
    plain = replace(beam, length=8.0, initial_curvature=[0.01, 0.02, 0.03])
    expected = [
        cc.body_jacobian(plain, q, 0.6),
        cc.body_jacobian_rate(plain, q, q_dot, 0.6),
        cc.body_twist(plain, q, q_dot, 0.6, root_twist=root_twist),
    ]
    for got, value in zip(f(8.0, [0.01, 0.02, 0.03]), expected, strict=True):
        assert_relative(got, value, 1e-14)  # the same operations


# Bad input -------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["body_jacobian_rate", "body_twist"])
@pytest.mark.parametrize(
    "q_dot, message",
    [
        ([1, 2], r"q_dot: expected shape \(12, 1\), found \(2, 1\)"),
        (np.full(12, np.nan), r"q_dot: expected finite"),
        (1.0, r"q_dot: expected shape \(12, 1\), found \(1, 1\)"),
    ],
    ids=str,
)
def test_rates_of_a_wrong_shape_are_refused(wing, name, q_dot, message):
    with pytest.raises(ValueError, match=message):
        getattr(cc, name)(wing(2), np.zeros(12), q_dot)


@pytest.mark.parametrize("root_twist", [[1, 2, 3], 1.0, [1, 2, 3, 4, 5, np.nan]])
def test_root_twists_of_a_wrong_shape_are_refused(wing, root_twist):
    with pytest.raises(ValueError, match=r"root_twist: expected"):
        cc.body_twist(wing(2), np.zeros(12), np.zeros(12), root_twist=root_twist)


def test_kinds_that_do_not_mix_are_named(wing):
    q, q_dot = ca.SX.sym("q", 12), ca.MX.sym("q_dot", 12)
    with pytest.raises(ValueError, match=r"q is SX, q_dot is MX"):
        cc.body_jacobian_rate(wing(2), q, q_dot)
    with pytest.raises(ValueError, match=r"q is SX.*root_twist is MX"):
        cc.body_twist(wing(2), q, np.zeros(12), root_twist=ca.MX.sym("V", 6))


def test_a_root_twist_that_does_not_mix_with_the_beam_is_named(wing):
    beam = wing(2, length=ca.SX.sym("L"))
    with pytest.raises(ValueError, match=r"Beam\.length is SX.*root_twist is MX|root_twist is MX"):
        cc.body_twist(beam, np.zeros(12), np.zeros(12), root_twist=ca.MX.sym("V", 6))


# Laws ------------------------------------------------------------------------------------------

weights = st.lists(st.floats(-0.05, 0.05), min_size=12, max_size=12)


@settings(deadline=None, max_examples=15, derandomize=True)
@given(weights, weights, st.floats(-2, 2))
def test_twists_are_linear_in_the_rate(q, q_dot, factor):
    basis = cc.ChannelBasis(
        torsion=cc.Legendre(4), out_of_plane=cc.Legendre(4), in_plane=cc.Legendre(4)
    )
    beam = cc.Beam(length=16.0, basis=basis, grid=cc.Grid.uniform(6))
    once = cc.body_twist(beam, q, q_dot).full()
    scaled = cc.body_twist(beam, q, factor * np.array(q_dot)).full()
    assert_allclose(scaled, factor * once, atol=1e-13)  # rounding of some 30 m/s


@settings(deadline=None, max_examples=15, derandomize=True)
@given(weights)
def test_jacobians_of_a_wing_and_its_mirror_image(q):
    basis = cc.ChannelBasis(
        torsion=cc.Legendre(4), out_of_plane=cc.Legendre(4), in_plane=cc.Legendre(4)
    )
    beam = cc.Beam(length=16.0, basis=basis, grid=cc.Grid.uniform(6))
    flip = np.diag([-1, -1, 1, 1, 1, -1])  # of twists, in local axes
    got = cc.body_jacobian(cc.mirror(beam), q).full()
    assert_allclose(got, flip @ cc.body_jacobian(beam, q).full(), atol=2e-13)  # rounding of 130 m²
