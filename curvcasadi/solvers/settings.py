"""How a Gauss–Newton SQP is to be solved."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from curvcasadi.symbolic.expressions import count, instance


@dataclass(frozen=True, kw_only=True)
class SqpSettings:
    """How the Gauss–Newton SQP of a Function is solved.

    Attributes
    ----------
    iterations : int or None
        None to converge; k for k quadratic programs with full steps, 1 for a real-time iteration.
    max_iter : int
        Quadratic programs at most, where it converges.
    qp_solver : str
        "own", which becomes self-contained C, or a QP solver of CasADi.
    """

    iterations: int | None = None
    max_iter: int = 100
    qp_solver: str = "own"

    def __post_init__(self) -> None:
        if self.iterations is not None:
            count("iterations", self.iterations)
        count("max_iter", self.max_iter)


def sqp_settings(settings: SqpSettings | None, **keywords: Any) -> SqpSettings:
    """`settings`, or those of single keyword arguments; both are an error."""
    single = SqpSettings(**keywords)
    if settings is None:
        return single
    if single != SqpSettings():
        raise ValueError(
            "settings: expected settings, or iterations, max_iter and qp_solver; found both"
        )
    found: SqpSettings = instance("settings", settings, SqpSettings)
    return found
