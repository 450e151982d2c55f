"""Division of a beam into elements, and how an element is integrated."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal, cast

import numpy as np

from curvcasadi.beam.quadrature import GridKind, Panel, lobatto_points, panels_between
from curvcasadi.lie.series import degree_for
from curvcasadi.symbolic.expressions import Array, Real, choice, count, numbers

RuleName = Literal["trapezoid", "midpoint", "magnus4", "magnus6"]
ExponentialName = Literal["series", "rodrigues", "small_angle_sine", "small_angle"]
RULES = ("trapezoid", "midpoint", "magnus4", "magnus6")
EXPONENTIALS = ("series", "rodrigues", "small_angle_sine", "small_angle")

#: Stations closer than this are one station.
COINCIDENT = 1e-12


@dataclass(frozen=True, eq=False, kw_only=True)
class Grid:
    """Elements along xi = s/L, the rule within an element and its exponential.

    Make one by `Grid.uniform(n)`, `Grid.lobatto(n)` or `Grid(boundaries=[...])`.
    """

    boundaries: Array | None = None  #: (N + 1,) increasing from 0 to 1, for a custom grid
    kind: GridKind = "custom"
    elements: int | None = None  #: number of elements of the beam; of a custom grid None
    rule: RuleName = "magnus4"  #: curvatures of an element to its strain; orders 2, 2, 4, 6
    exponential: ExponentialName = "series"  #: exact by default; the others are the paper's
    max_angle: float = 1.0  #: largest angle that one element may turn, rad
    real: Real = "double"  #: arithmetic that the polynomials are made for

    def __post_init__(self) -> None:
        choice("Grid.kind", self.kind, ("uniform", "lobatto", "custom"))
        choice("Grid.rule", self.rule, RULES)
        choice("Grid.exponential", self.exponential, EXPONENTIALS)
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
        boundaries = numbers("Grid.boundaries", self.boundaries)
        if boundaries.ndim != 1 or len(boundaries) < 2 or not np.all(np.diff(boundaries) > 0):
            raise ValueError(
                "Grid.boundaries: expected at least two numbers, each above the one before; "
                f"found {boundaries.tolist()}"
            )
        if boundaries[0] != 0 or boundaries[-1] != 1:
            raise ValueError(
                "Grid.boundaries: expected the first to be 0 and the last 1, "
                f"found {boundaries[0]} and {boundaries[-1]}"
            )
        boundaries.setflags(write=False)
        object.__setattr__(self, "boundaries", boundaries)

    @classmethod
    def uniform(
        cls,
        n: int,
        *,
        rule: RuleName = "magnus4",
        exponential: ExponentialName = "series",
        max_angle: float = 1.0,
        real: Real = "double",
    ) -> Grid:
        """`n` elements of equal length; with breaks, equal between two breaks."""
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
        rule: RuleName = "magnus4",
        exponential: ExponentialName = "series",
        max_angle: float = 1.0,
        real: Real = "double",
    ) -> Grid:
        """`n` elements between Gauss–Lobatto points, a set of points between two breaks."""
        return replace(
            cls.uniform(n, rule=rule, exponential=exponential, max_angle=max_angle, real=real),
            kind="lobatto",
        )

    @property
    def degree(self) -> int:
        """Degree in θ² of the polynomials of an element's exponential."""
        return degree_for(self.max_angle, self.real)

    def stations(self, breaks: tuple[float, ...] = (), least: int = 1) -> Array:
        """Element boundaries (N + 1,) of a beam whose smoothness ends at `breaks`.

        Every break is a boundary. A uniform or Lobatto grid shares its elements among the panels
        between breaks by their length, at least `least` each; a custom grid gains the breaks.
        """
        panels = np.array([0.0, *breaks, 1.0])
        if self.kind == "custom":
            return _merge(cast(Array, self.boundaries), panels)
        points = _uniform_points if self.kind == "uniform" else lobatto_points
        pieces = [
            left + (right - left) * points(n)[:-1]
            for left, right, n in zip(
                panels[:-1],
                panels[1:],
                _shares(cast(int, self.elements), np.diff(panels), least),
                strict=True,
            )
        ]
        return np.concatenate([*pieces, [1.0]])

    def panels(self, breaks: tuple[float, ...] = (), least: int = 1) -> tuple[Panel, ...]:
        """Quadrature between the breaks, on `stations(breaks, least)`.

        See `quadrature.panels_between` for the weights.
        """
        return panels_between(self.kind, self.stations(breaks, least), breaks)


def _uniform_points(n: int) -> Array:
    return np.linspace(0.0, 1.0, n + 1)


def _shares(total: int, lengths: Array, least: int) -> list[int]:
    """Whole numbers from `least`, proportional to `lengths`, that sum to `total` if they can."""
    shares = np.full(len(lengths), least)
    while shares.sum() < total:
        shares[np.argmax(lengths / shares)] += 1
    return [int(share) for share in shares]


def _merge(points: Array, panels: Array) -> Array:
    """The ends and breaks `panels`, and the `points` that are none of them, sorted."""
    distances = np.min(np.abs(points[:, None] - panels), axis=1)
    return np.asarray(np.sort(np.concatenate([panels, points[distances > COINCIDENT]])))
