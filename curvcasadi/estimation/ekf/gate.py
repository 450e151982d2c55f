"""The gate of a filter, and how the filter recovers from a wrong start.

A gate that leaves out what is far from the prediction cannot tell a wrong sensor from a wrong
state: after a bad start it would leave out everything that could correct it. What tells them apart
is that a sensor fails alone and for a while, a state fails for all sensors that read it, and for
good. So each kind of sensor has a counter: of the updates in a row in which more than half of its
samples failed the gate. From `recovery` on, a sample of this kind that fails widens the prior, only
in the direction in which it corrects, until it is one standard deviation off, and is used
(`ud.relieve`). An update in which most samples pass sets the counter to zero.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from curvcasadi.estimation import ud
from curvcasadi.estimation.rows import Rows
from curvcasadi.symbolic.expressions import AnyExpr


class Gate:
    """Measurements by rows, and of each kind those that were there and those that failed.

    Parameters
    ----------
    gate : largest innovation over its standard deviation
    recovery : failed updates in a row after which the gate opens; 0 for never
    before : (kinds, 1), the counters before the update; none without recovery
    """

    def __init__(self, gate: float, recovery: int, before: ca.MX) -> None:
        self.gate, self.recovery, self.before = gate, recovery, before
        self.there = [ca.MX(0)] * before.numel()
        self.failed = [ca.MX(0)] * before.numel()

    def measure(self, belief: AnyExpr, group: Rows, kind: int) -> tuple[AnyExpr, list[AnyExpr]]:
        """Belief after the rows of one sensor, and what became of each row."""
        whole = group.together and self.gate < np.inf
        size = len(group.rows) if whole else 1
        step = ud.measure_together if whole else ud.measure_rows
        outcomes: list[AnyExpr] = []
        for k in range(0, len(group.rows), size):
            rows, variance = group.rows[k : k + size], group.variance[k : k + size]
            widened: AnyExpr = ca.MX(0)
            if self.recovery:
                belief, widened = self._widened(belief, rows, variance, kind)
            belief, found = step(belief, rows, variance, self.gate)
            if self.recovery:
                self._count(found, widened, kind)
            outcomes += found
        return belief, outcomes

    def counters(self) -> AnyExpr:
        """Updates in a row in which most samples of a kind failed; kept where there was none."""
        if not self.recovery:
            return ca.MX(0, 1)
        there, failed = ca.vertcat(*self.there), ca.vertcat(*self.failed)
        more = ca.fmin(self.before + 1, self.recovery)
        return (there > 0) * (2 * failed > there) * more + (there <= 0) * self.before

    def _widened(
        self, belief: AnyExpr, rows: list[AnyExpr], variance: np.ndarray, kind: int
    ) -> tuple[AnyExpr, AnyExpr]:
        is_open, widened = self.before[kind] >= self.recovery, ca.MX(0)
        for row, one in zip(rows, variance, strict=True):
            relieve = ud.relieve(row.numel() - 1, self.gate)
            belief, more = relieve(belief, row, one, is_open)
            widened = ca.fmax(widened, more)
        return belief, widened

    def _count(self, outcomes: list[AnyExpr], widened: AnyExpr, kind: int) -> None:
        for outcome in outcomes:
            seen = ca.logic_or(outcome[1] > 0, outcome[0] ** 2 > 0)
            self.there[kind] = self.there[kind] + seen
            self.failed[kind] = self.failed[kind] + seen * ca.fmax(widened, 1 - outcome[1])
