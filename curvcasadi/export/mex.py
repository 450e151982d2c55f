"""Functions for MATLAB and Octave, as the C of a MEX file."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import casadi as ca

from curvcasadi.symbolic.expressions import function_name


def export_mex(
    functions: Sequence[ca.Function] | ca.Function, directory: str | Path, *, name: str = "curv_mex"
) -> Path:
    """Write `functions` as one C file from which MATLAB and Octave build a MEX file.

    ``mex curv_mex.c`` in MATLAB, ``mkoctfile --mex -DMATLAB_MEX_FILE curv_mex.c`` in Octave; then
    ``[position, rotation] = curv_mex('tip', q)``: the first argument names the Function, its
    inputs and outputs follow in their order.

    Parameters
    ----------
    functions : casadi.Function or sequence of these
        With different names and without free symbols.
    directory : str or Path
        Folder to write into; made if it does not exist.
    name : str
        Name of the MEX file.

    Returns
    -------
    Path
        The C file.

    Raises
    ------
    ValueError
        If names collide, a symbol is left free, or a part of a Function is no C of its own.
    """
    function_name("name", name)
    given = functions if isinstance(functions, list | tuple) else [functions]
    parts: list[ca.Function] = []
    for f in given:
        if not isinstance(f, ca.Function):
            raise ValueError(f"functions: expected one or more casadi.Function, found {f!r}")
        parts.append(f)
    names = [f.name() for f in parts]
    if not parts or len(set(names)) < len(names):
        raise ValueError(f"functions: expected Functions of different names, found {names}")
    for f in parts:
        if f.has_free():
            raise ValueError(f"functions: {f.name()!r} has free symbols {f.get_free()}")
    generator = ca.CodeGenerator(f"{name}.c", {"mex": True, "casadi_int": "int"})
    for f in parts:
        generator.add(f)
    source = generator.dump()  # without the entry point, which only the file has
    foreign = re.search(r"^\s*#error (.*)$|^#include <([^>]*/[^>]*)>", source, re.MULTILINE)
    if foreign:
        raise ValueError(
            "functions: expected parts that CasADi generates as C of their own, found "
            f"{foreign[1] or foreign[2]}"
        )
    folder = Path(directory)
    folder.mkdir(parents=True, exist_ok=True)
    generator.generate(f"{folder}/")
    return folder / f"{name}.c"
