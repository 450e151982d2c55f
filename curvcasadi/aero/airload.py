"""Quasi-steady strip aerodynamics as a load on a beam, alone or with induced flow.

A strip at pose (R, p), parent axes, moves relative to the air with V = Rᵀ (v + ω × p − wind), and
turns with Ω = Rᵀ ω, local axes. Its forces are those of `section` in steady motion: circulation
follows at once, u_e = u, or as the lifting line of the wing lets it, and of the apparent mass there
is the moment −π ρ b³/2 V_y Ω_x, as of a camber. Rotations are not approximated; the velocity along
the span does nothing.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import NamedTuple

import casadi as ca
import numpy as np

from curvcasadi.aero import section
from curvcasadi.aero.induced import LiftingLine
from curvcasadi.aero.induced_load import (
    Followed,
    LineOnWing,
    line_on_wing,
    refuse_tip_loss,
)
from curvcasadi.aero.section import SectionData
from curvcasadi.aero.stations import air_stations, section_data
from curvcasadi.aero.strip import StripAerodynamics
from curvcasadi.beam.beam import Beam
from curvcasadi.beam.pose import unpack_pose
from curvcasadi.kinematics.shape import poses
from curvcasadi.loads.coupling import Coupling
from curvcasadi.loads.formulas import WrenchFormula
from curvcasadi.loads.stations import Contributions, Load, Mesh
from curvcasadi.symbolic.expressions import (
    AnyExpr,
    Array,
    Number,
    expression,
    instance,
    own_fields,
    positive,
    rotation_matrix,
    station as checked_station,
)


@dataclass(frozen=True, eq=False, kw_only=True)
class Flow:
    """The air, and the motion of the parent frame through it. Fields may be symbols.

    Attributes
    ----------
    density : float or symbol
        Density of the air, kg/m³.
    velocity : array or symbol, shape (3,)
        Velocity of the parent's origin, m/s, parent axes.
    angular_rate : array or symbol, shape (3,)
        Angular rate of the parent frame, rad/s, parent axes.
    wind : array or symbol, shape (3,)
        Velocity of the air, m/s, inertial axes.
    """

    density: Number
    velocity: Number = (0.0, 0.0, 0.0)
    angular_rate: Number = (0.0, 0.0, 0.0)
    wind: Number = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        positive("Flow.density", self.density, zero=True)
        for name in ("velocity", "angular_rate", "wind"):
            value = expression(f"Flow.{name}", getattr(self, name), (3, 1))
            object.__setattr__(self, name, value)


def strip_wrench(rotation: AnyExpr, position: AnyExpr, data: AnyExpr) -> AnyExpr:
    """Wrench (moment, force), (6, 1), about the parent origin, of `strip_data`."""
    velocity, omega, strip = _moving(rotation, position, data)
    u = section.circulation(velocity, omega, strip).velocity
    local = _steady_wrench(velocity, omega, strip, u, u)
    return _about_parent(rotation, position, local)


def induced_wrench(rotation: AnyExpr, position: AnyExpr, data: AnyExpr) -> AnyExpr:
    """The same of u_e, m/s, followed by `strip_data`."""
    velocity, omega, strip = _moving(rotation, position, data[1:])
    u = section.circulation(velocity, omega, strip).velocity
    local = _steady_wrench(velocity, omega, strip, u, data[0])
    return _about_parent(rotation, position, local)


def _moving(
    rotation: AnyExpr, position: AnyExpr, data: AnyExpr
) -> tuple[AnyExpr, AnyExpr, SectionData]:
    velocity, rate, strip = ca.vertsplit(data, [0, 3, 6, 6 + section.SIZE])
    through_air = rotation.T @ (velocity + ca.cross(rate, position))
    return through_air, rotation.T @ rate, section.unpack(strip)


def _steady_wrench(
    velocity: AnyExpr, omega: AnyExpr, strip: SectionData, u: AnyExpr, u_e: AnyExpr
) -> AnyExpr:
    """Wrench of a strip whose velocity and angular rate are constant in its axes."""
    rest = ca.DM.zeros(3)
    apparent = section.apparent_wrench(velocity, omega, rest, rest, strip)
    return section.circulatory_wrench(velocity, omega, strip, u, u_e) + apparent


def _about_parent(rotation: AnyExpr, position: AnyExpr, local: AnyExpr) -> AnyExpr:
    force = rotation @ local[3:]
    return ca.vertcat(rotation @ local[:3] + ca.cross(position, force), force)


@dataclass(frozen=True, eq=False, kw_only=True)
class AerodynamicLoad(Load):
    """Airloads on a beam: quasi-steady, strip by strip, with the induced flow of a lifting line.

    Attributes
    ----------
    strips : StripAerodynamics
        Airfoil data along the span.
    flow : Flow
        The air, and the motion of the parent frame.
    deflections : mapping of str to float or symbol
        Deflections of control surfaces by name, rad; others are zero.
    induced_flow : LiftingLine or None
        Without one every strip is on its own.
    """

    strips: StripAerodynamics
    flow: Flow
    deflections: Mapping[str, Number] = field(default_factory=dict)
    induced_flow: LiftingLine | None = None

    wrench = staticmethod(strip_wrench)

    def __post_init__(self) -> None:
        own_fields(self)
        for name, kind in (("strips", StripAerodynamics), ("flow", Flow)):
            instance(f"AerodynamicLoad.{name}", getattr(self, name), kind)
        for name, angle in self.deflections.items():
            if name not in self.strips.inputs:
                raise ValueError(
                    f"AerodynamicLoad.deflections: expected names of "
                    f"{self.strips.inputs or 'no control surface'}, found {name!r}"
                )
            expression(f"AerodynamicLoad.deflections[{name!r}]", angle, (1, 1))
        if self.induced_flow is not None:
            instance("AerodynamicLoad.induced_flow", self.induced_flow, LiftingLine)
        refuse_tip_loss(self.strips, self.induced_flow)

    @property
    def points(self) -> tuple[float, ...]:
        """Stations at which the airloads act, s/L."""
        return tuple(station.xi for station in air_stations(self.strips))

    def is_distributed(self, beam: Beam) -> bool:
        """Airloads are integrated at stations of their own."""
        return False

    def contributions(self, beam: Beam, mesh: Mesh, to_parent: AnyExpr) -> Contributions:
        """Data of `strip_wrench`, unless the strips are coupled."""
        if self.induced_flow is None:
            for xi, weight in air_stations(self.strips):
                yield mesh.node(xi), strip_data(self, xi, weight * beam.length, to_parent)

    def coupling(self, beam: Beam, mesh: Mesh, to_parent: AnyExpr) -> Coupling | None:
        """Strips whose circulation the lifting line determines."""
        if self.induced_flow is None:
            return None
        stations = air_stations(self.strips)
        line = _on_wing(self.induced_flow, self, beam, to_parent, self.points)
        return Coupling(
            nodes=tuple(mesh.node(xi) for xi in self.points),
            function=line.followed,
            data=line.data,
            formula=WrenchFormula(induced_wrench),
            own=tuple(strip_data(self, xi, w * beam.length, to_parent) for xi, w in stations),
            slopes=line.slopes,
        )


def strip_data(load: AerodynamicLoad, xi: float, measure: Number, to_parent: AnyExpr) -> AnyExpr:
    """What `strip_wrench` takes of `measure` m of span at `xi`.

    v − wind (3) and ω (3), parent axes, and `SectionData`.
    """
    flow = load.flow
    strip = section_data(
        load.strips, xi, load.deflections, density=flow.density, measure=measure, apparent=1.0
    )
    return ca.vertcat(flow.velocity - to_parent @ flow.wind, flow.angular_rate, strip.pack())


def _on_wing(
    line: LiftingLine,
    load: AerodynamicLoad,
    beam: Beam,
    to_parent: AnyExpr,
    wanted: Sequence[float],
) -> LineOnWing:
    """The lifting line of a load; u_e is that of the stations `wanted`."""
    flow = load.flow
    velocity = flow.velocity - to_parent @ flow.wind
    follows = Followed(through=velocity, motion=(velocity, flow.angular_rate))
    return line_on_wing(line, beam, load.strips, load.deflections, follows, wanted)


def wash_of(load: AerodynamicLoad, beam: Beam, to_parent: AnyExpr) -> LineOnWing:
    """The lifting line of a load, for the flow that it induces off the wing."""
    line = instance("AerodynamicLoad.induced_flow", load.induced_flow, LiftingLine)
    return _on_wing(line, load, beam, to_parent, load.points)


class StripForces(NamedTuple):
    """Airloads along the span, a column per station.

    Attributes
    ----------
    xi : array, shape (N,)
        Stations s/L.
    angle_of_attack : SX, MX or DM, shape (1, N)
        Angle of attack of the section, rad, in the air that the wing leaves alone.
    lift : SX, MX or DM, shape (1, N)
        Lift per length, N/m, normal to the local velocity in the section plane.
    drag : SX, MX or DM, shape (1, N)
        Drag per length, N/m, along that velocity; that of the induced flow included.
    moment : SX, MX or DM, shape (1, N)
        Moment per length, N, nose-up about the aerodynamic centre.
    induced_angle : SX, MX or DM, shape (1, N)
        Angle that the induced flow adds, rad; below zero for a downwash.
    weights : array or None, shape (N,)
        Of an integral over s/L: `length * lift @ weights` is the lift of a wing in N. None where
        `strip_forces` was given `stations`, which need not integrate anything.
    """

    xi: Array
    angle_of_attack: AnyExpr
    lift: AnyExpr
    drag: AnyExpr
    moment: AnyExpr
    induced_angle: AnyExpr
    weights: Array | None = None


def strip_forces(
    beam: Beam,
    q: AnyExpr,
    load: AerodynamicLoad,
    attitude: AnyExpr | None = None,
    *,
    stations: Sequence[float] | None = None,
) -> StripForces:
    """Airloads per length along the span of a shape.

    Parameters
    ----------
    beam : Beam
        The wing.
    q : SX, MX, DM or array, shape (n, 1)
        Weights, rad/m.
    load : AerodynamicLoad
        The airloads.
    attitude : SX, MX, DM or array, shape (3, 3), optional
        Parent to inertial axes, for the wind; None if these agree.
    stations : sequence of float, optional
        Where the airloads are wanted, s/L; those at which they are integrated unless given.

    Returns
    -------
    StripForces
        Of the kind of `q`.
    """
    q = expression("q", q, (beam.basis.n, 1))
    wanted = load.points if stations is None else [checked_station("stations", x) for x in stations]
    to_parent = ca.DM.eye(3) if attitude is None else rotation_matrix("attitude", attitude).T
    frames = [pose.packed for pose in poses(beam, q, [*load.points, *wanted])]
    count = len(load.points)
    followed = [None] * len(wanted)
    if load.induced_flow is not None:
        line = _on_wing(load.induced_flow, load, beam, to_parent, wanted)
        followed = ca.horzsplit(line.followed(ca.horzcat(*frames[:count]), line.data))
    columns = []
    for xi, frame, u_e in zip(wanted, frames[count:], followed, strict=True):
        data = strip_data(load, xi, 1.0, to_parent)
        given = [frame, data] if u_e is None else [frame, data, u_e]
        columns.append(_strip(u_e is not None)(*given))
    along = [ca.horzcat(*row) for row in zip(*columns, strict=True)]
    weights = None if stations is not None else np.array([w for _, w in air_stations(load.strips)])
    return StripForces._make([np.array(wanted), *along, weights])


@cache
def _strip(induced: bool) -> ca.Function:
    """(pose, data, u_e where `induced`) -> angle of attack, lift, drag, moment, induced angle."""
    pose, data, u_e = ca.SX.sym("pose", 12), ca.SX.sym("data", 6 + section.SIZE), ca.SX.sym("u_e")
    velocity, omega, strip = _moving(*unpack_pose(pose), data)
    followed = section.circulation(velocity, omega, strip)
    gained = u_e if induced else followed.velocity
    wrench = _steady_wrench(velocity, omega, strip, followed.velocity, gained)
    ahead, up = velocity[1], strip.upper * velocity[2]
    speed, angle = section.speed_and_angle(ahead, up)
    still = ca.if_else(speed > 0, speed, 1)
    forward, upward = wrench[4], strip.upper * wrench[5]
    outputs = [
        angle,
        (ahead * upward - up * forward) / still,
        -(ahead * forward + up * upward) / still,
        strip.upper * (wrench[0] - strip.center * wrench[5]),
        (gained - followed.velocity) / still,
    ]
    inputs = [pose, data, u_e][: 2 + induced]
    return ca.Function("strip", inputs, outputs, {"cse": True})
