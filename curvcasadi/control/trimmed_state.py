"""State and inputs of a model of an aircraft in trimmed flight."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from typing import NamedTuple

import casadi as ca
import numpy as np

from curvcasadi.aircraft.trim_problem import ANGLES
from curvcasadi.aircraft.trim_result import TrimResult
from curvcasadi.control.model import ControlModel, SecondOrder
from curvcasadi.control.signals import stacked
from curvcasadi.errors import ConvergenceError
from curvcasadi.lie import quaternion
from curvcasadi.symbolic.expressions import Array, Number, expression, instance

#: What is left of the equations beside the sum of the sizes of their terms, and most iterations.
TOLERANCE, ITERATIONS = 1e-9, 20
#: Steps in which a turn is approached from straight flight.
TURNS = 4
#: What the angle of attack may move from that of the trim, relative and in rad, without a warning.
MOVED, MOVED_LEAST = 0.1, 0.005


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
    *,
    turn_rate: float = 0.0,
) -> TrimmedState:
    """The state of a model in trimmed flight, so that `simulate` from there stays there.

    A trim has quasi-steady strips. With a state of the air for each strip they are those of the
    model in steady flight; lag functions along the span, which cannot follow every distribution of
    the angle of attack, and induced flow of another kind move the equilibrium a little. What the
    trim left free is therefore solved for once more, with the equations of the model. A warning
    names an angle of attack that is another then, as in other air.

    Parameters
    ----------
    model : ControlModel
        An `aircraft_model` of the aircraft, in air of the density of the trim.
    trim : TrimResult
        Of this aircraft.
    p : array or mapping of str to number, optional
        Parameters of the model, zero unless given: a gust is met as if it were steady.
    turn_rate : float
        Rate of the heading, rad/s, to the right: a steady turn at the speed and climb of the trim.
        Sideslip, roll angle and all inputs are free then, and change as little as they can.

    Returns
    -------
    TrimmedState
        Accelerations and rates of the states of the air are zero to rounding.

    Raises
    ------
    ValueError
        If the trim is not one, or that of another aircraft.
    ConvergenceError
        If the model has no such equilibrium near the trim.
    """
    instance("trim", trim, TrimResult)
    motion = _motion(model, trim)
    if not trim.trimmed:
        raise ValueError(f"trim: expected a flight in balance, found {trim.message!r}")
    rate = float(expression("turn_rate", turn_rate, (1, 1)))
    unknowns = _Unknowns(model, trim, turning=bool(rate))
    z, turning = ca.MX.sym("z", unknowns.size), ca.MX.sym("turn_rate")
    held = ca.DM(stacked("p", model.p, p))
    x, u, climb = unknowns.state(z, turning)
    left = ca.vertcat(*motion.balance(x, ca.DM.zeros(motion.velocities), u, held), climb)
    rest = ca.Function("rest", [z, turning], [left])
    slope = ca.Function("slope", [z, turning], [ca.densify(ca.jacobian(left, z))])
    at = ca.Function("at", [z, turning], [x, u])
    value = unknowns.start
    for share in np.linspace(0, 1, TURNS + 1)[1:] if rate else [1.0]:
        value, size = _newton(rest, slope, value, share * rate, unknowns)
    found = TrimmedState(*(part.full().ravel() for part in at(value, rate)))
    if not size < TOLERANCE:
        steady = f"turn of {rate:g} rad/s" if rate else "equilibrium"
        remedy = (
            "are there inputs that roll and yaw it?"
            if rate
            else ("is the density the same, and the aircraft?")
        )
        raise ConvergenceError(
            f"trimmed_state: no {steady} of {model.name!r} near the trim at {trim.speed:g} m/s; "
            f"{remedy}",
            found,
        )
    if not rate:
        _warn_of_another_flight(float(value[0]), trim)
    return found


def _newton(
    rest: ca.Function, slope: ca.Function, start: Array, rate: float, unknowns: _Unknowns
) -> tuple[Array, float]:
    """Free unknowns by Newton's method, the smallest steps, and what is left beside its terms."""
    value, size, scales = start, np.inf, unknowns.scales[unknowns.free]
    for _ in range(ITERATIONS):
        residual, matrix = (f(value, rate).full() for f in (rest, slope))
        # Every row by the sizes of its terms, every column by that of its unknown.
        scaled = matrix[:, unknowns.free] * scales
        rows = np.abs(scaled).sum(axis=1)
        rows = np.where(rows > 0, rows, 1.0)
        left_over = residual.ravel() / rows
        before, size = size, float(np.max(np.abs(left_over)))
        if not size < before / 2 and size < TOLERANCE:
            break
        step = np.linalg.lstsq(scaled / rows[:, None], -left_over, rcond=1e-12)[0]
        value = value.copy()
        value[unknowns.free] += step * scales
    return value, size


