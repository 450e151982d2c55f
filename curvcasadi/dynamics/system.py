"""A beam ready for the recursions: its chain, the inertia of its stations, what acts on them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import casadi as ca

from curvcasadi.beam.beam import Beam
from curvcasadi.beam.pose import Pose
from curvcasadi.dynamics.inertia import StationInertias, inertial_mesh, station_inertias
from curvcasadi.dynamics.rotation import SteadyRotation
from curvcasadi.kinematics import chain
from curvcasadi.kinematics.root_motion import RootMotion
from curvcasadi.kinematics.weights import check_angles
from curvcasadi.lie import se3
from curvcasadi.loads.coupling import Coupling
from curvcasadi.loads.kinds import Gravity
from curvcasadi.loads.stations import StationLoads, couplings, station_loads
from curvcasadi.symbolic.expressions import AnyExpr, expression, instance, same_kind, sequence


class ParentMotion(NamedTuple):
    """Motion of the parent frame, in its own axes at its origin."""

    twist: AnyExpr  #: V (6, 1), rad/s and m/s
    twist_rate: AnyExpr  #: rates of the components of V, (6, 1)
    gravity: AnyExpr  #: acceleration of gravity (3, 1), m/s²

    @property
    def acceleration(self) -> AnyExpr:
        """Spatial acceleration less gravity, (6, 1): that of all that rests in the parent."""
        return self.twist_rate - ca.vertcat(ca.DM.zeros(3), self.gravity)


class System(NamedTuple):
    """A beam with loads, divided into stations."""

    beam: Beam
    chain: chain.Chain
    inertias: StationInertias
    loads: tuple[StationLoads, ...]  #: per station, gravity excluded
    couplings: tuple[Coupling, ...]
    parent: ParentMotion

    @property
    def root_motion(self) -> AnyExpr:
        """(ω, α, a − g) of the root, (9, 1), root axes, with a = dv/dt + ω × v."""
        root, (twist, _, _) = self.beam.root, self.parent
        rate, acceleration = twist[:3], self.parent.acceleration
        velocity = twist[3:] + ca.cross(rate, root.position)
        linear = acceleration[3:] + ca.cross(acceleration[:3], root.position)
        linear += ca.cross(rate, velocity)
        to_root = root.rotation.T
        return ca.densify(ca.vertcat(to_root @ rate, to_root @ acceleration[:3], to_root @ linear))

    @property
    def root_twist(self) -> AnyExpr:
        """Body twist of the root, (6, 1), root axes."""
        return ca.densify(_adjoint(self.beam.root.inverse()) @ self.parent.twist)

    @property
    def order(self) -> int:
        """What loads depend on: 0 poses, 1 and twists, 2 and accelerations; −1 without loads."""
        formulas = [formula for acting in self.loads for formula, _ in acting]
        formulas += [coupling.formula for coupling in self.couplings]
        orders = [formula.order for formula in formulas]
        return max([*orders, *(coupling.order for coupling in self.couplings)], default=-1)

    def refuse_accelerations(self) -> None:
        """Refuse loads that depend on accelerations: their apparent mass is not in the matrices."""
        if self.order > 1:
            raise ValueError(
                "loads: expected loads that do not depend on accelerations, found one with an "
                "apparent mass; solve inverse_dynamics for the accelerations instead"
            )

    def to_parent(self, wrench: AnyExpr) -> AnyExpr:
        """A wrench (6, 1) in root axes at the root, in parent axes at the parent's origin."""
        rotation, position = self.beam.root.rotation, self.beam.root.position
        force = rotation @ wrench[3:]
        return ca.vertcat(rotation @ wrench[:3] + ca.cross(position, force), force)

    @property
    def from_parent(self) -> AnyExpr:
        """(6, 6), wrenches in parent axes at its origin to root axes at the root: `to_parent`⁻¹."""
        return _adjoint(self.beam.root).T


def weights(beam: Beam, **values: AnyExpr) -> dict[str, AnyExpr]:
    """The weights and their rates, checked for their shape (n, 1).

    Numbers must not turn an element by more than its exponential serves for.
    """
    instance("beam", beam, Beam)
    made = {name: expression(name, value, (beam.basis.n, 1)) for name, value in values.items()}
    check_angles(beam, made["q"])
    return made


def build(
    beam: Beam, loads: Sequence[Any], root: RootMotion | None, weights: Mapping[str, AnyExpr]
) -> System:
    """System of `beam`; all its symbols must be of the kind of the `weights`."""
    loads = sequence("loads", loads)
    root = instance("root", RootMotion() if root is None else root, RootMotion)
    to_parent, attitude = _adjoint(beam.root), root.pose.rotation
    parent = ParentMotion(
        to_parent @ root.twist, to_parent @ root.twist_rate, attitude.T @ _gravity(loads, root)
    )
    return in_parent(beam, loads, parent, attitude, {**weights, **root.symbols})


def in_parent(
    beam: Beam,
    loads: Sequence[Any],
    parent: ParentMotion,
    attitude: AnyExpr,
    symbols: Mapping[str, AnyExpr],
) -> System:
    """System of `beam` in a moving parent, whose `attitude` takes its axes to inertial ones.

    Gravity is that of `parent`; what `loads` have of it is left out.
    """
    if any(isinstance(load, SteadyRotation) for load in loads):
        raise ValueError(
            "loads: expected no SteadyRotation in dynamics, where inertial forces are those of the "
            "motion of the root; give its twist instead"
        )
    mesh = inertial_mesh(beam, loads)
    inertias = station_inertias(beam, mesh)
    others = [load for load in loads if not isinstance(load, Gravity)]
    applied = station_loads(beam, others, mesh, attitude)
    coupled = couplings(beam, others, mesh, attitude)
    acting = {
        f"loads at xi = {xi:g}": data
        for xi, station in zip(mesh.stations, applied, strict=True)
        for _, data in station
    }
    acting |= {"loads": ca.vertcat(*(part for c in coupled for part in (c.data, *c.own)))}
    inertia = {"the inertia of Beam.section and Beam.bodies": ca.vertcat(*inertias.data)}
    gravity = {"gravity": parent.gravity}
    same_kind(**symbols, **beam.design_symbols, **inertia, **gravity, **acting)
    beam_chain = chain.build(beam, mesh.stations.tolist(), boundaries=mesh.stations)
    return System(beam, beam_chain, inertias, tuple(applied), tuple(coupled), parent)


def _adjoint(pose: Pose) -> AnyExpr:
    return se3.adjoint(se3.matrix(pose.rotation, pose.position))


def _gravity(loads: Sequence[Any], root: RootMotion) -> AnyExpr:
    accelerations = [load.acceleration for load in loads if isinstance(load, Gravity)]
    if root.gravity is not None:
        if accelerations:
            raise ValueError(
                "loads: expected no Gravity beside RootMotion.gravity, which would count it twice"
            )
        accelerations = [root.gravity]
    return sum(accelerations, ca.DM.zeros(3))
