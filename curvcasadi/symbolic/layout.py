"""Named parts of a stacked vector."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from curvcasadi.symbolic.expressions import Array, Expr, count, expression


@dataclass(frozen=True, eq=False)
class Part:
    """One named part of a stacked vector.

    Attributes
    ----------
    name : str
        Its name, different from those of the other parts.
    size : int
        Number of entries.
    unit : str
        Unit of every entry, "1" without one.
    lower, upper : float or array, shape (size,)
        Bounds; infinite unless given.
    attitude : bool
        Whether the part is a unit quaternion, scalar first. Its error state is a rotation vector
        (3, 1) in local axes.
    nominal : float or array, shape (size,), optional
        Value of a parameter where it is not given, such as that of a gust in calm air; a parameter
        without one has to be given.

    Raises
    ------
    ValueError
        For an empty name, and sizes, bounds and nominal values that do not fit each other.
    """

    name: str
    size: int
    unit: str
    lower: float | Array = -np.inf
    upper: float | Array = np.inf
    attitude: bool = False
    nominal: float | Array | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not self.name:
            raise ValueError(f"Part.name: expected a name, found {self.name!r}")
        count(f"{self.name}.size", self.size, 0)
        if self.attitude and self.size != 4:
            raise ValueError(
                f"{self.name}: expected the 4 entries of a quaternion, found {self.size}"
            )
        lower, upper = self._entries("lower"), self._entries("upper")
        if np.any(lower > upper):
            raise ValueError(
                f"{self.name}: expected lower ≤ upper, found {self.lower} and {self.upper}"
            )
        if self.nominal is not None:
            nominal = self._entries("nominal")
            if not np.all(np.isfinite(nominal) & (lower <= nominal) & (nominal <= upper)):
                raise ValueError(
                    f"{self.name}.nominal: expected finite numbers within the bounds, "
                    f"found {self.nominal}"
                )

    def _entries(self, field: str) -> Array:
        value = getattr(self, field)
        try:
            array = np.broadcast_to(np.asarray(value, dtype=float), (self.size,))
        except (TypeError, ValueError):
            raise ValueError(
                f"{self.name}.{field}: expected one number or {self.size}, found {value!r}"
            ) from None
        if np.any(np.isnan(array)):
            raise ValueError(f"{self.name}.{field}: expected numbers, found NaN in {value!r}")
        return array


@dataclass(frozen=True, eq=False)
class Layout:
    """The parts of a stacked column vector, in order.

    Attributes
    ----------
    parts : tuple of Part
        The parts, in the order in which they stand in the vector.
    """

    parts: tuple[Part, ...]

    def __post_init__(self) -> None:
        names = [part.name for part in self.parts]
        if len(set(names)) < len(names):
            raise ValueError(f"Layout.parts: expected different names, found {names}")

    @property
    def size(self) -> int:
        """Length of the vector."""
        return sum(part.size for part in self.parts)

    @property
    def errors(self) -> Layout:
        """The layout of error states: a rotation vector, rad, for each attitude."""
        return Layout(
            tuple(Part(p.name, 3, "rad") if p.attitude else p for p in self.parts),
        )

    @property
    def labels(self) -> tuple[str, ...]:
        """Name, index and unit of every entry."""
        return tuple(
            f"{part.name}[{i}], {part.unit}" for part in self.parts for i in range(part.size)
        )

    @property
    def slices(self) -> dict[str, slice]:
        """Where each part stands in the vector, by name."""
        ends = np.cumsum([part.size for part in self.parts]).tolist()
        pairs = zip(self.parts, ends, strict=True)
        return {part.name: slice(end - part.size, end) for part, end in pairs}

    @property
    def bounds(self) -> tuple[Array, Array]:
        """Lower and upper bounds (size,)."""
        lower, upper = (
            np.concatenate(
                [
                    np.zeros(0),
                    *(np.broadcast_to(getattr(part, side), part.size) for part in self.parts),
                ]
            )
            for side in ("lower", "upper")
        )
        return lower, upper

    def split(self, vector: Expr) -> dict[str, Expr]:
        """The parts of a vector by name.

        Parameters
        ----------
        vector : SX, MX, DM or array, shape (size, 1)
            Stacked vector.

        Returns
        -------
        dict of str to SX, MX, DM or array
            Each part as a column.
        """
        column = expression("vector", vector, (self.size, 1))
        edges: Any = [0, *(where.stop for where in self.slices.values())]
        pieces = ca.vertsplit(column, edges) if self.parts else []
        return dict(zip(self.slices, pieces, strict=True))

    def join(self, parts: Mapping[str, Expr]) -> Expr:
        """The vector of named parts.

        Parameters
        ----------
        parts : mapping of str to SX, MX, DM or array
            Every part as a column.

        Returns
        -------
        SX, MX, DM or array, shape (size, 1)
            Stacked vector.

        Raises
        ------
        ValueError
            If a part is missing, unknown, or of another size.
        """
        expected = {part.name for part in self.parts}
        if set(parts) != expected:
            raise ValueError(f"parts: expected {sorted(expected)}, found {sorted(parts)}")
        pieces = (expression(part.name, parts[part.name], (part.size, 1)) for part in self.parts)
        joined: Expr = ca.vertcat(*pieces)
        return joined
