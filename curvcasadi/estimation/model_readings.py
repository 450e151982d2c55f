"""What estimators on a control model read: sensors on wings, and outputs of the model.

Sensors on a wing read q, q_dot and the model's q_ddot(x, u, p); with A = ∂q_ddot/∂δ the row of an
accelerometer is

    H = ∂h/∂q E_q + ∂h/∂q_dot E_q_dot + ∂h/∂q_ddot A

(E picks the part of the error state). The motion of the body, its acceleration included, adds its
own blocks in the same way.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import casadi as ca
import numpy as np

from curvcasadi.beam.beam import Beam
from curvcasadi.beam.pose import Pose
from curvcasadi.control.error_state import add
from curvcasadi.estimation.model_process import Dynamics, columns_of, rates_function
from curvcasadi.estimation.rows import Rows
from curvcasadi.kinematics.root_motion import ROOT_INPUTS
from curvcasadi.lie import quaternion, se3
from curvcasadi.sensors import Accelerometer, Channels, RateGyro, RootMotion, Sensor
from curvcasadi.sensors.channels import sensor_channels
from curvcasadi.sensors.readout import Readout
from curvcasadi.symbolic.expressions import AnyExpr, Array
from curvcasadi.symbolic.layout import Layout, Part

#: Kinds of sensors whose bias may be estimated, by the name of the bias.
BIASED: dict[str, type[Sensor]] = {"gyro_bias": RateGyro, "accelerometer_bias": Accelerometer}


@dataclass(frozen=True, eq=False, kw_only=True)
class Instrumented:
    """A wing with its sensors, and the names of its parts of the model's state."""

    beam: Beam
    sensors: tuple[Sensor, ...]
    q: str
    q_dot: str

    @property
    def order(self) -> int:
        """The highest order of the sensors."""
        return max((sensor.order for sensor in self.sensors), default=0)


@dataclass(frozen=True, eq=False)
class OutputReading:
    """A named output of the model, or part of its state, as a sensor reads it."""

    name: str
    size: int
    unit: str
    noise: Array
    whole: bool = False
    stand_in: tuple[float, ...] = ()
    may_be_hidden: bool = False

    @property
    def residual_components(self) -> tuple[str, ...]:
        """One per entry."""
        return ("",) if self.size == 1 else tuple(str(i) for i in range(self.size))

    def present(self, values: Any) -> Any:
        """1 for each entry that is there."""
        return ca.logic_or(values < 0, values >= 0)


@dataclass(frozen=True, eq=False, kw_only=True)
class ModelObservation:
    """Checked description of what is measured."""

    dynamics: Dynamics
    wings: tuple[Instrumented, ...]
    outputs: tuple[OutputReading, ...]
    root: RootMotion
    inputs: tuple[str, ...]  #: of `ROOT_INPUTS`
    unknown: Mapping[str, Array]  #: deviations of accelerations, by name of the part q_dot
    gate: float
    iterations: int
    recovery: int
    kinds: tuple[str, ...] = field(default=())  #: whose rejections are counted

    @property
    def channels(self) -> Channels:
        """Rows of all: sensors of every wing, then outputs."""
        return joined_channels(self.wings, self.outputs)

    @property
    def symbols(self) -> dict[str, ca.MX]:
        """What the update takes beside state, factor and measurements."""
        own = {key: ca.MX.sym(key, *ROOT_INPUTS[key]) for key in self.inputs}
        return self.dynamics.inputs | own

    @property
    def kind_of_rows(self) -> list[int]:
        """The kind of each group of rows."""
        found = [kind_name(sensor) for sensor in self.channels.sensors]
        return [self.kinds.index(name) for name in found]


def kind_name(sensor: Any) -> str:
    """What counts as one kind: sensors of a class, and each output."""
    return sensor.name if isinstance(sensor, OutputReading) else sensor.prefix


