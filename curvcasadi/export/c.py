"""C99 source, header, check program and manifest of CasADi Functions."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from curvcasadi.expressions import Array, expression, function_name

#: Largest error of the check program, over the largest entry of an output (at least 1): rounding.
_TOLERANCE = 1e-13
_SAMPLES = 5


#: Names that C, its library or the check program has taken.
_TAKEN = frozenset(
    """auto break case char const continue default do double else enum extern float for goto if
    inline int long register restrict return short signed sizeof static struct switch typedef
    union unsigned void volatile while main printf abs acos asin atan atan2 ceil cos cosh div
    erf exp exp2 expm1 fabs floor fma fmax fmin fmod frexp gamma hypot index isfinite isinf
    isnan ldexp lgamma log log10 log1p log2 modf nan pow round signbit sin sinh sqrt tan tanh
    tgamma time trunc y0 y1 j0 j1""".split()
)


def export_c(
    functions: Sequence[ca.Function],
    directory: str | Path,
    *,
    name: str = "curvcasadi_functions",
    reference_inputs: Mapping[str, Sequence[Sequence[Any]]] | None = None,
) -> dict[str, Any]:
    """Write `functions` as C, and a program that compares them with Python.

    Parameters
    ----------
    functions : Functions with different names, such as `tip_function(beam)`
    directory : where to write; made if it does not exist
    name : of the source and header files
    reference_inputs : by function name, the inputs at which the check program compares; five
        weight-sized random ones (|x| ≤ 0.05) unless given

    Returns
    -------
    dict
        The manifest, also written as manifest.json: files, CasADi version, and for every function
        its inputs and outputs with their shapes and the sizes of its buffers.

    Raises
    ------
    ValueError
        If names collide, a symbol is left free, or CasADi has no C for a part of a function.
    """
    functions = _checked(functions)
    function_name("name", name)
    if name == "check":
        raise ValueError("name: expected another than that of the check program, found 'check'")
    references = _references(functions, reference_inputs or {})
    folder = Path(directory)
    folder.mkdir(parents=True, exist_ok=True)
    generator = ca.CodeGenerator(f"{name}.c", {"with_header": True, "casadi_int": "int"})
    for function in functions:
        generator.add(function)
    generator.generate(f"{folder}/")
    _refuse_unsupported(folder / f"{name}.c", functions)

    (folder / "check.c").write_text(_check_program(name, functions, references))
    manifest = {
        "files": [f"{name}.c", f"{name}.h", "check.c"],
        "casadi": ca.CasadiMeta.version(),
        "functions": {f.name(): _describe(f) for f in functions},
    }
    (folder / "manifest.json").write_text(json.dumps(manifest, indent=2) + "\n")
    return manifest


def _checked(functions: Sequence[ca.Function]) -> list[ca.Function]:
    functions = list(functions) if isinstance(functions, Iterable) else [functions]
    if not functions or not all(isinstance(f, ca.Function) for f in functions):
        raise ValueError(f"functions: expected one or more casadi.Function, found {functions!r}")
    names = [f.name() for f in functions]
    if len(set(names)) < len(names):
        raise ValueError(f"functions: expected different names, found {names}")
    for f in functions:
        if f.name() in _TAKEN or f.name().startswith("check_"):
            raise ValueError(
                "functions: expected names other than C's keywords, those of its library and those "
                f"of the check program, found {f.name()!r}"
            )
        if f.has_free():
            raise ValueError(f"functions: {f.name()!r} has free symbols {f.get_free()}")
    return functions


def _refuse_unsupported(source: Path, functions: list[ca.Function]) -> None:
    """CasADi writes `#error` into the C for what it has no C for; do not leave that to gcc."""
    broken = [line.strip() for line in source.read_text().splitlines() if "#error" in line]
    if broken:
        source.unlink()
        source.with_suffix(".h").unlink()
        names = ", ".join(repr(f.name()) for f in functions)
        raise ValueError(f"functions: CasADi has no C for a part of {names}: {broken[0]}")


def _references(
    functions: list[ca.Function], given: Mapping[str, Sequence[Sequence[Any]]]
) -> dict[str, list[list[ca.DM]]]:
    """Inputs to compare at, by function: those given, else random ones."""
    names = [f.name() for f in functions]
    unknown = sorted(set(given) - set(names))
    if unknown:
        raise ValueError(f"reference_inputs: expected names of {names}, found {unknown}")
    return {
        f.name(): [_sample(f, sample) for sample in given.get(f.name()) or _random_inputs(f)]
        for f in functions
    }


def _sample(f: ca.Function, values: Sequence[Any]) -> list[ca.DM]:
    """One value per input, of its shape and sparsity."""
    where = f"reference_inputs[{f.name()!r}]"
    if len(values) != f.n_in():
        raise ValueError(f"{where}: expected {f.n_in()} inputs, found {len(values)}")
    inputs = []
    for i, value in enumerate(values):
        dense = expression(f"{where}, {f.name_in(i)}", value, f.size_in(i))
        inputs.append(ca.project(dense, f.sparsity_in(i)))
    return inputs


def _random_inputs(f: ca.Function) -> list[list[Array]]:
    random = np.random.default_rng(0)
    return [
        [random.uniform(-0.05, 0.05, f.size_in(i)) for i in range(f.n_in())]
        for _ in range(_SAMPLES)
    ]


def _describe(f: ca.Function) -> dict[str, Any]:
    return {
        "inputs": {f.name_in(i): list(f.size_in(i)) for i in range(f.n_in())},
        "outputs": {f.name_out(i): list(f.size_out(i)) for i in range(f.n_out())},
        "buffers": {"arg": f.sz_arg(), "res": f.sz_res(), "iw": f.sz_iw(), "w": f.sz_w()},
    }


def _check_program(
    name: str, functions: list[ca.Function], references: Mapping[str, list[list[ca.DM]]]
) -> str:
    data, cases = [], []
    for f in functions:
        samples = references[f.name()]
        outputs = [f.call(sample) for sample in samples]
        if not all(m.is_regular() for output in outputs for m in output):
            raise ValueError(
                f"reference_inputs: expected inputs at which {f.name()!r} is finite, found others"
            )
        key = f"check_{f.name()}"
        data += [
            _array("int", f"{key}_in", [f.nnz_in(i) for i in range(f.n_in())]),
            _array("int", f"{key}_out", [f.nnz_out(i) for i in range(f.n_out())]),
            _array("double", f"{key}_inputs", _nonzeros(samples)),
            _array("double", f"{key}_outputs", _nonzeros(outputs)),
        ]
        cases.append(
            f'  {{"{f.name()}", {f.name()}, {f.n_in()}, {f.n_out()}, {key}_in, {key}_out, '
            f"{len(samples)}, {key}_inputs, {key}_outputs}},"
        )
    fields = {
        "NAME": name,
        "REAL": "double",
        "TOLERANCE": repr(_TOLERANCE),
        "SZ_ARG": max(f.sz_arg() for f in functions),
        "SZ_RES": max(f.sz_res() for f in functions),
        "SZ_IW": max(f.sz_iw() for f in functions) or 1,
        "SZ_W": max(f.sz_w() for f in functions) or 1,
        "SZ_IN": max(f.nnz_in() for f in functions) or 1,
        "SZ_OUT": max(f.nnz_out() for f in functions),
        "DATA": "\n".join(data),
        "CASES": "\n".join(cases),
    }
    text = files("curvcasadi.export").joinpath("templates/check.c.in").read_text()
    for key, value in fields.items():
        text = text.replace(f"@{key}@", str(value))
    return text


def _nonzeros(samples: Iterable[Iterable[ca.DM]]) -> list[float]:
    return [x for sample in samples for matrix in sample for x in ca.DM(matrix).nonzeros()]


def _array(kind: str, name: str, values: Sequence[float]) -> str:
    """A constant C array; one entry at least, as C has no empty arrays."""
    entries = ", ".join(repr(value) for value in values) or "0"
    return f"static const {kind} {name}[] = {{{entries}}};"
