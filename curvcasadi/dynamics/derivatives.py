"""Structured first derivatives of the inverse dynamics, by one pass outward and one inward.

The rows are those of the weights and, for a free root, of the wrench on the parent; the columns
those of the weights and, for a moving root, six of the parent. The parent's columns are a change of
its pose, T exp(φ^), of the components of its twist V, and of their rates: on the group they do not
commute, so that their rates are S′ = 0, S″ = −ad(0, g) of the pose and S′ = ½ ad(V) of the twist.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import casadi as ca

from curvcasadi.dynamics import coupled, fields
from curvcasadi.dynamics.applied import LoadSlopes, data_slope, load_slopes
from curvcasadi.dynamics.coupled import Coupled
from curvcasadi.dynamics.fields import Fields, Wrenches
from curvcasadi.dynamics.system import System
from curvcasadi.lie import se3, so3
from curvcasadi.statics.energy import stiffness_matrix
from curvcasadi.symbolic.expressions import AnyExpr, is_numeric


class Rates(NamedTuple):
    """Rates of what loads with states follow, station by station, and their derivatives."""

    value: AnyExpr  #: (k, 1)
    by_weights: AnyExpr  #: (k, columns)
    by_rates: AnyExpr
    by_accelerations: AnyExpr
    by_parameters: AnyExpr = None  #: (k, m)


class Derivatives(NamedTuple):
    """Residual of a beam and its derivatives; where asked for, the parent's columns go first."""

    residual: AnyExpr  #: r (n, 1), N m²
    by_weights: AnyExpr  #: (n, columns)
    by_rates: AnyExpr  #: (n, columns)
    by_accelerations: AnyExpr  #: (n, columns): the mass matrix, and its coupling with the parent
    parent: Wrenches  #: wrench that the motion needs of the parent, parent axes, at its origin
    rates: Rates
    by_parameters: AnyExpr = None  #: (n, m), or with the parent's rows first (6 + n, m)


class Station(NamedTuple):
    state: AnyExpr  #: pose, spatial twist and acceleration, (24, 1)
    fields: Fields
    loads: list[LoadSlopes]  #: of those of the system, then of `coupled`
    tangent: AnyExpr = None  #: L of the element inboard
    coupled: tuple[Coupled, ...] = ()


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

    `parameters` (m, 1) are symbols in loads, stiffness and inertia, in the parent's motion, and in
    the pose of the root in a parent at rest.
    """
    n = system.beam.basis.n
    driving = (system.parent.twist, system.parent.twist_rate, system.beam.root.packed)
    driven = parameters is not None and any(_depends(x, parameters) for x in driving)
    if driven and not root:
        full = differentiate(system, q, q_dot, q_ddot, root=True, parameters=parameters)
        return _without_root(full)
    stations = _coupled(system, _outward(system, q, q_dot, q_ddot, root), root, parameters)
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
        _rates(stations, n + 6 * root, type(q)),
    )
    if parameters is None:
        return found
    by_data, rates = parameter_slopes(system, stations, q, parameters, root)
    if driven:
        by_parent, rates_by_parent = _by_parent(found, system, parameters)
        by_data, rates = by_data + by_parent, rates + rates_by_parent
    return found._replace(by_parameters=by_data, rates=found.rates._replace(by_parameters=rates))


def _rates(stations: list[Station], columns: int, kind: Any) -> Rates:
    """Those of all stations, below each other."""
    empty = [kind(0, 1), *[kind(0, columns)] * 3]
    rows = [[part[6:, :] for part in load] for station in stations for load in station.loads]
    return Rates(*(ca.vertcat(*parts) for parts in zip(empty, *rows, strict=True)))


def _outward(
    system: System, q: AnyExpr, q_dot: AnyExpr, q_ddot: AnyExpr, root: bool
) -> list[Station]:
    pattern, parent = system.chain.pattern, system.parent
    tangent, add = fields.tangent_step(pattern), fields.field_step(pattern, root)
    start = ca.densify(ca.vertcat(system.beam.root.packed, parent.twist, parent.acceleration))
    at_root = _fields_of_root(system, root)
    stations = [Station(start, at_root, _loads(system, 0, start, at_root, root))]
    for k, data in enumerate(system.chain.data, start=1):
        state, at_start = stations[-1].state, stations[-1].fields
        state, *tangents = tangent(q, q_dot, q_ddot, state, data)
        at_end = Fields(*(add(*pair, data) for pair in zip(at_start, tangents, strict=True)))
        loads = _loads(system, k, state, at_end, root)
        stations.append(Station(state, at_end, loads, tangents[0]))
    return stations


def _loads(system: System, k: int, state: AnyExpr, at: Fields, root: bool) -> list[LoadSlopes]:
    """Loads on a station and their derivatives."""
    columns = system.beam.basis.n + 6 * root
    of_rates = _rates_of_rates(system, at, root)
    return [
        LoadSlopes(
            *load_slopes(formula, data.numel(), columns)(
                state, system.parent.gravity, data, *at, of_rates
            )
        )
        for formula, data in system.loads[k]
    ]


def _coupled(
    system: System, stations: list[Station], root: bool, parameters: AnyExpr | None
) -> list[Station]:
    """The stations with what acts on them by the motion of all."""
    if not system.couplings:
        return stations
    columns, gravity = system.beam.basis.n + 6 * root, system.parent.gravity
    states, along = [at.state for at in stations], [at.fields for at in stations]
    joint = coupled.with_slopes(system, states, along, parameters)
    found = []
    for station, parts in zip(stations, joint, strict=True):
        of_rates = _rates_of_rates(system, station.fields, root)
        motion = (*station.fields, of_rates)
        loads = [
            LoadSlopes(
                *load_slopes(part.formula, part.data.numel(), columns, part.rows)(
                    station.state, gravity, part.data, *motion, part.by_weights, part.by_rates
                )
            )
            for part in parts
        ]
        found.append(station._replace(loads=[*station.loads, *loads], coupled=tuple(parts)))
    return found


def _rates_of_rates(system: System, at: Fields, root: bool) -> AnyExpr:
    """S′ of a change of the rates of the weights and of the parent's twist."""
    if not root:
        return at.rates
    bracket = se3.small_adjoint(system.parent.twist) / 2
    rest = ca.DM.zeros(6, system.beam.basis.n)
    return at.rates + ca.densify(ca.horzcat(bracket, rest))


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
    at = station.fields
    step = fields.station_step(mask, system.beam.basis.n + 6 * root)
    of_rates = _rates_of_rates(system, at, root)
    total = Wrenches(*step(station.state, inertias[k], *at, of_rates, *outboard))
    for load in station.loads:
        total = Wrenches(*(a - b[:6, :] for a, b in zip(total, load, strict=True)))
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
) -> tuple[AnyExpr, AnyExpr]:
    """Derivatives by parameters in stiffness, inertia, gravity and loads; and those of rates.

    dr/dp = dS/dp q + Σ_k S_kᵀ (∂W_k/∂data) d data/dp,      each ∂W_k/∂data by AD of one station

    With `root` the parent's rows go first. Gravity acts on inertia alone: loads do not know it.
    """
    n, m, first = system.beam.basis.n, parameters.numel(), 6 * root
    mask, inertias = system.inertias
    gravity = system.parent.gravity
    total = _jacobian(stiffness_matrix(system.beam) @ q, parameters)
    total = ca.vertcat(ca.DM.zeros(first, m), total)
    rates = [type(q)(0, m)]
    for station, inertia, loads in zip(stations, inertias, system.loads, strict=True):
        columns = station.fields.columns
        if _depends(inertia, parameters) or _depends(gravity, parameters):
            slope_of = fields.inertia_slope(mask, n + first, m)
            both = (_jacobian(inertia, parameters), _jacobian(gravity, parameters))
            total += slope_of(station.state, inertia, columns, *both)
        acting = []
        for formula, data in loads:
            rows = tuple(k for k in range(data.numel()) if _depends(data[k], parameters))
            acting.append((formula, data, rows, _jacobian(data[list(rows)], parameters)))
        acting += [
            (part.formula, part.data, part.driven, part.by_parameters) for part in station.coupled
        ]
        for (formula, data, rows, changes), slope in zip(acting, station.loads, strict=True):
            change = ca.DM.zeros(slope.value.numel() - 6, m)
            if rows:
                load_slope = data_slope(formula, data.numel(), rows, n + first, m)
                work, change = load_slope(station.state, gravity, data, columns, changes)
                total -= work
            rates.append(change)
    return total, ca.vertcat(*rates)


