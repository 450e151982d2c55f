"""Inverse dynamics: which forces on the weights a motion needs, by one pass outward and one inward.

Outward, in the local axes of each station: the angular velocity ω, the angular acceleration α and
the acceleration a of the material point, gravity included as an acceleration −g of the root. With
the element's end at (R_e, p_e) in the axes of its start, turning at w,

    ω⁺ = R_eᵀ (ω + w)
    α⁺ = R_eᵀ (α + ẇ + ω × w)
    a⁺ = R_eᵀ (a + α × p_e + ω × (ω × p_e + 2 ṗ_e) + p̈_e)

Inward, the wrenches (moment, force) that the inertia of the stations needs, less those of the
loads, and their virtual work on each element. No pose is needed unless loads depend on it.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import casadi as ca

from curvcasadi.dynamics.element_motion import element_motion
from curvcasadi.dynamics.inertia import Inertia, Mask, masked
from curvcasadi.kinematics import chain, element
from curvcasadi.kinematics.chain import Pattern


class LocalMotion(NamedTuple):
    """Motion of a station in its local axes."""

    rate: ca.SX  #: ω (3, 1), rad/s
    rate_dot: ca.SX  #: α (3, 1), rad/s²
    acceleration: ca.SX  #: a − g (3, 1), m/s², what an accelerometer reads


@lru_cache(maxsize=256)
def outward(pattern: Pattern) -> ca.Function:
    """(q, q_dot, q_ddot, motion, data) -> motion, motion = (ω, α, a)."""
    symbols = chain.interval(pattern)
    rates = {name: ca.SX.sym(name, pattern.n) for name in ("q_dot", "q_ddot")}
    motion = ca.SX.sym("motion", 9)
    crossed = cross_element(pattern, symbols, [*rates.values()], motion)
    return chain.step_function(
        "element_outward", {"q": symbols.q, **rates}, motion, symbols.data, crossed
    )


def cross_element(
    pattern: Pattern, symbols: chain.Interval, rates: list[ca.SX], motion: ca.SX
) -> ca.SX:
    """Motion (9, 1) at the end of an element, from that at its start."""
    rate, rate_dot, acceleration = ca.vertsplit(motion, 3)
    end = element_motion(pattern, symbols, rates)
    (turning, turning_dot), (velocity, moving_dot) = end.turning, end.moving
    carried = ca.cross(rate, ca.cross(rate, end.position) + 2 * velocity)
    return ca.vertcat(
        end.rotation.T @ (rate + turning),
        end.rotation.T @ (rate_dot + turning_dot + ca.cross(rate, turning)),
        end.rotation.T @ (acceleration + ca.cross(rate_dot, end.position) + carried + moving_dot),
    )


@lru_cache(maxsize=256)
def twist_step(pattern: Pattern) -> ca.Function:
    """(q, q_dot, twist, data) -> twist: ω⁺ = R_eᵀ (ω + w), v⁺ = R_eᵀ (v + ω × p_e + ṗ_e)."""
    symbols = chain.interval(pattern)
    rate, twist = ca.SX.sym("q_dot", pattern.n), ca.SX.sym("twist", 6)
    end = element_motion(pattern, symbols, [rate])
    angular = twist[:3] + end.turning[0]
    linear = twist[3:] + ca.cross(twist[:3], end.position) + end.moving[0]
    crossed = ca.vertcat(end.rotation.T @ angular, end.rotation.T @ linear)
    return chain.step_function(
        "element_twist", {"q": symbols.q, "q_dot": rate}, twist, symbols.data, crossed
    )


@lru_cache(maxsize=256)
def inward(pattern: Pattern, mask: Mask) -> ca.Function:
    """(q, motion and inertia at the end, data, wrench, Q) -> wrench, Q.

    The wrench outboard of the end, in its axes, becomes the one outboard of the start, in the axes
    of the start; Q (n, 1) gains its work on the element.
    """
    symbols = chain.interval(pattern)
    motion, inertia = ca.SX.sym("motion", 9), ca.SX.sym("inertia", sum(mask))
    wrench, total = ca.SX.sym("wrench", 6), ca.SX.sym("Q", pattern.n)
    summed = wrench + inertial_wrench(masked(mask, inertia), *ca.vertsplit(motion, 3))
    end = element_motion(pattern, symbols, [])
    force = end.rotation @ summed[3:]
    moment = end.rotation @ summed[:3] + ca.cross(end.position, force)
    at_start = ca.vertcat(moment, force)
    work = element.strain_force(
        symbols.h,
        symbols.moments,
        at_start,
        pattern.rule,
        pattern.exponential,
        pattern.degree,
    )
    return ca.Function(
        "element_inward",
        [symbols.q, motion, inertia, symbols.data, wrench, total],
        [at_start, total + symbols.directions[:, : pattern.n].T @ work],
        {"cse": True},
    )


def inertial_wrench(inertia: Inertia, rate: ca.SX, rate_dot: ca.SX, acceleration: ca.SX) -> ca.SX:
    """Wrench (moment, force), (6, 1), that moves a station so; its local axes.

    force = m a + α × m c + ω × (ω × m c),      moment = J α + ω × J ω + m c × a
    """
    mass, first, second = inertia
    force = mass * acceleration + ca.cross(rate_dot, first) + ca.cross(rate, ca.cross(rate, first))
    moment = second @ rate_dot + ca.cross(rate, second @ rate) + ca.cross(first, acceleration)
    return ca.densify(ca.vertcat(moment, force))


@lru_cache(maxsize=8)
def at_station(mask: Mask) -> ca.Function:
    """(motion, inertia) -> `inertial_wrench` of a station."""
    motion, inertia = ca.SX.sym("motion", 9), ca.SX.sym("inertia", sum(mask))
    wrench = inertial_wrench(masked(mask, inertia), *ca.vertsplit(motion, 3))
    return ca.Function("station_inertia", [motion, inertia], [wrench], {"cse": True})
