"""Control models from equations of motion: xdot with the derivatives of an implicit function."""

from __future__ import annotations

from collections.abc import Mapping

import casadi as ca
import numpy as np

from curvcasadi.control.model import ControlModel, SecondOrder, configuration_rates
from curvcasadi.control.spans import Span
from curvcasadi.symbolic.derivatives import with_jacobian
from curvcasadi.symbolic.expressions import Real
from curvcasadi.symbolic.layout import Layout


def second_order_model(
    *,
    name: str,
    x: Layout,
    u: Layout,
    p: Layout,
    y: Layout,
    motion: SecondOrder,
    output: ca.Function,
    real: Real = "double",
    spans: Mapping[str, tuple[Span, ...]] | None = None,
) -> ControlModel:
    """The control model with the equations of motion `motion`.

    Its xdot solves balance(x, a, u, p) = 0 for the accelerations a by the mass matrix. Its
    derivatives are those of the implicit function, da = −M⁻¹ d balance, so that the mass matrix is
    not differentiated.

    Parameters
    ----------
    name : str
        Name of the model and of its Functions.
    x, u, p, y : Layout
        Parts of state, input, parameter and output.
    motion : SecondOrder
        Equations of motion.
    output : casadi.Function
        (x, u, p) -> y.
    real : {"double", "float"}
        Arithmetic that the model is made for.
    spans : mapping of str to tuple, optional
        As in `ControlModel`.

    Returns
    -------
    ControlModel
        With `second_order`.
    """
    symbols = {key: ca.MX.sym(key, s.size) for key, s in (("x", x), ("u", u), ("p", p))}
    state, control, parameter = symbols.values()
    mass, _, _ = motion.matrices(state, parameter)
    still, symbol = ca.MX.zeros(motion.velocities), ca.MX.sym("acceleration", motion.velocities)
    at_rest, other_rates = motion.balance(state, still, control, parameter)
    acceleration = -ca.solve(mass, at_rest, "ldl")
    if not other_rates.numel():
        other_rates = ca.MX(0, 1)
    elif ca.depends_on(motion.balance(state, symbol, control, parameter)[1], symbol):
        other_rates = motion.balance(state, acceleration, control, parameter)[1]
    value = ca.vertcat(configuration_rates(x, motion, state), acceleration, other_rates)
    end = ca.MX.sym("out_xdot", x.size)
    xdot = with_jacobian(
        f"{name}_xdot",
        symbols,
        {"xdot": value},
        {"xdot": _slope(x, motion, state, control, parameter, end)},
        nominal={"xdot": end},
    )
    return ControlModel(
        name=name,
        x=x,
        u=u,
        p=p,
        y=y,
        xdot=xdot,
        output=output,
        real=real,
        second_order=motion,
        spans=spans or {},
    )


def _slope(layout: Layout, motion: SecondOrder, x: ca.MX, u: ca.MX, p: ca.MX, xdot: ca.MX) -> ca.MX:
    """d xdot / d(x, u, p) where the accelerations are those in `xdot`."""
    start = x.numel() - motion.velocities - int(motion.balance.size1_out("other_rates"))
    acceleration = xdot[start : start + motion.velocities]
    n = x.numel() + u.numel() + p.numel()
    stacked = ca.MX.sym("inputs", n + motion.velocities)
    ends = np.cumsum([0, x.numel(), u.numel(), p.numel(), motion.velocities]).tolist()
    at_x, at_u, at_p, at_a = ca.vertsplit(stacked, ends)
    results = [configuration_rates(layout, motion, at_x), *motion.balance(at_x, at_a, at_u, at_p)]
    # Together: each of the Functions in them is differentiated once.
    slope = ca.Function(
        "slopes", [stacked], [ca.densify(ca.jacobian(ca.vertcat(*results), stacked))]
    )
    rows = ca.vertsplit(
        slope(ca.vertcat(x, u, p, acceleration)),
        np.cumsum([0, *(result.numel() for result in results)]).tolist(),
    )
    (rates, _), (forces, mass), (others, others_by_a) = (
        ca.horzsplit(part, [0, n, stacked.numel()]) for part in rows
    )
    accelerations = -ca.solve(mass, forces, "ldl")
    return ca.vertcat(rates, accelerations, others + others_by_a @ accelerations)
