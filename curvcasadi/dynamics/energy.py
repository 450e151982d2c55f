"""Energy of a moving beam."""

from __future__ import annotations

from functools import lru_cache

import casadi as ca

from curvcasadi.beam.beam import Beam
from curvcasadi.dynamics import recursion, system
from curvcasadi.dynamics.inertia import Mask, masked, momentum
from curvcasadi.kinematics.root_motion import RootMotion
from curvcasadi.symbolic.expressions import AnyExpr


def kinetic_energy(
    beam: Beam, q: AnyExpr, q_dot: AnyExpr, root: RootMotion | None = None
) -> AnyExpr:
    """Kinetic energy T = Σ_k ½ V_kᵀ I_k V_k over the stations, V_k their twists.

    Parameters
    ----------
    beam : Beam
        With mass.
    q, q_dot : SX, MX, DM or array, shape (n, 1)
        Weights, rad/m, and their rates.
    root : RootMotion, optional
        Whose twist moves the root; a clamped root unless given.

    Returns
    -------
    SX, MX or DM, shape (1, 1)
        J.

    Raises
    ------
    ValueError
        As `inverse_dynamics`.
    """
    states = system.weights(beam, q=q, q_dot=q_dot)
    built = system.build(beam, (), root, states)
    mask, inertias = built.inertias
    step = recursion.twist_step(built.chain.pattern)
    twists = built.chain.march([step], built.root_twist, *states.values())
    energy = _station_energy(mask)
    return sum(energy(*station) for station in zip(twists, inertias, strict=True))


@lru_cache(maxsize=8)
def _station_energy(mask: Mask) -> ca.Function:
    """(twist, inertia) -> ½ Vᵀ I V."""
    twist, inertia = ca.SX.sym("twist", 6), ca.SX.sym("inertia", sum(mask))
    energy = ca.dot(twist, momentum(masked(mask, inertia), twist)) / 2
    return ca.Function("station_energy", [twist, inertia], [energy], {"cse": True})
