"""What is estimated and measured with a control model as process, from checked arguments."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from curvcasadi.aircraft.parts import Aircraft
from curvcasadi.beam.beam import Beam
from curvcasadi.control.model import ControlModel
from curvcasadi.estimation.belief import weights_of
from curvcasadi.estimation.model_process import (
    Dynamics,
    ModelProcess,
    checked_process,
    densities,
    return_times,
    unknown_accelerations,
)
from curvcasadi.estimation.model_readings import (
    BIASED,
    Instrumented,
    ModelObservation,
    OutputReading,
    joined_channels,
    kind_name,
)
from curvcasadi.estimation.sensor_model import check_numeric
from curvcasadi.kinematics.root_motion import RootMotion, numeric_root
from curvcasadi.sensors import Sensor
from curvcasadi.sensors.channels import checked_sensors
from curvcasadi.sensors.sensor import positive_numbers
from curvcasadi.symbolic.expressions import Number, choice, instance
from curvcasadi.symbolic.layout import Layout, Part


@dataclass(frozen=True, eq=False, kw_only=True)
class Options:
    """Checked keyword arguments of an estimator on a control model."""

    root: RootMotion | None
    root_inputs: tuple[str, ...]
    gate: float
    iterations: int
    recovery: int
    gyro_bias: bool
    accelerometer_bias: bool
    bias_density: float | None


def described_process(
    process: ControlModel | ModelProcess, density: Any, acceleration: Any
) -> ModelProcess:
    """A model and keyword arguments, or a description that has all, as a description."""
    if isinstance(process, ModelProcess):
        for name, value in {"density": density, "acceleration": acceleration}.items():
            if value is not None:
                raise ValueError(f"{name}: expected None beside a ModelProcess, found {value}")
        return checked_process(process)
    if density is None:
        raise ValueError(
            "density: expected the density of the noise of q_dot, rad/(m s √s), or densities by "
            "name of a part of the error state; found None"
        )
    if not isinstance(density, Mapping):
        density = dict.fromkeys(_driven(process), density)
    return checked_process(ModelProcess(model=process, density=density, acceleration=acceleration))


def _driven(model: ControlModel) -> list[str]:
    """Parts that noise drives: rates of weights, or the weights of a model without."""
    names = [part.name for part in model.x.parts]
    return [n for n in names if n.startswith("q_dot")] or [n for n in names if n == "q"]


def given_layouts(dynamics: Dynamics) -> dict[str, Layout]:
    """Parts of u and of the known parameters, where the model has any."""
    layouts = {"u": dynamics.model.u, "p": dynamics.known}
    return {key: layout for key, layout in layouts.items() if layout.size}


def model_observation(
    wings: Beam | Aircraft,
    sensors: Sequence[Sensor] | Mapping[str, Sequence[Sensor]],
    process: ModelProcess,
    outputs: Mapping[str, Number],
    options: Options,
) -> ModelObservation:
    """What is estimated, and what is measured, from checked arguments."""
    instrumented = _instrumented(wings, sensors, process.model, bool(outputs))
    readings = _output_readings(process.model, outputs)
    channels = joined_channels(instrumented, readings)
    biases = {
        key: 3 * sum(isinstance(sensor, kind) for sensor in channels.sensors)
        for (key, kind), wanted in zip(
            BIASED.items(), (options.gyro_bias, options.accelerometer_bias), strict=True
        )
        if wanted
    }
    for key, size in biases.items():
        if not size:
            raise ValueError(f"{key}: expected a sensor that has one, found none")
        if options.bias_density is not None and key not in process.density:
            process = replace(process, density={**process.density, key: options.bias_density})
    kinds = tuple(dict.fromkeys(kind_name(sensor) for sensor in channels.sensors))
    dynamics = Dynamics(
        model=process.model,
        density={},
        returns=return_times(process),
        biases=biases,
        counters=len(kinds) if options.recovery and options.gate < np.inf else 0,
        substeps=process.substeps,
        method=process.method,
    )
    dynamics = replace(dynamics, density=densities(process, dynamics.error))
    velocities = {p.name: p.size for p in process.model.x.parts if p.name.startswith("q_dot")}
    needed = [w.q_dot for w in instrumented if w.order == 2]
    missing = [part for part in needed if part not in velocities]
    if missing:
        raise ValueError(
            "sensors: expected a model with inertia for accelerometers, found "
            f"{process.model.name!r} without {missing[0]}"
        )
    unknown = {k: v for k, v in unknown_accelerations(process, velocities).items() if k in needed}
    return ModelObservation(
        dynamics=dynamics,
        wings=instrumented,
        outputs=readings,
        root=numeric_root(options.root, options.root_inputs),
        inputs=options.root_inputs,
        unknown=unknown,
        gate=options.gate,
        iterations=options.iterations,
        recovery=options.recovery if dynamics.counters else 0,
        kinds=kinds,
    )


def _instrumented(
    wings: Beam | Aircraft, sensors: Any, model: ControlModel, others: bool
) -> tuple[Instrumented, ...]:
    """Wings with their sensors."""
    if not isinstance(wings, Beam | Aircraft):
        instance("beam", wings, Beam)
    beams = weights_of(wings)
    names = [part.name for part in model.x.parts]
    for part, beam in beams.items():
        sizes = {p.name: p.size for p in model.x.parts}
        if sizes.get(part) != beam.basis.n:
            raise ValueError(
                f"process: expected a model whose state has a part {part!r} of {beam.basis.n} "
                f"weights, found {model!r} with {', '.join(names)}"
            )
    if isinstance(wings, Beam):
        sensors = {"q": sensors}
    elif isinstance(sensors, Mapping):
        for key in sensors:
            choice("sensors", key, [part.removeprefix("q_") for part in beams])
        sensors = {f"q_{key}": value for key, value in sensors.items()}
    else:
        raise ValueError(
            "sensors: expected sensors by name of the wing with an aircraft, found "
            f"{type(sensors).__name__}"
        )
    found = []
    for part, beam in beams.items():
        given = sensors.get(part, ())
        own = checked_sensors(given) if len(given) or not (others or len(beams) > 1) else ()
        check_numeric(beam, own)
        q_dot = "q_dot" + part.removeprefix("q")
        found.append(Instrumented(beam=beam, sensors=own, q=part, q_dot=q_dot))
    if not others and not any(wing.sensors for wing in found):
        raise ValueError("sensors: expected one or more, found none")
    return tuple(found)


def _output_readings(
    model: ControlModel, outputs: Mapping[str, Number]
) -> tuple[OutputReading, ...]:
    parts: dict[str, Part] = {part.name: part for part in model.x.parts if not part.attitude}
    parts |= {part.name: part for part in model.y.parts}
    found = []
    for name, noise in outputs.items():
        choice("outputs", name, list(parts))
        part = parts[name]
        deviations = positive_numbers(f"outputs[{name!r}]", noise, part.size)
        found.append(OutputReading(name, part.size, part.unit, deviations))
    return tuple(found)
