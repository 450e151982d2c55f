"""What the update of a shape filter reads: residuals of sensors, linearized at a state."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import casadi as ca

from curvcasadi.beam import Beam
from curvcasadi.estimation.process import Process
from curvcasadi.expressions import AnyExpr, Array
from curvcasadi.pose import Pose
from curvcasadi.sensors import Channels, RateGyro, RootMotion, Sensor
from curvcasadi.sensors.readout import Readout

#: What may be known of the root's motion, an input of the update.
SHAPES = {"attitude": (3, 3), "position": (3, 1), "twist": (6, 1), "twist_rate": (6, 1)}


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
    unknown: Mapping[str, Array]  #: of "q_dot", "q_ddot", "twist"
    inputs: tuple[str, ...]  #: of "attitude", "position", "twist", "twist_rate": known motion
    gate: float
    iterations: int


@dataclass(frozen=True, eq=False, kw_only=True)
class Rows:
    """Linearized rows of one sensor: residual + slope · (unknowns, error) + noise."""

    name: str
    shared: bool  #: whether they depend on unknowns
    residual: ca.MX  #: (r, 1), at the state, the unknown q_dot, and no q_ddot
    slope: ca.MX  #: (unknowns + error, r), transposed
    variance: Array  #: (r,)


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
        root, known = self.observation.root, dict(self.known)
        if "attitude" in parts:
            known["attitude"] = ca.reshape(parts["attitude"], 3, 3)
        if "root_gyro_bias" in parts and "twist" in known:
            bias = ca.vertcat(parts["root_gyro_bias"], ca.DM.zeros(3))
            known["twist"] = known["twist"] - bias
        root = RootMotion(
            pose=Pose(
                rotation=known.get("attitude", root.pose.rotation),
                position=known.get("position", root.pose.position),
            ),
            twist=known.get("twist", root.twist),
            twist_rate=known.get("twist_rate", root.twist_rate),
            gravity=root.gravity,
            magnetic_field=root.magnetic_field,
        )
        q_dot = None if q_dot is None else ca.MX(q_dot)
        sensors, beam = self.observation.sensors, self.observation.beam
        return Readout.of(sensors, beam, parts["q"], q_dot, None, root)

    def _linearized(
        self, parts: Mapping[str, ca.MX], readout: Readout, q_ddot: AnyExpr | None
    ) -> list[Rows]:
        process, channels = self.process, self.observation.channels
        columns = {key: len(x) for key, x in self.observation.unknown.items()}
        first = sum(columns.values()) + 3 * process.attitude
        biases = ("gyro_bias", "root_gyro_bias")  # the last parts of the error
        columns |= {p.name: p.size for p in process.error.parts if p.name not in biases}
        twisted = process.root_bias and "twist" in self.known
        columns |= {"twist": 6} if twisted else {}

        names = [part.name for part in channels.layout.parts]
        blocks = readout.short_blocks(channels.layout.split(self.samples), columns)
        residuals = dict(zip(names, (residual for residual, _ in blocks), strict=True))
        slopes = dict(zip(names, (slope for _, slope in blocks), strict=True))
        if q_ddot is not None:
            slopes = readout.turning(q_ddot, slopes, first)
        noise = channels.residual_layout.split(ca.DM(channels.noise))
        order = 1 if "q_dot" in self.observation.unknown else 2
        found, gyros = [], 0
        for name, sensor in zip(names, self.observation.sensors, strict=True):
            residual, slope = residuals[name], slopes[name]
            rows = residual.shape[0]
            by_twist = -slope[-6:-3, :] if twisted else ca.DM.zeros(3, rows)
            stack = [slope[:-6, :] if twisted else slope]
            if process.biases:
                place = ca.DM.zeros(3 * process.biases, rows)
                if isinstance(sensor, RateGyro):
                    own = slice(3 * gyros, 3 * gyros + 3)
                    place[own, :] = ca.DM.eye(3)
                    residual, gyros = residual + parts["gyro_bias"][own], gyros + 1
                stack.append(place)
            if process.root_bias:
                stack.append(by_twist)
            found.append(
                Rows(
                    name=name,
                    shared=bool(self.observation.unknown) and sensor.order >= order,
                    residual=residual,
                    slope=ca.densify(ca.vertcat(*stack)),
                    variance=noise[name].full()[:, 0] ** 2,
                )
            )
        return found


def known_motion(names: Sequence[str]) -> tuple[str, ...]:
    """`names`, each an input of the update."""
    if isinstance(names, str) or set(names) - set(SHAPES) or len(set(names)) < len(names):
        raise ValueError(
            f"root_inputs: expected names among {', '.join(SHAPES)}, each once; found {names!r}"
        )
    return tuple(names)
