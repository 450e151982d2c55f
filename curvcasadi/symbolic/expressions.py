"""Types of CasADi expressions, and the checks that public functions make of their arguments."""

from __future__ import annotations

from typing import Any, Literal, TypeAlias, TypeVar

import casadi as ca
import numpy as np
from numpy.typing import NDArray

#: One kind of expression: a function of it returns the kind that it was given.
Expr = TypeVar("Expr", ca.SX, ca.MX, ca.DM)
#: An SX, MX or DM; their operators do not accept a union of the three.
AnyExpr: TypeAlias = Any
#: A physical quantity in a field of a frozen description: a number, an array or a symbol.
Number: TypeAlias = Any
Array: TypeAlias = NDArray[np.float64]
#: Arithmetic of generated code.
Real = Literal["double", "float"]

_SYMBOLIC = (ca.SX, ca.MX)


def is_numeric(value: Number) -> bool:
    """Whether `value` holds numbers, not symbols."""
    return not isinstance(value, _SYMBOLIC)


def expression(name: str, value: Number, shape: tuple[int, int]) -> AnyExpr:
    """`value` as an expression of `shape`; a flat sequence counts as a column.

    Raises
    ------
    ValueError
        If the shape differs, or a number is NaN or infinite.
    """
    if is_numeric(value):
        value = ca.DM(numbers(name, value))
    if tuple(value.shape) != shape:
        raise ValueError(f"{name}: expected shape {shape}, found {tuple(value.shape)}")
    return value


def numeric(name: str, value: Number) -> Number:
    """`value`, which must hold numbers."""
    if not is_numeric(value):
        raise ValueError(f"{name}: expected numbers, found the symbol {value}")
    return value


def numbers(name: str, value: Number) -> Array:
    """`value` as a new array of finite numbers; text, truth values and symbols are none."""
    if value is None:
        raise ValueError(f"{name}: expected numbers, found None")
    if isinstance(value, (list, tuple)) and any(isinstance(entry, _SYMBOLIC) for entry in value):
        raise ValueError(f"{name}: expected numbers, found {value!r}; stack symbols by ca.vertcat")
    try:
        array = np.asarray(value.full() if isinstance(value, ca.DM) else value)
        entries = array.flat if array.dtype.kind == "O" else ()
        if array.dtype.kind not in "iufO" or not all(map(is_numeric, (value, *entries))):
            raise TypeError
        array = np.array(array, dtype=float)
    except (TypeError, ValueError):
        raise ValueError(f"{name}: expected numbers, found {value!r}") from None
    if not np.all(np.isfinite(array)):
        raise ValueError(f"{name}: expected finite numbers, found {array.tolist()}")
    return array


def positive(name: str, value: Number, *, zero: bool = False) -> Number:
    """`value`, a scalar that is a symbol or a finite number above zero (`zero`: or zero itself)."""
    scalar = expression(name, value, (1, 1))
    if is_numeric(scalar) and not (float(scalar) > 0 or (zero and float(scalar) == 0)):
        bound = "not below zero" if zero else "above zero"
        raise ValueError(f"{name}: expected a number {bound}, found {float(scalar)}")
    return scalar if not is_numeric(scalar) else float(scalar)


def rotation_matrix(name: str, value: Number) -> AnyExpr:
    """`value`, a (3, 3) symbol or a numeric rotation matrix, orthonormal to 1e-6."""
    rotation = expression(name, value, (3, 3))
    if is_numeric(rotation):
        columns = rotation.full()
        if not np.allclose(columns.T @ columns, np.eye(3), rtol=0, atol=1e-6):
            raise ValueError(f"{name}: expected orthonormal columns, found {columns.tolist()}")
        if np.linalg.det(columns) < 0:
            raise ValueError(
                f"{name}: expected a right-handed frame, found the reflection {columns.tolist()}"
            )
    return rotation


def station(name: str, xi: float) -> float:
    """`xi`, a numeric normalized arc length in [0, 1]."""
    if not is_numeric(xi):
        raise ValueError(f"{name}: expected a number in [0, 1], found the symbol {xi}")
    value = float(expression(name, xi, (1, 1)))
    if not 0.0 <= value <= 1.0:
        raise ValueError(f"{name}: expected a number in [0, 1], found {value}")
    return value


def count(name: str, value: int, least: int = 1) -> int:
    """`value`, a whole number of at least `least`."""
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or value < least:
        raise ValueError(f"{name}: expected a whole number of at least {least}, found {value!r}")
    return int(value)


def choice(name: str, value: Any, options: Any) -> Any:
    """`value`, one of `options`."""
    if value not in options:
        raise ValueError(
            f"{name}: expected one of {', '.join(map(repr, options))}; found {value!r}"
        )
    return value


def instance(name: str, value: Any, kind: type) -> Any:
    """`value`, an instance of `kind`."""
    if not isinstance(value, kind):
        article = "an" if kind.__name__[0] in "AEIOU" else "a"
        raise ValueError(f"{name}: expected {article} {kind.__name__}, found {value!r}")
    return value


def function_name(name: str, value: Any) -> str:
    """`value`, a name that CasADi takes for a Function."""
    if not isinstance(value, str) or not ca.Function.check_name(value):
        raise ValueError(
            f"{name}: expected letters, digits and single underscores, a letter first; "
            f"found {value!r}"
        )
    return value


def same_kind(**values: Number) -> type:
    """The kind that an expression of all `values` has: SX, MX, or DM if none is a symbol.

    Raises
    ------
    ValueError
        If an SX meets an MX; the message names both.
    """
    symbols = {name: type(value) for name, value in values.items() if not is_numeric(value)}
    kinds = set(symbols.values())
    if len(kinds) > 1:
        found = ", ".join(f"{name} is {kind.__name__}" for name, kind in symbols.items())
        raise ValueError(f"expected symbols of one kind (SX or MX), found: {found}")
    return kinds.pop() if kinds else ca.DM