def joined_channels(
    wings: tuple[Instrumented, ...], outputs: tuple[OutputReading, ...]
) -> Channels:
    """The rows of sensors of wings and of outputs; of several wings their names come first."""
    sensors: list[Any] = []
    parts, residuals, labels, errors = [], [], [], []
    noise: list[Array] = [np.zeros(0)]
    for wing in wings:
        if not wing.sensors:
            continue
        prefix = wing.q.removeprefix("q").lstrip("_") + "_" if wing.q != "q" else ""
        own = sensor_channels(wing.sensors)
        sensors += own.sensors
        parts += [Part(prefix + p.name, p.size, p.unit) for p in own.layout.parts]
        residuals += [Part(prefix + p.name, p.size, p.unit) for p in own.residual_layout.parts]
        labels += [prefix + label for label in own.labels]
        errors += [prefix + label for label in own.residual_labels]
        noise.append(own.noise)
    for output in outputs:
        sensors.append(output)
        parts.append(Part(output.name, output.size, output.unit))
        residuals.append(parts[-1])
        names = [f"{output.name}_{c}" if c else output.name for c in output.residual_components]
        labels, errors = labels + names, errors + names
        noise.append(output.noise)
    layout, residual_layout = Layout(tuple(parts)), Layout(tuple(residuals))
    return Channels(
        sensors=tuple(sensors),
        layout=layout,
        residual_layout=residual_layout,
        labels=tuple(labels),
        residual_labels=tuple(errors),
        units=tuple(p.unit for p in parts for _ in range(p.size)),
        residual_units=tuple(p.unit for p in residuals for _ in range(p.size)),
        noise=np.concatenate(noise),
    )


