"""Twists, rates of Jacobians and accelerations along a beam in motion.

One march outward carries the pose, its twist and acceleration, and on demand the sums of the
spatial Jacobian (see `jacobian`) with their rates.
"""

from __future__ import annotations

from functools import lru_cache
from math import comb
from typing import Any, NamedTuple, overload

import casadi as ca
import numpy as np

from curvcasadi.beam.beam import Beam
from curvcasadi.kinematics import chain, element
from curvcasadi.kinematics.chain import Pattern
from curvcasadi.kinematics.jacobian import to_body
from curvcasadi.kinematics.numeric import evaluated
from curvcasadi.kinematics.rules import strain_with_derivatives
from curvcasadi.kinematics.state import StateLayout, StationMotion
from curvcasadi.kinematics.weights import checked_weights
from curvcasadi.lie import so3
from curvcasadi.symbolic.expressions import (
    AnyExpr,
    Expr,
    Numbers,
    expression,
    same_kind,
    station,
)


@overload
def body_jacobian_rate(beam: Beam, q: Expr, q_dot: Expr, xi: float = 1.0) -> Expr: ...
@overload
def body_jacobian_rate(beam: Beam, q: Numbers, q_dot: Numbers, xi: float = 1.0) -> ca.DM: ...
def body_jacobian_rate(beam: Beam, q: AnyExpr, q_dot: AnyExpr, xi: float = 1.0) -> AnyExpr:
    """Rate of the body Jacobian along rates of the weights.

    With V = [A; B] q_dot the spatial twist of the station:

        dJ/dt = Ad(T⁻¹) (d[A; B]/dt − ad(V) [A; B])

    Parameters
    ----------
    beam : Beam
        Beam whose Jacobian is asked for.
    q : SX, MX, DM or array, shape (n, 1)
        Curvature weights, rad/m.
    q_dot : SX, MX, DM or array, shape (n, 1)
        Rates of the weights, rad/(m s).
    xi : float
        Station s/L in [0, 1], on or off the grid.

    Returns
    -------
    SX, MX or DM, shape (6, n)
        Time derivative of `body_jacobian`, in the same axes.
    """
    q, q_dot = _weights_and_rate(beam, q, q_dot)
    at = station("xi", xi)

    def formula(**motion: AnyExpr) -> AnyExpr:
        beam_chain = chain.build(beam, (at,))
        (state,) = motion_states(beam_chain, Motion(**motion), order=1, jacobian=True)
        at_station = unpack_motion(state, order=1)
        (a, b), (a_rate, b_rate) = at_station.sums
        omega_hat = so3.hat(at_station.twist[:3])
        angular = a_rate - omega_hat @ a
        linear = b_rate - so3.hat(at_station.twist[3:]) @ a - omega_hat @ b
        return to_body(at_station.rotation, at_station.position, angular, linear)

    return evaluated(beam, f"body_jacobian_rate {at!r}", formula, q=q, q_dot=q_dot)


@overload
def body_twist(
    beam: Beam, q: Expr, q_dot: Expr, xi: float = 1.0, root_twist: Expr | None = None
) -> Expr: ...
@overload
def body_twist(
    beam: Beam, q: Numbers, q_dot: Numbers, xi: float = 1.0, root_twist: Numbers | None = None
) -> ca.DM: ...
def body_twist(
    beam: Beam,
    q: AnyExpr,
    q_dot: AnyExpr,
    xi: float = 1.0,
    root_twist: AnyExpr | None = None,
) -> AnyExpr:
    """Body twist (Ω, v) of a station.

    Parameters
    ----------
    beam : Beam
        Beam that moves.
    q : SX, MX, DM or array, shape (n, 1)
        Curvature weights, rad/m.
    q_dot : SX, MX, DM or array, shape (n, 1)
        Rates of the weights, rad/(m s).
    xi : float
        Station s/L in [0, 1], on or off the grid.
    root_twist : SX, MX, DM or array, shape (6, 1), optional
        The root's own body twist, root axes, the parent's motion included; without it the twist is
        relative to the root. With it the first three rows are what a rate gyro strapped to the
        station reads: Omega of Eq. 1 and the root's rate in local axes.

    Returns
    -------
    SX, MX or DM, shape (6, 1)
        Angular rate, rad/s, and velocity, m/s, in the local axes of the station.
    """
    q, q_dot = _weights_and_rate(beam, q, q_dot)
    at, arguments = station("xi", xi), {"q": q, "q_dot": q_dot}
    if root_twist is not None:
        arguments["root_twist"] = expression("root_twist", root_twist, (6, 1))
        same_kind(**arguments, **beam.design_symbols)

    def formula(**motion: AnyExpr) -> AnyExpr:
        (state,) = motion_states(chain.build(beam, (at,)), Motion(**motion), order=1)
        at_station = unpack_motion(state, order=1)
        twist = at_station.twist
        return to_body(at_station.rotation, at_station.position, twist[:3], twist[3:])

    return evaluated(beam, f"body_twist {at!r}", formula, **arguments)


