"""What `casadi.external` asks of a compiled export, in CasADi's own integers.

On a target the integers of generated C are `int`. CasADi reads a library in integers of its own,
`long long int`: the functions that describe a Function, which it alone calls, are written with
them, and so are the sparsity patterns that they return. A linker with `--gc-sections` drops them.
"""

from __future__ import annotations

import re

#: Functions that describe another, by the ends of their names.
_DESCRIBING = "n_in|n_out|default_in|name_in|name_out|sparsity_in|sparsity_out|work|work_bytes"
_HEAD = re.compile(
    rf"^(?:CASADI_SYMBOL_EXPORT )?[\w *]*?\b\w+_casadi_\w+_(?:{_DESCRIBING})\([^)\n]*\)", re.M
)
_RETURNED = re.compile(r"return casadi_(s\d+);")
_OF_CASADI = "long long int"


def readable(source: str, header: str) -> tuple[str, str]:
    """`source` and `header` with descriptions in CasADi's own integers."""
    source, header = (
        _HEAD.sub(lambda head: head[0].replace("casadi_int", _OF_CASADI), text)
        for text in (source, header)
    )
    for name in sorted(set(_RETURNED.findall(source)), key=lambda name: int(name[1:])):
        source = _with_pattern(source, name)
    return source, header


def _with_pattern(source: str, name: str) -> str:
    """The pattern `name` that is returned in CasADi's integers; in those of the target if used."""
    (pattern,) = re.findall(rf"^static const casadi_int casadi_{name}\[[^;]*;\n", source, re.M)
    wide = pattern.replace("casadi_int", _OF_CASADI).replace(f"casadi_{name}", f"{name}_wide")
    source = source.replace(f"return casadi_{name};", f"return {name}_wide;")
    uses = len(re.findall(rf"\bcasadi_{name}\b", source)) - 2  # beside its macro and itself
    if uses:
        return source.replace(pattern, pattern + wide)
    source = source.replace(f"#define casadi_{name} CASADI_PREFIX({name})\n", "")
    return source.replace(pattern, wide)
