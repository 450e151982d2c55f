"""Extended Kalman filters of the shape of a wing, from sensors on it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from curvcasadi.beam import Beam
from curvcasadi.estimation import ud
from curvcasadi.estimation.correction import update_function
from curvcasadi.estimation.observation import Observation, known_motion
from curvcasadi.estimation.process import (
    PROCESSES,
    Process,
    ProcessName,
    offsets,
    predict_function,
)
from curvcasadi.expressions import (
    Array,
    Number,
    choice,
    count,
    expression,
    function_name,
    instance,
    is_numeric,
    numbers,
    positive,
    rotation_matrix,
)
from curvcasadi.layout import Layout
from curvcasadi.sensors import Channels, RateGyro, RootMotion, Sensor, sensor_channels
from curvcasadi.sensors.channels import checked_sensors


class Estimate(NamedTuple):
    """State of a filter at a time. What an update says of its samples is empty before the first."""

    time: float  #: s
    state: Array  #: (x,), parts as in `ShapeEkf.layout`
    factor: Array  #: (N, N), upper triangular: U D Uᵀ with D on the diagonal
    innovation: Array = np.zeros(0)  #: (r,), over its standard deviation; NaN where missing
    used: Array = np.zeros(0)  #: (r,), 1 for samples that were used, 0 for missing and gated ones
    nis: float = 0.0  #: normalized innovation squared of the used samples
    dof: int = 0  #: number of used samples, its expectation

    @property
    def covariance(self) -> Array:
        """Of the error state, (N, N), parts as in `ShapeEkf.error_layout`."""
        return ud.covariance_of(self.factor)


@dataclass(frozen=True, eq=False, kw_only=True)
class ShapeEkf:
    """An extended Kalman filter as two Functions, for Python and for C.

    predict: (state, factor, dt and, with an attitude, rate) -> state_after,
    factor_after.
    update: (state, factor, measured and the inputs asked for) -> state_after,
    factor_after, innovation (r, 1), used (r, 1), nis, dof. A sample that is NaN is missing; its
    innovation is 0.
    """

    predict: ca.Function
    update: ca.Function
    layout: Layout  #: of the state
    error_layout: Layout  #: of the error state: the attitude's is a rotation vector, parent axes
    channels: Channels  #: rows of measured, and of residuals
    beam: Beam

    def initial(
        self,
        deviation: Mapping[str, Number],
        mean: Mapping[str, Number] | None = None,
        *,
        time: float = 0.0,
    ) -> Estimate:
        """An estimate to start from.

        Parameters
        ----------
        deviation : for every part of the error state its standard deviation, one number or one per
            entry; or a positive definite covariance matrix of the part
        mean : of parts of the state; zero, and the identity attitude, where not given; the attitude
            is a rotation matrix (3, 3)
        time : s
        """
        means = dict(mean or {})
        parts: dict[str, Any] = {part.name: ca.DM.zeros(part.size) for part in self.layout.parts}
        _known_parts("mean", means, self.layout)
        _known_parts("deviation", deviation, self.error_layout)
        if "attitude" in parts:
            attitude = rotation_matrix("mean['attitude']", means.pop("attitude", np.eye(3)))
            parts["attitude"] = ca.vec(attitude)
        for key, value in means.items():
            parts[key] = expression(f"mean[{key!r}]", value, (self.layout_size(key), 1))
        covariance = np.zeros((self.error_layout.size, self.error_layout.size))
        for part in self.error_layout.parts:
            if part.name not in deviation:
                raise ValueError(f"deviation: expected {part.name!r}, {part.unit}; not found")
            where = offsets(self.error_layout)[part.name]
            covariance[where, where] = _covariance(part.name, deviation[part.name], part.size)
        state = self.layout.join(parts).full()[:, 0]
        return Estimate(float(time), state, ud.factor_of(covariance))

    def layout_size(self, name: str) -> int:
        """Size of a part of the state."""
        return next(part.size for part in self.layout.parts if part.name == name)

    def part(self, estimate: Estimate, name: str) -> Array:
        """A part of the state of an estimate, (size,)."""
        return estimate.state[offsets(self.layout)[name]]

    def covariance(self, estimate: Estimate, name: str) -> Array:
        """Covariance of a part of the error state of an estimate, (size, size)."""
        where = offsets(self.error_layout)[name]
        return estimate.covariance[where, where]


def shape_ekf(
    beam: Beam,
    sensors: Sequence[Sensor],
    *,
    process: ProcessName,
    density: Number,
    rate: Number = None,
    acceleration: Number = None,
    attitude: bool = False,
    root_gyro_density: float | None = None,
    gyro_bias: bool = False,
    bias_density: float | None = None,
    root: RootMotion | None = None,
    root_inputs: Sequence[str] = (),
    gate: float = 5.0,
    iterations: int = 1,
    name: str = "ekf",
) -> ShapeEkf:
    """Extended Kalman filter of curvature weights, and of what else is asked for."""
    instance("beam", beam, Beam)
    n = beam.basis.n
    checked = checked_sensors(sensors)
    order = max(sensor.order for sensor in checked)
    choice("process", process, PROCESSES)
    gyros = sum(isinstance(sensor, RateGyro) for sensor in checked)
    known = known_motion(root_inputs)
    unknown = {}
    if order >= 1 and process == "random_walk":
        unknown["q_dot"] = _deviations("rate", rate, n)
    if order == 2:
        unknown["q_ddot"] = _deviations("acceleration", acceleration, n)
    root = instance("root", root or RootMotion(), RootMotion)
    described = Process(
        kind=process,
        density=_deviations("density", density, n),
        attitude=attitude,
        root_rotation=beam.root.rotation,
        rate_density=root_gyro_density,
        biases=gyros if gyro_bias else 0,
        root_bias=gyro_bias and attitude,
        bias_density=bias_density,
    )
    observation = Observation(
        beam=beam,
        sensors=checked,
        channels=sensor_channels(checked),
        root=root,
        unknown=unknown,
        inputs=known,
        gate=float(gate),
        iterations=count("iterations", iterations),
    )
    function_name("name", name)
    return ShapeEkf(
        predict=predict_function(f"{name}_predict", described),
        update=update_function(f"{name}_update", described, observation),
        layout=described.state,
        error_layout=described.error,
        channels=observation.channels,
        beam=beam,
    )


def run_ekf(
    ekf: ShapeEkf, start: Estimate, samples: Iterable[tuple[Any, ...]]
) -> Iterator[Estimate]:
    """Estimates at the times of `samples`, (time, measured) or (time, measured, inputs by name)."""
    at = start
    for k, (time, measured, *rest) in enumerate(samples):
        inputs: dict[str, Any] = {**rest[0]} if rest else {}
        yield (at := _step(ekf, at, k, float(time), measured, inputs))


def _step(
    ekf: ShapeEkf, at: Estimate, k: int, time: float, measured: Any, inputs: dict[str, Any]
) -> Estimate:
    if not time >= at.time:
        raise ValueError(
            f"samples[{k}]: expected a time of at least {at.time:g} s, that of the one before; "
            f"found {time:g} s"
        )
    rate = {"rate": inputs.pop("rate")} if "rate" in inputs else {}
    predicted = ekf.predict(state=at.state, factor=at.factor, dt=time - at.time, **rate)
    values = np.asarray(measured, dtype=float).ravel()
    if values.size != ekf.channels.layout.size:
        raise ValueError(
            f"samples[{k}]: expected {ekf.channels.layout.size} values, found {values.size}"
        )
    found = ekf.update(
        state=predicted["state_after"], factor=predicted["factor_after"], measured=values, **inputs
    )
    innovation, used = found["innovation"].full()[:, 0], found["used"].full()[:, 0]
    return Estimate(
        time,
        found["state_after"].full()[:, 0],
        found["factor_after"].full(),
        innovation,
        used,
        float(found["nis"]),
        int(found["dof"]),
    )


def _deviations(name: str, value: Number, size: int) -> Array:
    if value is None or not is_numeric(value):
        raise ValueError(f"{name}: expected 1 number or {size}, found {value}")
    array = numbers(name, value).ravel()
    if array.size not in (1, size):
        raise ValueError(f"{name}: expected 1 number or {size}, found {array.size}")
    for entry in array:
        positive(name, entry)
    return np.array(np.broadcast_to(array, (size,)))


def _covariance(name: str, value: Number, size: int) -> Array:
    where = f"deviation[{name!r}]"
    array = numbers(where, value)
    if array.shape == (size, size) and size > 1:
        if not np.allclose(array, array.T) or np.linalg.eigvalsh(array)[0] <= 0:
            raise ValueError(f"{where}: expected a positive definite covariance, found {array}")
        return array
    return np.diag(_deviations(where, value, size) ** 2)


def _known_parts(name: str, given: Mapping[str, Any], layout: Layout) -> None:
    names = [part.name for part in layout.parts]
    for key in given:
        choice(name, key, names)
