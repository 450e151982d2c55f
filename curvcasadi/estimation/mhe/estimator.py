"""Moving-horizon estimation of the shape of a wing, one step as a Function."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import casadi as ca
import numpy as np

from curvcasadi.beam.beam import Beam
from curvcasadi.estimation import ud
from curvcasadi.estimation.belief import initial_belief
from curvcasadi.estimation.mhe.step import step_function
from curvcasadi.estimation.mhe.window import WindowProblem
from curvcasadi.estimation.process import (
    Process,
    ProcessName,
    RandomWalk,
    WhiteAcceleration,
    process_model,
)
from curvcasadi.estimation.samples import numeric_array
from curvcasadi.estimation.sensor_model import check_numeric
from curvcasadi.estimation.words import mhe_words
from curvcasadi.kinematics.root_motion import root_input_names
from curvcasadi.sensors import Channels, RootMotion, Sensor
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
from curvcasadi.symbolic.text import described, shown

#: Units of what a sample depends on and the state does not hold, by name.
_UNITS = {"q_dot": "rad/(m s)", "q_ddot": "rad/(m s²)"}

#: Why an argument is needed.
_WHY = {
    "rate": "rad/(m s), of q_dot, which gyros and accelerometers read in a random walk",
    "acceleration": "rad/(m s²), of q_ddot, which accelerometers read",
}


class WindowEstimate(NamedTuple):
    """What a window of samples says, and what the next one starts from.

    Attributes
    ----------
    time : float
        Time of the newest sample, s.
    state : array, shape (x,)
        State at that time, parts as in `ShapeMhe.layout`.
    states : array, shape (x, k)
        States at all times of the window so far, one a column.
    arrival_mean : array, shape (x,)
        Mean at the start of the next window, from samples before it.
    arrival_factor : array, shape (x, x)
        Its covariance U D Uᵀ, upper triangular with D on the diagonal.
    guess : array, shape (v, N + 1)
        Guess of the next window.
    violation : float
        Violation of the bounds over its tolerance.
    stationarity : float
        Bound of the distance to the optimum over its tolerance.
    used : array, shape (r,)
        Of the newest sample, 1 where there is one, 0 where it is missing. A bearing of a point that
        the window finds out of the camera's view has 1, but no part in the estimate.
    """

    time: float
    state: Array
    states: Array
    arrival_mean: Array
    arrival_factor: Array
    guess: Array
    violation: float = 0.0
    stationarity: float = 0.0
    used: Array = np.zeros(0)

    @property
    def solved(self) -> bool:
        """Whether bounds and optimality conditions hold to their tolerances."""
        return self.violation <= 1 and self.stationarity <= 1

    @property
    def success(self) -> bool:
        """Whether the window was solved, the same as `solved`."""
        return self.solved

    @property
    def message(self) -> str:
        """Whether the window was solved, and by how much it was not."""
        if self.solved:
            return "solved"
        misses = {"bounds are exceeded": self.violation, "the optimum is missed": self.stationarity}
        return "not solved: " + " and ".join(
            f"{what} by {miss:.3g} times the tolerance" for what, miss in misses.items() if miss > 1
        )

    def __repr__(self) -> str:
        return f"<WindowEstimate at {self.time:g} s: {self.message}>"

    def __str__(self) -> str:
        rows = {
            "state": shown(self.state),
            "window": f"{self.states.shape[1]} samples",
            "used": f"{int(np.sum(self.used))} of {self.used.size} readings of the newest sample",
            "violation": f"{self.violation:.3g} of its tolerance",
            "stationarity": f"{self.stationarity:.3g} of its tolerance",
        }
        return described(f"WindowEstimate at {self.time:g} s: {self.message}", rows)

    @property
    def arrival_covariance(self) -> Array:
        """Covariance of `arrival_mean`, (x, x)."""
        return ud.covariance_of(self.arrival_factor)


@dataclass(frozen=True, eq=False, kw_only=True)
class ShapeMhe:
    """A moving-horizon estimator whose step is one Function, for Python and for C.

    Attributes
    ----------
    step : casadi.Function
        One step, as `shape_mhe` describes it.
    layout : Layout
        Parts of the state.
    node : Layout
        Parts of a column of the guess: the state, and what else is unknown at a sample.
    channels : Channels
        Rows of the measurements.
    beam : Beam
        Wing whose shape is estimated.
    dt : float
        Time between samples, s.
    window : int
        Number N of steps; a window holds N + 1 samples.
    """

    step: ca.Function
    layout: Layout
    node: Layout
    channels: Channels
    beam: Beam
    dt: float
    window: int

    @property
    def descriptions(self) -> Mapping[str, str]:
        """Words for inputs and outputs of the step, as `CFunction` takes them."""
        names = [*self.step.name_in(), *self.step.name_out()]
        return mhe_words(self.layout, self.node, self.channels, names)

    def initial(
        self,
        deviation: Mapping[str, Number],
        mean: Mapping[str, Number] | None = None,
        *,
        time: float = 0.0,
    ) -> WindowEstimate:
        """What is known of the state at the first sample, before it.

        Parameters
        ----------
        deviation : mapping of str to float or array
            Standard deviation of every part of the state, one number or one per entry; or a
            symmetric, positive definite covariance matrix of the part.
        mean : mapping of str to float or array, optional
            Parts of the state, weights within `Beam.weight_bounds`; zero where not given.
        time : float
            Time of the first sample, s.

        Returns
        -------
        WindowEstimate
            What `run_mhe` starts from.
        """
        state, factor = initial_belief(self.beam, self.layout, self.layout, deviation, mean)
        column = np.concatenate([state, np.zeros(self.node.size - state.size)])
        return WindowEstimate(
            time=numeric_array("time", time, (1, 1)).item(),
            state=state,
            states=state[:, None],
            arrival_mean=state,
            arrival_factor=factor,
            guess=np.tile(column[:, None], self.window + 1),
        )


def shape_mhe(
    beam: Beam,
    sensors: Sequence[Sensor],
    *,
    dt: float,
    window: int,
    process: ProcessName | RandomWalk | WhiteAcceleration,
    density: Number = None,
    rate: Number = None,
    acceleration: Number = None,
    rate_bound: Number | None = None,
    root: RootMotion | None = None,
    root_inputs: Sequence[str] = (),
    iterations: int | None = None,
    max_iter: int = 100,
    qp_solver: str = "own",
    settings: SqpSettings | None = None,
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
    beam : Beam
        Wing with numeric fields.
    sensors : sequence of Sensor
        Sensors on the wing.
    dt : float
        Time between samples, s.
    window : int
        Number N of steps in a window.
    process : {"random_walk", "white_acceleration"}, RandomWalk or WhiteAcceleration
        "random_walk" of q, or "white_acceleration" of (q, q_dot). A `RandomWalk` or
        `WhiteAcceleration` holds density, rate and acceleration.
    density : float or array, shape (n,), optional
        Density of the driving white noise, rad/(m √s) or, of q_dot, rad/(m s √s).
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
        size, kind or range.
    """
    function_name("name", name)
    n = instance("beam", beam, Beam).basis.n
    checked = checked_sensors(sensors)
    step = float(numeric("dt", positive("dt", dt)))
    nodes = count("window", window) + 1
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
    solving = sqp_settings(settings, iterations=iterations, max_iter=max_iter, qp_solver=qp_solver)
    return ShapeMhe(
        step=step_function(problem, solving),
        layout=described.state,
        node=node,
        channels=problem.channels,
        beam=beam,
        dt=problem.dt,
        window=nodes - 1,
    )


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
