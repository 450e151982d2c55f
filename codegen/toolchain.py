"""Compiling for a Cortex-M, and running on an emulated one."""

from __future__ import annotations

import re
import shutil
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path

CORTEX_M = Path(__file__).parent / "cortex_m"
GCC, NM, QEMU = "arm-none-eabi-gcc", "arm-none-eabi-nm", "qemu-system-arm"
CMAKE, CTEST = "cmake", "ctest"
#: Programs, and the Debian packages that they come in.
PACKAGES = {
    GCC: "gcc-arm-none-eabi libnewlib-arm-none-eabi",
    NM: "binutils-arm-none-eabi",
    QEMU: "qemu-system-arm",
    CMAKE: "cmake",
}
CPU_FLAGS = {
    "cortex-m7": ("-mcpu=cortex-m7", "-mfpu=fpv5-d16"),
    "cortex-m4": ("-mcpu=cortex-m4", "-mfpu=fpv4-sp-d16"),
}
MACHINES = {"cortex-m7": "mps2-an500", "cortex-m4": "mps2-an386"}
FLAGS = (
    *("-mthumb", "-mfloat-abi=hard", "-Os", "-std=c99"),
    "-fno-inline-functions-called-once",  # frames of functions that are done leave the stack
    *("-ffunction-sections", "-fdata-sections"),
)
WARNINGS = ("-pedantic", "-Wall", "-Wextra", "-Wno-unused-parameter", "-Werror")
FLOAT_WARNINGS = ("-Wdouble-promotion", "-Wfloat-conversion", "-Wconversion")
#: gcc's helpers for double without hardware, and libm's functions of double.
DOUBLE = re.compile(
    r"__aeabi_(d\w+|\w+2d|cd\w+)|a?(sin|cos|tan)h?|atan2|sqrt|cbrt|pow|hypot|exp|exp2|expm1|log|"
    r"log2|log10|log1p|fmod|fma|fmin|fmax|fabs|floor|ceil|round|trunc|copysign|ldexp"
)
SECONDS = 120  #: that a program may take


def missing_tools(packages: Mapping[str, str] = PACKAGES) -> list[str]:
    """A line for every program that is not on the PATH, with the package that it is in."""
    return [
        f"{tool} is missing (Debian: apt-get install --no-install-recommends {package})"
        for tool, package in packages.items()
        if shutil.which(tool) is None
    ]


def compiler_version() -> str:
    return run([GCC, "--version"]).splitlines()[0]


def compile_c(
    source: Path, target: Path, cpu: str, *, options: Sequence[str] = (), real: str | None = None
) -> Path:
    """The object file of a C source; warnings are errors, for floats those of conversions too."""
    target.parent.mkdir(parents=True, exist_ok=True)
    warnings = (*WARNINGS, *(FLOAT_WARNINGS if real == "float" else ()))
    warnings += ("-Wmissing-prototypes",) if real else ()
    run(
        [
            *(GCC, *CPU_FLAGS[cpu], *FLAGS, *warnings, *options),
            *("-c", str(source), "-o", str(target)),
        ]
    )
    return target


def startup(folder: Path, cpu: str) -> list[Path]:
    """Objects of start-up and measurement."""
    return [
        compile_c(CORTEX_M / f"{name}.c", folder / f"{name}.o", cpu, options=["-std=gnu99"])
        for name in ("startup", "measure")
    ]


def link(objects: Sequence[Path], target: Path, cpu: str) -> str:
    """Link `objects` into `target`; returns the map file's text."""
    map_file = target.with_suffix(".map")
    run(
        [
            *(GCC, *CPU_FLAGS[cpu], *FLAGS, "--specs=rdimon.specs", "-nostartfiles"),
            *map(str, objects),
            *("-lm", f"-T{CORTEX_M / 'cortex_m.ld'}", "-Wl,--gc-sections", f"-Wl,-Map={map_file}"),
            *("-o", str(target)),
        ]
    )
    return map_file.read_text()


def emulate(program: Path, cpu: str, *, folder: Path | None = None) -> str:
    """What `program` prints; files that it opens are those in `folder`."""
    return run(emulator(program, cpu), folder=folder)


def emulator(program: Path, cpu: str) -> list[str]:
    """The command that runs `program`."""
    return [
        *(QEMU, "-M", MACHINES[cpu], "-icount", "shift=1", "-nographic", "-monitor", "none"),
        *("-serial", "none", "-semihosting-config", "enable=on,target=native"),
        *("-kernel", str(program.resolve())),
    ]


def build_by_cmake(folder: Path) -> None:
    """Build an export by the CMake project in it: self-test on this machine, and each target."""
    host = str(folder / "host")
    run([CMAKE, "-S", str(folder), "-B", host])
    run([CMAKE, "--build", host])
    run([CTEST, "--test-dir", host])
    for cpu in CPU_FLAGS:
        target = str(folder / f"{cpu}-cmake")
        toolchain = str((folder / "cortex-m.cmake").resolve())
        run([CMAKE, "-S", str(folder), "-B", target, "--toolchain", toolchain, f"-DCPU={cpu}"])
        run([CMAKE, "--build", target])


def undefined(objects: Sequence[Path]) -> set[str]:
    """Names that `objects` take from elsewhere, from one another too."""
    found = run([NM, "--undefined-only", "--format=just-symbols", *map(str, objects)])
    return {name for name in found.split() if not name.endswith(":")}


def double_symbols(objects: Sequence[Path]) -> list[str]:
    """Functions of double that `objects` call."""
    return sorted(name for name in undefined(objects) if DOUBLE.fullmatch(name))


def run(command: Sequence[str], *, folder: Path | None = None, errors: bool = False) -> str:
    """Output of a command, with what it writes to its standard error behind it if asked for.

    Raises
    ------
    RuntimeError
        If it fails, with all that it said.
    """
    done = subprocess.run(
        command, cwd=folder, capture_output=True, text=True, check=False, timeout=SECONDS
    )
    if done.returncode:
        said = (done.stdout + done.stderr).strip()
        raise RuntimeError(f"{' '.join(command)}\nended with {done.returncode}:\n{said}")
    return done.stdout + (done.stderr if errors else "")
