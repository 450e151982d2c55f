"""The rows of stacked measurements: names, units and noise."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from curvcasadi.sensors.sensor import Sensor
from curvcasadi.symbolic.expressions import Array
from curvcasadi.symbolic.layout import Layout, Part


@dataclass(frozen=True, eq=False)
class Channels:
    """What stands in which row of stacked measurements.

    Values and residuals have the same rows, but for attitude sensors: a value is the nine entries
    of a rotation matrix by columns, a residual a rotation vector.
    """

    sensors: tuple[Sensor, ...]
    layout: Layout  #: a part per sensor, by its name, of the values
    residual_layout: Layout  #: the same of the residuals
    labels: tuple[str, ...]  #: one per value: name of the sensor and component
    residual_labels: tuple[str, ...]  #: one per residual
    units: tuple[str, ...]  #: one per value
    residual_units: tuple[str, ...]  #: one per residual
    noise: Array  #: standard deviation of a sample of each residual, `residual_units`


def sensor_channels(sensors: Sequence[Sensor]) -> Channels:
    """The rows of the measurements of `sensors`, in their order.

    A sensor without a name is called by its kind and its place among its kind: "gyro_1".

    Parameters
    ----------
    sensors : sequence of Sensor
        Sensors on a wing.

    Returns
    -------
    Channels
        Names and units of readings and residuals.
    """
    sensors = checked_sensors(sensors)
    names = _names(sensors)
    named = list(zip(names, sensors, strict=True))
    labels = Counter(f"{n}_{c}" if c else n for n, s in named for c in s.components)
    for label in [label for label, times in labels.items() if times > 1]:
        raise ValueError(f"sensors: expected different labels, found {label!r} twice in {names}")
    return Channels(
        sensors=sensors,
        layout=Layout(tuple(Part(n, len(s.components), s.unit) for n, s in named)),
        residual_layout=Layout(
            tuple(Part(n, len(s.residual_components), s.residual_unit) for n, s in named)
        ),
        labels=tuple(labels),
        residual_labels=tuple(
            f"{n}_{c}" if c else n for n, s in named for c in s.residual_components
        ),
        units=tuple(s.unit for s in sensors for _ in s.components),
        residual_units=tuple(s.residual_unit for s in sensors for _ in s.residual_components),
        noise=np.concatenate([_noise(s) for s in sensors]),
    )


def checked_sensors(sensors: Sequence[Sensor]) -> tuple[Sensor, ...]:
    """`sensors`, one or more."""
    if isinstance(sensors, Sensor) or not np.iterable(sensors):
        raise ValueError(f"sensors: expected a sequence of sensors, found {sensors!r}")
    checked = tuple(sensors)
    if not checked:
        raise ValueError("sensors: expected one or more, found none")
    for i, sensor in enumerate(checked):
        if not isinstance(sensor, Sensor) or not sensor.components:
            raise ValueError(
                f"sensors[{i}]: expected a sensor such as RateGyro(...), found {sensor!r}"
            )
    return checked


def _noise(sensor: Any) -> Array:
    """Standard deviation of one sample of each residual, its `residual_unit`."""
    return np.asarray(sensor.noise)


def _names(sensors: tuple[Sensor, ...]) -> list[str]:
    names, found = [], Counter[str]()
    for sensor in sensors:
        found[sensor.prefix] += 1
        names.append(sensor.name or f"{sensor.prefix}_{found[sensor.prefix]}")
    if len(set(names)) < len(names):
        raise ValueError(f"sensors: expected different names, found {names}")
    return names
