"""Can a Cortex-M fly the gust case, and what does a period cost?

    python -m codegen.loop.run [--cpu cortex-m7 ...] [--real double ...] [--periods 120] [--update]

Exports filter and controller, compiles codegen/firmware/controller.c around them for the target,
and runs it in qemu, in the loop with the nonlinear wing on this machine: a period at a time, it
sends samples and applies the inputs that come back. Compares with the same controller in Python,
prints instructions of a period, flash, RAM and stack, and draws the gust with and without control.
"""

from __future__ import annotations

import argparse
import os
import select
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import curvcasadi as cc
from codegen import budgets, map_file, toolchain
from codegen.loop.case import LARGEST, PERIOD, PERIODS, Case
from codegen.loop.host import Flight, HostController, Plant, data_header, still
from curvcasadi.symbolic.expressions import Array, Real

FIRMWARE = Path(__file__).parents[1] / "firmware"
#: Targets: no double on a processor that computes it in software.
TARGETS: tuple[tuple[str, Real], ...] = (
    ("cortex-m7", "double"),
    ("cortex-m7", "float"),
    ("cortex-m4", "float"),
)
CLOCK = 216e6  #: Hz, of a Cortex-M7 of which one instruction takes a cycle
#: What may be lost on the way to the processor.
LARGEST_DIFFERENCE = 1e-4  #: of inputs, over their range, in float; in double far less
LARGEST_LOSS = 0.01  #: of alleviation, over the peak without control
#: Undefined names of the controller's objects: no heap, and of libm these alone; the smaller and
#: larger of two numbers are instructions of a Cortex-M7, and calls on a Cortex-M4.
ALLOWED = {"sqrt", "sqrtf", "atan2", "atan2f", "fmin", "fminf", "fmax", "fmaxf"}
ALLOWED |= {"memcpy", "memset", "memmove"}


STRICT = (
    *("-std=c99", "-pedantic", "-Wall", "-Wextra", "-Wconversion", "-Wshadow", "-Wundef"),
    *("-Wstrict-prototypes", "-Wmissing-prototypes", "-Wcast-qual", "-Wcast-align"),
    *("-Wdouble-promotion", "-Wfloat-equal", "-Wswitch-enum", "-Werror"),
)
#: Left out, of advice alone: macros that another program uses (2.5), functions that another file
#: calls (8.7), and constants that stand in a header of their own (8.9).
MISRA = (
    *("--addon=misra", "--std=c99", "--enable=style", "--error-exitcode=1", "--quiet"),
    *(f"--suppress=misra-c2012-{rule}" for rule in ("2.5", "8.7", "8.9")),
)


@dataclass(frozen=True, eq=False, kw_only=True)
class Run:
    """A flight with the controller on a processor."""

    flight: Flight
    instructions: Array  #: of each period
    statuses: Array  #: (periods, 3): update, control, predict
    source: Array  #: of each period
    stack: int  #: bytes


class Processor:
    """A program in qemu that answers samples with inputs, over two pipes."""

    def __init__(self, program: Path, cpu: str, real: Real, folder: Path) -> None:
        number = np.float64 if real == "double" else np.float32
        self.number = np.dtype(number).newbyteorder("<")
        fields = [("u", self.number, 2), ("certificates", self.number, 3), ("words", "<u4", 6)]
        self.reply = np.dtype(fields)
        self.answers: list[np.void] = []
        for name in ("samples", "results"):
            (folder / name).unlink(missing_ok=True)
            os.mkfifo(folder / name)
        self.process = subprocess.Popen(
            toolchain.emulator(program, cpu), cwd=folder, stdout=subprocess.PIPE, text=True
        )
        # For both ways, as opening a pipe for one waits for the other end, which may never come.
        self.to, self.back = (os.open(folder / name, os.O_RDWR) for name in ("samples", "results"))

    def __call__(self, measured: Array) -> Array:
        os.write(self.to, measured.astype(self.number).tobytes())
        content = b""
        while len(content) < self.reply.itemsize:
            if select.select([self.back], [], [], 1.0)[0]:
                content += os.read(self.back, self.reply.itemsize - len(content))
            elif self.process.poll() is not None:
                raise RuntimeError(f"the program ended with {self.process.returncode}")
        answer = np.frombuffer(content, self.reply)[0]
        self.answers.append(answer)
        return np.asarray(answer["u"], dtype=float)

    def end(self) -> str:
        """What the program prints when no more samples come."""
        os.close(self.to)
        text, _ = self.process.communicate(timeout=toolchain.SECONDS)
        os.close(self.back)
        return text


