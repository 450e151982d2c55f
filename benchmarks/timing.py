"""Time of a call, for ratios within one run."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any


def seconds(call: Callable[..., Any], *arguments: Any, budget: float = 0.3) -> float:
    """Least seconds of one call, after a warm-up, from several rounds that last `budget` in all."""
    call(*arguments)
    rounds = 7
    once = _round(call, arguments, 1)
    calls = max(1, int(budget / rounds / max(once, 1e-9)))
    return min(_round(call, arguments, calls) / calls for _ in range(rounds))


def least(call: Callable[[], Any], budget: float = 0.5) -> float:
    """Least seconds of a single call that takes a millisecond or so, within `budget` seconds.

    Also beside other work: some calls are not interrupted.
    """
    call()
    end = time.perf_counter() + budget
    found = float("inf")
    while time.perf_counter() < end:
        found = min(found, _round(call, (), 1))
    return found


def _round(call: Callable[..., Any], arguments: tuple[Any, ...], calls: int) -> float:
    start = time.perf_counter()
    for _ in range(calls):
        call(*arguments)
    return time.perf_counter() - start
