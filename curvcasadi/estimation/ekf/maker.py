"""Shape filters from what a user asks for."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from curvcasadi.aircraft.parts import Aircraft
from curvcasadi.beam.beam import Beam
from curvcasadi.control.model import ControlModel
from curvcasadi.estimation.ekf.filter import ShapeEkf
from curvcasadi.estimation.ekf.model_filter import RECOVERY, model_filter
from curvcasadi.estimation.ekf.readings import Observation
from curvcasadi.estimation.ekf.update import update_function
from curvcasadi.estimation.model_observation import Options, described_process
from curvcasadi.estimation.model_process import ModelProcess
from curvcasadi.estimation.process import (
    Process,
    ProcessName,
    RandomWalk,
    WhiteAcceleration,
    predict_function,
    process_model,
)
from curvcasadi.estimation.sensor_model import check_numeric
from curvcasadi.kinematics.root_motion import numeric_root, root_input_names
from curvcasadi.sensors import RateGyro, RootMotion, Sensor, sensor_channels
from curvcasadi.sensors.channels import checked_sensors
from curvcasadi.sensors.sensor import positive_numbers
from curvcasadi.symbolic.expressions import (
    Array,
    Number,
    count,
    function_name,
    instance,
    is_numeric,
    numeric,
    positive,
)


def shape_ekf(
    beam: Beam | Aircraft,
    sensors: Sequence[Sensor] | Mapping[str, Sequence[Sensor]],
    *,
    process: ProcessName | RandomWalk | WhiteAcceleration | ControlModel | ModelProcess,
    density: Number | Mapping[str, Number] = None,
    rate: Number = None,
    acceleration: Number | Mapping[str, Number] = None,
    attitude: bool = False,
    root_gyro_density: float | None = None,
    gyro_bias: bool = False,
    bias_density: float | None = None,
    root: RootMotion | None = None,
    root_inputs: Sequence[str] = (),
    gate: float = 5.0,
    iterations: int = 1,
    outputs: Mapping[str, Number] | None = None,
    accelerometer_bias: bool = False,
    recovery: int | None = None,
    name: str = "ekf",
) -> ShapeEkf:
    """Extended Kalman filter of curvature weights, and of what else is asked for.

    The state is, in this order: attitude of the parent (9, R by columns; on request), q, q_dot
    (white acceleration only), gyro_bias (three a wing gyro, in the order of `sensors`) and
    root_gyro_bias. The error of the attitude R is a rotation vector φ on the right, R exp([φ×]),
    parent axes; the covariance is kept as U D Uᵀ, so that it is positive definite in single
    precision, too. Samples are used one at a time: one that is NaN or fails the gate changes
    nothing.

    What readings depend on and the state does not hold is noise that all samples of an update
    share: q_ddot for accelerometers, and q_dot in a random walk. Its effect is not simply added to
    the noise of each sensor: within an update it is estimated beside the state, and forgotten
    after it. Readings are linearized at what a first pass finds of it, as J(q) q_ddot depends on
    the shape, too. Of the derivative of accelerometers by q, the part that is quadratic in q_dot,
    (d/dq)(dJ/dt q_dot), is left out.

    With gyros and accelerometers alone, in-plane bending, which turns about gravity, is seen at
    second order only, and the filter becomes overconfident: of 40 runs on a wing with in-plane
    weights 12 had a normalized error squared above three times its expectation. Leave in-plane
    weights out of the basis, add magnetometers or attitude sensors, or use `shape_mhe`, whose error
    was 0.012 where the filter's was 0.12.

    Accelerometers need gyros: with accelerometers and attitude sensors of 0.01 rad alone, in white
    acceleration from a start of 0.01 rad/m and 0.05 rad/(m s), the filter is grossly overconfident,
    as the readings bend with rates that nothing else tells. Of 40 runs 15 had a normalized error
    squared above three times its expectation, hundreds of times in the mean; with two gyros
    beside them none, and 1.03 times in the mean (5 iterations, gate 5).

    Parameters
    ----------
    beam : Beam or Aircraft
        Wing with numeric fields; with an `aircraft_model` as process its aircraft.
    sensors : sequence of Sensor, or mapping of str to such
        Sensors on the wing; of an aircraft by name of the wing. A sensor at xi = 0 moves with the
        body.
    process : {"random_walk", "white_acceleration"}, RandomWalk, WhiteAcceleration, ControlModel \
