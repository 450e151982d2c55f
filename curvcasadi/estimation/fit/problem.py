"""The least-squares problem of one sample: rows over their standard deviations."""

from __future__ import annotations

import numpy as np

from curvcasadi.beam.beam import Beam, numeric_length
from curvcasadi.estimation.fit.gauss_newton import UNDEFINED, Linearization
from curvcasadi.estimation.fit.losses import Loss
from curvcasadi.estimation.observability import Observability, observability
from curvcasadi.estimation.sensor_model import SensorModel
from curvcasadi.sensors.measurement import check_in_view
from curvcasadi.symbolic.expressions import Array

#: Curvature of a loss along a residual, over that across it, that a step relies on at least.
_LEAST_CURVATURE = 0.01


class FitProblem:
    """Rows of the least-squares problem over their standard deviations."""

    def __init__(
        self,
        beam: Beam,
        model: SensorModel,
        rates: dict[str, Array],
        measured: Array,
        prior: tuple[Array, Array] | None,
        loss: Loss,
    ) -> None:
        self.beam, self.model, self.measured = beam, model, measured
        self.prior, self.loss = prior, loss
        self.length = numeric_length(beam, "fit_shape")
        self.present = model.present(measured)
        if not np.any(self.present):
            raise ValueError("measurements: expected one or more, found only missing samples")
        self.groups = model.groups[self.present]
        self._rates = rates
        self._noise = model.channels.noise

    def check_start(self, q: Array) -> None:
        """ValueError unless cameras that have a sample see their points."""
        names = [part.name for part in self.model.channels.layout.parts]
        there = [names[i] for i in np.unique(self.groups)]
        where = " where the fit starts: give it a q_guess from which the camera sees it"
        check_in_view(self.model.sensors, self.beam, q, where, there)

    def residual(self, q: Array) -> tuple[Array, Array]:
        """Residual and slope of the samples that are there, over the noise."""
        residual, slope = self.model.evaluate({"q": q, **self._rates}, self.measured)
        noise = self._noise[self.present]
        return residual[self.present] / noise, slope[self.present] / noise[:, None]

    def prior_rows(self, q: Array) -> tuple[Array, Array]:
        """Residual and slope of the prior, over its standard deviations."""
        if self.prior is None:
            return np.zeros(0), np.zeros((0, q.size))
        mean, whitener = self.prior
        return whitener @ (q - mean), whitener

    def sizes(self, residual: Array) -> tuple[Array, Array]:
        """Number of readings and root mean square of the residual, by sensor."""
        counts = np.bincount(self.groups, minlength=len(self.model.sensors))
        squares = np.bincount(self.groups, residual**2, minlength=len(counts))
        return counts.astype(float), np.sqrt(squares / np.maximum(counts, 1))

    def linearize(self, q: Array) -> Linearization:
        """The problem at `q`, with the gradient of the loss and its curvature, where positive.

        B. Triggs et al., "Bundle Adjustment – A Modern Synthesis", 2000, section 4.3: along the
        residual r of a sensor rows are scaled by √ρ' (1 − β), (1 − β)² = (ρ' + 2 u² ρ'')/ρ', across
        it by √ρ'; with the squares alone, β = 0, iterations are many.
        """
        residual, slope = self.residual(q)
        prior_residual, prior_slope = self.prior_rows(q)
        if np.isnan(residual).any():  # out of a camera's view, where no step should lead
            return UNDEFINED
        counts, sizes = self.sizes(residual)
        seen = self.observability(np.vstack([slope, prior_slope])).seen

        root = np.sqrt(self.loss.weight(sizes))[self.groups]
        along = np.sqrt(np.maximum(self.loss.curvature(sizes), _LEAST_CURVATURE))[self.groups]
        lengths = np.sqrt(counts) * sizes
        direction = residual / np.where(lengths > 0, lengths, 1.0)[self.groups]
        same = self.groups[:, None] == self.groups
        projected = direction[:, None] * (same @ (direction[:, None] * slope))
        slope = root[:, None] * (slope - (1 - along)[:, None] * projected)
        return Linearization(
            cost=float(counts @ self.loss.value(sizes) + prior_residual @ prior_residual) / 2,
            residual=np.concatenate([root / along * residual, prior_residual]),
            slope=np.vstack([slope, prior_slope]),
            seen=seen,
        )

    def observability(self, slope: Array) -> Observability:
        """What rows of derivatives over the noise see."""
        return observability(slope, self.length, self.beam.basis.labels)
