"""Functions as native code: C that CasADi generates, compiled on this machine."""

from __future__ import annotations

import atexit
import ctypes
import os
import re
import shutil
import subprocess
import tempfile
import warnings
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

import casadi as ca

from curvcasadi.symbolic.derivatives import attached
from curvcasadi.symbolic.expressions import choice, instance

#: A shared library that calls its own functions whatever else is loaded. For straight-line code
#: `-O2` is no faster and takes twice as long.
_LIBRARY = ("-std=c99", "-O1", "-fPIC", "-shared", "-Wl,-Bsymbolic")
#: In C a function bears this behind its name, so that a Function may be called "sin" or "double".
_SUFFIX = "_native"
#: Parts of a Function that are no C of their own: calls back into Python or another library.
_FOREIGN = ("External", "CallbackInternal")


def compile_function(
    f: ca.Function, real: str = "double", *, derivatives: int = 1, compiler: str = "gcc"
) -> ca.Function:
    """`f` as native code, for simulations and predictive control on a PC.

    The C that CasADi generates is compiled and loaded. The library is cached by a hash
    of the C and of the compiler, in `curvcasadi` below `XDG_CACHE_HOME` or `~/.cache`, so the same
    Function is compiled once on a machine. Files there may be deleted at any time.

    Parameters
    ----------
    f : casadi.Function
        A Function without free symbols and without parts that are no C: solvers that CasADi cannot
        generate, callbacks, and Functions that are compiled already.
    real : {"double"}
        Arithmetic of the native code.
    derivatives : {0, 1, 2}
        How many times CasADi can differentiate the result. 1 compiles the Jacobian of `f` too, the
        attached one where there is one; 2 also that Jacobian's own, for exact Hessians; 0 saves the
        time to compile any.
    compiler : str
        Name or path of a C compiler that takes the options of gcc.

    Returns
    -------
    casadi.Function
        With the name, inputs and outputs of `f`. It may be pickled for another process on this
        machine. It cannot be exported as C: export `f`. Without a compiler it is `f` itself, in
        CasADi's virtual machine, and a warning says so.

    Raises
    ------
    ValueError
        If `f` has free symbols, or a part that CasADi does not generate as C.
    RuntimeError
        If the compiler fails.
    """
    instance("f", f, ca.Function)
    choice("real", real, ("double",))
    choice("derivatives", derivatives, (0, 1, 2))
    refuse_foreign(f)
    if shutil.which(compiler) is None:
        warnings.warn(
            f"compile_function: found no {compiler!r} on the PATH, so {f.name()!r} stays in "
            "CasADi's virtual machine; Debian: apt-get install gcc",
            stacklevel=2,
        )
        return f
    levels = [f]
    for _ in range(derivatives):
        levels.append(levels[-1].jacobian())
    source = _source(levels)
    library = _path(source, _LIBRARY, compiler)
    if not library.exists():
        _build(source, library, compiler)
    try:
        return _loaded(levels, library)
    except RuntimeError:  # a file that was damaged since
        _build(source, library, compiler)
        return _loaded(levels, library)


def compile_c(
    sources: Sequence[str | Path],
    output: str | Path,
    options: Sequence[str],
    *,
    folder: str | Path = ".",
    compiler: str = "gcc",
) -> None:
    """Compile C `sources` to `output`, linked with libm; paths are relative to `folder`.

    Raises
    ------
    FileNotFoundError
        If there is no such compiler.
    RuntimeError
        If the compiler fails; the message holds what it wrote.
    """
    if shutil.which(compiler) is None:
        raise FileNotFoundError(
            f"compiler: expected {compiler!r} on the PATH, found none; Debian: apt-get install gcc"
        )
    run([compiler, *options, *map(str, sources), "-o", str(output), "-lm"], folder)


def run(command: Sequence[str], folder: str | Path = ".") -> str:
    """What `command`, run in `folder`, writes to its standard output.

    Raises
    ------
    RuntimeError
        If the command fails; the message holds what it wrote.
    """
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(f"{' '.join(command)} failed:\n{done.stdout}{done.stderr}")
    return done.stdout


