"""The shape map: from curvature weights to curvature, attitude and position along a beam."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import overload

import casadi as ca
import numpy as np

from curvcasadi.beam.beam import Beam
from curvcasadi.beam.pose import Pose, pose_of, unpack_pose
from curvcasadi.kinematics import chain
from curvcasadi.kinematics.numeric import NumericPoses, numeric_shape
from curvcasadi.kinematics.weights import check_angles, checked_weights, element_angles
from curvcasadi.symbolic.expressions import (
    AnyExpr,
    Array,
    Expr,
    Numbers,
    expression,
    is_numeric,
    station,
)
from curvcasadi.symbolic.text import described, shown


@dataclass(frozen=True, eq=False, kw_only=True)
class Shape:
    """Poses and curvatures at the stations of a beam.

    Attributes
    ----------
    stations : array, shape (N + 1,)
        Stations s/L of the element boundaries.
    poses : sequence of Pose
        N + 1 poses, local to parent axes.
    curvatures : SX, MX or DM, shape (3, N + 1)
        Curvatures K, rad/m, local axes, one station per column.
    """

    stations: Array
    poses: Sequence[Pose]
    curvatures: AnyExpr

    def __repr__(self) -> str:
        return f"<Shape at {len(self.stations)} stations, tip at {shown(self.tip.position, 'm')}>"

    def __str__(self) -> str:
        magnitudes = np.sqrt(np.sum(self.curvatures.full() ** 2, axis=0)) if self._known else None
        rows = {
            "stations": f"{len(self.stations)} from xi = 0 to 1",
            "tip": str(self.tip),
        }
        if magnitudes is not None:
            k = int(magnitudes.argmax())
            rows["largest curvature"] = f"{magnitudes[k]:.5g} rad/m at xi = {self.stations[k]:.4g}"
        return described("Shape", rows)

    @property
    def _known(self) -> bool:
        return isinstance(self.curvatures, ca.DM)

    @property
    def positions(self) -> AnyExpr:
        """p (3, N + 1), m, parent axes, one station per column."""
        if isinstance(self.poses, NumericPoses):
            return ca.DM(self.poses.positions)
        return ca.horzcat(*(pose.position for pose in self.poses))

    @property
    def tip(self) -> Pose:
        """Pose at xi = 1."""
        return self.poses[-1]


def shape_map(beam: Beam, q: AnyExpr) -> Shape:
    """Shape of `beam` with weights `q` (Eqs. 3–13).

    Parameters
    ----------
    beam : Beam
        Beam whose shape is asked for.
    q : SX, MX, DM or array, shape (n, 1)
        Curvature weights, rad/m.

    Returns
    -------
    Shape
        Of the kind of `q`: SX weights give an unrolled chain, MX weights a compact one.

    Raises
    ------
    ValueError
        If `q` has a wrong shape or a NaN, breaks `Beam.weight_bounds`, or turns an element by more
        than `Grid.max_angle`.
    """
    q = checked_weights(beam, q, angles=False)
    shape, squared_angle = _shape(beam, q)
    if squared_angle is None or squared_angle > beam.grid.max_angle**2:
        check_angles(beam, q)
    return shape


def unchecked_shape(beam: Beam, q: AnyExpr) -> Shape:
    """`shape_map` of weights (n, 1) that may break its limits, as those of a failed solve do."""
    return _shape(beam, q)[0]


def _shape(beam: Beam, q: AnyExpr) -> tuple[Shape, float | None]:
    """Shape, and the largest θ² of an element, rad², where it is known."""
    stations = beam.stations
    if is_numeric(q) and not beam.design_symbols:
        numeric = numeric_shape(beam, q, stations.tolist())
        found = NumericPoses(numeric.rotations, numeric.positions)
        shape = Shape(stations=stations, poses=found, curvatures=numeric.curvatures)
        return shape, numeric.squared_angle
    shape = Shape(
        stations=stations,
        poses=tuple(poses(beam, q, stations.tolist())),
        curvatures=ca.horzcat(*(_curvature(beam, q, xi) for xi in stations)),
    )
    return shape, None


def pose_at(beam: Beam, q: AnyExpr, xi: float) -> Pose:
    """Pose at any numeric station in [0, 1], on or off the grid.

    Within an element the rule integrates from the element's start to `xi`: the order is kept.

    Parameters
    ----------
    beam : Beam
        Beam whose pose is asked for.
    q : SX, MX, DM or array, shape (n, 1)
        Curvature weights, rad/m.
    xi : float
        Station s/L in [0, 1].

    Returns
    -------
    Pose
        Local to parent axes, of the kind of `q`.
    """
    xi, q = station("xi", xi), checked_weights(beam, q, angles=False)
    if is_numeric(q) and not beam.design_symbols:
        numeric = numeric_shape(beam, q, (xi,))
        if numeric.squared_angle > beam.grid.max_angle**2:
            check_angles(beam, q)
        return pose_of(numeric.rotations, numeric.positions)
    check_angles(beam, q)
    return poses(beam, q, [xi])[0]


@overload
def curvature(beam: Beam, q: Expr, xi: float) -> Expr: ...
@overload
def curvature(beam: Beam, q: Numbers, xi: float) -> ca.DM: ...
def curvature(beam: Beam, q: AnyExpr, xi: float) -> AnyExpr:
    """Curvature of a station, K(xi) = K_0(xi) + Φ(xi) q (Eq. 3), for any weights.

    Parameters
    ----------
    beam : Beam
        Beam whose curvature is asked for.
    q : SX, MX, DM or array, shape (n, 1)
        Curvature weights, rad/m.
    xi : float
        Station s/L in [0, 1].

    Returns
    -------
    SX, MX or DM, shape (3, 1)
        Curvature (K_x, K_y, K_z), rad/m, local axes.
    """
    return _curvature(beam, expression("q", q, (beam.basis.n, 1)), station("xi", xi))


def _curvature(beam: Beam, q: AnyExpr, xi: float) -> AnyExpr:
    phi = ca.sparsify(ca.DM(beam.basis(xi)))
    return ca.densify(beam.initial_curvature_at(xi) + phi @ q)


@overload
def squared_element_angles(beam: Beam, q: Expr) -> Expr: ...
@overload
def squared_element_angles(beam: Beam, q: Numbers) -> ca.DM: ...
def squared_element_angles(beam: Beam, q: AnyExpr) -> AnyExpr:
    """Squared angles by which the elements turn.

    A bound for NLPs, `squared_element_angles(beam, q) <= beam.grid.max_angle**2`: unlike the angle
    itself it has derivatives at the straight wing.

    Parameters
    ----------
    beam : Beam
        Beam with N elements.
    q : SX, MX, DM or array, shape (n, 1)
        Curvature weights, rad/m.

    Returns
    -------
    SX, MX or DM, shape (N, 1)
        Squared angles, rad².
    """
    return element_angles(beam, checked_weights(beam, q))


def poses(beam: Beam, q: AnyExpr, stations: Sequence[float]) -> list[Pose]:
    """Poses of numeric stations, from weights that are checked already."""
    if is_numeric(q) and not beam.design_symbols:
        numeric = numeric_shape(beam, q, stations)
        return [*NumericPoses(numeric.rotations, numeric.positions)[:]]
    beam_chain = chain.build(beam, stations)
    root = beam.root.packed
    states = beam_chain.march([chain.pose_step(beam_chain.pattern)], root, q)
    return [
        Pose(rotation=rotation, position=position)
        for rotation, position in map(unpack_pose, states)
    ]
