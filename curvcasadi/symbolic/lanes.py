"""Generated C as C++ over lanes: one wing in each lane of a vector register.

CasADi's C for the Functions of this package is straight-line arithmetic. Compiled as C++ with a
vector of numbers for `casadi_real` (`templates/lanes.h`) it evaluates as many wings at once. What
looks at a number to decide where to go on has to be said in another way, or refused:

    (a ? b : 0)                     selection, lane by lane
    arg[i] ? arg[i][j] : 0          every input is given; zeros where a call leaves one out
    if (condition) f(…); else g(…)  both, where lanes differ, and a selection (CasADi's `Switch`)
"""

from __future__ import annotations

import re
from importlib.resources import files

import casadi as ca

#: Functions of numbers that `templates/lanes.h` does not have.
_REFUSED = (
    "LOG POW CONSTPOW FMOD ERF ERFINV SINH COSH TANH ASINH ACOSH ATANH LOG1P EXPM1 HYPOT "
    "LOGSUMEXP REMAINDER FIND LOW GETNONZEROS_PARAM ADDNONZEROS_PARAM SETNONZEROS_PARAM ASSERTION "
    "MONITOR PRINTME DUMP BSPLINE CONVEXIFY"
).split()
_OPERATIONS = {getattr(ca, f"OP_{name}"): name.lower() for name in _REFUSED}
#: What a Function may be made of.
_CLASSES = ("SXFunction", "MXFunction", "Switch", "Map")
#: CasADi's own functions that go the same way whatever the numbers are.
_HELPERS = (
    "axpy bilin clear copy densify diff dot fill kron ldl ldl_solve ldl_trs mmax mmin mtimes "
    "mtimes_dense mv mv_dense norm_1 norm_2 norm_fro norm_inf project rank1 scal sparsify sumsqr "
    "swap trans tri_project trilsolve triusolve vfmax vfmin"
).split()
#: Those of one number, for which `templates/lanes.h` has others.
_OWN = ("fabs", "fmax", "fmin", "sign", "sq")

_PLACE = r"(?:\w+(?:\[i\])?|\(\*\w+\+\+\))"
_SELECTION = re.compile(rf"\(({_PLACE}) ?\? ?({_PLACE}) ?: ?0\)")
_BRANCH = re.compile(
    r"^/\* \w+:\([^\n]*?\)->\((?P<outputs>[^\n]*)\) \*/\n"
    r"(?P<head>static int casadi_f\d+\([^\n]*\{\n)"
    r"  if \(arg\[0\] \? casadi_to_int\(\*arg\[0\]\) : 0\) \{\n"
    r"    if \((?P<yes>casadi_f\d+)\(arg\+1, res, iw, w, 0\)\) return 1;\n"
    r"  \} else \{\n"
    r"    if \((?P<no>casadi_f\d+)\(arg\+1, res, iw, w, 0\)\) return 1;\n"
    r"  \}\n",
    re.M,
)
_SIZE = re.compile(r"\w+(?:\[(\d+)(?:x(\d+))?(?:,(\d+)nz)?\])?")


def refuse(f: ca.Function) -> None:
    """Refuse, by name, what `f` holds that does not work on lanes.

    Raises
    ------
    ValueError
        Names the part of `f` and what it calls.
    """
    for part in [f, *f.find_functions()]:
        kind = part.class_name()
        if kind not in _CLASSES:
            raise _refused(f, part, f"is a {kind}")
        if kind not in ("SXFunction", "MXFunction"):
            continue
        calls = {part.instruction_id(k) for k in range(part.n_instructions())} & set(_OPERATIONS)
        if calls:
            names = ", ".join(sorted(_OPERATIONS[call] for call in calls))
            raise _refused(f, part, f"calls {names}")


def source(f: ca.Function, real: str) -> str:
    """C++ of a library with the function `batch`, which evaluates `f` over a batch."""
    generator = ca.CodeGenerator("lanes.c", {"casadi_int": "int", "casadi_real": "Number"})
    generator.add(f)
    text, entry = _body(f, generator.dump())
    text = _SELECTION.sub(r"if_else_zero(\1, \2)", text)
    text = _without_null_inputs(f, _BRANCH.sub(_both, text))
    _refuse_branches(f, text)
    ports = "\n".join(
        _port(f"{name}{i}", pattern)
        for name, patterns in (("in", _patterns(f, "in")), ("out", _patterns(f, "out")))
        for i, pattern in enumerate(patterns)
    )
    nonzeros = [p.nnz() for way in ("in", "out") for p in _patterns(f, way)]
    sizes = {
        "LANES_FLUSH": int(real == "float"),
        "INPUTS": f.n_in(),
        "OUTPUTS": f.n_out(),
        "ARGUMENTS": f.sz_arg() + 1,
        "RESULTS": f.sz_res() + 1,
        "INTEGERS": f.sz_iw() + 1,
        "MEMORY": sum(nonzeros) + f.sz_w() + 1,
        "EVALUATE": entry,
    }
    return "\n".join(
        [
            f"#define LANES_REAL {real}",
            template("lanes.h"),
            text,
            "struct Port { int nonzeros; const int *row, *column; };",
            ports,
            *(_table(name, getattr(f, f"n_{name}")()) for name in ("in", "out")),
            *(f"#define {name} {value}" for name, value in sizes.items()),
            template("batch.cpp"),
        ]
    )


