"""The lifting line of a wing as a coupling of its strips: u_e of each from the motion of all.

Positions, and the local y and z axes, are interpolated from the aerodynamic stations and the root
to the ends and control points of the horseshoes; velocities u are fitted to the control points;
circulations come back to the stations. The line needs no stations of its own. Where a control
surface ends, u jumps, which no polynomial follows: what the fit makes of shares of the panels is
put right by the speed of the wing.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.polynomial import legendre

from curvcasadi.aero import induced, line_functions
from curvcasadi.aero.induced import LiftingLine
from curvcasadi.aero.line_functions import LineKey
from curvcasadi.aero.section import SectionData
from curvcasadi.aero.stations import air_stations, section_data
from curvcasadi.aero.strip import StripAerodynamics
from curvcasadi.beam.beam import Beam
from curvcasadi.kinematics.shape import poses
from curvcasadi.kinematics.weights import check_angles
from curvcasadi.symbolic.expressions import AnyExpr, Number, expression, is_numeric

#: Cosine of the largest angle between an axis and the parent axis that it is taken for.
_CLEAR = 0.75
#: Sine of the least angle between a wing and its plane of symmetry; m that it may stand beyond it.
_LEAST_AWAY, _OFF = 0.05, 1e-6
#: Gauss points between two breaks over which quantities of a panel are averaged.
_MEAN_POINTS = 3


class Followed(NamedTuple):
    """What the circulations of a wing follow.

    With `motion` they follow the air that its stations meet in a parent that moves so; `given` adds
    to that, or is all there is.
    """

    through: AnyExpr  #: velocity of the parent origin through the air (3, 1), m/s, parent axes
    motion: tuple[AnyExpr, AnyExpr] | None = None  #: velocity and rate of the parent, (3, 1) each
    moving: bool = False  #: whether the stations move in the parent
    given: AnyExpr | None = None  #: u of the stations (S, 1), m/s
    added: AnyExpr | None = None  #: to the u_e wanted, (wanted, 1), m/s


class LineOnWing(NamedTuple):
    """The lifting line of a wing: its Functions, and their data."""

    key: LineKey
    data: AnyExpr

    @property
    def followed(self) -> ca.Function:
        """(motions, data) -> u_e (1, wanted), m/s."""
        return line_functions.followed(self.key)

    @property
    def slopes(self) -> ca.Function:
        """Its derivatives, as `Coupling` takes them."""
        return line_functions.followed_slopes(self.key)


def line_on_wing(
    line: LiftingLine,
    beam: Beam,
    strips: StripAerodynamics,
    deflections: Mapping[str, Number],
    follows: Followed,
    wanted: Sequence[float],
) -> LineOnWing:
    """The lifting line of a wing whose parent moves through the air.

    Parameters
    ----------
    line : LiftingLine
        Number of panels, and what it is made of.
    beam, strips, deflections
        The wing, its airfoil data, and the deflections of its control surfaces, rad.
    follows : Followed
        What the circulations follow.
    wanted : sequence of float
        Stations at which u_e is wanted, s/L.

    Raises
    ------
    ValueError
        If a lift slope is not above zero, which leaves the circulation of a strip undefined; if the
        strips are too few; if the wing does not lead away from the plane of symmetry.
    """
    stations = tuple(station.xi for station in air_stations(strips))
    if len(stations) < induced.FEWEST:
        raise ValueError(
            f"StripAerodynamics.stations: expected at least {induced.FEWEST} with induced flow, "
            f"found {len(stations)}"
        )
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
    along = [airfoil(xi) for xi in stations]
    at_stations: AnyExpr = ca.vertcat(*(strip.shift for strip in along))
    fitted = ca.DM(induced.span_maps(line, np.array(stations)).fitted)
    centers = ca.vertcat(*(strips.at("aerodynamic_center", xi) for xi in panels.edges))
    plane = plane_of(line, beam)
    none = ca.DM.zeros(len(stations)), ca.DM.zeros(len(wanted))
    parts = [
        follows.through,
        plane,
        strips.side,
        shifts - fitted @ at_stations,
        none[0] if follows.given is None else follows.given,
        none[1] if follows.added is None else follows.added,
        ca.vertcat(*(scale(xi) for xi in wanted)),
    ]
    if follows.motion is not None:
        parts += [*follows.motion, *(ca.vertcat(*x) for x in _chords(along)), at_stations]
    if line.frozen:
        parts += _frozen(line, beam, stations, centers, k, plane)
    else:
        parts += [k, centers, beam.root.packed]
    key = LineKey(
        line.panels,
        line.frozen,
        line.image,
        stations,
        tuple(wanted),
        follows.motion is not None,
        follows.moving,
    )
    return LineOnWing(key, ca.vertcat(*parts))


def refuse_tip_loss(strips: StripAerodynamics, line: LiftingLine | None) -> None:
    """Refuse a factor that lets the lift vanish at the tip beside a line that does."""
    if line is not None and strips.tip_loss is not None:
        raise ValueError(
            "StripAerodynamics.tip_loss: expected None with induced flow, which makes the lift "
            f"vanish at the tip; found {strips.tip_loss}"
        )


def _chords(along: Sequence[SectionData]) -> list[list[AnyExpr]]:
    return [[strip.chord for strip in along], [strip.center for strip in along]]


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


def plane_of(line: LiftingLine, beam: Beam) -> ca.DM:
    """Normal of the plane of symmetry (3, 1), parent axes, on the side of the wing."""
    if line.plane is None and not line.image:
        return ca.DM([0, 0, 1])  # there is none
    if line.plane is None:
        normal = _nearest_axis(beam, 0, "the span of the root, as LiftingLine.plane is None")
    else:
        normal = ca.DM(line.plane)
    root = ca.vertcat(beam.root.rotation[:, 0], beam.root.position)
    if line.image and is_numeric(root):
        span, position = ca.vertsplit(ca.DM(root), [0, 3, 6])
        away, off = float(ca.dot(normal, span)), float(ca.dot(normal, position))
        if away < 0:
            normal, away, off = -normal, -away, -off
        if away < _LEAST_AWAY or off < -_OFF * (1 + float(ca.norm_2(position))):
            raise ValueError(
                "LiftingLine.image: expected a wing that leads away from its plane of symmetry, "
                f"found one whose root stands {off:g} m from it on its own side with the span at "
                f"{np.degrees(np.arcsin(min(away, 1.0))):.3g} degrees to it; give `plane`, or "
                "image=False for a wing with two free ends"
            )
    return normal


def _nearest_axis(beam: Beam, column: int, purpose: str) -> ca.DM:
    """The parent axis, with its sign, nearest to a local axis of the root."""
    axis = beam.root.rotation[:, column]
    if not is_numeric(axis):
        names = ", ".join(sorted(symbol.name() for symbol in ca.symvar(axis)))
        raise ValueError(
            f"Beam.root: expected numbers for {purpose}, found an expression of {names}; give the "
            "field of the LiftingLine"
        )
    values = ca.DM(axis).full().ravel()
    nearest = int(np.argmax(np.abs(values)))
    if abs(values[nearest]) < _CLEAR:
        raise ValueError(
            f"Beam.root: expected an axis of the parent near {purpose}, found {values}; give the "
            "field of the LiftingLine"
        )
    return ca.DM(np.eye(3)[nearest] * np.sign(values[nearest]))


def _frozen(
    line: LiftingLine,
    beam: Beam,
    stations: Sequence[float],
    centers: AnyExpr,
    k: AnyExpr,
    plane: AnyExpr,
) -> list[AnyExpr]:
    """What a line is at one shape in one stream: matrix, corners, direction of the stream.

    Γ = matrix @ u, (N, N).
    """
    if isinstance(line.shape, Mapping):
        raise ValueError(
            "LiftingLine.shape: expected the weights of this wing, found those of "
            f"{sorted(line.shape)}"
        )
    q = ca.DM.zeros(beam.basis.n)
    if line.shape is not None:
        q = expression("LiftingLine.shape", line.shape, q.shape)
        check_angles(beam, q, "LiftingLine.shape")
    frames = [beam.root.packed, *(pose.packed for pose in poses(beam, q, stations))]
    shape = line_functions.geometry(line.panels, line.image, tuple(stations))
    corners, normals = shape(ca.horzcat(*frames), centers)
    if line.velocity is None:
        stream = -_nearest_axis(beam, 1, "the chord of the root, as LiftingLine.velocity is None")
    else:
        stream = -ca.DM(line.velocity / np.linalg.norm(line.velocity))
        chord = beam.root.rotation[:, 1]
        if is_numeric(chord) and float(ca.dot(stream, ca.DM(chord))) > -1e-9:
            raise ValueError(
                "LiftingLine.velocity: expected one toward the leading edge of the root, along "
                f"{ca.DM(chord)}, found {line.velocity}"
            )
    of = induced.influence(line.panels, line.image, tuple(induced.panels_of(line).fractions))
    reduced = ca.DM.eye(line.panels) - of(corners, normals, stream, plane) @ ca.diag(k)
    matrix = ca.diag(k) @ induced.unpivoted_solve(reduced, ca.DM.eye(line.panels))
    return [ca.vec(matrix), ca.vec(corners), stream]
