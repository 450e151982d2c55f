"""Small models with inertia whose motion is known by other means: oracles of the integrators."""

from __future__ import annotations

import casadi as ca
import numpy as np

import curvcasadi as cc
from curvcasadi.lie import quaternion

INERTIA = np.diag([1.0, 2.0, 3.5])
MASS = 4.0


def _model(name, x, u, p, symbols, xdot, second_order):
    names = ["x", "u", "p"]
    return cc.ControlModel(
        name=name,
        x=x,
        u=u,
        p=p,
        y=cc.Layout(()),
        xdot=ca.Function(f"{name}_xdot", symbols, [xdot], names, ["xdot"]),
        output=ca.Function(f"{name}_output", symbols, [ca.SX(0, 1)], names, ["y"]),
        second_order=second_order,
    )


def _second_order(
    name, symbols, acceleration, kinematics, balance, rates, mass, *, stiffness, damping, **fields
):
    x, u, p = symbols
    matrices = [mass, ca.DM(damping), ca.DM(stiffness)]
    return cc.SecondOrder(
        kinematics=ca.Function(f"{name}_kinematics", [x], [kinematics], ["x"], ["rate"]),
        balance=ca.Function(
            f"{name}_balance",
            [x, acceleration, u, p],
            [balance, rates],
            ["x", "acceleration", "u", "p"],
            ["balance", "other_rates"],
        ),
        matrices=ca.Function(
            f"{name}_matrices", [x, p], matrices, ["x", "p"], ["mass", "damping", "stiffness"]
        ),
        velocities=acceleration.numel(),
        **fields,
    )


def pendulum(stiffness: float = 400.0, damping: float = 0.0) -> cc.ControlModel:
    """An elastic pendulum with a lag: x = (angle θ, stretch s, rates, lag), input: a moment.

    M = diag((1 + s)², 1), gravity p, a moment u + lag; the lag follows the angle at 3/s.
    """
    x, u, p, a = ca.SX.sym("x", 5), ca.SX.sym("u"), ca.SX.sym("p"), ca.SX.sym("a", 2)
    angle, s, w, v, lag = ca.vertsplit(x)
    mass = ca.diag(ca.vertcat((1 + s) ** 2, 1))
    force = ca.vertcat(
        -2 * (1 + s) * v * w - (1 + s) * p * ca.sin(angle) + u + lag,
        (1 + s) * w**2 + p * ca.cos(angle) - stiffness * s - damping * v,
    )
    rates = 3 * (angle - lag)
    xdot = ca.vertcat(w, v, force / ca.vertcat((1 + s) ** 2, 1), rates)
    motion = _second_order(
        "pendulum",
        (x, u, p),
        a,
        ca.vertcat(w, v),
        mass @ a - force,
        rates,
        mass,
        configuration=1,
        stiffness=np.diag([0, stiffness]),
        damping=np.diag([0, damping]),
    )
    layout = cc.Layout(
        (cc.Part("configuration", 2, "1"), cc.Part("rates", 2, "1/s"), cc.Part("lag", 1, "1"))
    )
    u_layout, p_layout = (cc.Layout((cc.Part(n, 1, "1"),)) for n in ("moment", "gravity"))
    return _model("pendulum", layout, u_layout, p_layout, [x, u, p], xdot, motion)


def rigid_body() -> cc.ControlModel:
    """A free rigid body with a point mass on a spring along its x axis; no loads.

    x = (quaternion, position, s, body rate Ω, body velocity V of the body's centre, s_dot). The
    spring's mass of 1 kg sits at (1 + s) e_x, stiffness 100 N/m.
    """
    x, a = ca.SX.sym("x", 15), ca.SX.sym("a", 7)
    u, p = ca.SX(0, 1), ca.SX(0, 1)
    attitude, _, s, omega, velocity, rate = ca.vertsplit(x, [0, 4, 7, 8, 11, 14, 15])
    e = ca.DM([1, 0, 0])
    arm = (1 + s) * e
    hat = ca.skew
    # Velocity of the mass: V + Ω × arm + s_dot e.
    jacobian = ca.horzcat(-hat(arm), ca.DM.eye(3), e)
    mass = jacobian.T @ jacobian + ca.diagcat(INERTIA, MASS * np.eye(3), 0)
    drift = (
        ca.cross(omega, velocity)
        + ca.cross(omega, ca.cross(omega, arm))
        + 2 * rate * ca.cross(omega, e)
    )
    bias = jacobian.T @ drift + ca.vertcat(
        ca.cross(omega, INERTIA @ omega), MASS * ca.cross(omega, velocity), 100 * s
    )
    kinematics = ca.vertcat(omega, quaternion.rotation(attitude) @ velocity, rate)
    xdot = ca.vertcat(quaternion.rate(attitude, omega), kinematics[3:], ca.solve(mass, -bias))
    motion = _second_order(
        "rigid_body",
        (x, u, p),
        a,
        kinematics,
        mass @ a + bias,
        ca.SX(0, 1),
        mass,
        configuration=3,
        stiffness=np.diag([0, 0, 0, 0, 0, 0, 100.0]),
        damping=np.zeros((7, 7)),
    )
    layout = cc.Layout(
        (
            cc.Part("quaternion_wxyz", 4, "1", attitude=True),
            cc.Part("position", 3, "m"),
            cc.Part("s", 1, "m"),
            cc.Part("twist", 6, "rad/s, m/s"),
            cc.Part("s_dot", 1, "m/s"),
        )
    )
    empty = cc.Layout(())
    return _model("rigid_body", layout, empty, empty, [x, u, p], xdot, motion)


def momentum(x):
    """Linear and angular momentum (6,) of `rigid_body` in inertial axes, and its energy."""
    x = np.asarray(x).ravel()
    rotation = quaternion.rotation(ca.DM(x[:4])).full()
    position, s, omega, velocity, rate = x[4:7], x[7], x[8:11], x[11:14], x[14]
    arm = np.array([1 + s, 0, 0])
    of_mass = velocity + np.cross(omega, arm) + [rate, 0, 0]
    linear = rotation @ (MASS * velocity + of_mass)
    spin = rotation @ (INERTIA @ omega + np.cross(arm, of_mass))
    energy = (
        omega @ INERTIA @ omega + MASS * velocity @ velocity + of_mass @ of_mass + 100 * s**2
    ) / 2
    return np.concatenate([linear, spin + np.cross(position, linear)]), energy