def _by_parent(found: Derivatives, system: System, parameters: AnyExpr) -> tuple[AnyExpr, AnyExpr]:
    """What parameters do by way of the pose of the root, the twist of the parent and its rates."""
    parent, wrench, rates = system.parent, found.parent, found.rates
    moved = root_change(system, parameters)
    twist, rate = (_jacobian(x, parameters) for x in (parent.twist, parent.twist_rate))
    carried = fields.cross_force(moved, wrench.value)  # the axes of the wrench stay
    by_weights: AnyExpr = ca.vertcat(wrench.by_weights, found.by_weights)
    by_rates: AnyExpr = ca.vertcat(wrench.by_rates, found.by_rates)
    by_accelerations: AnyExpr = ca.vertcat(wrench.by_accelerations, found.by_accelerations)
    forces = by_weights[:, :6] @ moved + by_rates[:, :6] @ twist + by_accelerations[:, :6] @ rate
    forces += ca.vertcat(carried, ca.DM.zeros(found.residual.numel(), parameters.numel()))
    changes = rates.by_weights[:, :6] @ moved + rates.by_rates[:, :6] @ twist
    return forces, changes + rates.by_accelerations[:, :6] @ rate


def root_change(system: System, parameters: AnyExpr) -> AnyExpr:
    """How parameters move the root in its parent, (6, m): a twist in parent axes at its origin.

    With dR = [a×] R it is a = ½ Σ r_k × dr_k of the columns of R, and b = dp − a × p.
    """
    rotation, position = system.beam.root.rotation, system.beam.root.position
    columns = (rotation[:, k] for k in range(3))
    turned = sum(so3.hat(column) @ _jacobian(column, parameters) for column in columns) / 2
    return ca.vertcat(turned, _jacobian(position, parameters) + so3.hat(position) @ turned)


def _without_root(full: Derivatives) -> Derivatives:
    wrench = Wrenches(full.parent.value, *(part[:, 6:] for part in full.parent[1:]))
    weights, rates, accelerations = (part[:, 6:] for part in full[1:4])
    own = Rates(full.rates.value, *(part[:, 6:] for part in full.rates[1:4]))
    return Derivatives(
        full.residual,
        weights,
        rates,
        accelerations,
        wrench,
        own._replace(by_parameters=full.rates.by_parameters),
        full.by_parameters[6:, :],
    )


def _jacobian(value: AnyExpr, parameters: AnyExpr) -> AnyExpr:
    if is_numeric(value):
        return ca.DM.zeros(ca.DM(value).numel(), parameters.numel())
    return ca.densify(ca.jacobian(value, parameters))


def _depends(value: AnyExpr, parameters: AnyExpr) -> bool:
    return not is_numeric(value) and bool(ca.depends_on(value, parameters))
