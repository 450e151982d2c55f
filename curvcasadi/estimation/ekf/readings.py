"""What the update of a shape filter reads: residuals of sensors, linearized at a state."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import casadi as ca

from curvcasadi.beam.beam import Beam
from curvcasadi.estimation.process import Process
from curvcasadi.estimation.rows import Rows
from curvcasadi.sensors import Channels, RateGyro, RootMotion, Sensor
from curvcasadi.sensors.readout import Readout
from curvcasadi.symbolic.expressions import AnyExpr, Array


@dataclass(frozen=True, eq=False, kw_only=True)
class Observation:
    """Checked description of what is measured.

    `unknown` are variables that a reading depends on and the state does not hold, with standard
    deviations: zero-mean noise that all rows of an update share. They go before the error state,
    where a factor U D Uᵀ is marginalized by leaving out its first rows and columns.
    """

    beam: Beam
    sensors: tuple[Sensor, ...]
    channels: Channels
    root: RootMotion
    unknown: Mapping[str, Array]  #: standard deviations (n,) of "q_dot", "q_ddot"
    inputs: tuple[str, ...]  #: of "attitude", "position", "twist", "twist_rate": known motion
    gate: float  #: largest innovation over its standard deviation
    iterations: int  #: linearizations of an update
    recovery: int = 0  #: failed updates in a row after which the gate opens; 0 for never

    @property
    def kinds(self) -> tuple[str, ...]:
        """Kinds of sensors, whose rejections are counted."""
        return tuple(dict.fromkeys(sensor.prefix for sensor in self.sensors))


@dataclass(frozen=True, eq=False)
class Readings:
    """The sensors of an observation at a state."""

    process: Process
    observation: Observation
    state: ca.MX
    samples: ca.MX
    known: Mapping[str, ca.MX]

    def rows(self, unknown: ca.MX | None) -> list[Rows]:
        """Rows of every sensor, linearized at `unknown`; None is at zero."""
        n, needed = self.process.n, self.observation.unknown
        at: dict[str, AnyExpr] = dict.fromkeys(needed, ca.DM.zeros(n))
        if unknown is not None:
            at = {key: unknown[n * i : n * (i + 1)] for i, key in enumerate(needed)}
        parts = self.process.state.split(self.state)
        readout = self._readout(parts, parts.get("q_dot", at.get("q_dot")))
        q_ddot = at.get("q_ddot") if unknown is not None else None
        return self._linearized(parts, readout, q_ddot)

    def offset(self, unknown: ca.MX) -> ca.MX:
        """Unknowns at which `rows` has its residuals: readings are affine in q_ddot."""
        n, needed = self.process.n, self.observation.unknown
        at = [
            unknown[n * i : n * (i + 1)] if key == "q_dot" else ca.MX(ca.DM.zeros(n))
            for i, key in enumerate(needed)
        ]
        return ca.vertcat(ca.MX(0, 1), *at)

    def _readout(self, parts: Mapping[str, ca.MX], q_dot: AnyExpr) -> Readout:
        known = dict(self.known)
        if "attitude" in parts:
            known["attitude"] = ca.reshape(parts["attitude"], 3, 3)
        if "root_gyro_bias" in parts and "twist" in known:
            bias = ca.vertcat(parts["root_gyro_bias"], ca.DM.zeros(3))
            known["twist"] = known["twist"] - bias
        root = self.observation.root.with_inputs(known)
        q_dot = None if q_dot is None else ca.MX(q_dot)
        sensors, beam = self.observation.sensors, self.observation.beam
        return Readout.of(sensors, beam, parts["q"], q_dot, None, root)

    def _linearized(
        self, parts: Mapping[str, ca.MX], readout: Readout, q_ddot: AnyExpr | None
    ) -> list[Rows]:
        process, channels = self.process, self.observation.channels
        columns = {key: len(x) for key, x in self.observation.unknown.items()}
        first = sum(columns.values())
        columns |= {part.name: part.size for part in process.error.parts}
        given, own = channels.layout.split(self.samples), self._gyro_biases()
        for name, where in own.items():
            given[name] -= parts["gyro_bias"][where]
        blocks = dict(zip(given, readout.rows(given, columns, q_ddot), strict=True))
        for name, where in own.items():
            start = first + process.error.slices["gyro_bias"].start + where.start
            for k, row in enumerate(blocks[name]):
                by_bias = ca.DM(row.numel(), 1)
                by_bias[start + k] = 1
                blocks[name][k] = row + by_bias
        noise = channels.residual_layout.split(ca.DM(channels.noise))
        order = 1 if "q_dot" in self.observation.unknown else 2
        return [
            Rows(
                shared=bool(self.observation.unknown) and sensor.order >= order,
                together=sensor.whole,
                rows=rows,
                variance=noise[name].full()[:, 0] ** 2,
            )
            for (name, rows), sensor in zip(blocks.items(), self.observation.sensors, strict=True)
        ]

    def _gyro_biases(self) -> dict[str, slice]:
        """Where the bias of each gyro stands among them, by its name."""
        pairs = zip(self.observation.channels.layout.parts, self.observation.sensors, strict=True)
        gyros = [part.name for part, sensor in pairs if isinstance(sensor, RateGyro)]
        known = gyros[: self.process.biases]
        return {name: slice(3 * i, 3 * i + 3) for i, name in enumerate(known)}
