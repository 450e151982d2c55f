"""The shape map against closed forms, matrix exponentials and an ODE solver."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from numpy.testing import assert_allclose
from scipy.special import fresnel

import curvcasadi as cc
from curvcasadi.kinematics.rules import RULES
from tests.support import oracle
from tests.support.oracle import CURLED_WEIGHTS, WING_LENGTH, WING_WEIGHTS

ORDERS = {"trapezoid": 2, "midpoint": 2, "magnus4": 4, "magnus6": 6}
EXACT_TIP = oracle.integrate(oracle.wing_curvature, WING_LENGTH)[0]
CURLED_TIP = oracle.integrate(oracle.curled_curvature, WING_LENGTH)[0]
WINGS = {"bent": (WING_WEIGHTS, EXACT_TIP), "curled": (CURLED_WEIGHTS, CURLED_TIP)}
CONSTANT = cc.ChannelBasis(
    torsion=cc.Legendre(1), out_of_plane=cc.Legendre(1), in_plane=cc.Legendre(1)
)
IN_PLANE = cc.ChannelBasis(in_plane=cc.Legendre(1))


def tip_error(beam, q, exact=EXACT_TIP):
    tip = cc.shape_map(beam, q).tip
    return np.linalg.norm(tip.position.full()[:, 0] - exact[1]) / float(beam.length)


def observed_orders(errors):
    """Orders from errors at doubled numbers of elements."""
    return np.log2(errors[:-1] / errors[1:])


# Accuracy --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "rule, elements",
    [
        ("trapezoid", (32, 64, 128)),
        ("midpoint", (32, 64, 128)),
        ("magnus4", (32, 64, 128)),
        ("magnus6", (16, 32, 64)),
    ],
)
@pytest.mark.parametrize("weights, exact", WINGS.values(), ids=WINGS)
def test_rules_have_their_orders(wing, rule, elements, weights, exact):
    assert RULES[rule].order == ORDERS[rule]
    errors = np.array([tip_error(wing(n, rule), weights, exact) for n in elements])
    # In the asymptotic range the observed order is within 0.15 of the true one.
    assert_allclose(observed_orders(errors), ORDERS[rule], atol=0.15)


@pytest.mark.parametrize("rule", ORDERS)
def test_rotations_have_the_order_too(wing, rule):
    errors = []
    for elements in (16, 32, 64):
        R = cc.shape_map(wing(elements, rule), CURLED_WEIGHTS).tip.rotation.full()
        errors.append(np.linalg.norm(R - CURLED_TIP[0]))
    # As above, with one coarser grid.
    assert_allclose(observed_orders(np.array(errors)), ORDERS[rule], atol=0.3)


@pytest.mark.parametrize("rule", ["magnus4", "magnus6"])
def test_curvatures_about_one_axis_turn_it_exactly(wing, rule):
    R = cc.shape_map(wing(8, rule), WING_WEIGHTS).tip.rotation
    # The commutators vanish and the Gauss points integrate the cubic: rounding, also of the oracle.
    assert_allclose(R, EXACT_TIP[0], atol=3e-14)


def test_default_rule_on_the_test_wing(wing):
    # The promised accuracy of 16 uniform elements, in shares of the span.
    assert tip_error(wing(16, "magnus4"), WING_WEIGHTS) < 2e-6


def test_all_stations_are_accurate(wing):
    shape = cc.shape_map(wing(64, "magnus6"), CURLED_WEIGHTS)
    exact = oracle.integrate(oracle.curled_curvature, WING_LENGTH, shape.stations)
    # The rule's error is below 1e-11 of 16 m here.
    for pose, (R, p) in zip(shape.poses, exact, strict=True):
        assert_allclose(pose.rotation, R, atol=1e-10)
        assert_allclose(pose.position.full()[:, 0], p, atol=1e-10)


@pytest.mark.parametrize("rule", ORDERS)
@pytest.mark.parametrize("turns", [0.01, 0.25, 1.0])
def test_circle_is_exact_with_every_rule(rule, turns):
    length, K = 3.0, 2 * np.pi * turns / 3.0
    beam = cc.Beam(length=length, basis=IN_PLANE, grid=cc.Grid.uniform(8, rule=rule))
    tip = cc.shape_map(beam, [K]).tip.position
    angle = K * length
    expected = [np.sin(angle) / K, (1 - np.cos(angle)) / K, 0]
    # Constant curvature is represented exactly: rounding, 1e-12 L is asked for.
    assert_allclose(tip.full()[:, 0], expected, atol=1e-12 * length)


@pytest.mark.parametrize("rule", ORDERS)
def test_helix_is_exact_with_every_rule(rule):
    beam = cc.Beam(length=5.0, basis=CONSTANT, grid=cc.Grid.lobatto(7, rule=rule, max_angle=1.5))
    K = [0.4, -0.7, 0.5]
    shape = cc.shape_map(beam, K)
    for xi, pose in zip(shape.stations, shape.poses, strict=True):
        R, p = oracle.constant_curvature(K, 5.0 * xi)
        # Constant curvature is represented exactly: rounding, 1e-12 L is asked for.
        assert_allclose(pose.position.full()[:, 0], p, atol=5e-12)
        assert_allclose(pose.rotation, R, atol=1e-12)


@pytest.mark.parametrize("rule", ORDERS)
def test_clothoid_converges_at_the_order_of_the_rule(rule):
    length, a = 4.0, 0.35  # K_y = a s
    scale = np.sqrt(np.pi / a)
    S, C = fresnel(length / scale)
    expected = (None, scale * np.array([C, 0, -S]))  # angle φ = a s²/2 about y
    basis = cc.ChannelBasis(out_of_plane=cc.Monomial(2))
    errors = np.array(
        [
            tip_error(
                cc.Beam(length=length, basis=basis, grid=cc.Grid.uniform(n, rule=rule)),
                [0, a * length],
                expected,
            )
            for n in (8, 16, 32)
        ]
    )
    assert_allclose(observed_orders(errors), ORDERS[rule], atol=0.15)


@pytest.mark.parametrize("row", range(5))
def test_constant_curvature_case_21(published, row):
    case = published("21")["reference"][row]
    K, s = case["K"], case["s"]
    for elements in (1, 4, 9):
        if s * np.linalg.norm(K) / elements > np.pi * (1 + 1e-9):
            continue
        grid = cc.Grid.uniform(elements, max_angle=np.pi)
        tip = cc.shape_map(cc.Beam(length=s, basis=CONSTANT, grid=grid), K).tip
        # The case gives ten digits, of K too.
        assert_allclose(tip.deformation_map, case["D_matrix"], atol=5e-10)
        assert_allclose(tip.position.full()[:, 0], case["p"], atol=5e-10)
        R, p = oracle.constant_curvature(K, s)
        # Exact but for rounding; turns up to 10 rad.
        assert_allclose(tip.rotation, R, atol=1e-13)
        assert_allclose(tip.position.full()[:, 0], p, atol=1e-13)


@pytest.mark.parametrize("row", range(6))
def test_tip_moment_rolls_the_wing_up_case_01(published, row):
    case = published("01")["reference"][row]
    for channel, component, sign in [("out_of_plane", 2, -1), ("in_plane", 1, 1)]:
        basis = cc.ChannelBasis(**{channel: cc.Legendre(1)})
        beam = cc.Beam(length=1.0, basis=basis, grid=cc.Grid.uniform(16))
        tip = cc.shape_map(beam, [case["K_const"]]).tip.position.full()[:, 0]
        # Ten digits, of K too, and constant curvature is exact. Positive K_y bends towards −z.
        assert_allclose(tip[0], case["x_tip"], atol=5e-10)
        assert_allclose(sign * tip[component], case["h_tip"], atol=5e-10)


def helix_curvature(case):
    T, M, _ = case["tip_moment_root_frame"]
    c = T * (1 / 0.6 - 1)
    return lambda xi: np.array([T / 0.6, M * np.cos(c * xi), -M * np.sin(c * xi)])


@pytest.mark.parametrize("form", ["vector basis", "initial curvature", "tabulated"])
@pytest.mark.parametrize("row", range(4))
def test_tip_moment_with_torsion_bends_a_helix_case_18(published, row, form):
    case = published("18")["reference"][row]
    K = helix_curvature(case)
    initial, q = None, [1.0]
    if form == "vector basis":
        basis = cc.VectorBasis(lambda xi: K(xi)[:, None], 1)
    elif form == "initial curvature":
        basis, initial, q = IN_PLANE, K, [0.0]
    else:
        xi = np.linspace(0, 1, 81)
        table = np.array([K(x) for x in xi])
        families = [cc.Tabulated(xi, column[:, None], degree=3) for column in table.T]
        torsion, out_of_plane, in_plane = families
        basis = cc.ChannelBasis(torsion=torsion, out_of_plane=out_of_plane, in_plane=in_plane)
        q = [1.0, 1.0, 1.0]
    beam = cc.Beam(
        length=1.0,
        basis=basis,
        grid=cc.Grid.uniform(96, rule="magnus6"),
        initial_curvature=initial,
    )
    # Ten digits are given. The spline of a sinusoid of up to 4 rad leaves 12 (4/80)^4/384 ~ 2e-7
    # locally and less in the integral.
    atol = 1e-7 if form == "tabulated" else 2e-10
    tip, middle = cc.shape_map(beam, q).tip, cc.pose_at(beam, q, 0.5)
    assert_allclose(tip.position.full()[:, 0], case["tip_position"], atol=atol)
    assert_allclose(tip.rotation, case["tip_rotation_matrix"], atol=5 * atol)
    assert_allclose(middle.position.full()[:, 0], case["mid_position"], atol=atol)


# Kinds of expression ---------------------------------------------------------------------------


@pytest.mark.parametrize("rule", ORDERS)
def test_shapes_agree_in_all_kinds(wing, evaluate, rule):
    beam = wing(5, rule)
    expected = cc.shape_map(beam, CURLED_WEIGHTS)
    positions = evaluate(lambda q: cc.shape_map(beam, q).positions, CURLED_WEIGHTS)
    rotation = evaluate(lambda q: cc.shape_map(beam, q).tip.rotation, CURLED_WEIGHTS)
    # The same operations: at most rounding from reassociation.
    assert_allclose(positions, expected.positions, atol=2e-14)
    assert_allclose(rotation, expected.tip.rotation, atol=2e-15)


def test_shape_has_a_pose_and_a_curvature_at_every_station(wing, evaluate):
    beam = wing(5)
    shape = cc.shape_map(beam, CURLED_WEIGHTS)
    assert len(shape.poses) == 6
    assert shape.positions.shape == (3, 6)
    curvatures = evaluate(lambda q: cc.shape_map(beam, q).curvatures, CURLED_WEIGHTS)
    expected = np.transpose([oracle.curled_curvature(xi) for xi in shape.stations])
    assert_allclose(curvatures, expected, atol=1e-16)  # rounding of 0.1


def test_no_derivative_is_nan_at_the_straight_wing(wing, symbolic):
    for exponential in ("series", "rodrigues", "small_angle_sine", "small_angle"):
        beam = wing(3, exponential=exponential)
        q = symbolic.sym("q", 12)
        tip = cc.shape_map(beam, q).tip
        cost = ca.sumsqr(tip.position - ca.DM([1, 2, 3])) + ca.sumsqr(tip.rotation[:, 0])
        f = ca.Function("f", [q], [*ca.hessian(cost, q)])
        for part in f(0):
            assert np.all(np.isfinite(part.full()))


def test_hessian_at_the_straight_wing_equals_the_limit(wing, symbolic):
    q = symbolic.sym("q", 12)
    tip = cc.shape_map(wing(3), q).tip
    hessian, _ = ca.hessian(ca.sumsqr(tip.position - ca.DM([1, 2, 3])), q)
    f = ca.Function("f", [q], [hessian])
    at_zero, near = f(0).full(), f(1e-9 * np.arange(1, 13)).full()
    # Third derivatives are of the order L^5 = 1e6, times 1e-8.
    assert_allclose(at_zero, near, atol=0.1)
    assert np.abs(at_zero).max() > 1e3


# Stations off the grid -------------------------------------------------------------------------


@pytest.mark.parametrize("xi", [0.0, 1e-14, 0.0625, 0.1, 0.55, 0.999, 1.0])
def test_pose_at_any_station_is_accurate(wing, xi):
    pose = cc.pose_at(wing(16, "magnus6"), CURLED_WEIGHTS, xi)
    R, p = oracle.integrate(oracle.curled_curvature, WING_LENGTH, [xi])[0]
    # Sixteen magnus6 elements leave 5e-9 L.
    assert_allclose(pose.position.full()[:, 0], p, atol=1e-7)
    assert_allclose(pose.rotation, R, atol=1e-7)


def test_pose_at_a_grid_station_is_the_pose_of_the_shape(wing):
    beam = wing(5, kind="lobatto")
    shape = cc.shape_map(beam, CURLED_WEIGHTS)
    for xi, pose in zip(shape.stations[1:], shape.poses[1:], strict=True):
        got = cc.pose_at(beam, CURLED_WEIGHTS, xi)
        assert_allclose(got.position, pose.position, rtol=0, atol=0)
        assert_allclose(got.rotation, pose.rotation, rtol=0, atol=0)


@pytest.mark.parametrize("xi", [0.0, 0.4, 0.5])
def test_pose_at_in_all_kinds(wing, evaluate, xi):
    beam = wing(32)
    got = evaluate(lambda q: cc.pose_at(beam, q, xi).position, CURLED_WEIGHTS)
    _, p = oracle.integrate(oracle.curled_curvature, WING_LENGTH, [xi])[0]
    # Thirty-two magnus4 elements leave some 1e-7 L.
    assert_allclose(got[:, 0], p, atol=1e-5)


def test_root_pose_at_station_zero(wing, kind):
    root = cc.Pose(rotation=oracle.rotation([1, 2, 3]), position=[1, 2, 3])
    q = CURLED_WEIGHTS if kind is ca.DM else kind.sym("q", 12)
    beam = wing(4, root=root)
    pose = cc.pose_at(beam, q, 0.0)
    assert_allclose(ca.evalf(pose.position), root.position, rtol=0)
    assert_allclose(ca.evalf(pose.rotation), beam.root.rotation, rtol=0)
    # The beam orthonormalizes what the oracle's exponential leaves.
    assert_allclose(beam.root.rotation, root.rotation, atol=1e-13)


@pytest.mark.parametrize("rule", ORDERS)
def test_partial_elements_keep_the_order(wing, rule):
    xi = 0.71
    exact = oracle.integrate(oracle.curled_curvature, WING_LENGTH, [xi])[0]
    errors = []
    elements = (10, 20, 40) if rule == "magnus6" else (30, 60, 120)
    for n in elements:
        p = cc.pose_at(wing(n, rule), CURLED_WEIGHTS, xi).position.full()[:, 0]
        errors.append(np.linalg.norm(p - exact[1]))
    # The position within the element differs from grid to grid, hence a wider margin, downwards.
    orders = np.log2(errors[0] / errors[-1]) / 2
    assert orders > ORDERS[rule] - 0.3


def test_pose_is_continuous_across_stations(wing):
    beam = wing(8)
    for xi in (0.125, 0.5):
        before, after = (cc.pose_at(beam, CURLED_WEIGHTS, xi + d).position for d in (-1e-9, 1e-9))
        # The distance along the wing is 2e-9 × 16 m; the rule's error changes the speed a little.
        assert_allclose(np.linalg.norm((after - before).full()), 3.2e-8, rtol=1e-3)


# Initial curvature and breaks ------------------------------------------------------------------


@pytest.mark.parametrize("rule", ORDERS)
def test_constant_initial_curvature_adds_to_the_weights(rule):
    beam = cc.Beam(
        length=5.0,
        basis=CONSTANT,
        grid=cc.Grid.uniform(6, rule=rule),
        initial_curvature=[0.1, -0.5, 0.2],
    )
    tip = cc.shape_map(beam, [0.3, -0.2, 0.3]).tip
    R, p = oracle.constant_curvature([0.4, -0.7, 0.5], 5.0)
    assert_allclose(tip.position.full()[:, 0], p, atol=5e-12)  # 1e-12 L
    assert_allclose(tip.rotation, R, atol=1e-12)


def test_initial_curvature_along_the_span():
    def initial(xi):
        return np.array([0.1 * np.sin(3 * xi), -0.3 * xi**2, 0.2 * np.exp(-xi)])

    q = np.array([0.1, -0.2, 0.05])
    beam = cc.Beam(
        length=5.0,
        basis=CONSTANT,
        grid=cc.Grid.uniform(24, rule="magnus6"),
        initial_curvature=initial,
    )
    tip = cc.shape_map(beam, q).tip
    R, p = oracle.integrate(lambda xi: initial(xi) + q, 5.0)[0]
    # The rule's error of 24 small elements.
    assert_allclose(tip.position.full()[:, 0], p, atol=1e-11)
    assert_allclose(tip.rotation, R, atol=1e-11)
    K = cc.curvature(beam, ca.DM(q), 0.4)
    assert_allclose(K.full()[:, 0], initial(0.4) + q, rtol=1e-15)


def test_symbolic_initial_curvature_and_length(symbolic):
    k0, length, q = symbolic.sym("k0", 3), symbolic.sym("L"), symbolic.sym("q", 3)
    beam = cc.Beam(length=length, basis=CONSTANT, grid=cc.Grid.uniform(6), initial_curvature=k0)
    f = ca.Function("f", [q, k0, length], [cc.shape_map(beam, q).tip.position])
    _, p = oracle.constant_curvature([0.4, -0.7, 0.5], 5.0)
    got = f([0.3, -0.2, 0.3], [0.1, -0.5, 0.2], 5.0)
    assert_allclose(got.full()[:, 0], p, atol=5e-12)  # 1e-12 L


def test_symbolic_design_with_numeric_weights(symbolic):
    length = symbolic.sym("L")
    beam = cc.Beam(length=length, basis=CONSTANT, grid=cc.Grid.uniform(6))
    p = cc.shape_map(beam, [0.4, -0.7, 0.5]).tip.position
    got = ca.Function("f", [length], [p])(5.0)
    _, expected = oracle.constant_curvature([0.4, -0.7, 0.5], 5.0)
    assert_allclose(got.full()[:, 0], expected, atol=5e-12)  # 1e-12 L


def test_a_symbol_in_part_of_the_initial_curvature_is_accepted(symbolic):
    k0 = symbolic.sym("k0", 3)
    beam = cc.Beam(
        length=5.0,
        basis=CONSTANT,
        grid=cc.Grid.uniform(6),
        initial_curvature=lambda xi: k0 if xi > 0.5 else ca.DM.zeros(3),
    )
    tip = cc.shape_map(beam, [0.1, 0.2, 0.3]).tip
    R1, p1 = oracle.constant_curvature([0.1, 0.2, 0.3], 2.5)
    _, p2 = oracle.constant_curvature([0.2, 0.2, 0.3], 2.5)
    got = ca.Function("f", [k0], [tip.position])([0.1, 0, 0])
    assert_allclose(got.full()[:, 0], p1 + R1 @ p2, atol=5e-12)  # 1e-12 L


@pytest.mark.parametrize("rule", ORDERS)
@pytest.mark.parametrize("kind", ["uniform", "lobatto"])
def test_piecewise_constant_curvature_is_exact_with_few_elements(rule, kind):
    basis = cc.ChannelBasis(torsion=cc.PiecewiseConstant(2), out_of_plane=cc.PiecewiseConstant(3))
    q = np.array([0.1, -0.2, 0.3, -0.25, 0.15])
    grid = getattr(cc.Grid, kind)(3, rule=rule)
    beam = cc.Beam(length=4.0, basis=basis, grid=grid)
    assert len(beam.stations) == 5  # breaks at 1/3, 1/2, 2/3
    pieces = [(0, 1 / 3, 0, 0), (1 / 3, 1 / 2, 0, 1), (1 / 2, 2 / 3, 1, 1), (2 / 3, 1, 1, 2)]
    pose = np.eye(4)
    for a, b, i, j in pieces:
        pose = pose @ oracle.homogeneous(
            *oracle.constant_curvature([q[i], q[2 + j], 0], 4.0 * (b - a))
        )
    tip = cc.shape_map(beam, q).tip
    # Every element has constant curvature, also in the trapezoid rule: rounding.
    assert_allclose(tip.position.full()[:, 0], pose[:3, 3], atol=4e-12)
    assert_allclose(tip.rotation, pose[:3, :3], atol=1e-12)


@pytest.mark.parametrize("rule", ORDERS)
def test_a_boundary_rounded_to_twelve_digits_is_the_break(rule):
    basis = cc.ChannelBasis(out_of_plane=cc.PiecewiseConstant(3))
    q = [0.1, -0.1, 0.05]
    tips = [
        cc.shape_map(cc.Beam(length=4.0, basis=basis, grid=grid), q).tip.position
        for grid in (
            cc.Grid(boundaries=[0, 0.333333333333, 1], rule=rule),
            cc.Grid.uniform(3, rule=rule),
        )
    ]
    # The boundaries differ by 3e-13 of 4 m.
    assert_allclose(tips[0], tips[1], atol=1e-11)


def test_coupled_basis_functions_move_all_channels_at_once():
    def function(xi):
        return np.array([[0.5, xi], [-1, xi**2], [0.2, 1 - xi]])

    q = np.array([0.1, -0.15])
    beam = cc.Beam(
        length=6.0, basis=cc.VectorBasis(function, 2), grid=cc.Grid.uniform(24, rule="magnus6")
    )
    _, p = oracle.integrate(lambda xi: function(xi) @ q, 6.0)[0]
    # The rule's error of 24 small elements.
    assert_allclose(cc.shape_map(beam, q).tip.position.full()[:, 0], p, atol=1e-11)


@pytest.mark.parametrize(
    "family", [cc.Chebyshev(3), cc.BSpline(5), cc.CantileverModes(3), cc.Monomial(4)], ids=str
)
def test_families_reach_the_shape(family):
    basis = cc.ChannelBasis(torsion=family, in_plane=family)
    q = 0.1 * np.cos(np.arange(basis.n))
    beam = cc.Beam(length=6.0, basis=basis, grid=cc.Grid.uniform(48, rule="magnus6"))

    def curvature(xi):
        values = family(xi)
        return np.array([values @ q[: family.n], 0, values @ q[family.n :]])

    _, p = oracle.integrate(curvature, 6.0, breaks=family.breaks)[0]
    # The rule's error of 48 small elements.
    assert_allclose(cc.shape_map(beam, q).tip.position.full()[:, 0], p, atol=1e-9)


# Element angles --------------------------------------------------------------------------------


def test_squared_element_angles_are_those_of_the_element_rotations(wing, evaluate):
    beam = wing(8)
    shape = cc.shape_map(beam, CURLED_WEIGHTS)
    got = evaluate(lambda q: cc.squared_element_angles(beam, q), CURLED_WEIGHTS)
    assert got.shape == (8, 1)
    for k, (a, b) in enumerate(zip(shape.poses[:-1], shape.poses[1:], strict=True)):
        R = a.rotation.full().T @ b.rotation.full()
        # arccos of a trace loses half the digits.
        assert_allclose(np.sqrt(got[k, 0]), np.arccos((np.trace(R) - 1) / 2), atol=1e-7)


def test_squared_element_angles_have_derivatives_at_the_straight_wing(wing, symbolic):
    q = symbolic.sym("q", 12)
    angles = cc.squared_element_angles(wing(4), q)
    f = ca.Function("f", [q], [ca.jacobian(angles, q), ca.hessian(ca.sum1(angles), q)[0]])
    jacobian, hessian = f(0)
    assert_allclose(jacobian, 0, atol=0)
    assert np.all(np.isfinite(hessian.full()))
    assert np.all(np.linalg.eigvalsh(hessian.full()) > 0)


# Bad input -------------------------------------------------------------------------------------

SHORT = cc.Beam(
    length=16.0,
    basis=cc.ChannelBasis(out_of_plane=cc.Legendre(2)),
    grid=cc.Grid.uniform(4),
    weight_bounds=[0.5, 0.05],
)
CALLS = {
    "shape_map": cc.shape_map,
    "pose_at": lambda beam, q: cc.pose_at(beam, q, 0.3),
    "curvature": lambda beam, q: cc.curvature(beam, q, 0.3),
    "squared_element_angles": cc.squared_element_angles,
    "body_jacobian": cc.body_jacobian,
    "body_jacobian_rate": lambda beam, q: cc.body_jacobian_rate(beam, q, [0, 0]),
    "body_twist": lambda beam, q: cc.body_twist(beam, q, [0, 0]),
}
every_call = pytest.mark.parametrize("call", CALLS.values(), ids=CALLS)
#: The curvature is defined for any weights.
LIMITED = {name: call for name, call in CALLS.items() if name != "curvature"}
every_limited_call = pytest.mark.parametrize("call", LIMITED.values(), ids=LIMITED)


@every_call
@pytest.mark.parametrize(
    "q, message",
    [
        ([0.1], r"q: expected shape \(2, 1\), found \(1, 1\)"),
        ([0.1, 0, 0], r"q: expected shape \(2, 1\), found \(3, 1\)"),
        ([[0.1, 0]], r"q: expected shape \(2, 1\), found \(1, 2\)"),
        (0.1, r"q: expected shape \(2, 1\), found \(1, 1\)"),
        ([0.1, np.nan], r"q: expected finite numbers"),
        (ca.SX.sym("q", 3), r"q: expected shape \(2, 1\), found \(3, 1\)"),
        (ca.MX.sym("q", 1, 2), r"q: expected shape \(2, 1\), found \(1, 2\)"),
    ],
    ids=str,
)
def test_weights_of_a_wrong_shape_or_nan_are_refused(call, q, message):
    with pytest.raises(ValueError, match=message):
        call(SHORT, q)


@every_limited_call
def test_weights_outside_their_bounds_are_refused(call):
    message = r"q\[1\] \(out_of_plane: Legendre 1\): expected within .*0\.05\].*found -0\.06"
    with pytest.raises(ValueError, match=message):
        call(SHORT, [0.1, -0.06])


@every_limited_call
def test_elements_that_turn_too_far_are_refused(call):
    message = r"q: expected every element .* Grid\.max_angle = 1 rad, found 1\.2 rad.*more elements"
    with pytest.raises(ValueError, match=message):
        call(SHORT, [0.3, 0])


def test_the_element_that_turns_too_far_is_named():
    beam = replace(
        SHORT, basis=cc.ChannelBasis(out_of_plane=cc.PiecewiseConstant(2)), weight_bounds=None
    )
    with pytest.raises(ValueError, match=r"between xi = 0\.5 and 0\.75"):
        cc.shape_map(beam, [0.1, 0.3])


@pytest.mark.parametrize("xi", [-0.1, 1.1, np.nan, ca.SX.sym("xi"), "tip", [0.1, 0.2]])
@pytest.mark.parametrize("name", ["pose_at", "curvature", "body_jacobian", "body_twist"])
def test_stations_off_the_beam_are_refused(name, xi):
    arguments = ([0, 0],) if name == "body_twist" else ()
    with pytest.raises(ValueError, match=r"xi: expected .*\[0, 1\]|xi: expected .*found"):
        getattr(cc, name)(SHORT, [0, 0], *arguments, xi)


def test_curvature_takes_plain_numbers():
    assert_allclose(cc.curvature(SHORT, [0.1, 0.02], 1.0), [[0], [0.12], [0]], rtol=1e-15)


def test_kinds_that_do_not_mix_are_named():
    beam = replace(SHORT, length=ca.MX.sym("L"))
    with pytest.raises(ValueError, match=r"q is SX, Beam\.length is MX"):
        cc.shape_map(beam, ca.SX.sym("q", 2))


def test_initial_curvature_functions_are_checked_where_they_are_used():
    beam = replace(SHORT, initial_curvature=lambda xi: [0, np.nan, 0])
    with pytest.raises(ValueError, match=r"Beam\.initial_curvature at xi = 0: expected finite"):
        cc.shape_map(beam, [0, 0])


def test_a_family_as_basis_is_refused():
    with pytest.raises(ValueError, match=r"Beam\.basis: expected a basis"):
        cc.shape_map(replace(SHORT, basis=cc.Legendre(3), weight_bounds=None), [0, 0, 0])


# Laws ------------------------------------------------------------------------------------------

weights = st.lists(st.floats(-0.15, 0.15), min_size=7, max_size=7)
property_test = settings(deadline=None, max_examples=20, derandomize=True)
MIXED = cc.Beam(
    length=5.0,
    basis=cc.ChannelBasis(
        torsion=cc.Legendre(2), out_of_plane=cc.Legendre(3), in_plane=cc.Legendre(2)
    ),
    grid=cc.Grid.uniform(8),
)
EXACT = replace(MIXED, grid=cc.Grid.uniform(40, rule="magnus6"))


@property_test
@given(weights)
def test_every_rotation_is_orthogonal(q):
    for pose in cc.shape_map(MIXED, q).poses:
        R = pose.rotation.full()
        assert_allclose(R.T @ R, np.eye(3), atol=2e-14)  # rounding of eight products
        assert np.linalg.det(R) > 0


@property_test
@given(weights)
def test_chords_are_not_longer_than_arcs(q):
    # Of the rules with one mean curvature: an element is an arc of a helix.
    shape = cc.shape_map(replace(MIXED, grid=cc.Grid.uniform(8, rule="midpoint")), q)
    chords = np.linalg.norm(np.diff(shape.positions.full(), axis=1), axis=0)
    assert np.all(chords <= 5.0 * np.diff(shape.stations) * (1 + 1e-14))  # rounding


@property_test
@given(weights)
def test_mirrored_wing_with_equal_weights_is_the_mirror_image(q):
    right = replace(
        MIXED, root=cc.Pose(rotation=[[0, 1, 0], [1, 0, 0], [0, 0, -1]], position=[0, 0.5, 0])
    )
    a, b = (cc.shape_map(beam, q).positions.full() for beam in (right, cc.mirror(right)))
    assert_allclose(b, np.diag([1, -1, 1]) @ a, atol=1e-14)  # rounding of 5 m


@property_test
@given(weights)
def test_the_root_pose_moves_the_whole_shape(q):
    root = cc.Pose(rotation=oracle.rotation([0.3, -1.0, 2.0]), position=[1, -2, 3])
    lone, moved = cc.shape_map(MIXED, q), cc.shape_map(replace(MIXED, root=root), q)
    for a, b in zip(lone.poses, moved.poses, strict=True):
        expected = root @ a
        assert_allclose(b.position, expected.position, atol=2e-14)  # rounding of 5 m
        assert_allclose(b.rotation, expected.rotation, atol=1e-14)


@property_test
@given(weights)
def test_length_scales_the_shape_at_a_constant_product_with_the_weights(q):
    twice = replace(MIXED, length=10.0)
    a = cc.shape_map(MIXED, q).positions
    b = cc.shape_map(twice, np.array(q) / 2).positions
    assert_allclose(b, 2 * a, atol=1e-14)  # powers of two: the same roundings


@settings(deadline=None, max_examples=8, derandomize=True)
@given(weights)
def test_walking_back_from_the_tip_reverses_the_wing(q):
    tip = cc.shape_map(EXACT, q).tip
    # Turned by π about z at the tip, the frame walks back: R(1 − xi) Z has the curvature −Z K, with
    # Z = diag(−1, −1, 1).
    turn = np.diag([-1, -1, 1])
    reversed_basis = cc.VectorBasis(lambda xi: -turn @ EXACT.basis(1 - xi), 7)
    back = replace(
        EXACT,
        basis=reversed_basis,
        root=cc.Pose(rotation=tip.rotation.full() @ turn, position=tip.position),
    )
    end = cc.shape_map(back, q).tip
    # The rule's error of 40 elements.
    assert_allclose(end.position, np.zeros((3, 1)), atol=1e-9)
    assert_allclose(end.rotation, turn, atol=1e-9)


@settings(deadline=None, max_examples=8, derandomize=True)
@given(weights, st.floats(0.05, 0.95))
def test_an_outer_part_is_a_wing_of_its_own(q, xi):
    whole = cc.shape_map(EXACT, q).tip
    outer = replace(
        EXACT,
        length=5.0 * (1 - xi),
        basis=cc.VectorBasis(lambda x: EXACT.basis(xi + (1 - xi) * x), 7),
        root=cc.pose_at(EXACT, q, xi),
    )
    tip = cc.shape_map(outer, q).tip
    # The rule's error of 40 elements.
    assert_allclose(tip.position, whole.position, atol=1e-9)
    assert_allclose(tip.rotation, whole.rotation, atol=1e-9)
