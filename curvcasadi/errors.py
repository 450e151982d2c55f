"""Failures that carry what was reached."""

from __future__ import annotations

import os
import signal
import sys
from pathlib import Path
from types import FrameType
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

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (str(self), self.result)


def _is_command() -> bool:
    """Whether the package is imported by its command or by `python -m curvcasadi`."""
    name = Path(sys.argv[0]).stem if sys.argv else ""
    module = sys.orig_argv[sys.orig_argv.index("-m") + 1 :] if name == "-m" else []
    return name == "curvcasadi" or module[:1] == ["curvcasadi"]


def leave_at_interrupt(number: int, frame: FrameType | None) -> None:
    """End the process as after Ctrl-C: a line and the exit code 130."""
    os.write(2, b"curvcasadi: error: interrupted\n")
    os._exit(130)


if _is_command():  # imports take a second: Ctrl-C ends them without a traceback, too
    signal.signal(signal.SIGINT, leave_at_interrupt)
