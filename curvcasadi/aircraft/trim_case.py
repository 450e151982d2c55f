"""The conditions of one trim: what is held, what is free within which bounds."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from curvcasadi.aircraft.trim_problem import TrimProblem, bounds_of
from curvcasadi.aircraft.turn import Turn
from curvcasadi.symbolic.expressions import Array, choice, expression, number

#: Singular values of unit columns below this are those of undetermined unknowns.
DEPENDENT = 1e-8
#: What `free` names.
FREE = ("sideslip", "roll")


class Case(NamedTuple):
    """The conditions of one trim, as the user gave them."""

    speed: float
    density: float
    gravity: float
    flight_path: float | None
    free: tuple[str, ...]
    inputs: Mapping[str, float]
    bounds: Mapping[str, tuple[float, float]]
    sideslip: float | None = None
    turn: Turn | None = None

    @property
    def lateral(self) -> bool:
        """Whether the flight may leave the plane of symmetry."""
        return bool(self.free) or self.sideslip is not None or self.turn is not None

    @property
    def coordinated(self) -> bool:
        """Whether the sideslip of a turn is that without side force."""
        return self.turn is not None and self.sideslip is None and "sideslip" not in self.free

    @property
    def flight(self) -> str:
        """Speed and turn, for messages."""
        turn = "" if self.turn is None else f" in a {self.turn}"
        return f"{float(self.speed):g} m/s{turn}"

    @property
    def remedy(self) -> str:
        """What may help where lateral balances are missed."""
        if self.coordinated:
            return (
                "are there inputs that roll and yaw the aircraft? Without a rudder it turns with a "
                "free sideslip, by `free`"
            )
        if self.sideslip is not None or self.turn is not None:
            return "are there inputs that roll and yaw the aircraft?"
        return "free sideslip and roll by `free`, with inputs that turn the aircraft"

    def held_motion(self) -> dict[str, float]:
        """What is held of sideslip, roll and turn rate, rad and rad/s."""
        held: dict[str, float] = {}
        if self.sideslip is not None:
            held["sideslip"] = number("sideslip", self.sideslip)
        elif self.turn is None and "sideslip" not in self.free:
            held["sideslip"] = 0.0
        if self.turn is None:
            held["turn_rate"] = 0.0
            if self.sideslip is None and "roll" not in self.free:
                held["roll"] = 0.0
        elif self.turn.bank is not None:
            held["roll"] = self.turn.bank
        else:
            held["turn_rate"] = self.turn.rate_at(self.speed, self.gravity, self.flight_path)
        return held


def case_bounds(case: Case, problem: TrimProblem, p: Array) -> tuple[Array, Array]:
    """Scaled bounds of all unknowns; held ones have the same on both sides.

    Raises
    ------
    ValueError
        For unknown names, what is held and free at once, and values out of bounds.
    """
    lower, upper = bounds_of(problem)
    motion, sides = case.held_motion(), {}
    for name in case.free:
        if choice("free", name, FREE) in motion:
            holder = "sideslip" if name == "sideslip" else "turn with a bank angle"
            raise ValueError(f"free: expected what is not held, found {name!r} beside a {holder}")
    units = tuple(problem.aircraft.inputs)
    named = [(f"inputs[{choice('inputs', k, units)!r}]", k, v) for k, v in case.inputs.items()]
    for argument, name, value in [*named, *((key, key, v) for key, v in motion.items())]:
        held = float(expression(argument, value, (1, 1)))
        k, unit = problem.names.index(name), problem.units[name]
        if not lower[k] <= held <= upper[k]:
            hint = f"; {held:g} degrees are {np.deg2rad(held):.4g} rad" if unit == "rad" else ""
            raise ValueError(
                f"{argument}: expected within {lower[k]:g} to {upper[k]:g} {unit}, "
                f"found {held:g}{hint}"
            )
        sides[name] = (held, held)
    for name, pair in case.bounds.items():
        if choice("bounds", name, problem.names) in sides:
            raise ValueError(f"bounds: {name!r} is held, not free")
        sides[name] = tuple(expression(f"bounds[{name!r}]", pair, (2, 1)).full().ravel())
    scales = dict(zip(problem.names, problem.scales(p), strict=True))
    for name, (low, high) in sides.items():
        if low > high:
            raise ValueError(f"bounds[{name!r}]: expected lower <= upper, found {low}, {high}")
        k = problem.names.index(name)
        lower[k], upper[k] = low / scales[name], high / scales[name]
    return lower, upper


def check_settled(
    case: Case, problem: TrimProblem, bounds: tuple[Array, Array], slope: Array
) -> None:
    """ValueError of free unknowns that the conditions leave undetermined.

    In symmetric flight lateral balances settle inputs that roll and yaw: at zero.

    Parameters
    ----------
    case, problem : Case, TrimProblem
        The conditions, and what they are conditions of.
    bounds : tuple of array
        Of `case_bounds`.
    slope : array, shape (conditions, unknowns)
        Derivatives of all conditions that the case has, where the search starts.
    """
    free = bounds[0] < bounds[1]
    names = [name for name, on in zip(problem.names, free, strict=False) if on]
    conditions = 3 + (case.flight_path is not None) + 3 * case.lateral + case.coordinated
    if len(names) <= conditions:
        return
    columns = slope[:, free]
    size = np.linalg.norm(columns, axis=0)
    rank = int(np.linalg.matrix_rank(columns / np.where(size > 0, size, 1.0), tol=DEPENDENT))
    undetermined = columns.shape[1] - rank
    if undetermined:
        settled = len(names) - undetermined
        raise ValueError(
            f"inputs: {settled} balances settle {settled} of the free unknowns "
            f"{', '.join(names)}; hold others by `inputs`, or give an objective"
        )


def free_bounds(
    problem: TrimProblem, bounds: tuple[Array, Array], p: Array
) -> dict[str, tuple[float, float]]:
    """Lower and upper bounds of what is free of motion and inputs, in their units."""
    sides = zip(problem.names, *bounds, problem.scales(p), strict=False)
    return {
        name: (float(low * scale), float(high * scale))
        for name, low, high, scale in sides
        if low < high
    }
