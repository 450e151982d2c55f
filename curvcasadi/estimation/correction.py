"""The update of a shape filter: scalar measurements one after another, from one linearization."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import casadi as ca
import numpy as np

from curvcasadi.estimation import ud
from curvcasadi.estimation.observation import SHAPES, Observation, Readings, Rows
from curvcasadi.estimation.process import DEGREE, Process, orthonormal
from curvcasadi.expressions import AnyExpr
from curvcasadi.lie import so3
from curvcasadi.sensors import AttitudeSensor


def update_function(name: str, process: Process, observation: Observation) -> ca.Function:
    """(state, factor, measured, known motion) -> what `ShapeEkf.update` gives."""
    layout, channels = process.state, observation.channels
    state = ca.MX.sym("state", layout.size)
    factor = ca.MX.sym("factor", ca.Sparsity.upper(process.error.size))
    measured = ca.MX.sym("measured", channels.layout.size)
    known = {key: ca.MX.sym(key, *SHAPES[key]) for key in observation.inputs}
    inputs = {"state": state, "factor": factor, "measured": measured, **known}

    samples, seen = _samples(observation)(measured)
    retract, difference = _retraction(process), _difference(process)
    at, error = state, ca.MX(ca.DM.zeros(process.error.size))
    unknown = ca.MX(ca.DM.zeros(sum(map(len, observation.unknown.values()))))
    for iteration in range(observation.iterations):
        if iteration:
            error = difference(at, state)
        correct = _correction(process, observation, look=iteration == 0)
        step, factor_after, innovation, used, unknown = correct(
            error, factor, at, unknown, samples, seen, *known.values()
        )
        at = retract(at, step)
    outputs = {
        "state_after": at,
        "factor_after": factor_after,
        "innovation": innovation,
        "used": used,
        "nis": ca.dot(used, innovation**2),
        "dof": ca.sum1(used),
    }
    arguments = [*inputs.values()]
    return ca.Function(name, arguments, [*outputs.values()], [*inputs], [*outputs], {"cse": True})


def _samples(observation: Observation) -> ca.Function:
    """measured -> the same with zeros for NaN, and 1 or 0 for every residual that is there.

    A number is below zero or not; NaN is neither. The selection is no guard of a derivative, and
    none is taken of it.
    """
    layout = observation.channels.layout
    measured = ca.MX.sym("measured", layout.size)
    there = ca.logic_or(measured < 0, measured >= 0)
    seen = []
    for sensor, part in zip(observation.sensors, layout.split(there).values(), strict=True):
        whole = isinstance(sensor, AttitudeSensor)
        seen.append(ca.repmat(ca.mmin(part), 3, 1) if whole else part)
    samples = ca.if_else(there, measured, 0)
    return ca.Function("samples", [measured], [samples, ca.vertcat(*seen)], {"cse": True})


def _correction(process: Process, observation: Observation, look: bool) -> ca.Function:
    """(error, factor, state, unknowns, samples, seen, known motion) -> error, factor, innovation,
    used, unknowns.

    The unknowns multiply the shape, as J(q) q_ddot does. Linearized at an acceleration of zero, a
    filter would trust the combinations of readings that no J(q) q_ddot reaches, with a J that it
    does not know; so the readings are linearized at the unknowns, too. With `look` these are what
    the readings show in a first pass; otherwise they are an input.
    """
    size, first = process.error.size, sum(map(len, observation.unknown.values()))
    start, state = ca.MX.sym("error", size), ca.MX.sym("state", process.state.size)
    start_factor = ca.MX.sym("factor", ca.Sparsity.upper(size))
    samples = ca.MX.sym("samples", observation.channels.layout.size)
    seen = ca.MX.sym("seen", observation.channels.residual_layout.size)
    unknown = ca.MX.sym("unknown", first)
    known = {key: ca.MX.sym(key, *SHAPES[key]) for key in observation.inputs}
    arguments = [start, start_factor, state, unknown, samples, seen, *known.values()]

    readings = Readings(process, observation, state, samples, known)
    there = observation.channels.residual_layout.split(seen)
    factor = _augmented(observation, start_factor)
    if look and first:
        shared = [row for row in readings.rows(None) if row.shared]
        error = ca.vertcat(ca.DM.zeros(first), start)
        unknown = _sequence(shared, error, factor, there, observation.gate)[0][:first]
    rows = readings.rows(unknown if first else None)
    offset = readings.offset(unknown)
    error, factor, *said = _sequence(
        rows, ca.vertcat(-offset, start), factor, there, observation.gate
    )
    outputs = [error[first:], factor[first:, first:], *said, offset + error[:first]]
    return ca.Function("correction", arguments, outputs, {"cse": True})


def _sequence(
    rows: Sequence[Rows], error: AnyExpr, factor: AnyExpr, seen: Mapping[str, ca.MX], gate: float
) -> tuple[AnyExpr, AnyExpr, AnyExpr, AnyExpr]:
    """Error, factor, innovations and which were used, after the rows of all sensors."""
    said = []
    for row in rows:
        step = ud.measure_rows(error.shape[0], len(row.variance), gate)
        error, factor, *found = step(
            error, factor, row.slope, row.residual, row.variance, seen[row.name]
        )
        said.append(found)
    innovation, used = (ca.vertcat(*x) for x in zip(*said, strict=True))
    return error, factor, innovation, used


def _augmented(observation: Observation, factor: ca.MX) -> ca.MX:
    """Factor of the unknowns and the error together, which are independent before an update."""
    if not observation.unknown:
        return factor
    variances = np.concatenate([*observation.unknown.values()]) ** 2
    first, size = len(variances), factor.shape[0]
    corner = np.diag(variances)[np.tril_indices(first)]  # symmetric: the upper one by columns
    entries = [ca.MX(ca.DM(corner))]
    offsets = [j * (j + 1) // 2 for j in range(size + 1)]
    for column in ca.vertsplit(ca.sparsity_cast(factor, ca.Sparsity.dense(offsets[-1])), offsets):
        entries += [ca.MX(ca.DM.zeros(first)), column]
    return ca.sparsity_cast(ca.vertcat(*entries), ca.Sparsity.upper(first + size))


def _retraction(process: Process) -> ca.Function:
    """(state, error) -> state: sums, and C exp(φ)."""
    state = ca.SX.sym("state", process.state.size)
    error = ca.SX.sym("error", process.error.size)
    parts, steps = process.state.split(state), process.error.split(error)
    moved: dict[str, AnyExpr] = {key: parts[key] + steps[key] for key in parts if key != "attitude"}
    if process.attitude:
        attitude = ca.reshape(parts["attitude"], 3, 3) @ so3.exp(steps["attitude"], DEGREE)
        moved["attitude"] = ca.vec(orthonormal(attitude))
    return ca.Function("retract", [state, error], [process.state.join(moved)], {"cse": True})


def _difference(process: Process) -> ca.Function:
    """(a, b) -> the error that takes the state a to b."""
    a, b = (ca.SX.sym(key, process.state.size) for key in "ab")
    of_a, of_b = process.state.split(a), process.state.split(b)
    errors: dict[str, AnyExpr] = {key: of_b[key] - of_a[key] for key in of_a if key != "attitude"}
    if process.attitude:
        rotations = (ca.reshape(of["attitude"], 3, 3) for of in (of_b, of_a))
        errors["attitude"] = so3.log_error(*rotations)
    return ca.Function("difference", [a, b], [process.error.join(errors)], {"cse": True})
