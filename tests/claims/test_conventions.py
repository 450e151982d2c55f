"""One test per row of the table of conventions."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose

import curvcasadi as cc
from curvcasadi.lie import se3
from curvcasadi.reference_wings import RIGHT_WING_ROOT, hale_wing
from tests.support import oracle
from tests.support.oracle import CURLED_WEIGHTS

BENDING = cc.ChannelBasis(
    torsion=cc.Legendre(1), out_of_plane=cc.Legendre(1), in_plane=cc.Legendre(1)
)
RATE = 0.2 * np.cos(np.arange(12))


def bent(K, root=None, length=2.0):
    """Tip pose of a beam of constant curvature K."""
    beam = cc.Beam(
        length=length, basis=BENDING, grid=cc.Grid.uniform(8), root=root or cc.Pose.identity()
    )
    return cc.shape_map(beam, K).tip


def differences(f, x, d=1e-4):
    """df/dx by central differences of order four."""
    return (8 * (f(x + d) - f(x - d)) - (f(x + 2 * d) - f(x - 2 * d))) / (12 * d)


def test_units_weights_are_curvatures_in_rad_per_m():
    # The families are dimensionless: weight 0.1 of a constant function over 5 m turns 0.5 rad.
    tip = bent([0, 0, 0.1], length=5.0)
    assert_allclose(tip.rotation, oracle.rotation([0, 0, 0.5]), atol=1e-14)  # rounding


def test_vectors_are_columns_and_stations_stand_side_by_side(wing):
    beam = wing(4)
    shape = cc.shape_map(beam, CURLED_WEIGHTS)
    assert shape.tip.position.shape == (3, 1)
    assert shape.positions.shape == shape.curvatures.shape == (3, 5)
    assert cc.curvature(beam, ca.DM(CURLED_WEIGHTS), 0.3).shape == (3, 1)
    assert cc.body_twist(beam, CURLED_WEIGHTS, RATE).shape == (6, 1)
    assert cc.squared_element_angles(beam, CURLED_WEIGHTS).shape == (4, 1)


def test_station_is_normalized_arc_length(wing):
    beam = wing(4)
    assert (beam.stations[0], beam.stations[-1]) == (0.0, 1.0)
    straight = cc.pose_at(beam, np.zeros(12), 0.3).position
    assert_allclose(straight, [[0.3 * 16.0], [0], [0]], atol=1e-14)  # rounding
    # The length may be a symbol while the basis stays numeric.
    length = ca.SX.sym("L")
    position = cc.pose_at(replace(beam, length=length), np.zeros(12), 0.3).position
    assert_allclose(ca.Function("f", [length], [position])(2.0), [[0.6], [0], [0]], atol=1e-15)
    assert isinstance(beam.basis(0.3), np.ndarray)


def test_frames_poses_are_given_in_the_parent_frame():
    root = cc.Pose(rotation=oracle.rotation([0.3, -1.0, 2.0]), position=[1, -2, 3])
    lone, moved = bent([0.1, 0.2, -0.3]), bent([0.1, 0.2, -0.3], root)
    expected = root @ lone
    assert_allclose(moved.position, expected.position, atol=1e-14)  # rounding
    assert_allclose(moved.rotation, expected.rotation, atol=1e-14)


def test_local_axes_run_to_the_tip_to_the_leading_edge_and_to_their_product():
    right, left = RIGHT_WING_ROOT, cc.mirror(hale_wing()).root
    for root, z_body in ((right, -1), (left, 1)):  # body z points down: up on a right wing
        x, y, z = root.rotation.full().T
        assert_allclose(np.cross(x, y), z, atol=0)
        assert_allclose(y, [1, 0, 0], atol=0)  # forward, to the leading edge
        assert_allclose(z, [0, 0, z_body], atol=0)
    wing = hale_wing()
    tip = cc.pose_at(wing, np.zeros(9), 1.0).position
    assert_allclose(tip, [[0], [16], [0]], atol=1e-14)  # x runs to the right tip


def test_aircraft_root_rotations_of_unswept_wings():
    wing = hale_wing()
    assert_allclose(wing.root.rotation, [[0, 1, 0], [1, 0, 0], [0, 0, -1]], atol=0)
    assert_allclose(cc.mirror(wing).root.rotation, [[0, 1, 0], [-1, 0, 0], [0, 0, 1]], atol=0)


def test_total_curvature_is_torsion_out_of_plane_in_plane():
    # On a right wing tip-up is K_y < 0 and leading edge up K_x > 0; z of the body is down.
    root = RIGHT_WING_ROOT
    assert bent([0, -0.1, 0], root).position[2] < -0.1
    assert bent([0.1, 0, 0], root).rotation[2, 1] < -0.1  # local y, to the leading edge
    assert bent([0, 0, 0.1], root).position[0] > 0.1  # in plane, forward
    # Both flip on a left wing.
    left = cc.mirror(hale_wing()).root
    assert bent([0, 0.1, 0], left).position[2] < -0.1
    assert bent([-0.1, 0, 0], left).rotation[2, 1] < -0.1
    assert bent([0, 0, 0.1], left).position[0] > 0.1


def test_mirror_makes_the_left_wing_with_equal_weights():
    right = replace(hale_wing(), initial_curvature=[0.01, 0.02, 0.03])
    left = cc.mirror(right)
    flip = np.diag([-1, -1, 1])
    assert_allclose(left.basis(0.3), flip @ right.basis(0.3), atol=0)
    assert_allclose(left.initial_curvature_at(0.3), flip @ [[0.01], [0.02], [0.03]], atol=0)
    q = 0.03 * np.cos(np.arange(9))
    a, b = cc.shape_map(right, q).positions.full(), cc.shape_map(left, q).positions.full()
    assert_allclose(b, np.diag([1, -1, 1]) @ a, atol=2e-14)  # rounding of 16 m


def test_deformation_map_takes_parent_components_to_local_ones(wing):
    root = cc.Pose(rotation=oracle.rotation([0.3, -1.0, 2.0]), position=[1, -2, 3])
    beam = wing(64, "magnus6", root=root)

    def D(xi):
        return cc.pose_at(beam, CURLED_WEIGHTS, xi).deformation_map.full()

    slope = differences(D, 0.4, 1e-3) / 16.0
    # Differences of order four with a step of 0.016 m; curvatures of 0.1 rad/m.
    assert_allclose(slope, -oracle.hat(oracle.curled_curvature(0.4)) @ D(0.4), atol=1e-10)
    first = cc.shape_map(beam, CURLED_WEIGHTS).poses[0]
    assert_allclose(first.deformation_map, root.rotation.full().T, rtol=0)


def test_rotation_is_the_transpose_with_the_local_axes_as_columns(wing):
    beam = wing(64, "magnus6")
    pose = cc.pose_at(beam, CURLED_WEIGHTS, 0.4)
    assert_allclose(pose.rotation, pose.deformation_map.T, rtol=0)

    def R(xi):
        return cc.pose_at(beam, CURLED_WEIGHTS, xi).rotation.full()

    # As above.
    slope = differences(R, 0.4, 1e-3) / 16.0
    assert_allclose(slope, R(0.4) @ oracle.hat(oracle.curled_curvature(0.4)), atol=1e-10)
    _, p = oracle.integrate(oracle.curled_curvature, 16.0, [0.399, 0.401])
    assert_allclose(
        R(0.4)[:, 0], (p[1] - _[1]) / (0.002 * 16.0), atol=1e-4
    )  # first column: tangent


def test_position_is_the_integral_of_the_tangent(wing):
    root = cc.Pose(rotation=oracle.rotation([0.3, -1.0, 2.0]), position=[1, -2, 3])
    beam = wing(64, "magnus6", root=root)
    nodes, weights = np.polynomial.legendre.leggauss(20)
    tangents = [
        cc.pose_at(beam, CURLED_WEIGHTS, (1 + x) / 2).deformation_map.full().T[:, 0] for x in nodes
    ]
    expected = np.array([1, -2, 3]) + 16.0 / 2 * weights @ np.array(tangents)
    tip = cc.shape_map(beam, CURLED_WEIGHTS).tip.position.full()[:, 0]
    # Twenty Gauss points resolve the shape; the rule leaves 1e-12 L.
    assert_allclose(tip, expected, atol=1e-9)


def test_pose_is_inextensible_and_unshearable(wing):
    beam = wing(64, "magnus6")

    def T(xi):
        pose = cc.pose_at(beam, CURLED_WEIGHTS, xi)
        return oracle.homogeneous(pose.rotation.full(), pose.position.full())

    strain = oracle.body_twist_of(T(0.4), differences(T, 0.4, 1e-3) / 16.0)
    # T' = T ξ^ with ξ = (K, e_x); as above.
    assert_allclose(strain, [*oracle.curled_curvature(0.4), 1, 0, 0], atol=1e-9)


def test_six_vectors_have_the_angular_part_first_in_local_axes():
    xi = np.arange(1.0, 7.0)
    assert_allclose(se3.hat(ca.DM(xi))[:3, :3], oracle.hat(xi[:3]), rtol=0)
    assert_allclose(se3.hat(ca.DM(xi))[:3, 3].full()[:, 0], xi[3:], rtol=0)
    # A root that turns about its own z axis moves the straight tip along its own y axis.
    root = cc.Pose(rotation=oracle.rotation([0.3, -1.0, 2.0]), position=[1, -2, 3])
    beam = cc.Beam(length=2.0, basis=BENDING, grid=cc.Grid.uniform(2), root=root)
    twist = cc.body_twist(beam, [0, 0, 0], [0, 0, 0], root_twist=[0, 0, 3, 0, 0, 0])
    assert_allclose(twist.full()[:, 0], [0, 0, 3, 0, 6, 0], atol=1e-14)  # rounding


def test_jacobian_maps_rates_of_weights_to_the_body_twist(wing):
    beam = wing(5)

    def T(t):
        pose = cc.shape_map(beam, CURLED_WEIGHTS + t * RATE).tip
        return oracle.homogeneous(pose.rotation.full(), pose.position.full())

    # The perturbation is on the right: T⁻¹ dT/dt. Differences of order four, rates of 10 rad/s.
    expected = oracle.body_twist_of(T(0), differences(T, 0.0, 1e-4))
    got = cc.body_jacobian(beam, CURLED_WEIGHTS) @ RATE
    assert_allclose(got.full()[:, 0], expected, atol=1e-8)


def test_omega_is_the_local_rate_and_with_a_root_twist_what_a_gyro_reads(wing):
    root_rate = np.array([0.4, -0.2, 0.9])
    beam = wing(5)

    def D(t, turning):
        root = oracle.rotation(t * root_rate) if turning else np.eye(3)
        moved = replace(beam, root=cc.Pose(rotation=root, position=[0, 0, 0]))
        return cc.pose_at(moved, CURLED_WEIGHTS + t * RATE, 0.7).deformation_map.full()

    for turning in (False, True):
        slope = differences(lambda t, turning=turning: D(t, turning), 0.0, 1e-4)
        root_twist = [*root_rate, 0, 0, 0] if turning else None
        twist = cc.body_twist(beam, CURLED_WEIGHTS, RATE, 0.7, root_twist=root_twist)
        omega = twist.full()[:3, 0]
        # dD/dt = −[Omega×] D (Eq. 1). Differences as above.
        assert_allclose(slope, -oracle.hat(omega) @ D(0, turning), atol=1e-9)


def test_compatibility_of_rates_and_curvatures(wing):
    beam = wing(64, "magnus6")

    def omega(xi):
        return cc.body_twist(beam, CURLED_WEIGHTS, RATE, xi).full()[:3, 0]

    slope = differences(omega, 0.4, 1e-3) / 16.0
    K, K_dot = oracle.curled_curvature(0.4), oracle.wing_curvature(0.4, RATE)
    # Differences of order four with a step of 0.016 m; Omega changes by 1 rad/s per metre.
    assert_allclose(slope, K_dot + np.cross(omega(0.4), K), atol=1e-8)


@pytest.mark.parametrize(
    "family, root, tip",
    [
        (cc.Legendre(3), [1, -1, 1], [1, 1, 1]),
        (cc.Chebyshev(3), [1, -1, 1], [1, 1, 1]),
        (cc.Monomial(3), [1, 0, 0], [1, 1, 1]),
        (cc.BSpline(4), [1, 0, 0, 0], [0, 0, 0, 1]),
        (cc.CantileverModes(3), [1, 1, 1], [0, 0, 0]),
        (cc.PiecewiseConstant(3), [1, 0, 0], [0, 0, 1]),
    ],
    ids=lambda value: type(value).__name__,
)
def test_families_have_n_functions_on_the_unit_interval(family, root, tip):
    assert family(0.3).shape == (family.n,)
    assert_allclose(family(0.0), root, atol=1e-14)  # rounding
    assert_allclose(family(1.0), tip, atol=1e-14)


def test_families_weights_stack_torsion_out_of_plane_in_plane():
    basis = cc.ChannelBasis(
        torsion=cc.Legendre(1), out_of_plane=cc.Legendre(1), in_plane=cc.Legendre(1)
    )
    assert_allclose(basis(0.3), np.eye(3), rtol=0)
