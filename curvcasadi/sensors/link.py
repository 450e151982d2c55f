"""How samples reach a controller: noisy, late, and not all of them."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from curvcasadi.symbolic.expressions import Array, count, number, numbers, sequence


class SensorLink:
    """Noise, delay and loss of the samples of one wing or of several, of which each is a lane.

    Called with the true readings of the present it returns what arrives now: those of `delay`
    calls ago with noise, NaN where a sample was lost, or None while the first is on its way. Each
    lane draws from its own generator, so that lanes of one seed have the same noise and losses,
    whatever flies beside them.

    Parameters
    ----------
    noise : float or array, shape (m,)
        Standard deviations of the readings, in their units.
    delay : int
        Age of the samples that arrive, in calls.
    loss : float
        Share of the samples that are lost, each reading for itself; below 1.
    seeds : sequence of int
        A seed for each lane.

    Raises
    ------
    ValueError
        If an argument is not of that kind.
    """

    def __init__(
        self,
        *,
        noise: ArrayLike,
        delay: int = 0,
        loss: float = 0.0,
        seeds: Sequence[int] = (0,),
    ) -> None:
        self._noise = numbers("noise", noise).ravel()
        if not np.all(self._noise >= 0):
            raise ValueError(f"noise: expected numbers of at least zero, found {noise!r}")
        self._loss = number("loss", loss)
        if not 0 <= self._loss < 1:
            raise ValueError(f"loss: expected a share from 0 to below 1, found {loss}")
        seeds = [count("seeds", seed, 0) for seed in sequence("seeds", seeds)]
        if not seeds:
            raise ValueError("seeds: expected a seed for each lane, found none")
        self._generators = [np.random.default_rng(seed) for seed in seeds]
        self._queue: deque[Array] = deque(maxlen=count("delay", delay, 0) + 1)

    def __call__(self, values: ArrayLike) -> Array | None:
        """The samples that arrive now.

        Parameters
        ----------
        values : array, shape (lanes, m)
            Readings of the present, without noise.

        Returns
        -------
        array, shape (lanes, m), or None
            The samples of `delay` calls ago; None where there is none yet.
        """
        array = np.array(values, dtype=float)
        lanes = len(self._generators)
        m = self._noise.size if self._noise.size > 1 else "m"
        if array.ndim != 2 or len(array) != lanes or m not in ("m", array.shape[1]):
            raise ValueError(f"values: expected shape ({lanes}, {m}), found {array.shape}")
        for row, rng in zip(array, self._generators, strict=True):
            row += self._noise * rng.normal(size=row.shape)
            row[rng.random(row.shape) < self._loss] = np.nan
        self._queue.append(array)
        return self._queue[0] if len(self._queue) == self._queue.maxlen else None
