"""Failures that carry what was reached."""

from __future__ import annotations

from typing import Any


class ConvergenceError(RuntimeError):
    """A solver did not reach what was asked for; `result` holds the best that it found."""

    def __init__(self, message: str, result: Any) -> None:
        super().__init__(message)
        self.result = result
