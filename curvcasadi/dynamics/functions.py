"""Inverse and forward dynamics as `casadi.Function`s whose derivatives are structured."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from curvcasadi.beam.beam import Beam
from curvcasadi.dynamics import forward, inverse, system
from curvcasadi.dynamics.derivatives import Derivatives, differentiate, root_change
from curvcasadi.dynamics.fields import cross_force
from curvcasadi.kinematics.pose_function import KINDS, Form
from curvcasadi.kinematics.root_motion import RootMotion
from curvcasadi.symbolic import ldl
from curvcasadi.symbolic.derivatives import with_jacobian
from curvcasadi.symbolic.expressions import AnyExpr, Array, choice, function_name, is_numeric
from curvcasadi.symbolic.functions import free_symbols


def inverse_dynamics_function(
    beam: Beam,
    loads: Sequence[Any] = (),
    parameters: Mapping[str, AnyExpr] | None = None,
    *,
    root: RootMotion | None = None,
    form: Form = "compact",
    small: bool = False,
    name: str = "inverse_dynamics",
) -> ca.Function:
    """Inverse dynamics as a Function: q, q_dot, q_ddot, parameters … -> residual.

    Its derivatives by all inputs are structured and attached; that by q_ddot is the mass matrix
    where no load depends on accelerations. Both become self-contained C.

    Parameters
    ----------
    beam : Beam
        With mass; its section and bodies may hold parameters.
    loads : sequence of loads
        As for `inverse_dynamics`; they may hold parameters.
    parameters : mapping of str to symbols, optional
        Symbols in loads, section, bodies, the pose of the beam's root and `root`, by the name of
        their input; MX for the compact form, SX for the unrolled one.
    root : RootMotion, optional
        How the root moves; it may hold parameters.
    form : {"compact", "unrolled"}
        A chain of calls, or one long expression.
    small : bool
        Whether the derivatives are those of one reverse sweep of the compact recursion per weight:
        half the generated C and work memory at some three times the time, for targets with little
        memory.
    name : str
        Name of the Function.

    Returns
    -------
    casadi.Function
        residual (n, 1), N m².

    Raises
    ------
    ValueError
        As `inverse_dynamics`; and if a symbol is not among the parameters, one of them is in the
        length or initial curvature of the beam, or in the pose of a root that moves.
    """
    if small and form != "compact":
        raise ValueError(f"form: expected 'compact' where small is set, found {form!r}")
    made = _prepare(beam, loads, parameters, root, form, name, ("q", "q_dot", "q_ddot"))
    residual = inverse.balance(made.system, *made.states).residual
    _refuse_free(residual, made.inputs)
    if small:
        slopes = _reverse_sweeps(name, made, residual)
    else:
        found = differentiate(made.system, *made.states, parameters=made.stacked)
        slopes = _columns(found)
    return with_jacobian(name, made.inputs, {"residual": made.kind(residual)}, {"residual": slopes})


def balance_function(
    beam: Beam,
    loads: Sequence[Any],
    projection: Array,
    parameters: Mapping[str, AnyExpr],
    *,
    root: RootMotion | None = None,
    form: Form = "compact",
    name: str = "balance",
) -> ca.Function:
    """Inverse dynamics of a beam one of whose loads has states, as a Function.

    q, q_dot, q_ddot, parameters … -> residual, rates.

    Its derivatives are structured and attached, those of both from one pass.

    Parameters
    ----------
    beam, loads, root, form, name
        As for `inverse_dynamics_function`; one of the loads has states.
    projection : array, shape (states, values)
        Rates of the states from those of the values at the stations of that load.
    parameters : mapping of str to symbols
        As for `inverse_dynamics_function`, the states among them.

    Returns
    -------
    casadi.Function
        residual (n, 1), N m², and rates (states, 1).

    Raises
    ------
    ValueError
        As `inverse_dynamics_function`.
    """
    made = _prepare(beam, loads, parameters, root, form, name, ("q", "q_dot", "q_ddot"))
    onto = ca.DM(projection)
    balance = inverse.balance(made.system, *made.states)
    outputs = {"residual": balance.residual, "rates": onto @ balance.rates}
    _refuse_free(ca.vertcat(*outputs.values()), made.inputs)
    found = differentiate(made.system, *made.states, parameters=made.stacked)
    slopes = {"residual": _columns(found), "rates": onto @ ca.horzcat(*found.rates[1:])}
    return with_jacobian(name, made.inputs, outputs, slopes)


def root_wrench_function(
    beam: Beam,
    loads: Sequence[Any] = (),
    parameters: Mapping[str, AnyExpr] | None = None,
    *,
    root: RootMotion | None = None,
    form: Form = "compact",
    name: str = "root_wrench",
) -> ca.Function:
    """Wrench that a moving beam hands on to its root: q, q_dot, q_ddot, parameters … -> wrench.

    It is the sum of the loads, weight included, less what the inertia of the beam takes of them.
    Its derivatives are structured and attached.

    Parameters
    ----------
    beam, loads, parameters, root, form, name
        As for `inverse_dynamics_function`.

    Returns
    -------
    casadi.Function
        wrench (6, 1): moment, N m, about the root station and force, N, both in root axes.

    Raises
    ------
    ValueError
        As `inverse_dynamics_function`.
    """
    made = _prepare(beam, loads, parameters, root, form, name, ("q", "q_dot", "q_ddot"))
    to_root = made.system.from_parent
    value = inverse.root_wrench(made.system, *made.states)
    _refuse_free(value, made.inputs)
    stacked = made.kind(0, 1) if made.stacked is None else made.stacked
    found = differentiate(made.system, *made.states, root=True, parameters=stacked)
    wrench = found.parent
    slopes = [part[:, 6:] for part in (wrench.by_weights, wrench.by_rates, wrench.by_accelerations)]
    turned = cross_force(root_change(made.system, stacked), wrench.value)  # the axes of the root
    slope = -to_root @ ca.horzcat(*slopes, found.by_parameters[:6, :] - turned)
    return with_jacobian(name, made.inputs, {"wrench": made.kind(value)}, {"wrench": slope})


def forward_dynamics_function(
    beam: Beam,
    loads: Sequence[Any] = (),
    parameters: Mapping[str, AnyExpr] | None = None,
    *,
    root: RootMotion | None = None,
    form: Form = "compact",
    name: str = "forward_dynamics",
) -> ca.Function:
    """Forward dynamics as a Function: q, q_dot, parameters … -> q_ddot.

    Its derivatives are structured and attached. With the inverse dynamics r they are

        ∂q_ddot/∂(q, q_dot, parameters) = −M⁻¹ ∂r/∂(q, q_dot, parameters)

    Parameters
    ----------
    beam, loads, parameters, root, form, name
        As for `inverse_dynamics_function`; the loads do not depend on accelerations.

    Returns
    -------
    casadi.Function
        q_ddot (n, 1), rad/(m s²).

    Raises
    ------
    ValueError
        As `inverse_dynamics_function` and `forward_dynamics`.
    """
    made = _prepare(beam, loads, parameters, root, form, name, ("q", "q_dot"))
    n = beam.basis.n
    value = forward.accelerations(made.system, *made.states)
    _refuse_free(value, made.inputs)
    q_ddot = made.kind.sym("out_q_ddot", n)
    q, q_dot = made.states
    found = differentiate(made.system, q, q_dot, q_ddot, parameters=made.stacked)
    by_parameters = [] if found.by_parameters is None else [found.by_parameters]
    right = ca.horzcat(found.by_weights, found.by_rates, *by_parameters)
    triangle = ldl.upper_triangle(found.by_accelerations)
    slopes = -ldl.ldl_solve(n, right.shape[1])(triangle, ca.densify(right))
    return with_jacobian(
        name,
        made.inputs,
        {"q_ddot": made.kind(value)},
        {"q_ddot": slopes},
        nominal={"q_ddot": q_ddot},
    )


class _Prepared(NamedTuple):
    system: system.System
    kind: Any
    states: list[AnyExpr]
    inputs: dict[str, AnyExpr]  #: states and parameters by name
    stacked: AnyExpr  #: all parameters, or None


def _prepare(
    beam: Beam,
    loads: Sequence[Any],
    parameters: Mapping[str, AnyExpr] | None,
    root: RootMotion | None,
    form: Form,
    name: str,
    states: Sequence[str],
) -> _Prepared:
    function_name("name", name)
    kind = KINDS[choice("form", form, KINDS)]
    parameters = dict(parameters or {})
    taken = sorted(set(parameters) & {"q", "q_dot", "q_ddot", "residual"})
    if taken:
        raise ValueError(f"parameters: expected names of their own, found {', '.join(taken)}")
    at_rest = root is None or is_at_rest(root)
    for field, symbol in (beam.shaping_symbols if at_rest else beam.design_symbols).items():
        raise ValueError(f"{field}: expected numbers, found the symbol {symbol}")
    symbols = {key: kind.sym(key, beam.basis.n) for key in states}
    inputs = {**symbols, **parameters}
    built = system.build(beam, loads, root, inputs)
    stacked = ca.veccat(*parameters.values()) if parameters else None
    return _Prepared(built, kind, [*symbols.values()], inputs, stacked)


def is_at_rest(root: RootMotion) -> bool:
    """Whether a root has no motion, so that its pose in its parent is all that a symbol moves."""
    parts = (root.twist, root.twist_rate)
    return all(is_numeric(part) and not np.any(ca.DM(part).full()) for part in parts)


def _refuse_free(value: AnyExpr, inputs: Mapping[str, AnyExpr]) -> None:
    missing = free_symbols(value, inputs.values())
    if missing:
        raise ValueError(f"parameters: expected every symbol, missing {', '.join(missing)}")


def _columns(found: Derivatives) -> AnyExpr:
    parts = [found.by_weights, found.by_rates, found.by_accelerations, found.by_parameters]
    return ca.horzcat(*(part for part in parts if part is not None))


def _reverse_sweeps(name: str, made: _Prepared, residual: AnyExpr) -> AnyExpr:
    """Derivatives by all inputs, row by row: one call per weight of one Function."""
    inputs = [*made.inputs.values()]
    plain = ca.Function(f"{name}_plain", inputs, [residual], {"cse": True})
    sweep = plain.reverse(1)
    n = residual.shape[0]
    rows = []
    for unit in ca.horzsplit(ca.DM.eye(n)):
        adjoints = sweep.call([*inputs, ca.MX(n, 1), ca.MX(ca.densify(unit))])
        rows.append(ca.veccat(*map(ca.densify, adjoints)).T)
    return ca.vertcat(*rows)
