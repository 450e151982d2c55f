"""The update of a shape filter: scalar measurements one after another, from one linearization."""

from __future__ import annotations

import casadi as ca
import numpy as np

from curvcasadi.estimation import ud
from curvcasadi.estimation.ekf.gate import Gate
from curvcasadi.estimation.ekf.readings import Observation, Readings
from curvcasadi.estimation.process import DEGREE, REJECTIONS, Process
from curvcasadi.estimation.samples import attitudes_function
from curvcasadi.kinematics.root_motion import ROOT_INPUTS
from curvcasadi.lie import so3
from curvcasadi.symbolic.expressions import AnyExpr, Array


def update_function(name: str, process: Process, observation: Observation) -> ca.Function:
    """(state, factor, measured, known motion) -> what `ShapeEkf.update` gives."""
    layout, channels = process.state, observation.channels
    state = ca.MX.sym("state", layout.size)
    factor = ca.MX.sym("factor", ca.Sparsity.upper(process.error.size))
    measured = ca.MX.sym("measured", channels.layout.size)
    known = {key: ca.MX.sym(key, *ROOT_INPUTS[key]) for key in observation.inputs}
    inputs = {"state": state, "factor": factor, "measured": measured, **known}

    retract, difference = _retraction(process), _difference(process)
    look, take = (_pass(process, observation, only) for only in (True, False))
    at, error = state, ca.MX(ca.DM.zeros(process.error.size))
    unknown = ca.MX(ca.DM.zeros(_unknowns(observation)))
    if any(sensor.whole for sensor in observation.sensors):
        measured = attitudes_function(observation.channels)(measured)
    if observation.unknown:
        unknown = look(error, factor, at, unknown, measured, *known.values())
    for iteration in range(observation.iterations):
        if iteration:
            error = difference(at, state)
        step, factor_after, said, unknown, *counters = take(
            error, factor, at, unknown, measured, *known.values()
        )
        at = retract(at, step)
    if counters:
        at = ca.vertcat(at[: -process.counters], *counters)
    innovation, used = said[0, :].T, said[1, :].T
    outputs = {
        "state_after": at,
        "factor_after": factor_after,
        "innovation": innovation,
        "used": used,
        "nis": ca.sumsqr(used * innovation),  # of an outlier the square alone may overflow
        "dof": ca.sum1(used),
    }
    arguments = [*inputs.values()]
    return ca.Function(name, arguments, [*outputs.values()], [*inputs], [*outputs], {"cse": True})


def _pass(process: Process, observation: Observation, look: bool) -> ca.Function:
    """(error, factor, state, unknowns, measured, known motion) -> error, factor, what `ud.measure`
    says (2, r), unknowns; with `look` the unknowns alone, as the rows show them that depend on any.

    The unknowns multiply the shape, as J(q) q_ddot does. Linearized at an acceleration of zero, a
    filter would trust the combinations of readings that no J(q) q_ddot reaches, with a J that it
    does not know; so the readings are linearized at the unknowns, too. These are what the readings
    show in a first pass. Each pass reads the sensors anew, one after another: kept between passes,
    their rows and stations would take more memory than all else.
    """
    size, first = process.error.size, _unknowns(observation)
    start, state = ca.MX.sym("error", size), ca.MX.sym("state", process.state.size)
    factor = ca.MX.sym("factor", ca.Sparsity.upper(size))
    unknown = ca.MX.sym("unknown", first)
    measured = ca.MX.sym("measured", observation.channels.layout.size)
    known = {key: ca.MX.sym(key, *ROOT_INPUTS[key]) for key in observation.inputs}
    arguments = [start, factor, state, unknown, measured, *known.values()]

    readings = Readings(process, observation, state, measured, known)
    gate = Gate(observation.gate, observation.recovery, _counters(process, state))
    rows = readings.rows(None if look or not first else unknown)
    offset = ca.MX(ca.DM.zeros(first)) if look else readings.offset(unknown)
    variances = np.concatenate([np.zeros(0), *observation.unknown.values()]) ** 2
    belief = prior_belief(size, variances)(factor, start, offset)
    outcomes = []
    for row, sensor in zip(rows, observation.sensors, strict=True):
        if row.shared or not look:
            kind = observation.kinds.index(sensor.prefix)
            belief, more = gate.measure(belief, row, kind)
            outcomes += more
    after, error = ud.split_belief(belief, first + size)
    outputs = [
        error[first:],
        after[first:, first:],
        ca.horzcat(*outcomes),
        offset + error[:first, :],
    ]
    name, outputs = ("look", outputs[-1:]) if look else ("take", outputs)
    if observation.recovery and not look:
        outputs.append(gate.counters())
    return ca.Function(name, arguments, outputs, {"cse": True})


def _counters(process: Process, state: ca.MX) -> ca.MX:
    return process.state.split(state)[REJECTIONS] if process.counters else ca.MX(0, 1)


def _unknowns(observation: Observation) -> int:
    return sum(map(len, observation.unknown.values()))


def prior_belief(size: int, variances: Array) -> ca.Function:
    """(factor, error, offset) -> belief in the unknowns, less their offset, and in the error.

    They are independent before an update; `variances` are those of the unknowns, `size` is that of
    the error state.
    """
    first = len(variances)
    factor = ca.MX.sym("factor", ca.Sparsity.upper(size))
    error, offset = ca.MX.sym("error", size), ca.MX.sym("offset", first)
    corner = np.diag(variances)[np.tril_indices(first)]  # symmetric: the upper one by columns
    entries = [ca.MX(ca.DM(corner))]
    ends = [j * (j + 1) // 2 for j in range(size + 1)]
    for column in ca.vertsplit(ca.sparsity_cast(factor, ca.Sparsity.dense(ends[-1])), ends):
        entries += [ca.MX(ca.DM.zeros(first)), column]
    belief = ca.vertcat(*entries, -offset, error)
    return ca.Function("belief", [factor, error, offset], [belief], {"cse": True})


def _retraction(process: Process) -> ca.Function:
    """(state, error) -> state: sums, and C exp(φ)."""
    state = ca.SX.sym("state", process.state.size)
    error = ca.SX.sym("error", process.error.size)
    parts, steps = process.state.split(state), process.error.split(error)
    moved: dict[str, AnyExpr] = {
        key: parts[key] + steps[key] for key in parts if key in steps and key != "attitude"
    }
    if process.counters:
        moved[REJECTIONS] = parts[REJECTIONS]
    if process.attitude:
        attitude = ca.reshape(parts["attitude"], 3, 3) @ so3.exp(steps["attitude"], DEGREE)
        moved["attitude"] = ca.vec(so3.orthonormal(attitude))
    return ca.Function("retract", [state, error], [process.state.join(moved)], {"cse": True})


def _difference(process: Process) -> ca.Function:
    """(a, b) -> the error that takes the state a to b."""
    a, b = (ca.SX.sym(key, process.state.size) for key in "ab")
    of_a, of_b = process.state.split(a), process.state.split(b)
    errors: dict[str, AnyExpr] = {
        part.name: of_b[part.name] - of_a[part.name]
        for part in process.error.parts
        if part.name != "attitude"
    }
    if process.attitude:
        rotations = (ca.reshape(of["attitude"], 3, 3) for of in (of_b, of_a))
        errors["attitude"] = so3.log_error(*rotations)
    return ca.Function("difference", [a, b], [process.error.join(errors)], {"cse": True})
