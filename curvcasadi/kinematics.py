"""Twists and Jacobians along a beam, by sums over its elements.

The spatial Jacobian at a station (relative to the root, root axes, at the root) is the sum of the
contributions of all elements inboard of it:

    [A; B] = Σ_e Ad(T_e) J_l(ξ_e) dξ_e/dq,      body Jacobian J = Ad(T⁻¹) [A; B]

Its cost is linear in the number of elements. Nothing here depends on the beam's root.
"""

from __future__ import annotations

from functools import lru_cache

import casadi as ca
import numpy as np

from curvcasadi import chain, element
from curvcasadi.beam import Beam
from curvcasadi.chain import Interval, Pattern
from curvcasadi.expressions import AnyExpr, expression, same_kind, station
from curvcasadi.lie import so3


def body_jacobian(beam: Beam, q: AnyExpr, xi: float = 1.0) -> AnyExpr:
    """Body Jacobian of the station `xi`: twist = J(q) q_dot, relative to the root.

    Parameters
    ----------
    q : (n, 1) SX, MX, DM or numbers, rad/m
    xi : numeric station in [0, 1], on or off the grid

    Returns
    -------
    (6, n)
        Angular rows (m) first, then linear (m²), local axes of the station, at the station.

    Raises
    ------
    ValueError
        As `shape_map`; and for an exponential that leaves SO(3), which has no twist.
    """
    q = chain.checked_weights(beam, q)
    (state,) = jacobian_states(chain.build(beam, (station("xi", xi),)), q)
    return body_jacobian_of(state)


def body_jacobian_rate(beam: Beam, q: AnyExpr, q_dot: AnyExpr, xi: float = 1.0) -> AnyExpr:
    """Rate of the body Jacobian along `q_dot` (n, 1), rad/(m s): (6, n), axes of `body_jacobian`.

    With V = [A; B] q_dot the spatial twist of the station:

        dJ/dt = Ad(T⁻¹) (d[A; B]/dt − ad(V) [A; B])
    """
    q, q_dot = _weights_and_rate(beam, q, q_dot)
    beam_chain = chain.build(beam, (station("xi", xi),))
    n = beam.basis.n
    start = ca.vertcat(chain.IDENTITY, ca.DM.zeros(6 + 12 * n))
    (state,) = beam_chain.march(_rate_step(beam_chain.pattern), start, q, q_dot)
    rotation, position = chain.unpack_pose(state)
    omega, v = state[12:15], state[15:18]
    a, b, a_rate, b_rate = (
        ca.reshape(part, 3, n)
        for part in ca.vertsplit(state[18:], [0, 3 * n, 6 * n, 9 * n, 12 * n])
    )
    omega_hat = so3.hat(omega)
    angular = a_rate - omega_hat @ a
    linear = b_rate - so3.hat(v) @ a - omega_hat @ b
    return _to_body(rotation, position, angular, linear)


def body_twist(
    beam: Beam,
    q: AnyExpr,
    q_dot: AnyExpr,
    xi: float = 1.0,
    root_twist: AnyExpr | None = None,
) -> AnyExpr:
    """Body twist (Ω, v), (6, 1), of the station `xi`: rad/s and m/s, its local axes.

    Parameters
    ----------
    q, q_dot : (n, 1), rad/m and rad/(m s)
    root_twist : (6, 1), the root's own body twist, root axes, the parent's motion included; without
        it the twist is relative to the root. With it the first three rows are what a rate gyro
        strapped to the station reads, Omega of Eq. 1 and the root's rate in local axes.
    """
    q, q_dot = _weights_and_rate(beam, q, q_dot)
    beam_chain = chain.build(beam, (station("xi", xi),))
    start = ca.vertcat(chain.IDENTITY, ca.DM.zeros(6))
    (state,) = beam_chain.march(_twist_step(beam_chain.pattern), start, q, q_dot)
    rotation, position = chain.unpack_pose(state)
    twist = state[12:]
    if root_twist is not None:
        root_twist = expression("root_twist", root_twist, (6, 1))
        same_kind(q=q, q_dot=q_dot, root_twist=root_twist, **beam.design_symbols)
        twist = twist + root_twist
    return _to_body(rotation, position, twist[:3], twist[3:])


def jacobian_states(
    beam_chain: chain.Chain, q: AnyExpr, root: AnyExpr = chain.IDENTITY
) -> list[AnyExpr]:
    """States (vec R, p, vec A, vec B) at the stations of a chain, in the frame of the pose `root`.

    Without `root` they are relative to the root; with it in parent axes, about the parent origin.
    """
    pattern = beam_chain.pattern
    columns = pattern.n + pattern.n_parameters
    start = ca.vertcat(root, ca.DM.zeros(6 * columns))
    return beam_chain.march(_jacobian_step(pattern), start, q)


def body_jacobian_of(state: AnyExpr) -> AnyExpr:
    """Body Jacobian (6, columns) of a state of `jacobian_states`."""
    rotation, position = chain.unpack_pose(state)
    return _to_body(rotation, position, *unpack_sums(state))


