"""One step of a control model in time."""

from __future__ import annotations

import casadi as ca

from curvcasadi.control.model import ControlModel
from curvcasadi.symbolic.expressions import count, instance, is_numeric, positive


def rk4_step(model: ControlModel, dt: float, *, substeps: int = 1) -> ca.Function:
    """x(t + dt) by the classical Runge–Kutta method of order 4, inputs held constant.

    Parameters
    ----------
    dt : s
    substeps : equal steps within dt

    Returns
    -------
    casadi.Function
        (x, u, p) -> x_next
    """
    instance("model", model, ControlModel)
    if not is_numeric(dt):
        raise ValueError(f"dt: expected a number, found the symbol {dt}")
    h = positive("dt", dt) / count("substeps", substeps)
    x, u, p = (
        ca.MX.sym(name, layout.size)
        for name, layout in (("x", model.x), ("u", model.u), ("p", model.p))
    )
    end = x
    for _ in range(substeps):
        k1 = model.xdot(end, u, p)
        k2 = model.xdot(end + h / 2 * k1, u, p)
        k3 = model.xdot(end + h / 2 * k2, u, p)
        k4 = model.xdot(end + h * k3, u, p)
        end = end + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return ca.Function(f"{model.name}_step", [x, u, p], [end], ["x", "u", "p"], ["x_next"])