def refuse_foreign(f: ca.Function) -> None:
    """Refuse free symbols, and parts that are no C of their own."""
    if f.has_free():
        raise ValueError(f"f: {f.name()!r} has free symbols {f.get_free()}; make each one an input")
    for part in [f, *f.find_functions()]:
        if part.class_name() in _FOREIGN:
            raise ValueError(
                f"f: {f.name()!r} holds {part.name()!r}, which is compiled already or calls Python "
                f"({part.class_name()}); compile a Function of CasADi expressions alone"
            )


def _source(levels: Sequence[ca.Function]) -> str:
    """C of each Function, under a name that no keyword and no function of a C library has."""
    generator = ca.CodeGenerator("native.c")
    for f in levels:
        inputs = _symbols(f)
        options = {"never_inline": True}
        name = f.name() + _SUFFIX
        generator.add(ca.Function(name, inputs, f.call(inputs), f.name_in(), f.name_out(), options))
    source: str = generator.dump()
    foreign = re.search(r"^\s*#error (.*)$|^#include <([^>]*/[^>]*)>", source, re.MULTILINE)
    if foreign:
        raise ValueError(
            f"f: {levels[0].name()!r} holds a part that CasADi does not generate as C of its own: "
            f"{foreign[1] or foreign[2]}"
        )
    return source


def _symbols(f: ca.Function) -> list[ca.MX]:
    return [ca.MX.sym(name, f.sparsity_in(name)) for name in f.name_in()]


def _loaded(levels: Sequence[ca.Function], library: Path) -> ca.Function:
    """The first of `levels` out of `library`; each is the attached Jacobian of the one before."""
    f, *jacobians = levels
    options: dict[str, Any] = {
        "never_inline": True,
        "is_diff_in": f.is_diff_in(),
        "is_diff_out": f.is_diff_out(),
    }
    if jacobians:
        options |= attached(_loaded(jacobians, library))
    inputs = _symbols(f)
    outputs = ca.external(f.name() + _SUFFIX, str(library)).call(inputs)
    return ca.Function(f.name(), inputs, outputs, f.name_in(), f.name_out(), options)


def loaded(source: str, options: Sequence[str], compiler: str, ending: str) -> ctypes.CDLL:
    """The library of a `source` in a file of this `ending`, out of the cache or made for it."""
    library = _path(source, options, compiler)
    if not library.exists():
        _build(source, library, compiler, options, ending)
    try:
        return ctypes.CDLL(str(library))
    except OSError:  # a file that was damaged since
        _build(source, library, compiler, options, ending)
        return ctypes.CDLL(str(library))


def _path(source: str, options: Sequence[str], compiler: str) -> Path:
    """Where the cache has the library of a source."""
    import hashlib

    key = hashlib.sha256("\0".join([source, *options, _identity(compiler)]).encode()).hexdigest()
    return _folder() / f"{key[:40]}.so"


def _build(
    source: str,
    library: Path,
    compiler: str,
    options: Sequence[str] = _LIBRARY,
    ending: str = "c",
) -> None:
    """Compile beside the cache, then rename: other processes see a whole library or none."""
    with tempfile.TemporaryDirectory(dir=library.parent, prefix="build-") as folder:
        name = f"native.{ending}"
        Path(folder, name).write_text(source)
        compile_c([name], "native.so", options, folder=folder, compiler=compiler)
        os.replace(Path(folder, "native.so"), library)


@cache
def _identity(compiler: str) -> str:
    """What the code of a compiler depends on, beside its options and the source."""
    import platform

    return f"{platform.platform()} {platform.machine()} {run([compiler, '--version'])}"


def _folder() -> Path:
    """The cache, which nobody else may write to; a temporary one where there can be none."""
    configured = os.environ.get("XDG_CACHE_HOME", "")
    try:
        base = Path(configured) if os.path.isabs(configured) else Path.home() / ".cache"
        folder = base / "curvcasadi"
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        with tempfile.TemporaryFile(dir=folder):
            return folder
    except (OSError, RuntimeError):  # read-only, full, or no home at all
        return _temporary_folder()


@cache
def _temporary_folder() -> Path:
    folder = tempfile.mkdtemp(prefix="curvcasadi-")
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return Path(folder)
