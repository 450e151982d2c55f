"""What CasADi generates, made fit for a flight computer: no static state, no double in float.

CasADi writes `#error` where it has no C, calls into libraries that are elsewhere, keeps the memory
of its solvers in static variables, and in single precision still writes double literals and calls
the double functions of libm. Here the first two are refused, and the others changed in its text.
"""

from __future__ import annotations

import re
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from curvcasadi.export import solver_c
from curvcasadi.export.casadi_c import external, work_vector
from curvcasadi.export.casadi_c.null_checks import (
    without_failure_checks,
    without_null_checks,
    without_null_copies,
)
from curvcasadi.export.solver_c import SolverC
from curvcasadi.solvers.embedded import SolverFunction
from curvcasadi.symbolic.expressions import Real

#: What can be written instead, by what CasADi calls the part.
_INSTEAD = {
    "Daqp": "the solver itself, not a Function that calls it",
    "Qpoases|Osqp|Highs|Hpipm|Ipqp|Proxqp|Piqp|Cplex|Gurobi|Clp|Ooqp": "the QP solver 'qrqp'",
    "Ipopt|Sqp|Scpgen|Alpaqa|Fatrop|Knitro|Worhp|Snopt|Bonmin": "nlpsol(…, 'sqpmethod', …) with "
    "qpsol 'qrqp', or shape_target_function and tip_path_step_function",
    "Newton|Kinsol|ImplicitToNlp": "rootfinder(…, 'fast_newton', …)",
    "Cvodes|Idas|Collocation|RungeKutta": "integrator(…, 'rk', …, {'simplify': True})",
    "SymbolicQr|Csparse|Mumps|Lapack|Ma27|Ma57|Ma97|Ma86": "the linear solver 'qr' or 'ldl'",
    "External": "the CasADi expressions themselves, or C of yours that calls the exported function",
    "Callback": "CasADi expressions: Python does not become C",
    "ThreadMap|OmpMap": "map(n) or map(n, 'serial')",
    "does not have": "real='double', inf where a bound is none, 0 where a number is",
    "erfinv": "an approximation of your own",
    "printme|Monitor": "the same without monitors and print options",
}
#: The same for solvers of this package.
_OWN_SOLVER = (
    "qp_solver='own', and of an Mpc solver='rti' or 'sqp', as in mpc.copy(solver='sqp', "
    "qp_solver='own'), whose loop and quadratic programs are C of this package"
)
_ALLOWED_HEADERS = {"math.h", "stdarg.h", "stdio.h"}
_LIBM = (
    "acos acosh asin asinh atan atan2 atanh ceil copysign cos cosh erf exp expm1 fabs floor fma "
    "fmax fmin fmod hypot log log10 log1p pow sin sinh sqrt tan tanh trunc"
).split()
_FLOAT = re.compile(r"(?<![\w.])(?:\d+\.\d*|\.\d+|\d+(?=[eE]))(?:[eE][+-]?\d+)?(?![\w.])")
_SMALLEST_FLOAT = float(np.finfo(np.float32).smallest_subnormal)
_LARGEST_FLOAT = float(np.finfo(np.float32).max)
_COMMENT = re.compile(r"(/\*.*?\*/|\"(?:\\.|[^\"\\])*\"|^[ \t]*#[ \t]*include[^\n]*)", re.S | re.M)


def generate(
    functions: Sequence[ca.Function], stem: str, real: Real
) -> tuple[str, str, dict[str, dict[str, int]]]:
    """Source and header of `functions`, in files of the name `stem`, and lengths of their buffers.

    Raises
    ------
    ValueError
        If a part of a function has no C of its own: names the function and what to use instead.
    """
    solvers, plain = [], []
    for function in functions:
        if isinstance(function, SolverFunction) and function.solver.is_exportable:
            solvers.append(_solver_c(function, stem, real))
        else:
            plain.append(function)
    parts = [part for solver in solvers for part in solver.parts]
    for function in [*plain, *parts]:
        _refuse_unsupported(function, real)
    made = [*plain, *parts]
    source, header = (_with_own_names(text, made, stem) for text in _generated(made, stem, real))
    source, work = work_vector.compacted(_without_static_memory(source), made)
    sizes = {f.name(): _sizes(f, work) for f in plain}
    integers = {name: size["iw"] for name, size in sizes.items()}
    source, header = (
        work_vector.told(work_vector.told(text, work), integers, "iw") for text in (source, header)
    )
    source = without_null_copies(without_failure_checks(without_null_checks(source)))
    if solvers:
        own = {solver.function.name(): solver.sizes(work) for solver in solvers}
        source, header = _with_solvers(source, header, solvers, own, stem, real)
        sizes |= own
    source = _with_prototypes(source, stem)
    if real == "float":
        source = _single_precision(source, stem)
    return *external.readable(source, header), sizes


