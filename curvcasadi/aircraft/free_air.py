"""The air of free flight: what it does to the wings and surfaces of a moving aircraft.

Every wing and every rigid surface is made of unsteady strips (`aero.unsteady`) that move with their
section through air at rest, beside gusts. A surface is one strip of its whole area.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import casadi as ca
import numpy as np

from curvcasadi.aero import section
from curvcasadi.aero.air_states import StateParts, gained, state_parts
from curvcasadi.aero.airload import Flow
from curvcasadi.aero.apparent_mass import strip_apparent_mass
from curvcasadi.aero.gust import GustEntry
from curvcasadi.aero.induced import LiftingLine, line_of_wing
from curvcasadi.aero.lag_states import IndicialLag, SpanFunctions
from curvcasadi.aero.stations import AirStation, air_stations, section_data
from curvcasadi.aero.strip import StripAerodynamics
from curvcasadi.aero.strip_formula import StripFormula
from curvcasadi.aero.unsteady import UnsteadyAirload
from curvcasadi.aircraft.parts import LiftingSurface, Wing
from curvcasadi.kinematics.jacobian import to_body
from curvcasadi.symbolic.expressions import AnyExpr, Number, instance

#: Station of the airfoil data of a surface.
MIDDLE = 0.5


@dataclass(frozen=True, eq=False, kw_only=True)
class FreeAir:
    """Air at rest, and how strips follow their motion through it and gusts.

    Attributes
    ----------
    density : float
        kg/m³, above zero.
    lag : IndicialLag or None
        Lag of the circulation.
    entry : GustEntry or None
        How strips follow a gust; None without gusts.
    induced_flow : LiftingLine or None
        A lifting line of each wing, or none.
    """

    density: float
    lag: IndicialLag | None
    entry: GustEntry | None = None
    induced_flow: LiftingLine | None = None

    def load(
        self,
        wing: Wing,
        states: Number,
        deflections: Mapping[str, Number],
        gust: Number = (0, 0, 0),
        velocity: Number = (0, 0, 0),
    ) -> UnsteadyAirload:
        """Airloads of a wing; the gust (3, 1) or (3, stations) is in body axes.

        So is the velocity (3, 1) of the body origin, m/s, of which a lifting line takes the
        direction of its wake; the motion of the strips is that of the beam.
        """
        strips = instance("Wing.strips", wing.strips, StripAerodynamics)
        return UnsteadyAirload(
            strips=strips,
            flow=Flow(density=self.density),
            lag=self.lag,
            states=states,
            deflections={name: deflections[name] for name in strips.inputs},
            gust=gust,
            entry=self.entry,
            induced_flow=line_of_wing(self.induced_flow, wing.name),
            through_air=velocity,
        )

    def states(self, part: Wing | LiftingSurface) -> StateParts | None:
        """The states of the air of a wing or a surface; None without airfoil data."""
        if isinstance(part, LiftingSurface):
            one = SpanFunctions(np.eye(1), np.eye(1))
            return StateParts((AirStation(MIDDLE, 1.0),), *self.poles, one, one)
        return None if part.strips is None else state_parts(part.strips, self.lag, self.entry)

    def size(self, part: Wing | LiftingSurface) -> int:
        """Number of states of the air of a wing or a surface."""
        return sum(self.sizes(part))

    def sizes(self, part: Wing | LiftingSurface) -> list[int]:
        """Number of states of each pole of lag and entry."""
        states = self.states(part)
        return [] if states is None else states.sizes

    @property
    def poles(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Rates of the lag and of the entry states."""
        lag = () if self.lag is None else tuple(self.lag.rates.tolist())
        return lag, () if self.entry is None else tuple(self.entry.poles.rates.tolist())


def strip_points(part: Wing | LiftingSurface) -> tuple[float, ...]:
    """Stations of the strips of a wing, s/L; of a surface one."""
    if isinstance(part, LiftingSurface):
        return (MIDDLE,)
    return () if part.strips is None else tuple(at.xi for at in air_stations(part.strips))


def surface_function(surface: LiftingSurface, air: FreeAir, name: str) -> ca.Function:
    """Airloads of a rigid surface by its motion, its states and the air that it meets.

    (twist, twist_rate, lag, gust, wash, deflections …) -> wrench, rates.
    Twist and its rate are those of the body, gust and wash (3, 1), m/s, are in body axes; the wash
    of the wings meets the surface as the wind does. The wrench (moment, force), (6, 1), is about
    the body origin in body axes, N m and N; rates are those of the states.
    """
    formula = StripFormula.of(air.lag, air.entry)
    twist, rate = ca.SX.sym("twist", 6), ca.SX.sym("twist_rate", 6)
    states = ca.SX.sym("lag", formula.count)
    gust, wash = ca.SX.sym("gust", 3), ca.SX.sym("wash", 3)
    deflections = {key: ca.SX.sym(key) for key in surface.strips.inputs}
    strip = _surface_strip(surface, air, deflections).pack()
    rotation, position = surface.pose.rotation, surface.pose.position
    local = to_body(rotation, position, twist[:3], twist[3:])
    linear = rate[3:] + ca.cross(twist[:3], twist[3:]) + ca.cross(rate[:3], position)
    linear += ca.cross(twist[:3], ca.cross(twist[:3], position))
    acceleration = ca.vertcat(rotation.T @ rate[:3], rotation.T @ linear)
    direct = 1.0 - (0.0 if air.lag is None else float(np.sum(air.lag.amplitudes)))
    vectors = ca.horzcat(-rotation.T @ wash, rotation.T @ gust)[:, : formula.vectors]
    data = ca.vertcat(direct, sum(gained(air.lag, air.entry, states)), states, strip)
    values = formula(vectors, data, local, acceleration)
    force = rotation @ values[3:6]
    wrench = ca.vertcat(rotation @ values[:3] + ca.cross(position, force), force)
    inputs = {"twist": twist, "twist_rate": rate, "lag": states, "gust": gust, "wash": wash}
    inputs |= deflections
    return ca.Function(
        name,
        [*inputs.values()],
        [ca.densify(wrench), ca.densify(values[6:])],
        [*inputs],
        ["wrench", "rates"],
        {"cse": True},
    )


def surface_apparent_mass(surface: LiftingSurface, air: FreeAir) -> AnyExpr:
    """Apparent mass (6, 6) of a surface for the twist of the body."""
    none = dict.fromkeys(surface.strips.inputs, 0.0)
    unit, pose = ca.DM.eye(6), surface.pose
    jacobian = to_body(pose.rotation, pose.position, unit[:3, :], unit[3:, :])
    return strip_apparent_mass(_surface_strip(surface, air, none), jacobian)


def _surface_strip(
    surface: LiftingSurface, air: FreeAir, deflections: Mapping[str, Number]
) -> section.SectionData:
    span = surface.area / surface.strips.at("chord", MIDDLE)
    return section_data(
        surface.strips, MIDDLE, deflections, density=air.density, measure=span, apparent=1.0
    )
