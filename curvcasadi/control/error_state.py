"""Error states of models whose state holds attitudes.

An attitude is a unit quaternion in the state and a rotation vector δ, rad, in local axes in the
error state; every other part is its own difference:

    retract:     R ← R exp(δ),    x ← x + δ
    difference:  the δ that takes one state to the other
    changes:     dδ = 2 Im(q⁻¹ ∘ dq),    dδ = dx
"""

from __future__ import annotations

import casadi as ca

from curvcasadi.control.model import ControlModel
from curvcasadi.control.signals import LENGTH_TOLERANCE
from curvcasadi.lie import quaternion
from curvcasadi.symbolic.expressions import Expr, expression, instance, is_numeric
from curvcasadi.symbolic.layout import Layout


def retract(model: ControlModel, x: Expr, dx: Expr) -> Expr:
    """The state that lies `dx` from `x`.

    Parameters
    ----------
    model : ControlModel
        The model whose state it is.
    x : SX, MX, DM or array, shape (nx, 1)
        State.
    dx : SX, MX, DM or array, shape (nd, 1)
        Error state, laid out as `model.x.errors`: three entries for each attitude.

    Returns
    -------
    SX, MX or DM, shape (nx, 1)
        For a unit quaternion in `x` a unit quaternion again.

    Raises
    ------
    ValueError
        If a shape is wrong, or a quaternion of numbers has no unit length.
    """
    layout = instance("model", model, ControlModel).x
    x = _on_group("x", layout, expression("x", x, (layout.size, 1)))
    return add(layout, x, expression("dx", dx, (layout.errors.size, 1)))


def difference(model: ControlModel, x: Expr, y: Expr) -> Expr:
    """The error state that takes `x` to `y`, so that ``retract(model, x, dx)`` is `y`.

    Parameters
    ----------
    model : ControlModel
        The model whose states they are.
    x, y : SX, MX, DM or array, shape (nx, 1)
        States.

    Returns
    -------
    SX, MX or DM, shape (nd, 1)
        Error state, laid out as `model.x.errors`; attitudes the shorter way round.

    Raises
    ------
    ValueError
        As `retract`.
    """
    layout = instance("model", model, ControlModel).x
    start = _on_group("x", layout, expression("x", x, (layout.size, 1)))
    return subtract(layout, start, _on_group("y", layout, expression("y", y, (layout.size, 1))))


def _on_group(name: str, layout: Layout, x: Expr) -> Expr:
    """`x`, whose attitudes are unit quaternions if they are numbers."""
    if is_numeric(x):
        for part in layout.parts:
            length = float(ca.norm_2(x[layout.slices[part.name]])) if part.attitude else 1.0
            if abs(length - 1) > LENGTH_TOLERANCE:
                raise ValueError(
                    f"{name}: expected the unit quaternion {part.name}, "
                    f"found one of length {length:g}"
                )
    return x


def add(layout: Layout, x: Expr, dx: Expr) -> Expr:
    """`retract` without checks, for any layout."""
    steps = layout.errors.split(dx)
    pieces = []
    for part, start in layout.split(x).items():
        step = steps[part]
        if start.numel() == step.numel():
            pieces.append(start + step)
        else:
            pieces.append(quaternion.product(start, quaternion.exp(step)))
    return ca.vertcat(*pieces)


def subtract(layout: Layout, x: Expr, y: Expr) -> Expr:
    """`difference` without checks, for any layout."""
    starts, ends = layout.split(x), layout.split(y)
    pieces = []
    for part in layout.parts:
        start, end = starts[part.name], ends[part.name]
        if part.attitude:
            pieces.append(quaternion.log(quaternion.product(quaternion.conjugate(start), end)))
        else:
            pieces.append(end - start)
    return ca.vertcat(*pieces)


def in_error_state(layout: Layout, x: ca.MX, changes: ca.MX) -> ca.MX:
    """Changes (nx, m) of the state `x`, a column each, as changes (nd, m) of its error state."""
    if not any(part.attitude for part in layout.parts):
        return changes
    values, pieces = layout.split(x), []
    for part in layout.parts:
        rows = changes[layout.slices[part.name], :]
        if part.attitude:
            inverse = quaternion.conjugate(values[part.name])
            units = [ca.MX(unit) for unit in ca.horzsplit(ca.DM.eye(4))]
            turned = [quaternion.product(inverse, unit) for unit in units]
            rows = 2 * ca.horzcat(*turned)[1:, :] @ rows
        pieces.append(rows)
    return ca.vertcat(*pieces)
