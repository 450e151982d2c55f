"""One test per numbered equation of the paper."""

from __future__ import annotations

from itertools import pairwise

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose

import curvcasadi as cc
from curvcasadi.lie import so3
from tests.support import oracle
from tests.support.oracle import CURLED_WEIGHTS, WING_LENGTH

ONE_OF_EACH = cc.ChannelBasis(
    torsion=cc.Legendre(1), out_of_plane=cc.Legendre(1), in_plane=cc.Legendre(1)
)
RATE = 0.2 * np.cos(np.arange(12))
ROOT = cc.Pose(rotation=oracle.rotation([0.3, -1.0, 2.0]), position=[1, -2, 3])


def differences(f, x, d):
    """df/dx by central differences of order four."""
    return (8 * (f(x + d) - f(x - d)) - (f(x + 2 * d) - f(x - 2 * d))) / (12 * d)


def one_element(K, s, exponential="series"):
    """Tip of one element of constant curvature K and length s."""
    grid = cc.Grid.uniform(1, exponential=exponential, max_angle=np.pi)
    return cc.shape_map(cc.Beam(length=s, basis=ONE_OF_EACH, grid=grid), K).tip


def test_equation_1_deformation_map_in_time(wing):
    """dD/dt = −[Omega×] D."""
    beam = wing(5, root=ROOT)

    def D(t):
        return cc.pose_at(beam, CURLED_WEIGHTS + t * RATE, 0.7).deformation_map.full()

    omega = cc.body_twist(beam, CURLED_WEIGHTS, RATE, 0.7).full()[:3, 0]
    # Differences of order four: (1e-4 times rates of 10 rad/s)^4, and rounding of 1e-16/1e-4.
    assert_allclose(differences(D, 0.0, 1e-4), -oracle.hat(omega) @ D(0), atol=1e-9)


def test_equation_2_deformation_map_along_the_span(wing):
    """dD/ds = −[K×] D."""
    beam = wing(64, "magnus6", root=ROOT)

    def D(xi):
        return cc.pose_at(beam, CURLED_WEIGHTS, xi).deformation_map.full()

    slope = differences(D, 0.4, 1e-3) / WING_LENGTH
    # Differences of order four: (0.016 m times 0.1 rad/m)^4 = 1e-11.
    assert_allclose(slope, -oracle.hat(oracle.curled_curvature(0.4)) @ D(0.4), atol=1e-10)


def test_equation_3_curvature_is_a_sum_of_basis_functions(wing, evaluate):
    """K(s) = K_0(s) + Σ q_i Φ_i(s)."""
    k0 = np.array([0.01, -0.02, 0.03])
    beam = wing(2, initial_curvature=k0)
    got = evaluate(lambda q: cc.curvature(beam, q, 0.37), CURLED_WEIGHTS)
    assert_allclose(got[:, 0], k0 + oracle.curled_curvature(0.37), atol=1e-16)  # rounding


def test_equation_4_position_is_the_integral_of_the_tangent(wing):
    """p(s) = p_0 + ∫ Dᵀ e_x dS."""
    beam = wing(64, "magnus6", root=ROOT)

    def p(xi):
        return cc.pose_at(beam, CURLED_WEIGHTS, xi).position.full()

    tangent = cc.pose_at(beam, CURLED_WEIGHTS, 0.4).deformation_map.full().T[:, :1]
    # Differences as in Eq. 2, of a position of some 10 m.
    assert_allclose(differences(p, 0.4, 1e-3) / WING_LENGTH, tangent, atol=1e-9)
    first = cc.shape_map(beam, CURLED_WEIGHTS).poses[0]
    assert_allclose(first.position, ROOT.position, rtol=0)


@pytest.mark.parametrize("row", range(5))
def test_equations_5_and_6_deformation_map_of_constant_curvature(published, row):
    """D(s) = exp(−s [K×]) D_0 = (I − sin(αs)/α [K×] + (1 − cos(αs))/α² [K×]²) D_0, α = |K|."""
    case = published("21")["reference"][row]
    K, s = np.array(case["K"]), case["s"]
    alpha, hat = np.linalg.norm(K), oracle.hat(K)
    printed = (
        np.eye(3) - np.sin(alpha * s) / alpha * hat + (1 - np.cos(alpha * s)) / alpha**2 * hat @ hat
    )
    # The coefficient functions take any angle up to π; Eq. 6 as printed is good to 1e-9 at 1e-7.
    if alpha * s <= np.pi * (1 + 1e-9):
        assert_allclose(one_element(K, s).deformation_map, printed, atol=1e-13)
        assert_allclose(one_element(K, s).deformation_map, case["D_matrix"], atol=5e-10)
    closed = cc.shape_map(
        cc.Beam(
            length=s,
            basis=ONE_OF_EACH,
            grid=cc.Grid.uniform(8, exponential="rodrigues", max_angle=2.0),
        ),
        K,
    ).tip.deformation_map
    assert_allclose(closed, printed, atol=1e-13)  # rounding of eight products


