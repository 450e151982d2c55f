"""Samples that may be missing, made safe for expressions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np

from curvcasadi.expressions import AnyExpr, Array
from curvcasadi.sensors import AttitudeSensor, Sensor, sensor_channels

#: In place of an attitude that is missing: the identity by columns, whose logarithm is finite.
_ATTITUDE = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)

#: From a rotation: what a sensor in single precision never is, and a dead one always.
_FAR = 1e-2


def samples_function(sensors: Sequence[Sensor]) -> ca.Function:
    """measured (m, 1) -> samples (m, 1) without NaN, and seen (r, 1): 1, or 0 where one is missing.

    An attitude is there as a whole or not at all; one that `is_rotation` denies is not. A number
    is below zero or not; NaN is neither, as comparisons with it are false in C, too. The selection
    guards no derivative, and none is taken.
    """
    layout = sensor_channels(sensors).layout
    measured = ca.SX.sym("measured", layout.size)
    samples, seen = [], []
    there: Any
    for sensor, values in zip(sensors, layout.split(measured).values(), strict=True):
        if isinstance(sensor, AttitudeSensor):
            there, instead = ca.repmat(is_rotation(values), 9, 1), ca.DM(_ATTITUDE)
        else:
            there, instead = ca.logic_or(values < 0, values >= 0), ca.DM.zeros(values.shape)
        samples.append(ca.if_else(there, values, instead))
        seen.append(there[: len(sensor.residual_components)])
    outputs = [ca.vertcat(*samples), ca.vertcat(*seen)]
    return ca.Function(
        "samples", [measured], outputs, ["measured"], ["samples", "seen"], {"cse": True}
    )


def attitudes_function(sensors: Sequence[Sensor]) -> ca.Function:
    """measured (m, 1) -> the same with NaN for attitudes that `is_rotation` denies."""
    layout = sensor_channels(sensors).layout
    measured = ca.SX.sym("measured", layout.size)
    samples = []
    for sensor, values in zip(sensors, layout.split(measured).values(), strict=True):
        wrong = isinstance(sensor, AttitudeSensor)
        samples.append(values + ca.sqrt(is_rotation(values) - 1) if wrong else values)
    return ca.Function("attitudes", [measured], [ca.vertcat(*samples)], {"cse": True})


def is_rotation(values: AnyExpr) -> AnyExpr:
    """1 if `values`, columns c1, c2, c3 of a matrix stacked (9, 1), are a rotation to 1e-2, else 0.

    |(c1·c1 − 1, c2·c2 − 1, c1·c2, c1 × c2 − c3)| ≤ 1e-2, which no NaN fulfils.
    """
    c1, c2, c3 = ca.vertsplit(values, 3)
    lengths = (ca.sumsqr(c1) - 1, ca.sumsqr(c2) - 1, ca.dot(c1, c2))
    return ca.sumsqr(ca.vertcat(*lengths, ca.cross(c1, c2) - c3)) <= _FAR**2


def sample_values(where: str, measured: Any) -> Array:
    """`measured` as a new array (m,) of numbers that are finite, or NaN where missing."""
    given = measured.full() if isinstance(measured, ca.DM) else measured
    try:
        values = np.array(given, dtype=float).ravel()
    except (TypeError, ValueError):
        values = np.array([])
    if isinstance(given, (str, bytes)) or not values.size:
        raise ValueError(f"{where}: expected numbers, NaN where missing; found {measured!r}")
    for i in np.flatnonzero(np.isinf(values)):
        raise ValueError(f"{where}[{i}]: expected a finite number or NaN, found {values[i]}")
    return values
