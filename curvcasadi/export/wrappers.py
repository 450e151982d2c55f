"""Typed calls of generated functions: their declarations and definitions in C.

A generated function takes arrays of pointers and buffers, and does not report a wrong result. Its
wrapper has an argument for every input and a struct for the outputs, refuses bad input, and gives
out only results that it has checked.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import casadi as ca
import numpy as np

from curvcasadi.beam.beam import Beam
from curvcasadi.export.c_function import STATIONARITY, TAKEN, VIOLATION, CFunction
from curvcasadi.export.casadi_c import generate as generated
from curvcasadi.kinematics.resolution import elements_that_may_exceed
from curvcasadi.kinematics.shape import squared_element_angles
from curvcasadi.kinematics.weights import tolerated_bounds
from curvcasadi.symbolic.expressions import BOUND_SLACK, Real

_RESERVED = TAKEN | {"out", "work", "buffers", "column"}


@dataclass(frozen=True, eq=False, kw_only=True)
class Wrapper:
    """A function with the generated ones that check its weights, by input."""

    export: CFunction
    angles: dict[str, ca.Function]  #: weights -> largest squared element angle over its limit
    prefix: str  #: of all names in C
    real: str
    work: dict[str, dict[str, int]]  #: lengths of buffers, by the names of generated functions

    @property
    def name(self) -> str:
        return f"{self.prefix}_{self.export.name}"

    @property
    def sizes(self) -> dict[str, int]:
        """Lengths of the buffers that serve every generated function which is called."""
        called = [self.export.function, *self.angles.values()]
        sizes = {key: max(self.work[f.name()][key] for f in called) for key in _BUFFERS}
        work = [self.work[f.name()]["w"] for f in called]
        work[1:] = [size + 1 for size in work[1:]]  # one more, for the angle that they return
        return sizes | {"w": max(work)}

    @property
    def inputs(self) -> list[tuple[str, str, int]]:
        """(name, name in C, entries) of the inputs that have any."""
        f = self.export.function
        return [(k, _c_name(k), f.nnz_in(k)) for k in f.name_in() if f.nnz_in(k)]

    @property
    def outputs(self) -> list[tuple[str, str, int]]:
        """(name, name in C, entries) of the outputs that have any."""
        f = self.export.function
        return [(k, _c_name(k), f.nnz_out(k)) for k in f.name_out() if f.nnz_out(k)]


_BUFFERS = ("arg", "res", "iw", "w")


def angle_functions(exports: Iterable[CFunction]) -> dict[Beam, ca.Function]:
    """For every beam whose bounds do not keep its elements' angles: a Function that says them."""
    functions: dict[Beam, ca.Function] = {}
    for beam in (beam for export in exports for beam in export.weights.values()):
        if beam not in functions and elements_that_may_exceed(beam):
            q = ca.MX.sym("q", beam.basis.n)
            limit = beam.grid.max_angle * (1 + BOUND_SLACK[beam.grid.real])
            largest = ca.mmax(squared_element_angles(beam, q)) / limit**2
            name = f"element_angle_{len(functions)}" if functions else "element_angle"
            functions[beam] = ca.Function(name, [q], [largest], ["q"], ["largest"])
    return functions


def refuse_clashes(wrappers: Iterable[Wrapper]) -> None:
    """Raise where C would have one name for two functions, inputs or outputs."""
    owners: dict[str, str] = {}
    macros: dict[str, tuple[str, int]] = {}
    for w in wrappers:
        name = w.export.name
        for public in (name, f"{name}_with", f"{name}_out", f"{name}_work", f"casadi_{name}"):
            _only("names", public, name, owners.setdefault(public, name))
        for side in (w.inputs, w.outputs):
            members: dict[str, str] = {}
            for key, c, _ in side:
                _only(f"inputs and outputs of {name!r}", c, key, members.setdefault(c, key))
        for key, c, size in w.inputs:
            macro, of = f"{name}_N_{c}".upper(), f"{name}.{key}"
            other, other_size = macros.setdefault(macro, (of, size))
            if size != other_size:
                _only("names", macro, of, other)


def _only(what: str, c: str, name: str, other: str) -> None:
    if name != other:
        raise ValueError(
            f"functions: expected {what} that differ in C, found {other!r} and {name!r}, both {c!r}"
        )


