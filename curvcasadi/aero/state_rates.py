"""Rates of the states of unsteady air, with structured derivatives."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import casadi as ca

from curvcasadi.aero import section
from curvcasadi.aero.air_states import in_front
from curvcasadi.aero.stations import section_data
from curvcasadi.aero.unsteady import UnsteadyAirload
from curvcasadi.beam.beam import Beam
from curvcasadi.kinematics import chain
from curvcasadi.kinematics.jacobian import to_body
from curvcasadi.kinematics.motion import Motion, motion_states, unpack_motion
from curvcasadi.lie import so3
from curvcasadi.symbolic.expressions import AnyExpr, Array


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
