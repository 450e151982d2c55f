"""The equations of motion as a residual: what a motion leaves unbalanced."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import casadi as ca

from curvcasadi.beam.beam import Beam
from curvcasadi.dynamics import applied, recursion, system
from curvcasadi.dynamics.system import System
from curvcasadi.kinematics.root_motion import RootMotion
from curvcasadi.statics.energy import stiffness_matrix
from curvcasadi.symbolic.expressions import AnyExpr


def inverse_dynamics(
    beam: Beam,
    q: AnyExpr,
    q_dot: AnyExpr,
    q_ddot: AnyExpr,
    loads: Sequence[Any] = (),
    root: RootMotion | None = None,
) -> AnyExpr:
    """Residual of the equations of motion, r = M q_ddot + bias + S q − Q(loads).

    It vanishes along motions of the beam; at rest it equals `equilibrium_residual`. There is no
    damping in it.

    Parameters
    ----------
    beam : Beam
        With a section that has stiffness and mass, or bodies.
    q, q_dot, q_ddot : SX, MX, DM or array, shape (n, 1)
        Weights, rad/m, and their rates.
    loads : sequence of loads
        As for `equilibrium_residual`. A `Gravity` is an acceleration −g of the root, and is not
        counted as a load as well.
    root : RootMotion, optional
        How the root moves, and gravity if `loads` have none; a clamped root unless given.

    Returns
    -------
    SX, MX or DM, shape (n, 1)
        N m². SX weights give an unrolled recursion, MX weights a chain of calls.

    Raises
    ------
    ValueError
        If a shape is wrong, symbols are of two kinds, or the beam has no mass, or torsion without
        rotary inertia.
    """
    states = system.weights(beam, q=q, q_dot=q_dot, q_ddot=q_ddot)
    built = system.build(beam, loads, root, states)
    return balance(built, *states.values()).residual


class Balance(NamedTuple):
    """What a motion leaves unbalanced, and what it needs of the parent."""

    residual: AnyExpr  #: r (n, 1), N m²
    wrench: AnyExpr  #: (moment, force), (6, 1), outboard of the root station, root axes
    motion: AnyExpr  #: of the root station, `recursion.LocalMotion`
    load: AnyExpr  #: on the root station, (6, 1), or None
    rates: AnyExpr  #: of what loads with states follow, station by station, (m, 1)


def balance(built: System, q: AnyExpr, q_dot: AnyExpr, q_ddot: AnyExpr) -> Balance:
    """The two passes: see `recursion`."""
    beam_chain, (mask, inertias) = built.chain, built.inertias
    pattern = beam_chain.pattern
    outward, inward = recursion.outward(pattern), recursion.inward(pattern, mask)
    motions = beam_chain.march([outward], built.root_motion, q, q_dot, q_ddot)
    acting, rates = applied.acting(built, q, q_dot, motions)
    wrench, force = ca.DM.zeros(6), ca.DM.zeros(built.beam.basis.n)
    for k in reversed(range(1, len(motions))):
        if acting[k] is not None:
            wrench = wrench - acting[k]
        wrench, force = inward(q, motions[k], inertias[k], beam_chain.data[k - 1], wrench, force)
    residual = stiffness_matrix(built.beam) @ q + force
    return Balance(residual, wrench, motions[0], acting[0], rates)


def parent_wrench(built: System, found: Balance) -> AnyExpr:
    """Wrench (moment, force), (6, 1), that the beam needs of its parent; parent axes and origin."""
    mask, inertias = built.inertias
    wrench = found.wrench + recursion.at_station(mask)(found.motion, inertias[0])
    return built.to_parent(wrench if found.load is None else wrench - found.load)


def root_wrench(built: System, q: AnyExpr, q_dot: AnyExpr, q_ddot: AnyExpr) -> AnyExpr:
    """Wrench (moment, force), (6, 1), that the beam hands on to its root; root axes and station."""
    return -built.from_parent @ parent_wrench(built, balance(built, q, q_dot, q_ddot))