class Motion(NamedTuple):
    """Weights and root in motion; what is None is at rest."""

    q: AnyExpr
    q_dot: AnyExpr = None
    q_ddot: AnyExpr = None
    root_twist: AnyExpr = None  #: (6, 1) body twist of the root, root axes
    root_twist_rate: AnyExpr = None  #: (6, 1), derivative of its components


def motion_states(
    beam_chain: chain.Chain, motion: Motion, order: int, jacobian: bool = False, span: int = 1
) -> list[AnyExpr]:
    """States at the stations of a chain: see `unpack_motion`.

    With V = T_t T⁻¹ the spatial twist, root motion included, J_s = [A; B] the spatial Jacobian, and
    rates taken along the motion in inertial axes, the Maurer–Cartan identity
    ∂_i J_j − ∂_j J_i = [J_i, J_j] makes rates of derivatives:

        body twist:    ∂/∂q = Ad(T⁻¹) dJ_s/dt,      ∂/∂q_dot = Ad(T⁻¹) J_s
        velocity and acceleration of a material point, with G = B + A × p:
                       ∂p_tt/∂q = G_tt,   ∂p_tt/∂q_dot = 2 G_t,   ∂p_tt/∂q_ddot = G

    Parameters
    ----------
    order : 0 for poses, 1 for twists, 2 for accelerations
    jacobian : whether the sums are marched, too, and their rates up to `order`
    span : most elements that a call with MX weights crosses, where the sums are marched
    """
    n, zero = beam_chain.pattern.n, ca.DM.zeros(6)
    root = (motion.root_twist, motion.root_twist_rate)[:order]
    start = [chain.IDENTITY, *(zero if value is None else value for value in root)]
    if jacobian:
        start.append(ca.DM.zeros(6 * n * (order + 1)))
    arguments = [motion.q]
    if order:
        arguments.append(ca.DM.zeros(n) if motion.q_dot is None else motion.q_dot)
    if order == 2 and motion.q_ddot is not None:
        arguments.append(motion.q_ddot)
    steps = [
        _motion_step(beam_chain.pattern, order, len(arguments) - 1, jacobian, count)
        for count in range(1, 1 + span)
    ]
    return beam_chain.march(steps, ca.densify(ca.vertcat(*start)), *arguments)


def unpack_motion(state: AnyExpr, order: int) -> StationMotion:
    """What a state of `motion_states` of `order` says."""
    return StateLayout.of(state, order).unpack(state)


def _weights_and_rate(beam: Beam, q: AnyExpr, q_dot: AnyExpr) -> tuple[AnyExpr, AnyExpr]:
    q = checked_weights(beam, q)
    q_dot = expression("q_dot", q_dot, (beam.basis.n, 1))
    same_kind(q=q, q_dot=q_dot, **beam.design_symbols)
    return q, q_dot


@lru_cache(maxsize=256)
def _motion_step(
    pattern: Pattern, order: int, rates: int, jacobian: bool, count: int = 1
) -> ca.Function:
    """(q, q_dot, q_ddot, state, data) -> state, with the first `rates` of the rates of q.

    Of one interval SX; of several, whose data are stacked, MX that calls the two parts of a step:
    generated C is shorter than with steps of one part, and keeps more results meanwhile.
    """
    n = pattern.n
    kind: Any = ca.SX if count == 1 else ca.MX
    arguments = {name: kind.sym(name, n) for name in ("q", "q_dot", "q_ddot")[: 1 + rates]}
    layout = StateLayout(order, n if jacobian else 0)
    state = layout.symbol(kind)
    data = kind.sym("data", count * sum(pattern.sizes))
    tangent, columns = _tangent_step(pattern, order, rates), _columns_step(pattern)
    start, *sums = ca.vertsplit(state, np.cumsum([0, *layout.parts]).tolist())
    before = [kind(6 * n, 1)] * (order + 1)
    for part in ca.vertsplit(data, sum(pattern.sizes)):
        start, *found = tangent(*arguments.values(), start, part, *(sums or before))
        factors, strains = found[: order + 1], found[order + 1 :]
        for k in range(len(sums)):
            for i in range(k + 1):
                sums[k] = columns(sums[k], comb(k, i) * factors[i], strains[k - i], part)
    name, end = "element_motion", kind(ca.vertcat(start, *sums))
    if count > 1:
        name += f"_{count}"
    return chain.step_function(name, arguments, state, data, end)


