"""Samples that may be missing, made safe for expressions."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

from curvcasadi.sensors import AttitudeSensor, Sensor, sensor_channels

#: In place of an attitude that is missing: the identity by columns, whose logarithm is finite.
_ATTITUDE = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)


def samples_function(sensors: Sequence[Sensor]) -> ca.Function:
    """measured (m, 1) -> samples (m, 1) without NaN, and seen (r, 1): 1, or 0 where one is missing.

    An attitude is there as a whole or not at all. A number is below zero or not; NaN is neither, as
    comparisons with it are false in C, too. The selection guards no derivative, and none is taken.
    """
    layout = sensor_channels(sensors).layout
    measured = ca.SX.sym("measured", layout.size)
    samples, seen = [], []
    for sensor, values in zip(sensors, layout.split(measured).values(), strict=True):
        there = ca.logic_or(values < 0, values >= 0)
        instead = ca.DM.zeros(values.shape)
        if isinstance(sensor, AttitudeSensor):
            there, instead = ca.repmat(ca.mmin(there), values.shape[0], 1), ca.DM(_ATTITUDE)
        samples.append(ca.if_else(there, values, instead))
        seen.append(there[: len(sensor.residual_components)])
    outputs = [ca.vertcat(*samples), ca.vertcat(*seen)]
    return ca.Function(
        "samples", [measured], outputs, ["measured"], ["samples", "seen"], {"cse": True}
    )
