"""How a load acts at a station: formulas of its pose and motion.

Formulas with the same function are equal, so that their CasADi Functions are made once.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import casadi as ca

from curvcasadi.lie import so3
from curvcasadi.symbolic.expressions import AnyExpr

#: Numbers that describe the loads at one station: F_d, M_d, vec N, F_f, M_f.
SIZE = 21


@dataclass(frozen=True)
class WrenchFormula:
    """A load in parent axes: (R, p, data, twist, acceleration) -> wrench."""

    function: Callable[..., AnyExpr]
    order: int = 0  #: 0: of the pose alone, 1: and of the twist, 2: and of the acceleration

    def __call__(
        self,
        rotation: AnyExpr,
        position: AnyExpr,
        data: AnyExpr,
        twist: AnyExpr | None = None,
        acceleration: AnyExpr | None = None,
    ) -> AnyExpr:
        """Wrench (moment, force), (6, 1), about the parent origin, parent axes.

        Twist and acceleration (6, 1) are those of `Load.wrench`; at rest they are None.
        """
        motion = (twist, acceleration)[: self.order]
        at_rest = ca.DM.zeros(6)
        return self.function(
            rotation, position, data, *(at_rest if part is None else part for part in motion)
        )

    def at_station(
        self,
        rotation: AnyExpr,
        position: AnyExpr,
        data: AnyExpr,
        twist: AnyExpr,
        acceleration: AnyExpr,
    ) -> AnyExpr:
        """The wrench (6, 1) about the station in its axes."""
        wrench = self(rotation, position, data, twist, acceleration)
        moment = wrench[:3] - ca.cross(position, wrench[3:])
        return ca.vertcat(rotation.T @ moment, rotation.T @ wrench[3:])


@dataclass(frozen=True)
class LocalFormula:
    """A load as its station sees it: (vectors, data, twist, acceleration) -> values.

    The values are the wrench (moment, force) about the station in its axes, and below it the rates
    of what a load with states of its own follows there.
    """

    function: Callable[..., AnyExpr]
    vectors: int  #: of the data, so many vectors (3, 1) in parent axes go first
    order: int = 2

    def __call__(
        self,
        rotation: AnyExpr,
        position: AnyExpr,
        data: AnyExpr,
        twist: AnyExpr | None = None,
        acceleration: AnyExpr | None = None,
    ) -> AnyExpr:
        """As that of `WrenchFormula`."""
        at_rest = ca.DM.zeros(6)
        motion = (at_rest if part is None else part for part in (twist, acceleration))
        values = self.at_station(rotation, position, data, *motion)
        force = rotation @ values[3:6]
        return ca.vertcat(rotation @ values[:3] + ca.cross(position, force), force)

    def at_station(
        self,
        rotation: AnyExpr,
        position: AnyExpr,
        data: AnyExpr,
        twist: AnyExpr,
        acceleration: AnyExpr,
    ) -> AnyExpr:
        """The values (6 + rates, 1) of data whose vectors are in parent axes."""
        first = 3 * self.vectors
        local = rotation.T @ ca.reshape(data[:first], 3, self.vectors)
        return self.function(local, data[first:], twist, acceleration)


Formula: TypeAlias = WrenchFormula | LocalFormula


def linear_wrench(rotation: AnyExpr, position: AnyExpr, data: AnyExpr) -> AnyExpr:
    """Wrench (moment, force), (6, 1), about the parent origin, of 21 numbers of load data."""
    fixed, fixed_moment, lever, local, local_moment = ca.vertsplit(data, [0, 3, 6, 15, 18, SIZE])
    force = fixed + rotation @ local
    levers = -2 * so3.vee(rotation @ ca.reshape(lever, 3, 3))
    moment = ca.cross(position, force) + levers + fixed_moment + rotation @ local_moment
    return ca.vertcat(moment, force)


#: The formula of the default `Load.wrench`.
LINEAR = WrenchFormula(linear_wrench)
