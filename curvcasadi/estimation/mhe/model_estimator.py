"""A moving-horizon estimator on a control model, from checked arguments."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Literal

import numpy as np

from curvcasadi.aircraft.parts import Aircraft
from curvcasadi.beam.beam import Beam
from curvcasadi.control.signals import two_sides
from curvcasadi.estimation.mhe.estimator import ShapeMhe
from curvcasadi.estimation.mhe.model_step import model_step_function
from curvcasadi.estimation.mhe.model_window import ModelWindow
from curvcasadi.estimation.model_observation import Options, given_layouts, model_observation
from curvcasadi.estimation.model_process import Dynamics, ModelProcess
from curvcasadi.sensors import Sensor
from curvcasadi.solvers.settings import SqpSettings
from curvcasadi.symbolic.expressions import Array, Number, choice, instance

Loss = Literal["squared", "huber"]

#: Standard deviations from which a residual counts less: 95 % efficiency on Gaussian noise.
SCALES: dict[Loss, float] = {"squared": np.inf, "huber": 1.345}


def model_estimator(
    name: str,
    wings: Beam | Aircraft,
    sensors: Sequence[Sensor] | Mapping[str, Sequence[Sensor]],
    process: ModelProcess,
    outputs: Mapping[str, Number],
    options: Options,
    *,
    dt: float,
    nodes: int,
    bounds: Mapping[str, Any],
    loss: Loss,
    settings: SqpSettings,
    compiled: bool,
) -> ShapeMhe:
    """A `ShapeMhe`; the gate, iterations and recovery of the options are those of no filter."""
    observation = model_observation(wings, sensors, process, outputs, options)
    dynamics = observation.dynamics
    wrong = dynamics.unstable_at_rest(dt)
    if wrong:
        raise ValueError(f"dt: {wrong}")
    lower, upper = _bounds(dynamics, bounds)
    window = ModelWindow(
        name=name,
        observation=observation,
        nodes=nodes,
        dt=dt,
        lower=lower,
        upper=upper,
        scale=SCALES[choice("loss", loss, list(SCALES))],
    )
    return ShapeMhe(
        step=model_step_function(window, settings, compiled),
        layout=dynamics.whole,
        node=window.input,
        channels=observation.channels,
        beam=wings,
        dt=dt,
        window=nodes - 1,
        error_layout=dynamics.error,
        inputs=given_layouts(dynamics),
        dynamics=dynamics,
    )


def _bounds(dynamics: Dynamics, given: Mapping[str, Any]) -> tuple[Array, Array]:
    """Bounds (x,) of the state: those of the model's layouts, narrowed to those given by name."""
    layout = dynamics.whole
    lower, upper = (side.copy() for side in layout.bounds)
    sizes = {part.name: part.size for part in layout.parts if not part.attitude}
    for name, pair in instance("bounds", given, Mapping).items():
        choice("bounds", name, list(sizes))
        low, high = two_sides(f"bounds[{name!r}]", pair, sizes[name])
        where = layout.slices[name]
        lower[where] = np.maximum(lower[where], low)
        upper[where] = np.minimum(upper[where], high)
        if np.any(lower[where] > upper[where]):
            raise ValueError(
                f"bounds[{name!r}]: expected numbers within those of the model, found {pair!r}"
            )
    return lower, upper
