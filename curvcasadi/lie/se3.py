"""The group SE(3) of poses T = (R, p): 4 × 4 matrices, 6-vectors with the angular part first.

A strain or twist ξ = (θ, v) has ξ^ = [[θ×, v], [0, 0]]. With M = d(J_l(θ) v)/dθ of `so3`:

    exp(ξ)    = (exp(θ), J_l(θ) v)                                            (Eqs. 6 and 13)
    Ad(T)     = [[R, 0], [p× R, R]]
    J_l(ξ)    = [[J_l(θ), 0], [Q, J_l(θ)]],   Q = M + [J_l(θ) v ×] J_l(θ)
"""

from __future__ import annotations

import casadi as ca

from curvcasadi.lie import series, so3
from curvcasadi.symbolic.expressions import Expr


def matrix(rotation: Expr, position: Expr) -> Expr:
    """Homogeneous matrix (4, 4) of a rotation (3, 3) and a position (3, 1)."""
    return ca.vertcat(ca.horzcat(rotation, position), ca.DM([[0, 0, 0, 1]]))


def hat(xi: Expr) -> Expr:
    """Matrix ξ^ (4, 4) of a 6-vector, angular part first."""
    return ca.vertcat(ca.horzcat(so3.hat(xi[:3]), xi[3:]), ca.DM.zeros(1, 4))


def vee(matrix: Expr) -> Expr:
    """6-vector of a (4, 4) matrix: vee(hat(ξ)) = ξ."""
    return ca.vertcat(so3.vee(matrix[:3, :3]), matrix[:3, 3])


def exp(xi: Expr, degree: int = series.DEGREE) -> Expr:
    """Pose (4, 4) of the 6-vector ξ = (θ, v): R = exp(θ), p = J_l(θ) v (Eqs. 6 and 13)."""
    theta, v = xi[:3], xi[3:]
    return matrix(so3.exp(theta, degree), so3.left_jacobian(theta, degree) @ v)


def log(pose: Expr) -> Expr:
    """6-vector of a pose (4, 4); rotations up to 180°, derivatives as those of `so3.log`."""
    theta = so3.log(pose[:3, :3])
    return ca.vertcat(theta, so3.left_jacobian_inverse(theta) @ pose[:3, 3])


def inverse(pose: Expr) -> Expr:
    """Inverse pose (4, 4): (Rᵀ, −Rᵀ p)."""
    rotation = pose[:3, :3]
    return matrix(rotation.T, -(rotation.T @ pose[:3, 3]))


def adjoint(pose: Expr) -> Expr:
    """Ad(T), (6, 6): takes a twist in local axes to the same twist in parent axes."""
    rotation = pose[:3, :3]
    return _lower_triangle(rotation, so3.hat(pose[:3, 3]) @ rotation)


def small_adjoint(xi: Expr) -> Expr:
    """ad(ξ), (6, 6): ad(ξ) η is the bracket [ξ, η]."""
    return _lower_triangle(so3.hat(xi[:3]), so3.hat(xi[3:]))


def left_jacobian(xi: Expr, degree: int = series.DEGREE) -> Expr:
    """J_l(ξ), (6, 6): the parent-axes twist of d exp(ξ) is J_l(ξ) dξ."""
    theta, v = xi[:3], xi[3:]
    jacobian = so3.left_jacobian(theta, degree)
    return _lower_triangle(jacobian, _coupling(theta, v, jacobian, degree))


def right_jacobian(xi: Expr, degree: int = series.DEGREE) -> Expr:
    """J_r(ξ) = J_l(−ξ), (6, 6): the body twist of d exp(ξ) is J_r(ξ) dξ."""
    return left_jacobian(-xi, degree)


def left_jacobian_inverse(xi: Expr, degree: int = series.DEGREE) -> Expr:
    """J_l(ξ)⁻¹, (6, 6), for rotations below 2π: [[J⁻¹, 0], [−J⁻¹ Q J⁻¹, J⁻¹]]."""
    theta, v = xi[:3], xi[3:]
    inverse = so3.left_jacobian_inverse(theta, degree)
    coupling = _coupling(theta, v, so3.left_jacobian(theta, degree), degree)
    return _lower_triangle(inverse, -inverse @ coupling @ inverse)


def right_jacobian_inverse(xi: Expr, degree: int = series.DEGREE) -> Expr:
    """J_r(ξ)⁻¹ = J_l(−ξ)⁻¹, (6, 6)."""
    return left_jacobian_inverse(-xi, degree)


def _coupling(theta: Expr, v: Expr, jacobian: Expr, degree: int) -> Expr:
    coefficients = series.coefficients(ca.sumsqr(theta), degree)
    derivative = so3.left_jacobian_product_derivative(theta, v, coefficients)
    return derivative + so3.hat(jacobian @ v) @ jacobian


def _lower_triangle(diagonal: Expr, coupling: Expr) -> Expr:
    return ca.vertcat(ca.horzcat(diagonal, 0 * diagonal), ca.horzcat(coupling, diagonal))