def test_equation_7_channels_of_the_total_curvature():
    """K = (K_x, K_y, K_z): torsion, out-of-plane bending, in-plane bending."""
    torsion = one_element([0.5, 0, 0], 1.0)
    assert_allclose(torsion.position, [[1], [0], [0]], atol=1e-15)
    assert_allclose(torsion.rotation, oracle.rotation([0.5, 0, 0]), atol=1e-15)
    out_of_plane = one_element([0, 0.5, 0], 1.0).position.full()[:, 0]
    in_plane = one_element([0, 0, 0.5], 1.0).position.full()[:, 0]
    chord, sag = 2 * np.sin(0.5), 2 * (1 - np.cos(0.5))
    assert_allclose(out_of_plane, [chord, 0, -sag], atol=1e-15)  # rounding
    assert_allclose(in_plane, [chord, sag, 0], atol=1e-15)


def test_equation_9_deformation_map_at_the_root(wing):
    """D(0) = D_0, the transpose of the root's rotation."""
    first = cc.shape_map(wing(4, root=ROOT), CURLED_WEIGHTS).poses[0]
    assert_allclose(first.deformation_map, ROOT.rotation.full().T, rtol=0)
    assert_allclose(first.position, ROOT.position, rtol=0)


@pytest.mark.parametrize("row", range(5))
def test_equation_13_position_of_constant_curvature(published, row):
    """p = D_0ᵀ (s K Kᵀ/α² − (cos(αs) − 1)/α² [K×] − sin(αs)/α³ [K×]²) e_x."""
    case = published("21")["reference"][row]
    K, s = np.array(case["K"]), case["s"]
    alpha, hat = np.linalg.norm(K), oracle.hat(K)
    printed = (
        s * np.outer(K, K) / alpha**2
        - (np.cos(alpha * s) - 1) / alpha**2 * hat
        - np.sin(alpha * s) / alpha**3 * hat @ hat
    )[:, 0]
    # As printed it loses nine digits at |K| s = 2e-7, where the cosine cancels.
    near_zero = alpha * s < 1e-3
    if alpha * s <= np.pi * (1 + 1e-9):
        p = one_element(K, s).position.full()[:, 0]
        assert_allclose(p, printed, atol=1e-8 if near_zero else 1e-14)
        assert_allclose(p, case["p"], atol=5e-10)
        assert_allclose(p, oracle.constant_curvature(K, s)[1], atol=1e-14)
    grid = cc.Grid.uniform(8, exponential="rodrigues", max_angle=2.0)
    tip = cc.shape_map(cc.Beam(length=s, basis=ONE_OF_EACH, grid=grid), K).tip
    assert_allclose(tip.position.full()[:, 0], oracle.constant_curvature(K, s)[1], atol=1e-13)


def test_equations_6_and_13_at_zero_curvature_where_they_divide_by_zero(symbolic):
    """Their limits at K → 0, D = I − s [K×] and p = s e_x + s²/2 K × e_x, with derivatives."""
    K = symbolic.sym("K", 3)
    for exponential in ("series", "rodrigues"):
        tip = one_element(K, 2.0, exponential)
        f = ca.Function(
            "f",
            [K],
            [tip.position, ca.jacobian(tip.position, K), ca.jacobian(ca.vec(tip.rotation), K)],
        )
        p, dp, dR = (part.full() for part in f(0))
        assert_allclose(p[:, 0], [2, 0, 0], rtol=0)
        assert_allclose(dp, [[0, 0, 0], [0, 0, 2], [0, -2, 0]], rtol=0, atol=1e-15)
        generators = [2 * oracle.hat(axis).T.ravel() for axis in np.eye(3)]
        assert_allclose(dR, np.transpose(generators), atol=1e-15)