def unpack_sums(state: AnyExpr) -> tuple[AnyExpr, AnyExpr]:
    """Spatial Jacobian (A, B), (3, columns) each, of a state of `jacobian_states`."""
    columns = (state.numel() - 12) // 6
    middle = 12 + 3 * columns
    return ca.reshape(state[12:middle], 3, columns), ca.reshape(state[middle:], 3, columns)


def _to_body(rotation: AnyExpr, position: AnyExpr, angular: AnyExpr, linear: AnyExpr) -> AnyExpr:
    """Ad(T⁻¹) [angular; linear]: spatial to local axes, moved to the station."""
    at_station = linear - so3.hat(position) @ angular
    return ca.vertcat(rotation.T @ angular, rotation.T @ at_station)


def _weights_and_rate(beam: Beam, q: AnyExpr, q_dot: AnyExpr) -> tuple[AnyExpr, AnyExpr]:
    q = chain.checked_weights(beam, q)
    q_dot = expression("q_dot", q_dot, (beam.basis.n, 1))
    same_kind(q=q, q_dot=q_dot, **beam.design_symbols)
    return q, q_dot


def interval_tangent(pattern: Pattern, state: ca.SX, interval: Interval) -> tuple[ca.SX, ...]:
    """Pose at the end of an interval, and d[A; B]/d(h, M): see `element.advance_with_tangent`."""
    rotation, position = chain.unpack_pose(state)
    return element.advance_with_tangent(
        rotation,
        position,
        interval.h,
        interval.moments,
        pattern.rule,
        pattern.exponential,
        pattern.degree,
    )


@lru_cache(maxsize=256)
def _jacobian_step(pattern: Pattern) -> ca.Function:
    """(q, state, data) -> state, state = (vec R, p, vec A, vec B)."""
    symbols = chain.interval(pattern)
    state = ca.SX.sym("state", 12 + 6 * (pattern.n + pattern.n_parameters))
    a, b = unpack_sums(state)
    rotation, position, angular, linear = interval_tangent(pattern, state, symbols)
    a, b = a + angular @ symbols.directions, b + linear @ symbols.directions
    return chain.step_function(
        "element_jacobian",
        {"q": symbols.q},
        state,
        symbols.data,
        ca.veccat(rotation, position, a, b),
    )


@lru_cache(maxsize=256)
def _twist_step(pattern: Pattern) -> ca.Function:
    """(q, q_dot, state, data) -> state, state = (vec R, p, Ω, v), the twist spatial."""
    symbols = chain.interval(pattern)
    q_dot, state = ca.SX.sym("q_dot", pattern.n), ca.SX.sym("state", 18)
    rotation, position, angular, linear = interval_tangent(pattern, state, symbols)
    rate = symbols.directions @ q_dot
    twist = state[12:] + ca.vertcat(angular @ rate, linear @ rate)
    return chain.step_function(
        "element_twist",
        {"q": symbols.q, "q_dot": q_dot},
        state,
        symbols.data,
        ca.veccat(rotation, position, twist),
    )


@lru_cache(maxsize=256)
def _rate_step(pattern: Pattern) -> ca.Function:
    """(q, q_dot, state, data) -> state, state = (vec R, p, Ω, v, vec A, vec B, vec A', vec B').

    The rate of an element's contribution is its derivative along the motion of the element's own
    start pose and moments: AD of one element, never of the chain.
    """
    n = pattern.n
    symbols = chain.interval(pattern)
    q_dot, state = ca.SX.sym("q_dot", n), ca.SX.sym("state", 18 + 12 * n)
    rotation, position, angular, linear = interval_tangent(pattern, state, symbols)
    contribution = ca.vertcat(angular, linear)

    local = (ca.SX.sym("R", 3, 3), ca.SX.sym("p", 3), ca.SX.sym("M", *symbols.moments.shape))
    r, p, m = local
    tangent = element.advance_with_tangent(
        r, p, symbols.h, m, pattern.rule, pattern.exponential, pattern.degree
    )
    omega, v = state[12:15], state[15:18]
    start_rotation, start_position = chain.unpack_pose(state)
    moment_rate = symbols.directions[1:, :] @ q_dot
    motion = ca.veccat(
        so3.hat(omega) @ start_rotation, v + ca.cross(omega, start_position), moment_rate
    )
    rate = ca.jtimes(ca.veccat(tangent[2], tangent[3]), ca.veccat(*local), motion)
    rate = ca.substitute(
        rate, ca.veccat(*local), ca.veccat(start_rotation, start_position, symbols.moments)
    )
    columns = angular.shape[1]
    angular_rate = ca.reshape(rate[: 3 * columns], 3, columns)
    linear_rate = ca.reshape(rate[3 * columns :], 3, columns)

    sums = ca.vertsplit(state[18:], np.arange(0, 12 * n + 1, 3 * n).tolist())
    added = (angular, linear, angular_rate, linear_rate)
    next_sums = [
        ca.reshape(total, 3, n) + block @ symbols.directions
        for total, block in zip(sums, added, strict=True)
    ]
    twist = state[12:18] + contribution @ symbols.directions @ q_dot
    return chain.step_function(
        "element_jacobian_rate",
        {"q": symbols.q, "q_dot": q_dot},
        state,
        symbols.data,
        ca.veccat(rotation, position, twist, *next_sums),
    )