@dataclass(frozen=True, eq=False)
class ModelReadings:
    """The readings of an observation at a state without counters."""

    observation: ModelObservation
    whole: ca.MX
    samples: ca.MX
    known: Mapping[str, ca.MX]
    accelerations: Mapping[str, ca.MX] = field(default_factory=dict)  #: beside the model's

    def rows(self) -> list[Rows]:
        """Rows of every sensor and output, over the unknown accelerations and the error state."""
        found: list[Rows] = []
        channels = self.observation.channels
        samples = channels.layout.split(self.samples)
        noise = channels.residual_layout.split(ca.DM(channels.noise))
        blocks: list[tuple[AnyExpr, AnyExpr]] = []
        for wing in self.observation.wings:
            if wing.sensors:
                blocks += self._wing_blocks(wing, list(samples.values())[len(blocks) :])
        blocks += self._output_blocks(list(samples.values())[len(blocks) :])
        pairs = zip(blocks, noise.values(), channels.sensors, strict=True)
        for (slope, residual), deviation, sensor in pairs:
            stacked = ca.densify(ca.horzcat(slope, residual)).T
            rows = ca.horzsplit(stacked)
            variance = deviation.full()[:, 0] ** 2
            found.append(Rows(shared=False, together=sensor.whole, rows=rows, variance=variance))
        return found

    def _wing_blocks(self, wing: Instrumented, samples: list[ca.MX]) -> list[tuple[Any, Any]]:
        """Slope and residual of each sensor of a wing."""
        motion, slopes = self._motion(wing)
        root = self.observation.root.with_inputs({**self.known, **_named(motion, ROOT_INPUTS)})
        readout = Readout.of(
            wing.sensors,
            wing.beam,
            motion["q"],
            motion.get("q_dot"),
            motion.get("q_ddot"),
            root,
        )
        sizes = {key: slope.shape[0] for key, slope in slopes.items()}
        names = [part.name for part in readout.channels.layout.parts]
        given = dict(zip(names, samples[: len(names)], strict=True))
        biases = self._biases(wing)
        unknowns = sum(map(len, self.observation.unknown.values()))
        found = []
        for name, sensor, block in zip(
            names, wing.sensors, readout.blocks(given, sizes), strict=True
        ):
            _, residual, *by = block
            by_motion = dict(zip(slopes, by, strict=True))
            slope: Any = sum(by_motion[key] @ slopes[key] for key in slopes)
            for bias, where in biases.get(name, {}).items():
                residual = residual + self._parts[bias][where]
                picked = ca.DM.eye(self._parts[bias].numel())[where, :]
                slope = slope + columns_of(bias, self.observation.dynamics.error, picked)
            shared = ca.MX(ca.DM.zeros(residual.numel(), unknowns))
            if sensor.order == 2 and wing.q_dot in self.observation.unknown:
                shared = self._by_unknown(wing, by_motion["q_ddot"])
            found.append((ca.horzcat(shared, slope), residual))
        return found

    @property
    def _parts(self) -> dict[str, ca.MX]:
        return self.observation.dynamics.whole.split(self.whole)

    def _by_unknown(self, wing: Instrumented, block: ca.MX) -> ca.MX:
        layout = Layout(
            tuple(Part(k, len(x), "rad/(m s2)") for k, x in self.observation.unknown.items())
        )
        return columns_of(wing.q_dot, layout, block)

    def _motion(self, wing: Instrumented) -> tuple[dict[str, ca.MX], dict[str, ca.MX]]:
        """What the sensors of a wing depend on, and its derivatives by the error state."""
        dynamics = self.observation.dynamics
        parts, error = self._parts, dynamics.error

        def picked(name: str) -> AnyExpr:
            return ca.DM.eye(error.size)[error.slices[name], :]

        motion, slopes = {"q": parts[wing.q]}, {"q": ca.MX(picked(wing.q))}
        names = [part.name for part in dynamics.model.x.parts]
        free = "twist" in names
        if wing.order == 0 and not free:
            return motion, slopes
        wanted, rates = [wing.q_dot if wing.q_dot in names else wing.q], {}
        if free:
            wanted.append("twist")
        arguments = [self.whole, *(self.known[key] for key in dynamics.inputs)]
        value, slope = rates_function(dynamics, tuple(wanted))(*arguments)
        start = 0
        for name in wanted:
            end = start + dynamics.model.x.slices[name].stop - dynamics.model.x.slices[name].start
            rates[name] = value[start:end], slope[start:end, :]
            start = end
        if wing.q_dot in names:
            motion["q_dot"], slopes["q_dot"] = parts[wing.q_dot], ca.MX(picked(wing.q_dot))
            if wing.order == 2:
                q_ddot, slopes["q_ddot"] = rates[wing.q_dot]
                motion["q_ddot"] = q_ddot + self.accelerations.get(wing.q_dot, 0)
        else:
            motion["q_dot"], slopes["q_dot"] = rates[wing.q]
        if free:
            to_root = _adjoint(wing.beam.root.inverse())
            motion["attitude"] = quaternion.rotation(parts["quaternion_wxyz"])
            slopes["attitude"] = ca.MX(picked("quaternion_wxyz"))
            motion["position"], slopes["position"] = parts["position"], ca.MX(picked("position"))
            motion["twist"], slopes["twist"] = to_root @ parts["twist"], to_root @ picked("twist")
            motion["twist_rate"] = to_root @ rates["twist"][0]
            slopes["twist_rate"] = to_root @ rates["twist"][1]
        return motion, slopes

    def _biases(self, wing: Instrumented) -> dict[str, dict[str, slice]]:
        """Of each sensor its biases in the state, and where they stand in them."""
        counts = dict.fromkeys(BIASED, 0)
        found: dict[str, dict[str, slice]] = {}
        for other in self.observation.wings:
            if not other.sensors:
                continue
            names = [p.name for p in sensor_channels(other.sensors).layout.parts]
            for name, sensor in zip(names, other.sensors, strict=True):
                for bias, kind in BIASED.items():
                    if isinstance(sensor, kind):
                        start = counts[bias]
                        counts[bias] += 3
                        if other is wing and bias in self.observation.dynamics.biases:
                            found.setdefault(name, {})[bias] = slice(start, start + 3)
        return found

    def _output_blocks(self, samples: list[ca.MX]) -> list[tuple[Any, Any]]:
        dynamics, outputs = self.observation.dynamics, self.observation.outputs
        if not outputs:
            return []
        read = _outputs_function(dynamics, tuple(output.name for output in outputs))
        arguments = [self.whole, *(self.known[key] for key in dynamics.inputs)]
        results = read(*arguments)
        unknowns = sum(map(len, self.observation.unknown.values()))
        found = []
        for output, given, value, slope in zip(
            outputs, samples, results[::2], results[1::2], strict=True
        ):
            shared = ca.MX(ca.DM.zeros(output.size, unknowns))
            found.append((ca.horzcat(shared, slope), value - given))
        return found


def _adjoint(pose: Pose) -> AnyExpr:
    return se3.adjoint(se3.matrix(pose.rotation, pose.position))


def _named(values: Mapping[str, ca.MX], names: Mapping[str, Any]) -> dict[str, ca.MX]:
    return {key: value for key, value in values.items() if key in names}


def _outputs_function(dynamics: Dynamics, names: tuple[str, ...]) -> Any:
    """(state without counters, u, p) -> value and derivative by the error state, of each output."""
    start, given = ca.MX.sym("start", dynamics.whole.size), dynamics.inputs
    error = ca.MX.sym("error", dynamics.error.size)
    moved = add(dynamics.whole, start, error)
    x, u, p = dynamics.arguments(moved, given)
    values = dynamics.whole.split(moved) | dynamics.model.y.split(dynamics.model.output(x, u, p))
    results = []
    for name in names:
        results += [values[name], ca.densify(ca.jacobian(values[name], error))]
    arguments = [start, *given.values()]
    varied = ca.Function("varied", [error, *arguments], results)
    at_zero = varied.call([ca.MX(ca.DM.zeros(error.numel())), *arguments])
    return ca.Function("outputs", arguments, at_zero, {"cse": True})
