"""Unsteady airloads of a wing: a load with lag states of its own.

The strips are those of `section`; their circulation follows u by the lag states of `lag_states`,
and a gust by the entry states of `gust`. The states are weights of functions along the span:

    x_i(ξ) = Ψ(ξ) z_i,      dz_i/dt = P (b_i W/b (u + e − x_i)),      u_e = φ₀ (u + e) + Σ A_i x_i

with e what a single entry lag has let in of a gust; Küssner's two states g add to u_e instead. P is
the weighted least-squares projection of values at the stations on Ψ. With a lifting line T takes u
of all strips to their steady u_e, and what is lagged is three-dimensional:

    u_e = φ₀ (u + e − s) + T (s + g),      s = Σ A_i x_i/Σ A_i,      without lag u_e = T (u + e + g)

T follows the shape of the wing and the stream unless the line is frozen.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import casadi as ca
import numpy as np

from curvcasadi.aero.air_states import StateParts, gained, state_parts
from curvcasadi.aero.airload import Flow
from curvcasadi.aero.gust import GustEntry
from curvcasadi.aero.induced import LiftingLine
from curvcasadi.aero.induced_load import (
    Followed,
    LineOnWing,
    line_on_wing,
    refuse_tip_loss,
)
from curvcasadi.aero.lag_states import IndicialLag
from curvcasadi.aero.stations import air_stations, section_data
from curvcasadi.aero.strip import StripAerodynamics
from curvcasadi.aero.strip_formula import StripFormula
from curvcasadi.beam.beam import Beam
from curvcasadi.loads.coupling import Coupling
from curvcasadi.loads.formulas import Formula, LocalFormula
from curvcasadi.loads.stations import Contributions, Load, Mesh
from curvcasadi.symbolic.expressions import (
    AnyExpr,
    Number,
    expression,
    instance,
    own_fields,
)


@dataclass(frozen=True, eq=False, kw_only=True)
class UnsteadyAirload(Load):
    """Airloads on a moving beam: lagged circulation, apparent mass, leading-edge suction, gusts.

    Attributes
    ----------
    strips : StripAerodynamics
        Airfoil data of the wing.
    flow : Flow
        The air, and the uniform motion of the parent through it; its `angular_rate` must be zero,
        as the rotation of a parent belongs to the motion of the root.
    lag : IndicialLag or None
        Lag of the circulation; None for a circulation that follows at once.
    states : SX, MX, DM or array, shape (states, 1)
        Lag states, then entry states, m/s: those of one pole after the other, each the weights of
        its functions along the span. Their number is `parts.size`.
    deflections : mapping of str to number or symbol
        Of the control surfaces, rad; others are zero.
    gust : SX, MX, DM or array, shape (3, 1) or (3, stations)
        Velocity of the air beside the wind of `flow`, m/s, inertial axes; the same at all strips,
        or a column for each of `points`.
    entry : GustEntry or None
        How the strips follow the gust; None where there is none.
    induced_flow : LiftingLine or None
        A lifting line that moves with the wing or a frozen one, or none.
    through_air : SX, MX, DM or array, shape (3, 1), or None
        Velocity of the parent's origin through the air, m/s, parent axes, from which the wake of
        the lifting line streams away; that of `flow` unless given, as it must be where the root
        moves.
    apparent_mass : bool
        Whether the air that a strip accelerates has inertia.
    """

    strips: StripAerodynamics
    flow: Flow
    lag: IndicialLag | None = field(default_factory=IndicialLag)
    states: Number = ()
    deflections: Mapping[str, Number] = field(default_factory=dict)
    gust: Number = (0.0, 0.0, 0.0)
    entry: GustEntry | None = None
    induced_flow: LiftingLine | None = None
    through_air: Number | None = None
    apparent_mass: bool = True

    order = 2

    def __post_init__(self) -> None:
        own_fields(self)
        instance("UnsteadyAirload.strips", self.strips, StripAerodynamics)
        instance("UnsteadyAirload.flow", self.flow, Flow)
        for name, kind in (
            ("lag", IndicialLag),
            ("entry", GustEntry),
            ("induced_flow", LiftingLine),
        ):
            if getattr(self, name) is not None:
                instance(f"UnsteadyAirload.{name}", getattr(self, name), kind)
        rate = self.flow.angular_rate
        if not isinstance(rate, ca.DM) or np.any(rate.full()):
            raise ValueError(
                "UnsteadyAirload.flow: expected no angular_rate, which is that of the root's "
                f"motion, found {rate}"
            )
        refuse_tip_loss(self.strips, self.induced_flow)
        if self.through_air is not None:
            velocity = expression("UnsteadyAirload.through_air", self.through_air, (3, 1))
            object.__setattr__(self, "through_air", velocity)
        size = self.parts.size
        states = expression("UnsteadyAirload.states", self.states, (size, 1)) if size else None
        object.__setattr__(self, "states", ca.DM(0, 1) if states is None else states)
        each = (3, len(self.points))
        shape = each if getattr(self.gust, "shape", ()) == each else (3, 1)
        object.__setattr__(self, "gust", expression("UnsteadyAirload.gust", self.gust, shape))

    @property
    def parts(self) -> StateParts:
        """The states and their functions along the span."""
        return state_parts(self.strips, self.lag, self.entry)

    @property
    def points(self) -> tuple[float, ...]:
        """Stations at which the airloads act, s/L."""
        return tuple(station.xi for station in air_stations(self.strips))

    def is_distributed(self, beam: Beam) -> bool:
        """Airloads are integrated at stations of their own."""
        return False

    @property
    def formula(self) -> Formula:
        """Wrench of a strip, and the rates of the values that its states have there."""
        strip = StripFormula.of(self.lag, self.entry)
        return LocalFormula(strip, strip.vectors)

    def contributions(self, beam: Beam, mesh: Mesh, to_parent: AnyExpr) -> Contributions:
        """The velocity through the air and the gust, then the data of `StripFormula`."""
        if self._coupled:
            return
        gained, first = self._gained(beam, to_parent), self._first
        own = self._own(beam, to_parent)
        for xi, added, data in zip(self.points, gained, own, strict=True):
            yield mesh.node(xi), ca.vertcat(data[:first], added, data[first:])

    def coupling(self, beam: Beam, mesh: Mesh, to_parent: AnyExpr) -> Coupling | None:
        """Strips whose circulation a lifting line determines from their motion."""
        if not self._coupled:
            return None
        line = line_of_load(self, beam, circulations_follow(self, to_parent))
        return Coupling(
            nodes=tuple(mesh.node(xi) for xi in self.points),
            function=line.followed,
            data=line.data,
            formula=self.formula,
            own=tuple(self._own(beam, to_parent)),
            first=self._first,
            order=int(line.key.moving),
            slopes=line.slopes,
        )

    @property
    def _coupled(self) -> bool:
        """Whether u_e of a strip depends on the motion of others, not on states alone."""
        return self.induced_flow is not None and (not self.induced_flow.frozen or self.lag is None)

    @property
    def _first(self) -> int:
        """Data of a station before what is gained: the vectors and φ₀."""
        return 3 * StripFormula.of(self.lag, self.entry).vectors + 1

    @property
    def _direct(self) -> float:
        """φ₀, the part of u that circulations follow at once, without induced flow."""
        return 1.0 if self.lag is None else 1.0 - float(np.sum(self.lag.amplitudes))

    def _own(self, beam: Beam, to_parent: AnyExpr) -> list[AnyExpr]:
        """Data of the stations without what is gained."""
        parts, strip = self.parts, StripFormula.of(self.lag, self.entry)
        direct = 0.0 if self.lag is None and self.induced_flow is not None else self._direct
        values, count = parts.values(self.states), len(parts.stations)
        stream = self.flow.velocity - to_parent @ self.flow.wind
        gusts = to_parent @ ca.repmat(self.gust, 1, count // self.gust.shape[1])
        found = []
        for k, (xi, weight) in enumerate(parts.stations):
            section = section_data(
                self.strips,
                xi,
                self.deflections,
                density=self.flow.density,
                measure=weight * beam.length,
                apparent=float(self.apparent_mass),
            )
            vectors = [stream, gusts[:, k]][: strip.vectors]
            found.append(ca.vertcat(*vectors, direct, values[:, k], section.pack()))
        return found

    def _gained(self, beam: Beam, to_parent: AnyExpr) -> list[AnyExpr]:
        """u_e − φ₀ u of each station, where it is of states alone."""
        if self.induced_flow is not None:
            line = line_of_load(self, beam, circulations_follow(self, to_parent))
            anywhere = ca.DM.zeros(12, len(self.points))  # a frozen line is what it is
            return ca.horzsplit(line.followed(anywhere, line.data))
        return ca.horzsplit(sum(gained(self.lag, self.entry, self.parts.values(self.states))))


def circulations_follow(load: UnsteadyAirload, to_parent: AnyExpr) -> Followed:
    """What circulations follow by a lifting line; φ₀ u comes on top where there is a lag."""
    velocity = load.flow.velocity - to_parent @ load.flow.wind
    through = velocity if load.through_air is None else load.through_air
    lagged, ahead, entered = gained(load.lag, load.entry, load.parts.values(load.states))
    if load.lag is None:
        motion = (velocity, ca.DM.zeros(3))
        return Followed(through, motion, moving=True, given=(ahead + entered).T)
    share = float(np.sum(load.lag.amplitudes))
    slow = lagged / share
    return Followed(through, given=(slow + entered).T, added=(ahead - (1 - share) * slow).T)


def line_of_load(load: UnsteadyAirload, beam: Beam, follows: Followed) -> LineOnWing:
    """The lifting line of a load on a beam."""
    line = instance("UnsteadyAirload.induced_flow", load.induced_flow, LiftingLine)
    return line_on_wing(line, beam, load.strips, load.deflections, follows, load.points)
