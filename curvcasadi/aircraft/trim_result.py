"""What a trim found, and a table of several."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from curvcasadi.aero import StripForces
from curvcasadi.aircraft.trim_problem import BALANCES, LATERAL, TOLERANCE, TrimProblem
from curvcasadi.beam.beam import Beam
from curvcasadi.kinematics.shape import Shape, shape_map, unchecked_shape
from curvcasadi.solvers.active import active_bounds
from curvcasadi.symbolic.expressions import Array
from curvcasadi.symbolic.text import described, table


@dataclass(frozen=True, eq=False, kw_only=True)
class TrimResult:
    """An aircraft in steady flight, what comes nearest to it, or where a search stopped.

    Attributes
    ----------
    speed : float
        Airspeed, m/s.
    gravity : float
        Acceleration of gravity, m/s².
    angle_of_attack : float
        Angle of attack of the body x axis, rad.
    pitch : float
        Pitch angle, rad.
    sideslip : float
        Sideslip angle, rad.
    roll : float
        Roll angle, the bank angle of a turn, rad.
    turn_rate : float
        Rate of the heading, rad/s, above zero to the right; zero in straight flight.
    coordinated : bool
        Whether the sideslip is that of a turn without side force.
    flight_path : float
        Climb angle of the result, rad.
    inputs : dict of str to float
        Thrusts, N, and deflections, rad.
    input_units : dict of str to str
        Units of the inputs.
    q : dict of str to DM
        Curvature weights (n, 1), rad/m, by wing.
    shapes : dict of str to Shape
        Shapes by wing, body axes.
    root_loads : dict of str to array
        Moment, N m, and force, N, that a wing hands on to the body, (6,), root axes, by wing.
    airloads : dict of str to StripForces
        Airloads along the span, by wing.
    strain_energy : float
        Strain energy of all wings, J.
    drag : float
        Force against the path without thrust and weight, N; in a turn the power that these forces
        take, over the speed.
    balances : dict of str to float
        What is left of each balance, N and N m, body axes, about the body origin.
    equilibrium_residuals : dict of str to float
        Largest entry of the residual of each wing, N m².
    trimmed : bool
        Whether everything balances.
    converged : bool
        Whether the last solve ended at an optimum. A state that is not trimmed is the nearest one
        only if it did.
    iterations : int
        Iterations of all solves.
    active_bounds : tuple of str
        Bounds that hold the result, in words.
    message : str
        What was found, in words.
    unknowns : array
        All unknowns, scaled; where a warm start begins.
    bounds : dict of str to (float, float)
        Bounds of the angles, turn rate and inputs that were not held, rad, rad/s and N.
    path_is_free : bool
        Whether the flight path was not held.
    """

    speed: float
    gravity: float
    angle_of_attack: float
    pitch: float
    sideslip: float
    roll: float
    turn_rate: float
    coordinated: bool
    flight_path: float
    inputs: dict[str, float]
    input_units: dict[str, str]
    q: dict[str, ca.DM]
    shapes: dict[str, Shape]
    root_loads: dict[str, Array]
    airloads: dict[str, StripForces]
    strain_energy: float
    drag: float
    balances: dict[str, float]
    equilibrium_residuals: dict[str, float]
    trimmed: bool
    converged: bool
    iterations: int
    active_bounds: tuple[str, ...]
    message: str
    unknowns: Array
    bounds: dict[str, tuple[float, float]]
    path_is_free: bool

    @property
    def success(self) -> bool:
        """Whether everything balances, and nothing better balances, too."""
        return self.trimmed and self.converged

    @property
    def load_factor(self) -> float:
        """Force normal to the path over the weight, cos γ √(1 + (V ψ̇/g)²)."""
        pull = self.speed * self.turn_rate / self.gravity
        return float(np.cos(self.flight_path) * np.hypot(1.0, pull))

    @property
    def turn_radius(self) -> float:
        """Radius of the path, m, below zero to the left; infinite in straight flight."""
        if not self.turn_rate:
            return float("inf")
        return float(self.speed * np.cos(self.flight_path) / self.turn_rate)

    def __repr__(self) -> str:
        return f"<TrimResult at {self.speed:g} m/s: {self.message}>"

    def __str__(self) -> str:
        angles = ("angle_of_attack", "pitch", "sideslip", "roll", "flight_path")
        values = {name: getattr(self, name) for name in angles}
        rows = {
            name.replace("_", " "): f"{value:.5g} rad ({np.degrees(value):.3f}°)"
            for name, value in values.items()
            if value or name in angles[:2]
        }
        if self.turn_rate:
            rate, radius = self.turn_rate, self.turn_radius
            rows["turn"] = f"{rate:.5g} rad/s ({np.degrees(rate):.3f}°/s), radius {radius:.5g} m"
            rows["load factor"] = f"{self.load_factor:.5g}"
        rows |= {
            name: f"{value:.5g} {self.input_units[name]}" for name, value in self.inputs.items()
        }
        rows |= {"drag": f"{self.drag:.5g} N", "strain energy": f"{self.strain_energy:.5g} J"}
        for wing in self.shapes:
            moment = self.root_loads[wing][1]
            rows[wing] = (
                f"tip {self.tip_height(wing):.4g} m above the root, root M_y {moment:.5g} N m"
            )
        left = np.abs([*self.balances.values()])
        rows["unbalanced"] = f"{left[:3].max():.1e} N, {left[3:].max():.1e} N m"
        rows["held by"] = "; ".join(self.active_bounds) or "no bound"
        return described(f"TrimResult at {self.speed:g} m/s: {self.message}", rows)

    def tip_height(self, wing: str) -> float:
        """Height of the tip of a wing above its root.

        Parameters
        ----------
        wing : str
            Name of the wing.

        Returns
        -------
        float
            Height, m, along −z of the body.
        """
        shape = self.shapes[wing]
        return float(shape.poses[0].position[2] - shape.tip.position[2])


def trim_table(results: Sequence[TrimResult]) -> str:
    """Results as a table of speed, angles, inputs, tip heights, root bending and drag.

    Parameters
    ----------
    results : sequence of TrimResult
        Such as those of `trim_sweep`.

    Returns
    -------
    str
        A line per result.
    """
    rows = []
    for result in results:
        row = {"V [m/s]": f"{result.speed:.4g}"}
        row["alpha [deg]"] = f"{np.degrees(result.angle_of_attack):.3f}"
        row |= turn_cells(result) if any(r.turn_rate for r in results) else {}
        for name, value in result.inputs.items():
            unit = "N" if result.input_units[name] == "N" else "deg"
            shown = value if unit == "N" else np.degrees(value)
            row[f"{name} [{unit}]"] = f"{shown:.3f}"
        for name in result.shapes:
            row[f"{name} tip [m]"] = f"{result.tip_height(name):.3f}"
            row[f"{name} root M_y [N m]"] = f"{result.root_loads[name][1]:.1f}"
        row["drag [N]"] = f"{result.drag:.3f}"
        row["trimmed"] = "yes" if result.trimmed else "no"
        rows.append(row)
    return table(rows)


def turn_cells(result: TrimResult) -> dict[str, str]:
    """What a table says of a turn."""
    radius = f"{result.turn_radius:.4g}" if result.turn_rate else "-"
    return {
        "turn [deg/s]": f"{np.degrees(result.turn_rate):.3f}",
        "bank [deg]": f"{np.degrees(result.roll):.3f}",
        "sideslip [deg]": f"{np.degrees(result.sideslip):.3f}",
        "radius [m]": radius,
        "load factor": f"{result.load_factor:.4f}",
    }


def wing_shape(beam: Beam, q: ca.DM, trimmed: bool) -> Shape:
    """Shape of a wing; of a failed trim without the checks, which would hide the failure."""
    return shape_map(beam, q) if trimmed else unchecked_shape(beam, q)


def bounds_that_hold(
    problem: TrimProblem, x: Array, bounds: tuple[Array, Array], p: Array
) -> tuple[str, ...]:
    """Bounds that hold a free angle, input or weight, in words; `p` are the parameters."""
    units = [problem.units[name] for name in problem.names]
    scales = [float(scale) for scale in problem.scales(p)]
    names = [*problem.names]
    for wing in problem.aircraft.beams:
        names += [f"{wing.name} q[{i}] ({label})" for i, label in enumerate(wing.beam.basis.labels)]
        units += ["rad/m"] * wing.beam.basis.n
        scales += [1 / problem.length] * wing.beam.basis.n
    free = np.flatnonzero(bounds[0] < bounds[1])
    active = active_bounds(
        [names[i] for i in free],
        x[free],
        (bounds[0][free], bounds[1][free]),
        tolerance=1e-5,
        least=1.0,
        scales=np.array(scales)[free],
        units=[units[i] for i in free],
    )
    return tuple(active.values())


def failure_message(
    balances: Array,
    scales: Array,
    others: list[str],
    active: tuple[str, ...] | None,
    remedy: str,
) -> str:
    """Which balances are missed, the worst first, and what holds them; empty if none is.

    `others` are further misses in words. `active` is None where the search did not end: then
    nothing is known to hold them. The `remedy` is that of lateral balances that no bound holds.
    """
    misses = []
    for k in np.argsort(-np.abs(balances)):
        if abs(balances[k]) > TOLERANCE:
            left = f"{balances[k] * scales[k]:.4g} {'N' if k < 3 else 'N m'}"
            part = f" ({100 * abs(balances[k]):.2g} % of the weight)" if k < 3 else ""
            misses.append(f"{BALANCES[k]} is left with {left}{part}")
    misses += others
    if not misses:
        return ""
    text = "; ".join(misses)
    if active is None:
        return text
    if active:
        text += f"; held by bounds: {', '.join(active)}"
    elif any(abs(balances[k]) > TOLERANCE for k in LATERAL):
        text += f"; {remedy}"
    return text
