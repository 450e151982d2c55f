"""Generated C without questions that have one answer: for pointers never null, for no failure."""

from __future__ import annotations

import re

_DEFINITION = re.compile(r"^(?=(?:static |CASADI_SYMBOL_EXPORT )?\w[\w ]*\**\w+\(.*\) \{$)", re.M)
_SET_OR_CALL = re.compile(
    r"^ *((?:arg|res)\d+)\[(\d+)\]=(.*);$|\b(casadi_f\d+)\((?:(\w+), (\w+),)?", re.M
)
#: Values of pointers that are never null: parts of the work vector, inputs replaced by zeros.
_NOT_NULL = re.compile(r"\(?&?w\w*(\+\d+)?\)?|casadi_c\d+")

#: The zeros that an input is where a caller passes no pointer.
_ZEROS = re.compile(r"^static const casadi_real casadi_zeros\[\d+\] =\s*\{[^{}]*\};\n", re.M)

#: A copy between parts of the work vector, or of a constant into it.
_SURE_COPY = re.compile(
    r"\bcasadi_copy\((?=(?:w\w*|casadi_c\d+)(?:\+\d+)?, \d+, w\w*(?:\+\d+)?\);)"
)
_MOVE = """\
static void casadi_move(const casadi_real* x, casadi_int n, casadi_real* y) {
  casadi_int i;
  for (i=0; i<n; ++i) y[i] = x[i];
}

"""


def without_null_copies(source: str) -> str:
    """`source` whose copies within the work vector do not ask for null pointers.

    gcc at -O2 follows the branch of a null one, of which the other then is a few bytes beyond
    nothing, and warns of writing there.
    """
    source, count = _SURE_COPY.subn("casadi_move(", source)
    definition = re.search(r"^void casadi_copy\(", source, re.M)
    if not count or not definition:
        return source
    at = definition.start()
    return f"{source[:at]}{_MOVE}{source[at:]}"


def without_null_checks(source: str) -> str:
    """`source` without questions for null pointers that no call of a function passes.

    CasADi asks before every entry of an input or output that is read or written, also in the
    functions that only its own code calls.
    """
    parts = _DEFINITION.split(source)
    sure: dict[str, set[str]] = {}  # inputs and outputs that every call has given so far
    for part in parts:
        values: dict[str, str] = {}
        for found in _SET_OR_CALL.finditer(part.partition("\n")[2]):
            name, index, value, called, arguments, results = found.groups()
            if not called:
                values[f"{name}[{index}]"] = value
                continue
            given = {
                ("arg" if key.startswith(f"{arguments}[") else "res") + key[key.index("[") :]
                for key, value in values.items()
                if key.startswith((f"{arguments}[", f"{results}[")) and _NOT_NULL.fullmatch(value)
            }
            sure[called] = sure.get(called, given) & given
            values = {}
    text = "".join(_without(part, sure) for part in parts)
    if not re.search(r": casadi_zeros;", text):
        text = _ZEROS.sub("", text)
    return text


def _without(part: str, sure: dict[str, set[str]]) -> str:
    """The definition of a function without questions for what is `sure` of it."""
    head = re.match(r"static int (casadi_f\d+)\(", part)
    for entry in sorted(sure.get(head[1], ())) if head else ():
        pointer = re.escape(entry)
        part = re.sub(rf"({pointer}) *\? (\1\[\d+\]) : 0;", r"\2;", part)
        part = re.sub(rf"({pointer}) *\? \1 : casadi_zeros;", r"\1;", part)
        part = re.sub(rf"if \({pointer}(?:!=0)?\) (?=({pointer}\[|casadi_copy\())", "", part)
    return part


def without_failure_checks(source: str) -> str:
    """`source` without questions whether functions failed that cannot: they always return 0."""
    sure: set[str] = set()
    parts = _DEFINITION.split(source)
    for i, part in enumerate(parts):
        for name in sure:
            part = re.sub(rf"\bif \(({name}\([^()]*\))\) return 1;", r"\1;", part)
        parts[i] = part
        head = re.match(r"static int (casadi_f\d+)\(", part)
        if head and set(re.findall(r"\breturn\b([^;]*);", part)) == {" 0"}:
            sure.add(head[1])
    return "".join(parts)
