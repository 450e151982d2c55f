"""Largest responses of a linear model, in frequency and to a gust, and their design derivatives.

At a peak the response does not change with its frequency or time, so that its derivatives by
parameters are those at that frequency or time.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from curvcasadi.control.design import DesignDerivatives
from curvcasadi.control.linearize import LinearModel
from curvcasadi.symbolic.expressions import (
    Array,
    choice,
    count,
    instance,
    number,
    numbers,
    positive,
)

#: Samples of a gust, and frequencies at which a peak is looked for, at least.
SAMPLES = 400
#: Relative tolerance of the time or the frequency of a peak.
TOLERANCE = 1e-12


@dataclass(frozen=True, eq=False, kw_only=True)
class Peak:
    """The largest value of a response.

    Attributes
    ----------
    at : float
        Where it is: frequency, rad/s, or time, s.
    value : float
        Amplitude over that of the source, or change of the output with its sign.
    derivatives : array, shape (m,)
        By each of `DesignDerivatives.labels`.
    """

    at: float
    value: float
    derivatives: Array


def response_peak(
    derived: DesignDerivatives,
    omega: tuple[float, float],
    output: str,
    entry: int = 0,
    source: str = "gust",
) -> Peak:
    """The largest amplitude of a frequency response between two frequencies.

    Parameters
    ----------
    derived : DesignDerivatives
        Of a linear model.
    omega : tuple of float
        Lowest and highest frequency, rad/s.
    output : str
        Name of a part of y.
    entry : int
        Entry of that part.
    source : str
        Name of a part of u or p with one entry.

    Returns
    -------
    Peak
        Frequency, amplitude over that of the source, and its derivatives by the parameters.
    """
    from scipy.optimize import brentq

    a, b, c, d = _system(instance("derived", derived, DesignDerivatives), output, entry, source)
    low, high = (float(x) for x in numbers("omega", omega).ravel())
    if not 0 <= low < high:
        raise ValueError(f"omega: expected two frequencies that increase, found {omega}")
    unit = np.eye(len(a.value))

    def solved(w: float) -> tuple[complex, Any, Any]:
        pencil = 1j * w * unit - a.value
        x, y = np.linalg.solve(pencil, b.value), np.linalg.solve(pencil.T, c.value)
        return complex(c.value @ x + d.value), x, y

    def slope(w: float) -> float:  # of |H|²/2, with dH/dω = −i Y X
        h, x, y = solved(w)
        return float(np.real(np.conj(h) * -1j * (y @ x)))

    roots = np.abs(np.linalg.eigvals(a.value).imag)
    grid = np.unique(np.r_[np.linspace(low, high, SAMPLES), roots[(roots > low) & (roots < high)]])
    k = int(np.argmax([abs(solved(w)[0]) for w in grid]))
    at = float(grid[k])
    if 0 < k < len(grid) - 1:
        at = float(brentq(slope, grid[k - 1], grid[k + 1], xtol=TOLERANCE * high))
    h, x, y = solved(at)
    changes = c.slopes @ x + d.slopes + (a.slopes @ x + b.slopes) @ y
    slopes = np.real(np.conj(h) * changes) / abs(h)
    return Peak(at=at, value=abs(h), derivatives=slopes)


def gust_peak(
    derived: DesignDerivatives,
    gust: Callable[[float], Any],
    duration: float,
    output: str,
    entry: int = 0,
    source: str = "gust",
) -> Peak:
    """The largest change of an output in a gust, by the linear model.

    Parameters
    ----------
    derived : DesignDerivatives
        Of a linear model of a stable wing with a gust.
    gust : callable
        Velocity of the air, m/s upward, as a function of the time, s, such as a `OneMinusCosine`;
        linear between 400 samples.
    duration : float
        The time in which the peak is looked for, s.
    output : str
        Name of a part of y.
    entry : int
        Entry of that part.
    source : str
        Name of a part of u or p with one entry.

    Returns
    -------
    Peak
        Time, change from the steady value, and its derivatives by the parameters.
    """
    from scipy.linalg import expm
    from scipy.optimize import brentq

    a, b, c, d = _system(instance("derived", derived, DesignDerivatives), output, entry, source)
    n, m = len(a.value), len(a.slopes)
    times = np.linspace(0.0, float(positive("duration", duration)), SAMPLES + 1)
    if not callable(gust):
        raise ValueError(f"gust: expected a function of the time, found {gust!r}")
    velocities = np.array([number(f"gust({t:g})", gust(float(t))) for t in times])
    step = times[1]
    # State, its derivatives, and the gust with its rate: ẋ = A x + b w, Ṡ = A S + dA x + db w.
    size = n * (1 + m)
    flow = np.zeros((size + 2, size + 2))
    flow[:size, :size] = np.kron(np.eye(1 + m), a.value)
    flow[n:size, :n] = a.slopes.reshape(m * n, n)
    flow[:n, size], flow[n:size, size], flow[size, size + 1] = b.value, b.slopes.ravel(), 1.0
    row = np.concatenate([c.value, np.zeros(m * n), [d.value, 0.0]])

    across = expm(step * flow)
    states = [np.zeros(size + 2)]
    for w, rate in zip(velocities, np.diff(velocities) / step, strict=False):
        states[-1][size:] = w, rate
        states.append(across @ states[-1])
    values = np.array([row @ state for state in states])
    k = int(np.argmax(np.abs(values)))

    kept = np.r_[0:n, size, size + 1]  # the state and the gust, without derivatives

    def rate_after(j: int, t: float) -> float:
        small = flow[np.ix_(kept, kept)]
        return float(row[kept] @ small @ expm((t - times[j]) * small) @ states[j][kept])

    at, peak = float(times[k]), states[k]
    for j in (k - 1, k):  # the interval in which the rate of the output passes zero
        if 0 <= j < SAMPLES:
            rates = [float(row @ flow @ state) for state in (states[j], across @ states[j])]
            if rates[0] * rates[1] < 0:
                at = brentq(
                    lambda t, j=j: rate_after(j, t),
                    times[j],
                    times[j + 1],
                    xtol=TOLERANCE * times[-1],
                )
                peak = expm((at - times[j]) * flow) @ states[j]
    slopes = c.slopes @ peak[:n] + peak[n:size].reshape(m, n) @ c.value + d.slopes * peak[size]
    return Peak(at=float(at), value=float(row @ peak), derivatives=slopes)


class _Part(NamedTuple):
    """An array and its derivatives, which stand first."""

    value: Array
    slopes: Array


def _system(
    derived: DesignDerivatives, output: str, entry: int, source: str
) -> tuple[_Part, _Part, _Part, _Part]:
    """A, b, c, d from one source to one entry of an output."""
    linear: LinearModel = derived.linear
    model = linear.model
    choice("output", output, [part.name for part in model.y.parts])
    rows = range(model.y.size)[model.y.slices[output]]
    if not 0 <= count("entry", entry, 0) < len(rows):
        raise ValueError(f"entry: expected one from 0 to {len(rows) - 1}, found {entry}")
    choice("source", source, [part.name for part in (*model.u.parts, *model.p.parts)])
    of_u = source in model.u.slices
    where = (model.u if of_u else model.p).slices[source]
    if where.stop - where.start != 1:
        raise ValueError(f"source: expected a part of one entry, found {source!r}")
    column, row = where.start, rows[entry]
    b, d = (linear.B, linear.D) if of_u else (linear.B_p, linear.D_p)
    db, dd = (derived.B, derived.D) if of_u else (derived.B_p, derived.D_p)
    return (
        _Part(linear.A, derived.A),
        _Part(b[:, column], db[:, :, column]),
        _Part(linear.C[row], derived.C[:, row]),
        _Part(d[row, column], dd[:, row, column]),
    )
