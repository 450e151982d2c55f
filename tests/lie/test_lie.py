"""The groups SO(3) and SE(3): values, and derivatives up to the third where they matter most."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from numpy.testing import assert_allclose
from scipy.linalg import expm

from curvcasadi.lie import se3, series, so3
from tests.support import oracle

ANGLES = [0.0, 1e-16, 1e-12, 1e-8, 1e-5, 1e-3, 0.03, 0.1, 0.3, 0.7, 1.0]
AXES = [(1, 0, 0), (0, 1, 0), (0, 0, 1), (0.6, -0.48, 0.64), (-1 / 3, 2 / 3, 2 / 3)]
VECTORS = [np.array(axis) * angle for axis in AXES for angle in (0, 1e-9, 0.02, 0.9, 2.0, 3.1)]
TWISTS = [np.array([*k, 1.0, -0.4, 0.3]) for k in VECTORS[::3]]
DIRECTIONS = [(1, 0, 0), (0, 1, 0), (0, 0, 1), (0.5, -0.7, 0.2)]

property_test = settings(deadline=None, max_examples=25, derandomize=True)
coordinates = st.floats(-1.5, 1.5, allow_nan=False, width=32)
vectors3 = st.tuples(coordinates, coordinates, coordinates).map(np.array)
vectors6 = st.tuples(*[coordinates] * 6).map(np.array)


def repeated_derivatives(f, symbol, orders=3):
    """[f, f', f'', f'''] of a scalar `symbol`, as one Function."""
    values = [f]
    for _ in range(orders):
        values.append(ca.jacobian(values[-1], symbol))
    return ca.Function("derivatives", [symbol], [ca.densify(value) for value in values])


# Coefficient functions -------------------------------------------------------------------------


@pytest.mark.parametrize("squared", [False, True], ids=["angle", "squared angle"])
@pytest.mark.parametrize("k", [1, 2, 3, 4, 5])
def test_coefficients_have_right_derivatives_up_to_the_third(symbolic, k, squared):
    s = symbolic.sym("s")
    x = s if squared else s**2
    for form in (series.c(k, x), series.coefficients(x, series.DEGREE)[k - 1]):
        f = repeated_derivatives(form, s)
        for angle in ANGLES:
            got = [float(value) for value in f(angle**2 if squared else angle)]
            expected = [oracle.coefficient_derivative(k, angle, m, squared) for m in range(4)]
            # The bound that is asked for. Odd derivatives at zero must be exact zeros.
            assert_allclose(got, expected, rtol=1e-12, atol=0, err_msg=f"at {angle} rad")


@pytest.mark.parametrize("k", [1, 2, 3])
def test_grid_degree_keeps_derivatives_with_respect_to_the_angle(symbolic, k):
    theta = symbolic.sym("theta")
    f = repeated_derivatives(series.coefficients(theta**2, series.degree_for(1.0))[k - 1], theta)
    for angle in ANGLES:
        got = [float(value) for value in f(angle)]
        expected = [oracle.coefficient_derivative(k, angle, m) for m in range(4)]
        # What degree_for promises of the truncated polynomials of a grid.
        assert_allclose(got, expected, rtol=1e-12, atol=0, err_msg=f"at {angle} rad")


@pytest.mark.parametrize("k", [1, 2, 3])
def test_grid_degree_keeps_derivatives_with_respect_to_the_squared_angle(symbolic, k):
    x = symbolic.sym("x")
    f = repeated_derivatives(series.coefficients(x, series.degree_for(1.0))[k - 1], x)
    for angle in ANGLES:
        got = [float(value) for value in f(angle**2)]
        expected = [oracle.coefficient_derivative(k, angle, m, squared=True) for m in range(4)]
        # Degree 8 is chosen for derivatives with respect to the angle; with respect to its square
        # the third one of c_2 has a relative error of 1.5e-12 at 1 rad.
        assert_allclose(got, expected, rtol=2e-12, atol=0, err_msg=f"at {angle} rad")


@pytest.mark.parametrize("max_angle", [0.5, 1.0, np.pi / 2, np.pi])
def test_degree_for_keeps_third_derivatives_up_to_the_largest_angle(max_angle):
    theta = ca.SX.sym("theta")
    coefficients = series.coefficients(theta**2, series.degree_for(max_angle))
    for k in (2, 3):
        f = repeated_derivatives(coefficients[k - 1], theta)
        got = [float(value) for value in f(max_angle)]
        expected = [oracle.coefficient_derivative(k, max_angle, m) for m in range(4)]
        # 1e-12 is what degree_for promises; a third derivative may pass through zero near π.
        assert_allclose(got[:3], expected[:3], rtol=1e-12, atol=1e-14)
        assert_allclose(got[3], expected[3], rtol=1e-12, atol=1e-13)


@pytest.mark.parametrize(
    "max_angle, real, degree",
    [(0.5, "double", 7), (1.0, "double", 8), (np.pi / 2, "double", 9), (0.5, "float", 3)],
)
def test_degrees_are_the_documented_ones(max_angle, real, degree):
    assert series.degree_for(max_angle, real) == degree


@pytest.mark.parametrize("max_angle", [0.1, 0.5, 1.0, np.pi / 2, np.pi])
@pytest.mark.parametrize("k", [2, 3])
def test_coefficients_hold_in_single_precision(k, max_angle):
    degree = series.degree_for(max_angle, "float")
    for angle in np.float32(max_angle) * np.linspace(0, 1, 60, dtype=np.float32):
        value = series.c(k, angle * angle, degree)
        assert value.dtype == np.float32
        expected = oracle.coefficient_derivative(k, float(angle), 0)
        # Six roundings of 6e-8 each stay below the 1e-6.
        assert_allclose(value, expected, rtol=1e-6)


def test_coefficients_obey_their_recurrence(evaluate):
    def defects(x):
        c = [series.c(k, x) for k in range(7)]
        factorials = [1, 1, 2, 6, 24]
        return ca.vertcat(*(c[k] - 1 / factorials[k] + x * c[k + 2] for k in range(5)))

    for x in (0, 1e-8, 0.5, 9.0):
        # c_0 and c_1 reach 1, x c_k reaches 9/2: a few roundings.
        assert_allclose(evaluate(defects, x), 0, atol=5e-15)


# SO(3) values ----------------------------------------------------------------------------------


def test_hat_is_the_cross_product_and_vee_its_inverse(evaluate):
    k, v = np.array([0.3, -1.2, 0.7]), np.array([-0.4, 0.9, 2.0])
    # Products of two numbers each: one rounding.
    assert_allclose(evaluate(lambda a, b: so3.hat(a) @ b, k, v)[:, 0], np.cross(k, v), atol=1e-15)
    assert_allclose(evaluate(lambda a: so3.vee(so3.hat(a)), k)[:, 0], k, rtol=0, atol=0)


def test_vee_takes_the_skew_symmetric_part(evaluate):
    symmetric = np.array([[1, 2, 3], [2, 5, -1], [3, -1, 4.0]])
    k = np.array([0.3, -1.2, 0.7])
    # Sums of numbers near 3: roundings of 4e-16.
    assert_allclose(evaluate(so3.vee, symmetric + oracle.hat(k))[:, 0], k, atol=1e-15)


def test_exponential_equals_the_matrix_exponential(evaluate):
    for k in VECTORS:
        # expm itself is good to some 1e-15.
        assert_allclose(evaluate(so3.exp, k), oracle.rotation(k), atol=1e-14)


def test_exponential_is_the_transpose_of_the_deformation_map(evaluate):
    k = np.array([0.1, -0.7, 0.4])
    assert_allclose(evaluate(so3.exp, k).T, expm(-oracle.hat(k)), atol=1e-15)


def test_left_jacobian_equals_its_series(evaluate):
    for k in VECTORS:
        expected = oracle.matrix_series(k, (0, 0, 0), 1)[0]
        # Entries of order one: rounding.
        assert_allclose(evaluate(so3.left_jacobian, k), expected, atol=3e-15)
        assert_allclose(evaluate(so3.right_jacobian, k), expected.T, atol=3e-15)


def test_inverse_jacobians_invert_up_to_half_a_turn(evaluate):
    for k in VECTORS:
        left = oracle.matrix_series(k, (0, 0, 0), 1)[0]
        # The inverse has entries up to π/2 near 180°: rounding.
        assert_allclose(evaluate(so3.left_jacobian_inverse, k), np.linalg.inv(left), atol=1e-14)
        assert_allclose(evaluate(so3.right_jacobian_inverse, k), np.linalg.inv(left.T), atol=1e-14)


def test_left_jacobian_product_derivative_equals_ad(symbolic):
    k, v = symbolic.sym("k", 3), symbolic.sym("v", 3)
    coefficients = series.coefficients(ca.sumsqr(k), series.DEGREE)
    structured = so3.left_jacobian_product_derivative(k, v, coefficients)
    by_ad = ca.jacobian(so3.left_jacobian(k) @ v, k)
    f = ca.Function("f", [k, v], [structured, by_ad])
    for k_value in VECTORS:
        got, expected = f(k_value, [0.4, 1.1, -0.8])
        # Entries of order one: rounding of two evaluation orders.
        assert_allclose(got, expected, atol=5e-15)


# SO(3) derivatives -----------------------------------------------------------------------------


@pytest.mark.parametrize("axis", [AXES[1], AXES[3]])
@pytest.mark.parametrize("name, shift", [("exp", 0), ("left_jacobian", 1)])
def test_directional_derivatives_up_to_the_third(symbolic, name, shift, axis):
    t, k, d = symbolic.sym("t"), symbolic.sym("k", 3), symbolic.sym("d", 3)
    values = [ca.vec(getattr(so3, name)(k + t * d, series.degree_for(1.0)))]
    for _ in range(3):
        values.append(ca.jacobian(values[-1], t))
    f = ca.Function("f", [t, k, d], [ca.densify(value) for value in values])
    for angle in (0.0, 1e-16, 1e-8, 1e-3, 0.2, 1.0):
        for direction in DIRECTIONS:
            k_value = angle * np.array(axis)
            expected = oracle.matrix_series(k_value, direction, shift)
            for got, value in zip(f(0, k_value, direction), expected, strict=True):
                # 1e-12 of the largest entry: single entries pass through zero.
                scale = 1e-12 * np.abs(value).max()
                assert_allclose(got.full().reshape(3, 3).T, value, rtol=0, atol=scale)


@pytest.mark.parametrize("axis", AXES)
def test_logarithm_has_right_derivatives_up_to_the_third(symbolic, axis):
    t = symbolic.sym("t")
    R = [symbolic.sym(f"R{m}", 3, 3) for m in range(4)]
    f = [so3.log(R[0] + t * R[1] + t**2 / 2 * R[2] + t**3 / 6 * R[3])]
    for _ in range(3):
        f.append(ca.jacobian(f[-1], t))
    function = ca.Function("f", [t, *R], f)
    for angle in (0.0, 1e-16, 1e-8, 1e-3, 0.5, 1.5, 1.6, 2.5):
        for direction in DIRECTIONS[2:]:
            k = angle * np.array(axis)
            got = function(0, *oracle.matrix_series(k, direction, 0))
            # log(exp(k + t d)) = k + t d: derivatives d, 0, 0. Each derivative beyond 90° divides
            # once more by a sine of at least 0.6.
            for m, expected in enumerate((k, direction, (0, 0, 0), (0, 0, 0))):
                assert_allclose(got[m].full()[:, 0], expected, rtol=0, atol=2e-14 * 10**m)


@pytest.mark.parametrize("mode", ["forward", "reverse"])
@pytest.mark.parametrize("axis", [(1, 0, 0), (0, 1, 0), (0, 0, 1), (0, -1, 0), (0, 0.6, 0.8)])
def test_logarithm_has_right_derivatives_at_exactly_ninety_degrees(symbolic, axis, mode):
    n, d = np.array(axis, dtype=float), np.array([0.3, -0.5, 0.7])
    R = np.outer(n, n) + oracle.hat(n)  # cos θ is exactly zero
    right_jacobian = oracle.matrix_series(np.pi / 2 * n, (0, 0, 0), 1)[0].T
    if mode == "forward":  # d log(R exp(t d))/dt = J_r⁻¹ d
        t = symbolic.sym("t")
        derivative = ca.jacobian(so3.log(R @ so3.exp(t * ca.DM(d))), t)
        expected = np.linalg.solve(right_jacobian, d)
    else:  # gradient of d · log(R exp(t))
        t = symbolic.sym("t", 3)
        derivative = ca.gradient(ca.dot(ca.DM(d), so3.log(R @ so3.exp(t))), t)
        expected = np.linalg.solve(right_jacobian.T, d)
    got = ca.Function("f", [t], [derivative])(0).full()[:, 0]
    assert_allclose(got, expected, atol=1e-13)  # rounding of numbers of order one


@pytest.mark.parametrize("axis", AXES)
def test_logarithm_is_right_up_to_half_a_turn(evaluate, axis):
    for below in (1.0, 1e-2, 1e-4, 1e-8, 1e-12):
        k = (np.pi - below) * np.array(axis)
        # The rotation's rounding, 1e-16, is divided by a Jacobian of at most π/2.
        assert_allclose(evaluate(so3.log, oracle.rotation(k))[:, 0], k, atol=2e-14)


@pytest.mark.parametrize("axis", AXES)
def test_logarithm_of_half_a_turn_is_one_of_the_two_axes(evaluate, axis):
    n = np.array(axis, dtype=float)
    k = evaluate(so3.log, 2 * np.outer(n, n) - np.eye(3))[:, 0]
    assert_allclose(np.linalg.norm(k), np.pi, atol=1e-14)  # rounding
    assert_allclose(abs(k @ n), np.pi, atol=1e-14)


def test_logarithm_of_the_wing_root_rotations_is_half_a_turn(evaluate):
    R = np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1.0]])
    k = evaluate(so3.log, R)[:, 0]
    assert_allclose(oracle.rotation(k), R, atol=1e-14)  # rounding of expm


def test_logarithm_stands_rotations_that_are_not_quite_orthogonal(evaluate):
    rng = np.random.default_rng(0)
    for k in (np.zeros(3), [0.2, -1.0, 0.4], [1.5, -2.0, 1.2]):
        noisy = oracle.rotation(k) + 1e-12 * rng.standard_normal((3, 3))
        # An error of 1e-12 in R is one of some 1e-12 in k, far from 180°.
        assert_allclose(evaluate(so3.log, noisy)[:, 0], k, atol=3e-11)


# Attitude errors as costs ----------------------------------------------------------------------


def _cost(name, R, goal):
    if name == "trace":
        return so3.configuration_error(R, goal)
    error = so3.attitude_error if name == "vector" else so3.log_error
    return ca.sumsqr(error(R, goal)) / 2


@pytest.mark.parametrize("goal", [(0, 0, 0), (0.3, -0.5, 0.7), (0, 0, np.pi / 2), (1.2, -2.0, 1)])
@pytest.mark.parametrize("name", ["trace", "vector", "logarithm"])
def test_attitude_costs_are_smooth_and_right_at_the_goal(symbolic, name, goal):
    k = symbolic.sym("k", 3)
    cost = _cost(name, so3.exp(k), ca.DM(oracle.rotation(goal)))
    hessian, gradient = ca.hessian(cost, k)
    f = ca.Function("f", [k], [cost, gradient, hessian])
    value, slope, curvature = (np.array(part) for part in f(goal))
    right_jacobian = oracle.matrix_series(goal, (0, 0, 0), 1)[0].T
    # All three are θ²/2 + O(θ³) in the relative rotation, whose rate is J_r dk. Rounding.
    assert_allclose(value, 0, atol=5e-15)
    assert_allclose(slope, 0, atol=1e-14)
    assert_allclose(curvature, right_jacobian.T @ right_jacobian, atol=5e-14)


def test_trace_error_is_one_minus_the_cosine(evaluate):
    R_d = oracle.rotation([0.4, 1.0, -0.2])
    for axis in AXES:
        for angle in (0, 1e-3, 1.0, 3.0, np.pi):
            R = R_d @ oracle.rotation(angle * np.array(axis))
            psi = evaluate(so3.configuration_error, R, R_d).item()
            assert_allclose(psi, 1 - np.cos(angle), atol=1e-14)  # rounding of the trace


def test_attitude_error_is_the_gradient_of_the_trace_error(symbolic):
    R, R_d = oracle.rotation([0.4, 1.0, -0.2]), oracle.rotation([-0.9, 0.3, 0.8])
    w = symbolic.sym("w", 3)
    psi = so3.configuration_error(R @ so3.exp(w), ca.DM(R_d))
    gradient = ca.Function("f", [w], [ca.gradient(psi, w)])(np.zeros(3))
    # dΨ = e_R · Ω with the body rate Ω: rounding.
    assert_allclose(gradient, so3.attitude_error(ca.DM(R), ca.DM(R_d)), atol=2e-15)


def test_attitude_error_has_the_length_of_the_sine(evaluate):
    R_d = oracle.rotation([0.4, 1.0, -0.2])
    for angle in (0, 0.5, 2.0, np.pi):
        e = evaluate(so3.attitude_error, R_d @ oracle.rotation([0, angle, 0]), R_d)
        assert_allclose(e[:, 0], [0, np.sin(angle), 0], atol=1e-14)  # rounding


def test_log_error_is_the_rotation_from_the_goal(evaluate):
    R_d = oracle.rotation([0.4, 1.0, -0.2])
    for k in VECTORS:
        got = evaluate(so3.log_error, R_d @ oracle.rotation(k), R_d)
        assert_allclose(got[:, 0], k, atol=3e-14)  # as the logarithm


def test_rate_error_is_the_body_rate_of_the_relative_rotation(evaluate):
    rate, goal_rate = np.array([0.2, -0.4, 0.9]), np.array([-0.7, 0.1, 0.3])
    R, R_d = oracle.rotation([0.4, 1.0, -0.2]), oracle.rotation([-0.9, 0.3, 0.8])
    relative = R_d.T @ R
    relative_rate = R_d.T @ R @ oracle.hat(rate) - oracle.hat(goal_rate) @ R_d.T @ R
    expected = relative.T @ relative_rate  # [e_Ω×]
    got = evaluate(so3.rate_error, rate, R, R_d, goal_rate)
    assert_allclose(oracle.hat(got), expected, atol=1e-15)  # rounding


# SE(3) -----------------------------------------------------------------------------------------


def test_se3_hat_and_vee_are_inverse(evaluate):
    xi = np.array([0.1, -0.2, 0.3, 0.4, -0.5, 0.6])
    assert_allclose(evaluate(se3.hat, xi), oracle.twist_matrix(xi), rtol=0, atol=0)
    assert_allclose(evaluate(lambda x: se3.vee(se3.hat(x)), xi)[:, 0], xi, rtol=0, atol=0)


def test_se3_exponential_equals_the_matrix_exponential(evaluate):
    for xi in TWISTS:
        assert_allclose(evaluate(se3.exp, xi), expm(oracle.twist_matrix(xi)), atol=1e-14)


def test_se3_logarithm_inverts_the_exponential(evaluate):
    for xi in TWISTS:
        got = evaluate(se3.log, expm(oracle.twist_matrix(xi)))[:, 0]
        assert_allclose(got, xi, atol=5e-14)  # as the logarithm on SO(3)


def test_se3_exponential_has_right_derivatives_up_to_the_third(symbolic):
    t, x, d = symbolic.sym("t"), symbolic.sym("x", 6), symbolic.sym("d", 6)
    values = [ca.vec(se3.exp(x + t * d, series.degree_for(1.0)))]
    for _ in range(3):
        values.append(ca.jacobian(values[-1], t))
    f = ca.Function("f", [t, x, d], [ca.densify(value) for value in values])
    direction = (0.3, -0.8, 0.5, 0.2, 0.1, -0.4)
    for angle in (0.0, 1e-16, 1e-8, 1e-3, 1.0):
        xi = np.array([0.6 * angle, -0.48 * angle, 0.64 * angle, 1, 0, 0])
        expected = oracle.matrix_series(xi, direction, 0, size=4)
        for got, value in zip(f(0, xi, direction), expected, strict=True):
            # 1e-12 of the largest entry, as on SO(3).
            atol = 1e-12 * np.abs(value).max()
            assert_allclose(got.full().reshape(4, 4).T, value, rtol=0, atol=atol)


def test_se3_adjoint_moves_a_twist_to_the_parent(evaluate):
    pose, xi = expm(oracle.twist_matrix(TWISTS[-1])), TWISTS[4]
    moved = evaluate(lambda T, x: se3.adjoint(T) @ x, pose, xi)[:, 0]
    expected = pose @ oracle.twist_matrix(xi) @ np.linalg.inv(pose)
    assert_allclose(oracle.twist_matrix(moved), expected, atol=1e-14)  # rounding


def test_se3_small_adjoint_is_the_bracket(evaluate):
    a, b = TWISTS[3], TWISTS[-1]
    A, B = oracle.twist_matrix(a), oracle.twist_matrix(b)
    got = evaluate(lambda x, y: se3.small_adjoint(x) @ y, a, b)[:, 0]
    assert_allclose(oracle.twist_matrix(got), A @ B - B @ A, atol=1e-14)  # rounding


def test_se3_inverse_is_the_inverse(evaluate):
    pose = expm(oracle.twist_matrix(TWISTS[-1]))
    assert_allclose(evaluate(se3.inverse, pose) @ pose, np.eye(4), atol=1e-14)  # rounding


@pytest.mark.parametrize("xi", TWISTS, ids=str)
def test_se3_jacobians_equal_the_series_of_the_small_adjoint(evaluate, xi):
    R, v = oracle.hat(xi[:3]), oracle.hat(xi[3:])
    ad = np.block([[R, np.zeros((3, 3))], [v, R]])
    term, left = np.eye(6), np.eye(6)
    for m in range(1, 60):
        term = term @ ad / (m + 1)
        left = left + term
    right = np.linalg.solve(
        np.block(
            [
                [oracle.rotation(xi[:3]), np.zeros((3, 3))],
                [
                    oracle.hat(expm(oracle.twist_matrix(xi))[:3, 3]) @ oracle.rotation(xi[:3]),
                    oracle.rotation(xi[:3]),
                ],
            ]
        ),
        left,
    )
    # The series sums terms up to 3.1^3/6 ~ 5: a few roundings.
    assert_allclose(evaluate(se3.left_jacobian, xi), left, atol=2e-14)
    assert_allclose(evaluate(se3.right_jacobian, xi), right, atol=5e-14)
    assert_allclose(evaluate(se3.left_jacobian_inverse, xi), np.linalg.inv(left), atol=5e-14)
    assert_allclose(evaluate(se3.right_jacobian_inverse, xi), np.linalg.inv(right), atol=1e-13)


def test_attitude_cost_has_a_gradient_where_the_target_is_turned_by_ninety_degrees(symbolic):
    k = symbolic.sym("k", 3)
    goal = ca.DM([[0, 0, 1], [0, 1, 0], [-1, 0, 0]])  # exp(π/2 e_y)
    cost = ca.sumsqr(so3.log_error(so3.exp(k), goal))
    gradient = ca.Function("f", [k], [ca.gradient(cost, k)])(0)
    # d θ²/dk = 2 θ along the axis −e_y of R_dᵀ: rounding.
    assert_allclose(gradient.full()[:, 0], [0, -np.pi, 0], atol=1e-13)


@pytest.mark.parametrize("turn", [0, 90, -90, 120, 179])
@pytest.mark.parametrize("axis", AXES[:3])
def test_attitude_cost_has_a_hessian_at_every_turn(symbolic, axis, turn):
    k = symbolic.sym("k", 3)
    angle = np.deg2rad(turn)
    R = np.round(oracle.rotation(angle * np.array(axis)), 15)  # exact zeros at 90°
    cost = ca.sumsqr(so3.log(ca.DM(R) @ so3.exp(k)))
    hessian, gradient = (part.full() for part in ca.Function("f", [k], [*ca.hessian(cost, k)])(0))
    # θ² grows along the axis as (θ + k)², and across it by θ cot(θ/2) k²/2.
    along = np.outer(axis, axis)
    across = angle / np.tan(angle / 2) if turn else 2.0
    assert_allclose(gradient[:, 0], 2 * angle * np.array(axis), atol=1e-12)
    # Rounding to fifteen digits; two derivatives near 180° divide by its sine twice.
    expected = 2 * along + across * (np.eye(3) - along)
    assert_allclose((hessian + hessian.T) / 2, expected, atol=1e-10)


# Laws ------------------------------------------------------------------------------------------


@property_test
@given(vectors3)
def test_exponentials_are_rotations(k):
    R = so3.exp(ca.DM(k)).full()
    assert_allclose(R.T @ R, np.eye(3), atol=3e-15)  # rounding
    assert_allclose(np.linalg.det(R), 1, atol=5e-15)


@property_test
@given(vectors3, st.floats(-1, 1), st.floats(-1, 1))
def test_exponentials_about_one_axis_add(k, a, b):
    R = so3.exp(ca.DM(a * k)) @ so3.exp(ca.DM(b * k))
    assert_allclose(R, so3.exp(ca.DM((a + b) * k)), atol=2e-14)  # angles up to 5 rad


@property_test
@given(vectors3)
def test_the_transpose_is_the_exponential_of_the_opposite(k):
    assert_allclose(so3.exp(ca.DM(k)).T, so3.exp(ca.DM(-k)), rtol=0, atol=0)


@property_test
@given(vectors3)
def test_logarithm_inverts_the_exponential(k):
    # |k| up to 2.6 rad; rounding.
    assert_allclose(so3.log(so3.exp(ca.DM(k))).full()[:, 0], k, atol=2e-14)


@property_test
@given(vectors3, vectors3)
def test_rotating_a_rotation_vector_conjugates(k, w):
    R = so3.exp(ca.DM(w))
    assert_allclose(R @ so3.exp(ca.DM(k)) @ R.T, so3.exp(R @ ca.DM(k)), atol=2e-14)  # rounding


@property_test
@given(vectors6, vectors6)
def test_the_adjoint_is_a_homomorphism(a, b):
    A, B = se3.exp(ca.DM(a)), se3.exp(ca.DM(b))
    assert_allclose(se3.adjoint(A @ B), se3.adjoint(A) @ se3.adjoint(B), atol=5e-14)  # rounding


@property_test
@given(vectors6)
def test_left_and_right_jacobians_differ_by_the_adjoint(xi):
    x = ca.DM(xi)
    got = se3.adjoint(se3.exp(x)) @ se3.right_jacobian(x)
    assert_allclose(got, se3.left_jacobian(x), atol=5e-14)  # rounding


@property_test
@given(vectors6)
def test_the_exponential_of_the_opposite_is_the_inverse(xi):
    pose = se3.exp(ca.DM(xi)) @ se3.exp(ca.DM(-xi))
    assert_allclose(pose, np.eye(4), atol=2e-14)  # rounding
