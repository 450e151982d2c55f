"""The planform of a half wing: outline, area, span and aspect ratio."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.polynomial import legendre

from curvcasadi.aero.strip import StripAerodynamics
from curvcasadi.beam.beam import Beam, merged_breaks, numeric_length
from curvcasadi.kinematics.shape import poses
from curvcasadi.symbolic.expressions import Array, instance, is_numeric

#: Gauss points between two breaks: exact for chords of degree 7.
_POINTS = 8


@dataclass(frozen=True, eq=False, kw_only=True)
class Planform:
    """The planform of an unloaded half wing.

    Attributes
    ----------
    xi : array, shape (N,)
        Stations s/L of the outline.
    leading, trailing : array, shape (3, N)
        Leading and trailing edge, m, parent axes (of a wing of an aircraft: body axes).
    reference : array, shape (3, N)
        Reference curve, m, parent axes.
    quarter_chord : array, shape (3, N)
        Line of aerodynamic centres, m, parent axes.
    area : float
        Of the half wing, ∫ chord ds, m².
    span : float
        From root to tip, normal to the plane of symmetry (the parent's y axis), m.
    mean_aerodynamic_chord : float
        ∫ chord² ds / area, m.
    """

    xi: Array
    leading: Array
    trailing: Array
    reference: Array
    quarter_chord: Array
    area: float
    span: float
    mean_aerodynamic_chord: float

    @property
    def aspect_ratio(self) -> float:
        """Of both half wings, (2 span)²/(2 area)."""
        return 2 * self.span**2 / self.area

    def __str__(self) -> str:
        return (
            f"half wing: area {self.area:.4g} m², span {self.span:.4g} m, aspect ratio of both "
            f"{self.aspect_ratio:.4g}, mean aerodynamic chord {self.mean_aerodynamic_chord:.4g} m"
        )


def planform(beam: Beam, strips: StripAerodynamics, stations: int = 41) -> Planform:
    """The planform of a half wing, with its aerodynamic centre at a quarter of its chord.

    Parameters
    ----------
    beam : Beam
        Its unloaded reference curve carries the chord, along local y.
    strips : StripAerodynamics
        Chord and aerodynamic centre along the span, numbers.
    stations : int
        Stations of the outline, to which both sides of every break are added.

    Returns
    -------
    Planform
        Outline, area, span and chords.

    Raises
    ------
    ValueError
        If length, root or chord hold symbols.
    """
    instance("beam", beam, Beam)
    instance("strips", strips, StripAerodynamics)
    length = numeric_length(beam, "planform")
    breaks = merged_breaks([*beam.breaks, *strips.breaks])
    # Both limits at a break, where a chord may jump.
    sides = [np.nextafter(x, end) for x in breaks for end in (0.0, 1.0)]
    xi = np.unique([*np.linspace(0, 1, stations), *sides])
    ahead, behind = edges(strips, xi)
    frames = poses(beam, np.zeros(beam.basis.n), xi.tolist())
    curve = np.hstack([np.asarray(frame.position) for frame in frames])
    forward = np.hstack([np.asarray(frame.rotation[:, 1]) for frame in frames])
    area = length * _integral(lambda x: _number("chord", strips, x), breaks)
    square = length * _integral(lambda x: _number("chord", strips, x) ** 2, breaks)
    return Planform(
        xi=xi,
        leading=curve + forward * ahead,
        trailing=curve + forward * behind,
        reference=curve,
        quarter_chord=curve + forward * (0.75 * ahead + 0.25 * behind),
        area=area,
        span=float(abs(curve[1, -1] - curve[1, 0])),
        mean_aerodynamic_chord=square / area,
    )


def edges(strips: StripAerodynamics, xi: Sequence[float] | Array) -> tuple[Array, Array]:
    """Leading and trailing edge at stations, (M,), m along local y from the reference curve."""
    chord, center = (
        np.array([_number(name, strips, x) for x in xi]) for name in ("chord", "aerodynamic_center")
    )
    return center + chord / 4, center - 3 * chord / 4


def _number(name: str, strips: StripAerodynamics, xi: float) -> float:
    value = strips.at(name, xi)
    if not is_numeric(value):
        raise ValueError(f"StripAerodynamics.{name}: planform needs numbers, found {value}")
    return float(value)


def _integral(quantity: Callable[[float], float], breaks: Sequence[float]) -> float:
    """∫ over [0, 1] by Gauss points between the breaks."""
    points, weights = legendre.leggauss(_POINTS)
    return float(
        sum(
            (right - left) / 2 * weight * quantity(left + (right - left) * (point + 1) / 2)
            for left, right in pairwise([0.0, *breaks, 1.0])
            for point, weight in zip(points, weights, strict=True)
        )
    )
