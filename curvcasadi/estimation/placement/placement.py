"""Which of many candidate sensors to buy: those with the most information about the weights."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import Any, Literal, get_args

import casadi as ca
import numpy as np

from curvcasadi.beam.beam import Beam, numeric_length
from curvcasadi.estimation.information import (
    ShapeDeviations,
    information_problem,
    shape_deviations,
)
from curvcasadi.estimation.observability import observability
from curvcasadi.estimation.placement.subset import Gains, Limits, checked_limits, exact, greedy
from curvcasadi.estimation.sensor_model import covariance_matrix
from curvcasadi.kinematics.shape import Shape, shape_map
from curvcasadi.sensors import RootMotion, Sensor
from curvcasadi.sensors.channels import checked_sensors
from curvcasadi.symbolic.expressions import Array, Number, choice

Method = Literal["greedy", "exact"]


@dataclass(frozen=True, eq=False, kw_only=True)
class Placement:
    """Chosen sensors, and how well they are expected to know the shape.

    Expected standard deviations are those of the weights given one sample of the chosen sensors and
    the prior, root mean square over the shapes and motions.

    Attributes
    ----------
    indices : tuple of int
        Chosen candidates, increasing.
    order : tuple of int
        The same as greedily chosen; increasing where exact.
    sensors : tuple of Sensor
        Sensors of the chosen candidates, as `fit_shape` takes them.
    gain : float
        Log det of the information over that of the prior, nats.
    bound : float
        Gain that no choice exceeds, nats; the gain itself where exact.
    cost : float or None
        Cost of the chosen candidates; None without costs.
    method : {"greedy", "exact"}
        How they were chosen.
    labels : tuple of str
        A name per weight.
    weight_deviations : array, shape (n,)
        Expected standard deviations of the weights, rad/m.
    prior_weight_deviations : array, shape (n,)
        The same without sensors, rad/m.
    deviations : ShapeDeviations
        Expected standard deviations along the span.
    prior_deviations : ShapeDeviations
        The same without sensors.
    unseen : tuple of str
        Weights that the chosen sensors do not see, in words.
    shape : Shape
        The first shape.
    candidate_stations : tuple of tuple of float
        Stations s/L of the sensors of each candidate.
    """

    indices: tuple[int, ...]
    order: tuple[int, ...]
    sensors: tuple[Sensor, ...]
    gain: float
    bound: float
    cost: float | None
    method: Method
    labels: tuple[str, ...]
    weight_deviations: Array
    prior_weight_deviations: Array
    deviations: ShapeDeviations
    prior_deviations: ShapeDeviations
    unseen: tuple[str, ...]
    shape: Shape
    candidate_stations: tuple[tuple[float, ...], ...]

    @property
    def guarantee(self) -> float:
        """At least this part of the best gain is reached: gain over bound."""
        return self.gain / self.bound if self.bound else 1.0

    @property
    def success(self) -> bool:
        """Always true: without a choice within the limits `place_sensors` raises."""
        return True

    @property
    def message(self) -> str:
        """How good the choice is, in words."""
        quality = "the optimum"
        if self.method == "greedy":
            quality = f"at least {100 * self.guarantee:.0f} % of the optimum"
        offered = len(self.candidate_stations)
        return f"gain {self.gain:.4g} nats over the prior, {quality} of {offered} candidates"

    def summary(self) -> str:
        """What was chosen, and what it is expected to know.

        Returns
        -------
        str
            Several lines.
        """
        width = max(len(label) for label in self.labels)
        rest = iter(self.sensors)
        groups = {i: islice(rest, len(self.candidate_stations[i])) for i in self.indices}
        where = ", ".join(f"{i} ({_words(group)})" for i, group in groups.items())
        spent = "" if self.cost is None else f" at a cost of {self.cost:g}"
        tip, before = self.deviations.distance[-1], self.prior_deviations.distance[-1]
        lines = [
            f"candidates {where}{spent}",
            self.message,
            f"expected standard deviation of the tip {tip:.3g} m, {before:.3g} m without sensors",
            "of the weights, rad/m",
        ]
        for label, after, prior in zip(
            self.labels, self.weight_deviations, self.prior_weight_deviations, strict=True
        ):
            lines.append(f"  {label:<{width}}  {after:.2e}, {prior:.2e} without sensors")
        if self.unseen:
            lines.append(
                "not seen by these sensors, the prior holds them: " + "; ".join(self.unseen)
            )
        return "\n".join(lines)

    def __repr__(self) -> str:
        return f"<Placement of candidates {[*self.indices]}: {self.message}>"

    def __str__(self) -> str:
        return self.summary()


def place_sensors(
    beam: Beam,
    candidates: Sequence[Sensor | Sequence[Sensor]],
    k: int | None = None,
    *,
    shapes: Number,
    prior: Number,
    rates: Number | None = None,
    unknowns: Sequence[str] = ("q",),
    root: RootMotion | None = None,
    costs: Number | None = None,
    budget: float | None = None,
    method: Method = "greedy",
) -> Placement:
    """Choose at most `k` of m candidates within the budget, with most information on the weights.

        max_A  f(A) = log det(P⁻¹ + Σ_{i ∈ A} H_i) − log det P⁻¹

    with H_i the `information_matrix` of candidate i, mean over the shapes and motions. f is
    monotone and submodular, so that the greedy choice has a guarantee:

    - k of m: at least 1 − 1/e = 63 % of the best gain (Nemhauser, Wolsey, Fisher 1978);
    - within a budget, without k: the better of two greedy choices, by gain and by gain over cost,
      and of all single candidates reaches at least (1 − 1/e)/2 = 32 % (Leskovec et al. 2007). With
      both k and a budget there is no such constant.

    `Placement.guarantee` is what holds for the choice at hand, and mostly far better: by
    submodularity no choice exceeds f(A) plus the largest gains of single candidates beyond A.

    Parameters
    ----------
    beam : Beam
        Wing with numeric fields.
    candidates : sequence of Sensor or of sequences of Sensor
        Sensors, or groups of sensors that are bought together, as an inertial unit is.
    k : int, optional
        Largest number of candidates; only the budget limits it where None.
    shapes : array, shape (S, n) or (n,)
        Curvature weights, rad/m, as for `information_matrix`.
    prior : float or array, shape (n,) or (n, n)
        What is known without sensors: one standard deviation, rad/m, one for each unknown, or a
        covariance P.
    rates, unknowns, root : optional
        As of `information_matrix`.
    costs : float or array, optional
        Cost of each candidate, or one for all, in any unit.
    budget : float, optional
        Bound of the sum of the costs; needs `costs`.
    method : {"greedy", "exact"}
        "exact" tries every set, 200 000 at most.

    Returns
    -------
    Placement
        The choice, its gain, and what it is expected to know.

    Raises
    ------
    ValueError
        For arguments of the wrong shape, kind or range, if no candidate fits the budget, and for
        more sets than "exact" tries.
    """
    choice("method", method, get_args(Method))
    groups = _groups(candidates)
    limits = checked_limits(len(groups), k, costs, budget)
    flat = [sensor for group in groups for sensor in group]
    model, states = information_problem(beam, flat, shapes, rates, unknowns, root)
    covariance = covariance_matrix("prior", prior, len(model.unknowns) * beam.basis.n)

    owner = np.repeat(np.arange(len(groups)), [len(group) for group in groups])[model.groups]
    slopes = [model.slope(state) for state in states]
    factor = np.linalg.cholesky(covariance)
    gains = Gains(np.mean([_informations(slope @ factor, owner) for slope in slopes], axis=0))
    if method == "exact":
        order = exact(gains, limits)
        bound = gains.of(order)
    else:
        order, bound = greedy(gains, limits)

    chosen = np.isin(owner, order)
    return _placement(
        beam,
        groups,
        order,
        states,
        [slope[chosen] for slope in slopes],
        covariance,
        gain=gains.of(order),
        bound=bound,
        method=method,
        limits=limits,
    )


def _groups(candidates: Sequence[Sensor | Sequence[Sensor]]) -> list[tuple[Sensor, ...]]:
    if isinstance(candidates, Sensor) or not np.iterable(candidates):
        raise ValueError(f"candidates: expected a sequence of sensors, found {candidates!r}")
    groups = []
    for i, entry in enumerate(candidates):
        try:
            groups.append(checked_sensors([entry] if isinstance(entry, Sensor) else entry))
        except ValueError as error:
            raise ValueError(f"candidates[{i}]: {error}") from None
    if not groups:
        raise ValueError("candidates: expected one or more, found none")
    return groups


def _words(group: Iterable[Sensor]) -> str:
    """Names, or kinds, of sensors bought together, and where they sit."""
    return ", ".join(dict.fromkeys(f"{s.name or s.prefix} at xi = {s.xi:g}" for s in group))


def _informations(slope: Array, owner: Array) -> Array:
    """Information (m, N, N) of each candidate from the rows that it owns."""
    return np.array([slope[owner == i].T @ slope[owner == i] for i in range(owner.max() + 1)])


def _placement(
    beam: Beam,
    groups: list[tuple[Sensor, ...]],
    order: list[int],
    states: list[dict[str, Array]],
    slopes: list[Array],
    covariance: Array,
    limits: Limits,
    **fields: Any,
) -> Placement:
    """The choice, with what its rows `slopes` (r, N) at each of `states` leave unknown."""
    n = beam.basis.n
    before = np.linalg.inv(covariance)
    after = [np.array(np.linalg.inv(before + slope.T @ slope)[:n, :n]) for slope in slopes]
    indices = tuple(sorted(order))
    sensors = tuple(sensor for i in indices for sensor in groups[i])
    shapes = [state["q"] for state in states]
    seen = observability(
        np.vstack(slopes)[:, :n] / np.sqrt(len(slopes)),
        numeric_length(beam, "place_sensors"),
        beam.basis.labels,
    )
    return Placement(
        indices=indices,
        order=tuple(order),
        sensors=sensors,
        cost=None if limits.costs is None else limits.cost(order),
        labels=beam.basis.labels,
        weight_deviations=np.sqrt(np.mean([np.diag(p) for p in after], axis=0)),
        prior_weight_deviations=np.sqrt(np.diag(covariance)[:n]),
        deviations=_mean_deviations(beam, shapes, after),
        prior_deviations=_mean_deviations(beam, shapes, [covariance[:n, :n]] * len(shapes)),
        unseen=seen.words,
        shape=shape_map(beam, ca.DM(shapes[0])),
        candidate_stations=tuple(tuple(s.xi for s in group) for group in groups),
        **fields,
    )


def _mean_deviations(beam: Beam, shapes: list[Array], covariances: list[Array]) -> ShapeDeviations:
    """Root mean square over the shapes."""
    found = [shape_deviations(beam, q, p) for q, p in zip(shapes, covariances, strict=True)]

    def mean(values: list[Array]) -> Array:
        return np.asarray(np.sqrt(np.mean(np.square(values), axis=0)))

    return ShapeDeviations(
        stations=found[0].stations,
        position=mean([f.position for f in found]),
        attitude=mean([f.attitude for f in found]),
    )
