"""Sensors as a least-squares problem: residuals and derivatives over the noise, missing samples."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from curvcasadi.beam.beam import Beam, remembered
from curvcasadi.estimation.samples import missing_residuals, numbers_or_nan
from curvcasadi.sensors import (
    Channels,
    RootMotion,
    Sensor,
    measurement_function,
    sensor_channels,
)
from curvcasadi.sensors.channels import checked_sensors
from curvcasadi.symbolic.expressions import (
    Array,
    Number,
    instance,
    is_numeric,
    numbers,
    numeric,
    symmetric,
)


@dataclass(frozen=True, eq=False)
class SensorModel:
    """What sensors on a beam of numbers read, with derivatives, as arrays."""

    sensors: tuple[Sensor, ...]
    channels: Channels
    unknowns: tuple[str, ...]  #: by what residuals are differentiated: "q", "q_dot"
    inputs: tuple[str, ...]  #: of `function`, before the measurements
    function: ca.Function

    def evaluate(self, state: Mapping[str, Array], measured: Array) -> tuple[Array, Array]:
        """Residual (r,) and slope (r, unknowns) in the units of the residuals.

        Rows of missing samples hold NaN.
        """
        _, residual, *slopes = self._call(state, measured)
        return residual.ravel(), self._joined(slopes)

    def slope(self, state: Mapping[str, Array]) -> Array:
        """Derivative (r, unknowns) of the readings at `state`, over their noise.

        That of an attitude stands on the right, as its residual does.
        """
        values, *_ = self._call(state, np.zeros(self.channels.layout.size))
        _, _, *slopes = self._call(state, values.ravel())
        return np.asarray(self._joined(slopes) / self.channels.noise[:, None])

    def present(self, measured: Array) -> Array:
        """Which rows (r,) of the residual are there; an attitude is there as a whole."""
        return np.asarray(~missing_residuals(self.channels, measured))

    def split(self, measured: Array) -> list[Array]:
        """Values of each sensor."""
        return [measured[where] for where in self.channels.layout.slices.values()]

    @property
    def groups(self) -> Array:
        """The sensor (r,) that each row of the residual belongs to."""
        sizes = [part.size for part in self.channels.residual_layout.parts]
        return np.repeat(np.arange(len(sizes)), sizes)

    def _call(self, state: Mapping[str, Array], measured: Array) -> list[Array]:
        outputs = self.function(*(state[name] for name in self.inputs), measured)
        return [output.full() for output in outputs]

    def _joined(self, slopes: list[Array]) -> Array:
        by_input = dict(zip(self.inputs, slopes, strict=True))
        return np.hstack([by_input[name] for name in self.unknowns])


def sensor_model(
    beam: Beam,
    sensors: Sequence[Sensor],
    inputs: Sequence[str] = ("q",),
    unknowns: Sequence[str] = ("q",),
    root: RootMotion | None = None,
) -> SensorModel:
    """The model of `sensors` on `beam`; made once for the same objects.

    Raises
    ------
    ValueError
        If the beam or a sensor holds symbols, or something that a sensor reads is missing.
    """
    instance("beam", beam, Beam)
    for name, symbol in beam.design_symbols.items():
        raise ValueError(f"{name}: sensors of a numeric beam expected, found the symbol {symbol}")
    if root is not None:
        instance("root", root, RootMotion)
    key = (checked_sensors(sensors), tuple(inputs), tuple(unknowns), root)
    return remembered(beam, ("sensor model", *key), lambda: _model(beam, *key))


def check_numeric(beam: Beam, sensors: Sequence[Sensor]) -> None:
    """ValueError that names a field of the beam or a sensor that holds symbols."""
    symbols = {**beam.design_symbols}
    for i, sensor in enumerate(sensors):
        for key, value in sensor.mount().items():
            if not is_numeric(value):
                symbols[f"sensors[{i}].{key}"] = value
    for name, symbol in symbols.items():
        raise ValueError(f"{name}: expected numbers in a filter, found the symbol {symbol}")


def _model(
    beam: Beam,
    sensors: tuple[Sensor, ...],
    inputs: tuple[str, ...],
    unknowns: tuple[str, ...],
    root: RootMotion | None,
) -> SensorModel:
    read = measurement_function("read_sensors", sensors, beam, inputs, root)
    return SensorModel(sensors, sensor_channels(sensors), unknowns, inputs, read)


def measured_values(model: SensorModel, measurements: Any) -> Array:
    """`measurements` as stacked values (m,), NaN where missing.

    Parameters
    ----------
    measurements : (m,) as `measure` stacks them, or values by name of the sensor: what is not named
        is missing, and an attitude may be (3, 3)
    """
    layout = model.channels.layout
    if not isinstance(measurements, Mapping):
        found = numbers_or_nan("measurements", measurements).ravel(order="F")
        if found.size != layout.size:
            raise ValueError(
                f"measurements: expected {layout.size} values, those of "
                f"{', '.join(part.name for part in layout.parts)}; found {found.size}"
            )
    else:
        names = [part.name for part in layout.parts]
        unknown = [str(name) for name in measurements if name not in names]
        if unknown:
            raise ValueError(
                f"measurements: expected names among {', '.join(names)}; found {', '.join(unknown)}"
            )
        found = np.concatenate([_by_name(measurements, part) for part in layout.parts])
    split = model.split(found)
    for i, (part, sensor) in enumerate(zip(layout.parts, model.sensors, strict=True)):
        if np.all(np.isfinite(split[i])):
            sample = sensor.checked_sample(f"measurements of {part.name}", ca.DM(split[i]))
            split[i] = sample.full().ravel()
    return np.concatenate(split)


def _by_name(measurements: Mapping[str, Number], part: Any) -> Array:
    if part.name not in measurements:
        return np.full(part.size, np.nan)
    where = f"measurements[{part.name!r}]"
    values = numbers_or_nan(where, measurements[part.name]).ravel(order="F")
    if values.size != part.size:
        raise ValueError(f"{where}: expected {part.size} values, found {values.size}")
    return values


def covariance_matrix(name: str, value: Number, n: int) -> Array:
    """Covariance (n, n) from one standard deviation, n of them, or a covariance matrix.

    With one weight, [[x]] is a covariance, and x, [x] or DM(x) a standard deviation.

    Raises
    ------
    ValueError
        If it is not symmetric and positive definite.
    """
    found = numbers(name, numeric(name, value))
    one = found.size == 1 and (n > 1 or found.ndim < 2 or isinstance(value, ca.DM))
    if one or (found.size == n and n > 1 and max(found.shape) == n):
        deviations = np.broadcast_to(found.ravel(), (n,))
        if not np.all(deviations > 0):
            raise ValueError(
                f"{name}: expected standard deviations above zero, found {deviations.tolist()}"
            )
        return np.diag(deviations**2)
    if found.shape != (n, n):
        raise ValueError(
            f"{name}: expected a standard deviation, {n} of them or a covariance {(n, n)}, "
            f"found shape {found.shape}"
        )
    return np.asarray(symmetric(name, found, size=n, definite=True).full())
