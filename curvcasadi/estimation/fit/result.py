"""The result of a fit, and what it says."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from curvcasadi.beam.beam import Beam
from curvcasadi.estimation.observability import Observability
from curvcasadi.kinematics.shape import Shape, unchecked_shape
from curvcasadi.sensors import Channels
from curvcasadi.symbolic.expressions import Array

#: Probability below which the message calls χ² too large, or too small.
_UNLIKELY = 1e-3
#: Factor of a robust loss below which the message names a sensor.
_LIGHT = 0.5


@dataclass(frozen=True, eq=False, kw_only=True)
class ShapeFit:
    """Weights of maximum likelihood, what is known of them, and what is not.

    Attributes
    ----------
    beam : Beam
        Wing that was fitted.
    q : DM, shape (n, 1)
        Curvature weights, rad/m.
    covariance : array, shape (n, n)
        Covariance of the weights, (rad/m)², prior included: the inverse of the information matrix.
        A weight that is not seen has an infinite variance and NaN for covariances.
    information : array, shape (n, n)
        Fisher information of the sensors alone, (rad/m)⁻², robust weights included.
    rank : int
        Number of combinations of weights, each known to pi/L or better, that sensors see.
    unseen : tuple of str
        The others, in words, a combination of weights each.
    channels : Channels
        Names and units of the residuals.
    residuals : array, shape (r,)
        Prediction minus measurement, `channels.residual_units`; NaN for missing samples.
    normalized_residuals : array, shape (r,)
        Residuals over the noise.
    chi_squared : float
        Sum of their squares, and of the distance from the prior.
    degrees_of_freedom : int
        Readings and prior minus weights that they move.
    p_value : float
        Probability of a larger χ² if the noise is as stated; NaN without degrees of freedom.
    loss_weights : dict of str to float
        Factor that a robust loss gave each sensor; NaN for a missing one.
    active_bounds : tuple of str
        Weights at a bound, which `covariance` treats as free.
    converged : bool
        Whether the descent ended at a minimum.
    iterations : int
        Gauss–Newton steps, of all starts.
    message : str
        Whether the readings fit, and what is not seen, in words.
    """

    beam: Beam
    q: ca.DM
    covariance: Array
    information: Array
    rank: int
    unseen: tuple[str, ...]
    channels: Channels
    residuals: Array
    normalized_residuals: Array
    chi_squared: float
    degrees_of_freedom: int
    p_value: float
    loss_weights: dict[str, float]
    active_bounds: tuple[str, ...]
    converged: bool
    iterations: int
    message: str

    @property
    def success(self) -> bool:
        """Whether the descent ended at a minimum that the beam can take."""
        return self.converged

    @property
    def labels(self) -> tuple[str, ...]:
        """A name per weight."""
        return self.beam.basis.labels

    @cached_property
    def shape(self) -> Shape:
        """The shape at `q`, which may bend elements too far if the fit has not converged."""
        return unchecked_shape(self.beam, self.q)

    @property
    def deviations(self) -> Array:
        """Standard deviations (n,) of the weights, rad/m; infinite for what is not seen."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    def summary(self) -> str:
        """Weights with standard deviations, residuals by sensor, and the message.

        Returns
        -------
        str
            Several lines.
        """
        width = max(len(label) for label in self.labels)
        lines = ["weights, rad/m"]
        for label, value, deviation in zip(
            self.labels, self.q.full().ravel(), self.deviations, strict=True
        ):
            known = f"± {deviation:.2e}" if np.isfinite(deviation) else "not seen"
            lines.append(f"  {label:<{width}}  {value:+.6f}  {known}")
        lines.append("residuals, prediction minus measurement")
        width = max(len(label) for label in self.channels.residual_labels)
        rows = zip(
            self.channels.residual_labels,
            self.residuals,
            self.channels.residual_units,
            self.normalized_residuals,
            strict=True,
        )
        for label, value, unit, normalized in rows:
            text = f"{value:+.3e} {unit}, {normalized:+.2f} σ" if np.isfinite(value) else "missing"
            lines.append(f"  {label:<{width}}  {text}")
        return "\n".join([*lines, self.message])

    def __repr__(self) -> str:
        return f"<ShapeFit: {self.message.partition(chr(10))[0]}>"

    def __str__(self) -> str:
        return self.summary()


def fit_message(
    *,
    converged: bool,
    too_bent: str,
    chi_test: tuple[float, int, float],
    loss: str,
    loss_weights: dict[str, float],
    active_bounds: Iterable[str],
    seen: Observability,
    prior: bool,
) -> str:
    """A line for each thing that a user should know.

    Parameters
    ----------
    too_bent : limit of the beam that the fit exceeds, in words
    chi_test : χ², degrees of freedom, probability of more
    """
    lines = [
        *_end_said(converged, too_bent),
        _test_said(*chi_test),
        *_loss_said(loss, loss_weights),
        *(f"held by a bound: {bound}" for bound in active_bounds),
        *_unseen_said(seen, prior),
    ]
    return "\n".join(lines)


def _end_said(converged: bool, too_bent: str) -> list[str]:
    said = []
    if not converged:
        said.append("not converged: no start led to a minimum; try a q_guess or a prior")
    if too_bent:
        said.append(f"the best fit is beyond the beam: {too_bent}")
    return said


def _test_said(squares: float, freedom: int, p_value: float) -> str:
    if not freedom:
        return "as many weights as readings: the residuals test nothing"
    verdict = "as the stated noise lets expect"
    if p_value < _UNLIKELY:
        verdict = "larger than the stated noise explains: outliers, more noise or too few weights"
    elif p_value > 1 - _UNLIKELY:
        verdict = "smaller than the stated noise lets expect, which may be too large"
    return f"χ² = {squares:.4g} with {freedom} degrees of freedom, p = {p_value:.3g}: {verdict}"


def _loss_said(loss: str, weights: dict[str, float]) -> list[str]:
    light = [name for name, weight in weights.items() if weight < _LIGHT]
    return [f"the {loss} loss counts less than half: {', '.join(light)}"] if light else []


def _unseen_said(seen: Observability, held: bool) -> list[str]:
    if not seen.words:
        return []
    return [
        f"{seen.rank} of {seen.seen.shape[0]} combinations of weights are seen; not seen by these "
        f"sensors{'; the prior holds them' if held else ''}: " + "; ".join(seen.words)
    ]