or ModelProcess
        "random_walk" of q, or "white_acceleration" of q (state q, q_dot). A `RandomWalk` or
        `WhiteAcceleration` holds density, rate and acceleration. A `ControlModel` moves the state
        by its own equations, driven by its inputs and by noise of the given density on q_dot; a
        `ModelProcess` says more about it. Notes below say how such a filter differs.
    density : float, array of shape (n,), or mapping of str to such, optional
        Density of the process noise, rad/(m √s), or of white acceleration rad/(m s √s); after the
        time t its integral has the standard deviation density √t. With a control model also by
        name of a part of the error state.
    rate : float or array, shape (n,), optional
        Standard deviation of q_dot, rad/(m s); needed by gyros and accelerometers in a random walk.
    acceleration : float or array, shape (n,), optional
        Standard deviation of q_ddot, rad/(m s²); needed by accelerometers.
    attitude : bool
        Whether the parent's attitude is estimated; `predict` then takes "rate" (3, 1), rad/s, the
        reading of a gyro at the root, root axes. Gyros on the wing read the root's motion, too, and
        need the root input "twist"; accelerometers also "twist_rate", unless that is small.
    root_gyro_density : float, optional
        Noise density of that gyro, rad/√s.
    gyro_bias : bool
        Whether biases of the gyros on the wing, and of the root's, are estimated.
    bias_density : float, optional
        Density of the random walk of the biases, rad/(s √s).
    root : RootMotion, optional
        Numbers for what is known of the root's motion, gravity and magnetic field.
    root_inputs : sequence of str
        What is an input of `update` instead, out of "attitude" (3, 3), "position" (3, 1), "twist"
        (6, 1) and "twist_rate" (6, 1), as in `RootMotion`. The estimated bias of the root's gyro is
        taken off the twist; its noise is not accounted for in the gyros on the wing.
    gate : float
        Largest innovation over its standard deviation; np.inf uses everything. From a wide start a
        gate helps the linearization, too: in the runs with gyros above the mean was 1.03 with a
        gate of 5, and 2.6 without. The three rows of an attitude sensor are used or left out
        together.
    iterations : int
        Linearizations of an update. One serves a filter that has converged; from a start whose
        errors bend the readings (or after a long gap) take five or more, in a second filter.
    outputs : mapping of str to float or array, optional
        With a control model: its outputs, or parts of its state, that are measured, too, by name,
        and the standard deviations of their samples. They stand behind the sensors' readings.
    accelerometer_bias : bool
        Whether biases of accelerometers are estimated, with a control model.
    recovery : int, optional
        Of how many updates in a row most samples of a kind of sensor have to fail the gate before
        it opens, so that the filter does not lock itself out after a wrong start; 0 for never.
        Unless given 10 with a control model, else 0. Counters of it are then part of the state.
    name : str
        The Functions are called <name>_predict and <name>_update.

    Returns
    -------
    ShapeEkf
        `run_ekf` calls it sample by sample; in C its two Functions are called in turn.

    Raises
    ------
    ValueError
        If something is missing that the sensors, the process or a request needs, or an argument is
        of another size, kind or range.

    Notes
    -----
    With a control model the state is that of the model, then the parameters that are estimated,
    gyro_bias, accelerometer_bias, and counters of rejected updates, which have no error. Both
    Functions take the model's inputs and other parameters as "u" and "p", where it has any: as they
    were since the sample before. Attitudes of a model are unit quaternions, with a rotation vector
    on the right as error, local axes. Accelerometers read the model's own accelerations, whose
    derivatives by shape, rates and states of the air are complete; what the model may be wrong by
    is `acceleration`, noise that all samples of an update share. A step is one of Runge–Kutta
    (`ModelProcess.substeps`), half of the noise before it and half behind. Biases are constant
    unless `bias_density`, or a density of their own, lets them wander.

    Of the samples of each kind of sensor (a class of sensors, or an output) a counter in the state
    says in how many updates in a row more than half failed the gate. From `recovery` on, a sample
    of this kind that fails the gate widens the covariance, only along the direction in which it
    corrects the state, until it is one standard deviation off, and is used; the first update in
    which most samples pass ends this. One wrong sensor among three of its kind stays out; of two,
    or alone, it is believed after that many updates.
    """
    function_name("name", name)
    if isinstance(process, ControlModel | ModelProcess):
        unused = {"rate": rate, "root_gyro_density": root_gyro_density, "attitude": attitude}
        for key, value in unused.items():
            if value is not None and value is not False:
                raise ValueError(f"{key}: expected none with a control model, found {value}")
        options = Options(
            root=root,
            root_inputs=root_input_names(root_inputs),
            gate=_gate(gate),
            iterations=count("iterations", iterations),
            recovery=RECOVERY if recovery is None else count("recovery", recovery, 0),
            gyro_bias=gyro_bias,
            accelerometer_bias=accelerometer_bias,
            bias_density=bias_density,
        )
        by_model = described_process(process, density, acceleration)
        return ShapeEkf(**model_filter(name, beam, sensors, by_model, dict(outputs or {}), options))
    if outputs is not None:
        raise ValueError(f"outputs: expected None without a control model, found {outputs}")
    if accelerometer_bias:
        raise ValueError("accelerometer_bias: expected a control model as process with it")
    instance("beam", beam, Beam)
    if isinstance(sensors, Mapping) or not isinstance(beam, Beam):
        raise ValueError("sensors: expected a sequence of sensors, found a mapping")
    n = beam.basis.n
    checked = checked_sensors(sensors)
    order = max(sensor.order for sensor in checked)
    kind, density, rate, acceleration = process_model(
        process, density=density, rate=rate, acceleration=acceleration
    )
    gyros = sum(isinstance(sensor, RateGyro) for sensor in checked)
    known = root_input_names(root_inputs)
    if attitude and "attitude" in known:
        raise ValueError("root_inputs: expected no attitude where it is estimated, found one")
    check_numeric(beam, checked)
    if attitude and order and "twist" not in known:
        also = ", and for accelerometers 'twist_rate' unless it is small," if order == 2 else ""
        raise ValueError(
            f"root_inputs: expected 'twist'{also} "
            "where the attitude is estimated, as the wing's gyros and accelerometers also read the "
            f"root's rate; found {list(known)}"
        )
    if gyro_bias and not (gyros or attitude):
        raise ValueError("gyro_bias: expected a gyro on the wing or at the root, found none")
    unknown = {}
    if order >= 1 and kind == "random_walk":
        unknown["q_dot"] = _needed("rate", rate, n)
    if order == 2:
        unknown["q_ddot"] = _needed("acceleration", acceleration, n)
    described = Process(
        kind=kind,
        density=_needed("density", density, n),
        attitude=attitude,
        root_rotation=beam.root.rotation,
        rate_density=_one("root_gyro_density", root_gyro_density) if attitude else None,
        biases=gyros if gyro_bias else 0,
        root_bias=gyro_bias and attitude,
        bias_density=_one("bias_density", bias_density) if gyro_bias else None,
    )
    limit, opens = _gate(gate), count("recovery", 0 if recovery is None else recovery, 0)
    observation = Observation(
        beam=beam,
        sensors=checked,
        channels=sensor_channels(checked),
        root=numeric_root(root, known),
        unknown=unknown,
        inputs=known,
        gate=limit,
        iterations=count("iterations", iterations),
        recovery=opens if limit < np.inf else 0,
    )
    described = replace(described, counters=len(observation.kinds) if observation.recovery else 0)
    return ShapeEkf(
        predict=predict_function(f"{name}_predict", described),
        update=update_function(f"{name}_update", described, observation),
        layout=described.state,
        error_layout=described.error,
        channels=observation.channels,
        beam=beam,
    )


#: What arguments are that may be missing.
_MEANING = {
    "density": "the density of the process noise, rad/(m √s) or rad/(m s √s)",
    "rate": "the standard deviation of q_dot, rad/(m s), as gyros and accelerometers read the rate "
    "of a random walk",
    "acceleration": "the standard deviation of q_ddot, rad/(m s²), as accelerometers read it",
    "root_gyro_density": "the noise of the gyro at the root, rad/√s, as it drives the attitude",
    "bias_density": "the noise of the random walk of the biases, rad/(s √s)",
}


def _gate(value: Any) -> float:
    """`value`, a number above zero, or infinity."""
    if is_numeric(value) and value == np.inf:
        return np.inf
    return float(numeric("gate", positive("gate", value)))


def _one(name: str, value: Any) -> float:
    return float(_needed(name, value, 1)[0])


def _needed(name: str, value: Number, size: int) -> Array:
    if value is None:
        raise ValueError(f"{name}: expected {_MEANING[name]}; found None")
    return positive_numbers(name, value, size)
