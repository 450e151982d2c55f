"""Jacobians along a beam, by sums over its elements.

The spatial Jacobian at a station (relative to the root, root axes, at the root) is the sum of the
contributions of all elements inboard of it:

    [A; B] = Σ_e Ad(T_e) J_l(ξ_e) dξ_e/dq,      body Jacobian J = Ad(T⁻¹) [A; B]

Its cost is linear in the number of elements. Nothing here depends on the beam's root.
"""

from __future__ import annotations

from functools import lru_cache
from typing import overload

import casadi as ca

from curvcasadi.beam.beam import Beam
from curvcasadi.beam.pose import unpack_pose
from curvcasadi.kinematics import chain, element
from curvcasadi.kinematics.chain import Interval, Pattern
from curvcasadi.kinematics.numeric import evaluated
from curvcasadi.kinematics.state import StateLayout
from curvcasadi.kinematics.weights import checked_weights
from curvcasadi.lie import so3
from curvcasadi.symbolic.expressions import (
    AnyExpr,
    Expr,
    Numbers,
    station,
)


@overload
def body_jacobian(beam: Beam, q: Expr, xi: float = 1.0) -> Expr: ...
@overload
def body_jacobian(beam: Beam, q: Numbers, xi: float = 1.0) -> ca.DM: ...
def body_jacobian(beam: Beam, q: AnyExpr, xi: float = 1.0) -> AnyExpr:
    """Body Jacobian of the station `xi`: twist = J(q) q_dot, relative to the root.

    Parameters
    ----------
    beam : Beam
        Beam whose Jacobian is asked for.
    q : SX, MX, DM or array, shape (n, 1)
        Curvature weights, rad/m.
    xi : float
        Station s/L in [0, 1], on or off the grid.

    Returns
    -------
    SX, MX or DM, shape (6, n)
        Angular rows (m) first, then linear ones (m²), in the local axes of the station.

    Raises
    ------
    ValueError
        As `shape_map`; and for an exponential that leaves SO(3), which has no twist.
    """
    at = station("xi", xi)

    def formula(q: AnyExpr) -> AnyExpr:
        (state,) = jacobian_states(chain.build(beam, (at,)), q)
        return body_jacobian_of(state)

    return evaluated(beam, f"body_jacobian {at!r}", formula, q=checked_weights(beam, q))


def jacobian_states(
    beam_chain: chain.Chain, q: AnyExpr, root: AnyExpr = chain.IDENTITY
) -> list[AnyExpr]:
    """States (vec R, p, vec A, vec B) at the stations of a chain, in the frame of the pose `root`.

    Without `root` they are relative to the root; with it in parent axes, about the parent origin.
    """
    pattern = beam_chain.pattern
    columns = pattern.n + pattern.n_parameters
    start = ca.vertcat(root, ca.DM.zeros(6 * columns))
    return beam_chain.march([_jacobian_step(pattern)], start, q)


def body_jacobian_of(state: AnyExpr) -> AnyExpr:
    """Body Jacobian (6, columns) of a state of `jacobian_states`."""
    rotation, position = unpack_pose(state)
    return to_body(rotation, position, *unpack_sums(state))


def unpack_sums(state: AnyExpr) -> tuple[AnyExpr, AnyExpr]:
    """Spatial Jacobian (A, B), (3, columns) each, of a state of `jacobian_states`."""
    sums: tuple[AnyExpr, AnyExpr] = StateLayout.of(state).unpack(state).sums[0]
    return sums


def to_body(rotation: AnyExpr, position: AnyExpr, angular: AnyExpr, linear: AnyExpr) -> AnyExpr:
    """Ad(T⁻¹) [angular; linear]: spatial to local axes, moved to the station."""
    at_station = linear - so3.hat(position) @ angular
    return ca.vertcat(rotation.T @ angular, rotation.T @ at_station)


def interval_tangent(pattern: Pattern, state: ca.SX, interval: Interval) -> tuple[ca.SX, ...]:
    """Pose at the end of an interval, and d[A; B]/d(h, M): see `element.advance_with_tangent`."""
    rotation, position = unpack_pose(state)
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
    state = StateLayout(columns=pattern.n + pattern.n_parameters).symbol()
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
