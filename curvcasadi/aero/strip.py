"""Airfoil data along the span of a wing, and its control surfaces."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, field

import casadi as ca
import numpy as np

from curvcasadi.aero.surfaces import ControlSurface, ExponentialTipLoss
from curvcasadi.beam.along import Along, Check, breaks_of, scalar
from curvcasadi.symbolic.expressions import (
    AnyExpr,
    Number,
    choice,
    count,
    is_numeric,
    own_fields,
    positive,
)
from curvcasadi.symbolic.plausible import sizes, warn_of_size

#: Lift slopes, 1/rad, and angles of zero lift, rad, beyond which a warning names the unit.
SMALLEST_SLOPE, LARGEST_SLOPE, LARGEST_ANGLE = 0.5, 20.0, 0.5


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
