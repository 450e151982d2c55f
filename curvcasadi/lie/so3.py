"""The rotation group SO(3): exponential, logarithm, Jacobians, and the attitude errors of control.

A rotation R takes local components to parent ones; its transpose is the deformation map D. A
rotation vector k is in rad. With θ = |k| and the coefficient functions c_k of `series`:

    exp(k)      = I + c1 [k×] + c2 [k×]²
    J_l(k)      = I + c2 [k×] + c3 [k×]²,    d exp(k) = [J_l dk ×] exp(k)
    J_l(k)⁻¹    = I − ½ [k×] + e [k×]²,      e = (c3 − 2 c4)/(2 c2)
    J_r(k)      = J_l(−k) = J_l(k)ᵀ,         d exp(k) = exp(k) [J_r dk ×]
"""

from __future__ import annotations

import casadi as ca

from curvcasadi.lie import series
from curvcasadi.symbolic.expressions import Expr


def hat(k: Expr) -> Expr:
    """Cross-product matrix [k×] of a vector (3, 1): hat(k) @ v = k × v."""
    return ca.skew(k)


def vee(matrix: Expr) -> Expr:
    """Vector (3, 1) of the skew-symmetric part of a (3, 3) matrix: vee(hat(k)) = k."""
    return ca.inv_skew(matrix)


def exp(k: Expr, degree: int = series.DEGREE) -> Expr:
    """Rotation matrix of the rotation vector `k`.

    R = I + c1(θ²) [k×] + c2(θ²) [k×]²,   θ = |k|          (transpose of Eq. 6, k = s K)

    With the default degree the polynomials are those of sine and cosine to rounding up to θ = 5,
    to 1e-11 up to 2π, and to 1e-6 up to 9; beyond, as for a vector in degrees, the result is no
    rotation.

    Parameters
    ----------
    k : (3, 1), rad
    degree : degree of the polynomials in θ²

    Returns
    -------
    (3, 3)
        Local-to-parent rotation; the deformation map is its transpose.
    """
    x = ca.sumsqr(k)
    k_hat = hat(k)
    c1 = 1 - x * series.c(3, x, degree)
    return ca.DM.eye(3) + c1 * k_hat + series.c(2, x, degree) * (k_hat @ k_hat)


def log(rotation: Expr) -> Expr:
    """Rotation vector (3, 1), rad, of a rotation matrix (3, 3): the inverse of `exp` up to 180°.

    Up to 90°, branch-free:  k = (θ/sin θ) vee(R), where θ/sin θ is an analytic function of
    sin²(θ/2) = (3 − tr R)/4. Beyond, the axis n is the largest column of n nᵀ, read from the
    symmetric part of R. Both branches are finite everywhere, and so are all derivatives below 180°;
    at 180° either sign of the axis is right, and derivatives do not exist.
    """
    cosine = (ca.trace(rotation) - 1) / 2
    sine_axis = vee(rotation)
    beyond = cosine < 0

    half = ca.if_else(beyond, 0, (1 - cosine) / 2)
    near = _angle_over_sine(half) * sine_axis

    outer = (rotation + rotation.T) / 2 - cosine * ca.DM.eye(3)  # (1 − cos θ) n nᵀ
    column = outer[:, 0]
    largest = outer[0, 0]
    for i in (1, 2):
        column = ca.if_else(outer[i, i] > largest, outer[:, i], column)
        largest = ca.fmax(outer[i, i], largest)
    column = ca.if_else(beyond, column, ca.DM([1, 0, 0]))
    axis = column / ca.sqrt(ca.dot(column, column))
    projection = ca.dot(axis, sine_axis)
    sign = ca.if_else(projection < 0, -1, 1)
    far = sign * ca.atan2(sign * projection, ca.if_else(beyond, cosine, -1)) * axis

    return ca.if_else(beyond, far, near)


def _angle_over_sine(half: Expr) -> Expr:
    """θ/sin θ as a function of sin²(θ/2) = `half` < 1, for θ up to 90°.

    Two half-angle steps, sin²(θ/4) = sin²(θ/2)/(2 (1 + cos(θ/2))), bring the argument of the
    series asin(√z)/√z = Σ (2j)!/(4^j j!² (2j + 1)) z^j below sin²(11.25°).
    """
    cos_half = ca.sqrt(1 - half)
    quarter = half / (2 * (1 + cos_half))
    cos_quarter = ca.sqrt(1 - quarter)
    eighth = quarter / (2 * (1 + cos_quarter))
    terms = 14
    coefficient = [1.0]
    for j in range(1, terms):
        coefficient.append(coefficient[-1] * (2 * j - 1) / (2 * j))
    value = 0 * half
    for j in reversed(range(terms)):
        value = coefficient[j] / (2 * j + 1) + eighth * value
    return value / (ca.sqrt(1 - eighth) * cos_quarter * cos_half)


