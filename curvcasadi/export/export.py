"""C99 source, typed wrappers, self-test, build files and manifest of CasADi Functions."""

from __future__ import annotations

import json
import warnings
from collections.abc import Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any, Literal

import casadi as ca

from curvcasadi.beam.beam import Beam
from curvcasadi.export import self_test, wrappers
from curvcasadi.export.c_function import TAKEN, TAKEN_FILES, CFunction, c_functions
from curvcasadi.export.casadi_c import generate as generated
from curvcasadi.export.manifest import manifest
from curvcasadi.ocp.mpc import Mpc
from curvcasadi.solvers.embedded import SolverFunction
from curvcasadi.symbolic.expressions import choice, function_name

#: What a caller must know of static memory, by whether it is shared.
_CALLERS = {
    False: "The plain form keeps its buffers in static memory: one caller at a time.",
    True: "The plain forms share buffers in static memory: one caller of any of them at a time,\n"
    "   interrupts included.",
}

#: Options of maps, filters and equilibria; solvers of programs become faster, but grow by a fifth.
_SMALL_AND_FAST = """\
                       # Smaller and faster than -Os, for functions that solve no programs.
                       $<$<AND:$<CONFIG:MinSizeRel>,$<C_COMPILER_ID:GNU>>:-O2$<SEMICOLON>-ffp-contract=fast>
"""


