"""Solves that end at Ctrl-C."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

import casadi as ca


def solved(nlp: ca.Function, **arguments: Any) -> tuple[dict[str, Any], dict[str, Any]]:
    """Solution and statistics of an NLP solver.

    Parameters
    ----------
    nlp : Function
        What `casadi.nlpsol` returns.
    **arguments : array
        Its inputs by name.

    Returns
    -------
    solution, stats : dict
        Outputs by name, and what `nlp.stats()` says of them.

    Raises
    ------
    KeyboardInterrupt
        After Ctrl-C, which IPOPT would take for the end of this solve alone.
    """
    with ending_at_interrupt():
        solution = nlp(**arguments)
    return solution, nlp.stats()


@contextmanager
def ending_at_interrupt() -> Iterator[None]:
    """Raise KeyboardInterrupt after Ctrl-C, whatever CasADi makes of it meanwhile.

    A solver of CasADi meets the exception within a callback and hands on an error of its own, or
    none. Outside the main thread Python delivers no signals, and nothing changes.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    seen: list[int] = []
    before = signal.getsignal(signal.SIGINT)

    def remember(number: int, frame: FrameType | None) -> None:
        seen.append(number)
        if callable(before):
            before(number, frame)

    signal.signal(signal.SIGINT, remember)
    try:
        yield
    except Exception:
        if not seen:
            raise
    finally:
        signal.signal(signal.SIGINT, before)
    if seen:
        raise KeyboardInterrupt
