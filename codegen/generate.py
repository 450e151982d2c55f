"""Which C does a flight computer need for this wing?

    python codegen/generate.py ocp_examples/hale_wing.toml --real float --out out/codegen/hale

Writes, for the wing of a TOML file: `curv_tip`, tip pose and body Jacobian; `curv_shape_target`,
the weights that bring the tip to a position; `curv_tip_path_step`, one real-time iteration of the
MPC that keeps the tip on a path. `curv.h` in the folder says how to call them, its CMakeLists.txt
builds library and self-test.
"""

import argparse
import sys
from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np

import curvcasadi as cc

DT, STAGES = 0.05, 5  # of the MPC, s
TIME_CONSTANT = 0.25  # s, in which weights follow their commands
# With 1e-4 a tip stays up to some 1e-3 of the length off targets within reach; 1e-6 comes nearer,
# but does not converge for targets out of reach.
SMOOTHNESS = 1e-4
HALVINGS = 40
TURN = 0.3  # rad, that the wing of the self-test turns from root to tip, where its limits allow it


def generate(beam: cc.Beam, folder: Path) -> dict:
    """The manifest of the C that is written into `folder`."""
    target = cc.Target(xi=1.0, position=beam.root.position, weight=1.0)
    model = cc.kinematic_model(beam, time_constant=TIME_CONSTANT)
    step = cc.tip_path_step_function(
        model,
        dt=DT,
        horizon=STAGES,
        position_weight=1 / beam.length**2,
        attitude_weight=0.1,
        move_weight=1e-5 * beam.length**2,
        iterations=1,
    )
    functions = [
        cc.tip_function(beam, jacobian=True),
        cc.shape_target_function(beam, [target], regularization=SMOOTHNESS, max_iter=50),
        cc.CFunction(function=step, weights={"x": beam}),
    ]
    return cc.export_c(
        functions,
        folder,
        real=beam.grid.real,
        beam=beam,
        reference_inputs=samples(beam),
    )


def samples(beam: cc.Beam) -> dict:
    """Inputs at which the self-test compares the solvers with Python: a shape, and one nearby."""
    shape, nearby = bent(beam, TURN), bent(beam, 0.9 * TURN)
    position, rotation = cc.tip_function(beam)(shape)
    path = [np.tile(pose.full(), STAGES) for pose in (position, rotation)]
    at_rest = np.zeros(beam.basis.n)
    return {
        "shape_target": [(nearby, position)],
        "tip_path_step": [(nearby, at_rest, nearby, *path, np.tile(nearby, 2 * STAGES))],
    }


def bent(beam: cc.Beam, turn: float) -> np.ndarray:
    """Weights that turn the tip by about `turn`, or less: as far as the limits of `beam` allow."""
    q = ca.MX.sym("q", beam.basis.n)
    angles = ca.Function("angles", [q], [ca.sqrt(cc.squared_element_angles(beam, q))])
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


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("wing", type=Path, help="a TOML file, see ocp_examples")
    parser.add_argument("--real", choices=("double", "float"), default="float")
    parser.add_argument("--max-angle", type=float, help="that one element may turn, rad")
    parser.add_argument("--out", type=Path, default=Path("out/codegen/wing"), metavar="FOLDER")
    options = parser.parse_args()

    try:
        beam = cc.load_beam(options.wing)
        grid = replace(beam.grid, real=options.real)
        if options.max_angle is not None:
            grid = replace(grid, max_angle=options.max_angle)
        manifest = generate(replace(beam, grid=grid), options.out)
    except (OSError, ValueError) as error:
        print(f"generate: error: {error}", file=sys.stderr)
        return 2
    for name, function in manifest["functions"].items():
        sizes = function["buffers"]
        print(f"curv_{name}: {sizes['w']} {options.real}s and {sizes['iw']} ints of work")
    print(f"{len(manifest['files'])} files in {options.out}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
