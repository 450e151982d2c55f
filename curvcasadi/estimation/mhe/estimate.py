"""What a window of samples says of the state."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from curvcasadi.estimation import ud
from curvcasadi.symbolic.expressions import Array
from curvcasadi.symbolic.text import described, shown


class WindowEstimate(NamedTuple):
    """What a window of samples says, and what the next one starts from.

    Attributes
    ----------
    time : float
        Time of the newest sample, s.
    state : array, shape (x,)
        State at that time, parts as in `ShapeMhe.layout`.
    states : array, shape (x, k)
        States at all times of the window so far, one a column.
    arrival_mean : array, shape (x,)
        Mean at the start of the next window, from samples before it.
    arrival_factor : array, shape (x, x)
        Its covariance U D Uᵀ, upper triangular with D on the diagonal.
    guess : array, shape (v, N + 1)
        Guess of the next window.
    violation : float
        Violation of the bounds over its tolerance.
    stationarity : float
        Bound of the distance to the optimum over its tolerance.
    used : array, shape (r,)
        Of the newest sample, 1 where there is one, 0 where it is missing. A bearing of a point that
        the window finds out of the camera's view has 1, but no part in the estimate.
    """

    time: float
    state: Array
    states: Array
    arrival_mean: Array
    arrival_factor: Array
    guess: Array
    violation: float = 0.0
    stationarity: float = 0.0
    used: Array = np.zeros(0)

    @property
    def solved(self) -> bool:
        """Whether bounds and optimality conditions hold to their tolerances."""
        return self.violation <= 1 and self.stationarity <= 1

    @property
    def success(self) -> bool:
        """Whether the window was solved, the same as `solved`."""
        return self.solved

    @property
    def message(self) -> str:
        """Whether the window was solved, and by how much it was not."""
        if self.solved:
            return "solved"
        misses = {"bounds are exceeded": self.violation, "the optimum is missed": self.stationarity}
        return "not solved: " + " and ".join(
            f"{what} by {miss:.3g} times the tolerance" for what, miss in misses.items() if miss > 1
        )

    def __repr__(self) -> str:
        return f"<WindowEstimate at {self.time:g} s: {self.message}>"

    def __str__(self) -> str:
        rows = {
            "state": shown(self.state),
            "window": f"{self.states.shape[1]} samples",
            "used": f"{int(np.sum(self.used))} of {self.used.size} readings of the newest sample",
            "violation": f"{self.violation:.3g} of its tolerance",
            "stationarity": f"{self.stationarity:.3g} of its tolerance",
        }
        return described(f"WindowEstimate at {self.time:g} s: {self.message}", rows)

    @property
    def arrival_covariance(self) -> Array:
        """Covariance of `arrival_mean`, (x, x)."""
        return ud.covariance_of(self.arrival_factor)
