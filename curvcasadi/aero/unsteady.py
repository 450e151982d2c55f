"""Unsteady airloads of a wing: a load with lag states of its own.

The strips are those of `section`; their circulation follows u by the lag states of `lag_states`,
and a gust by the entry states of `gust`. The states are weights of functions along the span:

    x_i(ξ) = Ψ(ξ) z_i,      dz_i/dt = P (b_i W/b (u + e − x_i)),      u_e = φ₀ (u + e) + Σ A_i x_i

with e what a single entry lag has let in of a gust; Küssner's two states add to u_e instead. P is
the weighted least-squares projection of values at the stations on Ψ. With the induced flow of a
frozen lifting line the lagged part becomes a three-dimensional one, T Σ A_i x_i/Σ A_i: T takes u of
all strips to their steady u_e.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from typing import NamedTuple

import casadi as ca
import numpy as np

from curvcasadi.aero import section
from curvcasadi.aero.airload import Flow
from curvcasadi.aero.gust import GustEntry
from curvcasadi.aero.induced import LiftingLine
from curvcasadi.aero.induced_load import frozen_map
from curvcasadi.aero.lag_states import IndicialLag, SpanFunctions, span_functions
from curvcasadi.aero.strip import AirStation, StripAerodynamics, air_stations, section_data
from curvcasadi.beam.beam import Beam
from curvcasadi.beam.pose import unpack_pose
from curvcasadi.kinematics import chain
from curvcasadi.kinematics.jacobian import body_jacobian_of, jacobian_states, to_body
from curvcasadi.kinematics.motion import Motion, motion_states, unpack_motion
from curvcasadi.lie import so3
from curvcasadi.loads.stations import Contributions, Load, Mesh
from curvcasadi.symbolic.expressions import (
    AnyExpr,
    Array,
    Number,
    expression,
    instance,
    own_fields,
)


class StateParts(NamedTuple):
    """The states of an unsteady load, and the functions along the span that carry them."""

    stations: tuple[AirStation, ...]
    lag: tuple[float, ...]  #: rates of the poles of the circulation
    entry: tuple[float, ...]  #: rates of the entry states
    of_lag: SpanFunctions
    of_entry: SpanFunctions

    @property
    def size(self) -> int:
        """Number of states."""
        lag, entry = (part.values.shape[1] for part in (self.of_lag, self.of_entry))
        return int(len(self.lag) * lag + len(self.entry) * entry)

    def values(self, states: AnyExpr) -> AnyExpr:
        """Values at the stations, (poles and entry states, stations), of the states (size, 1)."""
        rows, start = [], 0
        for functions, count in ((self.of_lag, len(self.lag)), (self.of_entry, len(self.entry))):
            size = functions.values.shape[1]
            for _ in range(count):
                rows.append((ca.DM(functions.values) @ states[start : start + size]).T)
                start += size
        return ca.vertcat(*rows)

    @property
    def projection(self) -> Array:
        """Rates of the states from those of values at the stations, stacked station by station."""
        sizes = [self.of_lag.values.shape[1]] * len(self.lag)
        sizes += [self.of_entry.values.shape[1]] * len(self.entry)
        count, total = len(self.stations), len(sizes)
        matrix, start = np.zeros((self.size, count * total)), 0
        for i, size in enumerate(sizes):
            functions = self.of_lag if i < len(self.lag) else self.of_entry
            matrix[start : start + size, i::total] = functions.rates
            start += size
        return matrix


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
        A frozen lifting line, or none.
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
        if self.induced_flow is not None and not self.induced_flow.frozen:
            raise ValueError(
                "UnsteadyAirload.induced_flow: expected LiftingLine(frozen=True), found a line "
                "whose influence moves with the wing"
            )
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

    def contributions(self, beam: Beam, mesh: Mesh, to_parent: AnyExpr) -> Contributions:
        """φ₀, what else adds to u_e, the velocity through the air, and the data of the strip."""
        parts = self.parts
        direct = 1.0 if self.lag is None else 1.0 - float(np.sum(self.lag.amplitudes))
        added = self._gained(beam, parts, direct)
        velocity = self.flow.velocity - to_parent @ self.flow.wind
        for k, (xi, weight) in enumerate(parts.stations):
            strip = section_data(
                self.strips,
                xi,
                self.deflections,
                density=self.flow.density,
                measure=weight * beam.length,
                apparent=float(self.apparent_mass),
            )
            yield mesh.node(xi), ca.vertcat(direct, added[k], velocity, strip.pack())

    def _gained(self, beam: Beam, parts: StateParts, direct: float) -> list[AnyExpr]:
        """u_e − φ₀ u of each station, which is of states alone."""
        if not parts.size:
            return [0.0] * len(parts.stations)
        lagged, entered = gained(self.lag, self.entry, parts.values(self.states))
        if self.induced_flow is not None and self.lag is not None:
            steady = frozen_map(self.induced_flow, beam, self.strips)
            whole = lagged / float(np.sum(self.lag.amplitudes))
            lagged = (steady @ whole.T).T - direct * whole
        return ca.horzsplit(lagged + entered)

    @staticmethod
    def wrench(
        rotation: AnyExpr, position: AnyExpr, data: AnyExpr, twist: AnyExpr, acceleration: AnyExpr
    ) -> AnyExpr:
        """Wrench (moment, force), (6, 1), about the parent origin, parent axes."""
        direct, gained, stream, packed = ca.vertsplit(data, [0, 1, 2, 5, 5 + section.SIZE])
        strip, omega = section.unpack(packed), twist[:3]
        velocity = twist[3:] + rotation.T @ stream
        u = section.circulation(velocity, omega, strip).velocity
        local = section.circulatory_wrench(velocity, omega, strip, u, direct * u + gained)
        rate = acceleration[3:] - ca.cross(omega, velocity)
        local += section.apparent_wrench(velocity, omega, rate, acceleration[:3], strip)
        force = rotation @ local[3:]
        return ca.vertcat(rotation @ local[:3] + ca.cross(position, force), force)


def gained(
    lag: IndicialLag | None, entry: GustEntry | None, values: AnyExpr
) -> tuple[AnyExpr, AnyExpr]:
    """What lag states add to u_e beside φ₀ u, and what a gust adds, (1, stations) each, m/s.

    Parameters
    ----------
    lag, entry : IndicialLag, GustEntry or None
        As of `UnsteadyAirload`.
    values : SX, MX or DM, shape (poles and entry states, stations)
        Of the lag states, then of the entry states.
    """
    zero: AnyExpr = ca.DM.zeros(1, values.shape[1])
    amplitudes = np.zeros(0) if lag is None else lag.amplitudes
    of_lag, of_entry = values[: len(amplitudes), :], values[len(amplitudes) :, :]
    lagged = ca.DM(amplitudes).T @ of_lag if lag is not None else zero
    if entry is None:
        return lagged, zero
    if entry.kind == "kussner":
        return lagged, ca.DM(entry.poles.amplitudes).T @ of_entry
    return lagged + (1 - float(np.sum(amplitudes))) * of_entry, zero


def state_parts(
    strips: StripAerodynamics, lag: IndicialLag | None, entry: GustEntry | None
) -> StateParts:
    """The states of a load and their functions along the span.

    Raises
    ------
    ValueError
        If there are fewer aerodynamic stations than functions.
    """
    stations = air_stations(strips)
    xi, measures = np.array(stations).T
    functions = [
        span_functions(model.modes, xi, measures)
        if model is not None
        else SpanFunctions(np.zeros((len(xi), 0)), np.zeros((0, len(xi))))
        for model in (lag, entry)
    ]
    rates = () if lag is None else tuple(lag.rates.tolist())
    entered = () if entry is None else tuple(entry.poles.rates.tolist())
    return StateParts(stations, rates, entered, *functions)


class StateRates(NamedTuple):
    """Rates of the states of a load, and their derivatives where asked for."""

    value: AnyExpr  #: (states, 1), m/s²
    by_weights: AnyExpr = None  #: (states, n)
    by_rates: AnyExpr = None  #: (states, n)
    by_parameters: AnyExpr = None  #: (states, m)


def state_rates(
    beam: Beam,
    q: AnyExpr,
    q_dot: AnyExpr,
    load: UnsteadyAirload,
    to_parent: AnyExpr,
    boundaries: Array,
    parameters: AnyExpr | None = None,
    root_twist: AnyExpr | None = None,
) -> StateRates:
    """Rates of the lag and entry states of a load on a beam.

    Parameters
    ----------
    beam : Beam
        The wing.
    q, q_dot : SX, MX or DM, shape (n, 1)
        Weights, rad/m, and their rates.
    load : UnsteadyAirload
        The load; its fields may hold symbols.
    to_parent : SX, MX or DM, shape (3, 3)
        Rotation from inertial to parent axes.
    boundaries : array, shape (N + 1,)
        Of the elements, the stations of the mesh on which the load acts.
    parameters : SX or MX, shape (m, 1), optional
        Symbols in the load, `to_parent` and `root_twist`, by which the rates are differentiated as
        well.
    root_twist : SX, MX or DM, shape (6, 1), optional
        Body twist of the root, rad/s and m/s, root axes; unless given the root is clamped to its
        parent.

    Returns
    -------
    StateRates
        With derivatives where there are `parameters`: structured ones, of one station each.
    """
    parts = load.parts
    stations = [xi for xi, _ in parts.stations]
    beam_chain = chain.build(beam, stations, boundaries=boundaries)
    slopes, symbols = parameters is not None, ca.MX(0, 1) if parameters is None else parameters
    motion = Motion(q=q, q_dot=q_dot, root_twist=root_twist)
    states = motion_states(beam_chain, motion, order=1, jacobian=slopes)
    values = parts.values(load.states)
    stream = beam.root.rotation.T @ (load.flow.velocity - to_parent @ load.flow.wind)
    gusts = ca.repmat(load.gust, 1, len(stations) if load.gust.shape[1] == 1 else 1)
    gusts = beam.root.rotation.T @ to_parent @ gusts
    n, carried = beam.basis.n, ca.DM.zeros(6) if root_twist is None else root_twist
    of = _station_rates(parts.lag, parts.entry, in_front(load.entry), n if slopes else 0)
    found: list[tuple[AnyExpr, ...]] = []
    for k, (xi, state) in enumerate(zip(stations, states, strict=True)):
        strip = section_data(load.strips, xi, load.deflections, density=1.0, measure=1.0)
        data = ca.vertcat(values[:, k], stream, gusts[:, k], strip.pack())
        results = of(state, data)
        if slopes:
            rate, by_q, by_q_dot, by_root, by_data = results
            by_symbols = by_data @ ca.jacobian(data, symbols)
            by_symbols += by_root @ ca.densify(ca.jacobian(ca.MX(carried), symbols))
            found.append((rate, by_q, by_q_dot, by_symbols))
        else:
            found.append((results,))
    projection = ca.DM(parts.projection)
    return StateRates(*(projection @ ca.vertcat(*column) for column in zip(*found, strict=True)))


def in_front(entry: GustEntry | None) -> bool:
    """Whether a single entry state stands in front of the lag states."""
    return entry is not None and entry.kind == "lag"


@lru_cache(maxsize=64)
def _station_rates(
    lag: tuple[float, ...], entry: tuple[float, ...], first: bool, columns: int
) -> ca.Function:
    """(state, data) -> rates of the values at a station; with `columns` of sums also derivatives.

    The state is that of `motion_states`, relative to the root; data are the values, the velocity
    through the air and the gust in root axes, and `SectionData`. The derivatives are those by q,
    q_dot, the twist of the root and the data.
    """
    count = len(lag) + len(entry)
    state = ca.SX.sym("state", 18 + 12 * columns)
    data = ca.SX.sym("data", count + 6 + section.SIZE)
    at = unpack_motion(state, 1)
    local = to_body(at.rotation, at.position, at.twist[:3], at.twist[3:])
    rotation, twist = ca.SX.sym("rotation", 9), ca.SX.sym("twist", 6)
    rates = strip_rates(lag, entry, first, ca.reshape(rotation, 3, 3), twist, data)
    arguments, given = [rotation, twist], [ca.vec(at.rotation), local]
    if not columns:
        (value,) = ca.substitute([rates], arguments, given)
        return ca.Function("lag_rates", [state, data], [value], {"cse": True})
    slopes = [ca.jacobian(rates, x) for x in (rotation, twist, data)]
    value, by_rotation, by_twist, by_data = ca.substitute([rates, *slopes], arguments, given)
    (a, b), (a1, b1) = at.sums
    turned = ca.vertcat(*(-so3.hat(at.rotation[:, k]) @ a for k in range(3)))
    by_q = by_rotation @ turned + by_twist @ to_body(at.rotation, at.position, a1, b1)
    by_q_dot = by_twist @ to_body(at.rotation, at.position, a, b)
    unit = ca.DM.eye(6)
    by_root = by_twist @ to_body(at.rotation, at.position, unit[:3, :], unit[3:, :])
    outputs = [value, by_q, by_q_dot, by_root, by_data]
    return ca.Function(
        "lag_rates_tangent", [state, data], [ca.densify(x) for x in outputs], {"cse": True}
    )


def strip_rates(
    lag: tuple[float, ...],
    entry: tuple[float, ...],
    first: bool,
    rotation: ca.SX,
    twist: ca.SX,
    data: ca.SX,
) -> ca.SX:
    """Rates (poles and entry states, 1) of the values at a station, m/s².

    Parameters
    ----------
    lag, entry : tuple of float
        Rates of their poles.
    first : bool
        Whether the entry state stands in front of the lag states.
    rotation : SX, shape (3, 3)
        Of the station, local axes to those of the stream and the gust.
    twist : SX, shape (6, 1)
        Of the station, rad/s and m/s, local axes.
    data : SX
        Values, velocity of the parent through the air and gust (3, 1) each, `SectionData`.
    """
    count = len(lag) + len(entry)
    values, stream, gust, packed = ca.vertsplit(
        data, [0, count, count + 3, count + 6, count + 6 + section.SIZE]
    )
    strip, omega = section.unpack(packed), twist[:3]
    velocity = twist[3:] + rotation.T @ stream
    followed = section.circulation(velocity, omega, strip)
    pace = followed.speed / (strip.chord / 2)
    x, g = values[: len(lag)], values[len(lag) :]
    target = followed.velocity + (g[0] if first else 0)
    rates = [rate * pace * (target - x[i]) for i, rate in enumerate(lag)]
    if entry:
        u_g = section.gust_velocity(velocity, omega, rotation.T @ gust, strip)
        rates += [rate * pace * (u_g - g[i]) for i, rate in enumerate(entry)]
    return ca.SX(ca.vertcat(*rates))


def apparent_mass_matrix(
    beam: Beam, q: AnyExpr, load: UnsteadyAirload, boundaries: Array, *, root: bool = False
) -> AnyExpr:
    """What the apparent mass of the air adds to the mass matrix of the weights, (n, n).

    With `root` also to that of a free parent, whose twist is about its origin in its axes and goes
    first: (6 + n, 6 + n).

    With π ρ b² l the mass of a strip and J its body Jacobian, J_mid that of the normal velocity in
    the middle of its chord: Σ π ρ b² l (J_midᵀ J_mid + ⅛ b² J_ωxᵀ J_ωx).

    Parameters
    ----------
    beam : Beam
        The wing.
    q : SX, MX or DM, shape (n, 1)
        Weights, rad/m.
    load : UnsteadyAirload
        The load; without apparent mass the matrix is zero.
    boundaries : array, shape (N + 1,)
        Of the elements, the stations of the mesh on which the load acts.
    root : bool
        Whether the parent of the beam is free.
    """
    n = beam.basis.n
    stations = air_stations(load.strips)
    beam_chain = chain.build(beam, [xi for xi, _ in stations], boundaries=boundaries)
    add = _add_apparent_mass(n, root)
    total: AnyExpr = ca.DM.zeros(n + 6 * root, n + 6 * root)
    frame = beam.root.packed if root else chain.IDENTITY
    states = jacobian_states(beam_chain, q, frame)
    for (xi, weight), state in zip(stations, states, strict=True):
        strip = section_data(
            load.strips,
            xi,
            {},
            density=load.flow.density,
            measure=weight * beam.length,
            apparent=float(load.apparent_mass),
        )
        total = add(state, strip.pack(), total)
    return total


@lru_cache(maxsize=32)
def _add_apparent_mass(n: int, root: bool) -> ca.Function:
    """(state with sums, `SectionData`, sum) -> sum with the apparent mass of a strip."""
    state, data = ca.SX.sym("state", 12 + 6 * n), ca.SX.sym("data", section.SIZE)
    size = n + 6 * root
    total, jacobian = ca.SX.sym("total", size, size), body_jacobian_of(state)
    if root:
        unit, pose = ca.DM.eye(6), unpack_pose(state)
        jacobian = ca.horzcat(to_body(*pose, unit[:3, :], unit[3:, :]), jacobian)
    added = strip_apparent_mass(section.unpack(data), jacobian)
    return ca.Function("apparent_mass", [state, data, total], [total + added], {"cse": True})


def strip_apparent_mass(strip: section.SectionData, jacobian: AnyExpr) -> AnyExpr:
    """Apparent mass (k, k) of a strip whose body Jacobian is (6, k): see `apparent_mass_matrix`."""
    half = strip.chord / 2
    mass = strip.apparent * np.pi * half * strip.pressure
    rolling = jacobian[0, :]
    normal = jacobian[5, :] + (strip.center - half / 2) * rolling
    return mass * (normal.T @ normal + half**2 / 8 * (rolling.T @ rolling))
