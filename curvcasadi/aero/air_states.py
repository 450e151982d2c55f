"""The states of unsteady air: weights of functions along the span, and what they add to u_e."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import casadi as ca
import numpy as np

from curvcasadi.aero.gust import GustEntry
from curvcasadi.aero.lag_states import IndicialLag, SpanFunctions, span_functions
from curvcasadi.aero.stations import AirStation, air_stations
from curvcasadi.aero.strip import StripAerodynamics
from curvcasadi.symbolic.expressions import AnyExpr, Array


class StateParts(NamedTuple):
    """The states of an unsteady load, and the functions along the span that carry them."""

    stations: tuple[AirStation, ...]
    lag: tuple[float, ...]  #: rates of the poles of the circulation
    entry: tuple[float, ...]  #: rates of the entry states
    of_lag: SpanFunctions
    of_entry: SpanFunctions

    @property
    def sizes(self) -> list[int]:
        """Number of states of each pole of lag and entry."""
        lag, entry = (part.values.shape[1] for part in (self.of_lag, self.of_entry))
        return [lag] * len(self.lag) + [entry] * len(self.entry)

    @property
    def size(self) -> int:
        """Number of states."""
        return sum(self.sizes)

    def values(self, states: AnyExpr) -> AnyExpr:
        """Values at the stations, (poles and entry states, stations), of the states (size, 1)."""
        rows, start = [], 0
        for functions, count in ((self.of_lag, len(self.lag)), (self.of_entry, len(self.entry))):
            size = functions.values.shape[1]
            for _ in range(count):
                rows.append((ca.DM(functions.values) @ states[start : start + size]).T)
                start += size
        return ca.vertcat(ca.DM(0, len(self.stations)), *rows)

    @property
    def projection(self) -> Array:
        """Rates of the states from those of values at the stations, stacked station by station."""
        count, total = len(self.stations), len(self.sizes)
        matrix, start = np.zeros((self.size, count * total)), 0
        for i, size in enumerate(self.sizes):
            functions = self.of_lag if i < len(self.lag) else self.of_entry
            matrix[start : start + size, i::total] = functions.rates
            start += size
        return matrix


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


class Gained(NamedTuple):
    """What states add to u_e beside φ₀ u, (1, stations) each, m/s."""

    lagged: AnyExpr  #: Σ A_i x_i, by lag states
    ahead: AnyExpr  #: φ₀ e, by an entry state in front of them
    entered: AnyExpr  #: by the entry states of Küssner's function


def gained(lag: IndicialLag | None, entry: GustEntry | None, values: AnyExpr) -> Gained:
    """What the states of the air add to u_e.

    Parameters
    ----------
    lag, entry : IndicialLag, GustEntry or None
        As of `UnsteadyAirload`.
    values : SX, MX or DM, shape (poles and entry states, stations)
        Of the lag states, then of the entry states.
    """
    amplitudes = np.zeros(0) if lag is None else lag.amplitudes
    of_lag, of_entry = values[: len(amplitudes), :], values[len(amplitudes) :, :]
    lagged = ahead = entered = ca.DM.zeros(1, values.shape[1])
    if lag is not None:
        lagged = ca.DM(amplitudes).T @ of_lag
    if entry is not None and entry.kind == "lag":
        ahead = (1 - float(np.sum(amplitudes))) * of_entry
    elif entry is not None:
        entered = ca.DM(entry.poles.amplitudes).T @ of_entry
    return Gained(lagged, ahead, entered)


def decays(poles: Sequence[float], sizes: Sequence[int], chords: Sequence[AnyExpr]) -> AnyExpr:
    """Rates κ/b at which states follow per metre travelled, (states, 1), 1/m.

    Parameters
    ----------
    poles : sequence of float
        Rates κ of the poles of lag and entry, per half chord travelled.
    sizes : sequence of int
        Number of states of each.
    chords : sequence of number or symbol
        At the stations, m; b is half their mean.
    """
    half = sum(chords) / (2 * len(chords))
    return ca.DM(np.repeat(poles, sizes)) / half
