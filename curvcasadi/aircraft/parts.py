"""A flexible aircraft: a rigid body with flexible wings, rigid lifting surfaces and thrust.

Positions are in body axes (x forward, y right, z down); the parent frame of every wing is the body.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import casadi as ca

from curvcasadi.aero import Flow, StripAerodynamics, mirror_aero
from curvcasadi.aero.sides import with_upper_side
from curvcasadi.beam.beam import Beam
from curvcasadi.beam.mirror import mirror
from curvcasadi.beam.pose import Pose, checked_pose
from curvcasadi.beam.section import rigid_inertia
from curvcasadi.loads.kinds import Gravity
from curvcasadi.symbolic.expressions import (
    AnyExpr,
    Number,
    expression,
    own_fields,
    positive,
    sequence,
    unit_vector,
)
from curvcasadi.symbolic.text import described, shown


@dataclass(frozen=True, eq=False, kw_only=True)
class RigidBody:
    """What is rigid of the aircraft, wings and their bodies excluded.

    Attributes
    ----------
    mass : float or symbol
        Mass, kg.
    center_of_mass : array or symbol, shape (3,)
        Centre of mass, m, body axes.
    inertia : array, symbol or None, shape (3, 3)
        Inertia about the centre of mass, kg m², body axes; steady flight needs none.
    """

    mass: Number
    center_of_mass: Number
    inertia: Number | None = None

    def __post_init__(self) -> None:
        own_fields(self)
        positive("RigidBody.mass", self.mass)
        center = expression("RigidBody.center_of_mass", self.center_of_mass, (3, 1))
        object.__setattr__(self, "center_of_mass", center)
        if self.inertia is not None:
            object.__setattr__(self, "inertia", rigid_inertia("RigidBody.inertia", self.inertia))


@dataclass(frozen=True, eq=False, kw_only=True)
class NoBody(RigidBody):
    """In the place of a rigid body: nothing. The beams of such an aircraft fly alone.

    The body axes are those in which the roots of the beams are given.

    Attributes
    ----------
    mass, center_of_mass, inertia
        Zero.
    """

    mass: Number = field(default=0.0, init=False)
    center_of_mass: Number = field(default_factory=lambda: ca.DM.zeros(3), init=False)
    inertia: Number = field(default_factory=lambda: ca.DM.zeros(3, 3), init=False)

    def __post_init__(self) -> None:
        """Nothing to check."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Thrust:
    """A force along a line that is fixed in the body; its magnitude, N, is an input.

    Attributes
    ----------
    name : str
        Name of the input that is its magnitude, N.
    position : array or symbol, shape (3,)
        A point of the line, m, body axes.
    direction : array or symbol, shape (3,)
        Unit vector, body axes.
    """

    name: str = "thrust"
    position: Number = (0.0, 0.0, 0.0)
    direction: Number = (1.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        own_fields(self)
        position = expression("Thrust.position", self.position, (3, 1))
        object.__setattr__(self, "position", position)
        direction = unit_vector("Thrust.direction", self.direction)
        object.__setattr__(self, "direction", direction)


@dataclass(frozen=True, eq=False, kw_only=True)
class LiftingSurface:
    """A rigid lifting surface, such as a tail: one strip of the whole area.

    Local axes as those of a wing: x along the span, y to the leading edge. The airfoil data are
    taken at xi = 0.5. The downwash of the wings is that of their induced flow, where they have one.

    Attributes
    ----------
    name : str
        Name of the surface.
    area : float or symbol
        Area, m².
    pose : Pose
        Pose, in body axes, of the point ahead of which the aerodynamic centre lies.
    strips : StripAerodynamics
        Airfoil data. Their upper side, unless given, is that of local z of the pose.
    """

    name: str
    area: Number
    pose: Pose
    strips: StripAerodynamics

    def __post_init__(self) -> None:
        positive("LiftingSurface.area", self.area)
        _is("LiftingSurface.strips", self.strips, StripAerodynamics)
        object.__setattr__(self, "pose", checked_pose("LiftingSurface.pose", self.pose))
        owner, rotation = f"the surface {self.name!r}", self.pose.rotation
        object.__setattr__(self, "strips", with_upper_side(owner, self.strips, rotation))


@dataclass(frozen=True, eq=False, kw_only=True)
class Wing:
    """A flexible half wing: a beam whose parent frame is the body, and what acts on it.

    Attributes
    ----------
    name : str
        Name of the wing.
    beam : Beam
        The beam, with a section.
    strips : StripAerodynamics, optional
        Airfoil data along the span; without them no airloads act. Their upper side, unless given,
        is that of local z of the root.
    loads : tuple of loads
        Further loads; weight and airloads act anyway.
    """

    name: str
    beam: Beam
    strips: StripAerodynamics | None = None
    loads: tuple[Any, ...] = ()

    def __post_init__(self) -> None:
        _is("Wing.beam", self.beam, Beam)
        if self.strips is not None:
            _is("Wing.strips", self.strips, StripAerodynamics)
        object.__setattr__(self, "loads", sequence("Wing.loads", self.loads))
        if any(isinstance(load, Gravity) for load in self.loads):
            raise ValueError("Wing.loads: expected loads beside the weight, found Gravity")
        if not self.name.isidentifier():
            raise ValueError(f"Wing.name: expected letters and digits, found {self.name!r}")
        if self.beam.section is None:
            raise ValueError(f"Wing {self.name!r}: expected a beam with a section, found None")
        if self.strips is not None:
            owner, rotation = f"the wing {self.name!r}", self.beam.root.rotation
            object.__setattr__(self, "strips", with_upper_side(owner, self.strips, rotation))


def mirror_wing(wing: Wing, name: str) -> Wing:
    """The other half wing, with beam and airfoil data mirrored.

    Parameters
    ----------
    wing : Wing
        One half wing, without further loads.
    name : str
        Name of the other one.

    Returns
    -------
    Wing
        The other half wing.
    """
    if wing.loads:
        raise ValueError(f"mirror_wing: expected no further loads, found {len(wing.loads)}")
    strips = None if wing.strips is None else mirror_aero(wing.strips)
    return Wing(name=name, beam=mirror(wing.beam), strips=strips)


@dataclass(frozen=True, eq=False, kw_only=True)
class Aircraft:
    """A rigid body, flexible wings, rigid lifting surfaces and thrusts.

    Attributes
    ----------
    body : RigidBody
        What is rigid, wings excluded; `NoBody()` where beams fly alone.
    beams : tuple of Wing
        Flexible half wings.
    surfaces : tuple of LiftingSurface
        Rigid lifting surfaces.
    thrusts : tuple of Thrust
        Forces along fixed lines.
    """

    body: RigidBody
    beams: tuple[Wing, ...]
    surfaces: tuple[LiftingSurface, ...] = ()
    thrusts: tuple[Thrust, ...] = ()

    def __post_init__(self) -> None:
        _is("Aircraft.body", self.body, RigidBody)
        for key, kind in (("beams", Wing), ("surfaces", LiftingSurface), ("thrusts", Thrust)):
            parts = tuple(getattr(self, key))
            object.__setattr__(self, key, parts)
            for i, part in enumerate(parts):
                _is(f"Aircraft.{key}[{i}]", part, kind)
            names = [part.name for part in parts]
            if len(set(names)) < len(names):
                raise ValueError(f"Aircraft.{key}: expected different names, found {names}")
        rigid = ["weight", *(s.name for s in self.surfaces), *(t.name for t in self.thrusts)]
        if len(set(rigid)) < len(rigid):
            raise ValueError(
                "Aircraft: expected different names of surfaces and thrusts, and none of them "
                f"'weight'; found {rigid[1:]}"
            )
        for thrust in self.thrusts:
            if thrust.name in self._deflections:
                raise ValueError(
                    f"Aircraft.thrusts: {thrust.name!r} is the name of a control surface, too"
                )

    def __repr__(self) -> str:
        wings, surfaces = ([part.name for part in parts] for parts in (self.beams, self.surfaces))
        return f"<Aircraft: wings {wings}, surfaces {surfaces}>"

    def __str__(self) -> str:
        body = self.body
        rows = {"body": f"{shown(body.mass, 'kg')} at {shown(body.center_of_mass, 'm')}, body axes"}
        rows |= {f"wing {wing.name}": f"{wing.beam!r}"[1:-1] for wing in self.beams}
        for surface in self.surfaces:
            at = shown(surface.pose.position, "m")
            rows[f"surface {surface.name}"] = f"{shown(surface.area, 'm²')} at {at}"
        rows["inputs"] = (
            ", ".join(f"{name}, {unit}" for name, unit in self.inputs.items()) or "none"
        )
        return described("Aircraft", rows)

    @property
    def inputs(self) -> dict[str, str]:
        """Names of the inputs and their units: thrusts, then deflections."""
        units = {thrust.name: "N" for thrust in self.thrusts}
        return {**units, **{name: "rad" for name in self._deflections}}

    @property
    def _deflections(self) -> tuple[str, ...]:
        parts: list[Any] = [*self.beams, *self.surfaces]
        strips = [part.strips for part in parts if part.strips is not None]
        return tuple(dict.fromkeys(name for airfoils in strips for name in airfoils.inputs))


@dataclass(frozen=True, eq=False, kw_only=True)
class Flight:
    """A state of steady flight. Fields may be symbols.

    Attributes
    ----------
    flow : Flow
        The air, and the motion of the body through it.
    attitude : array or symbol, shape (3, 3)
        Rotation from body to inertial axes (north, east, down).
    gravity : float or symbol
        Acceleration of gravity, m/s², down.
    """

    flow: Flow
    attitude: Number
    gravity: Number

    @property
    def acceleration(self) -> AnyExpr:
        """Acceleration of gravity (3, 1), m/s², inertial axes."""
        return ca.vertcat(0, 0, self.gravity)


def _is(name: str, value: Any, kind: type) -> None:
    if not isinstance(value, kind):
        raise ValueError(f"{name}: expected a {kind.__name__}, found {value!r}")