def declaration(wrapper: Wrapper) -> str:
    """What a caller sees: words, sizes, output, buffers and both forms of the call."""
    export, name = wrapper.export, wrapper.name
    lines = [f"/* {export.name}: {_signature(export.function)}"]
    lines += [f"     in   {_described(export, key, 'in')}" for key, _, _ in wrapper.inputs]
    lines += [f"     out  {_described(export, key, 'out')}" for key, _, _ in wrapper.outputs]
    sizes = wrapper.sizes
    lines += [
        f"   Buffers: {sizes['w']} @REAL_TYPE@, {sizes['iw']} int, "
        f"{sizes['arg'] + sizes['res']} pointers and the outputs. */"
    ]
    lines += [f"#define {name.upper()}_N_{c.upper()} {size}" for _, c, size in wrapper.inputs]
    lines += ["typedef struct {"]
    lines += [f"  @REAL_TYPE@ {_member(c, size)};" for _, c, size in wrapper.outputs]
    lines += [f"}} {name}_out;", "typedef struct {"]
    lines += [
        f"  const @REAL_TYPE@ *arg[{max(sizes['arg'], 1)}];",
        f"  @REAL_TYPE@ *res[{max(sizes['res'], 1)}];",
        f"  int iw[{max(sizes['iw'], 1)}];",
        f"  @REAL_TYPE@ w[{max(sizes['w'], 1)}];",
        f"  {name}_out out;",
        f"}} {name}_work;",
        f"{_head(wrapper, with_work=False)};",
        f"{_head(wrapper, with_work=True)};",
    ]
    return "\n".join(lines) + "\n"


def definition(wrapper: Wrapper, *, shared: bool) -> str:
    """Both forms of the call, and the bounds of the weights; see `shared_buffers`."""
    tables = "".join(_bounds(wrapper, key, beam) for key, beam in wrapper.export.weights.items())
    buffers = f"&buffers.{wrapper.export.name}" if shared else "&buffers"
    own = "" if shared else f"  static {wrapper.name}_work buffers;\n"
    arguments = ", ".join([buffers, *(c for _, c, _ in wrapper.inputs), "out"])
    body = [*_input_checks(wrapper), *_call(wrapper), *_output_checks(wrapper)]
    return (
        f"{tables}{_head(wrapper, with_work=True)} {{\n"
        + "".join(f"  {line}\n" for line in body)
        + f"  *out = work->out;\n  return {wrapper.prefix.upper()}_OK;\n}}\n\n"
        f"{_head(wrapper, with_work=False)} {{\n"
        f"{own}  return {wrapper.name}_with({arguments});\n}}\n"
    )


def shared_buffers(wrappers: Iterable[Wrapper]) -> str:
    """One place for the buffers of all plain calls, which then exclude each other."""
    members = "".join(f"  {w.name}_work {w.export.name};\n" for w in wrappers)
    return f"\nstatic union {{\n{members}}} buffers;\n"


def helpers(wrappers: Iterable[Wrapper]) -> str:
    """Checks that only some functions need."""
    wrappers = list(wrappers)
    text = ""
    if any(w.export.missing for w in wrappers):
        text += _NO_INFINITY
    if any(w.export.weights for w in wrappers):
        text += _WITHIN
    return text


_NO_INFINITY = """
/* NaN stands for a missing sample. */
static int none_infinite(const @REAL_TYPE@ *x, int n) {
  int i;
  for (i = 0; i < n; ++i) {
    if ((x[i] < -LARGEST) || (x[i] > LARGEST)) return 0;
  }
  return 1;
}
"""
_WITHIN = """
static int all_within(const @REAL_TYPE@ *x, int n, const @REAL_TYPE@ *lower,
                      const @REAL_TYPE@ *upper) {
  int i;
  for (i = 0; i < n; ++i) {
    if (!((x[i] >= lower[i]) && (x[i] <= upper[i]))) return 0;
  }
  return 1;
}
"""


