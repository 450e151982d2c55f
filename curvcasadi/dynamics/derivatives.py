"""Structured first derivatives of the inverse dynamics, by one pass outward and one inward.

The rows are those of the weights and, for a free root, of the wrench on the parent; the columns
those of the weights and, for a moving root, six of the parent. The parent's columns are a change of
its pose, T exp(φ^), of the components of its twist V, and of their rates: on the group they do not
commute, so that their rates are S′ = 0, S″ = −ad(0, g) of the pose and S′ = ½ ad(V) of the twist.
"""

from __future__ import annotations

from typing import NamedTuple

import casadi as ca

from curvcasadi.dynamics import fields
from curvcasadi.dynamics.applied import data_slope, wrench_with_slopes
from curvcasadi.dynamics.fields import Fields, Wrenches
from curvcasadi.dynamics.system import ParentMotion, System
from curvcasadi.lie import se3
from curvcasadi.statics.energy import stiffness_matrix
from curvcasadi.symbolic.expressions import AnyExpr, is_numeric


class Derivatives(NamedTuple):
    """Residual of a beam and its derivatives; where asked for, the parent's columns go first."""

    residual: AnyExpr  #: r (n, 1), N m²
    by_weights: AnyExpr  #: (n, columns)
    by_rates: AnyExpr  #: (n, columns)
    by_accelerations: AnyExpr  #: (n, columns): the mass matrix, and its coupling with the parent
    parent: Wrenches  #: wrench that the motion needs of the parent, parent axes, at its origin
    by_parameters: AnyExpr = None  #: (n, m), or with the parent's rows first (6 + n, m)


class Station(NamedTuple):
    state: AnyExpr  #: pose, spatial twist and acceleration, (24, 1)
    fields: Fields
    tangent: AnyExpr = None  #: L of the element inboard


def differentiate(
    system: System,
    q: AnyExpr,
    q_dot: AnyExpr,
    q_ddot: AnyExpr,
    *,
    root: bool = False,
    parameters: AnyExpr | None = None,
) -> Derivatives:
    """Residual of `inverse_dynamics` with its derivatives; with `root` also by the parent's motion.

    `parameters` (m, 1) are symbols in loads, stiffness and inertia, and in the parent's motion.
    """
    n = system.beam.basis.n
    driven = parameters is not None and any(_depends(x, parameters) for x in system.parent)
    if driven and not root:
        full = differentiate(system, q, q_dot, q_ddot, root=True, parameters=parameters)
        return _without_root(full)
    stations = _outward(system, q, q_dot, q_ddot, root)
    outboard = Wrenches(ca.DM.zeros(6), *[ca.DM.zeros(6, n + 6 * root)] * 3)
    sums = [ca.DM.zeros(n), *[ca.DM.zeros(n, n + 6 * root)] * 2]
    sums.append(ca.DM.zeros(len(fields.mass_entries(n, root))))
    inward = fields.inward_step(system.chain.pattern, root)
    for k in reversed(range(len(stations))):
        if k or root:
            outboard = _add_station(system, k, stations[k], outboard, root)
        if k:
            start, data = stations[k - 1], system.chain.data[k - 1]
            sums = inward(
                q,
                start.state[:12],
                data,
                stations[k].tangent,
                start.fields.columns,
                *outboard,
                *sums,
            )
    stiffness = stiffness_matrix(system.beam)
    elastic = ca.horzcat(ca.DM.zeros(n, 6), stiffness) if root else stiffness
    held = outboard.by_weights - fields.cross_force(stations[0].fields.columns, outboard.value)
    found = Derivatives(
        sums[0] + stiffness @ q,
        sums[1] + elastic,
        sums[2],
        _mass(sums[3], n, root),
        outboard._replace(by_weights=held),
    )
    if parameters is None:
        return found
    by_data = parameter_slopes(system, stations, q, parameters, root)
    if driven:
        by_data += _by_parent(found, system.parent, parameters)
    return found._replace(by_parameters=by_data)


def _outward(
    system: System, q: AnyExpr, q_dot: AnyExpr, q_ddot: AnyExpr, root: bool
) -> list[Station]:
    pattern, parent = system.chain.pattern, system.parent
    tangent, add = fields.tangent_step(pattern), fields.field_step(pattern, root)
    start = ca.vertcat(system.beam.root.packed, parent.twist, parent.acceleration)
    stations = [Station(ca.densify(start), _fields_of_root(system, root))]
    for data in system.chain.data:
        state, at_start = stations[-1].state, stations[-1].fields
        state, *tangents = tangent(q, q_dot, q_ddot, state, data)
        at_end = [add(field, part, data) for field, part in zip(at_start, tangents, strict=True)]
        stations.append(Station(state, Fields(*at_end), tangents[0]))
    return stations


