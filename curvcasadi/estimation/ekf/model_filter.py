"""A filter on a control model, from checked arguments."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from typing import Any

from curvcasadi.aircraft.parts import Aircraft
from curvcasadi.beam.beam import Beam
from curvcasadi.estimation.ekf.model_update import model_update_function
from curvcasadi.estimation.model_observation import Options, given_layouts, model_observation
from curvcasadi.estimation.model_process import (
    Dynamics,
    ModelProcess,
    model_predict_function,
)
from curvcasadi.sensors import Channels, Sensor
from curvcasadi.symbolic.expressions import Number

#: Updates in a row that fail the gate before it opens, unless told.
RECOVERY = 10


def model_filter(
    name: str,
    wings: Beam | Aircraft,
    sensors: Sequence[Sensor] | Mapping[str, Sequence[Sensor]],
    process: ModelProcess,
    outputs: Mapping[str, Number],
    options: Options,
) -> dict[str, Any]:
    """The fields of a `ShapeEkf`."""
    observation = model_observation(wings, sensors, process, outputs, options)
    dynamics = observation.dynamics
    _warn_of_sampling(dynamics, observation.channels)
    return {
        "predict": model_predict_function(f"{name}_predict", dynamics),
        "update": model_update_function(f"{name}_update", observation),
        "layout": dynamics.state,
        "error_layout": dynamics.error,
        "channels": observation.channels,
        "beam": wings,
        "inputs": given_layouts(dynamics),
        "dynamics": dynamics,
    }


def _warn_of_sampling(dynamics: Dynamics, channels: Channels) -> None:
    """Warn where even the fastest sensor leaves more time between samples than steps may take."""
    rates = [sensor.rate for sensor in channels.sensors if hasattr(sensor, "rate")]
    if rates:
        wrong = dynamics.unstable_at_rest(1 / max(rates))
        if wrong:
            warnings.warn(f"process: at the rate of the sensors {wrong}", stacklevel=4)
