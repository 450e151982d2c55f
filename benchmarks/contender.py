"""What is compared side by side: one way to compute the tip pose of the test wing."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from curvcasadi.symbolic.expressions import Array
from tests.support.wing import WEIGHTS

#: Weight vectors of a batch.
BATCH = 200


@dataclass(frozen=True, kw_only=True)
class Contender:
    """Callables take weights in the tool's own kind of array and block until the result is there.

    `point` holds the weights of the test wing; `batch` BATCH vectors about them.
    """

    name: str
    size: str  #: elements, steps or tolerance
    point: Any
    batch: Any
    position: Callable[[Array], Array]  #: tip position, m, for the error
    pose: Callable[[Any], Any]
    pose_and_jacobian: Callable[[Any], Any]
    pose_batch: Callable[[Any], Any]
    pose_and_jacobian_batch: Callable[[Any], Any]
    finite: Callable[[], tuple[bool, bool]]  #: Jacobian and Hessian of the tip position at q = 0


def batch_weights(n: int = BATCH) -> Array:
    """Weight vectors (12, n) of wings between three quarters and the whole of the test wing's."""
    return np.outer(WEIGHTS, np.linspace(0.75, 1.0, n))


def of_functions(
    name: str,
    size: str,
    pose: ca.Function,
    pose_and_jacobian: ca.Function,
    finite: Callable[[], tuple[bool, bool]],
) -> Contender:
    """A contender of two CasADi Functions of q whose first output is the tip position."""
    return Contender(
        name=name,
        size=size,
        point=ca.DM(WEIGHTS),
        batch=ca.DM(batch_weights()),
        position=lambda q: pose(q)[0].full().ravel(),
        pose=pose,
        pose_and_jacobian=pose_and_jacobian,
        pose_batch=pose.map(BATCH),
        pose_and_jacobian_batch=pose_and_jacobian.map(BATCH),
        finite=finite,
    )


def finite_at_zero(position: Any, q: Any) -> tuple[bool, bool]:
    """Whether the Jacobian and the Hessian of a CasADi expression are finite at q = 0."""
    first = ca.jacobian(position, q)
    function = ca.Function("derivatives", [q], [first, ca.jacobian(first, q)])
    zero = ca.DM.zeros(q.numel())
    jacobian, hessian = (bool(np.all(np.isfinite(d.full()))) for d in function(zero))
    return jacobian, hessian
