"""Compiling exported C on this machine."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

STRICT = ("-std=c99", "-pedantic", "-Wall", "-Wextra", "-Wno-unused-parameter", "-Werror")


def run_check(directory: str | Path, *, compiler: str = "gcc") -> dict[str, float]:
    """Compile what `export_c` wrote, run its check program, and return the error per function.

    The error is that of the worst output over its largest entry (at least 1).

    Raises
    ------
    FileNotFoundError
        If there is no compiler, or `directory` is not what `export_c` writes.
    RuntimeError
        If the compiler fails, or a function disagrees with Python.
    """
    folder = Path(directory)
    if shutil.which(compiler) is None:
        raise FileNotFoundError(
            f"compiler: expected {compiler!r} on the PATH, found none; Debian: apt-get install gcc"
        )
    sources = sorted(path.name for path in folder.glob("*.c"))
    if "check.c" not in sources:
        raise FileNotFoundError(f"directory: expected what export_c writes, no check.c in {folder}")
    program = "./check"
    _run([compiler, *STRICT, "-O1", *sources, "-o", program, "-lm"], folder)
    lines = _run([program], folder).splitlines()
    return {name: float(error) for name, error, _ in map(str.split, lines)}


def _run(command: list[str], folder: Path) -> str:
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(f"{' '.join(command)} failed:\n{done.stdout}{done.stderr}")
    return done.stdout