def _input_checks(wrapper: Wrapper) -> list[str]:
    export, bad = wrapper.export, f"return {wrapper.prefix.upper()}_BAD_INPUT;"
    lines = []
    for key, c, size in wrapper.inputs:
        where = f"&{c}" if size == 1 else c
        if key in export.weights:
            n = export.weights[key].basis.n
            columns = [where, *(f"&{c}[{k * n}]" for k in range(1, size // n))]
            limits = f"{wrapper.name}_{c}_lower, {wrapper.name}_{c}_upper"
            lines += [f"if (!all_within({x}, {n}, {limits})) {bad}" for x in columns]
            if key in wrapper.angles:
                for x in columns:
                    angle = generated.symbol(wrapper.angles[key], wrapper.prefix)
                    lines += _angle_check(angle, x, bad)
        else:
            check = "none_infinite" if key in export.missing else "all_finite"
            lines.append(f"if (!{check}({where}, {size})) {bad}")
    return lines


def _angle_check(function: str, weights: str, bad: str) -> list[str]:
    return [
        f"work->arg[0] = {weights};",
        "work->res[0] = work->w;",
        f"if ({function}(work->arg, work->res, work->iw, &work->w[1], 0) != 0) {bad}",
        f"if (!(work->w[0] <= 1)) {bad}",
    ]


def _call(wrapper: Wrapper) -> list[str]:
    f = wrapper.export.function
    arguments = {key: f"&{c}" if size == 1 else c for key, c, size in wrapper.inputs}
    results = {key: f"{'&' if size == 1 else ''}work->out.{c}" for key, c, size in wrapper.outputs}
    lines = [f"work->arg[{i}] = {arguments.get(k, '0')};" for i, k in enumerate(f.name_in())]
    lines += [f"work->res[{i}] = {results.get(k, '0')};" for i, k in enumerate(f.name_out())]
    return [
        *lines,
        f"if ({generated.symbol(f, wrapper.prefix)}(work->arg, work->res, work->iw, work->w, 0) "
        f"!= 0) {_failed(wrapper)}",
    ]


def _failed(wrapper: Wrapper) -> str:
    """A map without a finite value was asked too much; a solver without one did not converge."""
    status = "NOT_CONVERGED" if wrapper.export.is_solver else "BAD_INPUT"
    return f"return {wrapper.prefix.upper()}_{status};"


def _output_checks(wrapper: Wrapper) -> list[str]:
    prefix = wrapper.prefix.upper()
    lines = [
        f"if (!all_finite({'&' if size == 1 else ''}work->out.{c}, {size})) {_failed(wrapper)}"
        for _, c, size in wrapper.outputs
    ]
    if wrapper.export.is_solver:
        lines += [
            f"if (!(work->out.{VIOLATION} <= 1)) return {prefix}_INFEASIBLE;",
            f"if (!(work->out.{STATIONARITY} <= 1)) return {prefix}_NOT_CONVERGED;",
        ]
    return lines


def _bounds(wrapper: Wrapper, key: str, beam: Beam) -> str:
    real: Real = "float" if wrapper.real == "float" else "double"
    rows = zip(("lower", "upper"), tolerated_bounds(beam, real), strict=True)
    return "".join(
        f"static const @REAL_TYPE@ {wrapper.name}_{_c_name(key)}_{side}[{beam.basis.n}] = "
        f"{{{', '.join(_literal(x, wrapper.real) for x in values)}}};\n"
        for side, values in rows
    )


def _literal(value: float, real: str) -> str:
    """A number of the exported type; infinite bounds are those of the type."""
    if np.isinf(value):
        return "LARGEST" if value > 0 else "-LARGEST"
    return repr(float(value)) + ("f" if real == "float" else "")


def _head(wrapper: Wrapper, *, with_work: bool) -> str:
    arguments = [f"{wrapper.name}_work *work"] if with_work else []
    arguments += [
        f"const @REAL_TYPE@ {_member(c, size)}" if size > 1 else f"@REAL_TYPE@ {c}"
        for _, c, size in wrapper.inputs
    ]
    arguments += [f"{wrapper.name}_out *out"]
    suffix = "_with" if with_work else ""
    return f"{wrapper.prefix}_status {wrapper.name}{suffix}({', '.join(arguments)})"


def _member(name: str, size: int) -> str:
    return f"{name}[{size}]" if size > 1 else name


def _c_name(name: str) -> str:
    """`name`, or what it becomes where C or the wrapper has taken it."""
    return f"{name}_" if name in _RESERVED else name


def _signature(f: ca.Function) -> str:
    return f"{', '.join(f.name_in()) or 'nothing'} -> {', '.join(f.name_out())}"


def _described(export: CFunction, key: str, side: str) -> str:
    f = export.function
    rows, columns = getattr(f, f"size_{side}")(key)
    sparsity = getattr(f, f"sparsity_{side}")(key)
    shape = f"({rows}, {columns})"
    if not sparsity.is_dense():
        shape += f", its {sparsity.nnz()} nonzeros"
    words = export.words(key)
    if key in export.weights:
        low, high = (float(np.max(np.abs(side))) for side in export.weights[key].bounds)
        words += f"; within bounds, at most {max(low, high):g}"
    if key in export.missing:
        words += "; NaN where a sample is missing"
    return f"{key} {shape}{': ' + words if words else ''}"
