"""Induced flow: horseshoe vortices along the deformed quarter-chord line of a wing.

A horseshoe is a straight bound vortex between two points of the line and two straight trailing ones
along the stream. With Γ_j its circulation and n_i the upper normal at the control point of panel i,

    w_i = n_i · Σ_j W_ij Γ_j = Σ_j B_ij Γ_j,      Γ_i = k_i (u_i + w_i),      k_i = ½ c lift_slope

is linear in u, the velocity that the circulation of a strip follows: (I − B K) u_e = u. Panels end
at ξ = sin θ with equal steps of θ (of a single wing at (1 − cos θ)/2), and a control point lies on
its bound vortex in the middle of θ. The wing on the other side of a plane of symmetry is the mirror
image; the line goes on to that plane where the root stands off it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from itertools import pairwise
from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.polynomial import chebyshev, legendre

from curvcasadi.symbolic.expressions import AnyExpr, Array, Number, count, instance, numbers

#: Degree of the polynomials along the span that stand for poses, and the fewest stations.
SMOOTH, FEWEST = 6, 3
#: Most horseshoes of a line.
MOST = 24


@dataclass(frozen=True, eq=False, kw_only=True)
class LiftingLine:
    """Induced flow of a wing by a lifting line of horseshoe vortices.

    Attributes
    ----------
    panels : int
        Number of horseshoes along the beam, at most 24. Six are converged.
    frozen : bool
        Whether the influence of the horseshoes is that of one shape in one stream: a constant
        matrix, for control models. Otherwise it moves with the wing.
    image : bool
        Whether the wing has a mirror image beyond a plane of symmetry through the parent origin;
        without one it is a single wing with two free ends.
    plane : array, shape (3,), or None
        Unit normal of the plane of symmetry, parent axes; None for the parent axis nearest to the
        span at the root.
    shape : array, shape (n,), mapping of str to such arrays, or None
        Weights q, rad/m, of the shape at which the line is frozen, as those of an `Equilibrium`; of
        the wings of an aircraft by name, as those of a `TrimResult`. None for the unbent wing.
    velocity : array, shape (3,), or None
        Velocity of the parent through the air, m/s, parent axes, which leaves the wake of a frozen
        line behind, toward the leading edge of the root; None for the parent axis nearest to the
        chord at the root.
    """

    panels: int = 6
    frozen: bool = False
    image: bool = True
    plane: Number | None = None
    shape: Number | Mapping[str, Number] | None = None
    velocity: Number | None = None

    def __post_init__(self) -> None:
        if count("LiftingLine.panels", self.panels) > MOST:
            raise ValueError(
                f"LiftingLine.panels: expected at most {MOST}, as expressions grow with their "
                f"third power, found {self.panels}; six are converged"
            )
        for name in ("frozen", "image"):
            instance(f"LiftingLine.{name}", getattr(self, name), bool)
        for name in ("shape", "velocity"):
            if getattr(self, name) is not None and not self.frozen:
                raise ValueError(
                    f"LiftingLine.{name}: expected None of a line that moves with the wing, found "
                    f"{getattr(self, name)}; with frozen=True it is that of the frozen line"
                )
        if isinstance(self.shape, Mapping):
            values = {k: numbers(f"LiftingLine.shape[{k!r}]", q) for k, q in self.shape.items()}
            object.__setattr__(self, "shape", values)
        elif self.shape is not None:
            object.__setattr__(self, "shape", numbers("LiftingLine.shape", self.shape))
        if self.velocity is not None:
            velocity = numbers("LiftingLine.velocity", self.velocity).ravel()
            if velocity.shape != (3,) or not np.any(velocity):
                raise ValueError(
                    "LiftingLine.velocity: expected three numbers that are not all zero, found "
                    f"{velocity}"
                )
            object.__setattr__(self, "velocity", velocity)
        if self.plane is not None:
            normal = numbers("LiftingLine.plane", self.plane)
            if normal.shape != (3,) or abs(np.linalg.norm(normal) - 1) > 1e-6:
                raise ValueError(
                    f"LiftingLine.plane: expected a unit vector of three numbers, found {normal}"
                )
            object.__setattr__(self, "plane", normal)


def line_of_wing(line: LiftingLine | None, name: str) -> LiftingLine | None:
    """The line of the wing of this name, frozen at its own shape."""
    if line is None or not isinstance(line.shape, Mapping):
        return line
    if name not in line.shape:
        raise ValueError(
            f"LiftingLine.shape: expected weights of the wing {name!r}, found those of "
            f"{sorted(line.shape)}"
        )
    return replace(line, shape=line.shape[name])


class Panels(NamedTuple):
    """Where the horseshoes of a lifting line begin and end."""

    edges: Array  #: stations of their ends, (N + 1,)
    points: Array  #: stations of the control points, (N,)

    @property
    def fractions(self) -> Array:
        """Where the control points lie between the ends of their panels, (N,), in (0, 1)."""
        return np.asarray((self.points - self.edges[:-1]) / np.diff(self.edges))


def station_at(line: LiftingLine, angle: Array) -> Array:
    """Station ξ of the angle θ, of which equal steps make the panels."""
    return np.asarray(np.sin(angle) if line.image else (1 - np.cos(angle)) / 2)


def angle_at(line: LiftingLine, xi: Array) -> Array:
    """The angle θ of a station ξ."""
    return np.asarray(np.arcsin(xi) if line.image else np.arccos(1 - 2 * xi))


def panels_of(line: LiftingLine) -> Panels:
    """Ends and control points of the horseshoes of `line`."""
    theta = np.linspace(0, np.pi / 2 if line.image else np.pi, line.panels + 1)
    middle = (theta[1:] + theta[:-1]) / 2
    return Panels(station_at(line, theta), station_at(line, middle))


class SpanMaps(NamedTuple):
    """Numeric maps between the aerodynamic stations of a wing and the panels of its line."""

    to_edges: Array  #: of smooth quantities, known at the root and the S stations: (N + 1, S + 1)
    to_points: Array  #: likewise, (N, S + 1)
    fitted: Array  #: of velocities at the stations, (N, S), to the control points
    back: Array  #: of circulations at the control points, (S, N), to the stations


def span_maps(line: LiftingLine, stations: Array) -> SpanMaps:
    """Maps of a line on a wing with aerodynamic `stations` (S,) strictly between 0 and 1.

    Velocities are fitted by a polynomial of degree min(N, S) − 1, what is smooth by one of degree
    min(6, S): interpolation between many stations would magnify rounding by orders. The circulation
    is a root that vanishes at the free ends, times polynomials that are even where there is a
    mirror image.
    """
    panels = panels_of(line)
    known = np.concatenate([[0.0], stations])
    smooth = min(SMOOTH, len(stations))
    return SpanMaps(
        to_edges=_fit(known, panels.edges, smooth),
        to_points=_fit(known, panels.points, smooth),
        fitted=_fit(stations, panels.points, min(line.panels, len(stations)) - 1),
        back=circulation_shapes(line, stations)
        @ np.linalg.inv(circulation_shapes(line, panels.points)),
    )


def circulation_shapes(line: LiftingLine, xi: Array) -> Array:
    """Functions along the span of which a circulation is composed, at stations: (len(xi), N)."""
    n = line.panels
    if line.image:
        return np.asarray(
            np.sqrt(1 - xi**2)[:, None] * chebyshev.chebvander(xi, 2 * n)[:, : 2 * n : 2]
        )
    centered = 2 * xi - 1
    return np.asarray(np.sqrt(1 - centered**2)[:, None] * chebyshev.chebvander(centered, n - 1))


def _fit(known: Array, wanted: Array, degree: int) -> Array:
    """Values at `wanted` of the polynomial that fits values at `known`: (wanted, known)."""
    through = np.linalg.pinv(legendre.legvander(2 * known - 1, degree))
    return np.asarray(legendre.legvander(2 * wanted - 1, degree) @ through)


def bound_velocity(point: AnyExpr, start: AnyExpr, end: AnyExpr) -> AnyExpr:
    """Velocity (3, 1) at `point` from a straight vortex of unit circulation, by Biot and Savart.

    r_1 × r_2 (|r_1| + |r_2|)/(4 π |r_1| |r_2| (|r_1| |r_2| + r_1 · r_2)); not on the vortex itself.
    """
    first, second = point - start, point - end
    a, b = ca.sqrt(ca.sumsqr(first)), ca.sqrt(ca.sumsqr(second))
    scale = (a + b) / (4 * np.pi * a * b * (a * b + ca.dot(first, second)))
    return scale * ca.cross(first, second)


def trailing_velocity(point: AnyExpr, start: AnyExpr, direction: AnyExpr) -> AnyExpr:
    """Velocity (3, 1) at `point` from a vortex of unit circulation from `start` to infinity.

    d × r/(4 π |r| (|r| − d · r)) with the unit vector d; not downstream on the vortex itself.
    """
    arm = point - start
    distance = ca.sqrt(ca.sumsqr(arm))
    scale = 1 / (4 * np.pi * distance * (distance - ca.dot(direction, arm)))
    return scale * ca.cross(direction, arm)


@cache
def influence(panels: int, image: bool, fractions: tuple[float, ...]) -> ca.Function:
    """(corners (3, N + 1), normals (3, N), direction (3, 1), plane (3, 1)) -> B (N, N), 1/m.

    Normal velocity at the control point of panel i from a unit circulation of panel j, root to tip,
    with its mirror image. The own bound vortex induces nothing at a point on itself.
    """
    corners, normals = ca.SX.sym("corners", 3, panels + 1), ca.SX.sym("normals", 3, panels)
    direction, plane = ca.SX.sym("direction", 3), ca.SX.sym("plane", 3)
    ends = ca.horzsplit(corners)
    rows = []
    for i, t in enumerate(fractions):
        point = ends[i] + t * (ends[i + 1] - ends[i])
        velocities = _velocities(point, ends, direction, plane if image else None, own=i)
        rows.append([ca.dot(normals[:, i], velocity) for velocity in velocities])
    matrix = ca.vertcat(*(ca.horzcat(*row) for row in rows))
    return ca.Function("influence", [corners, normals, direction, plane], [matrix], {"cse": True})


@cache
def wake_velocity(panels: int, image: bool) -> ca.Function:
    """(point, corners, direction, plane, Γ (N, 1)) -> velocity (3, 1) there, m/s.

    For points off the wing, such as a tail. With `image` the trailing vortices at the plane of
    symmetry cancel and are left out; the image itself is not added: it is a wing of its own.
    """
    point, corners = ca.SX.sym("point", 3), ca.SX.sym("corners", 3, panels + 1)
    direction, plane = ca.SX.sym("direction", 3), ca.SX.sym("plane", 3)
    circulations = ca.SX.sym("circulations", panels)
    ends = ca.horzsplit(corners)
    total = ca.SX(3, 1)
    for j, (start, end) in enumerate(pairwise(ends)):
        velocity = bound_velocity(point, start, end) + trailing_velocity(point, end, direction)
        if j or not image:
            velocity = velocity - trailing_velocity(point, start, direction)
        else:
            velocity = velocity + bound_velocity(point, _on_plane(start, plane), start)
        total = total + circulations[j] * velocity
    inputs = [point, corners, direction, plane, circulations]
    return ca.Function("wake_velocity", inputs, [total], {"cse": True})


def _velocities(
    point: ca.SX, ends: list[ca.SX], direction: ca.SX, plane: ca.SX | None, own: int
) -> list[ca.SX]:
    """Velocity at `point` on the bound vortex `own` from each horseshoe and its image."""
    mirrored = [] if plane is None else [end - 2 * plane * ca.dot(plane, end) for end in ends]
    turned = None if plane is None else direction - 2 * plane * ca.dot(plane, direction)
    found = []
    for j in range(len(ends) - 1):
        velocity = ca.SX(3, 1)
        if j != own:
            velocity += bound_velocity(point, ends[j], ends[j + 1])
        velocity += trailing_velocity(point, ends[j + 1], direction)
        if plane is None or j:
            velocity -= trailing_velocity(point, ends[j], direction)
        if plane is not None:
            velocity -= bound_velocity(point, mirrored[j], mirrored[j + 1])
            velocity -= trailing_velocity(point, mirrored[j + 1], turned)
            if j:
                velocity += trailing_velocity(point, mirrored[j], turned)
            else:
                velocity += bound_velocity(point, mirrored[0], ends[0])
        found.append(velocity)
    return found


def _on_plane(point: ca.SX, plane: ca.SX) -> ca.SX:
    return point - plane * ca.dot(plane, point)


def unpivoted_solve(matrix: AnyExpr, right: AnyExpr) -> AnyExpr:
    """x of matrix @ x = right by elimination in the given order.

    For matrices such as I − B K, whose diagonal dominates: no pivot vanishes, and no branch is
    needed.
    """
    n = matrix.shape[0]
    rows = [[matrix[i, j] for j in range(n)] for i in range(n)]
    values = [right[i, :] for i in range(n)]
    for k in range(n):
        for i in range(k + 1, n):
            factor = rows[i][k] / rows[k][k]
            for j in range(k + 1, n):
                rows[i][j] = rows[i][j] - factor * rows[k][j]
            values[i] = values[i] - factor * values[k]
    for k in reversed(range(n)):
        for j in range(k + 1, n):
            values[k] = values[k] - rows[k][j] * values[j]
        values[k] = values[k] / rows[k][k]
    return ca.vertcat(*values)


@cache
def circulations(panels: int, image: bool, fractions: tuple[float, ...]) -> ca.Function:
    """(corners, normals, direction, plane, k (N, 1), u (N, 1)) -> Γ (N, 1), m²/s.

    Γ = K (I − B K)⁻¹ u of the panels, from the velocities u that their circulation follows.
    """
    of = influence(panels, image, fractions)
    geometry = [ca.SX.sym(of.name_in(i), *of.size_in(i)) for i in range(of.n_in())]
    k, u = ca.SX.sym("k", panels), ca.SX.sym("u", panels)
    matrix = of(*geometry)
    reduced = ca.SX.eye(panels) - matrix * ca.repmat(k.T, panels, 1)
    outputs = [k * unpivoted_solve(reduced, u)]
    return ca.Function("circulations", [*geometry, k, u], outputs, {"cse": True})
