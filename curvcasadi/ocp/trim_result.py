"""What a trim found, and a table of several."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from curvcasadi.aero import StripForces
from curvcasadi.expressions import Array
from curvcasadi.shape import Shape


@dataclass(frozen=True, eq=False, kw_only=True)
class TrimResult:
    """An aircraft in steady straight flight, or what comes nearest to it."""

    speed: float  #: m/s
    angle_of_attack: float  #: of the body x axis, rad
    pitch: float  #: rad
    sideslip: float  #: rad
    roll: float  #: rad
    flight_path: float  #: climb angle of what was found, rad
    inputs: dict[str, float]  #: thrusts, N, and deflections, rad
    input_units: dict[str, str]
    q: dict[str, ca.DM]  #: weights (n, 1), rad/m, by wing
    shapes: dict[str, Shape]  #: by wing, body axes
    root_loads: dict[str, Array]  #: (6,) moment, N m, and force, N, on the body, root axes
    airloads: dict[str, StripForces]  #: along the span, by wing
    strain_energy: float  #: of all wings, J
    drag: float  #: force against the path without thrust and weight, N
    balances: dict[str, float]  #: what is left of each, N and N m, body axes and origin
    equilibrium_residuals: dict[str, float]  #: largest entry by wing, N m²
    trimmed: bool  #: everything balances
    converged: bool  #: the last solve ended at an optimum
    iterations: int
    active_bounds: tuple[str, ...]
    message: str
    unknowns: Array  #: all unknowns, scaled: where a warm start begins


def trim_table(results: Sequence[TrimResult]) -> str:
    """Results as a table: speed, angles, inputs, tips above the roots, root bending, drag."""
    rows = []
    for result in results:
        row = {"V [m/s]": f"{result.speed:.4g}"}
        row["alpha [deg]"] = f"{np.degrees(result.angle_of_attack):.3f}"
        for name, value in result.inputs.items():
            unit = "N" if result.input_units[name] == "N" else "deg"
            shown = value if unit == "N" else np.degrees(value)
            row[f"{name} [{unit}]"] = f"{shown:.3f}"
        for name, shape in result.shapes.items():
            height = float(shape.poses[0].position[2] - shape.tip.position[2])
            row[f"{name} tip [m]"] = f"{height:.3f}"
            row[f"{name} root M_y [N m]"] = f"{result.root_loads[name][1]:.1f}"
        row["drag [N]"] = f"{result.drag:.3f}"
        row["trimmed"] = "yes" if result.trimmed else "no"
        rows.append(row)
    if not rows:
        return ""
    widths = {key: max(len(key), *(len(row[key]) for row in rows)) for key in rows[0]}
    lines = ["  ".join(key.rjust(width) for key, width in widths.items())]
    lines += ["  ".join(row[key].rjust(width) for key, width in widths.items()) for row in rows]
    return "\n".join(lines)
