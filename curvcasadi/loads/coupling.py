"""Loads whose stations depend on each other, as those of induced flow do."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import casadi as ca

from curvcasadi.beam.pose import unpack_pose
from curvcasadi.kinematics.state import POSE
from curvcasadi.lie import so3
from curvcasadi.loads.formulas import Formula
from curvcasadi.symbolic.expressions import AnyExpr


class Coupling(NamedTuple):
    """What a load takes at each of its stations from the motion of all of them."""

    nodes: tuple[int, ...]  #: indices of the S stations
    function: ca.Function  #: (motions, data) -> values (m, S); motions are poses (12, S)
    data: AnyExpr  #: of `function`
    formula: Formula  #: of a station; its data are the m values and those of the station
    own: tuple[AnyExpr, ...]  #: further data of each station
    first: int = 0  #: of the further data, so many entries go before the values
    order: int = 0  #: with 1 motions are poses and twists in local axes, (18, S)
    slopes: ca.Function | None = None  #: as `slopes_by_ad` of the function, which is the default

    @property
    def tangent(self) -> ca.Function:
        """(motions, data) -> derivatives of the values: see `slopes_by_ad`."""
        return self.slopes or slopes_by_ad(self.function)

    @property
    def rows(self) -> tuple[int, ...]:
        """Where the values stand among the data of a station."""
        return tuple(range(self.first, self.first + self.function.size1_out(0)))

    def joined(self, part: AnyExpr, own: AnyExpr) -> AnyExpr:
        """Data of a station, or their derivatives, of a station's values and further data."""
        return ca.vertcat(own[: self.first, :], part, own[self.first :, :])

    def station_data(self, values: AnyExpr) -> list[AnyExpr]:
        """Data of the formula at each station, of values (m, S)."""
        return [self.joined(values[:, k], own) for k, own in enumerate(self.own)]

    def of_stations(self, stacked: AnyExpr) -> list[AnyExpr]:
        """Rows (m, columns) of each station among those of all, (m S, columns)."""
        count = self.function.size1_out(0)
        return [stacked[k * count : (k + 1) * count, :] for k in range(len(self.nodes))]


@lru_cache(maxsize=64)
def slopes_by_ad(function: ca.Function) -> ca.Function:
    """(motions, data) -> derivatives (m S, …) of the values, by what moves and by the data.

    The columns of the first are six [A; B] of each station, a motion that turns R by [A×] and moves
    p by B + A × p; then, where the function takes them, the six entries of each twist.
    """
    motions = ca.SX.sym("motions", *function.size_in(0))
    data = ca.SX.sym("data", *function.size_in(1))
    values = ca.vec(ca.densify(function(motions, data)))
    by_motions = by_moves(ca.jacobian(values, ca.vec(motions)), motions)
    return slope_function(motions, data, by_motions, ca.jacobian(values, data))


def slope_function(motions: ca.SX, data: ca.SX, by_motions: ca.SX, by_data: ca.SX) -> ca.Function:
    """The Function of derivatives, dense."""
    outputs = [ca.densify(by_motions), ca.densify(by_data)]
    names = ["motions", "data"], ["by_motions", "by_data"]
    return ca.Function("coupled_slopes", [motions, data], outputs, *names, {"cse": True})


def by_moves(slopes: ca.SX, motions: ca.SX) -> ca.SX:
    """Derivatives by the entries of `motions`, by columns, as those of `slopes_by_ad`."""
    rows, stations = motions.shape
    moved, twisted = [], []
    for k in range(stations):
        block = slopes[:, k * rows : (k + 1) * rows]
        rotation, position = unpack_pose(motions[:, k])
        linear = block[:, POSE - 3 : POSE]
        angular = -linear @ so3.hat(position)
        for j in range(3):
            angular -= block[:, 3 * j : 3 * j + 3] @ so3.hat(rotation[:, j])
        moved += [angular, linear]
        twisted.append(block[:, POSE:])
    return ca.SX(ca.horzcat(*moved, *twisted))
