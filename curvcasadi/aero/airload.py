"""Steady strip aerodynamics as a load on a beam.

A strip at pose (R, p), parent axes, moves relative to the air with V = Rᵀ (v + ω × p − wind), local
axes. With V3 counted to the upper side, W² = V2² + V3² and α = atan2(−V3, V2):

    lift  ½ ρ c c_l W²  along (−V3, V2)/W,      drag  ½ ρ c c_d W²  along −(V2, V3)/W

per length in the section plane, at the aerodynamic centre, and the moment ½ ρ c² c_m W² nose-up.
Rotations are not approximated; the velocity along the span does nothing.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from typing import NamedTuple

import casadi as ca
import numpy as np

from curvcasadi.aero.strip import StripAerodynamics, coefficients
from curvcasadi.beam.beam import Beam
from curvcasadi.beam.pose import unpack_pose
from curvcasadi.kinematics.shape import poses
from curvcasadi.loads.stations import (
    Contributions,
    Load,
    Mesh,
    loaded_mesh,
    sites,
)
from curvcasadi.symbolic.expressions import (
    AnyExpr,
    Number,
    expression,
    own_fields,
    positive,
    rotation_matrix,
)


@dataclass(frozen=True, eq=False, kw_only=True)
class Flow:
    """The air, and the motion of the parent frame through it. Fields may be symbols."""

    density: Number  #: kg/m³
    velocity: Number = (0.0, 0.0, 0.0)  #: of the parent's origin, (3,), m/s, parent axes
    angular_rate: Number = (0.0, 0.0, 0.0)  #: of the parent frame, (3,), rad/s, parent axes
    wind: Number = (0.0, 0.0, 0.0)  #: velocity of the air, (3,), m/s, inertial axes

    def __post_init__(self) -> None:
        own_fields(self)
        positive("Flow.density", self.density, zero=True)
        for name in ("velocity", "angular_rate", "wind"):
            value = expression(f"Flow.{name}", getattr(self, name), (3, 1))
            object.__setattr__(self, name, value)


def strip_wrench(rotation: AnyExpr, position: AnyExpr, data: AnyExpr) -> AnyExpr:
    """Wrench (moment, force), (6, 1), about the parent origin, of `strip_data`."""
    upper, center = data[6], data[8]
    strip = _in_section(rotation, position, data)
    force = rotation @ ca.vertcat(0, strip.force[0], upper * strip.force[1])
    arm = position + center * rotation[:, 1]
    return ca.vertcat(ca.cross(arm, force) + upper * strip.moment * rotation[:, 0], force)


@dataclass(frozen=True, eq=False, kw_only=True)
class AerodynamicLoad(Load):
    """Airloads on a beam: quasi-steady, strip by strip."""

    strips: StripAerodynamics
    flow: Flow
    deflections: Mapping[str, Number] = field(default_factory=dict)  #: rad; others are zero

    wrench = staticmethod(strip_wrench)

    def __post_init__(self) -> None:
        own_fields(self)
        for name, kind in (("strips", StripAerodynamics), ("flow", Flow)):
            if not isinstance(getattr(self, name), kind):
                raise ValueError(
                    f"AerodynamicLoad.{name}: expected a {kind.__name__}, "
                    f"found {getattr(self, name)!r}"
                )
        for name, angle in self.deflections.items():
            if name not in self.strips.inputs:
                raise ValueError(
                    f"AerodynamicLoad.deflections: expected names of "
                    f"{self.strips.inputs or 'no control surface'}, found {name!r}"
                )
            expression(f"AerodynamicLoad.deflections[{name!r}]", angle, (1, 1))

    @property
    def breaks(self) -> tuple[float, ...]:
        """Stations at which the airfoil data jump."""
        return self.strips.breaks

    def contributions(self, beam: Beam, mesh: Mesh, to_parent: AnyExpr) -> Contributions:
        for site in sites(beam, mesh):
            yield site.node, strip_data(self, site.xi, site.measure, to_parent)


def strip_data(load: AerodynamicLoad, xi: float, measure: Number, to_parent: AnyExpr) -> AnyExpr:
    """What `strip_wrench` takes of `measure` m of span at `xi`: 13 numbers.

    v − wind (3) and ω (3), parent axes, upper side, ½ ρ c measure, aerodynamic centre, c_l per α,
    c_l at α = 0, c_d, and c_m c.
    """
    flow = load.flow
    chord, center, slope, lift, drag, moment = ca.vertsplit(
        coefficients(load.strips, xi, load.deflections)
    )
    return ca.vertcat(
        flow.velocity - to_parent @ flow.wind,
        flow.angular_rate,
        load.strips.upper_side,
        flow.density * chord * measure / 2,
        center,
        slope,
        lift,
        drag,
        moment * chord,
    )


class _InSection(NamedTuple):
    angle: AnyExpr  #: α, rad
    lift: AnyExpr  #: N
    drag: AnyExpr  #: N
    force: AnyExpr  #: (2, 1), N: to the leading edge, to the upper side
    moment: AnyExpr  #: N m, nose-up


def _in_section(rotation: AnyExpr, position: AnyExpr, data: AnyExpr) -> _InSection:
    velocity, rate, rest = ca.vertsplit(data, [0, 3, 6, 13])
    upper, pressure, _, slope, lift_at_zero, drag, moment = ca.vertsplit(rest)
    local = rotation.T @ (velocity + ca.cross(rate, position))
    v2, v3 = local[1], upper * local[2]
    speed, angle = _speed_and_angle(v2, v3)
    lift = slope * angle + lift_at_zero
    along = pressure * speed * (lift * ca.vertcat(-v3, v2) - drag * ca.vertcat(v2, v3))
    scale = pressure * speed**2
    return _InSection(angle, scale * lift, scale * drag, along, scale * moment)


def _speed_and_angle(v2: AnyExpr, v3: AnyExpr) -> tuple[AnyExpr, AnyExpr]:
    """W = √(V2² + V3²) and α = atan2(−V3, V2), by double-where.

    √ and atan2 have no derivative in still air, where forces, of degree two in V, are zero with
    zero derivative: neither branch is singular, and W = 0 takes the derivative away.
    """
    still = v2**2 + v3**2 <= 0
    ahead, up = ca.if_else(still, 1, v2), ca.if_else(still, 0, v3)
    speed = ca.if_else(still, 0, ca.sqrt(ahead**2 + up**2))
    return speed, ca.atan2(-up, ahead)


class StripForces(NamedTuple):
    """Airloads along the span, a column per quadrature node; at a break one for each side."""

    xi: np.ndarray  #: (N,)
    angle_of_attack: AnyExpr  #: (1, N), rad
    lift: AnyExpr  #: (1, N), N/m, normal to the local velocity in the section plane
    drag: AnyExpr  #: (1, N), N/m, along it
    moment: AnyExpr  #: (1, N), N, nose-up about the aerodynamic centre


def strip_forces(
    beam: Beam, q: AnyExpr, load: AerodynamicLoad, attitude: AnyExpr | None = None
) -> StripForces:
    """Airloads per length along the span of the shape `q` (n, 1), rad/m.

    Parameters
    ----------
    attitude : (3, 3), parent to inertial axes, for the wind; None if these agree
    """
    q = expression("q", q, (beam.basis.n, 1))
    mesh = loaded_mesh(beam, [load])
    frames = poses(beam, q, mesh.stations.tolist())
    to_parent = ca.DM.eye(3) if attitude is None else rotation_matrix("attitude", attitude).T
    columns = []
    for site in sites(beam, mesh):
        frame = frames[site.node]
        data = strip_data(load, site.xi, 1.0, to_parent)
        columns.append(_strip()(frame.packed, data))
    xi = np.array([site.xi for site in sites(beam, mesh)])
    return StripForces(xi, *(ca.horzcat(*row) for row in zip(*columns, strict=True)))


@cache
def _strip() -> ca.Function:
    """(state, data) -> angle of attack, lift, drag, moment."""
    state, data = ca.SX.sym("state", 12), ca.SX.sym("data", 13)
    strip = _in_section(*unpack_pose(state), data)
    outputs = [strip.angle, strip.lift, strip.drag, strip.moment]
    return ca.Function("strip", [state, data], outputs, {"cse": True})
