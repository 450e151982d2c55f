"""Airfoil data along the span of a wing, and its control surfaces."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import casadi as ca

from curvcasadi.beam.along import Along, Check, breaks_of, scalar
from curvcasadi.symbolic.expressions import (
    COINCIDENT,
    AnyExpr,
    Number,
    choice,
    expression,
    own_fields,
    positive,
    station,
)


@dataclass(frozen=True, eq=False, kw_only=True)
class ControlSurface:
    """Increments of the coefficients between two stations, per angle of deflection."""

    name: str  #: of the input that deflects it, rad
    lift: Number  #: increment of the lift coefficient, 1/rad
    moment: Number = 0.0  #: of the moment coefficient, nose-up positive, 1/rad
    drag: Number = 0.0  #: of the drag coefficient, 1/rad
    start: float = 0.0  #: station s/L
    end: float = 1.0  #: station s/L
    antisymmetric: bool = False  #: deflects the other way on a mirrored wing, as ailerons do

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
    """Factor 1 − exp(−decay (1 − xi)) on the lift coefficient; it vanishes at the tip."""

    decay: Number  #: lift is 63 % of the strip's at a fraction 1/decay of the length from the tip

    def __post_init__(self) -> None:
        positive("ExponentialTipLoss.decay", self.decay)

    def __call__(self, xi: float) -> Number:
        return 1 - ca.exp(-self.decay * (1 - xi))


@dataclass(frozen=True, eq=False, kw_only=True)
class StripAerodynamics:
    """Airfoil data of the strips of a wing.

    With the angle of attack α at a station and deflections δ the coefficients are

        c_l = factor (lift_slope (α − zero_lift_angle) + Σ lift δ)
        c_d = profile_drag + Σ drag δ,      c_m = moment_coefficient + Σ moment δ

    A quantity is a number, a CasADi symbol, or a function of xi = s/L that returns one; a function
    with jumps has `breaks`, as `Steps` has.
    """

    chord: Number  #: m
    aerodynamic_center: Number  #: distance ahead of the reference curve (along local y), m
    lift_slope: Number  #: 1/rad; 2 π of a thin airfoil
    zero_lift_angle: Number = 0.0  #: α without lift, rad; below zero for positive camber
    profile_drag: Number = 0.0
    moment_coefficient: Number = 0.0  #: about the aerodynamic centre, nose-up positive
    controls: tuple[ControlSurface, ...] = ()
    upper_side: int = 1  #: +1: local z points out of the upper side (right wing), −1: the lower
    tip_loss: ExponentialTipLoss | None = None
    _quantities: dict[str, Along] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        own_fields(self)
        choice("StripAerodynamics.upper_side", self.upper_side, (1, -1))
        object.__setattr__(self, "controls", tuple(self.controls))
        quantities = {
            name: Along(f"StripAerodynamics.{name}", getattr(self, name), check)
            for name, check in QUANTITIES.items()
        }
        object.__setattr__(self, "_quantities", quantities)
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
        """One of `QUANTITIES` at a station."""
        return self._quantities[name](xi)

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the deflections, each once."""
        return tuple(dict.fromkeys(surface.name for surface in self.controls))


#: Fields of `StripAerodynamics` that may vary along the span, and what they must fulfil.
QUANTITIES: dict[str, Check] = {
    "chord": positive,
    "aerodynamic_center": scalar,
    "lift_slope": scalar,
    "zero_lift_angle": scalar,
    "profile_drag": scalar,
    "moment_coefficient": scalar,
}


def mirror_aero(strips: StripAerodynamics) -> StripAerodynamics:
    """Airfoil data of the other half wing, for the beam `mirror(beam)`.

    Local z of a mirrored beam points out of the other side of the airfoil; x and y, and with them
    chord and aerodynamic centre, are mirror images. Antisymmetric surfaces deflect the other way.
    """
    controls = tuple(
        replace(c, lift=-c.lift, moment=-c.moment, drag=-c.drag) if c.antisymmetric else c
        for c in strips.controls
    )
    return replace(strips, upper_side=-strips.upper_side, controls=controls)


def coefficients(
    strips: StripAerodynamics, xi: float, deflections: Mapping[str, Number]
) -> AnyExpr:
    """Chord, aerodynamic centre, c_l per α, c_l at α = 0, c_d, c_m at a station: (6, 1)."""
    chord, center, slope, zero_lift, drag, moment = (strips.at(name, xi) for name in QUANTITIES)
    lift = -slope * zero_lift
    for surface in strips.controls:
        if surface.start <= xi <= surface.end:
            angle = deflections.get(surface.name, 0.0)
            lift = lift + surface.lift * angle
            drag = drag + surface.drag * angle
            moment = moment + surface.moment * angle
    factor = 1.0 if strips.tip_loss is None else strips.tip_loss(xi)
    return ca.vertcat(chord, center, factor * slope, factor * lift, drag, moment)
