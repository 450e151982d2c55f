"""One element in motion, seen from its start: the pose of its end, and two rates of that pose.

With the strain ξ = (θ, v) and the left Jacobian J_l(θ) y = c_1 y + c_2 θ × y + c_3 (θ·y) θ the end
stands at (R_e, p_e) = (exp θ, J_l v), and turns at the rate w = J_l θ̇ in the start's axes. Rates
follow from Leibniz' rule and dc_k/dx = (k c_{k+2} − c_{k+1})/2, x = θ²: polynomials, right at zero.
A change of θ moves the end by

    M = d(J_l v)/dθ = u θᵀ − c_2 [v×] + c_3 (θ vᵀ + (θ·v) I),
    u = 2 (dc_1/dx v + dc_2/dx θ × v + dc_3/dx (θ·v) θ)

Expressions are SX: a step is built once and called with any kind.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import comb
from typing import NamedTuple

import casadi as ca

from curvcasadi.kinematics import element
from curvcasadi.kinematics.chain import Interval, Pattern
from curvcasadi.kinematics.rules import strain_with_derivatives
from curvcasadi.lie import series, so3

#: A value and its rates.
Jet = list[ca.SX]


class ElementMotion(NamedTuple):
    """The end of an element in the axes of its start."""

    rotation: ca.SX  #: R_e (3, 3), axes of the end to those of the start
    position: ca.SX  #: p_e (3, 1), m
    turning: Jet  #: w (3, 1) with dR_e/dt = [w×] R_e, and dw/dt
    moving: Jet  #: dp_e/dt (3, 1), and d²p_e/dt²


class ElementTangent(NamedTuple):
    """How the end of an element follows its strain, in the axes of its start, with two rates."""

    strain: tuple[Jet, Jet]  #: θ and v, (3, 1) each
    by_moments: tuple[Jet, Jet]  #: dθ and dv, (3, moments) each
    turning: Jet  #: J_l (3, 3)
    moving: Jet  #: M (3, 3)


def element_tangent(pattern: Pattern, interval: Interval, rates: Sequence[ca.SX]) -> ElementTangent:
    """Tangent of an element whose weights have the `rates` q_dot and q_ddot, (n, 1)."""
    theta, v, d_theta, d_v = _strain_jets(pattern, interval, rates, slopes=True)
    along, across = leibniz(ca.dot, theta, v), leibniz(ca.cross, theta, v)
    squared = leibniz(ca.dot, theta, theta)
    c1, c2, c3 = _coefficient_jets(pattern, squared)
    symmetric = leibniz(_scaled, c3, leibniz(_outer, theta, theta))
    turning = _sum(
        [c * ca.DM.eye(3) for c in c1],
        leibniz(_scaled, c2, [so3.hat(x) for x in theta]),
        [ca.triu2symm(ca.triu(x)) for x in symmetric],
    )
    slopes = _coefficient_jets(pattern, squared, order=1)
    directions = (v, across, leibniz(_scaled, along, theta))
    u = _sum(*(leibniz(_scaled, c, x) for c, x in zip(slopes, directions, strict=True)))
    moving = _sum(
        leibniz(_outer, [2 * x for x in u], theta),
        leibniz(_scaled, c2, [-so3.hat(x) for x in v]),
        leibniz(_outer, leibniz(_scaled, c3, theta), v),
        [c * ca.DM.eye(3) for c in leibniz(_scaled, c3, along)],
    )
    return ElementTangent((theta, v), (d_theta, d_v), turning, moving)


def element_motion(pattern: Pattern, interval: Interval, rates: Sequence[ca.SX]) -> ElementMotion:
    """Motion of an element whose weights have the `rates` q_dot and q_ddot, or fewer, (n, 1)."""
    theta, v = _strain_jets(pattern, interval, rates)
    # θ·θ̇ and θ × θ̇, each with its rate; in the latter θ̇ × θ̇ vanishes.
    along = leibniz(ca.dot, theta, theta[1:])
    across = [ca.cross(theta[0], rate) for rate in theta[1:]]
    squared = [ca.sumsqr(theta[0]), *(2 * rate for rate in along)]
    c1, c2, c3 = _coefficient_jets(pattern, squared)
    turning = _left_jacobian((c1, c2, c3), theta, theta[1:], along, across)
    moving = _left_jacobian(
        (c1, c2, c3), theta, v, leibniz(ca.dot, theta, v), leibniz(ca.cross, theta, v)
    )
    rotation = element.rotation_of(theta[0], c1[0], c2[0])
    return ElementMotion(rotation, moving[0], turning, moving[1:])


def _strain_jets(
    pattern: Pattern, interval: Interval, rates: Sequence[ca.SX], *, slopes: bool = False
) -> list[Jet]:
    """Strain θ, v and its rates: derivatives of a polynomial of the moments in time.

    With `slopes` also of the derivatives dθ, dv by the moments.
    """
    t = ca.SX.sym("t")
    directions = interval.directions[1:, : pattern.n]
    moments, power = interval.moments, ca.SX(1)
    for k, rate in enumerate(rates, start=1):
        power = power * t / k
        moments = moments + power * ca.reshape(ca.densify(directions @ rate), 3, -1)
    parts = [*pattern.rule.strain(interval.h, moments)]
    if slopes:
        *parts, d_theta, d_v = strain_with_derivatives(pattern.rule)(interval.h, moments)
        parts += [d_theta[:, 1:], d_v[:, 1:]]
    jets = []
    for part in parts:
        jet = [ca.SX(part)]
        for _ in rates:
            jet.append(ca.reshape(ca.jacobian(ca.vec(jet[-1]), t), *part.shape))
        jets.append(ca.substitute(jet, [t], [ca.SX(0)]))
    return jets


def leibniz(product: Callable[[ca.SX, ca.SX], ca.SX], a: Jet, b: Jet) -> Jet:
    """A bilinear product and its rates."""
    return [
        sum((product(comb(k, i) * a[i], b[k - i]) for i in range(1, k + 1)), product(a[0], b[k]))
        for k in range(min(len(a), len(b)))
    ]


def _scaled(factor: ca.SX, value: ca.SX) -> ca.SX:
    return factor * value


def _outer(a: ca.SX, b: ca.SX) -> ca.SX:
    return a @ b.T


def _sum(*jets: Jet) -> Jet:
    return [sum(parts[1:], parts[0]) for parts in zip(*jets, strict=True)]


def _coefficient_jets(pattern: Pattern, squared: Jet, order: int = 0) -> list[Jet]:
    """c_1, c_2, c_3, or their derivatives in x of an `order`, with their rates along `squared`."""
    x, needed = squared[0], order + len(squared)
    derivatives = [[*element.tangent_coefficients(x, pattern.exponential, pattern.degree)]]
    if needed == 4:
        derivatives[0] += [series.c(k, x, max(pattern.degree - 3, 0)) for k in (8, 9)]
    while len(derivatives) < needed:
        c = derivatives[-1]
        derivatives.append([(k * c[k + 1] - c[k]) / 2 for k in range(1, len(c) - 1)])
    jets = []
    for value, *slopes in list(zip(*derivatives[order:needed], strict=False))[:3]:
        jet = [value, *(slopes[0] * rate for rate in squared[1:])]
        if len(squared) > 2:
            jet[2] += slopes[1] * squared[1] ** 2
        jets.append(jet)
    return jets


def _left_jacobian(coefficients: Sequence[Jet], theta: Jet, y: Jet, along: Jet, across: Jet) -> Jet:
    """J_l(θ) y and its rates, with θ·y `along` and θ × y `across`."""
    c1, c2, c3 = coefficients
    parallel = leibniz(_scaled, leibniz(_scaled, c3, along), theta)
    terms = zip(leibniz(_scaled, c1, y), leibniz(_scaled, c2, across), parallel, strict=True)
    return [a + b + c for a, b, c in terms]