def orthonormal(matrix: Expr) -> Expr:
    """A matrix close to a rotation, closer: one Newton step, C (3 I − Cᵀ C)/2.

    It leaves 3/8 of the square of the deviations, to the nearest rotation.
    """
    return matrix @ (1.5 * ca.DM.eye(3) - 0.5 * (matrix.T @ matrix))


def left_jacobian(k: Expr, degree: int = series.DEGREE) -> Expr:
    """J_l(k), (3, 3): d exp(k) = [J_l dk ×] exp(k); also ∫ exp(t k) dt over [0, 1]."""
    x = ca.sumsqr(k)
    k_hat = hat(k)
    return ca.DM.eye(3) + series.c(2, x, degree) * k_hat + series.c(3, x, degree) * (k_hat @ k_hat)


def right_jacobian(k: Expr, degree: int = series.DEGREE) -> Expr:
    """J_r(k) = J_l(−k), (3, 3): d exp(k) = exp(k) [J_r dk ×]."""
    return left_jacobian(-k, degree)


def left_jacobian_inverse(k: Expr, degree: int = series.DEGREE) -> Expr:
    """J_l(k)⁻¹, (3, 3), for θ < 2π; the default degree serves θ ≤ π."""
    x = ca.sumsqr(k)
    k_hat = hat(k)
    c3, c4 = series.c(3, x, degree), series.c(4, x, degree)
    e = (c3 - 2 * c4) / (2 * series.c(2, x, degree))
    return ca.DM.eye(3) - k_hat / 2 + e * (k_hat @ k_hat)


def right_jacobian_inverse(k: Expr, degree: int = series.DEGREE) -> Expr:
    """J_r(k)⁻¹ = J_l(−k)⁻¹, (3, 3)."""
    return left_jacobian_inverse(-k, degree)


def left_jacobian_product_derivative(
    k: Expr, v: Expr, coefficients: series.Coefficients[Expr]
) -> Expr:
    """d(J_l(k) v)/dk, (3, 3), with the coefficients at |k|².

    With w = k × v and c_k' = (k c_{k+2} − c_{k+1})/2 the derivative of c_k with respect to θ²:

        M = c3 (k·v) I − [(c2 v + c3 w)×] + (2 c2' w + 2 c3' k × w − c3 v) kᵀ
    """
    _, c2, c3, c4, c5, *_ = coefficients
    w = ca.cross(k, v)
    direction = (2 * c4 - c3) * w + (3 * c5 - c4) * ca.cross(k, w) - c3 * v
    return c3 * ca.dot(k, v) * ca.DM.eye(3) - hat(c2 * v + c3 * w) + direction @ k.T


def configuration_error(rotation: Expr, desired: Expr) -> Expr:
    """Trace error Ψ = ½ tr(I − R_dᵀ R) = 1 − cos θ, from 0 to 2; a polynomial of the entries.

    Both arguments are (3, 3) and take local components to the same parent frame.
    """
    return (3 - ca.trace(desired.T @ rotation)) / 2


def attitude_error(rotation: Expr, desired: Expr) -> Expr:
    """e_R = ½ (R_dᵀ R − Rᵀ R_d)^∨, (3, 1), local axes: the gradient of Ψ on the group.

    dΨ/dt = e_R · Ω for a body rate Ω and a constant R_d. |e_R| = sin θ: it vanishes at the goal and
    at 180° from it; `log_error` vanishes at the goal alone.
    """
    return vee(desired.T @ rotation)


def log_error(rotation: Expr, desired: Expr) -> Expr:
    """log(R_dᵀ R), (3, 1), rad: the rotation, in the desired axes, from the desired attitude."""
    return log(desired.T @ rotation)


def rate_error(rate: Expr, rotation: Expr, desired: Expr, desired_rate: Expr) -> Expr:
    """e_Ω = Ω − Rᵀ R_d Ω_d, (3, 1), rad/s, local axes; each rate is in its own local axes."""
    return rate - rotation.T @ desired @ desired_rate