def _with_prototypes(source: str, stem: str) -> str:
    """`source` of which all that is not static has a prototype before it."""
    helper = r"^((?:void|casadi_real|casadi_int|int) casadi_\w+\([^{};]*\)) \{"
    source = re.sub(helper, r"\1;\n\g<0>", source, flags=re.M)
    return source.replace("#include <math.h>\n", f'#include <math.h>\n\n#include "{stem}.h"\n', 1)


def _sizes(function: ca.Function, work: Mapping[str, int]) -> dict[str, int]:
    """Lengths of the buffers of a generated function."""
    return {
        "arg": function.sz_arg(),
        "res": function.sz_res(),
        "iw": work_vector.integers(function),
        "w": work[function.name()],
    }


def _solver_c(function: SolverFunction, stem: str, real: Real) -> SolverC:
    prefix = stem.removesuffix("_functions")
    return SolverC(function=function, symbol=lambda f: symbol(f, prefix), real=real)


def _with_solvers(
    source: str,
    header: str,
    solvers: Sequence[SolverC],
    sizes: Mapping[str, Mapping[str, int]],
    stem: str,
    real: Real,
) -> tuple[str, str]:
    """Source and header with solvers and lengths of their buffers; their parts become static."""
    for part in (part for solver in solvers for part in solver.parts):
        name = symbol(part, stem.removesuffix("_functions"))
        start = r"^(?:CASADI_SYMBOL_EXPORT )?[\w ]+[ *]+"
        body = r"\([^\n]*\{(?:[^\n]*\}\n|\n.*?^\}\n)"
        others = rf"{start}{name}_(?:{_PUBLIC}){body}"
        source = re.sub(others, "", source, flags=re.M | re.S)
        source = re.sub(rf"^\w+ (?=int {name}\()", "static ", source, flags=re.M)
        header = re.sub(rf"^[^\n]*\b{name}\w*\([^\n]*;\n", "", header, flags=re.M)
        header = re.sub(rf"^#define {part.name()}_SZ_\w+ \d+\n", "", header, flags=re.M)
    for pattern in re.findall(r"^#define (casadi_s\d+) ", source, re.M):
        if len(re.findall(rf"\b{pattern}\b", source)) == 2:  # its macro and itself
            source = re.sub(rf"^#define {pattern} [^\n]*\n", "", source, flags=re.M)
            table = rf"^static const casadi_int {pattern}\[[^;]*;\n"
            source = re.sub(table, "", source, flags=re.M)
    prefix = stem.removesuffix("_functions")
    text = solver_c.source(solvers, prefix, real)
    declared = "".join(
        f"{solver_c.prototype(s.symbol(s.function))};\n"
        + _size_macros(s.function.name(), sizes[s.function.name()])
        for s in solvers
    )
    end = "#ifdef __cplusplus\n}"
    before, after = source.rsplit(end, 1)
    head, tail = header.rsplit(end, 1)
    return f"{before}{text}\n{end}{after}", f"{head}{declared}{end}{tail}"


def _size_macros(name: str, sizes: Mapping[str, int]) -> str:
    """Lengths of buffers, as CasADi writes them for its own functions."""
    return "".join(f"#define {name}_SZ_{key.upper()} {size}\n" for key, size in sizes.items())


def symbol(function: ca.Function, prefix: str) -> str:
    """The name of what was generated of `function`, that of no other export."""
    return f"{prefix}_casadi_{function.name()}"


def float_macros() -> str:
    """Function-like macros from the names of libm to those of its float functions."""
    one = {name: f"#define {name}(x) {name}f(x)" for name in _LIBM}
    two = ("atan2", "copysign", "fmax", "fmin", "fmod", "hypot", "pow")
    one |= {name: f"#define {name}(x, y) {name}f(x, y)" for name in two}
    one["fma"] = "#define fma(x, y, z) fmaf(x, y, z)"
    return "\n".join(one.values())


def _generated(functions: Sequence[ca.Function], stem: str, real: str) -> tuple[str, str]:
    options: dict[str, Any] = {"with_header": True, "casadi_int": "int", "casadi_real": real}
    generator = ca.CodeGenerator(f"{stem}.c", options)
    for function in functions:
        generator.add(function)
    with tempfile.TemporaryDirectory() as folder:
        generator.generate(f"{folder}/")
        return Path(folder, f"{stem}.c").read_text(), Path(folder, f"{stem}.h").read_text()


