"""A flexible aircraft: a rigid body with flexible wings, rigid lifting surfaces and thrust.

Positions, forces and moments are in body axes (x forward, y right, z down), moments about the body
origin; the parent frame of every wing is the body. In steady flight the wrenches of all parts
balance, and every wing is in equilibrium.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca

from curvcasadi.aero import AerodynamicLoad, Flow, StripAerodynamics, mirror_aero
from curvcasadi.aero.airload import strip_data, strip_wrench
from curvcasadi.beam.beam import Beam
from curvcasadi.beam.mirror import mirror
from curvcasadi.beam.pose import Pose
from curvcasadi.beam.section import symmetric
from curvcasadi.loads.kinds import Gravity
from curvcasadi.statics.balance import Balance, balance, parameter_slopes
from curvcasadi.symbolic.expressions import (
    AnyExpr,
    Number,
    expression,
    is_numeric,
    positive,
    rotation_matrix,
)
from curvcasadi.symbolic.functions import free_symbols


@dataclass(frozen=True, eq=False, kw_only=True)
class RigidBody:
    """What is rigid of the aircraft, wings and their bodies excluded."""

    mass: Number  #: kg
    center_of_mass: Number  #: (3,), m, body axes
    inertia: Number | None = None  #: (3, 3) about the centre of mass, kg m²; steady flight has none

    def __post_init__(self) -> None:
        positive("RigidBody.mass", self.mass)
        center = expression("RigidBody.center_of_mass", self.center_of_mass, (3, 1))
        object.__setattr__(self, "center_of_mass", center)
        if self.inertia is not None:
            symmetric("RigidBody.inertia", self.inertia)


@dataclass(frozen=True, eq=False, kw_only=True)
class Thrust:
    """A force along a line that is fixed in the body; its magnitude, N, is an input."""

    name: str = "thrust"  #: of the input
    position: Number = (0.0, 0.0, 0.0)  #: (3,), m, body axes
    direction: Number = (1.0, 0.0, 0.0)  #: (3,), unit vector, body axes

    def __post_init__(self) -> None:
        for name in ("position", "direction"):
            value = expression(f"Thrust.{name}", getattr(self, name), (3, 1))
            object.__setattr__(self, name, value)
        if is_numeric(self.direction) and abs(float(ca.norm_2(self.direction)) - 1) > 1e-6:
            raise ValueError(f"Thrust.direction: expected a unit vector, found {self.direction}")


@dataclass(frozen=True, eq=False, kw_only=True)
class LiftingSurface:
    """A rigid lifting surface, such as a tail: one strip of the whole area.

    Local axes as those of a wing: x along the span, y to the leading edge. The airfoil data are
    taken at xi = 0.5; interference with the wing (downwash) is not modelled.
    """

    name: str
    area: Number  #: m²
    pose: Pose  #: of the point ahead of which the aerodynamic centre lies; body axes
    strips: StripAerodynamics

    def __post_init__(self) -> None:
        positive("LiftingSurface.area", self.area)
        for name, kind in (("pose", Pose), ("strips", StripAerodynamics)):
            _is(f"LiftingSurface.{name}", getattr(self, name), kind)
        rotation_matrix("LiftingSurface.pose.rotation", self.pose.rotation)


@dataclass(frozen=True, eq=False, kw_only=True)
class Wing:
    """A flexible half wing: a beam whose parent frame is the body, and what acts on it."""

    name: str
    beam: Beam
    strips: StripAerodynamics
    loads: tuple[Any, ...] = ()  #: further loads; weight and airloads are there anyway

    def __post_init__(self) -> None:
        for name, kind in (("beam", Beam), ("strips", StripAerodynamics)):
            _is(f"Wing.{name}", getattr(self, name), kind)
        object.__setattr__(self, "loads", tuple(self.loads))
        if any(isinstance(load, Gravity) for load in self.loads):
            raise ValueError("Wing.loads: expected loads beside the weight, found Gravity")
        if not self.name.isidentifier():
            raise ValueError(f"Wing.name: expected letters and digits, found {self.name!r}")
        if self.beam.section is None:
            raise ValueError(f"Wing {self.name!r}: expected a beam with a section, found None")


def mirror_wing(wing: Wing, name: str) -> Wing:
    """The other half wing: beam and airfoil data mirrored. Further loads are not."""
    if wing.loads:
        raise ValueError(f"mirror_wing: expected no further loads, found {len(wing.loads)}")
    return Wing(name=name, beam=mirror(wing.beam), strips=mirror_aero(wing.strips))


@dataclass(frozen=True, eq=False, kw_only=True)
class Aircraft:
    """A rigid body, flexible wings, rigid lifting surfaces and thrusts."""

    body: RigidBody
    beams: tuple[Wing, ...]
    surfaces: tuple[LiftingSurface, ...] = ()
    thrusts: tuple[Thrust, ...] = ()

    def __post_init__(self) -> None:
        _is("Aircraft.body", self.body, RigidBody)
        for field, kind in (("beams", Wing), ("surfaces", LiftingSurface), ("thrusts", Thrust)):
            parts = tuple(getattr(self, field))
            object.__setattr__(self, field, parts)
            for i, part in enumerate(parts):
                _is(f"Aircraft.{field}[{i}]", part, kind)
            names = [part.name for part in parts]
            if len(set(names)) < len(names):
                raise ValueError(f"Aircraft.{field}: expected different names, found {names}")
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

    @property
    def inputs(self) -> dict[str, str]:
        """Names of the inputs and their units: thrusts, then deflections."""
        units = {thrust.name: "N" for thrust in self.thrusts}
        return {**units, **{name: "rad" for name in self._deflections}}

    @property
    def _deflections(self) -> tuple[str, ...]:
        strips = [wing.strips for wing in self.beams] + [s.strips for s in self.surfaces]
        return tuple(dict.fromkeys(name for airfoils in strips for name in airfoils.inputs))


@dataclass(frozen=True, eq=False, kw_only=True)
class Flight:
    """A state of steady flight. Fields may be symbols."""

    flow: Flow
    attitude: Number  #: (3, 3), body to inertial axes (north, east, down)
    gravity: Number  #: m/s², down

    @property
    def acceleration(self) -> AnyExpr:
        """Acceleration of gravity (3, 1), m/s², inertial axes."""
        return ca.vertcat(0, 0, self.gravity)


def wing_loads(wing: Wing, flight: Flight, inputs: Mapping[str, Number]) -> list[Any]:
    """Loads on a wing in flight: airloads, weight where it has mass, and its further loads."""
    deflections = {name: inputs.get(name, 0.0) for name in wing.strips.inputs}
    airloads = AerodynamicLoad(strips=wing.strips, flow=flight.flow, deflections=deflections)
    section: Any = wing.beam.section
    heavy = section.mass_per_length is not None or wing.beam.bodies
    weight = [Gravity(flight.acceleration)] if heavy else []
    return [airloads, *weight, *wing.loads]


def wing_balance(
    wing: Wing, q: AnyExpr, flight: Flight, inputs: Mapping[str, Number], *, tangent: bool = False
) -> Balance:
    """Equilibrium residual of a wing, and the wrench that it hands on to the body."""
    loads = wing_loads(wing, flight, inputs)
    return balance(wing.beam, q, loads, flight.attitude, tangent=tangent)


def rigid_wrenches(
    aircraft: Aircraft, flight: Flight, inputs: Mapping[str, Number]
) -> dict[str, AnyExpr]:
    """Wrenches (moment, force), (6, 1), on the rigid parts by name; body axes, N m and N."""
    body = aircraft.body
    down = flight.attitude.T @ flight.acceleration
    wrenches = {"weight": _at(body.center_of_mass, body.mass * down)}
    for thrust in aircraft.thrusts:
        force = inputs.get(thrust.name, 0.0) * thrust.direction
        wrenches[thrust.name] = _at(thrust.position, force)
    for surface in aircraft.surfaces:
        strips = surface.strips
        deflections = {name: inputs.get(name, 0.0) for name in strips.inputs}
        load = AerodynamicLoad(strips=strips, flow=flight.flow, deflections=deflections)
        chord = strips.chord(0.5) if callable(strips.chord) else strips.chord
        data = strip_data(load, 0.5, surface.area / chord, flight.attitude.T)
        wrenches[surface.name] = strip_wrench(surface.pose.rotation, surface.pose.position, data)
    return wrenches


def aircraft_wrench(
    aircraft: Aircraft,
    q: Mapping[str, AnyExpr],
    flight: Flight,
    inputs: Mapping[str, Number],
) -> AnyExpr:
    """Sum of all wrenches (moment, force), (6, 1), about the body origin, body axes, N m and N.

    Parameters
    ----------
    q : weights (n, 1), rad/m, by the name of the wing
    inputs : thrusts, N, and deflections, rad, by name; others are zero
    """
    unknown = sorted(set(inputs) - set(aircraft.inputs))
    if unknown:
        raise ValueError(f"inputs: expected names of {[*aircraft.inputs]}, found {unknown}")
    total = sum(rigid_wrenches(aircraft, flight, inputs).values())
    for wing in aircraft.beams:
        total = total + wing_balance(wing, q[wing.name], flight, inputs).wrench
    return total


def wing_function(
    wing: Wing, flight: Flight, inputs: Mapping[str, Number], y: ca.MX
) -> ca.Function:
    """`wing_balance` as a Function with its structured derivatives: q, y -> residual, wrench.

    Parameters
    ----------
    y : (m, 1) MX symbol of which `flight` and `inputs` are made
    """
    q = ca.MX.sym("q", wing.beam.basis.n)
    if wing.beam.design_symbols:
        raise ValueError(f"Wing {wing.name!r}: expected numbers, found symbols in its beam")
    loads = wing_loads(wing, flight, inputs)
    value = balance(wing.beam, q, loads, flight.attitude)
    missing = free_symbols(ca.vertcat(value.residual, value.wrench), [q, y])
    if missing:
        raise ValueError(f"Wing {wing.name!r}: expected numbers, found {', '.join(missing)}")
    return ca.Function(
        f"balance_{wing.name}",
        [q, y],
        [value.residual, value.wrench],
        ["q", "y"],
        ["residual", "wrench"],
        {
            "cse": True,
            "custom_jacobian": _wing_jacobian(wing, flight, loads, q, y),
            "jac_penalty": 0,
            "never_inline": True,
        },
    )


def _wing_jacobian(
    wing: Wing, flight: Flight, loads: Sequence[Any], q: ca.MX, y: ca.MX
) -> ca.Function:
    by_q = balance(wing.beam, q, loads, flight.attitude, tangent=True)
    residual_by_y, wrench_by_y = parameter_slopes(wing.beam, q, loads, y, flight.attitude)
    return ca.Function(
        f"jac_balance_{wing.name}",
        [q, y, ca.MX.sym("out_residual", q.shape[0]), ca.MX.sym("out_wrench", 6)],
        [
            ca.densify(block)
            for block in (by_q.residual_slope, residual_by_y, by_q.wrench_slope, wrench_by_y)
        ],
        ["q", "y", "out_residual", "out_wrench"],
        ["jac_residual_q", "jac_residual_y", "jac_wrench_q", "jac_wrench_y"],
        {"cse": True},
    )


def _at(position: AnyExpr, force: AnyExpr) -> AnyExpr:
    return ca.vertcat(ca.cross(position, force), force)


def _is(name: str, value: Any, kind: type) -> None:
    if not isinstance(value, kind):
        raise ValueError(f"{name}: expected a {kind.__name__}, found {value!r}")
