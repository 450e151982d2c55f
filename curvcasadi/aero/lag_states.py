"""Indicial lag states: the memory that the wake of a strip leaves.

With W the speed of a strip through the air, b half its chord, and u the velocity of the air that
its circulation follows (W times the angle of attack at three quarters of the chord), Wagner's
function 1 − Σ A_i exp(−b_i s) of the distance s = ∫ W/b dt becomes one state a pole,

    dx_i/dt = b_i W/b (u − x_i),      u_e = φ₀ u + Σ A_i x_i,      φ₀ = 1 − Σ A_i = 1/2

The states are velocities in section axes: they need no rotation, and in steady flow x_i = u. Along
the span they are a set per station or weights of a few Legendre functions.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import ArrayLike, NDArray

from curvcasadi.symbolic.expressions import Array, choice, count, numbers


class Poles(NamedTuple):
    """Amplitudes and rates of exponentials in the distance travelled, in half chords."""

    amplitudes: Array
    rates: Array


#: Wagner's function by two poles (R. T. Jones), three and four (least largest error up to k = 2).
WAGNER = {
    2: Poles(np.array([0.165, 0.335]), np.array([0.0455, 0.3])),
    3: Poles(np.array([0.07366, 0.28766, 0.13868]), np.array([0.02268, 0.14748, 0.55523])),
    4: Poles(
        np.array([0.02931, 0.14983, 0.25207, 0.06879]),
        np.array([0.00972, 0.06958, 0.23781, 0.76691]),
    ),
}


@dataclass(frozen=True, eq=False, kw_only=True)
class IndicialLag:
    """Lag of the circulation behind the angle of attack, as real poles of Wagner's function.

    The largest error of Theodorsen's function C(k) for reduced frequencies k up to 2 is 2.34 % with
    two poles, 0.55 % with three and 0.23 % with four.

    Attributes
    ----------
    poles : int
        Number of poles: 2, 3 or 4.
    modes : int or None
        Number of Legendre functions along the span that carry the states of one pole; None for a
        state per pole and aerodynamic station.
    """

    poles: int = 3
    modes: int | None = 3

    def __post_init__(self) -> None:
        choice("IndicialLag.poles", self.poles, tuple(WAGNER))
        if self.modes is not None:
            count("IndicialLag.modes", self.modes)

    @property
    def amplitudes(self) -> Array:
        """Amplitudes A_i of the poles, (poles,); they sum to one half."""
        return WAGNER[self.poles].amplitudes.copy()

    @property
    def rates(self) -> Array:
        """Rates b_i of the poles, (poles,), per half chord travelled."""
        return WAGNER[self.poles].rates.copy()

    def wagner(self, s: ArrayLike) -> Array:
        """Circulation after a step of the angle of attack, over its final value.

        Parameters
        ----------
        s : array
            Distance travelled since the step, half chords.

        Returns
        -------
        ndarray
            1 − Σ A_i exp(−b_i s), of the shape of `s`.
        """
        distance = numbers("s", s)
        decay = np.exp(-np.multiply.outer(distance, self.rates))
        return np.asarray(1 - decay @ self.amplitudes)

    def theodorsen(self, k: ArrayLike) -> NDArray[np.complex128]:
        """Circulation over its quasi-steady value in harmonic motion: the approximation of C(k).

        Parameters
        ----------
        k : array
            Reduced frequency ω b/W.

        Returns
        -------
        ndarray of complex numbers
            1 − Σ A_i i k/(i k + b_i), of the shape of `k`.
        """
        s = 1j * numbers("k", k)[..., None]
        return np.asarray(1 - (s / (s + self.rates)) @ self.amplitudes)


class SpanFunctions(NamedTuple):
    """How the states of one pole make values at stations, and rates there those of the states."""

    values: Array  #: (stations, states): x(ξ) = values @ states
    rates: Array  #: (states, stations): d states/dt = rates @ dx/dt(ξ)


def span_functions(modes: int | None, xi: Array, measures: Array) -> SpanFunctions:
    """Legendre functions of `modes` at the stations, with the weighted least-squares projection.

    Parameters
    ----------
    modes : int or None
        Number of functions; None for a state per station.
    xi : ndarray, shape (N,)
        Stations s/L.
    measures : ndarray, shape (N,)
        Span that each station stands for; positive.

    Raises
    ------
    ValueError
        If there are fewer stations than functions.
    """
    if modes is None:
        each = np.eye(len(xi))
        return SpanFunctions(each, each)
    if modes > len(xi):
        raise ValueError(
            f"IndicialLag.modes: expected at most {len(xi)}, the aerodynamic stations that must "
            f"resolve the lag functions, found {modes}; use more stations"
        )
    values = np.asarray(legendre.legvander(2 * xi - 1, modes - 1), dtype=float)
    weighted = values.T * measures
    rates = np.linalg.solve(weighted @ values, weighted)
    return SpanFunctions(values, np.asarray(rates, dtype=float))
