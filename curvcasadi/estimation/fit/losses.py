"""Losses of residuals: squares, and two that gross outliers do not pull at."""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np

from curvcasadi.symbolic.expressions import Array

LossName = Literal["squared", "huber", "cauchy"]

#: Standard deviations from which a residual counts less: 95 % efficiency on Gaussian noise.
SCALES = {"squared": np.inf, "huber": 1.345, "cauchy": 2.3849}


class Loss(NamedTuple):
    """A loss ρ(u²) of the size u of a residual, ρ ≈ u² for small u; u in standard deviations."""

    name: LossName
    scale: float

    def value(self, u: Array) -> Array:
        """ρ."""
        if self.name == "huber":
            return np.where(u <= self.scale, u**2, self.scale * (2 * u - self.scale))
        if self.name == "cauchy":
            return np.asarray(self.scale**2 * np.log1p((u / self.scale) ** 2))
        return np.asarray(u**2)

    def weight(self, u: Array) -> Array:
        """ρ', the factor of the squares in iteratively reweighted least squares: at most 1."""
        if self.name == "huber":
            return np.asarray(self.scale / np.maximum(u, self.scale))
        if self.name == "cauchy":
            return np.asarray(1 / (1 + (u / self.scale) ** 2))
        return np.ones_like(u)

    def curvature(self, u: Array) -> Array:
        """(ρ' + 2 u² ρ'')/ρ': curvature along a residual over that across it; at most 1."""
        if self.name == "huber":
            return np.where(u <= self.scale, 1.0, 0.0)
        if self.name == "cauchy":
            part = (u / self.scale) ** 2
            return np.asarray((1 - part) / (1 + part))
        return np.ones_like(u)