def build(folder: Path, case: Case, cpu: str) -> tuple[Path, dict[str, int]]:
    """The program, and bytes of flash and RAM of the controller."""
    place = folder / cpu
    sources = {"curv": folder, "curv_functions": folder, "controller": FIRMWARE}
    options = [f"-I{folder}", f"-I{FIRMWARE}"]
    own = [
        toolchain.compile_c(
            path / f"{name}.c", place / f"{name}.o", cpu, options=options, real=case.real
        )
        for name, path in sources.items()
    ]
    foreign = {name for name in toolchain.undefined(own) if not name.startswith("curv_")} - ALLOWED
    if foreign:
        raise RuntimeError(f"the controller calls {sorted(foreign)}")
    main = toolchain.compile_c(
        Path(__file__).parent / "main.c", place / "main.o", cpu,
        options=["-std=gnu99", *options, f"-I{toolchain.CORTEX_M}"],
    )  # fmt: skip
    program = place / "loop.elf"
    linked = toolchain.link([main, *own, *toolchain.startup(place, cpu)], program, cpu)
    found = map_file.sizes(linked, ["curv.o", "curv_functions.o", "controller.o", "libm.a"])
    return program, {"flash": found["code"] + found["tables"], "ram": found["ram"]}


def lint(folder: Path) -> list[str]:
    """What strict compilers of this machine and the rules of MISRA C:2012 find in the controller.

    A tool that is missing is named and skipped.
    """
    source, found = str(FIRMWARE / "controller.c"), []
    include = [f"-I{FIRMWARE}", f"-I{folder}"]
    commands = {
        "gcc": ["gcc", *STRICT, *include, "-fsyntax-only", source],
        "clang": ["clang", *STRICT, *include, "-fsyntax-only", source],
        "cppcheck": ["cppcheck", *MISRA, *include, source],
    }
    for tool, command in commands.items():
        if shutil.which(tool) is None:
            print(f"{tool}: skipped, it is not on the PATH")
            continue
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode:
            found.append(f"{tool}: {done.stdout}{done.stderr}")
    return found


def fly(program: Path, folder: Path, case: Case, cpu: str, plant: Plant, periods: int) -> Run:
    """The flight with the controller on the processor."""
    processor = Processor(program, cpu, case.real, folder)
    try:
        flight = plant.fly(processor, periods)
        printed = processor.end()
    finally:
        processor.process.kill()
    words = np.array([answer["words"] for answer in processor.answers])
    stack = int(printed.rpartition("stack=")[2])
    return Run(
        flight=flight,
        instructions=words[:, 4],
        statuses=words[:, :3],
        source=words[:, 3],
        stack=stack,
    )


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cpu", choices=toolchain.MACHINES, nargs="+")
    parser.add_argument("--real", choices=("double", "float"), nargs="+")
    parser.add_argument("--periods", type=int, default=PERIODS)
    parser.add_argument("--update", action="store_true", help="write the numbers as budgets")
    parser.add_argument("--out", type=Path, default=Path("out/codegen/loop"))
    options = parser.parse_args()
    missing = toolchain.missing_tools()
    if missing:
        print("\n".join(missing), file=sys.stderr)
        return 2
    targets = [
        (cpu, real)
        for cpu, real in TARGETS
        if cpu in (options.cpu or toolchain.MACHINES) and real in (options.real or [real])
    ]
    host = Case()
    plant = Plant(host)
    open_loop = plant.fly(still, options.periods)
    controller = HostController(host)
    closed = plant.fly(controller, options.periods)
    print(
        f"{options.periods} periods of {PERIOD:g} s; peak of root bending {open_loop.peak:.1f} N m "
        f"without control, {closed.peak:.1f} N m with the controller of the host"
    )
    measured: dict[str, dict[str, int]] = {}
    faults: list[str] = []
    flights = {"without control": open_loop, "host, double": closed}
    for real in dict.fromkeys(real for _, real in targets):
        case, folder = Case(real=real), options.out / real
        manifest = cc.export_c(
            case.functions, folder, real=real, reference_inputs=case.examples, shared_buffers=True
        )
        bounds = ", ".join(f"{name} {n}" for name, n in manifest["iterations"].items())
        print(f"{real}: iterations at most {bounds}")
        (folder / "controller_data.h").write_text(data_header(case))
        faults += lint(folder)
        for cpu in [cpu for cpu, number in targets if number == real]:
            program, memory = build(folder, case, cpu)
            run = fly(program, folder, case, cpu, plant, options.periods)
            name = f"{cpu}, {real}"
            flights[name] = run.flight
            measured[f"gust_loop.period_{real}.{cpu}"] = {
                "text": memory["flash"],
                "ram": memory["ram"],
                "stack": run.stack,
                "instructions": int(run.instructions.max()),
            }
            print(_words(name, run, memory, open_loop, closed))
            faults += _faults(name, run, open_loop, closed, controller.source, real)
    draw(flights, options.out / "gust.png")
    print(f"{options.out / 'gust.png'}")
    allowed = budgets.load()
    if options.update:
        allowed = budgets.updated(allowed, measured, toolchain.compiler_version())
        budgets.FILE.write_text(budgets.text(allowed))
    faults += budgets.failures(measured, allowed)
    print("\n".join(faults), end="\n" if faults else "", file=sys.stderr)
    return int(bool(faults))


