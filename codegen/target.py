"""Size and speed of exported functions on Cortex-M7 and M4F, against their budgets; RISC-V.

    python -m codegen.target [--only NAME …] [--update] [--out out/codegen]

Exports the libraries of `benchmark_functions`, compiles them for the targets, runs their
self-tests in qemu, each function in a program of its own and, where a library says so, all of them
in one, and prints a table. Fails where a
result is not that of Python, where single precision calls double, and where a number exceeds its
budget by more than 3 %. The self-tests of single precision run on a RISC-V core, too, and cppcheck
looks for rules of MISRA C that the wrappers break.
"""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from codegen import budgets, map_file, misra, riscv, toolchain
from codegen.benchmark_functions import LIBRARIES, RELATIONS, Library

_MEASURED = re.compile(r"^measured (\w+) instructions=(\d+) stack=(\d+)$", re.M)


def measure(
    folder: Path,
    cpu: str,
    real: str,
    programs: Mapping[str, Sequence[str]],
    options: Sequence[str] = (),
) -> dict[str, dict]:
    """Sizes, stack and instructions of `programs`, each of exported functions that it calls."""
    build = folder / cpu
    library = [
        toolchain.compile_c(
            folder / f"{name}.c", build / f"{name}.o", cpu, options=options, real=real
        )
        for name in ("curv", "curv_functions")
    ]
    doubles = toolchain.double_symbols(library) if real == "float" else []
    if doubles:
        raise RuntimeError(f"{folder.name}: single precision calls {', '.join(doubles)}")
    common = [*library, *toolchain.startup(build, cpu)]
    return {
        name: _measure(folder, build, cpu, name, functions, common)
        for name, functions in programs.items()
    }


def _measure(
    folder: Path,
    build: Path,
    cpu: str,
    name: str,
    functions: Sequence[str],
    common: list[Path],
) -> dict[str, int]:
    """Of the program `name`: the instructions of one call of each function, its deepest stack."""
    chosen = [f"-DCHECK_{function}" for function in functions]
    hooks = ["-DCHECK_ONLY", *chosen, '-DCHECK_HOOKS="measure.h"', "-std=gnu99"]
    check = toolchain.compile_c(
        folder / "check.c",
        build / f"check_{name}.o",
        cpu,
        options=[*hooks, f"-I{toolchain.CORTEX_M}"],
    )
    program = build / f"{name}.elf"
    linked = toolchain.link([*common, check], program, cpu)
    printed = toolchain.emulate(program, cpu)
    found = _MEASURED.findall(printed)
    if [function for function, *_ in found] != [*functions]:
        raise RuntimeError(f"{program}: no measurement of {name} in what it printed:\n{printed}")
    own = map_file.sizes(linked, ["curv.o", "curv_functions.o"])
    libm = map_file.sizes(linked, ["libm.a"])
    return {
        "text": own["code"] + own["tables"],
        "tables": own["tables"],
        "libm": libm["code"] + libm["tables"],
        "ram": own["ram"],
        "stack": max(int(stack) for *_, stack in found),
        "instructions": sum(int(instructions) for _, instructions, _ in found),
    }


def measure_all(libraries: Sequence[Library], out: Path) -> dict[str, dict[str, int]]:
    """Numbers of all functions of `libraries` by "library.function.cpu"; two programs at a time."""
    with ThreadPoolExecutor(2) as pool:
        running = {}
        for library in libraries:
            functions = [*library.export(out / library.name)["functions"]]
            programs = {name: [name] for name in functions}
            if library.together:
                programs[library.together] = functions
            for cpu in library.cpus:
                task = (out / library.name, cpu, library.beam.grid.real, programs, library.options)
                running[library.name, cpu] = pool.submit(measure, *task)
        return {
            f"{library}.{function}.{cpu}": numbers
            for (library, cpu), task in running.items()
            for function, numbers in task.result().items()
        }


def table(measured: Mapping[str, Mapping[str, int]]) -> str:
    """One line a function and CPU."""
    rows = [["function", "CPU", *budgets.QUANTITIES]]
    for key, numbers in measured.items():
        library, function, cpu = key.split(".")
        cells = [f"{numbers[quantity]:,}".replace(",", " ") for quantity in budgets.QUANTITIES]
        rows.append([f"{library} {function}", cpu, *cells])
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return "\n".join(
        "  ".join(
            cell.ljust(width) if i < 2 else cell.rjust(width)
            for i, (cell, width) in enumerate(zip(row, widths, strict=True))
        )
        for row in rows
    )


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", nargs="+", metavar="NAME", help="libraries, by name")
    parser.add_argument("--update", action="store_true", help="write the numbers as budgets")
    parser.add_argument("--out", type=Path, default=Path("out/codegen"), metavar="FOLDER")
    options = parser.parse_args()

    missing = toolchain.missing_tools({**toolchain.PACKAGES, **riscv.PACKAGES, **misra.PACKAGES})
    if missing:
        print("\n".join(missing), file=sys.stderr)
        return 2
    chosen = [x for x in LIBRARIES if not options.only or x.name in options.only]
    if not chosen:
        parser.error(f"--only: expected names among {', '.join(x.name for x in LIBRARIES)}")
    measured = measure_all(chosen, options.out)
    toolchain.build_by_cmake(options.out / chosen[0].name)
    print("Bytes, and instructions (not cycles) of the worst sample:\n")
    print(table(measured))
    single = [options.out / x.name for x in chosen if x.beam.grid.real == "float"]
    with ThreadPoolExecutor(2) as pool:
        sizes = [
            f"{f.name} {n}" for f, n in zip(single, pool.map(riscv.self_test, single), strict=True)
        ]
    print(f"\nSelf-tests pass on {riscv.ARCHITECTURE}, bytes of code: {', '.join(sizes)}")
    with ThreadPoolExecutor(2) as pool:
        folders = [options.out / library.name for library in chosen]
        broken = [line for lines in pool.map(misra.violations, folders) for line in lines]
    print(
        "\n".join(
            ["Rules of MISRA C that the wrappers break:", *broken]
            if broken
            else ["The wrappers keep the rules of MISRA C but those named in codegen/misra.py."]
        )
    )
    return compare(measured, update=options.update) or int(bool(broken))


def compare(measured: Mapping[str, Mapping[str, int]], *, update: bool) -> int:
    """Exit status: 1 where `measured` is too much; with `update` it becomes the budget first."""
    allowed, compiler = budgets.load(), toolchain.compiler_version()
    if update:
        allowed = budgets.updated(allowed, measured, compiler)
        budgets.FILE.write_text(budgets.text(allowed))
    related = [pair for relation in RELATIONS for pair in relation.lines(measured)]
    failed = budgets.failures(measured, allowed) + [line for line, holds in related if not holds]
    for title, lines in (
        ("Relations:", [line for line, _ in related]),
        ("Far below their budgets (--update keeps that):", budgets.savings(measured, allowed)),
        ("Too much:", failed),
    ):
        if lines:
            print("\n".join(["", title, *lines]))
    if failed and compiler != allowed.compiler:
        print(f"\nThe budgets are those of {allowed.compiler}; this is {compiler}.")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
