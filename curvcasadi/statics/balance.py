"""Elastic and applied forces of a beam, their difference, and its derivatives.

In equilibrium r(q) = S q − Q(q) = 0, with S the stiffness of the weights and Q the virtual work of
the loads on them (`passes`).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, overload

import casadi as ca

from curvcasadi.beam.beam import Beam
from curvcasadi.kinematics import chain, jacobian as kinematics
from curvcasadi.loads.stations import (
    Load,
    couplings,
    loaded_mesh,
    station_loads,
)
from curvcasadi.statics import virtual_work
from curvcasadi.statics.energy import stiffness_matrix
from curvcasadi.statics.passes import motions_at_rest, passes
from curvcasadi.symbolic.expressions import (
    AnyExpr,
    Expr,
    Numbers,
    expression,
)


@overload
def generalized_force(
    beam: Beam, q: Expr, loads: Sequence[Load], attitude: AnyExpr | None = None
) -> Expr: ...
@overload
def generalized_force(
    beam: Beam, q: Numbers, loads: Sequence[Load], attitude: AnyExpr | None = None
) -> ca.DM: ...
def generalized_force(
    beam: Beam, q: AnyExpr, loads: Sequence[Load], attitude: AnyExpr | None = None
) -> AnyExpr:
    """Virtual work of loads on the weights.

    Parameters
    ----------
    beam : Beam
        Beam on which the loads act.
    q : SX, MX, DM or array, shape (n, 1)
        Curvature weights, rad/m.
    loads : sequence of loads
        Such as `Gravity` and `PointForce`; magnitudes may be symbols.
    attitude : SX, MX, DM or array, shape (3, 3), optional
        Rotation from parent to inertial axes, for dead loads and gravity; the identity unless
        given.

    Returns
    -------
    SX, MX or DM, shape (n, 1)
        Generalized force Q, N m².
    """
    q = expression("q", q, (beam.basis.n, 1))
    return passes(beam, q, loads, attitude, tangent=False).force


@overload
def equilibrium_residual(
    beam: Beam, q: Expr, loads: Sequence[Load], attitude: AnyExpr | None = None
) -> Expr: ...
@overload
def equilibrium_residual(
    beam: Beam, q: Numbers, loads: Sequence[Load], attitude: AnyExpr | None = None
) -> ca.DM: ...
def equilibrium_residual(
    beam: Beam, q: AnyExpr, loads: Sequence[Load], attitude: AnyExpr | None = None
) -> AnyExpr:
    """Elastic minus applied generalized force, r = S q − Q(q); zero in equilibrium.

    Parameters
    ----------
    beam : Beam
        With a section.
    q : SX, MX, DM or array, shape (n, 1)
        Curvature weights, rad/m.
    loads : sequence of loads
        As of `generalized_force`.
    attitude : SX, MX, DM or array, shape (3, 3), optional
        As of `generalized_force`.

    Returns
    -------
    SX, MX or DM, shape (n, 1)
        Residual, N m².
    """
    return stiffness_matrix(beam) @ q - generalized_force(beam, q, loads, attitude)


@overload
def equilibrium_tangent(
    beam: Beam, q: Expr, loads: Sequence[Load], attitude: AnyExpr | None = None
) -> tuple[Expr, Expr]: ...
@overload
def equilibrium_tangent(
    beam: Beam, q: Numbers, loads: Sequence[Load], attitude: AnyExpr | None = None
) -> tuple[ca.DM, ca.DM]: ...
def equilibrium_tangent(
    beam: Beam, q: AnyExpr, loads: Sequence[Load], attitude: AnyExpr | None = None
) -> tuple[AnyExpr, AnyExpr]:
    """Residual of the equilibrium and its structured derivative, by the same two passes.

    The derivative is unsymmetric where the loads have no potential: follower loads, and dead
    moments.

    Parameters
    ----------
    beam : Beam
        With a section.
    q : SX, MX, DM or array, shape (n, 1)
        Curvature weights, rad/m.
    loads : sequence of loads
        As of `generalized_force`.
    attitude : SX, MX, DM or array, shape (3, 3), optional
        As of `generalized_force`.

    Returns
    -------
    residual : SX, MX or DM, shape (n, 1)
        Residual r, N m².
    tangent : SX, MX or DM, shape (n, n)
        Derivative dr/dq, N m³.
    """
    balanced = balance(beam, q, loads, attitude, tangent=True)
    return balanced.residual, balanced.residual_slope


@overload
def root_wrench(
    beam: Beam, q: Expr, loads: Sequence[Load], attitude: AnyExpr | None = None
) -> Expr: ...
@overload
def root_wrench(
    beam: Beam, q: Numbers, loads: Sequence[Load], attitude: AnyExpr | None = None
) -> ca.DM: ...
def root_wrench(
    beam: Beam, q: AnyExpr, loads: Sequence[Load], attitude: AnyExpr | None = None
) -> AnyExpr:
    """Wrench (moment, force) that loads hand on to the root, Σ_k W_k.

    Parameters
    ----------
    beam : Beam
        Beam on which the loads act.
    q : SX, MX, DM or array, shape (n, 1)
        Curvature weights, rad/m.
    loads : sequence of loads
        As of `generalized_force`.
    attitude : SX, MX, DM or array, shape (3, 3), optional
        As of `generalized_force`.

    Returns
    -------
    SX, MX or DM, shape (6, 1)
        Moment, N m, about the parent origin and force, N, both in parent axes.
    """
    q = expression("q", q, (beam.basis.n, 1))
    return passes(beam, q, loads, attitude, tangent=False).wrench


class Balance(NamedTuple):
    """A loaded beam: its elastic and applied forces, and what it hands on to its root."""

    elastic: AnyExpr  #: S q (n, 1), N m²
    applied: AnyExpr  #: Q (n, 1), N m²
    wrench: AnyExpr  #: `root_wrench`, (6, 1)
    stiffness: AnyExpr  #: S (n, n)
    applied_slope: AnyExpr = None  #: dQ/dq (n, n)
    wrench_slope: AnyExpr = None  #: dW/dq (6, n)

    @property
    def residual(self) -> AnyExpr:
        """S q − Q (n, 1), N m²: zero in equilibrium."""
        return self.elastic - self.applied

    @property
    def residual_slope(self) -> AnyExpr:
        """dr/dq (n, n)."""
        return self.stiffness - self.applied_slope


def balance(
    beam: Beam,
    q: AnyExpr,
    loads: Sequence[Load],
    attitude: AnyExpr | None = None,
    *,
    tangent: bool = False,
) -> Balance:
    """Forces and root wrench by the same passes, with `tangent` also their derivatives."""
    q = expression("q", q, (beam.basis.n, 1))
    stiffness = stiffness_matrix(beam)
    passed = passes(beam, q, loads, attitude, tangent=tangent)
    return Balance(
        elastic=stiffness @ q,
        applied=passed.force,
        wrench=passed.wrench,
        stiffness=stiffness,
        applied_slope=passed.force_slope,
        wrench_slope=passed.wrench_slope,
    )


def parameter_slopes(
    beam: Beam,
    q: AnyExpr,
    loads: Sequence[Load],
    parameters: AnyExpr,
    attitude: AnyExpr | None = None,
) -> tuple[AnyExpr, AnyExpr]:
    """Derivatives of `balance` with respect to symbols in loads, attitude and stiffness.

        dr/dp = dS/dp q − Σ_k [A; B]_kᵀ ∂W_k/∂p,      dW/dp = Σ_k ∂W_k/∂p

    each ∂W_k/∂p by AD of one station.

    Parameters
    ----------
    parameters : (m, 1)

    Returns
    -------
    (n, m), (6, m)
    """
    q = expression("q", q, (beam.basis.n, 1))
    mesh = loaded_mesh(beam, loads)
    beam_chain = chain.build(beam, mesh.stations.tolist(), boundaries=mesh.stations)
    root = beam.root.packed
    states = kinematics.jacobian_states(beam_chain, q, root)
    n, m = beam.basis.n, parameters.numel()
    residual = ca.jacobian(stiffness_matrix(beam) @ q, parameters)
    wrench = ca.DM.zeros(6, m)
    acting = [
        (state, formula, data, ca.jacobian(data, parameters))
        for state, loads_here in zip(
            states, station_loads(beam, loads, mesh, attitude), strict=True
        )
        for formula, data in loads_here
    ]
    for coupled in couplings(beam, loads, mesh, attitude):
        motions = motions_at_rest(coupled, states)
        values = coupled.function(motions, coupled.data)
        _, by_data = coupled.tangent(motions, coupled.data)
        slopes = by_data @ ca.densify(ca.jacobian(coupled.data, parameters))
        together = zip(coupled.nodes, coupled.station_data(values), coupled.own, strict=True)
        for part, (node, data, own) in zip(coupled.of_stations(slopes), together, strict=True):
            slope = coupled.joined(part, ca.jacobian(own, parameters))
            acting.append((states[node], coupled.formula, data, slope))
    for state, formula, data, slope in acting:
        slope_of = virtual_work.wrench_by_data(formula, data.numel(), m, n)
        work, part = slope_of(state, data, ca.densify(slope))
        residual, wrench = residual - work, wrench + part
    return residual, wrench
