"""Division of a beam into elements, and how an element is integrated."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal, Protocol, cast, get_args

import casadi as ca
import numpy as np

from curvcasadi.beam.quadrature import (
    LEAST_ELEMENTS,
    GridKind,
    Panel,
    divided_panels,
    lobatto_points,
    panels_between,
)
from curvcasadi.lie.series import degree_for
from curvcasadi.symbolic.expressions import (
    COINCIDENT,
    Array,
    Real,
    choice,
    count,
    increasing_stations,
    numbers,
)
from curvcasadi.symbolic.text import shown

RuleName = Literal["trapezoid", "midpoint", "magnus4", "magnus6"]
ExponentialName = Literal["series", "rodrigues", "small_angle_sine", "small_angle"]


class ElementRule(Protocol):
    """How the curvatures of an element make its strain; `Grid.rule` takes any such object.

    A rule turns the curvatures K_i at its points into moments M_k = h Σ_i W_ki K_i, and the element
    length h and its moments into one strain ξ = (θ, v), the 6-vector whose exponential is the
    element. Moments are linear in the curvature, so a basis enters an element through its moments
    alone. The object is hashed: it must not change.

    Attributes
    ----------
    points : tuple of float
        Stations within the element, in [0, 1].
    weights : tuple of tuple of float
        W, a row per moment, a column per point.
    order : int
        Of the error of a pose, over the element length.
    """

    @property
    def points(self) -> tuple[float, ...]: ...

    @property
    def weights(self) -> tuple[tuple[float, ...], ...]: ...

    @property
    def order(self) -> int: ...

    def __hash__(self) -> int: ...

    def strain(self, h: ca.SX, moments: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Strain of an element.

        Parameters
        ----------
        h : SX, shape (1, 1)
            Element length, m.
        moments : SX, shape (3, m)
            Moments of the curvature, rad, one per row of `weights`.

        Returns
        -------
        theta : SX, shape (3, 1)
            Rotation vector of the element, rad, local axes of its start.
        v : SX, shape (3, 1)
            Translation part of the strain, m; h e_x where the element is straight.
        """
        ...


