"""Compiling exported C on this machine."""

from __future__ import annotations

from pathlib import Path

from curvcasadi.symbolic.compiled import compile_c, run

STRICT = ("-std=c99", "-pedantic", "-Wall", "-Wextra", "-Wno-unused-parameter", "-Werror")


def run_check(
    directory: str | Path, *, compiler: str = "gcc", optimization: str = "-O1"
) -> dict[str, float]:
    """Compile what `export_c` wrote, run its check program, and return the error per function.

    The error is that of the worst output over its largest entry (at least 1). The compiler takes
    most of the time: solvers compile three times as fast with the `optimization` "-O0".

    Raises
    ------
    FileNotFoundError
        If there is no compiler, or `directory` is not what `export_c` writes.
    RuntimeError
        If the compiler fails, or a function disagrees with Python.
    """
    folder = Path(directory)
    sources = sorted(path.name for path in folder.glob("*.c"))
    if "check.c" not in sources:
        raise FileNotFoundError(f"directory: expected what export_c writes, no check.c in {folder}")
    program = "./check"
    compile_c(sources, program, [*STRICT, optimization], folder=folder, compiler=compiler)
    lines = run([program], folder).splitlines()
    return {name: float(error) for name, error, _ in map(str.split, lines)}
