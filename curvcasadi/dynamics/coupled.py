"""Loads whose stations depend on each other, along a moving beam.

The values of a coupling are data of its stations that move: by the fields of `derivatives` a change
of the weights moves the pose of a station by S and its local twist by Ad(T⁻¹) S′, one of their
rates the local twist by Ad(T⁻¹) S.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import casadi as ca

from curvcasadi.dynamics.fields import Fields
from curvcasadi.dynamics.system import System
from curvcasadi.kinematics.jacobian import to_body
from curvcasadi.kinematics.motion import unpack_motion
from curvcasadi.loads.coupling import Coupling
from curvcasadi.loads.formulas import Formula
from curvcasadi.symbolic.expressions import AnyExpr, is_numeric


class Coupled(NamedTuple):
    """What a coupling does at a station, with derivatives where asked for."""

    formula: Formula
    data: AnyExpr
    rows: tuple[int, ...] = ()  #: of the data that follow the motion
    by_weights: AnyExpr = None  #: of these, (rows, columns)
    by_rates: AnyExpr = None
    driven: tuple[int, ...] = ()  #: of the data that follow parameters, other than by the motion
    by_parameters: AnyExpr = None  #: of these, (driven, m)


def at_stations(
    system: System, poses: Sequence[AnyExpr], twists: Sequence[AnyExpr]
) -> list[list[Coupled]]:
    """What couplings do at the stations, from poses and local twists."""
    found: list[list[Coupled]] = [[] for _ in poses]
    for coupling in system.couplings:
        together = [poses, twists][: 1 + coupling.order]
        motions = [ca.vertcat(*(part[node] for part in together)) for node in coupling.nodes]
        values = coupling.function(ca.horzcat(*motions), coupling.data)
        for node, data in zip(coupling.nodes, coupling.station_data(values), strict=True):
            found[node].append(Coupled(coupling.formula, data))
    return found


def with_slopes(
    system: System,
    states: Sequence[AnyExpr],
    fields: Sequence[Fields],
    parameters: AnyExpr | None,
) -> list[list[Coupled]]:
    """The same from the states (24, 1) and the fields of all stations, with derivatives."""
    found: list[list[Coupled]] = [[] for _ in states]
    for coupling in system.couplings:
        nodes, order = coupling.nodes, coupling.order
        motions = ca.horzcat(*(_motion(order)(states[node]) for node in nodes))
        values = coupling.function(motions, coupling.data)
        by_motions, by_data = coupling.tangent(motions, coupling.data)
        by_poses, by_twists = ca.horzsplit(
            by_motions, [0, 6 * len(nodes), 6 * (1 + order) * len(nodes)]
        )
        moved = by_poses @ ca.vertcat(*(fields[node].columns for node in nodes))
        rates = ca.DM.zeros(*moved.shape)
        if order:
            columns = moved.shape[1]
            changes = [_twists(columns)(states[k], *fields[k][:2]) for k in nodes]
            moved = moved + by_twists @ ca.vertcat(*(change[0] for change in changes))
            rates = by_twists @ ca.vertcat(*(change[1] for change in changes))
        slopes = [coupling.of_stations(part) for part in (moved, rates)]
        slope = None
        if parameters is not None:
            slope = by_data @ ca.densify(ca.jacobian(coupling.data, parameters))
        for k, data in enumerate(coupling.station_data(values)):
            at = Coupled(coupling.formula, data, coupling.rows, *(part[k] for part in slopes))
            if parameters is not None:
                at = at._replace(**_driven(coupling, k, slope, parameters))
            found[nodes[k]].append(at)
    return found


def _driven(coupling: Coupling, k: int, slope: AnyExpr, parameters: AnyExpr) -> dict[str, Any]:
    """Rows of the data of a station that follow the parameters, and their derivatives."""
    own = coupling.own[k]
    follow = [not is_numeric(x) and ca.depends_on(x, parameters) for x in ca.vertsplit(own)]
    whole = coupling.joined(
        coupling.of_stations(slope)[k], ca.densify(ca.jacobian(own, parameters))
    )
    size = len(coupling.rows)
    driven = {i if i < coupling.first else i + size for i, yes in enumerate(follow) if yes}
    chosen = sorted(driven | set(coupling.rows))
    return {"driven": tuple(chosen), "by_parameters": whole[chosen, :]}


@lru_cache(maxsize=8)
def _motion(order: int) -> ca.Function:
    """State -> pose, and with `order` 1 the local twist behind it."""
    state = ca.SX.sym("state", 24)
    at = unpack_motion(state, 2)
    local = to_body(at.rotation, at.position, at.twist[:3], at.twist[3:])
    motion = ca.vertcat(state[:12], local) if order else state[:12]
    return ca.Function("coupled_motion", [state], [motion])


@lru_cache(maxsize=32)
def _twists(columns: int) -> ca.Function:
    """(state, S, S′) -> derivatives (6, columns) of the local twist by weights and by rates."""
    state = ca.SX.sym("state", 24)
    moved, rates = (ca.SX.sym(name, 6, columns) for name in ("S", "S1"))
    at = unpack_motion(state, 2)
    changes = [to_body(at.rotation, at.position, x[:3, :], x[3:, :]) for x in (rates, moved)]
    return ca.Function("coupled_twists", [state, moved, rates], changes, {"cse": True})
