"""What changes the lift of strips: control surfaces, and the loss at a tip."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from curvcasadi.symbolic.expressions import (
    COINCIDENT,
    Number,
    expression,
    own_fields,
    positive,
    station,
)


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
