"""How a moving beam follows a change of its weights: fields along it, step by step.

A field is a twist per station and column, in inertial axes that coincide with the parent's at this
instant: S, the columns of the spatial Jacobian, and its rates S′, S″ along the motion. An element
adds L dM to S for a change dM of its moments, and L′ dM, L″ dM to the rates. Of a station with the
spatial inertia I, twist V and acceleration A (gravity taken off) the wrench is W = I A + V ×* I V,
and with W held in inertial axes it changes by

    weights:        I S″ + B S′ + S ×* W,      B X = X ×* I V + V ×* I X − I (V × X)
    rates:          2 I S′ + B S
    accelerations:  I S

Each is one `casadi.Function` built from SX, as the steps of `chain` are.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import casadi as ca

from curvcasadi.dynamics.element_motion import Jet, element_tangent, leibniz
from curvcasadi.dynamics.inertia import Inertia, Mask, masked, momentum, moved_to_parent
from curvcasadi.kinematics import chain, element
from curvcasadi.kinematics.chain import Pattern
from curvcasadi.kinematics.motion import unpack_motion
from curvcasadi.kinematics.state import StationMotion
from curvcasadi.lie import se3, so3
from curvcasadi.symbolic.expressions import AnyExpr


class Fields(NamedTuple):
    """S and its rates at a station, (6, columns) each."""

    columns: AnyExpr  #: S
    rates: AnyExpr  #: S′
    accelerations: AnyExpr  #: S″


class Wrenches(NamedTuple):
    """A wrench about the parent origin, parent axes, and its derivatives."""

    value: AnyExpr  #: (moment, force), (6, 1)
    by_weights: AnyExpr  #: (6, columns), with the wrench held in inertial axes
    by_rates: AnyExpr
    by_accelerations: AnyExpr


def cross_force(twists: AnyExpr, wrench: AnyExpr) -> AnyExpr:
    """X ×* W = (ω × m + v × f, ω × f), (6, columns): how a wrench changes that moves at X."""
    moment, force = so3.hat(wrench[:3]), so3.hat(wrench[3:])
    return -ca.vertcat(moment @ twists[:3, :] + force @ twists[3:, :], force @ twists[:3, :])


@lru_cache(maxsize=256)
def tangent_step(pattern: Pattern) -> ca.Function:
    """(q, q_dot, q_ddot, state, data) -> state, L, L′, L″, (6, moments) each.

    State: pose, spatial twist and acceleration. L are derivatives of the strain's exponential by
    the moments, with the position p⁺ of the end

        L = [R J_l dθ; (R M + [p⁺×] R J_l) dθ + R J_l dv],

    and its rates are those of an element whose start moves with the state.
    """
    symbols = chain.interval(pattern)
    rates = {name: ca.SX.sym(name, pattern.n) for name in ("q_dot", "q_ddot")}
    state = ca.SX.sym("state", 24)
    start, element = unpack_motion(state, 2), element_tangent(pattern, symbols, [*rates.values()])
    (theta, v), (d_theta, d_v) = element.strain, element.by_moments
    left, moving = _turned(start, element.turning), _turned(start, element.moving)
    rotation = start.rotation + left[0] @ so3.hat(theta[0])
    positions, twists, shift, tangents = [start.position + left[0] @ v[0]], [], [], []
    for k in range(3):
        levers = leibniz(ca.mtimes, [so3.hat(p) for p in positions], left[: k + 1])
        shift.append(moving[k] + levers[k])
        tangents.append(
            ca.vertcat(
                leibniz(ca.mtimes, left, d_theta)[k],
                leibniz(ca.mtimes, shift, d_theta[: k + 1])[k] + leibniz(ca.mtimes, left, d_v)[k],
            )
        )
        if k < 2:
            added = leibniz(ca.mtimes, left[: k + 1], theta[1 : k + 2])[k]
            moved = leibniz(ca.mtimes, shift, theta[1 : k + 2])[k]
            moved += leibniz(ca.mtimes, left[: k + 1], v[1 : k + 2])[k]
            twists.append((start.twist, start.acceleration)[k] + ca.vertcat(added, moved))
            turns = [twist[:3] for twist in twists]
            positions.append(twists[k][3:] + leibniz(ca.cross, turns, positions)[k])
    end = ca.veccat(rotation, positions[0], *twists)
    inputs = [symbols.q, *rates.values(), state, symbols.data]
    outputs = [end, *map(ca.densify, tangents)]
    return ca.Function("element_tangents", inputs, outputs, {"cse": True})


def _turned(start: StationMotion, jet: Jet) -> Jet:
    """R X of a matrix X in the axes of the start, with its rates in inertial axes."""
    omega, alpha = so3.hat(start.twist[:3]), so3.hat(start.acceleration[:3])
    value, rate, rate_dot = (start.rotation @ x for x in jet)
    turned = rate + omega @ value
    return [value, turned, rate_dot + omega @ (rate + turned) + alpha @ value]


@lru_cache(maxsize=256)
def field_step(pattern: Pattern, root: bool) -> ca.Function:
    """(S, L, data) -> S at the end of an element; with `root` six columns of the root go first."""
    symbols = chain.interval(pattern)
    columns = pattern.n + 6 * root
    before, tangent = ca.SX.sym("S", 6, columns), ca.SX.sym("L", 6, 3 * pattern.moments)
    after = before + tangent @ moments_by_columns(pattern, symbols, root)
    return ca.Function("element_field", [before, tangent, symbols.data], [after], {"cse": True})


def moments_by_columns(pattern: Pattern, symbols: chain.Interval, root: bool) -> ca.SX:
    """Derivatives of the moments of an element by the columns of a field."""
    directions = symbols.directions[1:, : pattern.n]
    return ca.horzcat(ca.SX(directions.shape[0], 6), directions) if root else directions


@lru_cache(maxsize=64)
def station_step(mask: Mask, columns: int) -> ca.Function:
    """(state, inertia, S, S′, S″, S′ of the rates, wrenches …) -> wrenches with the station's."""
    state, data = ca.SX.sym("state", 24), ca.SX.sym("inertia", sum(mask))
    fields = [ca.SX.sym(name, 6, columns) for name in ("S", "S1", "S2", "S1_rates")]
    outboard = [ca.SX.sym("W", 6), *(ca.SX.sym(f"dW{k}", 6, columns) for k in range(3))]
    at = unpack_motion(state, 2)
    inertia = moved_to_parent(masked(mask, data), at.rotation, at.position)
    momentum_ = momentum(inertia, at.twist)
    wrench = momentum(inertia, at.acceleration) + cross_force(at.twist, momentum_)
    gyroscopic = _gyroscopic(inertia, at.twist, momentum_)
    s, s1, s2, s1_rates = fields
    own = (
        wrench,
        momentum(inertia, s2) + gyroscopic @ s1[:3, :] + cross_force(s, wrench),
        2 * momentum(inertia, s1_rates) + gyroscopic @ s[:3, :],
        momentum(inertia, s),
    )
    return ca.Function(
        "station_inertia",
        [state, data, *fields, *outboard],
        [a + ca.densify(b) for a, b in zip(outboard, own, strict=True)],
        {"cse": True},
    )