def _warn_of_another_flight(alpha: float, trim: TrimResult) -> None:
    """Warn of an angle of attack that is not that of the trim, as in other air."""
    before = trim.angle_of_attack
    if abs(alpha - before) > MOVED * abs(before) + MOVED_LEAST:
        warnings.warn(
            f"trimmed_state: the angle of attack is {alpha:.4g} rad in the model's equilibrium and "
            f"{before:.4g} rad in the trim: are density, gravity and induced flow the same?",
            UserWarning,
            stacklevel=3,
        )


class _Unknowns:
    """Angles, inputs, weights and states of the air, stacked, and the state that they make."""

    def __init__(self, model: ControlModel, trim: TrimResult, turning: bool) -> None:
        self.model, self.trim = model, trim
        self.lag = [part for part in model.x.parts if part.name.startswith("lag_")]
        pieces: list[Array] = [np.array([getattr(trim, name) for name in ANGLES])]
        pieces += [np.array([*trim.inputs.values()])]
        pieces += [q.full().ravel() for q in trim.q.values()]
        pieces += [np.zeros(part.size) for part in self.lag]
        self.ends = np.cumsum([0, *map(len, pieces)]).tolist()
        self.start = np.concatenate(pieces)
        self.size = self.start.size
        names = [*ANGLES, *trim.inputs]
        self.free = np.ones(self.size, dtype=bool)
        self.free[: len(names)] = [turning or name in trim.free for name in names]
        forces = [unit == "N" for unit in trim.input_units.values()]
        typical = max((abs(load[5]) for load in trim.root_loads.values()), default=1.0)
        self.scales = np.ones(self.size)
        self.scales[len(ANGLES) : len(names)][forces] = max(typical, 1.0)
        self.scales[self.ends[2 + len(trim.q)] :] = trim.speed

    def state(self, z: ca.MX, turn_rate: ca.MX) -> tuple[ca.MX, ca.MX, ca.MX]:
        """State, inputs, and what is left of the climb, where the trim holds it, m/s."""
        trim, model = self.trim, self.model
        angles, inputs, *parts = ca.vertsplit(z, self.ends)
        alpha, pitch, beta, roll = ca.vertsplit(angles)
        attitude = quaternion.product(
            quaternion.exp(ca.vertcat(0, pitch, 0)), quaternion.exp(ca.vertcat(roll, 0, 0))
        )
        velocity = trim.speed * ca.vertcat(
            ca.cos(alpha) * ca.cos(beta), ca.sin(beta), ca.sin(alpha) * ca.cos(beta)
        )
        named = {part.name: ca.MX.zeros(part.size) for part in model.x.parts}
        down = quaternion.rotation(attitude)[2, :]  # inertial z in body axes
        named |= {"quaternion_wxyz": attitude, "twist": ca.vertcat(turn_rate * down.T, velocity)}
        keys = [f"q_{name}" for name in trim.q] + [part.name for part in self.lag]
        named |= dict(zip(keys, parts, strict=True))
        by_name = dict(zip(trim.inputs, ca.vertsplit(inputs), strict=True))
        climb = down @ velocity + trim.speed * np.sin(trim.flight_path)
        held = climb if "flight_path" not in trim.free else ca.MX(0, 1)
        return model.x.join(named), model.u.join(by_name), held


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
    return motion
