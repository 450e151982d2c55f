"""Forward dynamics: the accelerations of the weights under loads."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca

from curvcasadi.beam.beam import Beam
from curvcasadi.dynamics import inverse, mass, system
from curvcasadi.kinematics.root_motion import RootMotion
from curvcasadi.symbolic import ldl
from curvcasadi.symbolic.expressions import AnyExpr


def forward_dynamics(
    beam: Beam,
    q: AnyExpr,
    q_dot: AnyExpr,
    loads: Sequence[Any] = (),
    root: RootMotion | None = None,
) -> AnyExpr:
    """Accelerations q_ddot = M⁻¹ (Q(loads) − bias − S q) of a beam that moves freely under loads.

    Parameters
    ----------
    beam : Beam
        With mass.
    q, q_dot : SX, MX, DM or array, shape (n, 1)
        Weights, rad/m, and their rates.
    loads : sequence of loads
        As for `inverse_dynamics`, without loads that depend on accelerations.
    root : RootMotion, optional
        How the root moves, and gravity if `loads` have none; a clamped root unless given.

    Returns
    -------
    SX, MX or DM, shape (n, 1)
        rad/(m s²).

    Raises
    ------
    ValueError
        As `inverse_dynamics`; if the masses are fewer than the weights, or a load depends on
        accelerations.
    """
    states = system.weights(beam, q=q, q_dot=q_dot)
    built = system.build(beam, loads, root, states)
    return accelerations(built, *states.values())


def accelerations(built: system.System, q: AnyExpr, q_dot: AnyExpr) -> AnyExpr:
    """Accelerations (n, 1) by the mass matrix and the residual without acceleration."""
    mass.check_invertible(built)
    built.refuse_accelerations()
    n = built.beam.basis.n
    bias = inverse.balance(built, q, q_dot, ca.DM.zeros(n)).residual
    return ldl.ldl_solve(n)(mass.packed_mass_matrix(built, q), -bias)
