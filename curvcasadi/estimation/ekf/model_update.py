"""The update of a filter on a control model."""

from __future__ import annotations

import casadi as ca
import numpy as np

from curvcasadi.estimation import ud
from curvcasadi.estimation.ekf.gate import Gate
from curvcasadi.estimation.ekf.update import prior_belief
from curvcasadi.estimation.model_readings import ModelObservation, ModelReadings
from curvcasadi.estimation.samples import attitudes_function


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
    gate = Gate(observation.gate, observation.recovery, counters)
    outcomes = []
    rows = ModelReadings(observation, whole, measured, known).rows()
    for kind, group in zip(observation.kind_of_rows, rows, strict=True):
        belief, more = gate.measure(belief, group, kind)
        outcomes += more
    after, error = ud.split_belief(belief, first + size)
    outputs = [error[first:], after[first:, first:], ca.horzcat(*outcomes), gate.counters()]
    return ca.Function("take", arguments, outputs, {"cse": True})
