"""Which C does a flight computer need for this wing?

    python codegen/generate.py ocp_examples/hale_wing.toml --real float --out out/codegen/hale

Writes, for the wing of a TOML file: `curv_tip`, tip pose and body Jacobian; `curv_shape_target`,
the weights that bring the tip to a position; `curv_tip_path_step`, one real-time iteration of the
MPC that keeps the tip on a path. `curv.h` in the folder says how to call them, its CMakeLists.txt
builds library and self-test.
"""

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np

import curvcasadi as cc

DT, STAGES = 0.05, 5  # of the MPC, s
TIME_CONSTANT = 0.25  # s, in which weights follow their commands


def generate(beam: cc.Beam, folder: Path) -> dict:
    """The manifest of the C that is written into `folder`."""
    target = cc.Target(xi=1.0, position=beam.root.position, weight=1.0)
    model = cc.kinematic_model(beam, time_constant=TIME_CONSTANT)
    step = cc.tip_path_step_function(model, dt=DT, horizon=STAGES, attitude_weight=25, iterations=1)
    functions = [
        cc.tip_function(beam, jacobian=True),
        cc.shape_target_function(beam, [target], regularization=1e-6, max_iter=15),
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
    n, tip = beam.basis.n, cc.tip_function(beam)
    shape = np.random.default_rng(0).uniform(-0.02, 0.02, n)
    position, rotation = tip(shape)
    path = [np.tile(pose.full(), STAGES) for pose in (position, rotation)]
    nearby = 0.9 * shape
    return {
        "shape_target": [(nearby, position)],
        "tip_path_step": [(nearby, np.zeros(n), nearby, *path, np.tile(nearby, 2 * STAGES))],
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("wing", type=Path, help="a TOML file, see ocp_examples")
    parser.add_argument("--real", choices=("double", "float"), default="float")
    parser.add_argument("--max-angle", type=float, help="that one element may turn, rad")
    parser.add_argument("--out", type=Path, default=Path("out/codegen/wing"), metavar="FOLDER")
    options = parser.parse_args()

    beam = cc.load_beam(options.wing)
    grid = replace(beam.grid, real=options.real)
    if options.max_angle:
        grid = replace(grid, max_angle=options.max_angle)
    manifest = generate(replace(beam, grid=grid), options.out)
    for name, function in manifest["functions"].items():
        sizes = function["buffers"]
        print(f"curv_{name}: {sizes['w']} {options.real}s and {sizes['iw']} ints of work")
    print(f"{len(manifest['files'])} files in {options.out}")


if __name__ == "__main__":
    main()
