"""Rules: how the curvatures of an element make its strain.

A rule turns curvatures at its points into moments M_k = h Σ_i W_ki K_i, and the element length h
and its moments into one strain ξ = (θ, v), the 6-vector whose exponential is the element:
T ← T exp(ξ) integrates T' = T ξ^ with ξ = (K, e_x). Moments are linear in the curvature, so a
basis enters an element through its moments alone.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from math import sqrt

import casadi as ca

from curvcasadi.beam.grid import ElementRule, Grid, RuleName

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

RULES: dict[RuleName, ElementRule] = {
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


def rule_of(grid: Grid) -> ElementRule:
    """The rule of `grid`."""
    return RULES[grid.rule] if isinstance(grid.rule, str) else grid.rule


@cache
def strain_with_derivatives(rule: ElementRule) -> ca.Function:
    """(h, moments) -> θ, v and their derivatives, (3, 1 + 3 m), with respect to (h, M_1 … M_m)."""
    h, moments = ca.SX.sym("h"), ca.SX.sym("moments", 3, len(rule.weights))
    strain = rule.strain(h, moments)
    inputs = ca.veccat(h, moments)
    derivatives = [ca.jacobian(part, inputs) for part in strain]
    return ca.Function("strain", [h, moments], [*strain, *derivatives])


@cache
def strain_curvature(rule: ElementRule) -> ca.Function:
    """(h, moments, work) -> Σ_k work_k ∂²ξ_k/∂(h, M)²."""
    h, moments = ca.SX.sym("h"), ca.SX.sym("moments", 3, len(rule.weights))
    work, inputs = ca.SX.sym("work", 6), ca.veccat(h, moments)
    _, _, d_theta, d_v = strain_with_derivatives(rule)(h, moments)
    along = ca.vertcat(d_theta, d_v).T @ work
    return ca.Function("strain_curvature", [h, moments, work], [ca.jacobian(along, inputs)])
