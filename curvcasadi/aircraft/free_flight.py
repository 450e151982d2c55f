"""Free flight of a flexible aircraft: a rigid body and several beams that move with it.

The configuration is the attitude (3, 3), body to inertial axes, the position of the body origin,
and the weights q of the wings in order. The velocities are the body twist V at the body origin and
the rates q_dot, in one vector (6 + n, 1); accelerations are the rates of these components. The rows
of the equations of motion are the moment and the force on the whole aircraft about the body origin,
body axes, and the forces on the weights:

    [ I   C ] [ dV/dt ]
    [ Cᵀ  M ] [ q_ddot ]  + bias + S q = loads

Gravity is an acceleration −g of the body. There is no air: airloads are loads of a wing.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import casadi as ca

from curvcasadi.aircraft.free_motion import (
    WingLoads,
    at_rest,
    body_wrench,
    free_motion,
    offsets_of,
    thrust_wrench,
    weights_of,
)
from curvcasadi.aircraft.parts import Aircraft
from curvcasadi.dynamics import inertia, inverse, mass, momentum
from curvcasadi.loads.kinds import STANDARD_GRAVITY
from curvcasadi.statics.energy import strain_energy
from curvcasadi.symbolic import ldl
from curvcasadi.symbolic.expressions import AnyExpr, Number, expression


class FlightMomenta(NamedTuple):
    """Momenta of an aircraft, and the derivative of its kinetic energy by the weights.

    Attributes
    ----------
    velocities : SX, MX or DM, shape (6 + n, 1)
        Derivative of the kinetic energy by the velocities.
    by_shape : SX, MX or DM, shape (n, 1)
        Its derivative by q at fixed velocities.
    """

    velocities: AnyExpr
    by_shape: AnyExpr


def free_inverse_dynamics(
    aircraft: Aircraft,
    q: AnyExpr,
    velocity: AnyExpr,
    acceleration: AnyExpr,
    *,
    attitude: AnyExpr | None = None,
    inputs: Mapping[str, Number] | None = None,
    gravity: Number = STANDARD_GRAVITY,
    loads: WingLoads | None = None,
) -> AnyExpr:
    """Residual of the equations of motion of free flight; zero along motions of the aircraft.

    Parameters
    ----------
    aircraft : Aircraft
        With the inertia of its body, and mass in its wings.
    q : SX, MX, DM or array, shape (n, 1)
        Weights of all wings in order, rad/m.
    velocity : SX, MX, DM or array, shape (6 + n, 1)
        Body twist (rad/s, m/s) and q_dot, rad/(m s).
    acceleration : SX, MX, DM or array, shape (6 + n, 1)
        Rates of the components of `velocity`.
    attitude : SX, MX, DM or array, shape (3, 3), optional
        Body to inertial axes (north, east, down); equal unless given.
    inputs : mapping of str to number or symbol, optional
        Thrusts by name, N; others are zero.
    gravity : number or symbol
        m/s², down.
    loads : mapping of str to sequence of loads, optional
        Further loads by the name of the wing, beside `Wing.loads`.

    Returns
    -------
    SX, MX or DM, shape (6 + n, 1)
        Moment, N m, and force, N, about the body origin in body axes; then N m² for each weight.
    """
    flight = free_motion(aircraft, q, velocity, acceleration, attitude, gravity, loads)
    wrench = body_wrench(flight.body, flight.parent) - thrust_wrench(aircraft, inputs or {})
    residuals = []
    for wing in flight.wings:
        found = inverse.balance(wing.system, wing.q, wing.q_dot, wing.q_ddot)
        wrench = wrench + inverse.parent_wrench(wing.system, found)
        residuals.append(found.residual)
    return ca.vertcat(wrench, *residuals)


def free_mass_matrix(aircraft: Aircraft, q: AnyExpr) -> AnyExpr:
    """Mass matrix of free flight, (6 + n, 6 + n), symmetric: [[I, C], [Cᵀ, M]].

    Parameters
    ----------
    aircraft, q
        As for `free_inverse_dynamics`.

    Returns
    -------
    SX, MX or DM, shape (6 + n, 6 + n)
        The kinetic energy is ½ velocityᵀ M velocity.
    """
    flight = at_rest(aircraft, q)
    blocks = [mass.mass_blocks(wing.system, wing.q) for wing in flight.wings]
    body = inertia.momentum(inertia.unpack(flight.body), ca.DM.eye(6))
    whole = sum((block.parent for block in blocks), body)
    coupling = ca.horzcat(*(block.coupling for block in blocks))
    weights = ca.diagcat(*(block.weights for block in blocks))
    return ca.densify(
        ca.vertcat(ca.horzcat(whole, coupling), ca.horzcat(coupling.T, ca.densify(weights)))
    )


def free_forward_dynamics(
    aircraft: Aircraft,
    q: AnyExpr,
    velocity: AnyExpr,
    *,
    attitude: AnyExpr | None = None,
    inputs: Mapping[str, Number] | None = None,
    gravity: Number = STANDARD_GRAVITY,
    loads: WingLoads | None = None,
) -> AnyExpr:
    """Accelerations (6 + n, 1) of free flight under loads that do not depend on accelerations.

    Parameters
    ----------
    aircraft, q, velocity, attitude, inputs, gravity, loads
        As for `free_inverse_dynamics`.

    Returns
    -------
    SX, MX or DM, shape (6 + n, 1)
        Rates of the components of `velocity`.
    """
    size = 6 + weights_of(aircraft)
    rest = ca.DM.zeros(size)
    for wing in free_motion(aircraft, q, velocity, rest, attitude, gravity, loads).wings:
        wing.system.refuse_accelerations()
    bias = free_inverse_dynamics(
        aircraft,
        q,
        velocity,
        rest,
        attitude=attitude,
        inputs=inputs,
        gravity=gravity,
        loads=loads,
    )
    triangle = ldl.upper_triangle(free_mass_matrix(aircraft, q))
    return ldl.ldl_solve(size)(triangle, -bias)


def free_momenta(aircraft: Aircraft, q: AnyExpr, velocity: AnyExpr) -> FlightMomenta:
    """Momenta of free flight, the derivatives of the kinetic energy by the velocities.

    The first six are the angular and linear momentum about the body origin in body axes: turned to
    inertial axes and moved to a fixed point they are constant where no loads act.

    Parameters
    ----------
    aircraft, q, velocity
        As for `free_inverse_dynamics`.

    Returns
    -------
    FlightMomenta
        Momenta, and the derivative of the kinetic energy by q. Both structured: no AD of an energy.
    """
    size = 6 + weights_of(aircraft)
    flight = free_motion(aircraft, q, velocity, ca.DM.zeros(size), None, 0.0, None)
    total = inertia.momentum(inertia.unpack(flight.body), flight.twist)
    parts = [momentum.momenta(wing.system, wing.q, wing.q_dot) for wing in flight.wings]
    total = sum((part.parent for part in parts), total)
    return FlightMomenta(
        ca.vertcat(total, *(part.weights for part in parts)),
        ca.vertcat(*(part.by_shape for part in parts)),
    )


def free_kinetic_energy(aircraft: Aircraft, q: AnyExpr, velocity: AnyExpr) -> AnyExpr:
    """Kinetic energy of free flight.

    Parameters
    ----------
    aircraft, q, velocity
        As for `free_momenta`.

    Returns
    -------
    SX, MX or DM, shape (1, 1)
        Kinetic energy, J.
    """
    size = 6 + weights_of(aircraft)
    velocity = expression("velocity", velocity, (size, 1))
    return ca.dot(velocity, free_momenta(aircraft, q, velocity).velocities) / 2


def free_strain_energy(aircraft: Aircraft, q: AnyExpr) -> AnyExpr:
    """Strain energy of all wings.

    Parameters
    ----------
    aircraft, q
        As for `free_momenta`.

    Returns
    -------
    SX, MX or DM, shape (1, 1)
        Strain energy, J.
    """
    q = expression("q", q, (weights_of(aircraft), 1))
    parts: Any = ca.vertsplit(q, offsets_of(aircraft))
    return sum(strain_energy(w.beam, part) for w, part in zip(aircraft.beams, parts, strict=True))
