"""Types of CasADi expressions, and the checks that public functions make of their arguments."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields
from math import isfinite, pi
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
#: A vector of numbers where SX, MX or DM may stand as well; what is made of it is DM.
Numbers: TypeAlias = Sequence[float] | NDArray[Any]
#: Arithmetic of generated code.
Real = Literal["double", "float"]

#: Stations closer than this are one station: s/L by cumulated sums misses 1 by some 1e-16.
COINCIDENT = 1e-12
#: What solvers may exceed a bound by, times the larger of 1 and the bound: whatever they return is
#: within bounds everywhere, in Python and in C.
BOUND_SLACK: dict[Real, float] = {"double": 1e-6, "float": 1e-5}
#: Rotations and directions may miss their length or angles by this, rad: three digits suffice.
FAR_FROM_ROTATION = 1e-2
#: Two entries of a symmetric matrix may differ by this fraction of the largest entry.
ASYMMETRY = 1e-8

_SYMBOLIC = (ca.SX, ca.MX)
#: Deviations from a rotation that are rounding; matrices so close to one stay as they are.
_ROUNDING = 1e-14
#: Entries of what was meant as a rotation; so3.exp of a vector in degrees has larger ones.
_LARGEST_ENTRY = 100.0


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
    if isinstance(value, ca.DM) and value.is_regular():
        value = ca.densify(value)  # a copy, without the detour over numpy
    elif is_numeric(value):
        value = ca.DM(numbers(name, value))
    found = value.shape
    if found != shape:
        raise ValueError(f"{name}: expected shape {shape}, found {found}")
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


def number(name: str, value: Number) -> float:
    """`value`, one finite number."""
    return float(expression(name, numeric(name, value), (1, 1)))


def positive(name: str, value: Number, *, zero: bool = False) -> Number:
    """`value`, a scalar that is a symbol or a finite number above zero (`zero`: or zero itself)."""
    scalar = expression(name, value, (1, 1))
    if is_numeric(scalar) and not (float(scalar) > 0 or (zero and float(scalar) == 0)):
        bound = "not below zero" if zero else "above zero"
        raise ValueError(f"{name}: expected a number {bound}, found {float(scalar)}")
    return scalar if not is_numeric(scalar) else float(scalar)


def rotation_matrix(name: str, value: Number) -> AnyExpr:
    """`value`, a (3, 3) symbol, or the rotation nearest to numbers with a few digits.

    Numbers must be a rotation to 1e-2, by `is_rotation`; they are orthonormalized, so that no
    rounding of theirs stretches what they turn.
    """
    rotation = expression(name, value, (3, 3))
    if not is_numeric(rotation):
        return rotation
    columns = rotation.full()
    if not float(is_rotation(ca.vec(rotation))):
        if float(is_rotation(ca.vec(ca.horzcat(rotation[:, :2], -rotation[:, 2])))):
            raise ValueError(
                f"{name}: expected a right-handed frame, found the reflection {columns.tolist()}"
            )
        largest = np.max(np.abs(columns))
        raise ValueError(
            f"{name}: expected orthonormal columns, to {FAR_FROM_ROTATION:g}; found "
            + (
                f"{columns.tolist()}"
                if largest <= _LARGEST_ENTRY
                else f"entries up to {largest:.3g}: of a rotation vector in degrees?"
            )
        )
    if np.max(np.abs(columns.T @ columns - np.eye(3))) <= _ROUNDING:
        return rotation
    left, _, right = np.linalg.svd(columns)
    return ca.DM(left @ right)


def rotation_vector(name: str, value: Number) -> AnyExpr:
    """`value`, a (3, 1) symbol, or numbers of a length up to a full turn."""
    vector = expression(name, value, (3, 1))
    if is_numeric(vector) and float(ca.norm_2(vector)) > 2 * pi:
        raise ValueError(
            f"{name}: expected a rotation vector of at most 2π rad, "
            f"found {vector.full().ravel().tolist()} of length {float(ca.norm_2(vector)):g}; "
            "degrees?"
        )
    return vector


def is_rotation(values: AnyExpr) -> AnyExpr:
    """1 if `values`, a matrix by columns (9, 1), are a rotation to 1e-2, else 0; 0 for NaN.

    Python and generated C ask this wherever a rotation is given or measured.
    """
    return rotation_defect(values) <= 1


def rotation_defect(values: AnyExpr) -> AnyExpr:
    """By how much `values`, columns c1, c2, c3 of a matrix (9, 1), miss a rotation, over 1e-2.

    |(c1·c1 − 1, c2·c2 − 1, c1·c2, c1 × c2 − c3)|: zeros, as where one was forgotten, are no
    rotation, and neither is a reflection.
    """
    c1, c2, c3 = ca.vertsplit(values, 3)
    lengths = (ca.sumsqr(c1) - 1, ca.sumsqr(c2) - 1, ca.dot(c1, c2))
    return ca.norm_2(ca.vertcat(*lengths, ca.cross(c1, c2) - c3)) / FAR_FROM_ROTATION


def unit_vector(name: str, value: Number) -> AnyExpr:
    """`value`, a (3, 1) symbol, or numbers of the length 1 to 1e-2, divided by their length."""
    direction = expression(name, value, (3, 1))
    if not is_numeric(direction):
        return direction
    length = float(ca.norm_2(direction))
    if abs(length - 1) > FAR_FROM_ROTATION:
        raise ValueError(
            f"{name}: expected a unit vector, found {numbers(name, value).ravel().tolist()} "
            f"of length {length:g}"
        )
    return direction / length


def symmetric(name: str, value: Number, *, size: int = 3, definite: bool = False) -> AnyExpr:
    """`value`, a symmetric matrix, positive definite if `definite`; symbols as they are.

    Numbers may differ from their mirror images by 1e-8 of the largest entry, as those of solvers
    and files do; the mean of both is returned.
    """
    matrix = expression(name, value, (size, size))
    if not is_numeric(matrix):
        return matrix
    entries = matrix.full()
    difference = np.abs(entries - entries.T)
    if np.max(difference) > ASYMMETRY * np.max(np.abs(entries)):
        i, j = np.unravel_index(np.argmax(difference), difference.shape)
        raise ValueError(
            f"{name}: expected a symmetric matrix, to {ASYMMETRY:g} of its largest entry; found "
            f"{entries[i, j]:g} and {entries[j, i]:g} in {entries.tolist()}"
        )
    mean = (entries + entries.T) / 2
    if definite and np.linalg.eigvalsh(mean)[0] <= 0:
        raise ValueError(f"{name}: expected a positive definite matrix, found {entries.tolist()}")
    return ca.DM(mean)


def station(name: str, xi: float) -> float:
    """`xi`, a numeric normalized arc length in [0, 1]; within 1e-12 of an end, that end."""
    if not is_numeric(xi):
        raise ValueError(f"{name}: expected a number in [0, 1], found the symbol {xi}")
    plain = isinstance(xi, float) and isfinite(xi)
    value = float(xi if plain else expression(name, xi, (1, 1)))
    if not -COINCIDENT <= value <= 1.0 + COINCIDENT:
        raise ValueError(f"{name}: expected a number in [0, 1], found {value}")
    return 0.0 if value <= COINCIDENT else 1.0 if value >= 1.0 - COINCIDENT else value


def increasing_stations(name: str, values: Number) -> Array:
    """`values` that increase from 0 to 1, or stay: (m,), from exactly 0 to exactly 1.

    Values within 1e-12 of an end are that end, and values within 1e-12 of the first of a group are
    equal to it: what stands in a table twice.
    """
    xi = numbers(name, values)
    at_ends = xi.size and abs(xi.flat[0]) <= COINCIDENT and abs(xi.flat[-1] - 1) <= COINCIDENT
    if xi.ndim != 1 or np.any(np.diff(xi) < -COINCIDENT) or not at_ends or len(xi) < 2:
        raise ValueError(
            f"{name}: expected increasing stations that cover 0 to 1, found {xi.tolist()}"
        )
    xi[xi <= COINCIDENT], xi[xi >= 1 - COINCIDENT] = 0.0, 1.0
    for k in range(1, len(xi)):
        if xi[k] - xi[k - 1] <= COINCIDENT:
            xi[k] = xi[k - 1]
    return xi


def copied(value: Any) -> Any:
    """`value` with its arrays, expressions and lists copied, arrays read-only.

    What is none of these, such as a function of xi, stays as it is.
    """
    if isinstance(value, np.ndarray):
        array = value.copy()
        array.setflags(write=False)
        return array
    if isinstance(value, (ca.SX, ca.MX, ca.DM)):
        kind: Any = type(value)
        return kind(value)
    if type(value) in (list, tuple):
        return type(value)(map(copied, value))
    if type(value) is dict:
        return {key: copied(entry) for key, entry in value.items()}
    return value


def own_fields(description: Any) -> None:
    """Replace the fields of a frozen dataclass by copies of their own: to begin `__post_init__`.

    A later change of an array that a user passed in then leaves the description as it was.
    """
    for entry in fields(description):
        if hasattr(description, entry.name):
            object.__setattr__(description, entry.name, copied(getattr(description, entry.name)))


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


def optional(name: str, value: Any, kind: type) -> Any:
    """`value`, an instance of `kind` or None."""
    return None if value is None else instance(name, value, kind)


def sequence(name: str, values: Any) -> tuple[Any, ...]:
    """`values`, a sequence, as a tuple; a text is none, though Python iterates over its letters."""
    if isinstance(values, (str, bytes)):
        raise ValueError(f"{name}: expected a sequence, found {values!r}; write [{values!r}]")
    try:
        return tuple(values)
    except TypeError:
        raise ValueError(f"{name}: expected a sequence, found {values!r}") from None


def function_name(name: str, value: Any) -> str:
    """`value`, a name that CasADi takes for a Function."""
    if not isinstance(value, str) or not ca.Function.check_name(value):
        raise ValueError(
            f"{name}: expected letters, digits and single underscores, a letter first; "
            f"found {value!r}"
        )
    return value


def refuse_repeated(name: str, symbols: Mapping[str, Any]) -> None:
    """Refuse a symbol that stands under two names."""
    by_node: dict[int, str] = {}
    for key, symbol in symbols.items():
        other = by_node.setdefault(symbol.__hash__(), key)
        if other != key:
            raise ValueError(
                f"{name}: expected a symbol of its own under each name, found {symbol} under "
                f"{other!r} and {key!r}"
            )


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
