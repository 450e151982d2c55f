"""State and inputs of a model of an aircraft in trimmed flight."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from typing import NamedTuple

import casadi as ca
import numpy as np

from curvcasadi.aircraft.trim_problem import MOTION, flight_direction
from curvcasadi.aircraft.trim_result import TrimResult
from curvcasadi.control.model import ControlModel, SecondOrder
from curvcasadi.control.signals import stacked, with_nominal
from curvcasadi.errors import ConvergenceError
from curvcasadi.lie import quaternion
from curvcasadi.symbolic.expressions import Array, Number, instance

#: Residual of an equation over the sum of the sizes of its terms, and largest number of iterations.
TOLERANCE, ITERATIONS = 1e-9, 20
#: Relative difference of an angle or an input from the trim without a warning; differences of
#: 0.005 rad, or for thrusts of 0.005 of the largest vertical force at a root, are always allowed.
MOVED, MOVED_LEAST = 0.1, 0.005
#: Excess over a bound that counts as none, over the size of both bounds.
BEYOND = 1e-6


class TrimmedState(NamedTuple):
    """State and inputs of steady flight.

    Attributes
    ----------
    x : array, shape (nx,)
        State of the model; the body origin is at the inertial origin and flies north.
    u : array, shape (nu,)
        Its inputs.
    """

    x: Array
    u: Array


def trimmed_state(
    model: ControlModel,
    trim: TrimResult,
    p: Number | Mapping[str, Number] | None = None,
) -> TrimmedState:
    """The state of a model in trimmed flight, so that `simulate` from there stays there.

    A trim has quasi-steady strips. With a state of the air for each strip they are those of the
    model in steady flight; lag functions along the span, which cannot follow every distribution of
    the angle of attack, and induced flow of another kind move the equilibrium a little. What the
    trim left free is therefore solved for once more, within its bounds, with the equations of the
    model; in a turn the heading turns, and nothing else. A warning names the angles and inputs that
    differ from those of the trim, as they do in air of another density.

    Parameters
    ----------
    model : ControlModel
        An `aircraft_model` of the aircraft, in air of the density of the trim.
    trim : TrimResult
        Of this aircraft.
    p : array or mapping of str to number, optional
        Parameters of the model; of a gust, zero unless given, as if it were steady. A model in a
        gust that is a function of "time" needs it, s.

    Returns
    -------
    TrimmedState
        Accelerations and rates of the states of the air are zero to rounding.

    Raises
    ------
    ValueError
        If the trim is not one, or that of another aircraft, or parameters are missing.
    ConvergenceError
        If the model has no such equilibrium near the trim, or one beyond bounds, all of which are
        named; its `result` is the state that came nearest.
    """
    instance("trim", trim, TrimResult)
    motion = _motion(model, trim)
    if not trim.trimmed:
        raise ValueError(f"trim: expected a flight in balance, found {trim.message!r}")
    held = stacked("p", model.p, with_nominal("p", model.p, p))
    unknowns = _Unknowns(model, trim)
    z = ca.MX.sym("z", unknowns.size)
    x, u, path = unknowns.state(z)
    left = ca.vertcat(*motion.balance(x, ca.DM.zeros(motion.velocities), u, held), *path)
    rest = ca.Function("rest", [z], [left])
    slope = ca.Function("slope", [z], [ca.densify(ca.jacobian(left, z))])
    value, missed, beyond = _within_bounds(rest, slope, unknowns)
    state = TrimmedState(*(part.full().ravel() for part in ca.Function("at", [z], [x, u])(value)))
    if not missed < TOLERANCE:
        why = (
            f"it lies beyond the bounds of the trim: {'; '.join(beyond)}"
            if beyond
            else "is the density the same, and the aircraft?"
        )
        raise ConvergenceError(
            f"trimmed_state: no equilibrium of {model.name!r} near the trim at {trim.speed:g} m/s; "
            f"{why}",
            state,
        )
    _warn_of_another_flight(value, unknowns)
    return state


def _within_bounds(
    rest: ca.Function, slope: ca.Function, unknowns: _Unknowns
) -> tuple[Array, float, list[str]]:
    """The equilibrium within bounds, by how much it is missed, and what was beyond bounds before.

    What stands beyond a bound is held there, as long as the others can balance without it.
    """
    free, start = unknowns.free.copy(), unknowns.start
    words: list[str] = []
    while True:
        value, missed = _newton(rest, slope, start, free, unknowns.scales)
        outside = free & unknowns.beyond(value)
        if not missed < TOLERANCE or not np.any(outside):
            return value, missed, words
        words += unknowns.in_words(value, outside)
        start, free = np.clip(value, unknowns.lower, unknowns.upper), free & ~outside


def _newton(
    rest: ca.Function, slope: ca.Function, start: Array, free: Array, scales: Array
) -> tuple[Array, float]:
    """Free unknowns by Newton's method, the smallest steps, and what is left beside its terms."""
    value, size, scales = start, np.inf, scales[free]
    for _ in range(ITERATIONS):
        residual, matrix = (f(value).full() for f in (rest, slope))
        # Every row by the sizes of its terms, every column by that of its unknown.
        scaled = matrix[:, free] * scales
        rows = np.abs(scaled).sum(axis=1)
        rows = np.where(rows > 0, rows, 1.0)
        left_over = residual.ravel() / rows
        before, size = size, float(np.max(np.abs(left_over)))
        if not size < before / 2 and size < TOLERANCE:
            break
        step = np.linalg.lstsq(scaled / rows[:, None], -left_over, rcond=1e-12)[0]
        value = value.copy()
        value[free] += step * scales
    return value, size


