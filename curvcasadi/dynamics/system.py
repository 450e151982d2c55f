"""A beam ready for the recursions: its chain, the inertia of its stations, what acts on them."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import casadi as ca

from curvcasadi.beam.beam import Beam
from curvcasadi.dynamics.inertia import StationInertias, inertial_mesh, station_inertias
from curvcasadi.kinematics import chain
from curvcasadi.kinematics.root_motion import RootMotion
from curvcasadi.loads.kinds import Gravity
from curvcasadi.loads.stations import StationLoads, WrenchFormula, station_loads
from curvcasadi.symbolic.expressions import AnyExpr, expression, instance, same_kind


class System(NamedTuple):
    """A beam with loads, divided into stations."""

    beam: Beam
    chain: chain.Chain
    inertias: StationInertias
    loads: tuple[StationLoads, ...]  #: per station, gravity excluded
    root: RootMotion
    gravity: AnyExpr  #: acceleration (3, 1), m/s², inertial axes

    @property
    def root_pose(self) -> AnyExpr:
        """(vec R, p), (12, 1), of the root in parent axes."""
        return ca.veccat(self.beam.root.rotation, self.beam.root.position)

    @property
    def root_motion(self) -> AnyExpr:
        """(ω, α, a − g) of the root, (9, 1), root axes, with a = dv/dt + ω × v."""
        to_root = (self.root.pose.rotation @ self.beam.root.rotation).T
        angular, linear = self.root.twist[:3], self.root.twist[3:]
        rate = self.root.twist_rate
        acceleration = rate[3:] + ca.cross(angular, linear) - to_root @ self.gravity
        return ca.densify(ca.vertcat(angular, rate[:3], acceleration))


def weights(beam: Beam, **values: AnyExpr) -> dict[str, AnyExpr]:
    """The weights and their rates, checked for their shape (n, 1)."""
    instance("beam", beam, Beam)
    return {name: expression(name, value, (beam.basis.n, 1)) for name, value in values.items()}


def build(
    beam: Beam, loads: Sequence[Any], root: RootMotion | None, weights: dict[str, AnyExpr]
) -> System:
    """System of `beam`; all its symbols must be of the kind of the `weights`."""
    loads = tuple(loads)
    root = instance("root", RootMotion() if root is None else root, RootMotion)
    mesh = inertial_mesh(beam, loads)
    inertias = station_inertias(beam, mesh)
    others = [load for load in loads if not isinstance(load, Gravity)]
    applied = station_loads(beam, others, mesh, root.pose.rotation)
    beam_chain = chain.build(beam, mesh.stations.tolist(), boundaries=mesh.stations)
    system = System(beam, beam_chain, inertias, tuple(applied), root, _gravity(loads, root))
    acting = {
        f"loads at xi = {xi:g}": data
        for xi, station in zip(mesh.stations, applied, strict=True)
        for _, data in station
    }
    inertia = {"the inertia of Beam.section and Beam.bodies": ca.vertcat(*inertias.data)}
    gravity = {"Gravity.acceleration": system.gravity}
    same_kind(**weights, **beam.design_symbols, **root.symbols, **inertia, **gravity, **acting)
    return system


def _gravity(loads: Sequence[Any], root: RootMotion) -> AnyExpr:
    accelerations = [load.acceleration for load in loads if isinstance(load, Gravity)]
    if root.gravity is not None:
        if accelerations:
            raise ValueError(
                "loads: expected no Gravity beside RootMotion.gravity, which would count it twice"
            )
        accelerations = [root.gravity]
    return sum(accelerations, ca.DM.zeros(3))


def applied_wrenches(system: System, q: AnyExpr) -> list[AnyExpr]:
    """Sum of the loads on each station, (moment, force), (6, 1), its local axes; None where none.

    The poses are computed only if there are such loads.
    """
    if not any(system.loads):
        return [None] * len(system.loads)
    step = chain.pose_step(system.chain.pattern)
    poses = system.chain.march([step], system.root_pose, q)
    return [
        _sum(_local_wrench(formula, data.numel())(pose, data) for formula, data in acting)
        for pose, acting in zip(poses, system.loads, strict=True)
    ]


def _sum(terms: Any) -> AnyExpr:
    first, *others = [*terms] or [None]
    return sum(others, first)


@lru_cache(maxsize=256)
def _local_wrench(formula: WrenchFormula, size: int) -> ca.Function:
    """(pose, data) -> wrench (moment, force) at the station in its local axes."""
    pose, data = ca.SX.sym("pose", 12), ca.SX.sym("data", size)
    rotation, position = chain.unpack_pose(pose)
    wrench = formula(rotation, position, data)
    moment = wrench[:3] - ca.cross(position, wrench[3:])
    local = ca.vertcat(rotation.T @ moment, rotation.T @ wrench[3:])
    return ca.Function("local_wrench", [pose, data], [local], {"cse": True})
