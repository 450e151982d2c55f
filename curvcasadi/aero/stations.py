"""The stations at which airloads are integrated, and the data of the strips there."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.polynomial import legendre

from curvcasadi.aero.section import SectionData
from curvcasadi.aero.strip import QUANTITIES, StripAerodynamics
from curvcasadi.beam.grid import shares
from curvcasadi.symbolic.expressions import Number, is_numeric


class AirStation(NamedTuple):
    """A station at which airloads are integrated."""

    xi: float  #: s/L
    weight: float  #: part of the length that it stands for


def air_stations(strips: StripAerodynamics) -> tuple[AirStation, ...]:
    """Gauss points between the breaks of the airfoil data, shared out by length.

    Lift vanishes at a tip like the square root of the distance to it. Three points or more of the
    outermost interval therefore are those of Gauss in √(1 − ξ), of which it is a smooth function.
    """
    ends = np.array([0.0, *strips.breaks, 1.0])
    found = []
    for left, right, n in zip(
        ends[:-1], ends[1:], shares(strips.stations, np.diff(ends), 1), strict=True
    ):
        nodes, weights = legendre.leggauss(n)
        part, weights = (1 + nodes) / 2, weights / 2
        if right == 1 and n >= 3:
            part, weights = 1 - (1 - part) ** 2, 2 * weights * (1 - part)
        for x, w in zip(left + (right - left) * part, weights * (right - left), strict=True):
            found.append(AirStation(float(x), float(w)))
    return tuple(found)


def section_data(
    strips: StripAerodynamics,
    xi: float,
    deflections: Mapping[str, Number],
    *,
    density: Number,
    measure: Number,
    apparent: float = 0.0,
) -> SectionData:
    """What the forces of a strip at `xi` take, in the order of `SectionData`.

    Parameters
    ----------
    strips : StripAerodynamics
        Airfoil data of the wing.
    xi : float
        Station s/L.
    deflections : mapping of str to number or symbol
        Of the control surfaces, rad; others are zero.
    density : number or symbol
        Of the air, kg/m³.
    measure : number or symbol
        Span of the strip, m.
    apparent : float
        Part of the apparent mass that is there.
    """
    at = {name: strips.at(name, xi) for name in QUANTITIES}
    slope, lift = at["lift_slope"], 0.0
    drag, moment = at["profile_drag"], at["moment_coefficient"]
    for surface in strips.controls:
        if surface.start <= xi <= surface.end:
            angle = deflections.get(surface.name, 0.0)
            lift = lift + surface.lift * angle
            drag = drag + surface.drag * angle
            moment = moment + surface.moment * angle
    if is_numeric(slope) and float(slope) == 0:
        if not is_numeric(lift) or float(lift):
            raise ValueError(
                f"StripAerodynamics.lift_slope at xi = {xi:g}: expected a number above zero where "
                "a control surface makes lift, found 0"
            )
        slope = 1.0
    factor = 1.0 if strips.tip_loss is None else strips.tip_loss(xi)
    return SectionData(
        upper=strips.side,
        pressure=density * at["chord"] * measure / 2,
        chord=at["chord"],
        center=at["aerodynamic_center"],
        slope=factor * at["lift_slope"],
        shift=lift / slope - at["zero_lift_angle"],
        drag=drag,
        moment=moment,
        moment_slope=at["moment_slope"],
        suction=at["suction"],
        apparent=apparent,
    )
