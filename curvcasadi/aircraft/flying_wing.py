"""A wing of a flying aircraft as Functions of the motion of the body and of its own weights."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca

from curvcasadi.aero.apparent_mass import apparent_mass_matrix
from curvcasadi.aero.state_rates import state_rates
from curvcasadi.aero.unsteady import UnsteadyAirload
from curvcasadi.aircraft.free_air import FreeAir, strip_points
from curvcasadi.aircraft.parts import Wing
from curvcasadi.dynamics import inverse, mass, system
from curvcasadi.dynamics.derivatives import differentiate
from curvcasadi.dynamics.inertia import inertial_mesh
from curvcasadi.lie import se3
from curvcasadi.symbolic.derivatives import with_jacobian
from curvcasadi.symbolic.expressions import AnyExpr, Number
from curvcasadi.symbolic.functions import free_symbols


def wing_balance_function(wing: Wing, air: FreeAir | None, name: str) -> ca.Function:
    """What a motion of a wing leaves unbalanced, with attached and structured derivatives.

    (q, q_dot, q_ddot, twist, twist_rate, gravity, attitude, lag, deflections …) -> residual (n, 1),
    N m², and wrench (6, 1), N m and N, which the wing needs of the body.

    Twist, its rate, gravity and wrench are those of the body, body axes, about its origin; the
    attitude (3, 3) is an input only of wings with loads of their own, lag only with states of the
    air.
    """
    n, air = wing.beam.basis.n, None if wing.strips is None else air
    weights = {key: ca.MX.sym(key, n) for key in ("q", "q_dot", "q_ddot")}
    body = {key: ca.MX.sym(key, 6) for key in ("twist", "twist_rate")}
    body["gravity"] = ca.MX.sym("gravity", 3)
    if wing.loads:
        body["attitude"] = ca.MX.sym("attitude", 3, 3)
    states, deflections = _symbols(wing, air)
    inputs = {**weights, **body, **states, **deflections}
    parent = system.ParentMotion(body["twist"], body["twist_rate"], body["gravity"])
    loads = wing_loads(wing, air, states.get("lag", ca.MX(0, 1)), deflections)
    frame = body.get("attitude", ca.DM.eye(3))
    built = system.in_parent(wing.beam, loads, parent, frame, weights)
    found = inverse.balance(built, *weights.values())
    outputs = {"residual": found.residual, "wrench": inverse.parent_wrench(built, found)}
    missing = free_symbols(ca.vertcat(*outputs.values()), inputs.values())
    if missing:
        raise ValueError(
            f"Wing {wing.name!r}: expected numbers, found the symbols {', '.join(missing)}"
        )
    parameters = ca.veccat(*body.values(), *states.values(), *deflections.values())
    slopes = differentiate(built, *weights.values(), root=True, parameters=parameters)
    residual = (slopes.by_weights, slopes.by_rates, slopes.by_accelerations)
    own, held = ([x[:, 6:] for x in parts] for parts in (residual, slopes.parent[1:]))
    by_parameters = slopes.by_parameters
    return with_jacobian(
        name,
        inputs,
        outputs,
        {
            "residual": ca.horzcat(*own, by_parameters[6:, :]),
            "wrench": ca.horzcat(*held, by_parameters[:6, :]),
        },
    )


def wing_rates_function(wing: Wing, air: FreeAir, name: str) -> ca.Function:
    """Rates of the states of the air at a wing, with attached and structured derivatives.

    (q, q_dot, twist, lag, gust, deflections …) -> rates, m/s². The gust (3, strips), m/s, is in
    body axes, and an input only where the air has gusts.
    """
    beam = wing.beam
    weights = {key: ca.MX.sym(key, beam.basis.n) for key in ("q", "q_dot")}
    states, deflections = _symbols(wing, air)
    others = {"twist": ca.MX.sym("twist", 6), **states}
    if air.entry is not None:
        others["gust"] = ca.MX.sym("gust", 3, len(strip_points(wing)))
    others |= deflections
    load = air.load(wing, states["lag"], deflections, others.get("gust", (0, 0, 0)))
    inward = beam.root.inverse()
    root_twist = se3.adjoint(se3.matrix(inward.rotation, inward.position)) @ others["twist"]
    boundaries = inertial_mesh(beam, [load, *wing.loads]).stations
    q, q_dot = weights.values()
    plain, found = (
        state_rates(beam, q, q_dot, load, ca.DM.eye(3), boundaries, symbols, root_twist)
        for symbols in (None, ca.veccat(*others.values()))
    )
    slopes = ca.horzcat(found.by_weights, found.by_rates, found.by_parameters)
    return with_jacobian(name, {**weights, **others}, {"rates": plain.value}, {"rates": slopes})


def wing_mass(wing: Wing, air: FreeAir | None, q: AnyExpr) -> mass.Blocks:
    """Mass matrix by the twist of the body and the rates of the weights, with apparent mass."""
    air = None if wing.strips is None else air
    none = dict.fromkeys(() if wing.strips is None else wing.strips.inputs, 0.0)
    loads = wing_loads(wing, air, ca.DM.zeros(0 if air is None else air.size(wing)), none)
    still = system.ParentMotion(ca.DM.zeros(6), ca.DM.zeros(6), ca.DM.zeros(3))
    blocks = mass.mass_blocks(system.in_parent(wing.beam, loads, still, ca.DM.eye(3), {"q": q}), q)
    if air is None:
        return blocks
    load: UnsteadyAirload = loads[0]
    boundaries = inertial_mesh(wing.beam, loads).stations
    added = apparent_mass_matrix(wing.beam, q, load, boundaries, root=True)
    return mass.Blocks(
        blocks.parent + added[:6, :6],
        blocks.coupling + added[:6, 6:],
        blocks.weights + added[6:, 6:],
    )


def wing_loads(
    wing: Wing, air: FreeAir | None, states: Number, deflections: Mapping[str, Number]
) -> list[Any]:
    """Loads on a wing beside its weight; the airload first."""
    airloads = [] if air is None else [air.load(wing, states, deflections)]
    return [*airloads, *wing.loads]


def _symbols(wing: Wing, air: FreeAir | None) -> tuple[dict[str, ca.MX], dict[str, ca.MX]]:
    """States of the air, where there are some, and deflections."""
    size = 0 if air is None else air.size(wing)
    names = wing.strips.inputs if air is not None and wing.strips is not None else ()
    return ({"lag": ca.MX.sym("lag", size)} if size else {}), {k: ca.MX.sym(k) for k in names}
