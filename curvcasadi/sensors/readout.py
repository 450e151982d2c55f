"""A set of sensors on a moving beam: one march, then a call per sensor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from curvcasadi.beam.beam import Beam
from curvcasadi.kinematics import chain
from curvcasadi.kinematics.motion import Motion, motion_states
from curvcasadi.kinematics.root_motion import RootMotion
from curvcasadi.kinematics.shape import curvature
from curvcasadi.kinematics.state import StateLayout
from curvcasadi.kinematics.weights import checked_weights
from curvcasadi.sensors.channels import Channels, checked_sensors, sensor_channels
from curvcasadi.sensors.sensor import CurvatureSensor, Sensor
from curvcasadi.sensors.station import (
    derivative_function,
    row_function,
    value_function,
)
from curvcasadi.symbolic.expressions import AnyExpr, expression, instance, is_numeric, same_kind

#: Intervals that one call of generated C crosses where its length matters.
_SPAN = 4


@dataclass(frozen=True, eq=False)
class Readout:
    """Checked arguments of a measurement."""

    sensors: tuple[Sensor, ...]
    channels: Channels
    beam: Beam
    motion: Motion
    root: RootMotion
    kind: type  #: SX, MX or DM

    @classmethod
    def of(
        cls,
        sensors: Sequence[Sensor],
        beam: Beam,
        q: AnyExpr,
        q_dot: AnyExpr | None,
        q_ddot: AnyExpr | None,
        root: RootMotion | None,
    ) -> Readout:
        """The arguments, or a ValueError that names what is wrong with them."""
        sensors = checked_sensors(sensors)
        channels = sensor_channels(sensors)
        q = checked_weights(beam, q)
        root = instance("root", RootMotion() if root is None else root, RootMotion)
        rates = {
            name: expression(name, value, (beam.basis.n, 1))
            for name, value in {"q_dot": q_dot, "q_ddot": q_ddot}.items()
            if value is not None
        }
        symbols = {}
        for part, sensor in zip(channels.layout.parts, sensors, strict=True):
            _check_world(part.name, sensor, root)
            for name, value in sensor.mount().items():
                if not is_numeric(value):
                    symbols[f"{part.name}.{name}"] = value
        kind = same_kind(q=q, **rates, **beam.design_symbols, **root.symbols, **symbols)
        motion = Motion(q, **rates, root_twist=root.twist, root_twist_rate=root.twist_rate)
        return cls(sensors, channels, beam, motion, root, kind)

    @property
    def order(self) -> int:
        """The highest order of the sensors."""
        return max(sensor.order for sensor in self.sensors)

    def values(self) -> AnyExpr:
        """Stacked values (m, 1)."""
        states = self._states(jacobian=False, order=self.order)
        rows = []
        for sensor in self.sensors:
            if isinstance(sensor, CurvatureSensor):
                rows.append(self._gauge(sensor))
            else:
                state = states[sensor.xi][: StateLayout(sensor.order).size]
                read = value_function(_kind(sensor))
                rows.append(read(state, *self._arguments(sensor)))
        return ca.vertcat(*rows)

    def derivatives(self, measured: AnyExpr, columns: dict[str, int]) -> dict[str, AnyExpr]:
        """Stacked values, residuals, and their derivatives by what `columns` names, with sizes."""
        stacks: dict[str, list[AnyExpr]] = {
            key: [] for key in ("values", "residual", *(f"residual_{name}" for name in columns))
        }
        for blocks in self.blocks(self.channels.layout.split(measured), columns):
            for stack, block in zip(stacks.values(), blocks, strict=True):
                stack.append(block)
        return {key: ca.vertcat(*stack) for key, stack in stacks.items()}

    def blocks(self, measured: dict[str, AnyExpr], columns: dict[str, int]) -> list[list[AnyExpr]]:
        """Of each sensor its value, residual, and derivatives; `columns` has names and sizes."""
        states = self._states(jacobian=True, order=self.order)
        found = []
        for part, sensor in zip(self.channels.layout.parts, self.sensors, strict=True):
            given = measured[part.name]
            if isinstance(sensor, CurvatureSensor):
                value = self._gauge(sensor)
                found.append([value, value - given, *self._gauge_slopes(sensor, columns)])
                continue
            finish = derivative_function(
                _kind(sensor), self.order, self.beam.basis.n, tuple(columns.items())
            )
            found.append([*finish(states[sensor.xi], *self._arguments(sensor), given)])
        return found

    def rows(
        self, measured: dict[str, AnyExpr], columns: dict[str, int], q_ddot: AnyExpr | None
    ) -> list[list[AnyExpr]]:
        """Of each sensor a row (columns + 1, 1) per residual: its derivatives, then itself.

        Readings are affine in q_ddot: residuals are those without, derivatives those at `q_ddot`.
        The march carries no accelerations: the derivative by q of an accelerometer is without the
        part that is quadratic in q_dot, Rᵀ (d/dq)(dJ/dt q_dot) relative to the root. All else is
        exact.
        """
        order, n, still = min(self.order, 1), self.beam.basis.n, self._is_still
        states = self._states(jacobian=True, order=order, span=_SPAN)
        turned = self._turned(q_ddot)
        zero = ca.DM.zeros(n)
        rates = zero if self.motion.q_dot is None else self.motion.q_dot
        rates = rates if still else ca.vertcat(rates, self.root.twist_rate)
        found = []
        for part, sensor in zip(self.channels.layout.parts, self.sensors, strict=True):
            given = measured[part.name]
            if isinstance(sensor, CurvatureSensor):
                slopes = self._gauge_slopes(sensor, columns)
                rows = ca.horzcat(*slopes, self._gauge(sensor) - given).T
                found.append(ca.horzsplit(rows))
                continue
            read = row_function(_kind(sensor), order, n, tuple(columns.items()), still)
            extra = [rates, turned[sensor.xi]] if sensor.order > order else []
            rows = read.call([states[sensor.xi], *self._arguments(sensor), given, *extra])
            found.append(rows)
        return found

    def _turned(self, q_ddot: AnyExpr | None) -> dict[float, AnyExpr]:
        """Rates of the spatial Jacobian along `q_ddot` at each accelerometer, by xi."""
        n = self.beam.basis.n
        stations = tuple(dict.fromkeys(s.xi for s in self.sensors if s.order == 2))
        if q_ddot is None or not stations:
            return dict.fromkeys(stations, ca.DM.zeros(6 * n))
        motion = Motion(self.motion.q, q_ddot)
        states = motion_states(chain.build(self.beam, stations), motion, 1, True, _SPAN)
        return {xi: state[-6 * n :] for xi, state in zip(stations, states, strict=True)}

    @property
    def _is_still(self) -> bool:
        """Whether the root is at rest, in numbers."""
        motions = (self.root.twist, self.root.twist_rate)
        return all(is_numeric(x) and not np.any(ca.DM(x).full()) for x in motions)

    def _states(self, jacobian: bool, order: int, span: int = 1) -> dict[float, AnyExpr]:
        """State of the march at each station that a sensor needs, by xi."""
        moving = [s for s in self.sensors if not isinstance(s, CurvatureSensor)]
        stations = tuple(dict.fromkeys(sensor.xi for sensor in moving))
        if not stations:
            return {}
        beam_chain = chain.build(self.beam, stations)
        motion = self.motion if order == 2 else self.motion._replace(q_ddot=None)
        states = motion_states(beam_chain, motion, order, jacobian, span)
        return dict(zip(stations, states, strict=True))

    def _arguments(self, sensor: Sensor) -> tuple[AnyExpr, AnyExpr]:
        """Frames and mount of a sensor, stacked."""
        pose, root = self.root.pose, self.beam.root
        world = getattr(self.root, sensor.world or "gravity")
        frames = ca.veccat(
            pose.rotation,
            pose.position,
            root.rotation,
            root.position,
            self.root.twist,
            ca.DM.zeros(3) if world is None else world,
        )
        return frames, ca.veccat(*sensor.mount().values())

    def _gauge(self, sensor: CurvatureSensor) -> AnyExpr:
        """Value of a sensor of curvature."""
        strained = curvature(self.beam, self.motion.q, sensor.xi)
        if sensor.reference == "unloaded":
            strained = ca.sparsify(ca.DM(self.beam.basis(sensor.xi))) @ self.motion.q  # K − K_0
        return sensor.factors() @ strained + sensor.bias

    def _gauge_slopes(self, sensor: CurvatureSensor, columns: dict[str, int]) -> list[AnyExpr]:
        """Derivatives (r, size) of it by what `columns` names: by all but q they are zero."""
        by_q = sensor.factors() @ ca.DM(self.beam.basis(sensor.xi))
        rows = by_q.shape[0]
        return [by_q if name == "q" else ca.DM.zeros(rows, size) for name, size in columns.items()]


def _kind(sensor: Sensor) -> Any:
    """The class of a sensor, which mypy does not take for hashable."""
    return type(sensor)


def _check_world(name: str, sensor: Sensor, root: RootMotion) -> None:
    world = sensor.world
    if world is not None and getattr(root, world) is None:
        raise ValueError(
            f"RootMotion.{world}: expected shape (3, 1), inertial axes, for {name}; found None"
        )
