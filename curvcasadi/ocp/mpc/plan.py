"""The plan of a predictive controller, from step to step."""

from __future__ import annotations

import numpy as np

from curvcasadi.symbolic.expressions import Array


class Plan:
    """Inputs of the stages to come, as the last solved step left them.

    Parameters
    ----------
    rest : array, shape (nu,)
        Input that is applied where nothing is planned.
    horizon : int
        Number N of stages.

    Attributes
    ----------
    applied : array, shape (nu,)
        Input that was applied last.
    inputs : array, shape (nu, N)
        Inputs from now on.
    left : int
        How many of them a solution has planned.
    """

    def __init__(self, rest: Array, horizon: int) -> None:
        self._rest = np.tile(rest[:, None], horizon)
        self.reset(rest)

    def reset(self, applied: Array) -> None:
        """Forget what was planned."""
        self.applied, self.inputs, self.left = applied.copy(), self._rest, 0

    def accept(self, u: Array, later: Array) -> None:
        """Apply `u`; `later` is planned after it, its last stage once more."""
        self.applied, self.inputs, self.left = u, later, later.shape[1] - 1

    def go_on(self) -> tuple[Array, bool]:
        """The inputs (nu, N) from now on, the first of which is applied; whether it was planned."""
        planned, inputs = self.left > 0, self.inputs if self.left else self._rest
        self.left = max(self.left - 1, 0)
        self.applied = inputs[:, 0].copy()
        self.inputs = np.column_stack([inputs[:, 1:], inputs[:, -1]]) if self.left else self._rest
        return inputs.copy(), planned
