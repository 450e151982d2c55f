"""Attitudes in logs: nine entries of a rotation matrix, or a quaternion."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca

from curvcasadi.lie import quaternion

#: Entries of a quaternion, scalar first.
PARTS = ("q_w", "q_x", "q_y", "q_z")
#: What the length of a quaternion of a few digits may differ from 1.
LENGTH_TOLERANCE = 1e-2


@dataclass(frozen=True)
class Attitudes:
    """Columns of a log, and which of them are quaternions."""

    columns: tuple[str, ...]  #: in the log
    places: tuple[int, ...]  #: where a quaternion begins, in ascending order

    def matrices(self, values: list[float]) -> list[float]:
        """Values with the nine entries of a matrix, by columns, in place of each quaternion.

        Raises
        ------
        ValueError
            If a quaternion is not of unit length.
        """
        for place in reversed(self.places):
            found = values[place : place + 4]
            values[place : place + 4] = self._matrix(self.columns[place], found)
        return values

    @staticmethod
    def _matrix(name: str, found: list[float]) -> list[float]:
        if any(map(math.isnan, found)):
            return [math.nan] * 9
        length = math.hypot(*found)
        if abs(length - 1) > LENGTH_TOLERANCE:
            prefix = name.removesuffix("q_w")
            raise ValueError(
                f"columns {name} to {prefix}q_z: expected a unit quaternion, scalar first, "
                f"found one of length {length:g}"
            )
        rotation = quaternion.rotation(ca.DM(found) / length)
        return [float(entry) for entry in rotation.full().ravel(order="F")]


def attitudes(columns: Sequence[str], present: Sequence[str]) -> Attitudes:
    """`columns` with the four of a quaternion where `present` has those and no matrix."""
    named: list[str] = []
    places: list[int] = []
    for name in columns:
        prefix = name.rpartition("R_")[0]
        is_entry = name.endswith(tuple(f"R_{i}{j}" for i in "xyz" for j in "xyz"))
        if not is_entry or f"{prefix}q_w" not in present:
            named.append(name)
        elif name.endswith("R_xx"):
            places.append(len(named))
            named += [f"{prefix}{part}" for part in PARTS]
    return Attitudes(tuple(named), tuple(places))
