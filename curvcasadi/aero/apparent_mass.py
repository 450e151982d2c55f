"""What the apparent mass of the air adds to the mass matrix of a wing."""

from __future__ import annotations

from functools import lru_cache

import casadi as ca
import numpy as np

from curvcasadi.aero import section
from curvcasadi.aero.stations import air_stations, section_data
from curvcasadi.aero.unsteady import UnsteadyAirload
from curvcasadi.beam.beam import Beam
from curvcasadi.beam.pose import unpack_pose
from curvcasadi.kinematics import chain
from curvcasadi.kinematics.jacobian import body_jacobian_of, jacobian_states, to_body
from curvcasadi.symbolic.expressions import AnyExpr, Array


def apparent_mass_matrix(
    beam: Beam, q: AnyExpr, load: UnsteadyAirload, boundaries: Array, *, root: bool = False
) -> AnyExpr:
    """What the apparent mass of the air adds to the mass matrix of the weights, (n, n).

    With `root` also to that of a free parent, whose twist is about its origin in its axes and goes
    first: (6 + n, 6 + n).

    With π ρ b² l the mass of a strip and J its body Jacobian, J_mid that of the normal velocity in
    the middle of its chord: Σ π ρ b² l (J_midᵀ J_mid + ⅛ b² J_ωxᵀ J_ωx).

    Parameters
    ----------
    beam : Beam
        The wing.
    q : SX, MX or DM, shape (n, 1)
        Weights, rad/m.
    load : UnsteadyAirload
        The load; without apparent mass the matrix is zero.
    boundaries : array, shape (N + 1,)
        Of the elements, the stations of the mesh on which the load acts.
    root : bool
        Whether the parent of the beam is free.
    """
    n = beam.basis.n
    stations = air_stations(load.strips)
    beam_chain = chain.build(beam, [xi for xi, _ in stations], boundaries=boundaries)
    add = _add_apparent_mass(n, root)
    total: AnyExpr = ca.DM.zeros(n + 6 * root, n + 6 * root)
    frame = beam.root.packed if root else chain.IDENTITY
    states = jacobian_states(beam_chain, q, frame)
    for (xi, weight), state in zip(stations, states, strict=True):
        strip = section_data(
            load.strips,
            xi,
            {},
            density=load.flow.density,
            measure=weight * beam.length,
            apparent=float(load.apparent_mass),
        )
        total = add(state, strip.pack(), total)
    return total


@lru_cache(maxsize=32)
def _add_apparent_mass(n: int, root: bool) -> ca.Function:
    """(state with sums, `SectionData`, sum) -> sum with the apparent mass of a strip."""
    state, data = ca.SX.sym("state", 12 + 6 * n), ca.SX.sym("data", section.SIZE)
    size = n + 6 * root
    total, jacobian = ca.SX.sym("total", size, size), body_jacobian_of(state)
    if root:
        unit, pose = ca.DM.eye(6), unpack_pose(state)
        jacobian = ca.horzcat(to_body(*pose, unit[:3, :], unit[3:, :]), jacobian)
    added = strip_apparent_mass(section.unpack(data), jacobian)
    return ca.Function("apparent_mass", [state, data, total], [total + added], {"cse": True})


def strip_apparent_mass(strip: section.SectionData, jacobian: AnyExpr) -> AnyExpr:
    """Apparent mass (k, k) of a strip whose body Jacobian is (6, k): see `apparent_mass_matrix`."""
    half = strip.chord / 2
    mass = strip.apparent * np.pi * half * strip.pressure
    rolling = jacobian[0, :]
    normal = jacobian[5, :] + (strip.center - half / 2) * rolling
    return mass * (normal.T @ normal + half**2 / 8 * (rolling.T @ rolling))
