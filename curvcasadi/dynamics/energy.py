"""Energy of a moving beam."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import casadi as ca

from curvcasadi.beam.beam import Beam
from curvcasadi.beam.pose import unpack_pose
from curvcasadi.dynamics import recursion, system
from curvcasadi.dynamics.inertia import Mask, masked, momentum
from curvcasadi.kinematics import chain
from curvcasadi.kinematics.root_motion import RootMotion
from curvcasadi.loads.kinds import Gravity
from curvcasadi.statics.energy import strain_energy
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


def potential_energy(
    beam: Beam, q: AnyExpr, loads: Sequence[Any] = (), root: RootMotion | None = None
) -> AnyExpr:
    """Potential energy V = ½ qᵀ S q − Σ_k g · (m p + R m c)_k over the stations of the inertia.

    With `kinetic_energy` it is constant along undamped motions of a beam whose root rests. Heights
    are those above the origin of the parent.

    Parameters
    ----------
    beam : Beam
        With stiffness and mass.
    q : SX, MX, DM or array, shape (n, 1)
        Weights, rad/m.
    loads : sequence of Gravity
        Gravity, or nothing: the potentials of other loads are not known here.
    root : RootMotion, optional
        Whose attitude and gravity count.

    Returns
    -------
    SX, MX or DM, shape (1, 1)
        J.

    Raises
    ------
    ValueError
        As `inverse_dynamics`, and for loads other than `Gravity`.
    """
    for load in loads:
        if not isinstance(load, Gravity):
            raise ValueError(f"loads: expected Gravity alone, found {load!r}")
    states = system.weights(beam, q=q)
    built = system.build(beam, loads, root, states)
    mask, inertias = built.inertias
    step = chain.pose_step(built.chain.pattern)
    poses = built.chain.march([step], beam.root.packed, states["q"])
    moment = _station_moment(mask)
    total = sum(moment(*station) for station in zip(poses, inertias, strict=True))
    return strain_energy(beam, states["q"]) - ca.dot(built.parent.gravity, total)


@lru_cache(maxsize=8)
def _station_moment(mask: Mask) -> ca.Function:
    """(pose, inertia) -> m p + R m c, parent axes."""
    pose, inertia = ca.SX.sym("pose", 12), ca.SX.sym("inertia", sum(mask))
    rotation, position = unpack_pose(pose)
    mass, first, _ = masked(mask, inertia)
    value = ca.densify(mass * position + rotation @ first)
    return ca.Function("station_moment", [pose, inertia], [value], {"cse": True})


@lru_cache(maxsize=8)
def _station_energy(mask: Mask) -> ca.Function:
    """(twist, inertia) -> ½ Vᵀ I V."""
    twist, inertia = ca.SX.sym("twist", 6), ca.SX.sym("inertia", sum(mask))
    energy = ca.dot(twist, momentum(masked(mask, inertia), twist)) / 2
    return ca.Function("station_energy", [twist, inertia], [energy], {"cse": True})
