"""Named CasADi Functions."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import casadi as ca

from curvcasadi.symbolic.expressions import AnyExpr, is_numeric, same_kind


def function(
    name: str, inputs: Mapping[str, AnyExpr], outputs: Mapping[str, AnyExpr]
) -> ca.Function:
    """A `casadi.Function` with named inputs and outputs, common subexpressions shared.

    Parameters
    ----------
    name : str
        Name of the Function, also in generated C.
    inputs : mapping of str to symbol
        Symbols by name, in order.
    outputs : mapping of str to expression
        Expressions of the inputs by name, in order.

    Returns
    -------
    casadi.Function
        With these names.

    Raises
    ------
    ValueError
        If an input is not a symbol, SX and MX are mixed, or an output holds another symbol.
    """
    for key, symbol in inputs.items():
        if is_numeric(symbol) or not symbol.is_valid_input():
            raise ValueError(f"inputs[{key!r}]: expected an SX or MX symbol, found {symbol}")
    kind = same_kind(**inputs, **{f"outputs[{key!r}]": value for key, value in outputs.items()})
    for key, value in outputs.items():
        missing = free_symbols(value, inputs.values())
        if missing:
            raise ValueError(
                f"outputs[{key!r}]: expected an expression of {', '.join(inputs)}; "
                f"found also {', '.join(missing)}"
            )
    expressions = [kind(value) for value in outputs.values()]
    return ca.Function(name, [*inputs.values()], expressions, [*inputs], [*outputs], {"cse": True})


def free_symbols(value: AnyExpr, declared: Iterable[AnyExpr]) -> list[str]:
    """Names of the symbols in `value` that are not among the symbols `declared`."""
    if is_numeric(value):
        return []
    known = set(identities(declared))
    return [str(s) for s in ca.symvar(value) if _identity(s) not in known]


def identities(symbols: Iterable[AnyExpr]) -> list[int]:
    """Identities of the primitive symbols in `symbols`; symbols of one name have different ones."""
    return [_identity(s) for symbol in symbols for s in ca.symvar(symbol)]


def _identity(symbol: AnyExpr) -> int:
    return int(symbol.element_hash() if isinstance(symbol, ca.SX) else symbol.__hash__())
