"""Samples that may be missing, and what comes with them: checked, and safe for expressions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from curvcasadi.sensors import Channels, Sensor, sensor_channels
from curvcasadi.symbolic.expressions import (
    Array,
    Number,
    expression,
    numbers,
    numeric,
    rotation_matrix,
)


def samples_function(sensors: Sequence[Sensor] | Channels) -> ca.Function:
    """measured (m, 1) -> samples (m, 1) without NaN, and seen (r, 1): 1, or 0 where one is missing.

    `Sensor.present` says what is there, of a whole sample or entry by entry. The selection guards
    no derivative, and none is taken.
    """
    channels = sensors if isinstance(sensors, Channels) else sensor_channels(sensors)
    layout = channels.layout
    measured = ca.SX.sym("measured", layout.size)
    samples, seen = [], []
    for sensor, values in zip(channels.sensors, layout.split(measured).values(), strict=True):
        there: Any = sensor.present(values)
        if sensor.whole:
            there = ca.repmat(there, values.numel(), 1)
        instead = ca.DM(sensor.stand_in or [0.0] * values.numel())
        samples.append(ca.if_else(there, values, instead))
        seen.append(there[: len(sensor.residual_components)])
    outputs = [ca.vertcat(*samples), ca.vertcat(*seen)]
    return ca.Function(
        "samples", [measured], outputs, ["measured"], ["samples", "seen"], {"cse": True}
    )


def or_zero(size: int) -> ca.Function:
    """values (size, 1) -> the same with 0 for NaN; derivatives are not those of the values."""
    values = ca.SX.sym("values", size)
    there = ca.logic_or(values < 0, values >= 0)
    return ca.Function("or_zero", [values], [ca.if_else(there, values, 0)])


def attitudes_function(channels: Channels) -> ca.Function:
    """measured (m, 1) -> the same with NaN for what is there as a whole, and is not."""
    layout = channels.layout
    measured = ca.SX.sym("measured", layout.size)
    samples = []
    for sensor, values in zip(channels.sensors, layout.split(measured).values(), strict=True):
        wrong = ca.sqrt(sensor.present(values) - 1) if sensor.whole else 0
        samples.append(values + wrong)
    return ca.Function("attitudes", [measured], [ca.vertcat(*samples)], {"cse": True})


def missing_residuals(channels: Channels, values: Array) -> NDArray[np.bool_]:
    """Which residuals (r,) `values` (m,) have no sample of: of a whole sample all or none."""
    where, found = channels.layout.slices, [np.zeros(0, bool)]
    for part, sensor in zip(channels.layout.parts, channels.sensors, strict=True):
        missing = np.isnan(values[where[part.name]])
        if sensor.whole:
            there = bool(sensor.present(ca.DM(values[where[part.name]])))
            missing = np.full(len(sensor.residual_components), not there)
        found.append(missing)
    return np.concatenate(found)


def sequence(name: str, samples: Any) -> Any:
    """`samples`, which are many."""
    if not np.iterable(samples):
        raise ValueError(f"{name}: expected a sequence of samples, found {samples!r}")
    return samples


def sample_values(where: str, measured: Any, size: int) -> Array:
    """`measured` as a new array (size,) of numbers that are finite, or NaN where missing."""
    values: Array = numbers_or_nan(where, measured).ravel(order="F")
    if values.size != size:
        raise ValueError(f"{where}: expected {size} values, found {values.size}")
    return values


def numbers_or_nan(name: str, value: Number) -> Array:
    """`value` as a new array of numbers that are finite, or NaN where missing."""
    array = np.array(numeric(name, value.full() if isinstance(value, ca.DM) else value), object)
    for entry in array.flat:
        numeric(name, entry)
    try:
        missing = np.isnan(array.astype(float))
        infinite = np.argwhere(np.isinf(array.astype(float))).tolist()
    except (TypeError, ValueError):
        missing, infinite = np.zeros(array.shape, bool), []
    for at in infinite:
        where = ", ".join(map(str, at))
        raise ValueError(
            f"{name}[{where}]: expected finite numbers or NaN, found {array[tuple(at)]}"
        )
    filled = numbers(name, np.where(missing, 0.0, array))
    return np.where(missing, np.nan, filled)


def input_values(
    where: str, inputs: Any, shapes: Mapping[str, tuple[int, int]]
) -> dict[str, Array]:
    """`inputs`, numbers by name, as arrays of `shapes`; an attitude is a rotation."""
    if not isinstance(inputs, Mapping):
        raise ValueError(f"{where}: expected values by name, found {inputs!r}")
    if set(inputs) != set(shapes):
        found = sorted(map(str, inputs))
        raise ValueError(f"{where}: expected {sorted(shapes)}, found {found}")
    values = dict(inputs)
    if "attitude" in shapes:
        values["attitude"] = rotation_matrix(f"{where}['attitude']", inputs["attitude"])
    return {k: numeric_array(f"{where}[{k!r}]", values[k], shape) for k, shape in shapes.items()}


def numeric_array(name: str, value: Number, shape: tuple[int, int]) -> Array:
    """`value` as an array of `shape` of finite numbers."""
    return np.asarray(numeric(name, expression(name, value, shape)).full())
