"""The lifting line of a wing as Functions of the motion of its stations, with their derivatives.

At the control points the velocities r that the circulations Γ = K r follow solve

    F = u + B(shape, stream) K r − r = 0

and are what they are for u alone where the line is frozen, Γ = M u. Values y(r, shape, …) therefore
change by

    dy = y_r (I − B K)⁻¹ (F_shape dshape + F_data ddata) + y_shape dshape + y_data ddata

where the derivatives of F are those of one row each at fixed r: no elimination is differentiated.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from curvcasadi.aero import induced, section
from curvcasadi.aero.induced import LiftingLine
from curvcasadi.aero.section import SectionData
from curvcasadi.beam.pose import unpack_pose
from curvcasadi.loads.coupling import by_moves, slope_function


class LineKey(NamedTuple):
    """What the Functions of a line depend on."""

    panels: int
    frozen: bool
    image: bool
    stations: tuple[float, ...]  #: of the strips whose circulations it couples
    wanted: tuple[float, ...]  #: at which u_e is wanted
    follows: bool  #: whether circulations follow the motion of the stations, beside what is given
    moving: bool  #: whether the stations move in the parent

    @property
    def line(self) -> LiftingLine:
        """The line, of which no more than this matters here."""
        return LiftingLine(panels=self.panels, frozen=self.frozen, image=self.image)

    @property
    def sizes(self) -> dict[str, int]:
        """Entries of the data by name, in order."""
        n, s, w = self.panels, len(self.stations), len(self.wanted)
        sizes = {"through": 3, "plane": 3, "upper": 1, "jumps": n}
        sizes |= {"given": s, "added": w, "k_wanted": w}
        if self.follows:
            sizes |= {"velocity": 3, "rate": 3, "chord": s, "center": s, "shift": s}
        if self.frozen:
            return sizes | {"matrix": n * n, "corners": 3 * (n + 1), "stream": 3}
        return sizes | {"k": n, "ahead": n + 1, "root": 12}


class _Line(NamedTuple):
    """A lifting line of symbols."""

    motions: ca.SX  #: (12, S), or with twists (18, S)
    data: ca.SX
    parts: dict[str, ca.SX]  #: of the data
    u: ca.SX  #: symbol of u of the stations by their motion, (S, 1), m/s
    r: ca.SX  #: symbol of u_e of the control points, (N, 1), m/s
    followed: ca.SX  #: what u is
    left: ca.SX  #: F (N, 1), m/s
    reduced: ca.SX  #: −∂F/∂r, (N, N)
    corners: ca.SX  #: (3, N + 1), m
    stream: ca.SX  #: its direction (3, 1)
    circulations: ca.SX  #: Γ (N, 1) of r, m²/s, positive where it lifts


@lru_cache(maxsize=32)
def followed(key: LineKey) -> ca.Function:
    """(motions, data) -> u_e (1, wanted) = Γ/(½ c lift_slope) + added, m/s."""
    line = _line(key)
    return ca.Function(
        "induced_flow",
        [line.motions, line.data],
        [_solved(line, _values(key, line)).T],
        ["motions", "data"],
        ["values"],
        {"cse": True},
    )


@lru_cache(maxsize=32)
def followed_slopes(key: LineKey) -> ca.Function:
    """(motions, data) -> derivatives of `followed`, as those of `Coupling.slopes`."""
    line = _line(key)
    return _slopes(line, line.motions, line.data, _values(key, line))


@lru_cache(maxsize=32)
def wash(key: LineKey, points: int) -> ca.Function:
    """(motions, (data, points)) -> velocities (3, points) off the wing, its image left out."""
    line, data, velocities = _washed(key, points)
    return ca.Function(
        "wash",
        [line.motions, data],
        [_solved(line, velocities)],
        ["motions", "data"],
        ["values"],
        {"cse": True},
    )


@lru_cache(maxsize=32)
def wash_slopes(key: LineKey, points: int) -> ca.Function:
    """(motions, (data, points)) -> derivatives of `wash`, as those of `Coupling.slopes`."""
    line, data, velocities = _washed(key, points)
    return _slopes(line, line.motions, data, ca.vec(velocities))


@lru_cache(maxsize=32)
def _line(key: LineKey) -> _Line:
    n, stations, maps = (
        key.panels,
        len(key.stations),
        induced.span_maps(key.line, np.array(key.stations)),
    )
    motions = ca.SX.sym("motions", 18 if key.moving else 12, stations)
    data = ca.SX.sym("data", sum(key.sizes.values()))
    ends = np.cumsum([0, *key.sizes.values()]).tolist()
    parts = dict(zip(key.sizes, ca.vertsplit(data, ends), strict=True))
    u, r = ca.SX.sym("u", stations), ca.SX.sym("r", n)
    speed, direction = _speed_and_direction(parts)
    arriving = ca.DM(maps.fitted) @ (u + parts["given"]) + speed * parts["jumps"]
    if key.frozen:
        circulations = ca.reshape(parts["matrix"], n, n) @ r
        corners, stream = ca.reshape(parts["corners"], 3, n + 1), parts["stream"]
        left, reduced = arriving - r, ca.SX.eye(n)
    else:
        shape = geometry(n, key.image, key.stations)
        corners, normals = shape(ca.horzcat(parts["root"], motions[:12, :]), parts["ahead"])
        stream, circulations = direction, parts["k"] * r
        of = induced.influence(n, key.image, tuple(induced.panels_of(key.line).fractions))
        matrix = of(corners, normals, stream, parts["plane"])
        left = arriving + matrix @ circulations - r
        reduced = ca.SX.eye(n) - matrix * ca.repmat(parts["k"].T, n, 1)
    return _Line(
        motions=motions,
        data=data,
        parts=parts,
        u=u,
        r=r,
        followed=_followed(key, motions, parts),
        left=left,
        reduced=reduced,
        corners=corners,
        stream=stream,
        circulations=circulations,
    )


@lru_cache(maxsize=32)
def geometry(panels: int, image: bool, stations: tuple[float, ...]) -> ca.Function:
    """(poses (12, 1 + S), ahead (N + 1, 1)) -> ends (3, N + 1), normals (3, N).

    Poses are those of the root and the stations; the ends of the bound vortices lie `ahead`, m, of
    the reference curve, and normals are those at the control points.
    """
    maps = induced.span_maps(LiftingLine(panels=panels, image=image), np.array(stations))
    poses, ahead = ca.SX.sym("poses", 12, 1 + len(stations)), ca.SX.sym("ahead", panels + 1)
    frames = [unpack_pose(pose) for pose in ca.horzsplit(poses)]
    to_edges, to_points = ca.DM(maps.to_edges).T, ca.DM(maps.to_points).T
    chordwise = ca.horzcat(*(rotation[:, 1] for rotation, _ in frames)) @ to_edges
    corners = ca.horzcat(*(position for _, position in frames)) @ to_edges
    corners += chordwise * ca.repmat(ahead.T, 3, 1)
    normals = ca.horzcat(*(rotation[:, 2] for rotation, _ in frames)) @ to_points
    return ca.Function("line_shape", [poses, ahead], [corners, normals])


def _followed(key: LineKey, motions: ca.SX, parts: dict[str, ca.SX]) -> ca.SX:
    """u of the stations, (S, 1): zero where what is given is all that circulations follow."""
    if not key.follows:
        return ca.densify(ca.SX(len(key.stations), 1))
    found = []
    for i in range(len(key.stations)):
        rotation, position = unpack_pose(motions[:12, i])
        velocity = rotation.T @ (parts["velocity"] + ca.cross(parts["rate"], position))
        omega = rotation.T @ parts["rate"]
        if key.moving:
            omega, velocity = omega + motions[12:15, i], velocity + motions[15:18, i]
        strip = SectionData(
            upper=parts["upper"],
            pressure=0,
            chord=parts["chord"][i],
            center=parts["center"][i],
            slope=0,
            shift=parts["shift"][i],
            drag=0,
            moment=0,
            moment_slope=0,
            suction=0,
            apparent=0,
        )
        found.append(section.circulation(velocity, omega, strip).velocity)
    return ca.SX(ca.vertcat(*found))


def _speed_and_direction(parts: dict[str, ca.SX]) -> tuple[ca.SX, ca.SX]:
    """Speed of the parent through the air, and the direction of the stream that meets it.

    In still air, where forces vanish with their slopes, the direction is that of the chord.
    """
    velocity, chord = parts["through"], parts["root"][3:6] if "root" in parts else ca.DM([1, 0, 0])
    still = ca.sumsqr(velocity) <= 0
    moving = ca.if_else(still, chord, velocity)
    size = ca.sqrt(ca.sumsqr(moving))
    return ca.if_else(still, 0, size), -moving / size


def _values(key: LineKey, line: _Line) -> ca.SX:
    """u_e (wanted, 1) of r."""
    shapes = induced.circulation_shapes(key.line, np.array(key.wanted))
    points = induced.panels_of(key.line).points
    back = shapes @ np.linalg.inv(induced.circulation_shapes(key.line, points))
    return ca.DM(back) @ line.circulations / line.parts["k_wanted"] + line.parts["added"]


def _washed(key: LineKey, points: int) -> tuple[_Line, ca.SX, ca.SX]:
    """The line, its data with those of the points, and velocities (3, points) of r."""
    line, at = _line(key), ca.SX.sym("points", 3, points)
    strengths = line.parts["upper"] * line.circulations
    geometry = (line.corners, line.stream, line.parts["plane"])
    of = induced.wake_velocity(key.panels, key.image)
    velocities = ca.horzcat(*(of(point, *geometry, strengths) for point in ca.horzsplit(at)))
    return line, ca.vertcat(line.data, ca.vec(at)), velocities


def _solved(line: _Line, *values: ca.SX) -> Any:
    """Values of u and r, in which these stand for themselves, for those that solve F = 0."""
    arriving = ca.substitute([line.left], [line.u, line.r], [line.followed, 0 * line.r])[0]
    solution = induced.unpivoted_solve(line.reduced, arriving)
    results = ca.substitute([*values], [line.u, line.r], [line.followed, solution])
    return results[0] if len(results) == 1 else results


def _slopes(line: _Line, motions: ca.SX, data: ca.SX, values: ca.SX) -> ca.Function:
    """Derivatives of values (…, 1) of r by the motions and the data."""
    fitted = ca.jacobian(line.left, line.u)
    through = induced.unpivoted_solve(line.reduced.T, ca.jacobian(values, line.r).T).T
    slopes = []
    for by in (ca.vec(motions), data):
        arriving = ca.jacobian(line.left, by) + fitted @ ca.jacobian(line.followed, by)
        slopes.append(ca.jacobian(values, by) + through @ arriving)
    by_motions, by_data = _solved(line, *slopes)
    return slope_function(motions, data, by_moves(by_motions, motions), by_data)
