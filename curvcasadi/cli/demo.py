"""The library's main job on a published wing, checked at every step: `curvcasadi demo`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import casadi as ca
import numpy as np

from curvcasadi.beam.beam import Beam
from curvcasadi.beam.grid import Grid
from curvcasadi.export import export_c, run_check
from curvcasadi.kinematics.jacobian import body_jacobian
from curvcasadi.kinematics.pose_function import tip_function
from curvcasadi.kinematics.shape import pose_at, shape_map
from curvcasadi.ocp.reach import reach_shape
from curvcasadi.ocp.shape_target import shape_target_function
from curvcasadi.ocp.targets import Target
from curvcasadi.plotting.figures import save_figure
from curvcasadi.plotting.shape import plot_shape
from curvcasadi.reference_wings import hale_wing
from curvcasadi.symbolic.expressions import Array

#: Weights of a strongly bent and twisted wing, rad/m.
BENT = (0.03, -0.015, 0.01, -0.06, 0.03, -0.02, 0.01, 0.004, -0.002)
#: Tip that the wing shall reach, m, body axes: 6 m up.
TIP = (0.0, 14.3, -6.0)


@dataclass(frozen=True)
class Row:
    """One claim: what, the value found, the value expected, their difference and its bound."""

    what: str
    value: str
    expected: str
    error: float
    bound: float

    @property
    def ok(self) -> bool:
        return self.error <= self.bound


def run(directory: Path) -> int:
    """Shape, target, C export and comparison for the HALE wing; figures to `directory`.

    Prints a table and returns the exit code: 0 if every row holds.
    """
    directory.mkdir(parents=True, exist_ok=True)
    wing = hale_wing()
    print("HALE wing: 16 m half span, 9 curvature weights, 16 elements (magnus4)\n")
    print(f"{'what':43s} {'value':>22s} {'expected':>22s} {'error':>9s} {'bound':>7s}")
    steps: list[Callable[[Beam, Path], Row]] = [
        _circle,
        _against_ode,
        _jacobian,
        _target,
        _solver_function,
        _compiled,
    ]
    failed = 0
    for step in steps:
        row = step(wing, directory)
        failed |= not row.ok
        print(
            f"{row.what:43s} {row.value:>22s} {row.expected:>22s} {row.error:9.1e} "
            f"{row.bound:7.0e} {'' if row.ok else 'FAILED'}",
            flush=True,
        )
    print(f"\nfigures and C: {directory}/")
    return int(failed)


def _circle(wing: Beam, directory: Path) -> Row:
    """Constant curvature is a circle: the tip is known in closed form."""
    q = np.zeros(wing.basis.n)
    q[3], radius = -0.05, 1 / 0.05
    angle = 16.0 / radius
    expected = radius * np.array([0, np.sin(angle), np.cos(angle) - 1])
    return _row("circle of radius 20 m: tip, m", _tip(wing, q), expected, 16e-12)


def _against_ode(wing: Beam, directory: Path) -> Row:
    """A bent and twisted shape against R' = R [K×], p' = R e_x of an ODE solver."""
    fine = replace(wing, grid=Grid.lobatto(40, rule="magnus6"))
    save_figure(plot_shape(wing, ca.DM(BENT)), directory / "hale_wing_bent.png")
    expected = _ode_tip(wing, np.array(BENT))
    return _row("bent and twisted, 40 magnus6 elements: tip", _tip(fine, BENT), expected, 16e-11)


def _jacobian(wing: Beam, directory: Path) -> Row:
    """The body Jacobian against central differences of the tip position."""
    step, n = 1e-5, wing.basis.n
    differences = np.array(
        [(_tip(wing, BENT + d) - _tip(wing, BENT - d)) / (2 * step) for d in step * np.eye(n)]
    ).T
    rotation = pose_at(wing, ca.DM(BENT), 1.0).rotation.full()
    ours = rotation @ body_jacobian(wing, ca.DM(BENT)).full()[3:]
    error = float(np.max(np.abs(ours - differences)))
    size, expected = (f"{np.linalg.norm(m):.6f}" for m in (ours, differences))
    return Row("norm of d tip/dq, m²; differences", size, expected, error, 1e-6)


def _target(wing: Beam, directory: Path) -> Row:
    """The shape of least strain energy whose tip is 6 m up."""
    result = reach_shape(wing, [Target(xi=1.0, position=TIP)], regularizer="strain_energy")
    save_figure(plot_shape(wing, result.q), directory / "hale_wing_target.png")
    return _row("shape target: tip, m", _tip(wing, result.q), np.array(TIP), 16e-6)


def _solver_function(wing: Beam, directory: Path) -> Row:
    """The same solve as one Function."""
    solver = shape_target_function(
        wing, [Target(xi=1.0, position=TIP)], regularizer="strain_energy"
    )
    q = solver(np.zeros(wing.basis.n), TIP)[0]
    return _row("shape target by one Function: tip, m", _tip(wing, q), np.array(TIP), 16e-6)


def _compiled(wing: Beam, directory: Path) -> Row:
    """Tip pose and Jacobian as C, compiled and compared."""
    folder = directory / "c"
    export_c([tip_function(wing, jacobian=True)], folder, reference_inputs={"tip": [[BENT]]})
    error = run_check(folder)["tip"]
    size = (folder / "curv_functions.c").stat().st_size
    value = f"{size / 1024:.0f} KiB of source"
    return Row("tip pose and Jacobian in C, relative", value, "as Python", error, 1e-13)


def _row(what: str, value: Array, expected: Array, bound: float) -> Row:
    def text(p: Array) -> str:
        return "(" + ", ".join(f"{x + 0.0:.4f}" for x in np.round(p, 4)) + ")"

    return Row(what, text(value), text(expected), float(np.linalg.norm(value - expected)), bound)


def _tip(beam: Beam, q: Array | ca.DM | tuple[float, ...]) -> Array:
    return np.asarray(shape_map(beam, q).tip.position.full().ravel())


def _ode_tip(beam: Beam, q: Array) -> Array:
    from scipy.integrate import solve_ivp

    root = beam.root.rotation.full()

    def slope(xi: float, y: Array) -> Array:
        rotation = y[3:].reshape(3, 3)
        kx, ky, kz = beam.basis(xi) @ q
        hat = np.array([[0, -kz, ky], [kz, 0, -kx], [-ky, kx, 0]])
        return 16.0 * np.concatenate([rotation[:, 0], (rotation @ hat).ravel()])

    start = np.concatenate([np.zeros(3), root.ravel()])
    solution = solve_ivp(slope, (0, 1), start, method="DOP853", rtol=1e-13, atol=1e-13)
    return np.asarray(solution.y[:3, -1])
