"""Inertial forces of a beam whose parent moves steadily, as in a turn, as a load of statics."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from curvcasadi.beam.beam import Beam
from curvcasadi.dynamics.fields import cross_force
from curvcasadi.dynamics.inertia import SIZE, lumped, momentum, moved_to_parent, unpack
from curvcasadi.loads.stations import Contributions, Load, Mesh
from curvcasadi.symbolic.expressions import AnyExpr, Number, expression, is_numeric, own_fields


@dataclass(frozen=True, eq=False, kw_only=True)
class SteadyRotation(Load):
    """Inertial forces of the sections and bodies of a beam in a parent that turns steadily.

    The parent's twist V = (ω, v) is constant in its own axes, and the beam rests in it. The mass at
    a position p, parent axes, pulls by −m ω × (v + ω × p); with the inertia I of a station about
    the parent origin its wrench is −V ×* I V. Weight is not part of it.

    Attributes
    ----------
    angular_rate : array or symbol, shape (3,)
        Angular rate ω of the parent frame, rad/s, parent axes.
    velocity : array or symbol, shape (3,)
        Velocity v of the parent origin, m/s, parent axes; zero of a rotor.
    """

    angular_rate: Number
    velocity: Number = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        own_fields(self)
        for name in ("angular_rate", "velocity"):
            value = expression(f"SteadyRotation.{name}", getattr(self, name), (3, 1))
            object.__setattr__(self, name, value)

    def is_distributed(self, beam: Beam) -> bool:
        return beam.section is not None and beam.section.mass_per_length is not None

    def contributions(self, beam: Beam, mesh: Mesh, to_parent: AnyExpr) -> Contributions:
        for node, numbers in enumerate(lumped(beam, mesh)):
            if not is_numeric(numbers) or np.any(ca.DM(numbers).full()):
                yield node, ca.vertcat(self.angular_rate, self.velocity, numbers)

    @staticmethod
    def wrench(rotation: Any, position: Any, data: Any, *motion: Any) -> Any:
        twist, numbers = ca.vertsplit(data, [0, 6, 6 + SIZE])
        inertia = moved_to_parent(unpack(numbers), rotation, position)
        return -cross_force(twist, momentum(inertia, twist))
