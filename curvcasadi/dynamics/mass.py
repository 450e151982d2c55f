"""The mass matrix of the weights, and solutions with it."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from curvcasadi.beam.beam import Beam
from curvcasadi.beam.pose import unpack_pose
from curvcasadi.dynamics import system
from curvcasadi.dynamics.inertia import (
    SIZE,
    Mask,
    masked,
    momentum,
    moved_to_parent,
    pack,
    unpack,
)
from curvcasadi.kinematics import chain, jacobian as kinematics
from curvcasadi.kinematics.state import StateLayout
from curvcasadi.lie import so3
from curvcasadi.symbolic.expressions import AnyExpr, is_numeric


def mass_matrix(beam: Beam, q: AnyExpr, loads: Sequence[Any] = ()) -> AnyExpr:
    """Mass matrix M(q) = Σ_k J_kᵀ I_k J_k over the stations, J_k their body Jacobians.

    Parameters
    ----------
    beam : Beam
        With mass.
    q : SX, MX, DM or array, shape (n, 1)
        Weights, rad/m.
    loads : sequence of loads
        What `inverse_dynamics` is taken with: their stations divide the elements, on which the
        inertia is integrated. The loads themselves add nothing.

    Returns
    -------
    SX, MX or DM, shape (n, n)
        kg m⁴, symmetric; the kinetic energy of a beam with a clamped root is ½ q_dotᵀ M q_dot.

    Raises
    ------
    ValueError
        As `inverse_dynamics`.
    """
    states = system.weights(beam, q=q)
    built = system.build(beam, loads, None, states)
    return unpack_symmetric(packed_mass_matrix(built, states["q"]), beam.basis.n)


def packed_mass_matrix(built: system.System, q: AnyExpr) -> AnyExpr:
    """Upper triangle of the mass matrix by columns, (n (n + 1)/2, 1)."""
    n, (mask, inertias) = built.beam.basis.n, built.inertias
    total = ca.DM.zeros(n * (n + 1) // 2)
    add = _station_mass(n, mask)
    states = kinematics.jacobian_states(built.chain, q)
    for state, inertia in zip(states[1:], inertias[1:], strict=True):  # the root stands still
        total = add(state, inertia, total)
    return total


def check_invertible(built: system.System) -> None:
    """Refuse a beam whose masses are fewer than its weights: its mass matrix is singular.

    A station outboard of the root moves in as many directions as its inertia has rank.
    """
    n, (mask, inertias) = built.beam.basis.n, built.inertias
    if not all(is_numeric(data) for data in inertias):
        return
    kept = np.flatnonzero(mask)
    rank = 0
    for data in inertias[1:]:
        numbers = np.zeros(SIZE)
        numbers[kept] = data.full().ravel()
        rank += int(np.linalg.matrix_rank(momentum(unpack(ca.DM(numbers)), ca.DM.eye(6)).full()))
    if rank < n:
        raise ValueError(
            f"Beam: expected mass that resists each of the {n} weights, found masses that resist "
            f"{rank} motions; give Section.mass_per_length"
        )


def unpack_symmetric(triangle: AnyExpr, n: int) -> AnyExpr:
    """The symmetric matrix (n, n) whose upper triangle is packed by columns."""
    order = np.zeros((n, n), dtype=int)
    order.T[np.tril_indices(n)] = range(n * (n + 1) // 2)
    entries = np.maximum(order, order.T).ravel(order="F").tolist()
    return ca.reshape(triangle[entries], n, n)


@lru_cache(maxsize=64)
def _station_mass(n: int, mask: Mask) -> ca.Function:
    """(state with sums, inertia, triangle) -> triangle with Jᵀ I J of the station.

    J = (Rᵀ A, Rᵀ (B − p × A)); in parent axes unless the inertia needs local ones.
    """
    state, inertia = StateLayout(columns=n).symbol(), ca.SX.sym("inertia", sum(mask))
    triangle = ca.SX.sym("triangle", n * (n + 1) // 2)
    rotation, position = chain.unpack_pose(state)
    angular, linear = kinematics.unpack_sums(state)
    linear = linear - so3.hat(position) @ angular
    if any(mask[1:]):
        angular = rotation.T @ angular
    if any(mask[1:4]):
        linear = rotation.T @ linear
    moving = momentum(masked(mask, inertia), ca.vertcat(angular, linear))
    if not any(mask[1:]):
        angular = ca.SX(3, n)
    added = [
        ca.dot(angular[:, i], moving[:3, j]) + ca.dot(linear[:, i], moving[3:, j])
        for j in range(n)
        for i in range(j + 1)
    ]
    return ca.Function(
        "station_mass", [state, inertia, triangle], [triangle + ca.vertcat(*added)], {"cse": True}
    )


class Blocks(NamedTuple):
    """Mass matrix of a beam whose parent moves: [[I, C], [Cᵀ, M]]."""

    parent: AnyExpr  #: I (6, 6), inertia about the parent's origin, parent axes
    coupling: AnyExpr  #: C (6, n)
    weights: AnyExpr  #: M (n, n)


def mass_blocks(built: system.System, q: AnyExpr) -> Blocks:
    """I = Σ_k I_k, C = Σ_k I_k S_k and M over all stations, the root's included."""
    n, (mask, inertias) = built.beam.basis.n, built.inertias
    triangle, whole, coupling = ca.DM.zeros(n * (n + 1) // 2), ca.DM.zeros(SIZE), ca.DM.zeros(6, n)
    states = kinematics.jacobian_states(built.chain, q, built.beam.root.packed)
    add, add_blocks = _station_mass(n, mask), _station_blocks(n, mask)
    for state, inertia in zip(states, inertias, strict=True):
        triangle = add(state, inertia, triangle)
        whole, coupling = add_blocks(state, inertia, whole, coupling)
    parent = momentum(unpack(whole), ca.DM.eye(6))
    return Blocks(parent, coupling, unpack_symmetric(triangle, n))


@lru_cache(maxsize=64)
def _station_blocks(n: int, mask: Mask) -> ca.Function:
    """(state with sums, inertia, ten numbers, C) -> ten numbers and C with those of the station."""
    state, inertia = ca.SX.sym("state", 12 + 6 * n), ca.SX.sym("inertia", sum(mask))
    whole, coupling = ca.SX.sym("whole", SIZE), ca.SX.sym("C", 6, n)
    moved = moved_to_parent(masked(mask, inertia), *unpack_pose(state))
    columns = ca.vertcat(*kinematics.unpack_sums(state))
    outputs = [whole + pack(moved), coupling + momentum(moved, columns)]
    return ca.Function("station_blocks", [state, inertia, whole, coupling], outputs, {"cse": True})
