"""The equations of motion of a clamped wing in a stream, with structured derivatives."""

from __future__ import annotations

from typing import Any

import casadi as ca

from curvcasadi.aero.apparent_mass import apparent_mass_matrix
from curvcasadi.aero.state_rates import state_rates
from curvcasadi.aero.unsteady import UnsteadyAirload
from curvcasadi.aircraft.parts import Wing
from curvcasadi.control.damping import damping_matrix
from curvcasadi.control.model import SecondOrder
from curvcasadi.dynamics import inverse_dynamics, inverse_dynamics_function, mass_matrix
from curvcasadi.dynamics.inertia import inertial_mesh
from curvcasadi.kinematics.root_motion import RootMotion
from curvcasadi.statics.energy import stiffness_matrix
from curvcasadi.symbolic.derivatives import with_jacobian
from curvcasadi.symbolic.expressions import Array, Number
from curvcasadi.symbolic.functions import free_symbols, identities
from curvcasadi.symbolic.layout import Layout


def forces_function(
    name: str, wing: Wing, loads: list[Any], symbols: dict[str, ca.MX], root: RootMotion
) -> ca.Function:
    """q, q_dot, q_ddot, symbols … -> residual of the equations of motion."""
    beam, n = wing.beam, wing.beam.basis.n
    known = set(identities(symbols.values()))
    if not set(identities(beam.design_symbols.values())) <= known:
        missing = next(key for key, value in beam.design_symbols.items() if free_symbols(value, []))
        raise ValueError(f"{missing}: expected numbers or parameters, found a symbol")
    if not beam.design_symbols:
        return inverse_dynamics_function(beam, loads, symbols, root=root, name=name)
    q, q_dot, q_ddot = (ca.MX.sym(key, n) for key in ("q", "q_dot", "q_ddot"))
    residual = inverse_dynamics(beam, q, q_dot, q_ddot, loads, root)
    inputs = {"q": q, "q_dot": q_dot, "q_ddot": q_ddot, **symbols}
    return ca.Function(name, [*inputs.values()], [residual], [*inputs], ["residual"])


def equations(
    name: str,
    wing: Wing,
    forces: ca.Function,
    rates: ca.Function | None,
    load: UnsteadyAirload,
    design: dict[str, ca.MX],
    layouts: tuple[Layout, Layout, Layout],
    damping: Number,
) -> SecondOrder:
    """The equations of motion from the Functions of forces and of the rates of lag states."""
    x_layout, u_layout, p_layout = layouts
    beam, n = wing.beam, wing.beam.basis.n
    x, a = ca.MX.sym("x", x_layout.size), ca.MX.sym("acceleration", n)
    u, p = ca.MX.sym("u", u_layout.size), ca.MX.sym("p", p_layout.size)
    state, values = x_layout.split(x), p_layout.split(p)
    others = [state["lag"]] if "lag" in state else []
    others += [*u_layout.split(u).values(), *values.values()]
    loads = [load, *wing.loads]
    q = ca.MX.sym("q", n)
    made = ca.MX(ca.densify(stiffness_matrix(beam)))
    masses = mass_matrix(beam, q, loads) + apparent_mass_matrix(
        beam, q, load, inertial_mesh(beam, loads).stations
    )
    matrices = ca.Function(
        "matrices",
        [q, *design.values()],
        [ca.densify(x) for x in (masses, damping_matrix(damping, n, made), made)],
    )
    mass, matrix, stiffness = matrices(state["q"], *(values[key] for key in design))
    balance = forces(state["q"], state["q_dot"], a, *others)
    balance += matrix @ state["q_dot"]
    changes = ca.MX(0, 1) if rates is None else rates(state["q"], state["q_dot"], *others)
    return SecondOrder(
        configuration=1,
        velocities=n,
        kinematics=ca.Function(f"{name}_kinematics", [x], [state["q_dot"]], ["x"], ["rate"]),
        balance=ca.Function(
            f"{name}_balance",
            [x, a, u, p],
            [balance, changes],
            ["x", "acceleration", "u", "p"],
            ["balance", "other_rates"],
        ),
        matrices=ca.Function(
            f"{name}_matrices",
            [x, p],
            [mass, matrix, stiffness],
            ["x", "p"],
            ["mass", "damping", "stiffness"],
        ),
    )


def rates_function(
    name: str,
    wing: Wing,
    load: UnsteadyAirload,
    attitude: ca.MX,
    boundaries: Array,
    symbols: dict[str, ca.MX],
) -> ca.Function:
    """q, q_dot, states, inputs, parameters -> rates of the states, with structured derivatives."""
    n = wing.beam.basis.n
    q, q_dot = ca.MX.sym("q", n), ca.MX.sym("q_dot", n)
    stacked = ca.veccat(*symbols.values())
    value = state_rates(wing.beam, q, q_dot, load, attitude.T, boundaries).value
    missing = free_symbols(value, [q, q_dot, stacked])
    if missing:
        raise ValueError(f"wing: expected numbers, found the symbols {', '.join(missing)}")
    if wing.beam.design_symbols:  # of geometry there is AD alone
        inputs = {"q": q, "q_dot": q_dot, **symbols}
        return ca.Function(name, [*inputs.values()], [value], [*inputs], ["rates"])
    found = state_rates(wing.beam, q, q_dot, load, attitude.T, boundaries, stacked)
    slopes = ca.horzcat(found.by_weights, found.by_rates, found.by_parameters)
    return with_jacobian(
        name, {"q": q, "q_dot": q_dot, **symbols}, {"rates": value}, {"rates": slopes}
    )
