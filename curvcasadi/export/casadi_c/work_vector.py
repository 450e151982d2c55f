"""Generated C without room in its work vector that it never uses.

CasADi sizes work vectors as its own evaluation needs them. Its C holds the intermediate results of
SX functions in local variables, and points at parts of inputs and at constants where the evaluation
copies them; yet every caller leaves room for all of it.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

import casadi as ca

_PART = re.compile(
    r"^/\* (?P<signature>\w+:\([^\n]*\)) \*/\nstatic int (?P<name>casadi_f\d+)\([^\n]* \{\n"
    r"(?P<body>.*?)^\}$",
    re.S | re.M,
)
#: Where an intermediate result lies, and a call that hands the work vector on.
_PLACE = re.compile(r"\*w(\d+)=w\+(\d+)")
_CALL = re.compile(r"(casadi_f\d+)\(\w+, \w+, iw, w, 0\)")


def compacted(source: str, functions: Sequence[ca.Function]) -> tuple[str, dict[str, int]]:
    """`source` with less room in work vectors, and their lengths by the names of `functions`."""
    parts = {_signature(g): g for f in functions for g in (f, *f.find_functions())}
    sizes: dict[str, int] = {}  # of what has been defined so far, by its name in C

    def moved(match: re.Match[str]) -> str:
        body, function = match["body"], parts.get(match["signature"])
        places = {int(index): int(at) for index, at in _PLACE.findall(body)}
        rest = _CALL.sub("", _PLACE.sub("", body))
        called = [sizes.get(name) for name in _CALL.findall(body)]
        known = [size for size in called if size is not None]
        # What uses the vector in other ways, or hands it on to who may, keeps its room.
        is_sure = len(known) == len(called) and not re.search(r"\bw\b", rest)
        old = min(places.values(), default=0)
        new = max(known, default=0) if is_sure else old
        if places and function is not None and function.class_name() == "MXFunction":
            last = max(places)
            sizes[match["name"]] = new - old + places[last] + _length(function, last)
        elif is_sure and not places:
            sizes[match["name"]] = new
        shifted = _PLACE.sub(lambda m: f"*w{m[1]}=w+{int(m[2]) - old + new}", body)
        return match[0].replace(body, shifted)

    text = _PART.sub(moved, source)
    names = {match["signature"]: match["name"] for match in _PART.finditer(source)}
    return text, {f.name(): sizes.get(names[_signature(f)], f.sz_w()) for f in functions}


def integers(function: ca.Function) -> int:
    """Length of the work vector of integers; `qrqp` writes one beyond what it asks for.

    It lists there where multipliers change their signs, and an end: one more than there are.
    """
    parts = {f.class_name() for f in (function, *function.find_functions())}
    return int(function.sz_iw()) + ("Qrqp" in parts)


def told(text: str, work: Mapping[str, int], kind: str = "w") -> str:
    """`text` of a source or header in which lengths of work vectors are those of `work`.

    Parameters
    ----------
    kind : "w", or "iw" for the vectors of integers
    """
    for name, size in work.items():
        text = re.sub(rf"(#define {name}_SZ_{kind.upper()}) \d+", rf"\1 {size}", text)
        asked = rf"(casadi_{name}_work(?:_bytes)?\([^{{}}]*\{{[^{{}}]*\*sz_{kind} = )\d+"
        text = re.sub(asked, rf"\g<1>{size}", text)
    return text


def _signature(function: ca.Function) -> str:
    """As in the comment on what is generated of `function`."""
    return str(function).rpartition(" ")[0]


def _length(function: ca.Function, index: int) -> int:
    """Of an intermediate result of an MX function, by its index."""
    for k in range(function.n_instructions()):
        operation, outputs = function.instruction_id(k), function.instruction_output(k)
        if index in outputs and operation != ca.OP_OUTPUT:  # whose index is that of a result
            if operation == ca.OP_INPUT:
                return int(function.nnz_in(function.instruction_input(k)[0]))
            node = function.instruction_MX(k)
            if operation == ca.OP_CALL:
                return int(node.which_function().nnz_out(outputs.index(index)))
            whole = node.n_out() < 2
            return int((node if whole else node.get_output(outputs.index(index))).nnz())
    raise ValueError(f"{function.name()}: expected an intermediate result {index}, found none")
