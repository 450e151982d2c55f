"""Gauges that read the curvature of the wing at their station."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import casadi as ca

from curvcasadi.sensors.sensor import CurvatureSensor
from curvcasadi.symbolic.expressions import AnyExpr, Number


@dataclass(frozen=True, eq=False, kw_only=True)
class StrainGauge(CurvatureSensor):
    """Axial strain at a point (y, z) of the section: ε = κ_y z − κ_z y with κ = K − K_0.

    A gauge that is bonded to the unloaded wing reads zero there, pre-curved or not, and what it
    measures is the strain that the strain energy counts. With `reference="straight"` it reads zero
    on a straight wing, as a shape-sensing fibre that was calibrated before it was bonded: κ = K.

    Attributes
    ----------
    xi : float
        Station s/L in [0, 1].
    name : str or None
        Name of the sensor; its kind and number where None.
    offset : array or symbol, shape (2,)
        Place (y, z) in the section, m, local axes.
    noise : float
        Standard deviation of one sample, m/m.
    bias : float, symbol or None
        Bias, m/m; zero where None.
    reference : {"unloaded", "straight"}
        Shape at which it reads zero: the unloaded beam, so that it measures K − K_0, or a straight
        one.
    """

    offset: Number
    noise: Number
    bias: Number = None

    prefix = "strain"
    components = residual_components = ("",)
    unit = residual_unit = "1"
    shapes: ClassVar[dict[str, tuple[int, int]]] = {"offset": (2, 1)}

    def factors(self) -> AnyExpr:
        offset: AnyExpr = self.offset
        return ca.horzcat(0, offset[1], -offset[0])


@dataclass(frozen=True, eq=False, kw_only=True)
class ShearGauge(CurvatureSensor):
    """Elastic torsion K_x − K_0x, rad/m: shear strain over the distance from the axis of twist.

    With `reference="straight"` it reads K_x, built-in twist included.

    Attributes
    ----------
    xi : float
        Station s/L in [0, 1].
    name : str or None
        Name of the sensor; its kind and number where None.
    noise : float
        Standard deviation of one sample, rad/m.
    bias : float, symbol or None
        Bias, rad/m; zero where None.
    reference : {"unloaded", "straight"}
        Shape at which it reads zero: the unloaded beam, so that it measures K − K_0, or a straight
        one.
    """

    noise: Number
    bias: Number = None

    prefix = "shear"
    components = residual_components = ("",)
    unit = residual_unit = "rad/m"

    def factors(self) -> AnyExpr:
        return ca.DM([[1, 0, 0]])