def test_equation_14_euler_step_leaves_the_rotation_group(wing):
    """D ← (I − h [K×]) D: first order, and every step stretches the axes."""
    exact = oracle.integrate(oracle.curled_curvature, WING_LENGTH)[0][0]
    errors, defects = [], []
    for n in (400, 800):
        h, R = WING_LENGTH / n, np.eye(3)
        for k in range(n):
            R = R @ (np.eye(3) + h * oracle.hat(oracle.curled_curvature(k / n)))
        errors.append(np.linalg.norm(R - exact))
        defects.append(np.linalg.norm(R.T @ R - np.eye(3)))
    # First order in both, within 0.1; the exponential of 16 elements stays on the group.
    assert_allclose(np.log2(errors[0] / errors[1]), 1, atol=0.1)
    assert_allclose(np.log2(defects[0] / defects[1]), 1, atol=0.1)
    assert defects[1] > 1e-3
    R = cc.shape_map(wing(16), CURLED_WEIGHTS).tip.rotation.full()
    assert_allclose(R.T @ R, np.eye(3), atol=2e-14)  # rounding


@pytest.mark.parametrize("s", [0.05, 0.4])
def test_equation_15_small_angle_with_the_sine_kept(s):
    """cos(αs) → 1: D = I − sin(αs)/α [K×]; Eq. 13 becomes p = (s I + (1 − cos(αs))/α² [K×]) e_x."""
    K = np.array([0.3, -0.8, 0.2])
    alpha, hat = np.linalg.norm(K), oracle.hat(K)
    tip = one_element(K, s, "small_angle_sine")
    D = np.eye(3) - np.sin(alpha * s) / alpha * hat
    p = s * np.eye(3)[0] + (1 - np.cos(alpha * s)) / alpha**2 * hat[:, 0]
    assert_allclose(tip.deformation_map, D, atol=1e-15)  # rounding
    assert_allclose(tip.position.full()[:, 0], p, atol=1e-15)
    defect = np.linalg.norm(D @ D.T - np.eye(3), 2)
    assert_allclose(defect, np.sin(alpha * s) ** 2, rtol=1e-12)  # it leaves SO(3)


@pytest.mark.parametrize("s", [0.05, 0.4])
def test_equations_16_to_18_small_angle(s):
    """D = I − s [K×], p = (s I + s²/2 [K×]) e_x."""
    K = np.array([0.3, -0.8, 0.2])
    hat = oracle.hat(K)
    tip = one_element(K, s, "small_angle")
    assert_allclose(tip.deformation_map, np.eye(3) - s * hat, atol=1e-15)  # rounding
    assert_allclose(tip.position.full()[:, 0], s * np.eye(3)[0] + s**2 / 2 * hat[:, 0], atol=1e-15)
    exact = oracle.constant_curvature(K, s)
    # Second order in the segment angle αs: half its square, and a sixth of it in the position.
    angle = s * np.linalg.norm(K)
    assert np.linalg.norm(tip.rotation.full() - exact[0], 2) < 0.51 * angle**2
    assert np.linalg.norm(tip.position.full()[:, 0] - exact[1]) < 0.17 * s * angle**2


def test_section_2_5_the_exponential_is_orthogonal_not_skew():
    """exp([k×])ᵀ exp([k×]) = I; the paper's text calls it skew-symmetric."""
    R = so3.exp(ca.DM([0.3, -0.8, 0.2])).full()
    assert_allclose(R.T @ R, np.eye(3), atol=1e-15)  # rounding
    assert np.linalg.norm(R + R.T) > 1


def test_section_3_2_elements_do_not_depend_on_their_neighbours(wing):
    """The pose at each station is the product of element exponentials."""
    beam = wing(6, root=ROOT)
    poses = cc.shape_map(beam, CURLED_WEIGHTS).poses
    product = ROOT
    for (a, b), expected in zip(pairwise(beam.stations), poses[1:], strict=True):
        alone = cc.Beam(
            length=WING_LENGTH * (b - a),
            basis=cc.VectorBasis(lambda x, a=a, b=b: beam.basis(a + (b - a) * x), 12),
            grid=cc.Grid.uniform(1, max_angle=1.5),
        )
        product = product @ cc.shape_map(alone, CURLED_WEIGHTS).tip
        assert_allclose(product.position, expected.position, atol=3e-14)  # rounding of 16 m
        assert_allclose(product.rotation, expected.rotation, atol=5e-15)
