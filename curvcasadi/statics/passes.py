"""Forces of loads on the weights of a beam, and on its root, by two passes.

Virtual work on the weights, with the spatial Jacobian [A; B] of `kinematics` in parent axes:

    Q = Σ_k [A; B]_kᵀ W_k = Σ_e (dξ_e/dq)ᵀ J_l(ξ_e)ᵀ Ad(T_e)ᵀ Σ_{k outboard of e} W_k

One pass outward gives poses and wrenches W_k about the parent origin, one inward sums them: linear
in the number of elements.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import casadi as ca

from curvcasadi.beam.beam import Beam
from curvcasadi.kinematics import chain, jacobian as kinematics
from curvcasadi.loads.coupling import Coupling
from curvcasadi.loads.stations import (
    Load,
    StationLoads,
    couplings,
    loaded_mesh,
    station_loads,
)
from curvcasadi.statics import virtual_work
from curvcasadi.symbolic.expressions import AnyExpr, same_kind


class Passed(NamedTuple):
    """Q (n, 1), root wrench (6, 1), and their derivatives with respect to q."""

    force: AnyExpr
    wrench: AnyExpr
    force_slope: AnyExpr = None
    wrench_slope: AnyExpr = None


def passes(
    beam: Beam, q: AnyExpr, loads: Sequence[Load], attitude: AnyExpr | None, *, tangent: bool
) -> Passed:
    """What loads do to a beam, with `tangent` also the derivatives by the weights."""
    mesh = loaded_mesh(beam, loads)
    data = station_loads(beam, loads, mesh, attitude)
    for xi, acting in zip(mesh.stations, data, strict=True):
        same_kind(q=q, **{f"loads at xi = {xi:g}": values for _, values in acting})
    coupled = couplings(beam, loads, mesh, attitude)
    for joint in coupled:
        same_kind(**{"q": q, "loads": ca.vertcat(joint.data, *joint.own)})
    beam_chain = chain.build(beam, mesh.stations.tolist(), boundaries=mesh.stations)
    pattern, n = beam_chain.pattern, beam.basis.n
    root = beam.root.packed
    if tangent:
        states = kinematics.jacobian_states(beam_chain, q, root)
        inward = virtual_work.inward_tangent(pattern)
        outboard = [ca.DM.zeros(6), ca.DM.zeros(6, n)]
        forces = [ca.DM.zeros(n), ca.DM.zeros(n, n)]
    else:
        states = beam_chain.march([chain.pose_step(pattern)], root, q)
        inward = virtual_work.inward(pattern)
        outboard, forces = [ca.DM.zeros(6)], [ca.DM.zeros(n)]
    columns = n if tangent else None
    wrenches = _station_wrenches(states, data, coupled, columns)
    for k in reversed(range(len(states))):
        for wrench in wrenches[k]:
            outboard = [a + b for a, b in zip(outboard, wrench, strict=True)]
        if k:
            crossed = inward(q, states[k - 1], beam_chain.data[k - 1], *outboard, *forces)
            forces = [*_outputs(crossed)]
    return Passed(*(x for pair in zip(forces, outboard, strict=True) for x in pair))


def _station_wrenches(
    states: Sequence[AnyExpr],
    data: Sequence[StationLoads],
    coupled: Sequence[Coupling],
    columns: int | None,
) -> list[list[tuple[AnyExpr, ...]]]:
    """Wrench, and with `columns` its slope, of everything that acts on each station."""
    found: list[list[tuple[AnyExpr, ...]]] = []
    for state, acting in zip(states, data, strict=True):
        found.append([])
        for formula, values in acting:
            wrench_at = virtual_work.station_wrench(formula, values.numel(), columns)
            found[-1].append(_outputs(wrench_at(state, values)))
    for coupling in coupled:
        motions = motions_at_rest(coupling, states)
        values, moved = coupling.function(motions, coupling.data), None
        if columns is not None:
            by_motions, _ = coupling.tangent(motions, coupling.data)
            sums = (kinematics.unpack_sums(states[node]) for node in coupling.nodes)
            moves = ca.vertcat(*(part for pair in sums for part in pair))
            moved = coupling.of_stations(by_motions[:, : moves.shape[0]] @ moves)
        for k, held in enumerate(coupling.station_data(values)):
            node = coupling.nodes[k]
            moving = () if moved is None else coupling.rows
            wrench_at = virtual_work.station_wrench(coupling.formula, held.numel(), columns, moving)
            slopes = [] if moved is None else [moved[k]]
            found[node].append(_outputs(wrench_at(states[node], held, *slopes)))
    return found


def motions_at_rest(coupling: Coupling, states: Sequence[AnyExpr]) -> AnyExpr:
    """Poses of the stations of a coupling, and twists of zero where it takes them."""
    poses: AnyExpr = ca.horzcat(*(states[node][:12] for node in coupling.nodes))
    return ca.vertcat(poses, ca.DM.zeros(6 * coupling.order, len(coupling.nodes)))


def _outputs(results: Any) -> tuple[AnyExpr, ...]:
    """Outputs of a call as a tuple, also a single one."""
    return results if isinstance(results, tuple) else (results,)
