"""Families of scalar functions on [0, 1], from which curvature bases are made.

Every family is dimensionless, has `n` functions, `breaks` (interior points at which its smoothness
ends, so that no grid element crosses them) and maps a station xi = s/L to the (n,) function values.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from typing import Any, Protocol

import numpy as np
from numpy.polynomial import chebyshev, legendre

from curvcasadi.symbolic.expressions import Array, choice, count, increasing_stations, numbers


class Family(Protocol):
    """What a curvature basis asks of a family; any such object serves."""

    @property
    def n(self) -> int:
        """Number of functions."""
        ...

    @property
    def breaks(self) -> tuple[float, ...]:
        """Interior stations at which the smoothness of a function ends; elements end there."""
        ...

    @property
    def labels(self) -> tuple[str, ...]:
        """A name per function."""
        ...

    def __call__(self, xi: float) -> Array:
        """Values (n,) of the functions, dimensionless, at a station xi in [0, 1]."""
        ...


@dataclass(frozen=True)
class _Counted:
    """A family given by its number of functions."""

    n: int

    def __post_init__(self) -> None:
        count(f"{type(self).__name__}.n", self.n)

    @property
    def breaks(self) -> tuple[float, ...]:
        return ()

    @property
    def knots(self) -> tuple[float, ...]:
        """Interior stations between which every function is smooth."""
        return self.breaks

    @property
    def labels(self) -> tuple[str, ...]:
        return tuple(f"{type(self).__name__} {k}" for k in range(self.n))


@dataclass(frozen=True)
class Legendre(_Counted):
    """Legendre polynomials P_k(2 xi − 1), k = 0 … n − 1.

    Attributes
    ----------
    n : int
        Number of functions, and of weights.
    """

    def __call__(self, xi: float) -> Array:
        return np.asarray(legendre.legval(2 * xi - 1, np.eye(self.n)))


@dataclass(frozen=True)
class Chebyshev(_Counted):
    """Chebyshev polynomials T_k(2 xi − 1), k = 0 … n − 1.

    Attributes
    ----------
    n : int
        Number of functions, and of weights.
    """

    def __call__(self, xi: float) -> Array:
        return np.asarray(chebyshev.chebval(2 * xi - 1, np.eye(self.n)))


@dataclass(frozen=True)
class Monomial(_Counted):
    """Powers xi^k, k = 0 … n − 1.

    Attributes
    ----------
    n : int
        Number of functions, and of weights.
    """

    def __call__(self, xi: float) -> Array:
        return np.asarray(xi ** np.arange(self.n), dtype=float)


@dataclass(frozen=True)
class FreeTip(_Counted):
    """Functions (1 − xi)^order P_k(2 xi − 1), k = 0 … n − 1, for a wing whose tip carries nothing.

    At a free end bending moment and shear force vanish, hence the bending curvature and its slope:
    order 2, for the bending channels. The torsional moment alone vanishes there: order 1, for
    torsion. A beam with these functions cannot hold a body, a force or a moment at its tip, and
    refuses them.

    Attributes
    ----------
    n : int
        Number of functions.
    order : {1, 2}
        Order of their common zero at the tip: 2 for bending, 1 for torsion.
    """

    order: int = 2

    def __post_init__(self) -> None:
        super().__post_init__()
        choice("FreeTip.order", self.order, (1, 2))

    @property
    def tip_order(self) -> int:
        """Order of the common zero at the tip."""
        return self.order

    def __call__(self, xi: float) -> Array:
        return np.asarray((1 - xi) ** self.order * legendre.legval(2 * xi - 1, np.eye(self.n)))


@dataclass(frozen=True)
class PiecewiseConstant(_Counted):
    """One on the k-th of n equal segments, zero elsewhere; right-continuous, the tip included.

    Attributes
    ----------
    n : int
        Number of segments, and of weights.
    """

    @property
    def breaks(self) -> tuple[float, ...]:
        """Boundaries between the segments."""
        return tuple(k / self.n for k in range(1, self.n))

    def __call__(self, xi: float) -> Array:
        segment = np.searchsorted(self.breaks, xi, side="right")
        return np.asarray(np.eye(self.n)[segment])


@dataclass(frozen=True)
class BSpline(_Counted):
    """Clamped B-splines on uniform knots; they sum to one.

    Attributes
    ----------
    n : int
        Number of functions, at least degree + 1.
    degree : int
        Polynomial degree, at least 0; 3 is cubic.
    """

    degree: int = 3

    def __post_init__(self) -> None:
        count("BSpline.degree", self.degree, least=0)
        count("BSpline.n", self.n, least=self.degree + 1)

    @property
    def breaks(self) -> tuple[float, ...]:
        """Interior knots."""
        segments = self.n - self.degree
        return tuple(k / segments for k in range(1, segments))

    def __call__(self, xi: float) -> Array:
        from scipy.interpolate import BSpline as ScipyBSpline

        end = np.ones(self.degree + 1)
        knots = np.concatenate([0 * end, self.breaks, end])
        return np.asarray(ScipyBSpline(knots, np.eye(self.n), self.degree)(xi))


@dataclass(frozen=True)
class CantileverModes(_Counted):
    """Curvatures φ''_k of the bending modes of a uniform cantilever, scaled to 1 at the root.

    φ''(xi) ∝ cosh βxi + cos βxi − σ (sinh βxi + sin βxi), cos β cosh β = −1,
    σ = (cosh β + cos β)/(sinh β + sin β); they vanish at the free tip. The growing exponential is
    factored out, so that high modes do not cancel.

    Attributes
    ----------
    n : int
        Number of modes, and of weights.
    """

    def __call__(self, xi: float) -> Array:
        beta = np.array([_cantilever_root(k) for k in range(self.n)])
        decay = np.exp(-beta)
        scale = 1 - decay**2 + 2 * decay * np.sin(beta)  # 2 e^−β (sinh β + sin β)
        rising = (np.sin(beta) - np.cos(beta) - decay) / scale  # (1 − σ) e^β/2
        sigma = (1 + decay**2 + 2 * decay * np.cos(beta)) / scale
        return np.asarray(
            rising / 2 * np.exp(beta * (xi - 1))
            + (1 + sigma) / 4 * np.exp(-beta * xi)
            + (np.cos(beta * xi) - sigma * np.sin(beta * xi)) / 2
        )


@cache
def _cantilever_root(k: int) -> float:
    """k-th positive root, from 0, of cos β cosh β = −1."""
    from scipy.optimize import brentq

    return float(
        brentq(
            lambda beta: np.cos(beta) + 1 / np.cosh(beta), k * np.pi, (k + 1) * np.pi, xtol=1e-15
        )
    )


@dataclass(frozen=True, eq=False)
class Tabulated:
    """A family from samples: one function per column, interpolated.

    Attributes
    ----------
    xi : array, shape (m,)
        Stations s/L of the samples, increasing from 0 to 1.
    values : array, shape (m, n)
        Samples, one function per column.
    degree : {1, 3}
        1 is linear, with a break at every interior sample; 3 is a cubic spline without breaks.
    """

    xi: Array
    values: Array
    degree: int = 1
    _spline: Callable[[float], Any] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        choice("Tabulated.degree", self.degree, (1, 3))
        stations = increasing_stations("Tabulated.xi", self.xi)
        values = numbers("Tabulated.values", self.values)
        xi, first, of_sample = np.unique(stations, return_index=True, return_inverse=True)
        if len(xi) <= self.degree:
            raise ValueError(
                f"Tabulated.xi: expected more than {self.degree} increasing stations, "
                f"found {xi.tolist()}"
            )
        if values.ndim != 2 or len(values) != len(stations) or values.shape[1] == 0:
            raise ValueError(
                f"Tabulated.values: expected shape ({len(stations)}, n), found {values.shape}"
            )
        again = values[first][of_sample]
        for k in np.flatnonzero(np.any(np.abs(values - again) > 1e-9 * np.abs(again), axis=1)):
            raise ValueError(
                f"Tabulated.values: expected one sample at xi = {stations[k]:g}, "
                f"found {again[k].tolist()} and {values[k].tolist()}"
            )
        values = values[first]
        for name, array in (("xi", xi), ("values", values)):
            array.setflags(write=False)
            object.__setattr__(self, name, array)
        from scipy.interpolate import make_interp_spline

        object.__setattr__(self, "_spline", make_interp_spline(xi, values, k=self.degree))

    @property
    def n(self) -> int:
        """Number of functions."""
        return int(self.values.shape[1])

    @property
    def breaks(self) -> tuple[float, ...]:
        """Interior samples of a linear table; a cubic spline has none."""
        return tuple(float(x) for x in self.xi[1:-1]) if self.degree == 1 else ()

    @property
    def labels(self) -> tuple[str, ...]:
        """A name per function."""
        return tuple(f"Tabulated {k}" for k in range(self.n))

    @property
    def knots(self) -> tuple[float, ...]:
        """Interior samples: between two of them a function is one polynomial."""
        return tuple(float(x) for x in self.xi[1:-1])

    def __call__(self, xi: float) -> Array:
        return np.asarray(self._spline(xi))
