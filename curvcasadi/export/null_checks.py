"""Generated C without questions for null pointers that are never null."""

from __future__ import annotations

import re

_DEFINITION = re.compile(r"^(?=(?:static |CASADI_SYMBOL_EXPORT )?\w[\w ]*\**\w+\(.*\) \{$)", re.M)
_SET_OR_CALL = re.compile(
    r"^ *((?:arg|res)\d+)\[(\d+)\]=(.*);$|\b(casadi_f\d+)\((?:(\w+), (\w+),)?", re.M
)
#: Values of pointers that are never null: parts of the work vector, inputs replaced by zeros.
_NOT_NULL = re.compile(r"\(?&?w\w*(\+\d+)?\)?|casadi_c\d+")


def without_null_checks(source: str) -> str:
    """`source` without questions for null pointers where every call of a function passes none.

    CasADi asks before every entry of an input or output that is read or written, also in the
    functions that only its own code calls.
    """
    parts = _DEFINITION.split(source)
    used: dict[str, set[str]] = {}
    for part in parts:
        if head := re.match(r"static int (casadi_f\d+)\(", part):
            used[head[1]] = set(re.findall(r"\b((?:arg|res)\[\d+\])", part))
    sure: set[str] = set()
    unsure: set[str] = set()
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
            (sure if used.get(called, {""}) <= given else unsure).add(called)
            values = {}
    for i, part in enumerate(parts):
        head = re.match(r"static int (casadi_f\d+)\(", part)
        if head and head[1] in sure - unsure:
            part = re.sub(r"(arg\[\d+\]) *\? (\1\[\d+\]) : 0;", r"\2;", part)
            parts[i] = re.sub(r"if \((res\[\d+\])!=0\) (\1\[\d+\]=)", r"\2", part)
    return "".join(parts)
