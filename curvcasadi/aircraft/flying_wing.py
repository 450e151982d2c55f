"""A wing of a flying aircraft as Functions of the motion of the body and of its own weights."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca

from curvcasadi.aero.apparent_mass import apparent_mass_matrix
from curvcasadi.aero.unsteady import UnsteadyAirload
from curvcasadi.aircraft.free_air import FreeAir, strip_points
from curvcasadi.aircraft.parts import Wing
from curvcasadi.dynamics import inverse, mass, system
from curvcasadi.dynamics.derivatives import differentiate
from curvcasadi.dynamics.inertia import inertial_mesh
from curvcasadi.symbolic.derivatives import with_jacobian
from curvcasadi.symbolic.expressions import AnyExpr, Number
from curvcasadi.symbolic.functions import free_symbols


def wing_balance_function(wing: Wing, air: FreeAir | None, name: str) -> ca.Function:
    """What a motion of a wing leaves unbalanced, with attached and structured derivatives.

    (q, q_dot, q_ddot, twist, twist_rate, gravity, attitude, lag, gust, deflections …)
    -> residual (n, 1), N m², wrench (6, 1), N m and N, which the wing needs of the body, and
    rates, m/s², of the states of the air.

    Twist, its rate, gravity and wrench are those of the body, body axes, about its origin; the
    attitude (3, 3) is an input only of wings with loads of their own, lag only with states of the
    air, and the gust (3, strips), m/s, body axes, only where the air has gusts.
    """
    n, air = wing.beam.basis.n, None if wing.strips is None else air
    weights = {key: ca.MX.sym(key, n) for key in ("q", "q_dot", "q_ddot")}
    body = {key: ca.MX.sym(key, 6) for key in ("twist", "twist_rate")}
    body["gravity"] = ca.MX.sym("gravity", 3)
    if wing.loads:
        body["attitude"] = ca.MX.sym("attitude", 3, 3)
    states, deflections = air_symbols(wing, air)
    inputs = {**weights, **body, **states, **deflections}
    parent = system.ParentMotion(body["twist"], body["twist_rate"], body["gravity"])
    frame = body.get("attitude", ca.DM.eye(3))
    gust = frame @ states.get("gust", ca.DM.zeros(3))
    lag, velocity = states.get("lag", ca.MX(0, 1)), body["twist"][3:]
    loads = wing_loads(wing, air, lag, deflections, gust, velocity)
    onto = ca.DM(0, 0) if air is None else ca.DM(loads[0].parts.projection)
    built = system.in_parent(wing.beam, loads, parent, frame, weights)
    found = inverse.balance(built, *weights.values())
    outputs = {"residual": found.residual, "wrench": inverse.parent_wrench(built, found)}
    outputs["rates"] = onto @ found.rates
    missing = free_symbols(ca.vertcat(*outputs.values()), inputs.values())
    if missing:
        raise ValueError(
            f"Wing {wing.name!r}: expected numbers, found the symbols {', '.join(missing)}"
        )
    parameters = ca.veccat(*body.values(), *states.values(), *deflections.values())
    slopes = differentiate(built, *weights.values(), root=True, parameters=parameters)
    residual = (slopes.by_weights, slopes.by_rates, slopes.by_accelerations)
    own, held, rates = (
        [x[:, 6:] for x in parts] for parts in (residual, slopes.parent[1:], slopes.rates[1:4])
    )
    by_parameters = slopes.by_parameters
    return with_jacobian(
        name,
        inputs,
        outputs,
        {
            "residual": ca.horzcat(*own, by_parameters[6:, :]),
            "wrench": ca.horzcat(*held, by_parameters[:6, :]),
            "rates": onto @ ca.horzcat(*rates, slopes.rates.by_parameters),
        },
    )


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
    wing: Wing,
    air: FreeAir | None,
    states: Number,
    deflections: Mapping[str, Number],
    gust: Number = (0, 0, 0),
    velocity: Number = (0, 0, 0),
) -> list[Any]:
    """Loads on a wing beside its weight; the airload first."""
    airloads = [] if air is None else [air.load(wing, states, deflections, gust, velocity)]
    return [*airloads, *wing.loads]


def air_symbols(wing: Wing, air: FreeAir | None) -> tuple[dict[str, ca.MX], dict[str, ca.MX]]:
    """States of the air and the gust, where there are some, and deflections."""
    if air is None or wing.strips is None:
        return {}, {}
    states = {"lag": ca.MX.sym("lag", air.size(wing))} if air.size(wing) else {}
    if air.entry is not None:
        states["gust"] = ca.MX.sym("gust", 3, len(strip_points(wing)))
    return states, {key: ca.MX.sym(key) for key in wing.strips.inputs}
