"""A wing whose weights follow their commands with a first-order lag."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from curvcasadi.beam.beam import Beam
from curvcasadi.control.model import ControlModel
from curvcasadi.control.spans import curvature_spans
from curvcasadi.kinematics.element import ON_GROUP
from curvcasadi.kinematics.pose_function import pose_function, tip_function
from curvcasadi.kinematics.resolution import elements_that_may_exceed
from curvcasadi.kinematics.shape import curvature, squared_element_angles
from curvcasadi.symbolic.expressions import (
    Number,
    expression,
    instance,
    is_numeric,
    numbers,
    station,
)
from curvcasadi.symbolic.layout import Layout, Part

#: Stations of the curvatures among the outputs, unless others are asked for.
CURVATURE_STATIONS = (0.0, 0.25, 0.5, 0.75, 1.0)


def kinematic_model(
    beam: Beam, *, time_constant: Number, curvature_stations: Sequence[float] = CURVATURE_STATIONS
) -> ControlModel:
    """A beam whose weights follow their commands with a first-order lag.

        time_constant dq/dt = q_command + disturbance − q

    x: q, rad/m, bounded by `Beam.weight_bounds`; u: q_command, rad/m, bounded likewise;
    p: disturbance, rad/m; y: position (3, m) and rotation (9, by columns) of the tip, local to
    parent, and curvature (K_x, K_y, K_z at each of `curvature_stations`, rad/m, local axes). The
    tip's structured Jacobian is used by derivatives of `output`. Element angles are checked where
    `Beam.weight_bounds` do not keep them within `Grid.max_angle`.

    Parameters
    ----------
    beam : Beam
        Wing with numeric fields.
    time_constant : float or array
        Time constant, s, one number or one per weight.
    curvature_stations : sequence of float
        Stations s/L whose curvature is an output.

    Returns
    -------
    ControlModel
        With the parts above.
    """
    symbols = instance("beam", beam, Beam).design_symbols
    if symbols:
        raise ValueError(f"{next(iter(symbols))}: kinematic_model needs numbers, found a symbol")
    n = beam.basis.n
    tau = _time_constants(time_constant, n)
    stations = [station("curvature_stations", xi) for xi in curvature_stations]
    lower, upper = beam.bounds
    x = Layout((Part("q", n, "rad/m", lower, upper),))
    u = Layout((Part("q_command", n, "rad/m", lower, upper),))
    p = Layout((Part("disturbance", n, "rad/m", nominal=0.0),))
    y = Layout(
        (
            Part("position", 3, "m"),
            Part("rotation", 9, "1"),
            Part("curvature", 3 * len(stations), "rad/m"),
        )
    )
    q, command, disturbance = ca.MX.sym("x", n), ca.MX.sym("u", n), ca.MX.sym("p", n)
    position, rotation = tip_function(beam)(q)
    curvatures = ca.veccat(*(curvature(beam, q, xi) for xi in stations))
    signature = ([q, command, disturbance], ["x", "u", "p"])
    return ControlModel(
        name="kinematic",
        real=beam.grid.real,
        x=x,
        u=u,
        p=p,
        y=y,
        xdot=ca.Function(
            "kinematic_xdot",
            signature[0],
            [(command + disturbance - q) / tau],
            signature[1],
            ["xdot"],
        ),
        output=ca.Function(
            "kinematic_output",
            signature[0],
            [y.join({"position": position, "rotation": ca.vec(rotation), "curvature": curvatures})],
            signature[1],
            ["y"],
        ),
        angles=_angles(beam),
        pose=_pose(beam),
        spans={"q": curvature_spans(beam.basis)["q"]},
    )


def _pose(beam: Beam) -> ca.Function | None:
    """Pose and body Jacobian of the tip from one march along the beam."""
    if beam.grid.exponential not in ON_GROUP:
        return None
    return pose_function("tip_pose", beam, (1.0,), jacobian=True)


def _angles(beam: Beam) -> ca.Function | None:
    beyond = elements_that_may_exceed(beam)
    if not beyond:
        return None
    q = ca.MX.sym("x", beam.basis.n)
    squares = squared_element_angles(beam, q)[beyond, :] / beam.grid.max_angle**2
    return ca.Function("kinematic_angles", [q], [squares], ["x"], ["angles"])


def _time_constants(value: Number, n: int) -> ca.DM:
    if not is_numeric(value):
        raise ValueError(f"time_constant: expected numbers, found the symbol {value}")
    seconds = numbers("time_constant", value)
    tau = expression("time_constant", np.full(n, seconds) if seconds.size == 1 else seconds, (n, 1))
    if not np.all(tau.full() > 0):
        raise ValueError(f"time_constant: expected numbers above zero, s, found {value}")
    return tau
