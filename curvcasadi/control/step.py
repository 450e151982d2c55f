"""One step of a control model in time, as a Function."""

from __future__ import annotations

from typing import Literal, get_args

import casadi as ca
import numpy as np

from curvcasadi.control.implicit_midpoint import ITERATIONS, TOLERANCE, Midpoint, midpoint_step
from curvcasadi.control.model import ControlModel, symbols_of
from curvcasadi.control.stability import warn_of_unstable_step
from curvcasadi.lie import quaternion
from curvcasadi.symbolic.expressions import AnyExpr, choice, count, instance, is_numeric, positive

Method = Literal["rk4", "implicit_midpoint"]


def step_function(
    model: ControlModel,
    dt: float,
    *,
    method: Method = "rk4",
    substeps: int = 1,
    newton: bool = False,
    iterations: int = ITERATIONS,
    tolerance: float = TOLERANCE,
) -> ca.Function:
    """The state of a model after `dt`, with inputs held over it.

    Parameters
    ----------
    model : ControlModel
        Model; `implicit_midpoint` needs one with inertia.
    dt : float
        Length of the step, s.
    method : {"rk4", "implicit_midpoint"}
        The classical Runge–Kutta method of order 4, which is stable while dt times the highest
        frequency stays below 2.8 (a longer step, of the model at rest, warns), or the implicit
        midpoint rule, of order 2, symmetric and stable for stiff wings. Attitudes stay unit
        quaternions with both.
    substeps : int
        Equal steps within `dt`.
    newton : bool
        Iterate implicit steps by Newton's method instead of a constant matrix; for steps that turn
        or bend a wing so far that the constant matrix does not converge.
    iterations, tolerance : int, float
        An implicit step ends when a correction is below `tolerance` of the rates, or after
        `iterations`.

    Returns
    -------
    casadi.Function
        (x, u, p) -> x_next (nx, 1), residual. The residual is the last relative correction of an
        implicit step (a sum over `substeps`), NaN where it diverged, and zero for an
        explicit one: **check it**, a step that did not converge returns its last iterate. The
        Jacobian of an implicit step is that of the implicit function.

    Raises
    ------
    ValueError
        If `dt` is not above zero, or the model has no inertia for an implicit method.
    """
    instance("model", model, ControlModel)
    if method in ("variational", "cvodes"):
        raise ValueError(
            f"method: expected 'rk4' or 'implicit_midpoint', found {method!r}, a method of "
            "simulate alone, which carries more than the state from step to step"
        )
    choice("method", method, get_args(Method))
    if not is_numeric(dt):
        raise ValueError(f"dt: expected a number, found the symbol {dt}")
    h = positive("dt", dt) / count("substeps", substeps)
    if method == "rk4":
        at_rest = [np.zeros(layout.size) for layout in (model.x, model.u, model.p)]
        warn_of_unstable_step("dt", model, h, at_rest)
        x, u, p = symbols_of(model)
        step = _step(model, [x, u, p], rk4(model, h, x, u, p), ca.MX(0))
    else:
        step = midpoint_step(midpoint_rule(model, newton, iterations, tolerance), h)
    if substeps == 1:
        return step
    x, u, p = symbols_of(model)
    end, residual = x, ca.MX(0)
    for _ in range(substeps):
        end, last = step(end, u, p)
        residual = residual + last  # a sum, as the largest would lose a NaN
    return _step(model, [x, u, p], end, residual)


def rk4_step(model: ControlModel, dt: float, *, substeps: int = 1) -> ca.Function:
    """x(t + dt) by the classical Runge–Kutta method of order 4, inputs held constant.

    Parameters
    ----------
    model : ControlModel
        Model.
    dt : float
        Length of the step, s.
    substeps : int
        Equal steps within `dt`.

    Returns
    -------
    casadi.Function
        (x, u, p) -> x_next (nx, 1); attitudes are unit quaternions again.
    """
    step = step_function(model, dt, method="rk4", substeps=substeps)
    x, u, p = symbols_of(model)
    end, _ = step(x, u, p)
    return ca.Function(f"{model.name}_step", [x, u, p], [end], ["x", "u", "p"], ["x_next"])


def midpoint_rule(
    model: ControlModel,
    newton: bool = False,
    iterations: int = ITERATIONS,
    tolerance: float = TOLERANCE,
) -> Midpoint:
    """The implicit midpoint rule of a model that has inertia."""
    if model.second_order is None:
        raise ValueError(
            f"method: 'implicit_midpoint' needs a model with inertia, found {model.name!r}; "
            "use 'rk4'"
        )
    return Midpoint(
        model=model,
        motion=model.second_order,
        newton=newton,
        iterations=count("iterations", iterations),
        tolerance=positive("tolerance", tolerance),
    )


def rk4(model: ControlModel, h: AnyExpr, x: ca.MX, u: ca.MX, p: ca.MX) -> ca.MX:
    """The state after `h` by the classical Runge–Kutta method, attitudes of unit length again."""
    k1 = model.xdot(x, u, p)
    k2 = model.xdot(x + h / 2 * k1, u, p)
    k3 = model.xdot(x + h / 2 * k2, u, p)
    k4 = model.xdot(x + h * k3, u, p)
    end = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    if any(part.attitude for part in model.x.parts):
        values = model.x.split(end)
        end = ca.vertcat(
            *(
                quaternion.normalize(values[part.name]) if part.attitude else values[part.name]
                for part in model.x.parts
            )
        )
    return end


def _step(model: ControlModel, inputs: list[ca.MX], end: ca.MX, residual: ca.MX) -> ca.Function:
    return ca.Function(
        f"{model.name}_step", inputs, [end, residual], ["x", "u", "p"], ["x_next", "residual"]
    )
