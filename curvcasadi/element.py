"""One element: from curvatures to its strain, and from its strain to a change of pose.

A rule turns curvatures at its points into moments M_k = h Σ_i W_ki K_i, and the element length h
and its moments into one strain ξ = (θ, v), the 6-vector whose exponential is the element:
T ← T exp(ξ) integrates T' = T ξ^ with ξ = (K, e_x). Moments are linear in the curvature, so a
basis enters an element through its moments alone. Expressions are SX: a step is built once and
called with any kind.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from math import sqrt
from typing import NamedTuple

import casadi as ca

from curvcasadi.lie import series, so3

E_X = ca.DM([1, 0, 0])

Strain = tuple[ca.SX, ca.SX]


@dataclass(frozen=True)
class Rule:
    """Points on [0, 1], weights W of the moments, order, and strain (θ, v) of (h, moments)."""

    points: tuple[float, ...]
    weights: tuple[tuple[float, ...], ...]  #: a row per moment, a column per point
    order: int
    strain: Callable[[ca.SX, ca.SX], Strain]


def _mean(h: ca.SX, moments: ca.SX) -> Strain:
    """θ = h K of one mean curvature K, v = h e_x."""
    return moments[:, 0], h * E_X


def _magnus4(h: ca.SX, moments: ca.SX) -> Strain:
    """θ = α + α × γ, v = h (e_x + e_x × γ).

    With α = h/2 (K_1 + K_2), γ = √3/12 h (K_2 − K_1) and c = √3/12 h² this is
    θ = h/2 (K_1 + K_2) + c K_1 × K_2, v = h e_x + c (K_1 − K_2) × e_x.
    """
    alpha, gamma = moments[:, 0], moments[:, 1]
    return alpha + ca.cross(alpha, gamma), h * (E_X + ca.cross(E_X, gamma))


def _magnus6(h: ca.SX, moments: ca.SX) -> Strain:
    """Magnus expansion of order 6 on three Gauss points; [·, ·] is the bracket of se(3).

    With a = h ξ_2, b = √15/3 h (ξ_3 − ξ_1), c = 10/3 h (ξ_3 − 2 ξ_2 + ξ_1):

        ξ = a + c/12 + [b + d_2, d_1 − 20 a − c]/240,
        d_1 = [b, a],   d_2 = −[2 c + d_1, a]/60
    """
    zero = ca.SX.zeros(3)
    a, b, c = (moments[:, 0], h * E_X), (moments[:, 1], zero), (moments[:, 2], zero)
    d1 = _bracket(b, a)
    d2 = _combine((-1 / 60, _bracket(_combine((2, c), (1, d1)), a)))
    commutator = _bracket(_combine((1, b), (1, d2)), _combine((1, d1), (-20, a), (-1, c)))
    return _combine((1, a), (1 / 12, c), (1 / 240, commutator))


def _bracket(a: Strain, b: Strain) -> Strain:
    """[a, b] = ad(a) b of se(3), angular part first."""
    return ca.cross(a[0], b[0]), ca.cross(a[1], b[0]) + ca.cross(a[0], b[1])


def _combine(*terms: tuple[float, Strain]) -> Strain:
    zero = ca.SX.zeros(3)
    return sum((f * s[0] for f, s in terms), zero), sum((f * s[1] for f, s in terms), zero)


_GAUSS2, _GAUSS3 = sqrt(3) / 6, sqrt(15) / 10

RULES = {
    "trapezoid": Rule((0.0, 1.0), ((0.5, 0.5),), 2, _mean),
    "midpoint": Rule((0.5,), ((1.0,),), 2, _mean),
    "magnus4": Rule(
        (0.5 - _GAUSS2, 0.5 + _GAUSS2),
        ((0.5, 0.5), (-sqrt(3) / 12, sqrt(3) / 12)),
        4,
        _magnus4,
    ),
    "magnus6": Rule(
        (0.5 - _GAUSS3, 0.5, 0.5 + _GAUSS3),
        ((0.0, 1.0, 0.0), (-sqrt(15) / 3, 0.0, sqrt(15) / 3), (10 / 3, -20 / 3, 10 / 3)),
        6,
        _magnus6,
    ),
}


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


EXPONENTIALS = {
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
    rotation: ca.SX, position: ca.SX, strain: Strain, exponential: str, degree: int
) -> Strain:
    """Pose (R, p) at the end of an element: R ← R R_e, p ← p + R p_e (Eqs. 5–13).

    With [θ×]² = θ θᵀ − θ² I:

        R_e = (1 − b θ²) I + a [θ×] + b θ θᵀ,   p_e = (1 − d θ²) v + c θ × v + d (θ·v) θ
    """
    theta, v = strain
    x = ca.sumsqr(theta)
    a, b, c, d = EXPONENTIALS[exponential](x, degree)
    element_rotation = _combination(1 - x * b, a, b * theta, theta)
    element_position = (1 - x * d) * v + ca.cross(c * theta, v) + d * ca.dot(theta, v) * theta
    return rotation @ element_rotation, position + rotation @ element_position


def advance_with_tangent(
    rotation: ca.SX,
    position: ca.SX,
    h: ca.SX,
    moments: ca.SX,
    rule: str,
    exponential: str,
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
    theta, v, d_theta, d_v = _strain_with_derivatives(rule)(h, moments)
    x = ca.sumsqr(theta)
    tangent = _tangent_coefficients(x, exponential, degree)
    left = rotation @ _combination(tangent.c1, tangent.c2, tangent.c3 * theta, theta)  # R J_l
    end = position + left @ v
    shift = rotation @ so3.left_jacobian_product_derivative(theta, v, tangent)
    shift += so3.hat(end) @ left
    return rotation + left @ so3.hat(theta), end, left @ d_theta, shift @ d_theta + left @ d_v


def strain_force(
    h: ca.SX, moments: ca.SX, wrench: ca.SX, rule: str, exponential: str, degree: int
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
    theta, v, d_theta, d_v = _strain_with_derivatives(rule)(h, moments)
    coefficients = _tangent_coefficients(ca.sumsqr(theta), exponential, degree)
    by_theta, by_v = _work_on_strain(theta, v, coefficients, wrench)
    return d_theta.T @ by_theta + d_v.T @ by_v


def strain_force_with_derivatives(
    h: ca.SX, moments: ca.SX, wrench: ca.SX, rule: str, exponential: str, degree: int
) -> tuple[ca.SX, ca.SX, ca.SX]:
    """`strain_force` τ, ∂τ/∂w (1 + 3 m, 6) and ∂τ/∂(h, M) (1 + 3 m, 1 + 3 m).

    The coefficient functions are differentiated in closed form, the rest by AD of this element.
    """
    theta, v, d_theta, d_v = _strain_with_derivatives(rule)(h, moments)
    coefficients = _tangent_coefficients(ca.sumsqr(theta), exponential, degree)
    work, by_theta, by_v, by_coefficients, by_wrench = _work_derivatives()(
        theta, v, ca.vertcat(*coefficients), wrench
    )
    by_theta += 2 * (by_coefficients[:, :5] @ ca.vertcat(*series.slopes(coefficients))) @ theta.T
    d_strain = ca.vertcat(d_theta, d_v)
    by_interval = d_strain.T @ (by_theta @ d_theta + by_v @ d_v)
    by_interval += _strain_curvature(rule)(h, moments, work)
    return d_strain.T @ work, d_strain.T @ by_wrench, by_interval


def _work_on_strain(
    theta: ca.SX, v: ca.SX, coefficients: series.Coefficients[ca.SX], wrench: ca.SX
) -> Strain:
    """Virtual work of a local wrench on θ and on v: see `strain_force`."""
    c1, c2, c3, c4, c5, *_ = coefficients
    moment, force = wrench[:3], wrench[3:]

    def transposed(x: ca.SX) -> ca.SX:
        return c1 * x - ca.cross(c2 * theta, x) + c3 * ca.dot(theta, x) * theta

    along = ca.dot(theta, v)
    end = c1 * v + ca.cross(c2 * theta, v) + c3 * along * theta
    w = ca.cross(theta, v)
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


@cache
def _strain_curvature(name: str) -> ca.Function:
    """(h, moments, work) -> Σ_k work_k ∂²ξ_k/∂(h, M)²."""
    h, moments = ca.SX.sym("h"), ca.SX.sym("moments", 3, len(RULES[name].weights))
    work, inputs = ca.SX.sym("work", 6), ca.veccat(h, moments)
    _, _, d_theta, d_v = _strain_with_derivatives(name)(h, moments)
    along = ca.vertcat(d_theta, d_v).T @ work
    return ca.Function("strain_curvature", [h, moments, work], [ca.jacobian(along, inputs)])


@cache
def _strain_with_derivatives(name: str) -> ca.Function:
    """(h, moments) -> θ, v and their derivatives, (3, 1 + 3 m), with respect to (h, M_1 … M_m)."""
    rule = RULES[name]
    h, moments = ca.SX.sym("h"), ca.SX.sym("moments", 3, len(rule.weights))
    strain = rule.strain(h, moments)
    inputs = ca.veccat(h, moments)
    derivatives = [ca.jacobian(part, inputs) for part in strain]
    return ca.Function("strain", [h, moments], [*strain, *derivatives])


def _tangent_coefficients(x: ca.SX, exponential: str, degree: int) -> series.Coefficients[ca.SX]:
    if exponential not in ON_GROUP:
        raise ValueError(
            f"Grid.exponential: twists and Jacobians need {' or '.join(ON_GROUP)}, "
            f"found {exponential!r}, which leaves SO(3)"
        )
    closed = exponential == "rodrigues"
    return _closed_coefficients(x, degree) if closed else series.coefficients(x, degree)
