"""The equations of motion of a clamped wing in a stream, with structured derivatives."""

from __future__ import annotations

import casadi as ca

from curvcasadi.aero.air_states import decays
from curvcasadi.aero.apparent_mass import apparent_mass_matrix
from curvcasadi.aero.unsteady import UnsteadyAirload
from curvcasadi.aircraft.parts import Wing
from curvcasadi.control.damping import damping_matrix
from curvcasadi.control.model import SecondOrder
from curvcasadi.dynamics import inverse, mass_matrix, system
from curvcasadi.dynamics.functions import balance_function
from curvcasadi.dynamics.inertia import inertial_mesh
from curvcasadi.kinematics.root_motion import RootMotion
from curvcasadi.statics.energy import stiffness_matrix
from curvcasadi.symbolic.expressions import Number
from curvcasadi.symbolic.functions import free_symbols, identities
from curvcasadi.symbolic.layout import Layout


def forces_function(
    name: str,
    wing: Wing,
    load: UnsteadyAirload,
    symbols: dict[str, ca.MX],
    root: RootMotion,
) -> ca.Function:
    """q, q_dot, q_ddot, symbols … -> residual of the equations of motion, rates of lag states."""
    beam, n = wing.beam, wing.beam.basis.n
    loads, projection = [load, *wing.loads], load.parts.projection
    known = set(identities(symbols.values()))
    if not set(identities(beam.design_symbols.values())) <= known:
        missing = next(key for key, value in beam.design_symbols.items() if free_symbols(value, []))
        raise ValueError(f"{missing}: expected numbers or parameters, found a symbol")
    if not beam.shaping_symbols:
        return balance_function(beam, loads, projection, symbols, root=root, name=name)
    weights = {key: ca.MX.sym(key, n) for key in ("q", "q_dot", "q_ddot")}
    inputs = {**weights, **symbols}
    found = inverse.balance(system.build(beam, loads, root, inputs), *weights.values())
    outputs = {"residual": found.residual, "rates": ca.DM(projection) @ found.rates}
    return ca.Function(name, [*inputs.values()], [*outputs.values()], [*inputs], [*outputs])


def equations(
    name: str,
    wing: Wing,
    forces: ca.Function,
    load: UnsteadyAirload,
    design: dict[str, ca.MX],
    layouts: tuple[Layout, Layout, Layout],
    damping: Number,
) -> SecondOrder:
    """The equations of motion from the Function of forces and of the rates of lag states."""
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
    chords = [load.strips.at("chord", xi) for xi in load.points]
    per_metre = ca.MX(decays([*load.parts.lag, *load.parts.entry], load.parts.sizes, chords))
    of_design = ca.Function("decays", [*design.values()], [per_metre])
    rates = values["airspeed"] * of_design.call([values[key] for key in design])[0]
    balance, changes = forces(state["q"], state["q_dot"], a, *others)
    balance += matrix @ state["q_dot"]
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
        decays=ca.Function(f"{name}_decays", [x, p], [rates], ["x", "p"], ["decays"]),
    )
