"""Small control models: a mass on a spring, and a body that is turned."""

from __future__ import annotations

import casadi as ca
import numpy as np

from curvcasadi.control.model import ControlModel
from curvcasadi.lie import quaternion, so3
from curvcasadi.symbolic.layout import Layout, Part


def model(name, parts, xdot, output=None):
    """A control model of Layouts of `parts` (x, u, p, y) and expressions of (x, u, p)."""
    layouts = [Layout(tuple(parts.get(key, ()))) for key in "xupy"]
    x, u, p = (ca.MX.sym(key, s.size) for key, s in zip("xup", layouts, strict=False))
    y = output(x, u, p) if output else ca.MX(0, 1)
    names = ["x", "u", "p"]
    return ControlModel(
        name=name,
        **dict(zip("xupy", layouts, strict=True)),
        xdot=ca.Function(f"{name}_xdot", [x, u, p], [xdot(x, u, p)], names, ["xdot"]),
        output=ca.Function(f"{name}_output", [x, u, p], [y], names, ["y"]),
    )


#: A mass on a spring, pushed by an input and by a gust.
MASS = model(
    "mass",
    {
        "x": [Part("place", 1, "m"), Part("speed", 1, "m/s")],
        "u": [Part("force", 1, "N", -2.0, 2.0)],
        "p": [Part("gust", 1, "N", nominal=0.0)],
        "y": [Part("load", 2, "m")],
    },
    lambda x, u, p: ca.vertcat(x[1], -4 * x[0] + u + p),
    lambda x, u, p: ca.vertcat(x[0] + 0.5 * u + 0.1 * p, 2 * x[1]),
)

#: A body that a torque turns, with a mark that is turned by a quarter.
QUARTER = so3.exp(ca.DM([0.0, np.pi / 2, 0.0]))
BODY = model(
    "body",
    {
        "x": [Part("attitude", 4, "1", attitude=True), Part("rate", 3, "rad/s")],
        "u": [Part("torque", 3, "N m", -1.0, 1.0)],
        "y": [Part("rotation", 9, "1"), Part("station_rotation", 18, "1")],
    },
    lambda x, u, p: ca.vertcat(
        quaternion.rate(x[:4], x[4:]), u - ca.cross(x[4:], ca.DM([1, 2, 3]) * x[4:])
    ),
    lambda x, u, p: ca.veccat(
        *(quaternion.rotation(x[:4]) @ turn for turn in (np.eye(3), QUARTER, np.eye(3)))
    ),
)
