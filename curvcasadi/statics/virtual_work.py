"""The two passes of statics, step by step: wrenches of a station, and their work on an element.

Each is one `casadi.Function` built from SX, as the steps of `chain` are.
"""

from __future__ import annotations

from functools import lru_cache

import casadi as ca

from curvcasadi.beam.pose import unpack_pose
from curvcasadi.kinematics import chain, element, jacobian as kinematics
from curvcasadi.kinematics.chain import Pattern
from curvcasadi.kinematics.state import StateLayout
from curvcasadi.lie import so3
from curvcasadi.loads.formulas import Formula


@lru_cache(maxsize=256)
def station_wrench(
    formula: Formula, size: int, columns: int | None, moving: tuple[int, ...] = ()
) -> ca.Function:
    """(state, data) -> wrench; given `columns` of sums in the state, its derivatives, too.

    A motion [A; B] of the station turns R by [A×] and moves p by B + A × p. Of the
    data at the rows `moving` the derivatives (rows, columns) are a third input.
    """
    state = StateLayout(columns=columns or 0).symbol()
    data = ca.SX.sym("data", size)
    rotation, position = unpack_pose(state)
    wrench = formula(rotation, position, data)
    if columns is None:
        return ca.Function("station_wrench", [state, data], [wrench], {"cse": True})
    slope = ca.jacobian(wrench, state[:12]) @ _pose_slope(state)
    inputs = [state, data]
    if moving:
        d_data = ca.SX.sym("d_data", len(moving), columns)
        slope += ca.jacobian(wrench, data)[:, list(moving)] @ d_data
        inputs.append(d_data)
    return ca.Function("station_wrench_tangent", inputs, [wrench, slope], {"cse": True})


def _pose_slope(state: ca.SX) -> ca.SX:
    """Derivatives (12, columns) of the pose of a state with sums."""
    rotation, position = unpack_pose(state)
    a, b = kinematics.unpack_sums(state)
    turned = ca.vertcat(*(-so3.hat(rotation[:, k]) @ a for k in range(3)))
    slope: ca.SX = ca.vertcat(turned, b - so3.hat(position) @ a)
    return slope


@lru_cache(maxsize=256)
def wrench_by_data(formula: Formula, size: int, m: int, n: int) -> ca.Function:
    """(state with sums, data, d data (size, m)) -> [A; B]ᵀ ∂W (n, m), ∂W (6, m)."""
    state, data = StateLayout(columns=n).symbol(), ca.SX.sym("data", size)
    d_data = ca.SX.sym("d_data", size, m)
    wrench = formula(*unpack_pose(state), data)
    slope = ca.densify(ca.jacobian(wrench, data)) @ d_data
    work = ca.vertcat(*kinematics.unpack_sums(state)).T @ slope
    return ca.Function("wrench_by_data", [state, data, d_data], [work, slope], {"cse": True})


@lru_cache(maxsize=64)
def inward(pattern: Pattern) -> ca.Function:
    """(q, state at the start, data, outboard wrench, Q) -> Q of this element and all outboard."""
    symbols = chain.interval(pattern)
    state, wrench, total = (ca.SX.sym(*s) for s in (("state", 12), ("wrench", 6), ("Q", pattern.n)))
    by_moments = element.strain_force(
        symbols.h,
        symbols.moments,
        _to_local(state, wrench),
        pattern.rule,
        pattern.exponential,
        pattern.degree,
    )
    return ca.Function(
        "element_force",
        [symbols.q, state, symbols.data, wrench, total],
        [total + symbols.directions[:, : pattern.n].T @ by_moments],
        {"cse": True},
    )


@lru_cache(maxsize=64)
def inward_tangent(pattern: Pattern) -> ca.Function:
    """(q, state with sums, data, wrench, d wrench, Q, dQ) -> Q, dQ.

    With V = [A; B] at the element's start T, the outboard wrench W, and τ(h, M; w) the element's
    `strain_force` of the local wrench w = Ad(T)ᵀ W, linear in w:

        dτ = (∂τ/∂w) Ad(T)ᵀ (dW + C(W) V) + (∂τ/∂(h, M)) d(h, M),      C(W) V = ad(V)ᵀ W

    the partial derivatives by AD of one element.
    """
    n = pattern.n
    symbols = chain.interval(pattern)
    state = StateLayout(columns=n).symbol()
    wrench, d_wrench = ca.SX.sym("wrench", 6), ca.SX.sym("d_wrench", 6, n)
    total, slope = ca.SX.sym("Q", n), ca.SX.sym("dQ", n, n)
    directions = symbols.directions[:, :n]
    angular, linear = kinematics.unpack_sums(state)
    moment, force = so3.hat(wrench[:3]), so3.hat(wrench[3:])
    carried = ca.vertcat(moment @ angular + force @ linear, force @ angular)
    by_moments, by_wrench, by_interval = element.strain_force_with_derivatives(
        symbols.h,
        symbols.moments,
        _to_local(state, wrench),
        pattern.rule,
        pattern.exponential,
        pattern.degree,
    )
    d_by_moments = by_wrench @ _to_local(state, d_wrench + carried) + by_interval @ directions
    return ca.Function(
        "element_force_tangent",
        [symbols.q, state, symbols.data, wrench, d_wrench, total, slope],
        [total + directions.T @ by_moments, slope + directions.T @ d_by_moments],
        {"cse": True},
    )


def _to_local(state: ca.SX, wrench: ca.SX) -> ca.SX:
    """Ad(T)ᵀ W: wrenches (6, columns) about the parent origin, to the axes and origin of T."""
    rotation, position = unpack_pose(state)
    moment, force = wrench[:3, :], wrench[3:, :]
    at_station = moment - so3.hat(position) @ force
    return ca.vertcat(rotation.T @ at_station, rotation.T @ force)
