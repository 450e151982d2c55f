"""What loads amount to at the stations of a beam.

At a station with pose (R, p), parent axes, every load below is one wrench about the parent origin

    force  F = F_d + R F_f,      moment = p × F + axial(R N) + M_d + R M_f

of 21 numbers: forces and moments fixed in the parent frame (F_d, M_d) and in local axes (F_f, M_f),
and N = Σ r F_dᵀ of the offsets r at which fixed forces act, axial(R N) = Σ (R r) × F_d. A load that
acts otherwise brings a formula of its own, `Load.wrench`.

A load may have stations of its own, `Load.points`: elements end there, too, but the panels of the
quadrature stay those of the beam. Data that depend on the motion of all its stations, as those of
induced flow do, are a `Coupling`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import (
    Any,
    ClassVar,
    Literal,
    NamedTuple,
    Protocol,
    TypeAlias,
    runtime_checkable,
)

import casadi as ca
import numpy as np

from curvcasadi.beam.along import breaks_of
from curvcasadi.beam.beam import Beam, merged_breaks
from curvcasadi.beam.quadrature import Panel
from curvcasadi.loads.coupling import Coupling
from curvcasadi.loads.formulas import LINEAR, Formula, WrenchFormula, linear_wrench
from curvcasadi.symbolic.expressions import (
    COINCIDENT,
    AnyExpr,
    Array,
    Number,
    rotation_matrix,
    sequence,
)

Frame = Literal["dead", "follower", "body"]
FRAMES = ("dead", "follower", "body")


#: What acts at one station: formulas, each with its data.
StationLoads: TypeAlias = list[tuple[Formula, AnyExpr]]
#: (index of a station, load data that it gains) of one load.
Contributions: TypeAlias = Iterator[tuple[int, AnyExpr]]


class Site(NamedTuple):
    """Where a load acts: a node of the quadrature or a point."""

    node: int  #: index of the station
    xi: float  #: its s/L, within the panel that the load belongs to
    measure: Number  #: m of arc length that the node stands for; 1 for a point


class Mesh(NamedTuple):
    """Stations of a loaded beam, and its panels for quadrature."""

    stations: Array
    panels: tuple[Panel, ...]

    def node(self, xi: float) -> int:
        """Index of the station `xi`."""
        return int(np.argmin(np.abs(self.stations - xi)))


@runtime_checkable
class Load(Protocol):
    """What acts on a beam. A load of the user's inherits from this class, in any file.

    It has one method of its own, `contributions`. One that is not a sum of forces and moments fixed
    in the parent or in local axes also has its own `wrench`; one that depends on the motion of its
    station, as damping does, sets `order`.

    Attributes
    ----------
    order : int
        What `wrench` takes beside the pose: 0 nothing, 1 the twist, 2 the twist and acceleration of
        the station. In statics these are zero.
    """

    order: ClassVar[int] = 0

    def __init__(self) -> None:
        """A load without fields."""

    @property
    def breaks(self) -> tuple[float, ...]:
        """Stations xi in [0, 1] at which the load acts as a point, begins, ends or jumps."""
        return ()

    @property
    def points(self) -> tuple[float, ...]:
        """Stations of its own in [0, 1], where elements end and `Mesh.node` finds a station.

        Unlike `breaks` they do not divide the quadrature along the span.
        """
        return ()

    def is_distributed(self, beam: Beam) -> bool:
        """Whether the load is integrated along the span, by `sites`.

        Parameters
        ----------
        beam : Beam
            What the load acts on.

        Returns
        -------
        bool
            False for a load at points alone.
        """
        return True

    def contributions(self, beam: Beam, mesh: Mesh, to_parent: AnyExpr) -> Contributions:
        """Numbers from which `wrench` computes what acts at the stations.

        Parameters
        ----------
        beam : Beam
            What the load acts on.
        mesh : Mesh
            Stations; `mesh.node(xi)` is the index of one of `breaks`, and `sites(beam, mesh)` are
            the nodes of the quadrature along the span.
        to_parent : SX, MX or DM, shape (3, 3)
            Rotation from inertial to parent axes.

        Yields
        ------
        node : int
            Index of a station.
        data : SX, MX or DM, shape (m, 1)
            The `data` of `wrench` there; of several contributions to a station each acts. Data of
            the default `wrench` are made by `force_data` and `moment_data`.
        """
        ...

    def coupling(self, beam: Beam, mesh: Mesh, to_parent: AnyExpr) -> Coupling | None:
        """What acts at stations that depend on the motion of each other; most loads have none.

        It acts beside `contributions`.

        Parameters
        ----------
        beam : Beam
            What the load acts on.
        mesh : Mesh
            As of `contributions`.
        to_parent : SX, MX or DM, shape (3, 3)
            As of `contributions`.

        Returns
        -------
        Coupling or None
            Stations and the Function of their poses, or of their poses and twists.
        """
        return None

    @property
    def formula(self) -> Formula:
        """How `wrench` is evaluated; that of the default one is shared by all loads."""
        return LINEAR if self.wrench is Load.wrench else WrenchFormula(self.wrench, self.order)

    @staticmethod
    def wrench(rotation: Any, position: Any, data: Any, *motion: Any) -> Any:
        """What acts at a station.

        Every symbol that it depends on is an argument: it becomes one CasADi Function for all
        stations and beams.

        Parameters
        ----------
        rotation, position : SX, shapes (3, 3) and (3, 1)
            Pose of the station, local to parent axes, m.
        data : SX, shape (m, 1)
            Of `contributions`.
        *motion : SX, shape (6, 1)
            For `order` 1 the twist (Ω, v) of the station relative to inertial space, rad/s and m/s,
            local axes; for `order` 2 also its acceleration (dΩ/dt, a), rad/s² and m/s², local axes,
            where a is the acceleration of the point, not the rate of the components of v.

        Returns
        -------
        SX, shape (6, 1)
            Wrench (moment, force) about the parent origin, parent axes, N m and N.
        """
        return linear_wrench(rotation, position, data)


def load_breaks(loads: Sequence[Load]) -> tuple[float, ...]:
    """Stations at which `loads` begin, end or jump."""
    return breaks_of(*checked_loads(loads))


def checked_loads(loads: Sequence[Load]) -> tuple[Load, ...]:
    """`loads`, each of which has what a `Load` has."""
    loads = sequence("loads", loads)
    for load in loads:
        if not isinstance(load, Load):
            raise ValueError(f"loads: expected loads such as PointForce or Gravity, found {load!r}")
    return loads


def loaded_mesh(beam: Beam, loads: Sequence[Load]) -> Mesh:
    """Stations of `beam` and panels that also break where `loads` begin, end or jump.

    Where loads are distributed, panels of few elements have more stations: `Grid.quadrature`.
    """
    breaks, grid = merged_breaks([*beam.breaks, *load_breaks(loads)]), beam.grid
    if any(load.is_distributed(beam) for load in loads):
        stations, panels = grid.quadrature(breaks)
    else:
        stations, panels = grid.stations(breaks), grid.panels(breaks)
    own = sorted({float(x) for load in loads for x in load.points})
    added = [x for x in own if np.min(np.abs(stations - x)) > COINCIDENT]
    if not added:
        return Mesh(stations, panels)
    merged = np.sort(np.append(stations, added))
    index = np.searchsorted(merged, stations).tolist()
    moved = [panel._replace(nodes=tuple(index[k] for k in panel.nodes)) for panel in panels]
    return Mesh(merged, tuple(moved))


def station_loads(
    beam: Beam, loads: Sequence[Load], mesh: Mesh, attitude: AnyExpr | None
) -> list[StationLoads]:
    """Formulas and load data for every station of `mesh`; those of `linear_wrench` as one sum.

    Parameters
    ----------
    attitude : (3, 3), parent to inertial axes; None if they are the same
    """
    to_parent = ca.DM.eye(3) if attitude is None else rotation_matrix("attitude", attitude).T
    totals: list[AnyExpr] = [None for _ in mesh.stations]
    others: list[StationLoads] = [[] for _ in mesh.stations]
    for load in checked_loads(loads):
        formula = load.formula
        for node, data in load.contributions(beam, mesh, to_parent):
            if formula is LINEAR:
                totals[node] = data if totals[node] is None else totals[node] + data
            else:
                others[node].append((formula, data))
    return [
        other if total is None else [(LINEAR, total), *other]
        for total, other in zip(totals, others, strict=True)
    ]


def couplings(
    beam: Beam, loads: Sequence[Load], mesh: Mesh, attitude: AnyExpr | None
) -> list[Coupling]:
    """Couplings between stations of `mesh`, of all loads that have one.

    Parameters
    ----------
    attitude : (3, 3), parent to inertial axes; None if they are the same
    """
    to_parent = ca.DM.eye(3) if attitude is None else rotation_matrix("attitude", attitude).T
    found = (load.coupling(beam, mesh, to_parent) for load in loads)
    return [coupled for coupled in found if coupled is not None]


def sites(beam: Beam, mesh: Mesh) -> Iterator[Site]:
    """Quadrature nodes along the span; at a break one for each side."""
    for panel in mesh.panels:
        for node, xi, weight in zip(panel.nodes, panel.xi, panel.weights, strict=True):
            yield Site(node, xi, weight * beam.length)


def force_data(force: AnyExpr, frame: Frame, offset: AnyExpr, to_parent: AnyExpr) -> AnyExpr:
    """Data of `linear_wrench` for a force (3, 1), N, at `offset` (3, 1), m, local axes."""
    zero = ca.DM.zeros(3)
    if frame == "follower":
        return ca.vertcat(zero, zero, ca.DM.zeros(9), force, ca.cross(offset, force))
    fixed = to_parent @ force if frame == "dead" else force
    return ca.vertcat(fixed, zero, ca.vec(offset @ fixed.T), zero, zero)


def moment_data(moment: AnyExpr, frame: Frame, to_parent: AnyExpr) -> AnyExpr:
    """Data of `linear_wrench` for a moment (3, 1), N m."""
    zero, none = ca.DM.zeros(3), ca.DM.zeros(9)
    if frame == "follower":
        return ca.vertcat(zero, zero, none, zero, moment)
    fixed = to_parent @ moment if frame == "dead" else moment
    return ca.vertcat(zero, fixed, none, zero, zero)
