"""Which weights sensors see, from the derivative of their readings, and in words."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from curvcasadi.beam.beam import Beam, numeric_length
from curvcasadi.estimation.sensor_model import sensor_model
from curvcasadi.sensors import RootMotion, Sensor
from curvcasadi.symbolic.expressions import Array

#: Standard deviation of a combination of weights, times the length, beyond which it is not seen:
#: a constant curvature of that size rolls the wing up to half a circle, and no linearization holds.
LARGEST_DEVIATION = np.pi
#: Singular values below this part of the largest are rounding.
_ROUNDING = 1e-12
#: Part of a weight in a combination below which it is rounding, of the integration rule, too.
_LEAST_PART = 1e-4
#: Coefficient of a weight that is left out of the words.
_SILENT = 0.02


@dataclass(frozen=True, eq=False)
class Observability:
    """Combinations of weights that sensors see, and those that they do not."""

    seen: Array  #: orthonormal columns (n, rank)
    felt: Array  #: orthonormal columns: those, and what is drowned in noise
    silent: Array  #: orthonormal columns of what changes no reading
    words: tuple[str, ...]  #: what is not seen, one combination each

    @property
    def rank(self) -> int:
        """Number of combinations that are seen."""
        return int(self.seen.shape[1])

    def covariance(self, information: Array) -> Array:
        """Inverse (n, n) of `information`.

        Weights with a part in what changes no reading have infinite variance, and NaN for
        covariances.
        """
        within = self.felt.T @ information @ self.felt
        covariance = self.felt @ np.linalg.solve(within, self.felt.T)
        covariance = (covariance + covariance.T) / 2
        touched = np.linalg.norm(self.silent, axis=1) > _LEAST_PART
        covariance[touched] = covariance[:, touched] = np.nan
        covariance[touched, touched] = np.inf
        return np.asarray(covariance)


def observability(slope: Array, length: float, labels: Sequence[str]) -> Observability:
    """What readings see whose derivatives over their noise are `slope` (m, n), 1/(rad/m).

    A combination c of weights, |c| = 1, counts as seen if its standard deviation σ has
    σ L ≤ `LARGEST_DEVIATION`.
    """
    n = len(labels)
    padded = np.vstack([slope * (1 / length), np.zeros((n, n))])
    _, singular, rows = np.linalg.svd(padded, full_matrices=False)
    rounding = _ROUNDING * max(singular[0], 1 / LARGEST_DEVIATION)
    felt = int(np.sum(singular > rounding))
    rank = int(np.sum(singular > max(1 / LARGEST_DEVIATION, rounding)))
    drowned = rows[rank:felt].T
    words = [f"{name}: no reading changes with it" for name, _ in _named(rows[felt:].T, labels)]
    for name, combination in _named(drowned, labels):
        deviation = np.linalg.norm((drowned.T @ combination) / singular[rank:felt]) / length
        words.append(
            f"{name}: the noise leaves it a standard deviation of {deviation:.2g} rad/m, "
            f"above pi/L = {LARGEST_DEVIATION / length:.2g} rad/m"
        )
    return Observability(rows[:rank].T, rows[:felt].T, rows[felt:].T, tuple(words))


def unseen(
    beam: Beam, sensors: Sequence[Sensor], q: Array, root: RootMotion | None = None
) -> tuple[str, ...]:
    """What one sample of the sensors does not see of the weights at the shape `q`, at rest.

    Rates of weights are known here: a gyro sees how weights change, and not what they are.
    """
    names = ("q", "q_dot") if any(sensor.order for sensor in sensors) else ("q",)
    model = sensor_model(beam, sensors, names, ("q",), root)
    state = {"q": q, "q_dot": np.zeros_like(q)}
    slope = model.slope({name: state[name] for name in names})
    slope = slope[np.isfinite(slope).all(axis=1)]  # a camera sees nothing of what is beside it
    return observability(slope, numeric_length(beam, "sensors"), beam.basis.labels).words


def _named(columns: Array, labels: Sequence[str]) -> list[tuple[str, Array]]:
    """Combinations of weights, of length 1, that span the space of `columns`, with names."""
    basis = sorted(_echelon(columns), key=lambda c: int(np.argmax(np.abs(c))))
    return [(_sum(c, labels), c / np.linalg.norm(c)) for c in basis]


def _sum(combination: Array, labels: Sequence[str]) -> str:
    """A combination of weights as a sum of labels, the largest coefficient being 1."""
    parts = []
    for coefficient, label in zip(combination, labels, strict=True):
        if abs(coefficient) >= _SILENT:
            size = f"{abs(coefficient):.2g} "
            parts.append(
                f"{'-' if coefficient < 0 else '+'} {size if size != '1 ' else ''}({label})"
            )
    if len(parts) == 1:
        return labels[int(np.argmax(np.abs(combination)))]
    return " ".join(parts).removeprefix("+ ")


def _echelon(columns: Array) -> list[Array]:
    """A basis of the space of `columns` with a 1 of its own in each vector: Gauss–Jordan."""
    rows = columns.T.copy()
    for k in range(len(rows)):
        remaining = np.abs(rows[k:])
        i, j = divmod(int(np.argmax(remaining)), remaining.shape[1])
        rows[[k, k + i]] = rows[[k + i, k]]
        rows[k] /= rows[k, j]
        others = np.arange(len(rows)) != k
        rows[others] -= np.outer(rows[others, j], rows[k])
    return list(rows)