@lru_cache(maxsize=256)
def _tangent_step(pattern: Pattern, order: int, rates: int) -> ca.Function:
    """(q, q_dot, q_ddot, state without sums, data, sums) -> state without sums, then the factors
    (left, shift) and (dθ, dv) of `element.advance_with_factors`, each with its rates up to `order`.

    Sums are inputs that nothing depends on: so generated C finishes those of one element before it
    turns to the next, and keeps the factors of one element alone.

    Rates are derivatives along the motion of the element's own start pose and moments, as Taylor
    polynomials of the time: AD of one element, never of the chain.
    """
    symbols = chain.interval(pattern)
    directions = symbols.directions[1:, : pattern.n]
    weight_rates = {name: ca.SX.sym(name, pattern.n) for name in ("q_dot", "q_ddot")[:rates]}
    moment_rates = [directions @ rate for rate in weight_rates.values()]
    moment_rates += [ca.SX(directions.shape[0], 1)] * (order - rates)
    state = StateLayout(order).symbol()
    start = unpack_motion(state, order)

    t = ca.SX.sym("t")
    rotation, position, moments = taylor(start, symbols.moments, moment_rates, t)
    rotation, position, left, shift, d_theta, d_v = element.advance_with_factors(
        rotation, position, symbols.h, moments, pattern.rule, pattern.exponential, pattern.degree
    )
    factors, strains = [ca.horzcat(left, shift)], [ca.vertcat(d_theta, d_v)[:, 1:]]
    for series in (factors, strains):
        for _ in range(order):
            rate = ca.jacobian(ca.vec(ca.densify(series[-1])), t)
            series.append(ca.project(ca.reshape(rate, *series[0].shape), series[0].sparsity()))
    end, *found = ca.substitute([ca.veccat(rotation, position), *factors, *strains], [t], [0])
    factors, strains = found[: order + 1], found[order + 1 :]

    parts = [end]
    if order:
        moved = strains[0] @ moment_rates[0]
        parts.append(start.twist + _columns(factors[0], moved))
    if order == 2:
        moved_rate = strains[1] @ moment_rates[0] + strains[0] @ moment_rates[1]
        added = _columns(factors[1], moved) + _columns(factors[0], moved_rate)
        parts.append(start.acceleration + added)
    sums = [ca.SX.sym("sums", 6 * pattern.n) for _ in range(order + 1)]
    inputs = [symbols.q, *weight_rates.values(), state, symbols.data, *sums]
    outputs = [ca.vertcat(*parts), *factors, *strains]
    return ca.Function("element_tangent", inputs, outputs, {"cse": True})


@lru_cache(maxsize=256)
def _columns_step(pattern: Pattern) -> ca.Function:
    """(sums, (left, shift), (dθ, dv), data) -> sums (vec A, vec B) with those of an element."""
    symbols = chain.interval(pattern)
    _, _, d_theta, d_v = strain_with_derivatives(pattern.rule)(symbols.h, symbols.moments)
    strains = ca.SX.sym("strains", ca.vertcat(d_theta, d_v)[:, 1:].sparsity())
    sums, factors = ca.SX.sym("sums", 6 * pattern.n), ca.SX.sym("factors", 3, 6)
    added = _columns(factors, strains) @ symbols.directions[1:, : pattern.n]
    after = sums + ca.densify(ca.veccat(added[:3, :], added[3:, :]))
    inputs = [sums, factors, strains, symbols.data]
    return ca.Function("element_columns", inputs, [after], {"cse": True})


def _columns(factors: ca.SX, strains: ca.SX) -> ca.SX:
    """[left dθ; shift dθ + left dv]."""
    left, shift = factors[:, :3], factors[:, 3:]
    return ca.vertcat(left @ strains[:3, :], shift @ strains[:3, :] + left @ strains[3:, :])


def taylor(
    start: StationMotion, moments: ca.SX, moment_rates: list[ca.SX], t: ca.SX
) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Pose of a material frame and moments of its element after the time `t`."""
    rotation, position = start.rotation, start.position
    rates = [ca.reshape(rate, *moments.shape) for rate in moment_rates]
    if rates:
        omega, v = so3.hat(start.twist[:3]), start.twist[3:]
        turning, velocity = omega @ rotation, v + omega @ position
        rotation, position = rotation + t * turning, position + t * velocity
        moments = moments + t * rates[0]
    if len(rates) == 2:
        alpha = so3.hat(start.acceleration[:3])
        rotation += t**2 / 2 * (alpha @ start.rotation + omega @ turning)
        bent = start.acceleration[3:] + alpha @ start.position + omega @ velocity
        position += t**2 / 2 * bent
        moments += t**2 / 2 * rates[1]
    return rotation, position, moments
