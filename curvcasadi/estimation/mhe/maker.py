"""Moving-horizon estimators of the shape of a wing from what a user asks for."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from curvcasadi.aircraft.parts import Aircraft
from curvcasadi.beam.beam import Beam
from curvcasadi.control.model import ControlModel
from curvcasadi.estimation.mhe.estimator import ShapeMhe
from curvcasadi.estimation.mhe.model_estimator import Loss, model_estimator
from curvcasadi.estimation.mhe.step import step_function
from curvcasadi.estimation.mhe.window import WindowProblem
from curvcasadi.estimation.model_observation import Options, described_process
from curvcasadi.estimation.model_process import ModelProcess
from curvcasadi.estimation.process import (
    Process,
    ProcessName,
    RandomWalk,
    WhiteAcceleration,
    process_model,
)
from curvcasadi.estimation.sensor_model import check_numeric
from curvcasadi.kinematics.root_motion import root_input_names
from curvcasadi.sensors import RootMotion, Sensor
from curvcasadi.sensors.channels import checked_sensors
from curvcasadi.solvers.settings import SqpSettings, sqp_settings
from curvcasadi.symbolic.expressions import (
    Array,
    Number,
    count,
    function_name,
    instance,
    numeric,
    positive,
)
from curvcasadi.symbolic.layout import Layout, Part

#: Units of what a sample depends on and the state does not hold, by name.
_UNITS = {"q_dot": "rad/(m s)", "q_ddot": "rad/(m s²)"}

#: Why an argument is needed.
_WHY = {
    "rate": "rad/(m s), of q_dot, which gyros and accelerometers read in a random walk",
    "acceleration": "rad/(m s²), of q_ddot, which accelerometers read",
}


def shape_mhe(
    beam: Beam | Aircraft,
    sensors: Sequence[Sensor] | Mapping[str, Sequence[Sensor]],
    *,
    dt: float,
    window: int,
    process: ProcessName | RandomWalk | WhiteAcceleration | ControlModel | ModelProcess,
    density: Number | Mapping[str, Number] = None,
    rate: Number = None,
    acceleration: Number | Mapping[str, Number] = None,
    rate_bound: Number | None = None,
    root: RootMotion | None = None,
    root_inputs: Sequence[str] = (),
    iterations: int | None = None,
    max_iter: int = 100,
    qp_solver: str = "own",
    settings: SqpSettings | None = None,
    outputs: Mapping[str, Number] | None = None,
    gyro_bias: bool = False,
    accelerometer_bias: bool = False,
    bias_density: float | None = None,
    bounds: Mapping[str, Any] | None = None,
    loss: Loss = "squared",
    compiled: bool = False,
    name: str = "mhe",
) -> ShapeMhe:
    """Estimator of curvature weights from the last N + 1 samples, within bounds.

    Minimizes over the states x_0 … x_N of a window, within the bounds,

        ½ |x_0 − x̄|²_{P̄⁻¹} + ½ Σ_k |residual(x_k, y_k)/noise|² + ½ Σ_k |x_{k+1} − F x_k|²_{Q⁻¹}

    where x̄, P̄ tell what the samples before the window say: Gauss–Newton on the problem condensed to
    what drives the state, in units of its standard deviations. It becomes self-contained C. The
    arrival values of the next window are filtered: x̄, P̄ corrected by
    the sample y_0, linearized at the x_0 found here, and predicted by dt. With linear readings and
    idle bounds the newest state is that of the Kalman filter.

    Parameters
    ----------
    beam : Beam or Aircraft
        Wing with numeric fields; with an `aircraft_model` as process its aircraft.
    sensors : sequence of Sensor, or mapping of str to such
        Sensors on the wing; of an aircraft by name of the wing.
    dt : float
        Time between samples, s.
    window : int
        Number N of steps in a window.
    process : {"random_walk", "white_acceleration"}, RandomWalk, WhiteAcceleration, ControlModel \