def export_c(
    functions: Sequence[ca.Function | CFunction | Mpc] | ca.Function | CFunction | Mpc,
    directory: str | Path,
    *,
    real: Literal["double", "float"] = "double",
    beam: Beam | None = None,
    name: str = "curv",
    shared_buffers: bool = False,
    reference_inputs: Mapping[str, Sequence[Sequence[Any]]] | None = None,
) -> dict[str, Any]:
    """Write `functions` as C99 with typed, checked wrappers, a self-test and a CMake project.

    In `directory`, for the default name: curv.h and curv.c, the wrappers (`curv_tip(q, &out)`,
    which returns a status and leaves `out` alone unless all is well); curv_functions.c and .h, what
    CasADi generated; check.c, the self-test; CMakeLists.txt and a toolchain file for Cortex-M;
    manifest.json. No recursion, no allocation, no static state but the buffers of the plain
    wrappers. The same functions give the same bytes. Compiled as a shared library in double
    precision, curv_functions.c reads back through `casadi.external("curv_casadi_tip", library)`.

    Parameters
    ----------
    functions : casadi.Function, CFunction, Mpc or sequence of these
        With different names, such as `tip_function(beam)`; a `CFunction` says more of one. Of an
        `Mpc` a whole step is written; its last steps are compared unless others are given.
    directory : str or Path
        Folder to write into; made if it does not exist.
    real : {"double", "float"}
        Type of all numbers; for "float" build the model with `Grid(real="float")`. A warning names
        a solver that was not.
    beam : Beam, optional
        Beam whose weights the inputs q and q_guess of plain Functions are: their wrappers refuse
        weights beyond its bounds or its largest element angle.
    name : str
        Prefix of the files and of all names in the header.
    shared_buffers : bool
        Whether the plain calls share one piece of static memory, as large as the largest of them
        needs: then no two of them may run at once, as from an interrupt.
    reference_inputs : mapping of str to sequence, optional
        By function name, the inputs at which the self-test compares; five weight-sized random ones
        (|x| ≤ 0.05) unless given. Solvers need theirs. The self-test also compares at rest, where a
        loop begins: the first inputs with weights, states and guesses of zero, if those are solved.

    Returns
    -------
    dict
        The manifest, also written as manifest.json: files, CasADi version, hash of the generated
        source, iteration bounds, and for every function its inputs and outputs with their shapes,
        the sizes of its buffers, its nodes, weight bounds and largest element angle.

    Raises
    ------
    ValueError
        If names collide, a symbol is left free, or CasADi has no self-contained C for a part of a
        function.
    """
    choice("real", real, ("double", "float"))
    function_name("name", name)
    if name in TAKEN | TAKEN_FILES:
        raise ValueError(
            "name: expected another than those of the self-test, of words and headers of C and of "
            f"targets of CMake, found {name!r}"
        )
    if not isinstance(directory, str | Path):
        raise ValueError(f"directory: expected a path, found {directory!r}")
    exports = c_functions(functions, beam)
    reference_inputs = {**_examples(functions), **(reference_inputs or {})}
    if name in {f.name for f in exports}:
        raise ValueError(f"name: expected another than that of a function, found {name!r}")
    angles = wrappers.angle_functions(exports)
    casadi_functions = [*(f.function for f in exports), *angles.values()]
    names = [f.name() for f in casadi_functions]
    if len(set(names)) < len(names):
        raise ValueError(f"functions: expected names other than {names[len(exports) :]}")
    source, header, work = generated.generate(casadi_functions, f"{name}_functions", real)
    for export in exports:
        export.refuse_unchecked_solver()
        _warn_of_precision(export.function, real)
    wrapped = [
        wrappers.Wrapper(
            export=f,
            angles={key: angles[b] for key, b in f.weights.items() if b in angles},
            prefix=name,
            real=real,
            work=work,
        )
        for f in exports
    ]
    wrappers.refuse_clashes(wrapped)
    fields = {
        "NAME": name,
        "PREFIX": name.upper(),
        "GUARD": name.upper(),
        "REAL": real,
        "LARGEST": "FLT_MAX" if real == "float" else "DBL_MAX",
        "FUNCTIONS": ", ".join(f.name for f in exports),
        "DECLARATIONS": "\n".join(map(wrappers.declaration, wrapped)),
        "HELPERS": wrappers.helpers(wrapped),
        "BUFFERS": wrappers.shared_buffers(wrapped) if shared_buffers else "",
        "CALLERS": _CALLERS[shared_buffers],
        "DEFINITIONS": "\n".join(wrappers.definition(w, shared=shared_buffers) for w in wrapped),
        "MACROS": generated.float_macros(),
        "OPTIMIZATION": "" if any(f.solves_programs for f in exports) else _SMALL_AND_FAST,
        **self_test.fields(wrapped, reference_inputs),
        "REAL_TYPE": f"{name}_real",  # last: within what is filled in before
    }
    texts = {
        f"{name}.h": _filled("header.h.in", fields),
        f"{name}.c": _filled("source.c.in", fields),
        f"{name}_functions.h": header,
        f"{name}_functions.c": source,
        "check.c": _filled("check.c.in", fields),
        "CMakeLists.txt": _filled("CMakeLists.txt.in", fields),
        "cortex-m.cmake": _filled("cortex-m.cmake.in", fields),
    }
    if real == "float":
        texts[f"{name}_float.h"] = _filled("float.h.in", fields)
    described = manifest(wrapped, source, sorted(texts), real)
    described["shared_buffers"] = shared_buffers
    texts["manifest.json"] = json.dumps(described, indent=2) + "\n"
    folder = Path(directory)
    if folder.exists() and not folder.is_dir():
        raise ValueError(f"directory: expected a folder, found the file {folder}")
    folder.mkdir(parents=True, exist_ok=True)
    for file, text in texts.items():
        (folder / file).write_text(text)
    return described


def _warn_of_precision(function: ca.Function, real: str) -> None:
    """Warn of a solver whose tolerances single precision cannot meet."""
    if real == "float" and isinstance(function, SolverFunction):
        if function.solver.problem.real == "double":
            warnings.warn(
                f"functions: {function.name()!r} solves to tolerances of double precision, which "
                'single precision may not meet; build its beam with Grid(..., real="float")',
                stacklevel=3,
            )


def _examples(functions: Any) -> dict[str, Sequence[Sequence[Any]]]:
    """Inputs of the controllers among the functions, by name."""
    found = [functions] if isinstance(functions, Mpc) else functions
    if not isinstance(found, Sequence):
        return {}
    return {f.function.name(): f.examples for f in found if isinstance(f, Mpc)}


def _filled(template: str, fields: Mapping[str, Any]) -> str:
    text = files("curvcasadi.export").joinpath(f"templates/{template}").read_text()
    for key, value in fields.items():
        text = text.replace(f"@{key}@", str(value))
    return text
