"""The update of a shape filter: scalar measurements one after another, from one linearization."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from curvcasadi.beam import Beam
from curvcasadi.estimation import ud
from curvcasadi.estimation.process import DEGREE, Process, offsets, orthonormal
from curvcasadi.expressions import AnyExpr, Array
from curvcasadi.lie import so3
from curvcasadi.sensors import (
    AttitudeSensor,
    Channels,
    RateGyro,
    RootMotion,
    Sensor,
    measurement_function,
)


@dataclass(frozen=True, eq=False, kw_only=True)
class Observation:
    """Checked description of what is measured.

    `unknown` are variables that a reading depends on and the state does not hold, with standard
    deviations: zero-mean noise that all rows of an update share. They go before the error state,
    where a factor U D Uᵀ is marginalized by leaving out its first rows and columns.
    """

    beam: Beam
    sensors: tuple[Sensor, ...]
    channels: Channels
    root: RootMotion
    unknown: Mapping[str, Array]  #: of "q_dot", "q_ddot", "twist"
    inputs: tuple[str, ...]  #: of "attitude", "position", "twist", "twist_rate": known motion
    gate: float
    iterations: int


def update_function(name: str, process: Process, observation: Observation) -> ca.Function:
    """(state, factor, measured, known motion) -> what `ShapeEkf.update` gives."""
    layout, channels = process.state, observation.channels
    state = ca.MX.sym("state", layout.size)
    factor = ca.MX.sym("factor", ca.Sparsity.upper(process.error.size))
    measured = ca.MX.sym("measured", channels.layout.size)
    known = {key: ca.MX.sym(key, *_SHAPES[key]) for key in observation.inputs}
    inputs = {"state": state, "factor": factor, "measured": measured, **known}

    samples, seen = _samples(observation)(measured)
    correct = _correction(process, observation)
    retract, difference = _retraction(process), _difference(process)
    at, error = state, ca.MX(ca.DM.zeros(process.error.size))
    for iteration in range(observation.iterations):
        if iteration:
            error = difference(at, state)
        step, factor_after, innovation, used = correct(
            error, factor, at, samples, seen, *known.values()
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


_SHAPES = {"attitude": (3, 3), "position": (3, 1), "twist": (6, 1), "twist_rate": (6, 1)}


def _samples(observation: Observation) -> ca.Function:
    """measured -> the same with zeros for NaN, and 1 or 0 for every residual that is there.

    A number is below zero or not; NaN is neither. The selection is no guard of a derivative, and
    none is taken of it.
    """
    measured = ca.SX.sym("measured", observation.channels.layout.size)
    there = ca.logic_or(measured < 0, measured >= 0)
    samples = ca.if_else(there, measured, 0)
    seen = []
    for sensor, part in zip(
        observation.sensors,
        observation.channels.layout.split(there).values(),
        strict=True,
    ):
        whole = isinstance(sensor, AttitudeSensor)
        rows = len(sensor.residual_components)
        seen.append(ca.repmat(ca.mmin(part), rows, 1) if whole else part)
    return ca.Function("samples", [measured], [samples, ca.vertcat(*seen)], {"cse": True})


def _correction(process: Process, observation: Observation) -> ca.Function:
    """(error, factor, state, samples, seen, known motion) -> error, factor, innovation, used."""
    size, first = process.error.size, sum(map(len, observation.unknown.values()))
    error, state = ca.MX.sym("error", size), ca.MX.sym("state", process.state.size)
    factor = ca.MX.sym("factor", ca.Sparsity.upper(size))
    samples = ca.MX.sym("samples", observation.channels.layout.size)
    seen = ca.MX.sym("seen", observation.channels.residual_layout.size)
    known = {key: ca.MX.sym(key, *_SHAPES[key]) for key in observation.inputs}
    arguments = [error, factor, state, samples, seen, *known.values()]

    residual, rows = _linearized(process, observation, state, samples, known)
    variances = ca.DM(observation.channels.noise**2)
    error, factor = ca.vertcat(ca.DM.zeros(first), error), _augmented(observation, factor)
    measure = ud.measure(first + size, observation.gate)
    innovation, used = [], []
    for k in range(len(observation.channels.noise)):
        error, factor, *found = measure(
            error, factor, rows[:, k], residual[k], variances[k], seen[k]
        )
        innovation.append(found[0])
        used.append(found[1])
    outputs = [error[first:], factor[first:, first:], ca.vertcat(*innovation), ca.vertcat(*used)]
    return ca.Function("correction", arguments, outputs, {"cse": True})


def _augmented(observation: Observation, factor: ca.MX) -> ca.MX:
    """Factor of the unknowns and the error together, which are independent before an update."""
    if not observation.unknown:
        return factor
    deviations = np.concatenate([*observation.unknown.values()])
    both = ca.diagcat(ca.MX(ca.DM(np.diag(deviations**2))), factor)
    return ca.project(both, ca.Sparsity.upper(both.shape[0]))


def _linearized(
    process: Process,
    observation: Observation,
    state: ca.MX,
    samples: ca.MX,
    known: Mapping[str, ca.MX],
) -> tuple[ca.MX, ca.MX]:
    """Residual (r, 1), and its derivative by unknowns and error, transposed (N, r)."""
    n, parts, channels = process.n, process.state.split(state), observation.channels
    point: dict[str, ca.MX] = {"q": parts["q"], **known}
    if "q_dot" in parts:
        point["q_dot"] = parts["q_dot"]
    for key in ("q_dot", "q_ddot"):
        if key in observation.unknown:
            point[key] = ca.MX(ca.DM.zeros(n))
    if process.attitude:
        point["attitude"] = ca.reshape(parts["attitude"], 3, 3)
    bias = parts.get("root_gyro_bias")
    if bias is not None and "twist" in point:
        point["twist"] = point["twist"] - ca.vertcat(bias, ca.DM.zeros(3))

    gyros = [
        where
        for where, sensor in zip(
            offsets(channels.residual_layout).values(), observation.sensors, strict=True
        )
        if isinstance(sensor, RateGyro)
    ]
    f = measurement_function(
        "readings", observation.sensors, observation.beam, list(point), observation.root
    )
    found = f(**point, measured=samples)
    residual = found["residual"]
    slopes = {key: found[f"residual_{key}"] for key in point}
    if "twist" in slopes:
        slopes["twist"] = slopes["twist"][:, :3]
        slopes["root_gyro_bias"] = -slopes["twist"]
    if process.biases:
        place = np.zeros((residual.shape[0], 3 * process.biases))
        for i, where in enumerate(gyros):
            place[where, 3 * i : 3 * i + 3] = np.eye(3)
        slopes["gyro_bias"] = ca.MX(ca.sparsify(ca.DM(place)))
        residual = residual + slopes["gyro_bias"] @ parts["gyro_bias"]
    columns = [slopes[key] for key in observation.unknown]
    for part in process.error.parts:
        columns.append(slopes.get(part.name, ca.MX(residual.shape[0], part.size)))
    return residual, ca.densify(ca.horzcat(*columns).T)


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


def known_motion(names: Sequence[str]) -> tuple[str, ...]:
    """`names`, each an input of the update."""
    if isinstance(names, str) or set(names) - set(_SHAPES) or len(set(names)) < len(names):
        raise ValueError(
            f"root_inputs: expected names among {', '.join(_SHAPES)}, each once; found {names!r}"
        )
    return tuple(names)
