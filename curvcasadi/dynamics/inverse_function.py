"""Inverse dynamics as a `casadi.Function` whose derivatives are structured."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import casadi as ca

from curvcasadi.beam.beam import Beam
from curvcasadi.dynamics import inverse, system
from curvcasadi.dynamics.derivatives import differentiate
from curvcasadi.kinematics.pose_function import KINDS, Form
from curvcasadi.kinematics.root_motion import RootMotion
from curvcasadi.symbolic.derivatives import with_jacobian
from curvcasadi.symbolic.expressions import AnyExpr, choice, function_name
from curvcasadi.symbolic.functions import free_symbols

_STATES = ("q", "q_dot", "q_ddot")


def inverse_dynamics_function(
    beam: Beam,
    loads: Sequence[Any] = (),
    parameters: Mapping[str, AnyExpr] | None = None,
    *,
    root: RootMotion | None = None,
    form: Form = "compact",
    name: str = "inverse_dynamics",
) -> ca.Function:
    """Inverse dynamics as a Function: q, q_dot, q_ddot, parameters … -> residual.

    Its derivatives by all inputs are structured and attached: the derivative by q_ddot is the mass
    matrix, none goes through the chain by AD. Both become self-contained C.

    Parameters
    ----------
    beam : Beam
        With mass; its section and bodies may hold parameters.
    loads : sequence of loads
        As for `inverse_dynamics`; they may hold parameters.
    parameters : mapping of str to symbols, optional
        Symbols in loads, section, bodies and root, by the name of their input; MX for the compact
        form, SX for the unrolled one.
    root : RootMotion, optional
        How the root moves; it may hold parameters.
    form : {"compact", "unrolled"}
        A chain of calls, or one long expression.
    name : str
        Name of the Function.

    Returns
    -------
    casadi.Function
        residual (n, 1), N m².

    Raises
    ------
    ValueError
        As `inverse_dynamics`; and if a symbol is not among the parameters, or one of them is in the
        length, root pose or initial curvature of the beam.
    """
    function_name("name", name)
    kind = KINDS[choice("form", form, KINDS)]
    parameters = dict(parameters or {})
    taken = sorted(set(parameters) & {*_STATES, "residual"})
    if taken:
        raise ValueError(f"parameters: expected names of their own, found {', '.join(taken)}")
    for field, symbol in beam.design_symbols.items():
        raise ValueError(f"{field}: expected numbers, found the symbol {symbol}")
    states = {key: kind.sym(key, beam.basis.n) for key in _STATES}
    inputs = {**states, **parameters}
    built = system.build(beam, loads, root, inputs)
    residual = inverse.balance(built, *states.values()).residual
    missing = free_symbols(residual, inputs.values())
    if missing:
        raise ValueError(f"parameters: expected every symbol, missing {', '.join(missing)}")
    stacked = ca.veccat(*parameters.values()) if parameters else None
    found = differentiate(built, *states.values(), parameters=stacked)
    slopes = [found.by_weights, found.by_rates, found.by_accelerations]
    slopes += [] if stacked is None else [found.by_parameters]
    return with_jacobian(
        name, inputs, {"residual": kind(residual)}, {"residual": ca.horzcat(*slopes)}
    )