def _fields_of_root(system: System, root: bool) -> Fields:
    n = system.beam.basis.n
    if not root:
        return Fields(*[ca.DM.zeros(6, n)] * 3)
    falling = -se3.small_adjoint(ca.vertcat(ca.DM.zeros(3), system.parent.gravity))
    rest = ca.DM.zeros(6, n)
    return Fields(
        ca.horzcat(ca.DM.eye(6), rest), ca.DM.zeros(6, n + 6), ca.densify(ca.horzcat(falling, rest))
    )


def _add_station(
    system: System, k: int, station: Station, outboard: Wrenches, root: bool
) -> Wrenches:
    """Wrenches outboard of a station with its own: what its inertia needs, less its loads."""
    mask, inertias = system.inertias
    n, at = system.beam.basis.n, station.fields
    of_rates = at.rates
    if root:
        bracket = se3.small_adjoint(system.parent.twist) / 2
        of_rates = of_rates + ca.densify(ca.horzcat(bracket, ca.DM.zeros(6, n)))
    step = fields.station_step(mask, n + 6 * root)
    total = Wrenches(*step(station.state, inertias[k], *at, of_rates, *outboard))
    for formula, data in system.loads[k]:
        slopes_of = wrench_with_slopes(formula, data.numel(), n + 6 * root)
        load = slopes_of(station.state, system.parent.gravity, data, *at, of_rates)
        total = Wrenches(*(a - b for a, b in zip(total, load, strict=True)))
    return total


def _mass(entries: AnyExpr, n: int, root: bool) -> AnyExpr:
    """Derivatives by accelerations (n, columns) from their `fields.mass_entries`."""
    places = {place: k for k, place in enumerate(fields.mass_entries(n, root))}
    first = 6 * root
    order = [
        places[(i, j)] if (i, j) in places else places[(j - first, i + first)]
        for j in range(n + first)
        for i in range(n)
    ]
    return ca.reshape(entries[order], n, n + first)


def parameter_slopes(
    system: System, stations: list[Station], q: AnyExpr, parameters: AnyExpr, root: bool
) -> AnyExpr:
    """Derivatives by parameters in stiffness, inertia and loads, and with `root` the parent's rows.

    dr/dp = dS/dp q + Σ_k S_kᵀ (∂W_k/∂data) d data/dp,      each ∂W_k/∂data by AD of one station
    """
    n, m, first = system.beam.basis.n, parameters.numel(), 6 * root
    mask, inertias = system.inertias
    gravity = system.parent.gravity
    total = _jacobian(stiffness_matrix(system.beam) @ q, parameters)
    total = ca.vertcat(ca.DM.zeros(first, m), total)
    for station, inertia, acting in zip(stations, inertias, system.loads, strict=True):
        columns = station.fields.columns
        if _depends(inertia, parameters):
            slope_of = fields.inertia_slope(mask, n + first, m)
            total += slope_of(station.state, inertia, columns, _jacobian(inertia, parameters))
        for formula, data in acting:
            if _depends(data, parameters) or (formula.order == 2 and _depends(gravity, parameters)):
                load_slope = data_slope(formula, data.numel(), n + first, m)
                changes = (_jacobian(data, parameters), _jacobian(gravity, parameters))
                total -= load_slope(station.state, gravity, data, columns, *changes)
    return total


def _by_parent(found: Derivatives, parent: ParentMotion, parameters: AnyExpr) -> AnyExpr:
    """What parameters do by way of the twist of the parent, its rates and gravity."""
    twist, acceleration = (_jacobian(x, parameters) for x in (parent.twist, parent.acceleration))
    rates: AnyExpr = ca.vertcat(found.parent.by_rates, found.by_rates)
    accelerations: AnyExpr = ca.vertcat(found.parent.by_accelerations, found.by_accelerations)
    return rates[:, :6] @ twist + accelerations[:, :6] @ acceleration


def _without_root(full: Derivatives) -> Derivatives:
    wrench = Wrenches(full.parent.value, *(part[:, 6:] for part in full.parent[1:]))
    weights, rates, accelerations = (part[:, 6:] for part in full[1:4])
    by_parameters = full.by_parameters[6:, :]
    return Derivatives(full.residual, weights, rates, accelerations, wrench, by_parameters)


def _jacobian(value: AnyExpr, parameters: AnyExpr) -> AnyExpr:
    if is_numeric(value):
        return ca.DM.zeros(ca.DM(value).numel(), parameters.numel())
    return ca.densify(ca.jacobian(value, parameters))


def _depends(value: AnyExpr, parameters: AnyExpr) -> bool:
    return not is_numeric(value) and bool(ca.depends_on(value, parameters))