def _refuse_unsupported(function: ca.Function, real: str) -> None:
    parts = {f.class_name() for f in [function, *function.find_functions()]}
    for kind in ("External", "Feasiblesqpmethod", "ThreadMap", "OmpMap"):
        if kind in parts:
            raise _unsupported(function, kind)
    source, _ = _generated([function], "part", real)
    for line in source.splitlines():
        if "#error" in line:
            raise _unsupported(function, line.strip().removeprefix("#error").strip())
        include = re.match(r"\s*#include <(.*)>", line)
        if include and include[1] not in _ALLOWED_HEADERS:
            foreign = [part for part in parts if part.endswith("Interface")]
            raise _unsupported(function, f"{', '.join(foreign)} ({include[1]})")
    code = _COMMENT.sub("", source)
    for number in _FLOAT.findall(code) if real == "float" else ():
        if float(number) and not _SMALLEST_FLOAT <= float(number) <= _LARGEST_FLOAT:
            raise _unsupported(function, f"the number {number}, which real='float' does not have")
    if re.search(r"\berfinv\(", code):
        raise _unsupported(function, "a call of erfinv, of which C has none")
    for call in ("printf", "CASADI_PRINTF", "malloc", "calloc", "free"):
        if re.search(rf"\b{call}\(", code):
            raise _unsupported(function, f"a call of {call}, as printme and print options do")


def _unsupported(function: ca.Function, part: str) -> ValueError:
    instead = [use for kinds, use in _INSTEAD.items() if re.search(kinds, part, re.I)]
    if isinstance(function, SolverFunction) and not function.solver.is_exportable:
        instead = [_OWN_SOLVER]
    return ValueError(
        f"functions: {function.name()!r} holds a part without self-contained C: {part}; "
        f"use {instead[0] if instead else 'parts that CasADi generates itself'}"
    )


def _with_own_names(text: str, functions: Sequence[ca.Function], stem: str) -> str:
    """`text` with all that it makes public named as in `symbol`, so that exports link together."""
    prefix = stem.removesuffix("_functions")
    for f in functions:
        public = rf"^((?:CASADI_SYMBOL_EXPORT )?[\w ]+\*? ){f.name()}(?=(?:_(?:{_PUBLIC}))?\()"
        text = re.sub(public, rf"\g<1>{symbol(f, prefix)}", text, flags=re.M)
    return text


#: What CasADi writes beside every function, by the ends of their names.
_PUBLIC = (
    "checkout|release|incref|decref|n_in|n_out|default_in|name_in|name_out|sparsity_in|"
    "sparsity_out|work|work_bytes"
)


def _without_static_memory(source: str) -> str:
    """The memory of each SQP solver on the stack of its call, so that calls are reentrant."""
    for solver in sorted(set(re.findall(r"^static int (casadi_f\d+)_mem_counter", source, re.M))):
        for pattern, text in _ON_STACK:
            source = re.sub(pattern.replace("SOLVER", solver), text, source, flags=re.M)
    if not re.search(r"\bmid *=", source):
        source = re.sub(r"^( *int [^;\n]*), mid;", r"\1;", source, flags=re.M)
        source = re.sub(r"^ *int mid;\n", "", source, flags=re.M)
    return source


_ON_STACK = (
    (r"^static (?:int|struct \w+) SOLVER_(?:mem|unused|ref)\w*\b[^\n]*;\n", ""),
    (r"^(?:int|void) SOLVER_[a-z_]+\((?:void|int mem)\) \{\n(?:.*\n)*?\}\n", ""),
    (r"(struct \w+)\* d=&SOLVER_mem\[mem\];", r"\1 memory;\n  \1* d=&memory;"),
    (r"^ *mid = SOLVER_checkout\(\);\n *if \(mid<0\) return 1;\n", ""),
    (r"^ *SOLVER_(?:release|incref|decref)\(\w*\);\n", ""),
    (r"(= SOLVER\(\w+, \w+, \w+, \w+, )mid\)", r"\g<1>0)"),
)


def _single_precision(source: str, stem: str) -> str:
    """`source` with float literals, and the float functions of libm."""
    pieces = _COMMENT.split(source)
    pieces[::2] = [_FLOAT.sub(r"\g<0>f", piece) for piece in pieces[::2]]
    prefix = stem.removesuffix("_functions")
    return f'#include "{prefix}_float.h"\n' + "".join(pieces)
