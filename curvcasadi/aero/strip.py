"""Airfoil data along the span of a wing, and its control surfaces."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.polynomial import legendre

from curvcasadi.aero.section import SectionData
from curvcasadi.beam.along import Along, Check, breaks_of, scalar
from curvcasadi.beam.grid import shares
from curvcasadi.symbolic.expressions import (
    COINCIDENT,
    AnyExpr,
    Number,
    choice,
    count,
    expression,
    is_numeric,
    own_fields,
    positive,
    station,
)
from curvcasadi.symbolic.plausible import sizes, warn_of_size

#: Lift slopes, 1/rad, and angles of zero lift, rad, beyond which a warning names the unit.
SMALLEST_SLOPE, LARGEST_SLOPE, LARGEST_ANGLE = 0.5, 20.0, 0.5


@dataclass(frozen=True, eq=False, kw_only=True)
class ControlSurface:
    """Increments of the coefficients between two stations, per angle of deflection.

    Attributes
    ----------
    name : str
        Name of the input that deflects it, rad.
    lift : float or symbol
        Increment of the lift coefficient, 1/rad.
    moment : float or symbol
        Increment of the moment coefficient, nose-up positive, 1/rad.
    drag : float or symbol
        Increment of the drag coefficient, 1/rad.
    start : float
        Station s/L at which it begins.
    end : float
        Station s/L at which it ends.
    antisymmetric : bool
        Whether it deflects the other way on a mirrored wing, as ailerons do.
    """

    name: str
    lift: Number
    moment: Number = 0.0
    drag: Number = 0.0
    start: float = 0.0
    end: float = 1.0
    antisymmetric: bool = False

    def __post_init__(self) -> None:
        own_fields(self)
        for name in ("lift", "moment", "drag"):
            expression(f"ControlSurface.{name}", getattr(self, name), (1, 1))
        for name in ("start", "end"):
            object.__setattr__(self, name, station(f"ControlSurface.{name}", getattr(self, name)))
        if self.end - self.start <= COINCIDENT:
            raise ValueError(
                f"ControlSurface.end: expected above start = {self.start}, found {self.end}"
            )


@dataclass(frozen=True, eq=False, kw_only=True)
class ExponentialTipLoss:
    """Factor 1 − exp(−decay (1 − xi)) on the lift coefficient; it vanishes at the tip.

    Attributes
    ----------
    decay : float or symbol
        Lift is 63 % of the strip's at a fraction 1/decay of the length from the tip.
    """

    decay: Number

    def __post_init__(self) -> None:
        positive("ExponentialTipLoss.decay", self.decay)

    def __call__(self, xi: float) -> Number:
        return 1 - ca.exp(-self.decay * (1 - xi))


@dataclass(frozen=True, eq=False, kw_only=True)
class StripAerodynamics:
    """Airfoil data of the strips of a wing.

    With the angle of attack α at a station and deflections δ the coefficients are

        c_l = factor (lift_slope (α − zero_lift_angle) + Σ lift δ)
        c_d = profile_drag + Σ drag δ
        c_m = moment_coefficient + moment_slope α_0 + Σ moment δ

    with α_0 = c_l/(factor lift_slope), the angle from that of zero lift. Airloads are integrated at
    `stations` Gauss points between the breaks of the data, whatever elements the beam has.

    A quantity is a number, a CasADi symbol, or a function of xi = s/L that returns one; a function
    with jumps has `breaks`, as `Steps` has.

    Attributes
    ----------
    chord : float, symbol or callable
        Chord, m.
    aerodynamic_center : float, symbol or callable
        Distance of the aerodynamic centre ahead of the reference curve (along local y), m.
    lift_slope : float, symbol or callable
        Slope of the lift coefficient, 1/rad; 2 π of a thin airfoil.
    zero_lift_angle : float, symbol or callable
        Angle of attack without lift, rad; below zero for positive camber.
    profile_drag : float, symbol or callable
        Drag coefficient of the profile, not below zero.
    moment_coefficient : float, symbol or callable
        Moment coefficient about the aerodynamic centre, nose-up positive.
    controls : tuple of ControlSurface
        Control surfaces.
    moment_slope : float, symbol or callable
        Slope of the moment coefficient about the aerodynamic centre, nose-up positive, 1/rad.
    suction : float, symbol or callable
        Part of the leading-edge suction that is there, from 0 to 1: with 1 lift stands normal to
        the flow, with 0 normal to the chord.
    stations : int
        Number of aerodynamic stations; more where breaks leave more intervals.
    upper_side : {1, -1} or None
        1 where local z points out of the upper side (right wing), -1 where out of the lower one.
        None: of a wing or a surface of an aircraft as the attitude of its root says, whose body z
        axis points down; of a load on a beam alone 1.
    tip_loss : ExponentialTipLoss or None
        Factor on the lift coefficient.
    """

    chord: Number
    aerodynamic_center: Number
    lift_slope: Number
    zero_lift_angle: Number = 0.0
    profile_drag: Number = 0.0
    moment_coefficient: Number = 0.0
    controls: tuple[ControlSurface, ...] = ()
    moment_slope: Number = 0.0
    suction: Number = 1.0
    stations: int = 6
    upper_side: int | None = None
    tip_loss: ExponentialTipLoss | None = None
    _quantities: dict[str, Along] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        own_fields(self)
        if self.upper_side is not None:
            choice("StripAerodynamics.upper_side", self.upper_side, (1, -1))
        count("StripAerodynamics.stations", self.stations)
        object.__setattr__(self, "controls", tuple(self.controls))
        quantities = {
            name: Along(f"StripAerodynamics.{name}", getattr(self, name), check)
            for name, check in QUANTITIES.items()
        }
        object.__setattr__(self, "_quantities", quantities)
        _warn_of_units(self)
        for surface in self.controls:
            if not isinstance(surface, ControlSurface):
                raise ValueError(
                    f"StripAerodynamics.controls: expected ControlSurfaces, found {surface!r}"
                )

    @property
    def breaks(self) -> tuple[float, ...]:
        """Interior stations at which a quantity jumps or a control surface ends."""
        ends = {float(x) for surface in self.controls for x in (surface.start, surface.end)}
        points = ends.union(breaks_of(self.tip_loss, *self._quantities.values()))
        return tuple(sorted(x for x in points if 0 < x < 1))

    def at(self, name: str, xi: float) -> AnyExpr:
        """A quantity of the airfoil data at a station.

        Parameters
        ----------
        name : str
            Name of a field such as "chord".
        xi : float
            Station s/L in [0, 1].

        Returns
        -------
        SX, MX or DM, shape (1, 1)
            Its value.
        """
        return self._quantities[name](xi)

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the deflections, each once."""
        return tuple(dict.fromkeys(surface.name for surface in self.controls))

    @property
    def side(self) -> int:
        """`upper_side` of a load on a beam alone."""
        return 1 if self.upper_side is None else self.upper_side


