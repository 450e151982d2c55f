"""One element: from its strain to a change of pose, and back from a wrench to its strain.

Expressions are SX: a step is built once and called with any kind.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import NamedTuple

import casadi as ca

from curvcasadi.beam.grid import ElementRule, ExponentialName
from curvcasadi.kinematics.rules import Strain, strain_curvature, strain_with_derivatives
from curvcasadi.lie import series, so3


class _Factors(NamedTuple):
    """R_e = I + a [θ×] + b [θ×]², p_e = (I + c [θ×] + d [θ×]²) v."""

    a: ca.SX | float
    b: ca.SX | float
    c: ca.SX | float
    d: ca.SX | float


def _series(x: ca.SX, degree: int) -> _Factors:
    c1, c2, c3, *_ = series.coefficients(x, degree)
    return _Factors(c1, c2, c2, c3)


def _rodrigues(x: ca.SX, degree: int) -> _Factors:
    """Eqs. 6 and 13 in closed form; below 0.1 rad, where they cancel, the series."""
    c1, c2, c3, *_ = _closed_coefficients(x, degree)
    return _Factors(c1, c2, c2, c3)


def _small_angle_sine(x: ca.SX, degree: int) -> _Factors:
    """Eq. 15, cos α → 1: R_e = I + (sin α/α) [θ×], p_e = (I + c2 [θ×]) v. Not a rotation."""
    c1, c2, _, _ = _series(x, degree)
    return _Factors(c1, 0, c2, 0)


def _small_angle(x: ca.SX, degree: int) -> _Factors:
    """Eqs. 16–18, first order in α: R_e = I + [θ×], p_e = (I + ½ [θ×]) v. Not a rotation."""
    return _Factors(1, 0, 1 / 2, 0)


_FACTORS: dict[ExponentialName, Callable[[ca.SX, int], _Factors]] = {
    "series": _series,
    "rodrigues": _rodrigues,
    "small_angle_sine": _small_angle_sine,
    "small_angle": _small_angle,
}

#: Exponentials onto the group, whose poses have twists, with c_1 … c_7 of their tangent.
ON_GROUP = ("series", "rodrigues")


def _closed_coefficients(x: ca.SX, degree: int) -> series.Coefficients[ca.SX]:
    """c_1 … c_7 by trigonometric functions, by double-where: neither branch is ever singular."""
    small = x < 0.01
    safe = ca.if_else(small, 1, x)
    angle = ca.sqrt(safe)
    c1 = ca.sin(angle) / angle
    c2 = (1 - ca.cos(angle)) / safe
    c3 = (1 - c1) / safe
    c4, c5 = (1 / 2 - c2) / safe, (1 / 6 - c3) / safe
    closed = (c1, c2, c3, c4, c5, (1 / 24 - c4) / safe, (1 / 120 - c5) / safe)
    near = series.coefficients(ca.if_else(small, x, 0), degree)
    return series.Coefficients(
        *(ca.if_else(small, a, b) for a, b in zip(near, closed, strict=True))
    )


def _combination(unit: ca.SX, hat: ca.SX | float, outer: ca.SX, theta: ca.SX) -> ca.SX:
    """unit I + hat [θ×] + outer θᵀ, (3, 3), for `outer` parallel to θ."""
    symmetric = ca.triu2symm(ca.triu(outer @ theta.T))
    return unit * ca.DM.eye(3) + hat * so3.hat(theta) + symmetric


def advance(
    rotation: ca.SX, position: ca.SX, strain: Strain, exponential: ExponentialName, degree: int
) -> Strain:
    """Pose (R, p) at the end of an element: R ← R R_e, p ← p + R p_e (Eqs. 5–13).

    With [θ×]² = θ θᵀ − θ² I:

        R_e = (1 − b θ²) I + a [θ×] + b θ θᵀ,   p_e = (1 − d θ²) v + c θ × v + d (θ·v) θ
    """
    theta, v = strain
    x = ca.sumsqr(theta)
    a, b, c, d = _FACTORS[exponential](x, degree)
    element_rotation = _combination(1 - x * b, a, b * theta, theta)
    element_position = (1 - x * d) * v + ca.cross(c * theta, v) + d * ca.dot(theta, v) * theta
    return rotation @ element_rotation, position + rotation @ element_position


def advance_with_tangent(
    rotation: ca.SX,
    position: ca.SX,
    h: ca.SX,
    moments: ca.SX,
    rule: ElementRule,
    exponential: ExponentialName,
    degree: int,
) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX]:
    """Pose at the end of an element, and how its strain moves everything outboard of it.

    The spatial twist of all that lies outboard, in parent axes at the parent origin, is
    Ad(T) J_l(ξ) dξ, here written with the position p⁺ at the element's end and
    M = d(J_l(θ) v)/dθ:

        angular = R J_l dθ,      linear = (R M + [p⁺×] R J_l) dθ + R J_l dv

    Parameters
    ----------
    rotation, position : (3, 3) and (3, 1), pose at the element's start
    h, moments : (1, 1) and (3, m)

    Returns
    -------
    rotation, position : pose at the end, R⁺ = R + R J_l [θ×], p⁺ = p + R J_l v
    angular, linear : (3, 1 + 3 m)
        Derivatives with respect to (h, M_1 … M_m).
    """
    rotation, position, left, shift, d_theta, d_v = advance_with_factors(
        rotation, position, h, moments, rule, exponential, degree
    )
    return rotation, position, left @ d_theta, shift @ d_theta + left @ d_v


def advance_with_factors(
    rotation: ca.SX,
    position: ca.SX,
    h: ca.SX,
    moments: ca.SX,
    rule: ElementRule,
    exponential: ExponentialName,
    degree: int,
) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX, ca.SX, ca.SX]:
    """`advance_with_tangent` before its products: R⁺, p⁺, R J_l, R M + [p⁺×] R J_l, dθ and dv."""
    theta, v, d_theta, d_v = strain_with_derivatives(rule)(h, moments)
    x = ca.sumsqr(theta)
    tangent = tangent_coefficients(x, exponential, degree)
    left = rotation @ _combination(tangent.c1, tangent.c2, tangent.c3 * theta, theta)  # R J_l
    end = position + left @ v
    shift = rotation @ so3.left_jacobian_product_derivative(theta, v, tangent)
    shift += so3.hat(end) @ left
    return rotation + left @ so3.hat(theta), end, left, shift, d_theta, d_v


def strain_force(
    h: ca.SX,
    moments: ca.SX,
    wrench: ca.SX,
    rule: ElementRule,
    exponential: ExponentialName,
    degree: int,
) -> ca.SX:
    """What a wrench at or outboard of an element's end does to its strain: (1 + 3 m, 1).

    The transpose of `advance_with_tangent`, (dξ/d(h, M))ᵀ J_l(ξ)ᵀ w, applied without forming it.
    For w = (m, f) and x ↦ J_lᵀ x = x − c2 θ × x + c3 θ × (θ × x):

        by θ:  J_lᵀ (m − J_l v × f) + Mᵀ f,      by v:  J_lᵀ f

    Parameters
    ----------
    h, moments : (1, 1) and (3, m)
    wrench : (6, 1), moment first, local axes and origin of the element's start

    Returns
    -------
    (1 + 3 m, 1)
        Virtual work on (h, M_1 … M_m).
    """
    theta, v, d_theta, d_v = strain_with_derivatives(rule)(h, moments)
    coefficients = tangent_coefficients(ca.sumsqr(theta), exponential, degree)
    by_theta, by_v = _work_on_strain(theta, v, coefficients, wrench)
    return d_theta.T @ by_theta + d_v.T @ by_v


def strain_force_with_derivatives(
    h: ca.SX,
    moments: ca.SX,
    wrench: ca.SX,
    rule: ElementRule,
    exponential: ExponentialName,
    degree: int,
) -> tuple[ca.SX, ca.SX, ca.SX]:
    """`strain_force` τ, ∂τ/∂w (1 + 3 m, 6) and ∂τ/∂(h, M) (1 + 3 m, 1 + 3 m).

    The coefficient functions are differentiated in closed form, the rest by AD of this element.
    """
    theta, v, d_theta, d_v = strain_with_derivatives(rule)(h, moments)
    coefficients = tangent_coefficients(ca.sumsqr(theta), exponential, degree)
    work, by_theta, by_v, by_coefficients, by_wrench = _work_derivatives()(
        theta, v, ca.vertcat(*coefficients), wrench
    )
    by_theta += 2 * (by_coefficients[:, :5] @ ca.vertcat(*series.slopes(coefficients))) @ theta.T
    d_strain = ca.vertcat(d_theta, d_v)
    by_interval = d_strain.T @ (by_theta @ d_theta + by_v @ d_v)
    by_interval += strain_curvature(rule)(h, moments, work)
    return d_strain.T @ work, d_strain.T @ by_wrench, by_interval


def _work_on_strain(
    theta: ca.SX, v: ca.SX, coefficients: series.Coefficients[ca.SX], wrench: ca.SX
) -> Strain:
    """Virtual work of a local wrench on θ and on v: see `strain_force`."""
    c1, c2, c3, c4, c5, *_ = coefficients
    moment, force = wrench[:3], wrench[3:]

    def transposed(x: ca.SX) -> ca.SX:
        return c1 * x - ca.cross(c2 * theta, x) + c3 * ca.dot(theta, x) * theta

    along, w = ca.dot(theta, v), ca.cross(theta, v)
    end = c1 * v + c2 * w + c3 * along * theta
    direction = (2 * c4 - c3) * w + (3 * c5 - c4) * ca.cross(theta, w) - c3 * v
    by_theta = transposed(moment - ca.cross(end, force))
    by_theta += c3 * along * force + ca.cross(c2 * v + c3 * w, force)
    by_theta += ca.dot(direction, force) * theta
    return by_theta, transposed(force)


@cache
def _work_derivatives() -> ca.Function:
    """(θ, v, c, w) -> work on (θ, v), and its partial derivatives with respect to each."""
    theta, v, wrench = (ca.SX.sym(*s) for s in (("theta", 3), ("v", 3), ("wrench", 6)))
    c = ca.SX.sym("c", 7)
    work = ca.veccat(*_work_on_strain(theta, v, series.Coefficients(*ca.vertsplit(c)), wrench))
    arguments = [theta, v, c, wrench]
    return ca.Function("work", arguments, [work, *(ca.jacobian(work, x) for x in arguments)])


def rotation_of(theta: ca.SX, c1: ca.SX, c2: ca.SX) -> ca.SX:
    """R_e = (1 − c_2 θ²) I + c_1 [θ×] + c_2 θ θᵀ, with the coefficients at θ²."""
    return _combination(1 - ca.sumsqr(theta) * c2, c1, c2 * theta, theta)


def tangent_coefficients(
    x: ca.SX, exponential: ExponentialName, degree: int
) -> series.Coefficients[ca.SX]:
    """c_1 … c_7 at the squared angle `x`, for exponentials onto the group alone."""
    if exponential not in ON_GROUP:
        raise ValueError(
            f"Grid.exponential: twists and Jacobians need {' or '.join(ON_GROUP)}, "
            f"found {exponential!r}, which leaves SO(3)"
        )
    closed = exponential == "rodrigues"
    return _closed_coefficients(x, degree) if closed else series.coefficients(x, degree)
