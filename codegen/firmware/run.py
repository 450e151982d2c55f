"""Can a Cortex-M keep a wing tip on a path at 100 Hz, and what does a tick cost?

    python -m codegen.firmware.run [--cpu cortex-m4] [--out out/codegen/firmware]

Writes the C of the controller and the path, compiles main.c for the target, and runs it in qemu.
Two poses of the path are lost on their way: as long as one of them is ahead, the input is held.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import casadi as ca
import numpy as np

import curvcasadi as cc
from codegen import toolchain
from codegen.benchmark_functions import wing

TICK = 0.01  # s
STAGES = 2  # of the MPC, one tick each
TICKS = 300
TIME_CONSTANT = 0.25  # s
LOST = (120, 121)  #: poses of the path that do not arrive

WING = wing()


def path_weights(t: float) -> ca.DM:
    """Weights of a wing that flaps, twists and lags a little: its tip is the path."""
    twist, bend, sweep = 0.01 * np.sin(2 * t), -0.002 - 0.02 * np.sin(1.5 * t) ** 2, 0.005
    return ca.DM([twist, 0, bend, 0, sweep * np.sin(3 * t), 0])


def write_path(file: Path) -> None:
    """A pose a line: position, rotation by columns; NaN where it is lost."""
    tip = cc.tip_function(WING)
    poses = [ca.veccat(*tip(path_weights(k * TICK))).full().ravel() for k in range(1, 1 + TICKS)]
    for k in LOST:
        poses[k][:] = np.nan
    file.write_text("".join(" ".join(f"{x:.9g}" for x in pose) + "\n" for pose in poses))


def export(folder: Path) -> None:
    """The controller as C, and the model that stands for the wing."""
    model = cc.kinematic_model(WING, time_constant=TIME_CONSTANT)
    step = cc.tip_path_step_function(
        model, dt=TICK, horizon=STAGES, attitude_weight=25, iterations=1
    )
    functions = [cc.tip_function(WING, jacobian=True), step, cc.rk4_step(model, TICK)]
    q = path_weights(0)
    poses = [cc.tip_function(WING)(path_weights(k * TICK)) for k in range(1, 1 + STAGES)]
    goals = [ca.horzcat(*part) for part in zip(*poses, strict=True)]
    sample = [q, ca.DM.zeros(6), q, *goals, ca.repmat(q, 2 * STAGES)]
    cc.export_c(
        functions, folder, real="float", beam=WING, reference_inputs={step.name(): [sample]}
    )


def build(folder: Path, cpu: str) -> Path:
    """The program; its objects stand beside it."""
    options = ["-std=gnu99", f"-I{folder}", f"-I{toolchain.CORTEX_M}", f"-DTICK={TICK}f"]
    main = toolchain.compile_c(
        Path(__file__).parent / "main.c",
        folder / cpu / "main.o",
        cpu,
        options=options,
        real="float",
    )
    library = [
        toolchain.compile_c(folder / f"{name}.c", folder / cpu / f"{name}.o", cpu, real="float")
        for name in ("curv", "curv_functions")
    ]
    program = folder / cpu / "firmware.elf"
    toolchain.link([main, *library, *toolchain.startup(folder / cpu, cpu)], program, cpu)
    return program


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cpu", choices=toolchain.MACHINES, default="cortex-m4")
    parser.add_argument("--out", type=Path, default=Path("out/codegen/firmware"))
    options = parser.parse_args()
    missing = toolchain.missing_tools()
    if missing:
        print("\n".join(missing), file=sys.stderr)
        return 2
    export(options.out)
    write_path(options.out / "path.txt")
    printed = toolchain.emulate(build(options.out, options.cpu), options.cpu, folder=options.out)
    print(printed, end="")
    held = f"held {len(LOST) - 1 + STAGES}: infeasible 0, not converged 0"
    if held not in printed:
        print(f"expected {held}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
