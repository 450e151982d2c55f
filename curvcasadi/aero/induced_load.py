"""The lifting line of a wing as a coupling of its strips: u_e of each from the poses of all.

Positions, and the local y and z axes, are interpolated from the aerodynamic stations and the root
to the ends and control points of the horseshoes; velocities u are fitted to the control points;
circulations come back to the stations. The line needs no stations of its own.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from itertools import pairwise
from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.polynomial import legendre

from curvcasadi.aero import induced, section
from curvcasadi.aero.induced import LiftingLine
from curvcasadi.aero.section import SectionData
from curvcasadi.aero.stations import air_stations, section_data
from curvcasadi.aero.strip import StripAerodynamics
from curvcasadi.beam.beam import Beam
from curvcasadi.beam.pose import unpack_pose
from curvcasadi.kinematics.shape import poses
from curvcasadi.symbolic.expressions import AnyExpr, Number, is_numeric

#: Gauss points between two breaks over which quantities of a panel are averaged.
_MEAN_POINTS = 3


class LineOnWing(NamedTuple):
    """The lifting line of a wing in flight, as Functions of the poses (12, S) of its stations."""

    followed: ca.Function  #: (poses, data) -> u_e (1, wanted), m/s
    wash: ca.Function  #: (poses, (data, point)) -> velocity (3, 1) there, m/s, parent axes
    data: AnyExpr


class _Key(NamedTuple):
    """What the Functions of a line depend on."""

    line: tuple[int, bool, bool]  #: panels, frozen, image
    stations: tuple[float, ...]
    wanted: tuple[float, ...]


def line_on_wing(
    line: LiftingLine,
    beam: Beam,
    strips: StripAerodynamics,
    deflections: Mapping[str, Number],
    *,
    velocity: AnyExpr,
    rate: AnyExpr,
    wanted: Sequence[float],
) -> LineOnWing:
    """The lifting line of a wing whose parent moves through the air.

    Parameters
    ----------
    line : LiftingLine
        Number of panels, and what it is made of.
    beam, strips, deflections
        The wing, its airfoil data, and the deflections of its control surfaces, rad.
    velocity, rate : SX, MX or DM, shape (3, 1)
        Of the parent through the air, m/s and rad/s, parent axes.
    wanted : sequence of float
        Stations at which u_e is wanted, s/L.

    Raises
    ------
    ValueError
        If a lift slope is not above zero, which leaves the circulation of a strip undefined.
    """
    stations = tuple(station.xi for station in air_stations(strips))
    panels = induced.panels_of(line)

    def airfoil(xi: float) -> SectionData:
        found = section_data(strips, xi, deflections, density=1.0, measure=1.0)
        if is_numeric(found.slope) and not float(found.slope) > 0:
            raise ValueError(
                f"StripAerodynamics.lift_slope at xi = {xi:g}: expected a number above zero with "
                f"induced flow, found {float(found.slope):g}"
            )
        return found

    def scale(xi: float) -> AnyExpr:
        return airfoil(xi).chord * airfoil(xi).slope / 2

    def shift(xi: float) -> AnyExpr:
        return airfoil(xi).shift

    k, shifts = (_means(line, value, strips.breaks) for value in (scale, shift))
    centers = ca.vertcat(*(strips.at("aerodynamic_center", xi) for xi in panels.edges))
    along = [airfoil(xi) for xi in stations]
    common = [
        velocity,
        rate,
        strips.side,
        shifts,
        ca.vertcat(*(strip.chord for strip in along)),
        ca.vertcat(*(strip.center for strip in along)),
        ca.vertcat(*(scale(xi) for xi in wanted)),
    ]
    plane = _plane(line, beam)
    if line.frozen:
        data = ca.vertcat(*common, plane, *_frozen(line, beam, centers, k, plane))
    else:
        data = ca.vertcat(*common, plane, k, centers, beam.root.packed)
    key = _Key((line.panels, line.frozen, line.image), stations, tuple(wanted))
    return LineOnWing(_followed(key), _wash(key), data)


def _means(
    line: LiftingLine, value: Callable[[float], AnyExpr], breaks: Sequence[float]
) -> AnyExpr:
    """Means of a quantity over the panels, (N, 1), by the angle θ: near the control point's value.

    A jump, such as the end of a flap, counts with its part of the panel.
    """
    nodes, weights = legendre.leggauss(_MEAN_POINTS)
    jumps = induced.angle_at(line, np.array(breaks))
    means = []
    for start, end in pairwise(induced.angle_at(line, induced.panels_of(line).edges)):
        total = 0
        for left, right in pairwise([start, *jumps[(jumps > start) & (jumps < end)], end]):
            xi = induced.station_at(line, left + (right - left) * (1 + nodes) / 2)
            parts = weights / 2 * (right - left) / (end - start)
            total += sum(part * value(float(x)) for part, x in zip(parts, xi, strict=True))
        means.append(total)
    return ca.vertcat(*means)


def _plane(line: LiftingLine, beam: Beam) -> ca.DM:
    """Normal of the plane of symmetry (3, 1), parent axes."""
    if line.plane is not None:
        return ca.DM(line.plane)
    return _nearest_axis(beam, 0, "the plane of symmetry of LiftingLine, whose `plane` is None")


def _nearest_axis(beam: Beam, column: int, purpose: str) -> ca.DM:
    """The parent axis, with its sign, nearest to a local axis of the root."""
    axis = beam.root.rotation[:, column]
    if not is_numeric(axis):
        raise ValueError(f"Beam.root: {purpose} needs a number, found the symbol {axis}")
    values = ca.DM(axis).full().ravel()
    nearest = int(np.argmax(np.abs(values)))
    return ca.DM(np.eye(3)[nearest] * np.sign(values[nearest]))


def _frozen(
    line: LiftingLine, beam: Beam, centers: AnyExpr, k: AnyExpr, plane: AnyExpr
) -> list[AnyExpr]:
    """The unbent wing in a stream along the axis nearest to its chord: matrix, corners, stream.

    Γ = matrix @ u, (N, N).
    """
    panels = induced.panels_of(line)
    straight = ca.DM.zeros(beam.basis.n)
    at_edges = poses(beam, straight, panels.edges.tolist())
    at_points = poses(beam, straight, panels.points.tolist())
    corners = ca.horzcat(
        *(pose.position + centers[i] * pose.rotation[:, 1] for i, pose in enumerate(at_edges))
    )
    normals = ca.horzcat(*(pose.rotation[:, 2] for pose in at_points))
    stream = -_nearest_axis(beam, 1, "the stream of a frozen LiftingLine")
    of = induced.influence(line.panels, line.image, tuple(panels.fractions))
    reduced = ca.DM.eye(line.panels) - of(corners, normals, stream, plane) @ ca.diag(k)
    matrix = ca.diag(k) @ induced.unpivoted_solve(reduced, ca.DM.eye(line.panels))
    return [ca.vec(matrix), ca.vec(corners), stream]


class _Line(NamedTuple):
    """Symbols of a lifting line in flight, and the circulations of its panels."""

    poses: ca.SX
    data: ca.SX
    back: ca.SX  #: ½ c lift_slope of the wanted stations
    upper: ca.SX
    corners: ca.SX  #: (3, N + 1), m
    direction: ca.SX  #: (3, 1), of the stream
    plane: ca.SX  #: (3, 1)
    circulations: ca.SX  #: Γ (N, 1), m²/s, positive where it lifts


@lru_cache(maxsize=32)
def _line(key: _Key) -> _Line:
    n, frozen, image = key.line
    line = LiftingLine(panels=n, frozen=frozen, image=image)
    s, maps = len(key.stations), induced.span_maps(line, np.array(key.stations))
    sizes = [3, 3, 1, n, s, s, len(key.wanted), 3]
    sizes += [n * n, 3 * (n + 1), 3] if frozen else [n, n + 1, 12]
    poses, data = ca.SX.sym("poses", 12, s), ca.SX.sym("data", sum(sizes))
    parts = ca.vertsplit(data, np.cumsum([0, *sizes]).tolist())
    velocity, rate, upper, shifts, chords, centers, back, plane, *rest = parts
    frames = [unpack_pose(poses[:, i]) for i in range(s)]
    followed = [
        section.circulation(
            rotation.T @ (velocity + ca.cross(rate, position)),
            rotation.T @ rate,
            _airfoil(upper, chords[i], centers[i]),
        )
        for i, (rotation, position) in enumerate(frames)
    ]
    fitted = ca.DM(maps.fitted)
    speeds = fitted @ ca.vertcat(*(found.speed for found in followed))
    u = fitted @ ca.vertcat(*(found.velocity for found in followed)) + speeds * shifts
    if frozen:
        matrix, corners = ca.reshape(rest[0], n, n), ca.reshape(rest[1], 3, n + 1)
        return _Line(poses, data, back, upper, corners, rest[2], plane, matrix @ u)
    k, edges, root = rest
    frames = [unpack_pose(root), *frames]
    to_edges, to_points = ca.DM(maps.to_edges).T, ca.DM(maps.to_points).T
    ahead = ca.horzcat(*(rotation[:, 1] for rotation, _ in frames)) @ to_edges
    corners = ca.horzcat(*(position for _, position in frames)) @ to_edges
    corners += ahead * ca.repmat(edges.T, 3, 1)
    normals = ca.horzcat(*(rotation[:, 2] for rotation, _ in frames)) @ to_points
    direction = -_unit(velocity, root[3:6])
    of = induced.circulations(n, image, tuple(induced.panels_of(line).fractions))
    found = of(corners, normals, direction, plane, k, u)
    return _Line(poses, data, back, upper, corners, direction, plane, found)


def _airfoil(upper: ca.SX, chord: ca.SX, center: ca.SX) -> SectionData:
    """What `section.circulation` takes, without the angle of zero lift."""
    return SectionData(upper, 0, chord, center, 0, 0, 0, 0, 0, 0, 0)


def _unit(velocity: ca.SX, otherwise: ca.SX) -> ca.SX:
    """`velocity` over its norm; `otherwise` in still air, where forces vanish with their slopes."""
    still = ca.sumsqr(velocity) <= 0
    moving = ca.if_else(still, otherwise, velocity)
    return moving / ca.sqrt(ca.sumsqr(moving))


@lru_cache(maxsize=32)
def _followed(key: _Key) -> ca.Function:
    """(poses, data) -> u_e (1, wanted) = Γ/(½ c lift_slope), m/s."""
    count, frozen, image = key.line
    parts = _line(key)
    line = LiftingLine(panels=count, frozen=frozen, image=image)
    points = induced.panels_of(line).points
    shapes = induced.circulation_shapes(line, np.array(key.wanted))
    back = shapes @ np.linalg.inv(induced.circulation_shapes(line, points))
    values = ca.DM(back) @ parts.circulations / parts.back
    return ca.Function("induced_flow", [parts.poses, parts.data], [values.T], {"cse": True})


@lru_cache(maxsize=32)
def _wash(key: _Key) -> ca.Function:
    """(poses, (data, point)) -> velocity at a point off the wing, its image not included."""
    count, _, image = key.line
    parts, point = _line(key), ca.SX.sym("point", 3)
    strengths = parts.upper * parts.circulations
    geometry = (parts.corners, parts.direction, parts.plane)
    velocity = induced.wake_velocity(count, image)(point, *geometry, strengths)
    data = ca.vertcat(parts.data, point)
    return ca.Function("wash", [parts.poses, data], [velocity], ["poses", "data"], ["velocity"])


def frozen_map(line: LiftingLine, beam: Beam, strips: StripAerodynamics) -> AnyExpr:
    """u_e of the aerodynamic stations from their u, (S, S), with the influence of the unbent wing.

    Parameters
    ----------
    line : LiftingLine
        Number of panels and images.
    beam, strips
        The wing and its airfoil data; deflections count with the u of the stations.
    """
    still = {"velocity": ca.DM.zeros(3), "rate": ca.DM.zeros(3)}
    stations = np.array([station.xi for station in air_stations(strips)])
    frozen = replace(line, frozen=True)
    found = line_on_wing(frozen, beam, strips, {}, **still, wanted=stations.tolist())
    n, panels = line.panels, induced.panels_of(line)
    matrix = ca.reshape(found.data[-(n * n + 3 * (n + 1) + 3) : -(3 * (n + 1) + 3)], n, n)
    shapes = induced.circulation_shapes(line, stations)
    back = shapes @ np.linalg.inv(induced.circulation_shapes(line, panels.points))
    data = [section_data(strips, x, {}, density=1.0, measure=1.0) for x in stations]
    scales = ca.vertcat(*(strip.chord * strip.slope / 2 for strip in data))
    to_points = ca.DM(induced.span_maps(line, stations).fitted)
    return (ca.DM(back) @ matrix @ to_points) / ca.repmat(scales, 1, len(stations))
