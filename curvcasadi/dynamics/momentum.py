"""Momenta of a moving beam, and how its kinetic energy depends on its shape.

With the twists V_k of the stations and their momenta h_k = I_k V_k,

    p = ∂T/∂q_dot = Σ_k S_kᵀ h_k,      ∂T/∂q = Σ_k S′_kᵀ h_k,

and the momentum of the whole beam about the parent's origin is Σ_k h_k. The sums run inward, in
local axes: an element with the work τ(M, w) of a wrench w on its moments adds τ of the momenta h
outboard to p, and to ∂T/∂q the rate of τ along the motion, with h held in inertial axes.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import casadi as ca

from curvcasadi.dynamics import recursion
from curvcasadi.dynamics.element_motion import element_motion
from curvcasadi.dynamics.inertia import Mask, masked, momentum
from curvcasadi.dynamics.system import System
from curvcasadi.kinematics import chain, element
from curvcasadi.kinematics.chain import Pattern
from curvcasadi.lie import se3
from curvcasadi.symbolic.expressions import AnyExpr


class Momenta(NamedTuple):
    """Momenta of a beam, and the derivative of its kinetic energy by the weights."""

    weights: AnyExpr  #: p = ∂T/∂q_dot, (n, 1)
    by_shape: AnyExpr  #: ∂T/∂q at fixed rates and twist of the parent, (n, 1)
    parent: AnyExpr  #: (angular, linear) momentum about the parent's origin, (6, 1), parent axes


def momenta(built: System, q: AnyExpr, q_dot: AnyExpr) -> Momenta:
    """Momenta by one pass outward and one inward."""
    beam_chain, (mask, inertias) = built.chain, built.inertias
    pattern, n = beam_chain.pattern, built.beam.basis.n
    twists = beam_chain.march([recursion.twist_step(pattern)], built.root_twist, q, q_dot)
    inward = _inward(pattern, mask)
    carried, weights, by_shape = ca.DM.zeros(6), ca.DM.zeros(n), ca.DM.zeros(n)
    for k in reversed(range(1, len(twists))):
        data = beam_chain.data[k - 1]
        carried, weights, by_shape = inward(
            q, q_dot, twists[k - 1], twists[k], inertias[k], data, carried, weights, by_shape
        )
    carried = carried + _station_momentum(mask)(twists[0], inertias[0])
    return Momenta(weights, by_shape, built.to_parent(carried))


@lru_cache(maxsize=256)
def _inward(pattern: Pattern, mask: Mask) -> ca.Function:
    """(q, q_dot, twists at both ends, inertia, data, h, p, ∂T/∂q) -> h, p, ∂T/∂q.

    h, (angular, linear), is the momentum outboard of the end in its axes, then of the start.
    """
    symbols, n = chain.interval(pattern), pattern.n
    rate, start, end = ca.SX.sym("q_dot", n), ca.SX.sym("start", 6), ca.SX.sym("end", 6)
    inertia, outboard = ca.SX.sym("inertia", sum(mask)), ca.SX.sym("h", 6)
    sums = ca.SX.sym("p", n), ca.SX.sym("dT", n)
    carried = outboard + momentum(masked(mask, inertia), end)
    motion = element_motion(pattern, symbols, [])
    linear = motion.rotation @ carried[3:]
    angular = motion.rotation @ carried[:3] + ca.cross(motion.position, linear)
    at_start = ca.vertcat(angular, linear)

    moments, wrench = ca.SX.sym("M", 3, pattern.moments), ca.SX.sym("w", 6)
    work = element.strain_force(
        symbols.h, moments, wrench, pattern.rule, pattern.exponential, pattern.degree
    )
    directions = symbols.directions[:, :n]
    rates = ca.vertcat(directions[1:, :] @ rate, se3.small_adjoint(start).T @ at_start)
    work_rate = ca.jtimes(work, ca.veccat(moments, wrench), rates)
    work, work_rate = ca.substitute(
        [work, work_rate], [moments, wrench], [symbols.moments, at_start]
    )
    return ca.Function(
        "element_momenta",
        [symbols.q, rate, start, end, inertia, symbols.data, outboard, *sums],
        [at_start, sums[0] + directions.T @ work, sums[1] + directions.T @ work_rate],
        {"cse": True},
    )


@lru_cache(maxsize=8)
def _station_momentum(mask: Mask) -> ca.Function:
    """(twist, inertia) -> I V."""
    twist, inertia = ca.SX.sym("twist", 6), ca.SX.sym("inertia", sum(mask))
    value = ca.densify(momentum(masked(mask, inertia), twist))
    return ca.Function("station_momentum", [twist, inertia], [value], {"cse": True})