def _warn_of_units(strips: StripAerodynamics) -> None:
    """Warn of a lift slope or an angle that look like those of degrees."""
    slopes = sizes(strips.lift_slope)
    unlikely = slopes[((slopes != 0) & (slopes < SMALLEST_SLOPE)) | (slopes > LARGEST_SLOPE)]
    if unlikely.size:
        warnings.warn(
            f"StripAerodynamics.lift_slope: {unlikely[0]:g} 1/rad is implausible; a thin airfoil "
            "has 2 pi = 6.28 1/rad, which is 0.11 per degree",
            UserWarning,
            stacklevel=4,
        )
    chords = sizes(strips.chord)
    if chords.size:
        warn_of_size(
            "StripAerodynamics.aerodynamic_center",
            strips.aerodynamic_center,
            float(np.max(chords)),
            "m",
            "it is more than the chord away from the reference curve",
        )
    advice = "degrees are np.deg2rad(...)"
    warn_of_size(
        "StripAerodynamics.zero_lift_angle", strips.zero_lift_angle, LARGEST_ANGLE, "rad", advice
    )


def _not_negative(name: str, value: Number) -> AnyExpr:
    return ca.DM(positive(name, value, zero=True)) if is_numeric(value) else scalar(name, value)


def _share(name: str, value: Number) -> AnyExpr:
    share = scalar(name, value)
    if is_numeric(share) and not 0 <= float(share) <= 1:
        raise ValueError(f"{name}: expected a number from 0 to 1, found {float(share):g}")
    return share


#: Fields of `StripAerodynamics` that may vary along the span, and what they must fulfil.
QUANTITIES: dict[str, Check] = {
    "chord": positive,
    "aerodynamic_center": scalar,
    "lift_slope": scalar,
    "zero_lift_angle": scalar,
    "profile_drag": _not_negative,
    "moment_coefficient": scalar,
    "moment_slope": scalar,
    "suction": _share,
}


def mirror_aero(strips: StripAerodynamics) -> StripAerodynamics:
    """Airfoil data of the other half wing, for the beam `mirror(beam)`.

    Local z of a mirrored beam points out of the other side of the airfoil; x and y, and with them
    chord and aerodynamic centre, are mirror images. Antisymmetric surfaces deflect the other way.

    Parameters
    ----------
    strips : StripAerodynamics
        Airfoil data of one half wing, with their upper side.

    Returns
    -------
    StripAerodynamics
        Airfoil data of the other one.

    Raises
    ------
    ValueError
        If `upper_side` is None. `mirror_wing` needs none: a wing knows its root.
    """
    if strips.upper_side is None:
        raise ValueError(
            "StripAerodynamics.upper_side: expected 1 or -1 of what is mirrored without its wing, "
            "found None; mirror_wing knows the root"
        )
    controls = tuple(
        replace(c, lift=-c.lift, moment=-c.moment, drag=-c.drag) if c.antisymmetric else c
        for c in strips.controls
    )
    return replace(strips, upper_side=-strips.upper_side, controls=controls)


#: Vertical part of local z below which a root stands upright.
_UPRIGHT = 1e-6


def with_upper_side(owner: str, strips: StripAerodynamics, rotation: AnyExpr) -> StripAerodynamics:
    """Airfoil data that know the upper side: as given, or that of the root's local z.

    Parameters
    ----------
    owner : str
        What has the data, for errors.
    strips : StripAerodynamics
        Airfoil data.
    rotation : SX, MX or DM, shape (3, 3)
        Of the root, local to body axes; body z points down.

    Raises
    ------
    ValueError
        If the rotation does not tell the upper side: of an upright root and of a symbol.
    """
    if strips.upper_side is not None:
        return strips
    down = rotation[2, 2]
    if not is_numeric(down) or abs(float(down)) < _UPRIGHT:
        found = "upright" if is_numeric(down) else "a symbol"
        raise ValueError(
            f"StripAerodynamics.upper_side of {owner}: expected 1 (local z points out of the upper "
            f"side) or -1 (out of the lower side) where the root does not tell; found None, and "
            f"its root is {found}"
        )
    return replace(strips, upper_side=1 if float(down) < 0 else -1)


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