@dataclass(frozen=True, eq=False, kw_only=True)
class Grid:
    """Elements along xi = s/L, the rule within an element and its exponential.

    Make one by `Grid.uniform(n)`, `Grid.lobatto(n)` or `Grid(boundaries=[...])`.

    Attributes
    ----------
    boundaries : array or None, shape (N + 1,)
        Stations s/L of a custom grid, increasing from 0 to 1.
    kind : {"uniform", "lobatto", "custom"}
        How the boundaries are placed.
    elements : int or None
        Number of elements of the beam; None of a custom grid.
    rule : {"magnus4", "magnus6", "trapezoid", "midpoint"} or ElementRule
        How the curvatures of an element become its strain, of order 4, 6, 2 and 2; or a rule of
        your own.
    exponential : {"series", "rodrigues", "small_angle_sine", "small_angle"}
        Exact by default; the others are the paper's.
    max_angle : float
        Largest angle that one element may turn, rad.
    real : {"double", "float"}
        Arithmetic that the polynomials of an element are made for.
    """

    boundaries: Array | None = None
    kind: GridKind = "custom"
    elements: int | None = None
    rule: RuleName | ElementRule = "magnus4"
    exponential: ExponentialName = "series"
    max_angle: float = 1.0
    real: Real = "double"

    def __post_init__(self) -> None:
        choice("Grid.kind", self.kind, ("uniform", "lobatto", "custom"))
        _check_rule(self.rule)
        choice("Grid.exponential", self.exponential, get_args(ExponentialName))
        choice("Grid.real", self.real, ("double", "float"))
        if not 0 < float(numbers("Grid.max_angle", self.max_angle)) <= np.pi:
            raise ValueError(
                f"Grid.max_angle: expected an angle in (0, π] rad, found {self.max_angle}"
            )
        unused = "elements" if self.kind == "custom" else "boundaries"
        if getattr(self, unused) is not None:
            raise ValueError(
                f"Grid.{unused}: expected None for kind {self.kind!r}, "
                f"found {getattr(self, unused)!r}"
            )
        if self.kind != "custom":
            count("Grid.elements", cast(int, self.elements))
            return
        boundaries = np.unique(increasing_stations("Grid.boundaries", self.boundaries))
        boundaries.setflags(write=False)
        object.__setattr__(self, "boundaries", boundaries)

    @classmethod
    def uniform(
        cls,
        n: int,
        *,
        rule: RuleName | ElementRule = "magnus4",
        exponential: ExponentialName = "series",
        max_angle: float = 1.0,
        real: Real = "double",
    ) -> Grid:
        """`n` elements of equal length; with breaks, equal between two breaks.

        Parameters
        ----------
        n : int
            Number of elements of the beam.
        rule, exponential, max_angle, real : optional
            Fields of `Grid`.

        Returns
        -------
        Grid
            Of the kind "uniform".
        """
        return cls(
            kind="uniform",
            elements=n,
            rule=rule,
            exponential=exponential,
            max_angle=max_angle,
            real=real,
        )

    @classmethod
    def lobatto(
        cls,
        n: int,
        *,
        rule: RuleName | ElementRule = "magnus4",
        exponential: ExponentialName = "series",
        max_angle: float = 1.0,
        real: Real = "double",
    ) -> Grid:
        """`n` elements between Gauss–Lobatto points, a set of points between two breaks.

        Parameters
        ----------
        n : int
            Number of elements of the beam.
        rule, exponential, max_angle, real : optional
            Fields of `Grid`.

        Returns
        -------
        Grid
            Of the kind "lobatto".
        """
        return replace(
            cls.uniform(n, rule=rule, exponential=exponential, max_angle=max_angle, real=real),
            kind="lobatto",
        )

    def __str__(self) -> str:
        elements = f"{self.elements} {self.kind} elements"
        if self.kind == "custom":
            elements = f"custom boundaries {shown(self.boundaries)}"
        rule = self.rule if isinstance(self.rule, str) else repr(self.rule)
        turn = f"to {self.max_angle:.4g} rad an element"
        return f"{elements}, {rule} rule, {self.exponential} exponential {turn}, {self.real}"

    @property
    def degree(self) -> int:
        """Degree in θ² of the polynomials of an element's exponential."""
        return degree_for(self.max_angle, self.real)

    def stations(self, breaks: tuple[float, ...] = ()) -> Array:
        """Element boundaries of a beam whose smoothness ends at `breaks`.

        Every break is a boundary. A uniform or Lobatto grid shares its elements among the panels
        between breaks by their length, at least one each; a custom grid gains the breaks.

        Parameters
        ----------
        breaks : tuple of float
            Interior stations, increasing.

        Returns
        -------
        ndarray, shape (N + 1,)
            Stations s/L from 0 to 1.
        """
        return self._stations(breaks, 1)

    def panels(self, breaks: tuple[float, ...] = ()) -> tuple[Panel, ...]:
        """Quadrature between the breaks, on `stations(breaks)`.

        See `quadrature.panels_between` for the weights.

        Parameters
        ----------
        breaks : tuple of float
            Interior stations, increasing.

        Returns
        -------
        tuple of Panel
            Stations and weights of every panel.
        """
        return panels_between(self.kind, self.stations(breaks), breaks)

    def quadrature(self, breaks: tuple[float, ...] = ()) -> tuple[Array, tuple[Panel, ...]]:
        """Stations and panels that integrate along the span as exactly as the poses are known.

        Panels of many elements keep their stations. Few elements, or uneven ones, do not integrate
        what varies along them: a Lobatto grid then has three elements a panel, and the elements of
        other grids are divided (`quadrature.divided_panels`).

        Parameters
        ----------
        breaks : tuple of float
            Interior stations, increasing.

        Returns
        -------
        stations : ndarray, shape (N + 1,)
            Stations s/L from 0 to 1.
        panels : tuple of Panel
            Stations and weights of every panel.
        """
        if self.kind == "lobatto":
            stations = self._stations(breaks, LEAST_ELEMENTS)
            return stations, panels_between(self.kind, stations, breaks)
        return divided_panels(self.stations(breaks), breaks)

    def _stations(self, breaks: tuple[float, ...], least: int) -> Array:
        """Element boundaries with at least `least` elements a panel; custom ones as they are."""
        panels = np.array([0.0, *breaks, 1.0])
        if self.kind == "custom":
            return _merge(cast(Array, self.boundaries), panels)
        points = _uniform_points if self.kind == "uniform" else lobatto_points
        pieces = [
            left + (right - left) * points(n)[:-1]
            for left, right, n in zip(
                panels[:-1],
                panels[1:],
                shares(cast(int, self.elements), np.diff(panels), least),
                strict=True,
            )
        ]
        return np.concatenate([*pieces, [1.0]])


def _check_rule(rule: RuleName | ElementRule) -> None:
    if isinstance(rule, str) or not hasattr(rule, "strain"):
        choice("Grid.rule", rule, get_args(RuleName))
        return
    points, weights = numbers("Grid.rule.points", rule.points), rule.weights
    if points.ndim != 1 or not len(points) or points.min() < 0 or points.max() > 1:
        raise ValueError(f"Grid.rule.points: expected numbers in [0, 1], found {points.tolist()}")
    if numbers("Grid.rule.weights", weights).shape != (len(weights), len(points)):
        raise ValueError(
            f"Grid.rule.weights: expected {len(points)} numbers a row, one per point, "
            f"found {weights!r}"
        )
    count("Grid.rule.order", rule.order)


def _uniform_points(n: int) -> Array:
    return np.linspace(0.0, 1.0, n + 1)


def shares(total: int, lengths: Array, least: int) -> list[int]:
    """Whole numbers from `least`, proportional to `lengths`, that sum to `total` if they can."""
    shares = np.full(len(lengths), least)
    while shares.sum() < total:
        shares[np.argmax(lengths / shares)] += 1
    return [int(share) for share in shares]


def _merge(points: Array, panels: Array) -> Array:
    """The ends and breaks `panels`, and the `points` that are none of them, sorted."""
    distances = np.min(np.abs(points[:, None] - panels), axis=1)
    return np.asarray(np.sort(np.concatenate([panels, points[distances > COINCIDENT]])))
