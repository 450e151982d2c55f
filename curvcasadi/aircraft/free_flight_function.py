"""The equations of free flight as a `casadi.Function` whose derivatives are structured."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca

from curvcasadi.aircraft.free_flight import free_inverse_dynamics
from curvcasadi.aircraft.free_motion import (
    WingLoads,
    body_wrench,
    free_motion,
    offsets_of,
    thrust_wrench,
)
from curvcasadi.aircraft.parts import Aircraft
from curvcasadi.dynamics.derivatives import differentiate
from curvcasadi.kinematics.pose_function import KINDS, Form
from curvcasadi.loads.kinds import STANDARD_GRAVITY
from curvcasadi.symbolic.derivatives import with_jacobian
from curvcasadi.symbolic.expressions import AnyExpr, Number, choice, function_name
from curvcasadi.symbolic.functions import free_symbols


def free_inverse_dynamics_function(
    aircraft: Aircraft,
    parameters: Mapping[str, AnyExpr] | None = None,
    *,
    inputs: Mapping[str, Number] | None = None,
    gravity: Number = STANDARD_GRAVITY,
    loads: WingLoads | None = None,
    form: Form = "compact",
    name: str = "free_inverse_dynamics",
) -> ca.Function:
    """Equations of free flight: attitude, q, velocity, acceleration, parameters … -> residual.

    Its derivatives by all inputs are structured and attached; that by the acceleration is the mass
    matrix where no load depends on accelerations. By the attitude they are those by its nine
    entries.

    Parameters
    ----------
    aircraft : Aircraft
        As for `free_inverse_dynamics`.
    parameters : mapping of str to symbols, optional
        Symbols in inputs, gravity, loads and sections by the name of their input; MX for the
        compact form, SX for the unrolled one.
    inputs, gravity, loads
        As for `free_inverse_dynamics`.
    form : {"compact", "unrolled"}
        A chain of calls, or one long expression.
    name : str
        Name of the Function.

    Returns
    -------
    casadi.Function
        residual (6 + n, 1).
    """
    function_name("name", name)
    kind: Any = KINDS[choice("form", form, KINDS)]
    parameters = dict(parameters or {})
    n = offsets_of(aircraft)[-1]
    shapes = {"attitude": (3, 3), "q": (n,), "velocity": (6 + n,), "acceleration": (6 + n,)}
    states = {key: kind.sym(key, *shape) for key, shape in shapes.items()}
    taken = sorted(set(parameters) & {*states, "residual"})
    if taken:
        raise ValueError(f"parameters: expected names of their own, found {', '.join(taken)}")
    attitude, q, velocity, acceleration = states.values()
    options: dict[str, Any] = {"inputs": inputs, "gravity": gravity, "loads": loads}
    residual = free_inverse_dynamics(
        aircraft, q, velocity, acceleration, attitude=attitude, **options
    )
    symbols = {**states, **parameters}
    missing = free_symbols(residual, symbols.values())
    if missing:
        raise ValueError(f"parameters: expected every symbol, missing {', '.join(missing)}")
    slopes = _slopes(
        aircraft, attitude, q, velocity, acceleration, [*parameters.values()], **options
    )
    return with_jacobian(name, symbols, {"residual": residual}, {"residual": slopes})


def _slopes(
    aircraft: Aircraft,
    attitude: AnyExpr,
    q: AnyExpr,
    velocity: AnyExpr,
    acceleration: AnyExpr,
    parameters: list[AnyExpr],
    inputs: Mapping[str, Number] | None,
    gravity: Number,
    loads: WingLoads | None,
) -> AnyExpr:
    """Derivatives of the residual by attitude, q, velocity, acceleration and parameters.

    All but q are parameters of the motion of the body; the columns of the wings' own rates and
    accelerations are added to those.
    """
    flight = free_motion(aircraft, q, velocity, acceleration, attitude, gravity, loads)
    symbols = ca.veccat(attitude, velocity, acceleration, *parameters)
    offsets = offsets_of(aircraft)
    n, m, first = offsets[-1], symbols.numel(), 9
    needed = body_wrench(flight.body, flight.parent) - thrust_wrench(aircraft, inputs or {})
    body = ca.horzcat(ca.DM.zeros(6, n), ca.densify(ca.jacobian(needed, symbols)))
    rows = []
    for k, wing in enumerate(flight.wings):
        found = differentiate(
            wing.system, wing.q, wing.q_dot, wing.q_ddot, root=True, parameters=symbols
        )
        start, size = offsets[k], offsets[k + 1] - offsets[k]
        pairs = zip(found.parent[1:], found[1:4], strict=True)
        by_q, by_rates, by_accelerations = (
            _last_columns(ca.vertcat(*pair), size) for pair in pairs
        )
        block = _placed(by_q, start, n + m)
        block += ca.horzcat(ca.DM.zeros(6 + size, n), found.by_parameters)
        block += _placed(by_rates, n + first + 6 + start, n + m)
        block += _placed(by_accelerations, n + first + 12 + n + start, n + m)
        body = body + block[:6, :]
        rows.append(block[6:, :])
    whole: AnyExpr = ca.vertcat(body, *rows)
    by_weights, by_attitude, others = ca.horzsplit(whole, [0, n, n + first, n + m])
    return ca.horzcat(by_attitude, by_weights, others)


def _last_columns(matrix: AnyExpr, count: int) -> AnyExpr:
    return matrix[:, matrix.shape[1] - count :]


def _placed(block: AnyExpr, first: int, columns: int) -> AnyExpr:
    """`block` among zeros, its first column at `first`."""
    rows, width = block.shape
    after = ca.DM.zeros(rows, columns - first - width)
    return ca.horzcat(ca.DM.zeros(rows, first), block, after)
