"""Forces of one strip from the motion of its section through the air.

Everything is in local axes at the reference curve: V the velocity of the section relative to the
air, Ω its angular velocity; `upper` = ±1 says on which side of the airfoil z stands, c = 2 b is the
chord, and stations along y are the aerodynamic centre y_ac, the middle y_ac − c/4 and the three
quarter point y_ac − c/2. With V3 = V_z + Ω_x (y_ac − c/2) and W² = V_y² + V3²,

    u = W (atan2(−upper V3, V_y) − zero_lift_angle + Σ lift δ/lift_slope)

is the velocity that the circulation follows; u_e, what it has followed of it so far (lag states,
induced flow). Per length, with k = ½ ρ c lift_slope and u_s = u_e − ½ b upper Ω_x,

    F_z = upper k V_y u_e,      F_y = suction k (−upper V3 u_e + u_s² − u_e u)

at the aerodynamic centre, F_y the suction at the leading edge; drag ½ ρ c c_d W (−V_y, −V_z); the
moment upper ½ ρ c² (c_m W² + moment_slope u_e W). Apparent mass at the middle of the chord:

    F_z = −π ρ b² d(V_z,mid)/dt,      M_x = −½ π ρ b³ V_y Ω_x − ⅛ π ρ b⁴ dΩ_x/dt

with the rate of the component, a − Ω × V. For u_e = u and no rotation this is lift ½ ρ c c_l W²
normal to the flow. No approximation is made for large rotations or angles.
"""

from __future__ import annotations

from typing import NamedTuple

import casadi as ca
import numpy as np

from curvcasadi.symbolic.expressions import AnyExpr


class SectionData(NamedTuple):
    """What the forces take of one strip; `pack` stacks it."""

    upper: AnyExpr  #: +1 where local z points out of the upper side, else −1
    pressure: AnyExpr  #: ½ ρ c times the span of the strip, kg/m
    chord: AnyExpr  #: c, m
    center: AnyExpr  #: y_ac, m
    slope: AnyExpr  #: of the lift, 1/rad
    shift: AnyExpr  #: −zero_lift_angle + Σ lift δ/lift_slope, rad
    drag: AnyExpr  #: c_d
    moment: AnyExpr  #: c_m without angle of attack, nose-up
    moment_slope: AnyExpr  #: of c_m, 1/rad
    suction: AnyExpr  #: part of the leading-edge suction that is there
    apparent: AnyExpr  #: part of the apparent mass that is there

    def pack(self) -> AnyExpr:
        """The entries as a column, (11, 1)."""
        return ca.vertcat(*self)


#: Entries of `SectionData`.
SIZE = len(SectionData._fields)


def unpack(data: AnyExpr) -> SectionData:
    """The entries of a column (11, 1) that `SectionData.pack` made."""
    return SectionData(*ca.vertsplit(data))


class Circulation(NamedTuple):
    """What the circulation of a strip follows."""

    speed: AnyExpr  #: W, m/s
    angle: AnyExpr  #: atan2(−upper V3, V_y), rad
    velocity: AnyExpr  #: u, m/s


def circulation(velocity: AnyExpr, omega: AnyExpr, data: SectionData) -> Circulation:
    """W, the angle of attack at three quarters of the chord, and u.

    Parameters
    ----------
    velocity, omega : SX, MX or DM, shape (3, 1)
        Of the section relative to the air, m/s and rad/s, local axes.
    data : SectionData
        Of the strip.
    """
    v3 = data.upper * (velocity[2] + omega[0] * (data.center - data.chord / 2))
    speed, angle = speed_and_angle(velocity[1], v3)
    return Circulation(speed, angle, speed * (angle + data.shift))


def gust_velocity(velocity: AnyExpr, omega: AnyExpr, gust: AnyExpr, data: SectionData) -> AnyExpr:
    """What a gust adds to the velocity u of a strip once the strip is in it as a whole, m/s.

    Parameters
    ----------
    velocity, omega : SX, MX or DM, shape (3, 1)
        Of the section relative to the air without the gust, m/s and rad/s, local axes.
    gust : SX, MX or DM, shape (3, 1)
        Velocity of the air in the gust, m/s, local axes.
    data : SectionData
        Of the strip.
    """
    inside = circulation(velocity - gust, omega, data).velocity
    return inside - circulation(velocity, omega, data).velocity


def speed_and_angle(v2: AnyExpr, v3: AnyExpr) -> tuple[AnyExpr, AnyExpr]:
    """W = √(V2² + V3²) and α = atan2(−V3, V2), by double-where.

    √ and atan2 have no derivative in still air, where forces, of degree two in V, are zero with
    zero derivative: neither branch is singular, and W = 0 takes the derivative away.
    """
    still = v2**2 + v3**2 <= 0
    ahead, up = ca.if_else(still, 1, v2), ca.if_else(still, 0, v3)
    speed = ca.if_else(still, 0, ca.sqrt(ahead**2 + up**2))
    return speed, ca.atan2(-up, ahead)


def circulatory_wrench(
    velocity: AnyExpr, omega: AnyExpr, data: SectionData, u: AnyExpr, u_e: AnyExpr
) -> AnyExpr:
    """Lift, suction, drag and moment of a strip as a wrench about the reference curve.

    Parameters
    ----------
    velocity, omega : SX, MX or DM, shape (3, 1)
        Of the section relative to the air, m/s and rad/s, local axes.
    data : SectionData
        Of the strip.
    u, u_e : SX, MX or DM, scalar
        The velocity that the circulation follows, and what it has followed so far, m/s.

    Returns
    -------
    SX, MX or DM, shape (6, 1)
        Moment and force, N m and N, local axes.
    """
    upper, k = data.upper, data.pressure * data.slope
    ahead, up = velocity[1], velocity[2]
    lateral = omega[0] * (data.center - data.chord / 2)
    speed, _ = speed_and_angle(ahead, up + lateral)
    u_s = u_e - data.chord / 4 * upper * omega[0]
    suction = data.suction * k * (-upper * (up + lateral) * u_e + u_s**2 - u_e * u)
    drag = data.pressure * data.drag * speed
    force = ca.vertcat(0, suction - drag * ahead, upper * k * ahead * u_e - drag * up)
    pitch = data.moment * speed**2 + data.moment_slope * u_e * speed
    moment = upper * data.pressure * data.chord * pitch + data.center * force[2]
    return ca.vertcat(moment, 0, -data.center * force[0], force)


def apparent_wrench(
    velocity: AnyExpr,
    omega: AnyExpr,
    velocity_rate: AnyExpr,
    omega_rate: AnyExpr,
    data: SectionData,
) -> AnyExpr:
    """Apparent mass of a strip as a wrench about the reference curve.

    Parameters
    ----------
    velocity, omega : SX, MX or DM, shape (3, 1)
        Of the section relative to the air, m/s and rad/s, local axes.
    velocity_rate, omega_rate : SX, MX or DM, shape (3, 1)
        Rates of their components, m/s² and rad/s².
    data : SectionData
        Of the strip.

    Returns
    -------
    SX, MX or DM, shape (6, 1)
        Moment and force, N m and N, local axes.
    """
    half = data.chord / 2
    middle = data.center - half / 2
    mass = data.apparent * np.pi * half * data.pressure  # π ρ b² times the span of the strip
    force = -mass * (velocity_rate[2] + omega_rate[0] * middle)
    damping = half / 2 * velocity[1] * omega[0] + half**2 / 8 * omega_rate[0]
    return ca.vertcat(middle * force - mass * damping, 0, 0, 0, 0, force)