or ModelProcess
        "random_walk" of q, or "white_acceleration" of (q, q_dot). A `RandomWalk` or
        `WhiteAcceleration` holds density, rate and acceleration. A `ControlModel` or `ModelProcess`
        as for `shape_ekf`; notes below say how such an estimator differs.
    density : float, array of shape (n,), or mapping of str to such, optional
        Density of the driving white noise, rad/(m √s) or, of q_dot, rad/(m s √s). With a control
        model also by name of a part of the error state.
    rate, acceleration : float or array, shape (n,), optional
        Standard deviations of what sensors read and the state does not hold: q_dot of a random walk
        with gyros or accelerometers, rad/(m s); q_ddot with accelerometers, rad/(m s²). Each sample
        then has its own, estimated with the state.
    rate_bound : float or array, shape (n,), optional
        Bound of the absolute value of q_dot, rad/(m s); of a random walk also of
        (q_{k+1} − q_k)/dt. The weights are bounded by `Beam.weight_bounds`.
    root : RootMotion, optional
        Motion of the root, gravity and magnetic field, as for `measure`.
    root_inputs : sequence of str
        What of it comes with every sample: "attitude", "position", "twist", "twist_rate".
    iterations : int, optional
        None to converge, 1 for a real-time iteration (one quadratic program, full step).
    max_iter : int
        Iterations at most where it converges.
    qp_solver : str
        "own" becomes self-contained C; in Python it is CasADi's DAQP on the same numbers. Or
        another of CasADi's QP solvers, such as "qpoases", for Python alone.
    settings : SqpSettings, optional
        Values of iterations, max_iter and qp_solver in one object, in place of these.
    outputs, gyro_bias, accelerometer_bias, bias_density : optional
        With a control model, as for `shape_ekf`.
    bounds : mapping of str to pair, optional
        With a control model: bounds (lower, upper) of parts of the state by name, numbers or
        arrays, such as {"airspeed": (15, 25)}, within those of the model.
    loss : {"squared", "huber"}
        With a control model: "huber" counts residuals beyond 1.345 standard deviations less, so
        that an outlier pulls no more than that; smooth, ρ(r) = κ² (√(1 + r²/κ²) − 1).
    compiled : bool
        With a control model: the model's part of the step is native code, many times faster in
        Python. Such a step cannot be exported as C.
    name : str
        Name of the step, also in generated C.

    Returns
    -------
    ShapeMhe
        Its step has the inputs arrival_mean (x, 1); arrival_factor (x, x), upper triangular: U D Uᵀ
        with D on the diagonal, as in `shape_ekf`; measured (m, N + 1), one sample a column, NaN
        where missing; guess (v, N + 1); and root inputs, N + 1 side by side. Outputs: state (x, 1),
        the newest; states (x, N + 1); arrival_mean_after, arrival_factor_after and guess_after, for
        the next step; violation (1, 1), the largest excess over a bound over 1e-6 (`Grid.real`
        float: 1e-5), and stationarity (1, 1), a bound of the distance to the optimum in standard
        deviations of what is known before the samples, of x_0 and of what drives the state, over
        1e-4 (float: 0.3): at most 1 both where the estimate is good. For a number of iterations
        the optimum is that of the last program.

        In single precision bounds on rates leave some cold first windows unsolved (9 of 60), and
        more than half where they bound the steps of a random walk. In C the wrapper then leaves its
        outputs untouched: call again with the same arrival values and the next window, start warm,
        or, better, use double, which a Cortex-M7 has.

        Until the first window is full, samples to come are missing ones, and arrival values stay;
        `run_mhe` does so.

    Raises
    ------
    ValueError
        If something is missing that the sensors or the process need, or an argument is of another
        size, kind or range; with a control model, if `dt` is beyond the stability of its steps.

    Notes
    -----
    With a control model the state is that of the model, then the parameters that are estimated,
    gyro_bias and accelerometer_bias. What drives it is white noise on parts of its error state,
    half before a step and half behind, as in `shape_ekf`; attitudes are moved on the group. Its
    bounds are those of the model's layouts, `bounds` and, of weights, `Beam.weight_bounds`. The
    step takes the model's inputs and known parameters as "u" and "p", a column a sample: as they
    were since the sample before. `guess` (w, N + 1) holds what drives the window, in standard
    deviations, and an output "noise" what it was found to be: the guess of the same window.
    Without bounds, outliers and what is not linear the newest state is that of `shape_ekf`, and a
    window that holds all samples gives the states of the Kalman smoother.
    """
    function_name("name", name)
    step = float(numeric("dt", positive("dt", dt)))
    nodes = count("window", window) + 1
    solving = sqp_settings(settings, iterations=iterations, max_iter=max_iter, qp_solver=qp_solver)
    if isinstance(process, ControlModel | ModelProcess):
        _refuse("with a control model", {"rate": rate, "rate_bound": rate_bound})
        return model_estimator(
            name,
            beam,
            sensors,
            described_process(process, density, acceleration),
            dict(outputs or {}),
            Options(
                root=root,
                root_inputs=root_input_names(root_inputs),
                gate=np.inf,
                iterations=1,
                recovery=0,
                gyro_bias=gyro_bias,
                accelerometer_bias=accelerometer_bias,
                bias_density=bias_density,
            ),
            dt=step,
            nodes=nodes,
            bounds=bounds or {},
            loss=loss,
            settings=solving,
            compiled=compiled,
        )
    others: dict[str, Any] = {"outputs": outputs, "bounds": bounds, "bias_density": bias_density}
    others |= {"gyro_bias": gyro_bias or None, "accelerometer_bias": accelerometer_bias or None}
    others |= {"loss": None if loss == "squared" else loss, "compiled": compiled or None}
    _refuse("without a control model", others)
    instance("beam", beam, Beam)
    if isinstance(sensors, Mapping) or not isinstance(beam, Beam):
        raise ValueError("sensors: expected a sequence of sensors, found a mapping")
    n, checked = beam.basis.n, checked_sensors(sensors)
    kind, density, rate, acceleration = process_model(
        process, density=density, rate=rate, acceleration=acceleration
    )
    check_numeric(beam, checked)
    known = root_input_names(root_inputs)
    order = max(sensor.order for sensor in checked)
    unknown = {}
    if order >= 1 and kind == "random_walk":
        unknown["q_dot"] = _per_weight("rate", rate, n)
    if order == 2:
        unknown["q_ddot"] = _per_weight("acceleration", acceleration, n)
    described = Process(
        kind=kind,
        density=_per_weight("density", density, n),
        root_rotation=beam.root.rotation,
    )
    most = np.inf if rate_bound is None else rate_bound
    rates = _per_weight("rate_bound", most, n, infinite=True)
    node = _node(described.state, unknown, {"q": beam.bounds, "q_dot": (-rates, rates)})
    problem = WindowProblem(
        name=name,
        beam=beam,
        sensors=checked,
        root=root,
        known=known,
        process=described,
        node=node,
        unknown=unknown,
        moves=rates * step if kind == "random_walk" else np.full(n, np.inf),
        nodes=nodes,
        dt=step,
    )
    return ShapeMhe(
        step=step_function(problem, solving),
        layout=described.state,
        error_layout=described.error,
        node=node,
        channels=problem.channels,
        beam=beam,
        dt=problem.dt,
        window=nodes - 1,
    )


def _refuse(where: str, given: Mapping[str, Any]) -> None:
    for name, value in given.items():
        if value is not None:
            raise ValueError(f"{name}: expected none {where}, found {value!r}")


def _node(
    state: Layout, unknown: Mapping[str, Array], bounds: Mapping[str, tuple[Array, Array]]
) -> Layout:
    """The state, then the unknowns, with the bounds of those that have any."""
    parts = [(part.name, part.size, part.unit) for part in state.parts]
    parts += [(name, values.size, _UNITS[name]) for name, values in unknown.items()]
    free = (-np.inf, np.inf)
    return Layout(tuple(Part(*part, *bounds.get(part[0], free)) for part in parts))


def _per_weight(name: str, value: Number, n: int, *, infinite: bool = False) -> Array:
    """`value`, a number above zero or n of them, as (n,)."""
    try:
        found = np.array(np.broadcast_to(np.asarray(value, dtype=float).ravel(), (n,)))
    except (TypeError, ValueError, NotImplementedError):
        found = np.full(n, np.nan)
    if not np.all(found > 0) or not (infinite or np.all(np.isfinite(found))):
        why = f" ({_WHY[name]})" if value is None and name in _WHY else ""
        raise ValueError(f"{name}: expected one or {n} numbers above zero{why}, found {value!r}")
    return found