@lru_cache(maxsize=64)
def inertia_slope(mask: Mask, columns: int, m: int) -> ca.Function:
    """(state, inertia, S, d inertia (…, m), d gravity (3, m)) -> Sᵀ ∂W, (columns, m)."""
    state, data = ca.SX.sym("state", 24), ca.SX.sym("inertia", sum(mask))
    field, d_data = ca.SX.sym("S", 6, columns), ca.SX.sym("d_inertia", sum(mask), m)
    d_gravity = ca.SX.sym("d_gravity", 3, m)
    at = unpack_motion(state, 2)
    inertia = moved_to_parent(masked(mask, data), at.rotation, at.position)
    wrench = momentum(inertia, at.acceleration)
    wrench += cross_force(at.twist, momentum(inertia, at.twist))
    change = ca.jacobian(wrench, data) @ d_data
    change -= momentum(inertia, ca.vertcat(ca.SX(3, m), d_gravity))
    inputs = [state, data, field, d_data, d_gravity]
    return ca.Function("inertia_by_data", inputs, [ca.densify(field.T @ change)], {"cse": True})


def _gyroscopic(inertia: Inertia, twist: ca.SX, momentum_of: ca.SX) -> ca.SX:
    """B of the angular part, (6, 3); of linear motions it vanishes."""
    angular = ca.vertcat(ca.SX.eye(3), ca.SX(3, 3))
    turned = ca.horzcat(*(cross_force(angular[:, k], momentum_of) for k in range(3)))
    carried = momentum(inertia, se3.small_adjoint(twist) @ angular)
    moved = -se3.small_adjoint(twist).T @ momentum(inertia, angular)
    return turned + moved - carried


@lru_cache(maxsize=64)
def inward_step(pattern: Pattern, root: bool) -> ca.Function:
    """(q, pose at the start, data, L, S at the start, wrenches …, sums …) -> sums.

    Sums are r (n, 1), its derivatives by weights and rates, (n, columns), and of that by
    accelerations the columns of the root and the upper triangle, as one vector: see `mass_entries`.
    """
    symbols, n = chain.interval(pattern), pattern.n
    columns, rows = n + 6 * root, symbols.directions[1:, :n]
    pose, tangent = ca.SX.sym("pose", 12), ca.SX.sym("L", 6, 3 * pattern.moments)
    field, wrench = ca.SX.sym("S", 6, columns), ca.SX.sym("W", 6)
    slopes = [ca.SX.sym(f"dW{k}", 6, columns) for k in range(3)]
    entries = mass_entries(n, root)
    sums = [ca.SX.sym("r", n), *(ca.SX.sym(f"dr{k}", n, columns) for k in range(2))]
    sums.append(ca.SX.sym("M", len(entries)))
    rotation, position = pose[:9], pose[9:]
    rotation = ca.reshape(rotation, 3, 3)
    moment, force = wrench[:3] - ca.cross(position, wrench[3:]), wrench[3:]
    local = ca.vertcat(rotation.T @ moment, rotation.T @ force)
    _, _, bending = element.strain_force_with_derivatives(
        symbols.h, symbols.moments, local, pattern.rule, pattern.exponential, pattern.degree
    )
    by_columns = moments_by_columns(pattern, symbols, root)
    held = slopes[0] - cross_force(field, wrench)
    masses = tangent.T @ slopes[2]
    added = [
        rows.T @ (tangent.T @ wrench),
        rows.T @ (tangent.T @ held + bending[1:, 1:] @ by_columns),
        rows.T @ (tangent.T @ slopes[1]),
        ca.vertcat(*(ca.dot(rows[:, i], masses[:, j]) for i, j in entries)),
    ]
    return ca.Function(
        "element_sums",
        [symbols.q, pose, symbols.data, tangent, field, wrench, *slopes, *sums],
        [a + ca.densify(b) for a, b in zip(sums, added, strict=True)],
        {"cse": True},
    )


def mass_entries(n: int, root: bool) -> list[tuple[int, int]]:
    """(row, column) of what is summed of the derivatives by accelerations; weights are the rows."""
    of_root = [(i, j) for j in range(6 * root) for i in range(n)]
    return of_root + [(i, j + 6 * root) for j in range(n) for i in range(j + 1)]