def _refuse_branches(f: ca.Function, text: str) -> None:
    """Refuse what has no C of its own, or still looks at a number to decide where to go on."""
    code = re.sub(r"/\*.*?\*/", "", text[text.index("static int casadi_f") :], flags=re.S)
    for pattern, why in (
        (r"#error (.*)", "of which CasADi makes no C"),
        (r"\b(?:switch|casadi_to_int) ?\(.*", "with a branch in more than two ways"),
        (r"[^\n]*\?.*", "with a branch"),
    ):
        found = re.search(pattern, code)
        if found:
            raise _refused(f, f, f"holds a part {why} ({found[0].strip()})")


def _refused(f: ca.Function, part: ca.Function, why: str) -> ValueError:
    place = "" if part.name() == f.name() else f" holds {part.name()!r}, which"
    return ValueError(
        f"f: {f.name()!r}{place} {why}: this does not work on lanes; use compile_function or f.map"
    )


def _body(f: ca.Function, text: str) -> tuple[str, str]:
    """The functions in `text` without what describes `f`, and the name of the one that is `f`."""
    start = text.index("#ifndef casadi_int\n")
    found = re.search(rf"^CASADI_SYMBOL_EXPORT int {f.name()}\(.*\{{\n  return (\w+)\(", text, re.M)
    if found is None:
        raise RuntimeError(f"{f.name()!r}: CasADi's C has changed; expected a function of its name")
    body = text[start : found.start()]
    body = re.sub(r"^CASADI_SYMBOL_EXPORT .*\{(?:.*\}\n|\n(?:.*\n)*?\}\n)", "", body, flags=re.M)
    body = re.sub(r"^#define casadi_\w+ CASADI_PREFIX.*\n", "", body, flags=re.M)
    for name in _OWN:
        definition = rf"^casadi_real casadi_{name}\(.*\{{\n?(?:.*\n)*?.*\}}\n"
        body = re.sub(definition, "", body, count=1, flags=re.M)
    helpers = set(re.findall(r"^(?:static )?\w+ casadi_([a-z]\w*)\(.*\{", body, re.M))
    helpers -= {name for name in helpers if re.fullmatch(r"f\d+", name)}
    unknown = helpers - set(_HELPERS)
    if unknown:
        names = ", ".join(f"casadi_{name}" for name in sorted(unknown))
        raise _refused(f, f, f"calls {names}")
    own = "".join(f"#define casadi_{name} lanes::{name}\n" for name in _OWN)
    types = "#define casadi_real Number\n#define casadi_inf INFINITY\n"
    return types + own + body, found[1]


def _both(match: re.Match[str]) -> str:
    """A branch of two functions as a selection."""
    sizes = []
    for rows, columns, nonzeros in _SIZE.findall(match["outputs"]):
        sizes.append(nonzeros or str(int(rows or 1) * int(columns or 1)))
    call = f"either<{', '.join(sizes)}>(*arg[0], {match['yes']}, {match['no']}, arg+1, res, iw, w)"
    return f"{match['head']}  if ({call}) return 1;\n"


def _without_null_inputs(f: ca.Function, text: str) -> str:
    """Zeros for inputs that a call leaves out, a place for outputs that it does not want."""
    parts = [f, *f.find_functions()]
    zeros = max(p.numel() for g in parts for p in [ca.Sparsity(1, 1), *_patterns(g, "in")])
    sink = max(p.numel() for g in parts for p in [ca.Sparsity(1, 1), *_patterns(g, "out")])
    value = r"(arg\[\1\](?:\[\d+\]|\+\d+)?)"
    text = re.sub(rf"\barg\[(\d+)\] ?\? {value} : (?:0|casadi_zeros)\b", r"\2", text)
    text = re.sub(r"^(\s*arg\d+\[\d+\]=)0;", r"\1given_zeros;", text, flags=re.M)
    text = re.sub(r"^(\s*res\d+\[\d+\]=)0;", r"\1unwanted;", text, flags=re.M)
    text = re.sub(r"\bif \(res\[\d+\](?:!=0)?\) ", "", text)
    pieces = re.split(r"^(static int casadi_f\d+\(.*\{\n)", text, flags=re.M)
    for k in range(1, len(pieces), 2):
        if "unwanted;" in pieces[k + 1]:
            pieces[k] += f"  casadi_real unwanted[{sink}];\n"
    return f"static const Number given_zeros[{zeros}] = {{0}};\n" + "".join(pieces)


def _patterns(f: ca.Function, way: str) -> list[ca.Sparsity]:
    """Sparsity patterns of the inputs or outputs of `f`."""
    return [getattr(f, f"sparsity_{way}")(i) for i in range(getattr(f, f"n_{way}")())]


def _port(name: str, pattern: ca.Sparsity) -> str:
    """Rows and columns of the nonzeros of an input or output."""
    rows, columns = (", ".join(map(str, side)) or "0" for side in pattern.get_triplet())
    return (
        f"static const int {name}_row[] = {{{rows}}};\n"
        f"static const int {name}_column[] = {{{columns}}};\n"
        f"static const Port {name}_port = {{{pattern.nnz()}, {name}_row, {name}_column}};"
    )


def _table(way: str, count: int) -> str:
    ports = ", ".join(f"{way}{i}_port" for i in range(count))
    return f"static const Port {way}puts[] = {{{ports or '{0, nullptr, nullptr}'}}};"


def template(name: str) -> str:
    return files("curvcasadi.symbolic").joinpath(f"templates/{name}").read_text()
