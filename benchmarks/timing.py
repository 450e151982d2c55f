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


def _round(call: Callable[..., Any], arguments: tuple[Any, ...], calls: int) -> float:
    start = time.perf_counter()
    for _ in range(calls):
        call(*arguments)
    return time.perf_counter() - start
