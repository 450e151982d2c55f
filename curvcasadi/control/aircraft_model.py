"""A flexible aircraft in free flight as a control model."""

from __future__ import annotations

import casadi as ca

from curvcasadi.aircraft.free_flight import (
    STANDARD_GRAVITY,
    free_inverse_dynamics,
    free_mass_matrix,
    free_momenta,
)
from curvcasadi.aircraft.parts import Aircraft
from curvcasadi.control.model import ControlModel, SecondOrder
from curvcasadi.control.second_order import second_order_model
from curvcasadi.kinematics.pose_function import tip_function
from curvcasadi.lie import quaternion
from curvcasadi.statics.energy import stiffness_matrix
from curvcasadi.symbolic.expressions import instance, is_numeric, numbers, positive
from curvcasadi.symbolic.layout import Layout, Part


def aircraft_model(
    aircraft: Aircraft,
    *,
    density: float,
    gravity: float = STANDARD_GRAVITY,
    damping: float = 0.0,
    name: str = "aircraft",
) -> ControlModel:
    """A rigid body with flexible wings that flies freely, without air.

    The state is the attitude of the body axes (a unit quaternion, body to inertial axes), the
    position of the body origin (north, east, down), q of each wing, the body twist (rad/s, m/s) at
    the body origin, and q_dot of each wing. The inputs are the thrusts, N. The outputs are the tip
    position of each wing, body axes, m.

    Parameters
    ----------
    aircraft : Aircraft
        With the inertia of its body, and mass in its wings.
    density : float
        Density of the air, kg/m³: zero. Airloads of free flight are not modelled; of a wing on its
        own they are, by `wing_model`.
    gravity : float
        m/s², down.
    damping : float
        Time β of stiffness-proportional damping of the wings, C = β S, s.
    name : str
        Name of the model and of its Functions.

    Returns
    -------
    ControlModel
        With its equations of motion and momenta in `second_order`.

    Raises
    ------
    ValueError
        If the density is not zero, a field holds a symbol, or as `free_inverse_dynamics`.
    """
    instance("aircraft", aircraft, Aircraft)
    if not is_numeric(density) or float(numbers("density", density)) != 0:
        raise ValueError(f"density: expected 0, as free flight has no airloads, found {density}")
    beta = positive("damping", damping, zero=True)
    wings = aircraft.beams
    sizes = [wing.beam.basis.n for wing in wings]
    configuration = [Part("quaternion_wxyz", 4, "1", attitude=True), Part("position", 3, "m")]
    configuration += [
        Part(f"q_{w.name}", n, "rad/m", *w.beam.bounds) for w, n in zip(wings, sizes, strict=True)
    ]
    velocities = [Part("twist", 6, "rad/s, m/s")]
    velocities += [
        Part(f"q_dot_{w.name}", n, "rad/(m s)") for w, n in zip(wings, sizes, strict=True)
    ]
    x_layout = Layout((*configuration, *velocities))
    u_layout = Layout(tuple(Part(thrust.name, 1, "N") for thrust in aircraft.thrusts))
    nv = 6 + sum(sizes)

    x, a = ca.MX.sym("x", x_layout.size), ca.MX.sym("acceleration", nv)
    u, p = ca.MX.sym("u", u_layout.size), ca.MX.sym("p", 0)
    parts = x_layout.split(x)
    q = ca.vertcat(*(parts[f"q_{wing.name}"] for wing in wings))
    velocity = ca.vertcat(*(parts[part.name] for part in velocities))
    rotation = quaternion.rotation(parts["quaternion_wxyz"])
    stiffness = ca.diagcat(ca.DM(6, 6), *(ca.DM(stiffness_matrix(wing.beam)) for wing in wings))
    left = free_inverse_dynamics(
        aircraft,
        q,
        velocity,
        a,
        attitude=rotation,
        inputs=u_layout.split(u),
        gravity=gravity,
    )
    momenta = free_momenta(aircraft, q, velocity)
    names = ["x", "acceleration", "u", "p"]
    rate = ca.vertcat(velocity[:3], rotation @ velocity[3:6], velocity[6:])
    matrices = [free_mass_matrix(aircraft, q), ca.densify(beta * stiffness), ca.densify(stiffness)]
    motion = SecondOrder(
        configuration=len(configuration),
        velocities=nv,
        kinematics=ca.Function(f"{name}_kinematics", [x], [rate], ["x"], ["rate"]),
        balance=ca.Function(
            f"{name}_balance",
            [x, a, u, p],
            [left + beta * (stiffness @ velocity), ca.MX(0, 1)],
            names,
            ["balance", "other_rates"],
        ),
        matrices=ca.Function(
            f"{name}_matrices", [x, p], matrices, ["x", "p"], ["mass", "damping", "stiffness"]
        ),
        momenta=ca.Function(
            f"{name}_momenta",
            [x],
            [momenta.velocities, ca.vertcat(ca.MX.zeros(6), momenta.by_shape)],
            ["x"],
            ["momenta", "by_configuration"],
        ),
    )
    tips = {
        f"tip_{wing.name}": tip_function(wing.beam)(parts[f"q_{wing.name}"])[0] for wing in wings
    }
    y_layout = Layout(tuple(Part(key, 3, "m") for key in tips))
    output = ca.Function(f"{name}_output", [x, u, p], [y_layout.join(tips)], ["x", "u", "p"], ["y"])
    return second_order_model(
        name=name,
        x=x_layout,
        u=u_layout,
        p=Layout(()),
        y=y_layout,
        motion=motion,
        output=output,
        real=wings[0].beam.grid.real,
    )
