"""A basis whose weights describe bending moments instead of curvatures."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise

import casadi as ca
import numpy as np
from numpy.polynomial import legendre

from curvcasadi.beam.basis import CHANNELS, ChannelBasis
from curvcasadi.beam.families import Family
from curvcasadi.beam.section import Section
from curvcasadi.symbolic.expressions import Array, instance, is_numeric


@dataclass(frozen=True, eq=False)
class ComplianceBasis:
    """Curvatures of smooth moments: K = C(xi)⁻¹ C̄ Ψ(xi) q, for a section that jumps.

    Ψ is the `ChannelBasis` of the families. The moments C (K − K_0) = C̄ Ψ q are then smooth along
    the span where the stiffness C jumps, as the moments of a real wing are. C̄ is diagonal, the
    harmonic mean of the stiffness, 1/∫ (C⁻¹)_kk dxi, so that weights keep the unit and the size of
    curvatures. On a uniform section without couplings the basis is the `ChannelBasis` itself. The
    couplings of the section deform channels without a family of their own, too.

    The basis is numeric: it is made of a section of numbers. A beam may have another section, one
    with design symbols for instance, whose stiffness the basis then fits approximately.

    Attributes
    ----------
    section : Section
        Section whose compliance shapes the basis, usually that of the beam. Its jumps are breaks of
        the basis.
    torsion, out_of_plane, in_plane : Family, optional
        Families of the moments about the local x, y and z axes, such as `Legendre(4)`. None leaves
        that moment zero.
    """

    section: Section
    torsion: Family | None = None
    out_of_plane: Family | None = None
    in_plane: Family | None = None
    _moments: ChannelBasis = field(init=False, repr=False)
    _scale: Array = field(init=False, repr=False)

    def __post_init__(self) -> None:
        instance("ComplianceBasis.section", self.section, Section)
        families = {name: getattr(self, name) for name in CHANNELS}
        object.__setattr__(self, "_moments", ChannelBasis(**families))
        object.__setattr__(self, "_scale", 1 / self._mean_compliance())

    def __str__(self) -> str:
        return f"ComplianceBasis whose moments are a {self._moments}"

    def _mean_compliance(self) -> Array:
        """∫ (C⁻¹)_kk dxi, (3, 1): Gauss points between the jumps of the section."""
        points, weights = legendre.leggauss(_POINTS)
        total = np.zeros((3, 1))
        for a, b in pairwise([0.0, *self.section.breaks, 1.0]):
            for x, weight in zip(points, weights, strict=True):
                inverse = np.linalg.inv(self._stiffness((a + b) / 2 + (b - a) / 2 * x))
                total += weight * (b - a) / 2 * np.diag(inverse)[:, None]
        return total

    def _stiffness(self, xi: float) -> Array:
        stiffness = self.section.stiffness(xi)
        if not is_numeric(stiffness):
            symbols = ", ".join(map(str, ca.symvar(stiffness)))
            raise ValueError(f"ComplianceBasis.section: expected numbers, found symbols: {symbols}")
        return np.asarray(stiffness.full())

    @property
    def n(self) -> int:
        """Number of functions."""
        return self._moments.n

    @property
    def labels(self) -> tuple[str, ...]:
        """A name for each function, such as "torsion: Legendre 0"."""
        return self._moments.labels

    @property
    def breaks(self) -> tuple[float, ...]:
        """Interior xi at which the section jumps or a family's smoothness ends."""
        return tuple(sorted({*self.section.breaks, *self._moments.breaks}))

    @property
    def tip_orders(self) -> dict[str, int]:
        """As of `ChannelBasis`."""
        return self._moments.tip_orders

    def __call__(self, xi: float) -> Array:
        moments = self._scale * self._moments(xi)
        return np.asarray(np.linalg.solve(self._stiffness(xi), moments))


#: Gauss points between two jumps. They set the size of the weights alone.
_POINTS = 12
