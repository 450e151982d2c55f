"""One element in motion, seen from its start: the pose of its end, and two rates of that pose.

With the strain ξ = (θ, v) and the left Jacobian J_l(θ) y = c_1 y + c_2 θ × y + c_3 (θ·y) θ the end
stands at (R_e, p_e) = (exp θ, J_l v), and turns at the rate w = J_l θ̇ in the start's axes. Rates
follow from Leibniz' rule and dc_k/dx = (k c_{k+2} − c_{k+1})/2, x = θ²: polynomials, right at zero.

Expressions are SX: a step is built once and called with any kind.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import comb
from typing import NamedTuple

import casadi as ca

from curvcasadi.kinematics import element
from curvcasadi.kinematics.chain import Interval, Pattern
from curvcasadi.lie import series

#: A value and its rates.
Jet = list[ca.SX]


class ElementMotion(NamedTuple):
    """The end of an element in the axes of its start."""

    rotation: ca.SX  #: R_e (3, 3), axes of the end to those of the start
    position: ca.SX  #: p_e (3, 1), m
    turning: Jet  #: w (3, 1) with dR_e/dt = [w×] R_e, and dw/dt
    moving: Jet  #: dp_e/dt (3, 1), and d²p_e/dt²


def element_motion(pattern: Pattern, interval: Interval, rates: Sequence[ca.SX]) -> ElementMotion:
    """Motion of an element whose weights have the `rates` q_dot and q_ddot, or fewer, (n, 1)."""
    theta, v = _strain_jets(pattern, interval, rates)
    # θ·θ̇ and θ × θ̇, each with its rate; in the latter θ̇ × θ̇ vanishes.
    along = _leibniz(ca.dot, theta, theta[1:])
    across = [ca.cross(theta[0], rate) for rate in theta[1:]]
    squared = [ca.sumsqr(theta[0]), *(2 * rate for rate in along)]
    c = element.tangent_coefficients(squared[0], pattern.exponential, pattern.degree)
    c1, c2, c3 = _coefficient_jets(c, squared)
    turning = _left_jacobian((c1, c2, c3), theta, theta[1:], along, across)
    moving = _left_jacobian(
        (c1, c2, c3), theta, v, _leibniz(ca.dot, theta, v), _leibniz(ca.cross, theta, v)
    )
    rotation = element.rotation_of(theta[0], c)
    return ElementMotion(rotation, moving[0], turning, moving[1:])


def _strain_jets(pattern: Pattern, interval: Interval, rates: Sequence[ca.SX]) -> tuple[Jet, Jet]:
    """Strain (θ, v) and its rates: derivatives of a polynomial of the moments in time."""
    t = ca.SX.sym("t")
    directions = interval.directions[1:, : pattern.n]
    moments, power = interval.moments, ca.SX(1)
    for k, rate in enumerate(rates, start=1):
        power = power * t / k
        moments = moments + power * ca.reshape(ca.densify(directions @ rate), 3, -1)
    jets = []
    for part in pattern.rule.strain(interval.h, moments):
        jet = [ca.SX(part)]
        for _ in rates:
            jet.append(ca.jacobian(jet[-1], t))
        jets.append(ca.substitute(jet, [t], [ca.SX(0)]))
    return jets[0], jets[1]


def _leibniz(product: Callable[[ca.SX, ca.SX], ca.SX], a: Jet, b: Jet) -> Jet:
    """A bilinear product and its rates."""
    return [
        sum((comb(k, i) * product(a[i], b[k - i]) for i in range(1, k + 1)), product(a[0], b[k]))
        for k in range(min(len(a), len(b)))
    ]


def _scaled(factor: ca.SX, value: ca.SX) -> ca.SX:
    return factor * value


def _coefficient_jets(c: series.Coefficients[ca.SX], squared: Jet) -> list[Jet]:
    """c_1, c_2, c_3 and their rates along x = `squared`, by first and second derivatives in x."""
    first = series.slopes(c)
    jets = []
    for k in (1, 2, 3):
        jet = [c[k - 1]]
        if len(squared) > 1:
            jet.append(first[k - 1] * squared[1])
        if len(squared) > 2:
            second = (k * first[k + 1] - first[k]) / 2
            jet.append(second * squared[1] ** 2 + first[k - 1] * squared[2])
        jets.append(jet)
    return jets


def _left_jacobian(coefficients: Sequence[Jet], theta: Jet, y: Jet, along: Jet, across: Jet) -> Jet:
    """J_l(θ) y and its rates, with θ·y `along` and θ × y `across`."""
    c1, c2, c3 = coefficients
    parallel = _leibniz(_scaled, _leibniz(_scaled, c3, along), theta)
    terms = zip(_leibniz(_scaled, c1, y), _leibniz(_scaled, c2, across), parallel, strict=True)
    return [a + b + c for a, b, c in terms]
