"""Curvature bases: the matrix Φ of K = K_0 + Φ q (Eq. 3).

A basis has `n` functions; called with a station xi = s/L it gives Φ(xi), (3, n): a row each for
torsion K_x, out-of-plane bending K_y and in-plane bending K_z, local axes; one column per weight.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from curvcasadi.beam.families import Family
from curvcasadi.symbolic.expressions import (
    COINCIDENT,
    Array,
    Number,
    count,
    is_numeric,
    numbers,
    station,
)
from curvcasadi.symbolic.text import grouped

CHANNELS = ("torsion", "out_of_plane", "in_plane")


class Basis(Protocol):
    """What a beam asks of a basis; any such object serves."""

    @property
    def n(self) -> int:
        """Number of functions, which is that of the weights."""
        ...

    @property
    def labels(self) -> tuple[str, ...]:
        """A name per function."""
        ...

    @property
    def breaks(self) -> tuple[float, ...]:
        """Interior stations at which the smoothness of a function ends; elements end there."""
        ...

    def __call__(self, xi: float) -> Array:
        """Φ (3, n) at a station xi in [0, 1]; rows K_x, K_y, K_z, a column per weight."""
        ...


@dataclass(frozen=True, eq=False)
class ChannelBasis:
    """A family of functions for each channel; q stacks torsion, out_of_plane, in_plane.

    Attributes
    ----------
    torsion : Family or None
        Functions of K_x, such as `Legendre(3)`; None leaves K_0 there.
    out_of_plane : Family or None
        Functions of K_y.
    in_plane : Family or None
        Functions of K_z.
    """

    torsion: Family | None = None
    out_of_plane: Family | None = None
    in_plane: Family | None = None

    def __post_init__(self) -> None:
        if not self._channels():
            raise ValueError(
                "ChannelBasis: expected a family for torsion, out_of_plane or in_plane, found none"
            )
        for name, _, family in self._channels():
            if not (callable(family) and hasattr(family, "n")):
                raise ValueError(
                    f"ChannelBasis.{name}: expected a family such as Legendre(4), found {family!r}"
                )

    def __str__(self) -> str:
        return _told(self)

    def _channels(self) -> list[tuple[str, int, Family]]:
        families = (self.torsion, self.out_of_plane, self.in_plane)
        return [
            (name, row, family)
            for row, (name, family) in enumerate(zip(CHANNELS, families, strict=True))
            if family is not None
        ]

    @property
    def n(self) -> int:
        """Number of functions, and of weights."""
        return sum(family.n for _, _, family in self._channels())

    @property
    def labels(self) -> tuple[str, ...]:
        """A name per weight: its channel and function."""
        return tuple(
            f"{name}: {label}" for name, _, family in self._channels() for label in family.labels
        )

    @property
    def tip_orders(self) -> dict[str, int]:
        """Order of the zero at the tip of each channel whose functions vanish there."""
        orders = {name: getattr(family, "tip_order", 0) for name, _, family in self._channels()}
        return {name: order for name, order in orders.items() if order}

    @property
    def breaks(self) -> tuple[float, ...]:
        """Interior stations at which a function or its slope jumps."""
        return tuple(sorted({x for _, _, family in self._channels() for x in family.breaks}))

    @property
    def knots(self) -> tuple[float, ...] | None:
        """Interior stations between which every function is smooth; None if a family has none."""
        knots = [getattr(family, "knots", None) for _, _, family in self._channels()]
        if any(of_family is None for of_family in knots):
            return None
        return tuple(sorted({x for of_family in knots for x in of_family or ()}))

    def __call__(self, xi: float) -> Array:
        phi = np.zeros((3, self.n))
        start = 0
        for _, row, family in self._channels():
            phi[row, start : start + family.n] = family(xi)
            start += family.n
        return phi


@dataclass(frozen=True, eq=False)
class VectorBasis:
    """Coupled basis functions, each a curvature vector along the span, as Eq. 3 has them.

    Attributes
    ----------
    function : callable
        Function of xi that returns the (3, n) values of all basis functions, dimensionless.
    n : int
        Number of functions, and of weights.
    breaks : tuple of float
        Interior stations at which a function or its slope jumps.
    labels : tuple of str
        A name per function; "coupled: k" unless given.
    """

    function: Callable[[float], Array]
    n: int
    breaks: tuple[float, ...] = ()
    labels: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        count("VectorBasis.n", self.n)
        if not callable(self.function):
            raise ValueError(f"VectorBasis.function: expected a function, found {self.function!r}")
        breaks = {station("VectorBasis.breaks", x) for x in self.breaks}
        object.__setattr__(self, "breaks", tuple(sorted(breaks - {0.0, 1.0})))
        labels = tuple(self.labels) or tuple(f"coupled: {k}" for k in range(self.n))
        if len(labels) != self.n:
            raise ValueError(f"VectorBasis.labels: expected {self.n} names, found {self.labels}")
        object.__setattr__(self, "labels", labels)
        for xi in (0.0, 0.5, 1.0):
            self(xi)

    def __repr__(self) -> str:
        return f"<{_told(self)}>"

    def __str__(self) -> str:
        return _told(self)

    def __call__(self, xi: float) -> Array:
        phi = numbers(f"VectorBasis.function at xi = {xi}", self.function(xi))
        if phi.shape != (3, self.n):
            raise ValueError(
                f"VectorBasis.function: expected finite (3, {self.n}) at xi = {xi}, "
                f"found {phi.tolist()}"
            )
        return phi


@dataclass(frozen=True, eq=False)
class MirroredBasis:
    """The basis of the other half wing: rows by diag(−1, −1, 1), weights unchanged."""

    original: Basis

    def __str__(self) -> str:
        return f"mirror image of {self.original}"

    @property
    def n(self) -> int:
        return self.original.n

    @property
    def labels(self) -> tuple[str, ...]:
        return self.original.labels

    @property
    def breaks(self) -> tuple[float, ...]:
        return self.original.breaks

    @property
    def knots(self) -> tuple[float, ...] | None:
        """As of `ChannelBasis`."""
        return getattr(self.original, "knots", None)

    @property
    def tip_orders(self) -> dict[str, int]:
        """As of `ChannelBasis`."""
        return dict(getattr(self.original, "tip_orders", {}))

    def __call__(self, xi: float) -> Array:
        return np.diag([-1.0, -1.0, 1.0]) @ self.original(xi)


def _told(basis: Basis) -> str:
    """A basis in a line."""
    return f"{type(basis).__name__} of {basis.n} functions: {grouped(basis.labels)}"


def refuse_at_tip(
    basis: Basis,
    load: str,
    xi: float,
    *,
    force: Number = 0.0,
    offset: Number = 0.0,
    moment: Number = 0.0,
) -> None:
    """Refuse what acts at the tip of a beam whose functions vanish there, as `FreeTip`'s do.

    Parameters
    ----------
    basis : Basis
        Basis of the beam.
    load : str
        What acts, as the message names it.
    xi : float
        Station s/L at which it acts; inboard of the tip everything is held.
    force, offset, moment : number, array or symbol
        A force or mass, where it acts from the reference curve, and a moment or inertia. Zeros are
        none.
    """
    sheared = not _is_zero(force)
    bent = not _is_zero(moment) or (sheared and not _is_zero(offset))
    for channel, order in getattr(basis, "tip_orders", {}).items() if xi >= 1 - COINCIDENT else ():
        if bent or (sheared and order >= 2 and channel != "torsion"):
            raise ValueError(
                f"{load}: expected none at the tip, where the functions of basis.{channel} vanish "
                f"(FreeTip, order {order}) and a load cannot deform the beam; use Legendre there"
            )


def _is_zero(value: Number) -> bool:
    return is_numeric(value) and not np.any(numbers("value", value))
