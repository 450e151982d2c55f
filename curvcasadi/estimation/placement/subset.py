"""Subsets of largest log-determinant: greedy with a bound, and exact by enumeration."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import chain, combinations, islice
from math import comb
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from curvcasadi.symbolic.expressions import Array, Number, count, numbers, numeric, positive

#: Sets of candidates that the exact method tries at most.
MOST_SETS = 200_000
#: Sets whose information is added up at once.
_BATCH = 4096


class Limits(NamedTuple):
    """What a choice has to keep."""

    k: int  #: largest number of candidates
    costs: Array | None  #: (m,)
    budget: float

    @property
    def largest(self) -> float:
        """The budget, opened by the rounding of sums."""
        return self.budget * (1 + 1e-12)

    def cost(self, chosen: Sequence[int]) -> float:
        """Sum over `chosen`; 0 without costs."""
        return 0.0 if self.costs is None else float(np.sum(self.costs[list(chosen)]))

    def fitting(self, chosen: Sequence[int], m: int) -> NDArray[np.bool_]:
        """Candidates (m,) that may be added."""
        free = ~np.isin(np.arange(m), chosen)
        if len(chosen) >= self.k:
            free[:] = False
        elif self.costs is not None:
            free &= self.cost(chosen) + self.costs <= self.largest
        return free


def checked_limits(m: int, k: int | None, costs: Number | None, budget: float | None) -> Limits:
    """Limits of a choice among `m` candidates, or a ValueError that names what is wrong."""
    if k is None and budget is None:
        raise ValueError("k: expected a number of candidates, or a budget with costs, found None")
    if k is not None and count("k", k) > m:
        raise ValueError(f"k: expected at most the {m} candidates, found {k}")
    if budget is not None and costs is None:
        raise ValueError("costs: expected numbers where a budget is given, found None")
    values = None
    if costs is not None:
        found = numbers("costs", costs).ravel()
        if found.size not in (1, m) or not np.all(found > 0):
            raise ValueError(f"costs: expected 1 or {m} numbers above zero, found {found.tolist()}")
        values = np.array(np.broadcast_to(found, (m,)))
    most = np.inf if budget is None else float(numeric("budget", positive("budget", budget)))
    if values is not None and np.min(values) > most:
        raise ValueError(
            f"budget: expected at least {np.min(values):g}, the cheapest candidate, found {most:g}"
        )
    return Limits(m if k is None else k, values, most)


class Gains:
    """f(A) over the prior: log det(I + Σ M_i) with M_i = Pᵀ/² H_i P¹/²."""

    def __init__(self, informations: Array) -> None:
        self.informations = informations  #: (m, N, N)
        self.m = len(informations)

    def of(self, chosen: Sequence[int]) -> float:
        """f of one set."""
        return float(_log_det(self._sum(chosen)))

    def beyond(self, chosen: Sequence[int]) -> Array:
        """What each candidate (m,) adds to `chosen`."""
        total = self._sum(chosen)
        gained = _log_det(total + self.informations) - _log_det(total)
        gained[list(chosen)] = 0.0
        return np.asarray(np.maximum(gained, 0.0))

    def of_sets(self, sets: Array) -> Array:
        """f of many sets (B, size)."""
        total = np.eye(self.informations.shape[1]) + sum(
            self.informations[column] for column in sets.T
        )
        return _log_det(total)

    def _sum(self, chosen: Sequence[int]) -> Array:
        total = np.eye(self.informations.shape[1])
        return np.asarray(total + self.informations[list(chosen)].sum(axis=0))


def _log_det(matrices: Array) -> Array:
    return np.asarray(np.linalg.slogdet(matrices)[1])


def greedy(gains: Gains, limits: Limits) -> tuple[list[int], float]:
    """The best of the greedy choices, and a gain that no choice exceeds."""
    ones = np.ones(gains.m)
    rules = [ones] if limits.costs is None else [ones, limits.costs]
    found, bound = [], np.inf
    for divisor in rules:
        chosen: list[int] = []
        while True:
            gained = gains.beyond(chosen)
            bound = min(bound, gains.of(chosen) + _largest_sum(gained, limits))
            fitting = limits.fitting(chosen, gains.m)
            if not np.any(fitting):
                break
            chosen.append(int(np.argmax(np.where(fitting, gained / divisor, -1.0))))
        found.append(chosen)
    if limits.costs is not None:
        alone = np.where(limits.fitting([], gains.m), gains.beyond([]), -1.0)
        found.append([int(np.argmax(alone))])
    best = max(found, key=gains.of)
    return best, max(bound, gains.of(best))


def _largest_sum(gained: Array, limits: Limits) -> float:
    """At least the sum of `gained` over any set within the limits; fractions of one allowed."""
    most = float(np.sum(np.sort(gained)[::-1][: limits.k]))
    if limits.costs is None or not np.isfinite(limits.budget):
        return most
    best_first = np.argsort(-gained / limits.costs)
    costs = limits.costs[best_first]
    before = np.cumsum(costs) - costs
    parts = np.clip((limits.budget - before) / costs, 0.0, 1.0)
    return min(most, float(parts @ gained[best_first]))


def exact(gains: Gains, limits: Limits) -> list[int]:
    """The best set of all within the limits."""
    sets = _sets(gains.m, limits)
    best, largest = [], -np.inf
    for size, members in sets:
        for batch in _batches(members, size):
            values = gains.of_sets(batch)
            if np.max(values) > largest:
                best = batch[int(np.argmax(values))].tolist()
                largest = float(np.max(values))
    return best


def _sets(m: int, limits: Limits) -> list[tuple[int, Iterable[tuple[int, ...]]]]:
    """Sets within the limits by size, or a ValueError if they are too many."""
    if limits.costs is None or not np.isfinite(limits.budget):
        total = comb(m, limits.k)
        if total > MOST_SETS:
            raise _too_many(f"{limits.k} of {m} candidates are {total} sets")
        return [(limits.k, combinations(range(m), limits.k))]
    sets = _affordable(limits.costs.tolist(), limits.largest, limits.k)
    found = list(islice(sets, MOST_SETS + 1))
    if len(found) > MOST_SETS:
        raise _too_many(f"{m} candidates have more sets within the budget")
    sizes = sorted({len(members) for members in found})
    return [(size, [s for s in found if len(s) == size]) for size in sizes]


def _too_many(what: str) -> ValueError:
    return ValueError(
        f"method: 'exact' tries at most {MOST_SETS} sets, {what}; use 'greedy', whose result says "
        "how far from the optimum it may be"
    )


def _affordable(
    costs: list[float], budget: float, k: int, members: tuple[int, ...] = ()
) -> Iterator[tuple[int, ...]]:
    """Sets of at most `k` that begin with `members` and keep the budget, in order."""
    if members:
        yield members
    for i in range(members[-1] + 1 if members else 0, len(costs) if k else 0):
        if costs[i] <= budget:
            yield from _affordable(costs, budget - costs[i], k - 1, (*members, i))


def _batches(members: Iterable[tuple[int, ...]], size: int) -> Iterator[Array]:
    rest = iter(members)
    while batch := list(islice(rest, _BATCH)):
        yield np.fromiter(chain.from_iterable(batch), dtype=int).reshape(-1, size)