def _warn_of_another_flight(value: Array, unknowns: _Unknowns) -> None:
    """Warn of angles and inputs that differ from those of the trim."""
    count = len(unknowns.names)
    before, after = unknowns.start[:count], value[:count]
    allowed = MOVED * np.abs(before) + MOVED_LEAST * unknowns.scales[:count]
    moved = [
        f"{unknowns.names[k]} is {after[k]:.4g} {unknowns.units[k]} instead of {before[k]:.4g}"
        for k in np.flatnonzero(np.abs(after - before) > allowed)
    ]
    if moved:
        warnings.warn(
            "trimmed_state: the model's equilibrium is not that of the trim: "
            f"{'; '.join(moved)}; are density, gravity and induced flow the same?",
            UserWarning,
            stacklevel=3,
        )


class _Unknowns:
    """Motion, inputs, weights and states of the air, stacked, and the state that they make."""

    def __init__(self, model: ControlModel, trim: TrimResult) -> None:
        self.model, self.trim = model, trim
        self.names = [*MOTION, *trim.inputs]
        self.units = [*MOTION.values(), *trim.input_units.values()]
        self.lag = [part for part in model.x.parts if part.name.startswith("lag_")]
        pieces: list[Array] = [np.array([getattr(trim, name) for name in MOTION])]
        pieces += [np.array([*trim.inputs.values()])]
        pieces += [q.full().ravel() for q in trim.q.values()]
        pieces += [np.zeros(part.size) for part in self.lag]
        self.ends = np.cumsum([0, *map(len, pieces)]).tolist()
        self.start = np.concatenate(pieces)
        self.size, count = self.start.size, len(self.names)
        self.free = np.ones(self.size, dtype=bool)
        self.free[:count] = [name in trim.bounds for name in self.names]
        typical = max((abs(load[5]) for load in trim.root_loads.values()), default=1.0)
        by_unit = {"N": max(typical, 1.0)}
        self.scales = np.ones(self.size)
        self.scales[:count] = [by_unit.get(unit, 1.0) for unit in self.units]
        self.scales[self.ends[2 + len(trim.q)] :] = trim.speed
        self.lower, self.upper = self._bounds()

    def _bounds(self) -> tuple[Array, Array]:
        """Those of the trim, and of the weights of the model."""
        lower, upper = np.full((2, self.size), [[-np.inf], [np.inf]])
        for k, name in enumerate(self.names):
            lower[k], upper[k] = self.trim.bounds.get(name, (-np.inf, np.inf))
        parts = {part.name: part for part in self.model.x.parts}
        for wing, start, stop in zip(self.trim.q, self.ends[2:], self.ends[3:], strict=False):
            part = parts[f"q_{wing}"]
            lower[start:stop], upper[start:stop] = part.lower, part.upper
        return lower, upper

    def beyond(self, value: Array) -> Array:
        """Which unknowns stand beyond their bounds."""
        finite = [np.where(np.isfinite(side), np.abs(side), 0) for side in (self.lower, self.upper)]
        slack = BEYOND * np.maximum(sum(finite), self.scales)
        return np.asarray((value < self.lower - slack) | (value > self.upper + slack))

    def in_words(self, value: Array, which: Array) -> list[str]:
        """Unknowns and the bounds that they stand beyond."""
        names, units = [*self.names], [*self.units]
        for wing, q in self.trim.q.items():
            names += [f"{wing} q[{i}]" for i in range(q.numel())]
            units += ["rad/m"] * q.numel()
        return [
            f"{names[k]} would be {value[k]:.6g} {units[k]}, "
            + (
                f"below {self.lower[k]:g}"
                if value[k] < self.lower[k]
                else f"above {self.upper[k]:g}"
            )
            for k in np.flatnonzero(which)
        ]

    def state(self, z: ca.MX) -> tuple[ca.MX, ca.MX, list[ca.MX]]:
        """State, inputs, and what is left of the path that the trim holds, m/s and m/s²."""
        trim, model = self.trim, self.model
        motion, inputs, *parts = ca.vertsplit(z, self.ends)
        alpha, pitch, beta, roll, turn_rate = ca.vertsplit(motion)
        attitude = quaternion.product(
            quaternion.exp(ca.vertcat(0, pitch, 0)), quaternion.exp(ca.vertcat(roll, 0, 0))
        )
        velocity = trim.speed * flight_direction(alpha, beta)
        named = {part.name: ca.MX.zeros(part.size) for part in model.x.parts}
        down = quaternion.rotation(attitude)[2, :].T  # inertial z in body axes
        omega = turn_rate * down
        named |= {"quaternion_wxyz": attitude, "twist": ca.vertcat(omega, velocity)}
        keys = [f"q_{name}" for name in trim.q] + [part.name for part in self.lag]
        named |= dict(zip(keys, parts, strict=True))
        by_name = dict(zip(trim.inputs, ca.vertsplit(inputs), strict=True))
        path = []
        if not trim.path_is_free:
            path.append(ca.dot(down, velocity) + trim.speed * np.sin(trim.flight_path))
        if trim.coordinated:
            path.append((ca.cross(omega, velocity) - trim.gravity * down)[1])
        return model.x.join(named), model.u.join(by_name), path


def _motion(model: ControlModel, trim: TrimResult) -> SecondOrder:
    """The equations of motion of a model whose wings and inputs are those of a trim."""
    motion = instance("model", model, ControlModel).second_order
    wings = {part.name[2:] for part in model.x.parts if part.name.startswith("q_")}
    wings = {name for name in wings if not name.startswith("dot_")}
    inputs = {part.name for part in model.u.parts}
    if motion is None or model.x.parts[0].name != "quaternion_wxyz" or wings != set(trim.q):
        raise ValueError(
            f"model: expected an aircraft_model with the wings {sorted(trim.q)} of the trim, "
            f"found {model!r}"
        )
    if inputs != set(trim.inputs):
        raise ValueError(
            f"model: expected the inputs {sorted(trim.inputs)} of the trim, found {sorted(inputs)}"
        )
    sizes = {part.name: part.size for part in model.x.parts}
    for name, q in trim.q.items():
        if sizes[f"q_{name}"] != q.numel():
            raise ValueError(
                f"model: expected {q.numel()} weights of the wing {name!r}, as the trim has, found "
                f"{sizes[f'q_{name}']}"
            )
    return motion
