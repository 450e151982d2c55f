"""A beam as a chain of calls to one element step.

The step is one `casadi.Function` built from SX. Called with SX weights CasADi inlines it
(*unrolled*), with MX weights it stays a call (*compact*), with DM it evaluates: the user's symbol
chooses. What differs between elements (length, K_0, basis values) reaches the step as one data
vector, so one step serves all elements of a beam, and all beams of one rule and basis pattern.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import casadi as ca
import numpy as np

from curvcasadi.beam.beam import Beam, remembered
from curvcasadi.beam.grid import ElementRule, ExponentialName
from curvcasadi.beam.pose import Pose, unpack_pose
from curvcasadi.kinematics import element
from curvcasadi.kinematics.rules import rule_of
from curvcasadi.symbolic.expressions import (
    COINCIDENT,
    AnyExpr,
    Array,
    is_numeric,
    same_kind,
)


class Pattern(NamedTuple):
    """Where the moments of the basis functions come from, for all intervals of a chain.

    An entry is (moment, row, column, slot, factor): h times `factor` times a value of the data
    vector, or h times `factor` alone where `slot` is None. Entries that agree on every interval
    share a slot, so channels of one family share their data.
    """

    rule: ElementRule
    exponential: ExponentialName
    degree: int
    n: int  # weights
    slots: int  # distinct moments of basis functions
    entries: tuple[tuple[int, int, int, int | None, float], ...]
    has_initial_curvature: bool
    n_parameters: int

    @property
    def moments(self) -> int:
        return len(self.rule.weights)

    @property
    def sizes(self) -> tuple[int, ...]:
        """Parts of a data vector: h, h-scaled moments of K_0, slots, parameter derivatives."""
        initial = 3 * self.moments * self.has_initial_curvature
        return 1, initial, self.slots, (1 + 3 * self.moments) * self.n_parameters


@dataclass(frozen=True, eq=False)
class Chain:
    """Elements of a beam from its root to the last of some stations, and the way to each."""

    pattern: Pattern
    data: tuple[AnyExpr, ...]  #: a data vector per interval; elements first, then partial ones
    elements: int  #: number of whole elements
    exits: tuple[tuple[int, int | None], ...]  #: per station: whole elements, then a partial one

    def march(
        self, steps: Sequence[ca.Function], state: AnyExpr, *arguments: AnyExpr
    ) -> list[AnyExpr]:
        """The state at each station; `steps[k](*arguments, state, data)` crosses k + 1 intervals.

        Only MX weights take steps of several. The state goes before the data: generated C then
        keeps one data vector alive, not all.
        """
        kind = same_kind(state=state, **{str(i): value for i, value in enumerate(arguments)})
        longest = len(steps) if kind is ca.MX else 1
        at, states = 0, {0: kind(state)}
        for end in sorted({k for k, _ in self.exits}):
            while at < end:
                count = min(longest, end - at)
                data = ca.vertcat(*self.data[at : at + count])
                crossed = steps[count - 1](*arguments, states[at], data)
                at += count
                states[at] = crossed
        return [
            states[k] if partial is None else steps[0](*arguments, states[k], self.data[partial])
            for k, partial in self.exits
        ]


def build(
    beam: Beam,
    stations: Sequence[float],
    parameters: AnyExpr | None = None,
    boundaries: Array | None = None,
) -> Chain:
    """Chain of `beam` to numeric `stations`.

    A station within an element is reached by a partial element of its own, so that the chain, and
    with it the shape, does not depend on which stations are asked for. `parameters` (m, 1) are
    symbols with respect to which the chain's data are differentiated; `boundaries` those of the
    elements, unless they are the beam's.
    """
    if parameters is None and boundaries is None:
        at = tuple(stations)
        return remembered(beam, ("chain", at), lambda: _build(beam, at, None, beam.stations))
    return _build(beam, stations, parameters, beam.stations if boundaries is None else boundaries)


def _build(
    beam: Beam, stations: Sequence[float], parameters: AnyExpr | None, boundaries: Array
) -> Chain:
    intervals, exits = _intervals(boundaries, stations)
    elements = max((k for k, _ in exits), default=0)
    intervals = [(boundaries[k], boundaries[k + 1]) for k in range(elements)] + intervals
    exits = [(k, None if e is None else elements + e) for k, e in exits]

    rule = rule_of(beam.grid)
    samples = np.array([_points(a, b, rule.points) for a, b in intervals])
    phi = np.array([[beam.basis(x) for x in row] for row in samples])
    phi = phi.reshape(len(intervals), len(rule.points), 3, beam.basis.n)
    entries, values = _slots(np.einsum("mg,egrn->emrn", rule.weights, phi))
    pattern = Pattern(
        rule=rule,
        exponential=beam.grid.exponential,
        degree=beam.grid.degree,
        n=beam.basis.n,
        slots=values.shape[1],
        entries=entries,
        has_initial_curvature=beam.initial_curvature is not None,
        n_parameters=0 if parameters is None else parameters.numel(),
    )
    data = tuple(
        _data(beam, b - a, samples[e], values[e], pattern, parameters)
        for e, (a, b) in enumerate(intervals)
    )
    return Chain(pattern=pattern, data=data, elements=elements, exits=tuple(exits))


def _intervals(
    boundaries: Array, stations: Sequence[float]
) -> tuple[list[tuple[float, float]], list[tuple[int, int | None]]]:
    """Partial intervals, and for each station (whole elements, partial interval or None)."""
    partial: list[tuple[float, float]] = []
    exits: list[tuple[int, int | None]] = []
    for xi in stations:
        k = int(np.searchsorted(boundaries, xi + COINCIDENT, side="right")) - 1
        if xi - boundaries[k] <= COINCIDENT:
            exits.append((k, None))
        else:
            exits.append((k, len(partial)))
            partial.append((boundaries[k], xi))
    return partial, exits


def _points(left: float, right: float, points: tuple[float, ...]) -> Array:
    """Sample points of one element, strictly inside it: at a jump each side takes its own limit."""
    inside = np.nextafter([left, right], [right, left])
    return np.clip(left + (right - left) * np.array(points), *inside)


def _slots(moments: Array) -> tuple[tuple[tuple[int, int, int, int | None, float], ...], Array]:
    """Pattern entries of basis moments (E, m, 3, n), and the slot values (E, slots)."""
    entries: list[tuple[int, int, int, int | None, float]] = []
    known: dict[bytes, int] = {}
    columns: list[Array] = []
    for place in np.ndindex(moments.shape[1:]):
        values = moments[(slice(None), *place)] + 0.0  # no negative zeros
        if not np.any(values):
            continue
        if np.all(np.abs(values) == 1) and np.all(values == values[0]):
            entries.append((*place, None, float(values[0])))
            continue
        factor = 1.0
        if (-values + 0.0).tobytes() in known:
            factor, values = -1.0, -values + 0.0
        slot = known.setdefault(values.tobytes(), len(columns))
        if slot == len(columns):
            columns.append(values)
        entries.append((*place, slot, factor))
    return tuple(entries), np.stack(columns, axis=1) if columns else np.zeros((len(moments), 0))


def _data(
    beam: Beam,
    fraction: float,
    samples: Array,
    values: Array,
    pattern: Pattern,
    parameters: AnyExpr | None,
) -> AnyExpr:
    """Data vector of one interval, in the parts of `Pattern.sizes`."""
    h = beam.length * fraction
    parts = [h, h * ca.DM(values)]
    initial = ca.DM.zeros(3 * pattern.moments)
    if pattern.has_initial_curvature:
        k0 = ca.horzcat(*(beam.initial_curvature_at(x) for x in samples))
        initial = ca.vec(k0 @ ca.DM(pattern.rule.weights).T)
        parts.insert(1, h * initial)
    if parameters is not None and pattern.n_parameters:
        parts.append(_vec_jacobian(h, parameters))
        parts.append(_vec_jacobian(initial, parameters) * h)
    return ca.vertcat(*parts)


def _vec_jacobian(values: AnyExpr, parameters: AnyExpr) -> AnyExpr:
    if is_numeric(values):
        return ca.DM.zeros(ca.DM(values).numel() * parameters.numel())
    return ca.vec(ca.densify(ca.jacobian(values, parameters)))


class Interval(NamedTuple):
    """SX symbols of one interval, and what they mean to the step."""

    q: ca.SX
    data: ca.SX
    h: ca.SX  #: element length, m
    moments: ca.SX  #: (3, m), rad
    directions: ca.SX  #: (1 + 3 m, n + parameters): d(h, M_1 … M_m)/d(q, parameters)


def interval(pattern: Pattern) -> Interval:
    """Moments M_k = h Σ_i W_ki (K_0 + Φ q)(xi_i) from the weights and a data vector."""
    m = pattern.moments
    q, data = ca.SX.sym("q", pattern.n), ca.SX.sym("data", sum(pattern.sizes))
    h, initial, values, derivatives = ca.vertsplit(data, [0, *np.cumsum(pattern.sizes).tolist()])
    directions = ca.SX(1 + 3 * m, pattern.n)
    for moment, row, column, slot, factor in pattern.entries:
        directions[1 + 3 * moment + row, column] = factor * (h if slot is None else values[slot])
    moments = ca.densify(directions[1:, :] @ q)
    if pattern.has_initial_curvature:
        moments += initial
    if pattern.n_parameters:
        d_h = derivatives[: pattern.n_parameters].T
        d_initial = ca.reshape(derivatives[pattern.n_parameters :], 3 * m, pattern.n_parameters)
        directions = ca.horzcat(directions, ca.vertcat(d_h, moments / h @ d_h + d_initial))
    return Interval(q, data, h, ca.reshape(moments, 3, m), directions)


def step_function(
    name: str, arguments: dict[str, ca.SX], state: ca.SX, data: ca.SX, next_state: ca.SX
) -> ca.Function:
    """A step as a `casadi.Function`: arguments …, state, data -> state."""
    names = [*arguments, "state", "data"]
    return ca.Function(
        name, [*arguments.values(), state, data], [next_state], names, ["next"], {"cse": True}
    )


@lru_cache(maxsize=256)
def pose_step(pattern: Pattern) -> ca.Function:
    """Step of a pose: (q, state, data) -> state, state = (vec R, p)."""
    q, data, h, moments, _ = interval(pattern)
    state = ca.SX.sym("state", 12)
    rotation, position = unpack_pose(state)
    strain = pattern.rule.strain(h, moments)
    end = element.advance(rotation, position, strain, pattern.exponential, pattern.degree)
    return step_function("element_pose", {"q": q}, state, data, ca.veccat(*end))


@lru_cache(maxsize=256)
def squared_angle(pattern: Pattern) -> ca.Function:
    """θ² of an interval, rad²: (q, data) -> (1, 1)."""
    q, data, h, moments, _ = interval(pattern)
    theta, _ = pattern.rule.strain(h, moments)
    return ca.Function(
        "element_squared_angle", [q, data], [ca.sumsqr(theta)], ["q", "data"], ["squared_angle"]
    )


def squared_angles(beam: Beam, q: AnyExpr) -> AnyExpr:
    """θ² (N, 1), rad², of the elements of a beam."""
    elements = build(beam, (1.0,))
    angle = squared_angle(elements.pattern).map(len(elements.data))
    return angle(ca.repmat(q, 1, len(elements.data)), ca.horzcat(*elements.data)).T


#: State of the identity pose.
IDENTITY = Pose.identity().packed
