"""Unit quaternions against rotation matrices and scipy's, which share no code with them."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from curvcasadi.lie import quaternion, so3

RANDOM = np.random.default_rng(4)
VECTORS = [
    np.zeros(3),
    [1e-9, 0, 0],
    [0.3, -0.2, 0.5],
    [2.0, 1.0, -1.0],
    np.array([0, 0, np.pi]),
    [3.0, 3.0, -3.0],
]


def scipy_wxyz(vector):
    return np.roll(Rotation.from_rotvec(vector).as_quat(), 1)


@pytest.mark.parametrize("vector", VECTORS, ids=str)
def test_the_exponential_is_the_rotation_of_its_vector(evaluate, vector):
    q = evaluate(quaternion.exp, vector)
    expected = scipy_wxyz(vector)
    # Either sign is the same rotation; rounding of a polynomial of degree 15.
    assert_allclose(q.ravel() * np.sign(q.ravel() @ expected), expected, atol=1e-14)
    assert_allclose(
        evaluate(quaternion.rotation, q), Rotation.from_rotvec(vector).as_matrix(), atol=1e-14
    )


def test_products_are_products_of_rotations(evaluate):
    a, b = RANDOM.normal(size=(2, 3))
    q = evaluate(lambda u, v: quaternion.product(quaternion.exp(u), quaternion.exp(v)), a, b)
    expected = (Rotation.from_rotvec(a) * Rotation.from_rotvec(b)).as_matrix()
    assert_allclose(quaternion.rotation(ca.DM(q)), expected, atol=1e-14)
    identity = quaternion.product(ca.DM(q), quaternion.conjugate(ca.DM(q)))
    assert_allclose(identity.full().ravel(), [1, 0, 0, 0], atol=1e-15)


@pytest.mark.parametrize("vector", VECTORS[:4], ids=str)
def test_the_logarithm_undoes_the_exponential(evaluate, vector):
    back = evaluate(lambda k: quaternion.log(-quaternion.exp(k)), vector).ravel()
    assert_allclose(back, vector, atol=1e-13)  # either sign of q


def test_the_rate_is_that_of_the_rotation(evaluate):
    """dR/dt by the chain rule through R(q) against R [Ω×]."""
    k, omega = RANDOM.normal(size=(2, 3))
    q = quaternion.exp(ca.DM(k))

    def rotation_rate(q, omega):
        s = ca.SX.sym("q", 4)
        slope = ca.Function("slope", [s], [ca.jacobian(ca.vec(quaternion.rotation(s)), s)])
        return ca.reshape(slope(q) @ quaternion.rate(q, omega), 3, 3)

    expected = so3.exp(ca.DM(k)) @ so3.hat(ca.DM(omega))
    assert_allclose(evaluate(rotation_rate, q, omega), expected, atol=1e-14)


def test_derivatives_at_the_identity_are_finite_and_right(symbolic):
    k = symbolic.sym("k", 3)
    q = quaternion.exp(k)
    jacobian = ca.Function("J", [k], [ca.jacobian(q, k)])(np.zeros(3))
    assert_allclose(jacobian.full(), np.vstack([np.zeros(3), np.eye(3) / 2]), atol=1e-16)
    hessian = ca.Function("H", [k], [ca.hessian(q[0], k)[0]])(np.zeros(3))
    assert_allclose(hessian.full(), -np.eye(3) / 4, atol=1e-16)  # cos(θ/2) = 1 − θ²/8


def test_normalizing_finds_the_nearest_unit_quaternion(evaluate):
    q = RANDOM.normal(size=4)
    assert_allclose(evaluate(quaternion.normalize, q).ravel(), q / np.linalg.norm(q), rtol=1e-15)
