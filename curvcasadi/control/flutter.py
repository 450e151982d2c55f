"""Flutter and divergence of a wing: its equilibria and their stability from speed to speed.

At each speed the wing finds its equilibrium, and the linear model about it has the roots λ. Flutter
begins where an oscillation of a stable wing grows, Re λ > 1e-5 |λ|; divergence where the tangent of
the steady equations is singular.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from curvcasadi.control.bending import warn_of_bending
from curvcasadi.control.model import ControlModel, SecondOrder
from curvcasadi.control.roots import (
    GROWTH,
    OSCILLATING,
    Point,
    continues,
    extrapolated,
    followed,
    reordered,
    scaled,
    summits,
)
from curvcasadi.control.signals import held_within_bounds, increasing, with_nominal
from curvcasadi.control.steady import Slopes, SteadyStates
from curvcasadi.symbolic.expressions import Array, Number, instance
from curvcasadi.symbolic.text import described

#: Steps in which the first speed is reached from half of it.
CLIMB = 8
#: How often an interval is halved where modes change too much to be followed over it.
HALVINGS = 3
#: How often where its equilibrium changes too much.
STEEP = 6
#: What a function may be where it passes zero, over its values at both sides.
SHARP = 1e-3
#: Relative tolerance of speeds.
TOLERANCE = 1e-9


@dataclass(frozen=True, eq=False, kw_only=True)
class Flutter:
    """Stability of a wing over a range of airspeeds.

    Attributes
    ----------
    model : ControlModel
        The model of the wing.
    speeds : array, shape (T,)
        Airspeeds at which there are roots and equilibria, m/s.
    speed : float or None
        Lowest airspeed at which an oscillation begins to grow, m/s; None where none does.
    frequency : float or None
        Imaginary part of its root there, rad/s.
    mode : array, shape (nx,), or None
        Its mode shape, complex, laid out as the state; the largest weight is 1.
    equilibrium : array, shape (nx,), or None
        State about which it oscillates.
    divergence_speed : float or None
        Lowest airspeed at which the steady equations are singular, m/s.
    roots : array, shape (T, nx)
        Roots at each speed, complex, 1/s; a column follows one mode.
    equilibria : array, shape (T, nx)
        Steady state at each speed.
    divergence_equilibrium : array, shape (nx,), or None
        Steady state there.
    u, p : array
        Inputs, and parameters but for the airspeed, that were held.
    linearizations : int
        How many linear models were made in all.
    success : bool
        Whether there is an equilibrium at every speed that was needed.
    message : str
        What happened, in words.
    """

    model: ControlModel
    speeds: Array
    speed: float | None
    frequency: float | None
    mode: Array | None
    equilibrium: Array | None
    divergence_speed: float | None
    roots: Array
    equilibria: Array
    divergence_equilibrium: Array | None
    u: Array
    p: Array
    linearizations: int
    success: bool
    message: str

    @property
    def damping_ratios(self) -> Array:
        """−Re λ/|λ| of each root, shape (T, nx)."""
        return np.asarray(-self.roots.real / np.abs(self.roots))

    def __repr__(self) -> str:
        return f"<Flutter of {self.model.name}: {self.message.splitlines()[0]}>"

    def __str__(self) -> str:
        oscillation = "none"
        if self.speed is not None and self.frequency is not None:
            cycles = self.frequency / (2 * np.pi)
            oscillation = f"{self.speed:.5g} m/s, {self.frequency:.5g} rad/s ({cycles:.4g} Hz)"
        rows = {
            "speeds": f"{self.speeds[0]:g} to {self.speeds[-1]:g} m/s, {len(self.speeds)} of them",
            "flutter": oscillation,
            "divergence": "none"
            if self.divergence_speed is None
            else f"{self.divergence_speed:.5g} m/s",
            "message": self.message,
        }
        return described(f"Flutter of {self.model.name}", rows)


def flutter(
    model: ControlModel,
    speeds: Number,
    u: Number | Mapping[str, Number] | None = None,
    p: Mapping[str, Number] | None = None,
) -> Flutter:
    """Speeds at which a wing flutters and diverges, about its equilibrium at each airspeed.

    Parameters
    ----------
    model : ControlModel
        With inertia and a parameter "airspeed", as `wing_model` makes it.
    speeds : array, shape (T,)
        Two or more airspeeds that increase, m/s; the wing is stable at the first one.
    u : array or mapping, optional
        Inputs, which are held; zero unless given.
    p : mapping of str to number, optional
        The other parameters by name: pitch, say. Those that the model has a nominal value of, such
        as a gust, may be left out.

    Returns
    -------
    Flutter
        Speeds of flutter and divergence between the first and the last of `speeds`, found to 1e-9,
        and the roots at all of them. Growth between two speeds that is over at the second one is
        seen only where damping, a parabola through three speeds, lets it be expected. Where an
        equilibrium is missing the sweep ends: see `success` and `message`.

    Raises
    ------
    ValueError
        If the model has no airspeed or no inertia, an argument has a wrong size, parameters are
        missing, the first speed has no equilibrium, or the wing is unstable there.
    """
    motion, grid, held, others = checked_arguments(model, speeds, u, p)
    at = held_within_bounds("p", model.p, others)
    sweep = _Sweep(SteadyStates(model, motion), held, at)
    points = [_first(sweep, float(grid[0]))]
    message = "an equilibrium at every speed"
    for speed in grid[1:]:
        point = _next(sweep, points, float(speed))
        if point is None:
            last = f"the last speed is {points[-1].speed:g} m/s"
            message = f"no equilibrium found at {speed:g} m/s that goes on from there: {last}"
            break
        points.append(_follow(sweep, points, point))
    onset, divergence, success = None, None, len(points) == len(grid)
    try:
        onset = _crossing(sweep, _with_summits(sweep, points), lambda point: point.growth - GROWTH)
        divergence = _crossing(sweep, points, sweep.singularity(points[0]), both=True)
    except _LostError as lost:
        message, success = f"{lost} between two of the speeds; {message}", False
    states = np.array([point.x for point in points])
    warn_of_bending(model, np.array([point.speed for point in points]), states.T, "flutter", "m/s")
    mode = None if onset is None else scaled(onset.right[:, onset.growing], sweep.steady.n)
    return Flutter(
        model=model,
        speeds=np.array([point.speed for point in points]),
        speed=None if onset is None else onset.speed,
        frequency=None if onset is None else float(onset.roots[onset.growing].imag),
        mode=mode,
        equilibrium=None if onset is None else onset.x,
        divergence_speed=None if divergence is None else divergence.speed,
        roots=np.array([point.roots for point in points]),
        equilibria=states,
        divergence_equilibrium=None if divergence is None else divergence.x,
        u=held,
        p=at,
        linearizations=sweep.steady.linearizations,
        success=success,
        message=message,
    )


def checked_arguments(
    model: ControlModel,
    speeds: Number,
    u: Number | Mapping[str, Number] | None,
    p: Mapping[str, Number] | None,
    design: Sequence[str] = (),
) -> tuple[SecondOrder, Array, Array, dict[str, Number]]:
    """Equations of motion, speeds, inputs and parameters but for the airspeed and the `design`."""
    instance("model", model, ControlModel)
    if model.second_order is None or "airspeed" not in model.p.slices:
        raise ValueError(
            "model: expected a model with inertia and a parameter airspeed, as wing_model makes "
            f"it; found {model!r}"
        )
    grid = increasing("speeds", speeds, "airspeeds, m/s")
    if grid[0] <= 0:
        raise ValueError(f"speeds: expected airspeeds above zero, m/s, found {grid[0]:g}")
    others = instance("p", {} if p is None else p, Mapping)
    if "airspeed" in others:
        raise ValueError("p: expected parameters other than airspeed, which speeds sets")
    held = held_within_bounds("u", model.u, u)
    nominal = with_nominal("p", model.p, others, ["airspeed", *design])
    return model.second_order, grid, held, nominal


class _LostError(ArithmeticError):
    """No equilibrium was found at a speed where one is needed."""


class _Sweep(NamedTuple):
    """Steady states and roots of a model at held inputs and parameters."""

    steady: SteadyStates
    u: Array
    p: Array

    def at(self, speed: float, known: list[Point]) -> Point | None:
        """The wing at a speed, from its states at others; None without an equilibrium."""
        from scipy.linalg import eig

        p = self._parameters(speed)
        near = sorted(known, key=lambda point: abs(point.speed - speed))[:3]
        if near:
            found = self.steady.settle(extrapolated(near, speed), self.u, p, near[0].slopes)
            found = found or self.steady.settle(near[0].x, self.u, p)
        else:
            found = self._from_straight(speed)
        if found is None:
            return None
        x, _ = found
        slopes = self.steady.slopes(x, self.u, p)
        roots, left, right = eig(self.steady.state_matrix(slopes), left=True, right=True)
        drift = self.steady.drift(x, self.u, p, slopes)
        return Point(speed, x, slopes, roots, left, right, drift)

    def _parameters(self, speed: float) -> Array:
        p = self.p.copy()
        p[self.steady.model.p.slices["airspeed"]] = speed
        return p

    def _from_straight(self, speed: float, halvings: int = 4) -> tuple[Array, Slopes] | None:
        """The steady state from that of the straight wing, by way of lower speeds if need be."""
        straight = np.zeros(self.steady.model.x.size)
        found = self.steady.settle(straight, self.u, self._parameters(speed))
        if found is None and halvings:
            found = self._from_straight(speed / 2, halvings - 1)
            for higher in speed * np.linspace(0.5, 1.0, CLIMB + 1)[1:]:
                if found is not None:
                    found = self.steady.settle(found[0], self.u, self._parameters(higher))
        return found

    def singularity(self, first: Point) -> Callable[[Point], float]:
        """Determinant of the steady tangent, over that of the first speed."""
        sign, size = np.linalg.slogdet(self.steady.tangent(first.slopes))

        def relative(point: Point) -> float:
            of_point = np.linalg.slogdet(self.steady.tangent(point.slopes))
            return float(sign * of_point[0] * np.exp(of_point[1] - size))

        return relative


def _first(sweep: _Sweep, speed: float) -> Point:
    point = sweep.at(speed, [])
    if point is None:
        raise ValueError(
            f"speeds: expected an equilibrium at the first one, {speed:g} m/s; found none"
        )
    size = np.abs(point.roots)
    steady = np.abs(point.roots.imag) <= OSCILLATING * size
    if np.any(steady & (point.roots.real > 0)):
        raise ValueError(
            f"speeds: expected a stable wing at the first one, found {speed:g} m/s beyond "
            "divergence; begin at a lower speed"
        )
    if point.growth > GROWTH:
        root = point.roots[point.growing]
        raise ValueError(
            f"speeds: expected a stable wing at the first one, found an oscillation of "
            f"{root.imag:.4g} rad/s that grows at {speed:g} m/s; begin at a lower speed"
        )
    real, imaginary = point.roots.real, point.roots.imag
    return reordered(point, np.lexsort((imaginary < 0, np.abs(real), np.abs(imaginary))))


def _next(sweep: _Sweep, points: list[Point], speed: float, halvings: int = STEEP) -> Point | None:
    """The wing at the next speed, by way of speeds between where its equilibrium jumps."""
    point = sweep.at(speed, points)
    if point is not None and continues(points[-1], point, sweep.steady.n):
        return point
    if not halvings:
        return None
    middle = _next(sweep, points, (points[-1].speed + speed) / 2, halvings - 1)
    return None if middle is None else _next(sweep, [*points, middle], speed, halvings - 1)


def _follow(sweep: _Sweep, points: list[Point], after: Point, halvings: int = HALVINGS) -> Point:
    """`after` with the modes of the last point, by way of speeds between where these change."""
    ordered, certain = followed(points[-1], after)
    if certain or not halvings:
        return ordered
    middle = sweep.at((points[-1].speed + after.speed) / 2, points)
    if middle is None:
        return ordered
    middle = _follow(sweep, points, middle, halvings - 1)
    return _follow(sweep, [*points, middle], after, halvings - 1)


def _with_summits(sweep: _Sweep, points: list[Point]) -> list[Point]:
    """The points and those between them at which a mode may grow."""
    added = [sweep.at(speed, points) for speed in summits(points)]
    return sorted(
        [*points, *(point for point in added if point is not None)], key=lambda point: point.speed
    )


def _crossing(
    sweep: _Sweep, points: list[Point], function: Callable[[Point], float], both: bool = False
) -> Point | None:
    """The lowest speed at which a function passes zero, upward or in `both` directions."""
    values = [function(point) for point in points]
    for k, (low, high) in enumerate(pairwise(values)):
        if low <= 0 < high or (both and high <= 0 < low):
            return _bisected(sweep, points[max(0, k - 1) : k + 2], function)
    return None


def _bisected(sweep: _Sweep, around: list[Point], function: Callable[[Point], float]) -> Point:
    """Where a function passes zero between the last two of `around`."""
    from scipy.optimize import brentq

    known = {point.speed: point for point in around}

    def value(speed: float) -> float:
        if speed not in known:
            point = sweep.at(speed, [*known.values()])
            if point is None:
                raise _LostError(f"no equilibrium found at {speed:g} m/s,")
            known[speed] = point
        return function(known[speed])

    low, high = (point.speed for point in around[-2:])
    speed = brentq(value, low, high, xtol=TOLERANCE * high)
    found = min(known.values(), key=lambda point: abs(point.speed - speed))
    if abs(function(found)) > SHARP * max(abs(value(low)), abs(value(high))):
        raise _LostError(f"the equilibrium jumps at {speed:g} m/s,")
    return found
