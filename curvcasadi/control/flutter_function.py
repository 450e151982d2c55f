"""The flutter speed as a CasADi Function of design parameters, for nonlinear programs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import casadi as ca
import numpy as np

from curvcasadi.control.design import flutter_derivatives
from curvcasadi.control.flutter import Flutter, checked_arguments, flutter
from curvcasadi.control.model import ControlModel
from curvcasadi.control.signals import stacked
from curvcasadi.symbolic.expressions import Array, Number, choice, function_name, instance, sequence


def flutter_speed_function(
    model: ControlModel,
    names: Sequence[str],
    speeds: Number,
    u: Number | Mapping[str, Number] | None = None,
    p: Mapping[str, Number] | None = None,
    *,
    name: str = "flutter_speed",
) -> ca.Function:
    """The flutter speed as a Function: design -> speed, with its exact Jacobian.

    It runs `flutter` in Python, so it becomes no C. The Jacobian is that of `flutter_derivatives`,
    without derivatives of its own: programs need a Hessian that is not exact (IPOPT's
    ``hessian_approximation="limited-memory"``). A wing that flutters at none of `speeds`, or is
    unstable at the first, gives NaN.

    Parameters
    ----------
    model : ControlModel
        As of `flutter`; its parameters hold the design.
    names : sequence of str
        Parts of p that form the design, stacked in this order.
    speeds, u : optional
        As of `flutter`.
    p : mapping of str to number, optional
        The other parameters by name, as of `flutter`.
    name : str
        Name of the Function.

    Returns
    -------
    casadi.Function
        design (m, 1) -> speed (1, 1), m/s.

    Raises
    ------
    ValueError
        As `flutter`, but for what depends on the design.
    """
    instance("model", model, ControlModel)
    known = [part.name for part in model.p.parts if part.name != "airspeed"]
    chosen = [choice("names", key, known) for key in sequence("names", names)]
    sizes = [model.p.slices[key].stop - model.p.slices[key].start for key in chosen]
    _, grid, held, others = checked_arguments(model, speeds, u, p, chosen)
    stacked("p", model.p, others)

    def sweep(design: Array) -> Flutter | None:
        parts = np.split(design, np.cumsum(sizes)[:-1])
        try:
            return flutter(model, grid, held, {**others, **dict(zip(chosen, parts, strict=True))})
        except ValueError:  # unstable at the first speed, or no wing at all
            return None

    return _FlutterSpeed(function_name("name", name), chosen, sum(sizes), sweep)


class _FlutterSpeed(ca.Callback):  # type: ignore[misc]
    """design -> speed; the last sweep is kept for its Jacobian."""

    def __init__(self, name: str, names: list[str], size: int, sweep: Any) -> None:
        ca.Callback.__init__(self)
        self.names, self.size, self.sweep = names, size, sweep
        self.last: tuple[bytes, Flutter | None] = (b"", None)
        self.slopes: list[_Slope] = []  # as long as this lives
        self.construct(name, {})

    def get_n_in(self) -> int:
        return 1

    def get_n_out(self) -> int:
        return 1

    def get_name_in(self, i: int) -> str:
        return "design"

    def get_name_out(self, i: int) -> str:
        return "speed"

    def get_sparsity_in(self, i: int) -> ca.Sparsity:
        return ca.Sparsity.dense(self.size, 1)

    def get_sparsity_out(self, i: int) -> ca.Sparsity:
        return ca.Sparsity.dense(1, 1)

    def found(self, design: Array) -> Flutter | None:
        """The sweep at a design."""
        if self.last[0] != design.tobytes():
            self.last = design.tobytes(), self.sweep(design)
        return self.last[1]

    def eval(self, arg: Sequence[Any]) -> list[ca.DM]:
        found = self.found(arg[0].full().ravel())
        return [ca.DM(np.nan if found is None or found.speed is None else found.speed)]

    def has_jacobian(self) -> bool:
        return True

    def get_jacobian(
        self, name: str, inames: Sequence[str], onames: Sequence[str], opts: Any
    ) -> ca.Function:
        self.slopes.append(_Slope(self, name, inames, onames, opts))
        return self.slopes[-1]


class _Slope(ca.Callback):  # type: ignore[misc]
    """design, speed -> slope (1, m)."""

    def __init__(
        self,
        owner: _FlutterSpeed,
        name: str,
        inames: Sequence[str],
        onames: Sequence[str],
        opts: Any,
    ) -> None:
        ca.Callback.__init__(self)
        self.owner, self.inames, self.onames = owner, inames, onames
        self.construct(name, opts)

    def get_n_in(self) -> int:
        return 2

    def get_n_out(self) -> int:
        return 1

    def get_name_in(self, i: int) -> str:
        return self.inames[i]

    def get_name_out(self, i: int) -> str:
        return self.onames[i]

    def get_sparsity_in(self, i: int) -> ca.Sparsity:
        return ca.Sparsity.dense(self.owner.size, 1) if i == 0 else ca.Sparsity.dense(1, 1)

    def get_sparsity_out(self, i: int) -> ca.Sparsity:
        return ca.Sparsity.dense(1, self.owner.size)

    def eval(self, arg: Sequence[Any]) -> list[ca.DM]:
        found = self.owner.found(arg[0].full().ravel())
        if found is None or found.speed is None:
            return [ca.DM.nan(1, self.owner.size)]
        slopes = flutter_derivatives(found, self.owner.names)
        return [ca.DM(np.concatenate([*slopes.values()])).T]
