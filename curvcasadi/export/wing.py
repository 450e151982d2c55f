"""C for the wing of a file: pose, shape target, and tip-path control."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from curvcasadi.beam.beam import Beam
from curvcasadi.control.kinematic_model import kinematic_model
from curvcasadi.export.c_function import CFunction
from curvcasadi.export.export import export_c
from curvcasadi.kinematics.pose_function import tip_function
from curvcasadi.kinematics.shape import squared_element_angles
from curvcasadi.ocp.shape_target import shape_target_function
from curvcasadi.ocp.targets import Target
from curvcasadi.ocp.tip_path import tip_path_step_function
from curvcasadi.symbolic.expressions import Array

DT, STAGES = 0.05, 5  # of the MPC, s
TIME_CONSTANT = 0.25  # s, in which weights follow their commands
# With 1e-4 a tip stays up to some 1e-3 of the length off targets within reach; 1e-6 comes nearer,
# but does not converge for targets out of reach.
SMOOTHNESS = 1e-4
HALVINGS = 40
TURN = 0.3  # rad, that the wing of the self-test turns from root to tip, where its limits allow it


def write_wing_c(beam: Beam, folder: Path) -> dict[str, Any]:
    """Write the C of a wing, and a program that calls it, into `folder`; returns the manifest."""
    target = Target(xi=1.0, position=beam.root.position, weight=1.0)
    model = kinematic_model(beam, time_constant=TIME_CONSTANT)
    step = tip_path_step_function(
        model,
        dt=DT,
        horizon=STAGES,
        position_weight=1 / beam.length**2,
        attitude_weight=0.1,
        move_weight=1e-5 * beam.length**2,
        iterations=1,
    )
    functions: list[ca.Function | CFunction] = [
        tip_function(beam, jacobian=True),
        shape_target_function(beam, [target], regularization=SMOOTHNESS, max_iter=50),
        CFunction(function=step, weights={"x": beam}),
    ]
    manifest = export_c(
        functions,
        folder,
        real=beam.grid.real,
        beam=beam,
        reference_inputs=samples(beam),
    )
    program = Path("example") / "main.c"  # apart, as the folder has one main, that of the self-test
    (folder / "example").mkdir(exist_ok=True)
    (folder / program).write_text(_program(beam))
    return {**manifest, "files": sorted([*manifest["files"], program.as_posix()])}


def samples(beam: Beam) -> dict[str, Any]:
    """Inputs at which the self-test compares the solvers with Python: a shape, and one nearby."""
    shape, nearby = bent(beam, TURN), bent(beam, 0.9 * TURN)
    position, rotation = tip_function(beam)(shape)
    path = [np.tile(pose.full(), STAGES) for pose in (position, rotation)]
    at_rest = np.zeros(beam.basis.n)
    return {
        "shape_target": [(nearby, position)],
        "tip_path_step": [(nearby, at_rest, nearby, *path, np.tile(nearby, 2 * STAGES))],
    }


def bent(beam: Beam, turn: float) -> Array:
    """Weights that turn the tip by about `turn`, or less: as far as the limits of `beam` allow."""
    q = ca.MX.sym("q", beam.basis.n)
    angles = ca.Function("angles", [q], [ca.sqrt(squared_element_angles(beam, q))])
    weights = np.random.default_rng(0).uniform(-1, 1, beam.basis.n) * turn / beam.length
    for _ in range(HALVINGS):
        weights = np.clip(weights, *beam.bounds)
        if float(ca.mmax(angles(weights))) < 0.9 * beam.grid.max_angle:
            return weights
        weights = weights / 2
    raise ValueError(
        "expected a grid whose elements turn by less than its max_angle "
        f"({beam.grid.max_angle:g} rad) somewhere within the weight bounds, found none: use more "
        "elements or a larger angle"
    )


_MAIN = """\
/* Where is the tip of a bent wing? On this machine:
     gcc -std=c99 -O2 -I. example/main.c curv.c curv_functions.c -lm -o wing && ./wing */
#include <stdio.h>

#include "curv.h"

int main(void) {
  const curv_real q[CURV_TIP_N_Q] = {@WEIGHTS@}; /* rad/m */
  curv_tip_out tip;
  const curv_status status = curv_tip(q, &tip);
  if (status != CURV_OK) {
    printf("no tip pose: status %d\\n", (int)status);
    return 1;
  }
  printf("tip at (%.4f, %.4f, %.4f) m, parent axes\\n", (double)tip.position[0],
         (double)tip.position[1], (double)tip.position[2]);
  return 0;
}
"""


def _program(beam: Beam) -> str:
    suffix = "f" if beam.grid.real == "float" else ""
    weights = ", ".join(f"{weight:.6e}{suffix}" for weight in bent(beam, TURN))
    return _MAIN.replace("@WEIGHTS@", weights)
