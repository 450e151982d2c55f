"""Failures that carry what was reached."""

from __future__ import annotations

from typing import Any


class ConvergenceError(RuntimeError):
    """A solver did not reach what was asked for.

    Parameters
    ----------
    message : str
        What was missed and by how much.
    result : object
        The best that was found; its type is that of the solver's result.
    """

    def __init__(self, message: str, result: Any) -> None:
        super().__init__(message)
        self.result = result