def _difference(run: Run, closed: Flight) -> float:
    """Largest difference of inputs from those of the host, over their range."""
    return float(np.abs(run.flight.u - closed.u).max() / (2 * LARGEST))


def _words(name: str, run: Run, memory: dict[str, int], open_loop: Flight, closed: Flight) -> str:
    worst, mean = run.instructions.max(), run.instructions.mean()
    loss = (run.flight.peak - closed.peak) / open_loop.peak
    return (
        f"{name}: {mean / 1e6:.2f} M instructions a period, at most {worst / 1e6:.2f} M "
        f"({CLOCK / worst:.0f} Hz at {CLOCK / 1e6:.0f} MHz if each takes a cycle); flash "
        f"{memory['flash'] / 1024:.0f} KiB, RAM {memory['ram'] / 1024:.0f} KiB, stack "
        f"{run.stack} bytes; inputs within {_difference(run, closed):.1e} of the range; "
        f"alleviation lost {loss:.2%}; {np.count_nonzero(run.source)} periods without an optimum"
    )


def _faults(
    name: str, run: Run, open_loop: Flight, closed: Flight, source: list[int], real: Real
) -> list[str]:
    """What must not be."""
    found = []
    limit = LARGEST_DIFFERENCE if real == "float" else LARGEST_DIFFERENCE / 100
    difference = _difference(run, closed)
    if difference > limit:
        found.append(f"{name}: inputs differ by {difference:.1e} of their range, above {limit:g}")
    if (run.flight.peak - closed.peak) / open_loop.peak > LARGEST_LOSS:
        found.append(f"{name}: more than {LARGEST_LOSS:.0%} of alleviation is lost")
    if not np.array_equal(run.source, source):
        found.append(f"{name}: the sources of inputs are not those of the host")
    return found


def draw(flights: dict[str, Flight], path: Path) -> None:
    """Root bending and flaps over time."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, (upper, lower) = plt.subplots(2, 1, sharex=True, figsize=(7, 5))
    for style, (name, flight) in zip(
        ("k:", "k-", "C0--", "C1-.", "C2:"), flights.items(), strict=False
    ):
        upper.plot(flight.t, flight.bending, style, label=name)
        if name != "without control":
            lower.plot(flight.t, np.rad2deg(flight.u[0]), style)
            lower.plot(flight.t, np.rad2deg(flight.u[1]), style, alpha=0.5)
    upper.set_ylabel("root bending\nless steady flight, N m")
    upper.legend()
    lower.set_ylabel("flaps, °\n(inner; outer paler)")
    lower.set_xlabel("time, s")
    figure.tight_layout()
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path)
    plt.close(figure)


if __name__ == "__main__":
    sys.exit(main())
