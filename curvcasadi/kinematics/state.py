"""The state that a march along a beam carries from station to station."""

from __future__ import annotations

from typing import Any, NamedTuple

import casadi as ca

from curvcasadi.beam.pose import unpack_pose
from curvcasadi.symbolic.expressions import AnyExpr

#: Entries of a pose (vec R, p), and of a twist.
POSE, TWIST = 12, 6


class StationMotion(NamedTuple):
    """A station in the inertial axes that coincide with the root's at this instant.

    Twist and acceleration are spatial: (Ω, v) of the material at the origin of these axes, and its
    rate. `sums` are the spatial Jacobian (A, B), (3, n) each, and its rates in these axes.
    """

    rotation: AnyExpr
    position: AnyExpr
    twist: AnyExpr
    acceleration: AnyExpr
    sums: tuple[tuple[AnyExpr, AnyExpr], ...]


class StateLayout(NamedTuple):
    """Parts of a state: vec R, p, twist, acceleration, then vec A, vec B, vec A', vec B' …"""

    order: int = 0  #: 0: pose, 1: and twist, 2: and acceleration
    columns: int = 0  #: of the sums A and B; with them stand `order` rates of these

    @property
    def motion(self) -> int:
        """Entries before the sums."""
        return POSE + TWIST * self.order

    @property
    def parts(self) -> list[int]:
        """Entries of what comes before the sums, and of each pair of sums."""
        return [self.motion, *[TWIST * self.columns] * (self.order + 1 if self.columns else 0)]

    @property
    def size(self) -> int:
        """Entries of the state."""
        return sum(self.parts)

    def symbol(self, kind: Any = ca.SX) -> Any:
        """A symbol of a state, (size, 1)."""
        return kind.sym("state", self.size)

    def unpack(self, state: AnyExpr) -> StationMotion:
        """What a state (size, 1) says; what it has not is at rest."""
        sums = []
        for k in range(len(self.parts) - 1):
            start = self.motion + k * TWIST * self.columns
            middle = start + 3 * self.columns
            a, b = state[start:middle], state[middle : middle + 3 * self.columns]
            sums.append((ca.reshape(a, 3, self.columns), ca.reshape(b, 3, self.columns)))
        at_rest = ca.DM.zeros(TWIST)
        twist = state[POSE : POSE + TWIST] if self.order else at_rest
        acceleration = state[POSE + TWIST : self.motion] if self.order == 2 else at_rest
        return StationMotion(*unpack_pose(state), twist, acceleration, tuple(sums))

    @classmethod
    def of(cls, state: AnyExpr, order: int = 0) -> StateLayout:
        """The layout of a state of known order, by its size."""
        columns = (state.numel() - cls(order).size) // (TWIST * (order + 1))
        return cls(order, columns)
