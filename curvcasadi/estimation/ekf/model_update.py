"""The update of a filter on a control model, and how it recovers from a wrong start.

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
from curvcasadi.estimation.ekf.model_readings import ModelObservation, ModelReadings
from curvcasadi.estimation.ekf.readings import Rows
from curvcasadi.estimation.ekf.update import prior_belief
from curvcasadi.estimation.samples import attitudes_function
from curvcasadi.symbolic.expressions import AnyExpr


def model_update_function(name: str, observation: ModelObservation) -> ca.Function:
    """(state, factor, measured and, where asked for, u, p, root inputs) -> as `ShapeEkf.update`."""
    dynamics, channels = observation.dynamics, observation.channels
    state = ca.MX.sym("state", dynamics.state.size)
    factor = ca.MX.sym("factor", ca.Sparsity.upper(dynamics.error.size))
    measured = ca.MX.sym("measured", channels.layout.size)
    known = observation.symbols
    inputs = {"state": state, "factor": factor, "measured": measured, **known}

    retract, difference, take = dynamics.retraction(), dynamics.difference(), _pass(observation)
    at, error = state, ca.MX(ca.DM.zeros(dynamics.error.size))
    if any(sensor.whole for sensor in channels.sensors):
        measured = attitudes_function(channels)(measured)
    for iteration in range(observation.iterations):
        if iteration:
            error = difference(at, state)
        step, factor_after, outcome, counters = take(error, factor, at, measured, *known.values())
        at = retract(at, step)
    whole, _ = ca.vertsplit(at, [0, dynamics.whole.size, dynamics.state.size])
    innovation, used = outcome[0, :].T, outcome[1, :].T
    outputs = {
        "state_after": ca.vertcat(whole, counters),
        "factor_after": factor_after,
        "innovation": innovation,
        "used": used,
        "nis": ca.sumsqr(used * innovation),
        "dof": ca.sum1(used),
    }
    arguments = [*inputs.values()]
    return ca.Function(name, arguments, [*outputs.values()], [*inputs], [*outputs], {"cse": True})


def _pass(observation: ModelObservation) -> ca.Function:
    """(error, factor, state, measured, known) -> error, factor, outcome (2, r), counters."""
    dynamics = observation.dynamics
    size = dynamics.error.size
    start, state = ca.MX.sym("error", size), ca.MX.sym("state", dynamics.state.size)
    factor = ca.MX.sym("factor", ca.Sparsity.upper(size))
    measured = ca.MX.sym("measured", observation.channels.layout.size)
    known = observation.symbols
    arguments = [start, factor, state, measured, *known.values()]

    whole, counters = ca.vertsplit(state, [0, dynamics.whole.size, dynamics.state.size])
    variances = np.concatenate([np.zeros(0), *observation.unknown.values()]) ** 2
    first = len(variances)
    belief = prior_belief(size, variances)(factor, start, ca.DM.zeros(first))
    tally = _Tally(observation, counters)
    outcomes = []
    rows = ModelReadings(observation, whole, measured, known).rows()
    for kind, group in zip(observation.kind_of_rows, rows, strict=True):
        belief, more = tally.measure(belief, group, kind)
        outcomes += more
    after, error = ud.split_belief(belief, first + size)
    outputs = [error[first:], after[first:, first:], ca.horzcat(*outcomes), tally.counters()]
    return ca.Function("take", arguments, outputs, {"cse": True})


class _Tally:
    """Samples of each kind that were there, and those that failed the gate."""

    def __init__(self, observation: ModelObservation, counters: ca.MX) -> None:
        self.observation, self.before = observation, counters
        self.there = [ca.MX(0)] * len(observation.kinds)
        self.failed = [ca.MX(0)] * len(observation.kinds)

    def measure(self, belief: ca.MX, group: Rows, kind: int) -> tuple[AnyExpr, list[AnyExpr]]:
        """Belief after the rows of one sensor, and what became of each row."""
        observation = self.observation
        blocks = [slice(k, k + 1) for k in range(len(group.rows))]
        if group.together:
            blocks = [slice(0, len(group.rows))]
        outcomes: list[AnyExpr] = []
        together = group.together and observation.gate < np.inf
        step = ud.measure_together if together else ud.measure_rows
        for block in blocks:
            rows, variance = group.rows[block], group.variance[block]
            widened = ca.MX(0)
            if observation.recovery:
                is_open = self.before[kind] >= observation.recovery
                for row, one in zip(rows, variance, strict=True):
                    relieve = ud.relieve(row.numel() - 1, observation.gate)
                    belief, more = relieve(belief, row, one, is_open)
                    widened = ca.fmax(widened, more)
            belief, found = step(belief, rows, variance, observation.gate)
            for outcome in found:
                seen = ca.logic_or(outcome[1] > 0, outcome[0] ** 2 > 0)
                self.there[kind] = self.there[kind] + seen
                self.failed[kind] = self.failed[kind] + seen * ca.fmax(widened, 1 - outcome[1])
            outcomes += found
        return belief, outcomes

    def counters(self) -> AnyExpr:
        """Updates in a row in which most samples of a kind failed; kept where there was none."""
        if not self.observation.recovery:
            return ca.MX(0, 1)
        there, failed = ca.vertcat(*self.there), ca.vertcat(*self.failed)
        more = ca.fmin(self.before + 1, self.observation.recovery)
        return (there > 0) * (2 * failed > there) * more + (there <= 0) * self.before
