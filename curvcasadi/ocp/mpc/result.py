"""What a step of predictive control gives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from curvcasadi.symbolic.expressions import Array
from curvcasadi.symbolic.text import described, shown


@dataclass(frozen=True, eq=False, kw_only=True)
class MpcStep:
    """What a predictive controller says at one time.

    Attributes
    ----------
    u : array, shape (nu,)
        Input to apply now, within its bounds whatever happened.
    plan : array, shape (nu, N)
        Inputs of all stages, `u` the first.
    states : array, shape (nx, N + 1)
        States along the plan, of the model; NaN where there is none.
    success : bool
        Whether `u` comes from a solution of this call.
    message : str
        What happened, in words.
    violation : float
        Excess over bounds that are not soft, over what counts as none: at most 1 where kept.
    stationarity : float
        Distance from the optimality conditions over its tolerance: at most 1 where they hold.
    slack : dict of str to array, shape (N,)
        Excess over each soft bound, by name, in its unit.
    """

    u: Array
    plan: Array
    states: Array
    success: bool
    message: str
    violation: float
    stationarity: float
    slack: dict[str, Array]

    def __repr__(self) -> str:
        return f"<MpcStep: {self.message.splitlines()[0]}>"

    def __str__(self) -> str:
        rows = {
            "u": shown(self.u),
            "plan": f"{self.plan.shape[1]} stages",
            "violation": f"{self.violation:.2g}, at most 1 where bounds are kept",
            "stationarity": f"{self.stationarity:.2g}, at most 1 at an optimum",
            **{f"slack of {name}": f"{np.max(v):.3g} at most" for name, v in self.slack.items()},
        }
        return described(f"Step of predictive control: {self.message}", rows)
