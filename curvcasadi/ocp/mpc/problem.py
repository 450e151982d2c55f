"""The stages of a predictive controller, as the three Functions that are evaluated in a loop.

The state of a stage is the model's, its input, the change of that input, the slacks, and the
residual of an implicit step: z = (x, u, u − u_before, s, r). So weights and bounds of inputs, of
their moves and rates, and of soft limits are all of the end of a stage. The unknowns of a stage are
w = (u / scale, s), one slack for each soft limit, in its unit.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from curvcasadi.control.error_state import difference, in_error_state
from curvcasadi.control.model import ControlModel
from curvcasadi.lie import quaternion
from curvcasadi.ocp.mpc.functions import ModelFunctions, NativeFunctions
from curvcasadi.ocp.mpc.terms import Limit, Penalty, Terminal
from curvcasadi.solvers.stages import Stages
from curvcasadi.symbolic.expressions import Array
from curvcasadi.symbolic.layout import Layout

#: Relative correction of an implicit step up to which a plan may rely on it.
RESIDUAL = 1e-6


@dataclass(frozen=True, eq=False, kw_only=True)
class MpcProblem:
    """What is minimized, within which limits.

    Attributes
    ----------
    model : ControlModel
        The model.
    name : str
        Prefix of the Functions.
    dt : float
        Length of a stage, s.
    hold : tuple of int
        Index of the unknown input of each stage.
    penalties : tuple of Penalty
        Of outputs, states and inputs.
    moves : array, shape (nu,)
        Weights of the squared changes of inputs from stage to stage.
    limits : tuple of Limit
        Of outputs, states, angles and rates of states.
    lower, upper : array, shape (nu,)
        Bounds of the inputs.
    rates : pair of array, shape (nu,)
        Bounds of their rates.
    scale : array, shape (nu,)
        Units of the inputs among the unknowns.
    is_implicit : bool
        Whether the step has a residual to check.
    damping : float
        Weight of |w − guess|² in every program.
    terminal : Terminal or None
        Cost of the end of the last stage, beside that of every stage.
    """

    model: ControlModel
    name: str
    dt: float
    hold: tuple[int, ...]
    penalties: tuple[Penalty, ...]
    moves: Array
    limits: tuple[Limit, ...]
    lower: Array
    upper: Array
    rates: tuple[Array, Array]
    scale: Array
    is_implicit: bool
    damping: float
    terminal: Terminal | None = None

    @property
    def soft(self) -> tuple[Limit, ...]:
        """Limits with a slack, in the order of the slacks."""
        return tuple(limit for limit in self.limits if limit.weight is not None)

    @property
    def count(self) -> int:
        """Number of stages."""
        return len(self.hold)

    @property
    def nw(self) -> int:
        """Unknowns of a stage."""
        return self.model.u.size + len(self.soft)

    @property
    def goal_size(self) -> int:
        """Entries of a stage's reference."""
        return sum(penalty.part.size for penalty in self.penalties)

    @cached_property
    def unknown_bounds(self) -> tuple[Array, Array]:
        """Bounds of all unknowns.

        Slacks have none: one below zero would cost more and bound more closely, so that none is.
        A bound at zero would be reached without a multiplier, on which interior points do not end.
        """
        free, inputs = np.full(len(self.soft), np.inf), self.hold[-1] + 1
        lower = np.concatenate([self.lower / self.scale, -free])
        upper = np.concatenate([self.upper / self.scale, free])
        return np.tile(lower, inputs), np.tile(upper, inputs)

    @cached_property
    def limit_bounds(self) -> tuple[Array, Array]:
        """Bounds of the values of `limit_function`, for all stages."""
        lower, upper = [np.zeros(0)], [np.zeros(0)]
        for limit in self.limits:
            low, high = limit.lower / limit.unit, limit.upper / limit.unit
            if limit.weight is None:
                lower.append(low)
                upper.append(high)
            else:
                below, above = np.isfinite(low), np.isfinite(high)
                lower += [np.full(above.sum(), -np.inf), low[below]]
                upper += [high[above], np.full(below.sum(), np.inf)]
        for side, rate in zip((lower, upper), self.rates, strict=True):
            side.append((self.dt * rate / self.scale)[self._rate_rows])
        if self.is_implicit:
            lower.append(np.array([-np.inf]))
            upper.append(np.array([1.0]))
        tiled = (np.tile(np.concatenate(side), self.count) for side in (lower, upper))
        return tuple(tiled)  # type: ignore[return-value]

    @property
    def _rate_rows(self) -> NDArray[np.intp]:
        return np.flatnonzero(np.isfinite(self.rates[0]) | np.isfinite(self.rates[1]))

    def stages(self, functions: ModelFunctions | NativeFunctions) -> Stages:
        """The problem, made of Functions of the model."""
        return Stages(
            count=self.count,
            error=self._error(functions),
            step=self._step(functions.step),
            limits=self._limits(functions),
            move_weight=0.0,
            damping=self.damping,
            relative=True,
            hold=self.hold,
            varying=True,
            terminal=self._terminal(self.terminal) if self.terminal else None,
        )

    def goal(self, x: Array, u: Array, y: Array) -> Array:
        """The reference (ng,) of which these state, input and outputs miss nothing."""
        of = {"x": (self.model.x, x), "u": (self.model.u, u), "y": (self.model.y, y)}
        pieces = [np.zeros(0)]
        for penalty in self.penalties:
            layout, values = of[penalty.source]
            pieces.append(values[layout.slices[penalty.part.name]])
        return np.concatenate(pieces)

    @property
    def _sizes(self) -> list[int]:
        """Entries of z by part."""
        nu = self.model.u.size
        return [self.model.x.size, nu, nu, len(self.soft), int(self.is_implicit)]

    @property
    def size(self) -> int:
        """Entries of z, the state of a stage with what is compared and bounded at its end."""
        return sum(self._sizes)

    def split(self, z: ca.MX) -> list[ca.MX]:
        """x, u, change of u, slacks and residual."""
        parts: list[ca.MX] = ca.vertsplit(z, np.cumsum([0, *self._sizes]).tolist())
        return parts

    def _step(self, step: ca.Function) -> ca.Function:
        """(z, w, p) -> z_end, Aᵀ, Bᵀ in error states."""
        model, nu = self.model, self.model.u.size
        z, w = ca.MX.sym("z", self.size), ca.MX.sym("w", self.nw)
        p = ca.MX.sym("p", model.p.size)
        x, before, *_ = self.split(z)
        v, s = ca.vertsplit(w, [0, nu, self.nw])
        scale = ca.diag(ca.DM(self.scale))
        u = scale @ v
        end, residual = step(x, u, p)
        slopes = step.jacobian()
        found = slopes(x, u, p, end, residual)
        by = dict(zip(slopes.name_out(), found, strict=True))
        a = in_error_state(model.x, end, by["jac_x_next_x"] @ _from_error(model.x, x))
        b = in_error_state(model.x, end, by["jac_x_next_u"] @ scale)
        sizes = [model.x.errors.size, *self._sizes[1:]]
        one = ca.DM.eye(nu)
        rows = {(0, 0): a.T, (1, 2): -one}
        inputs = {(0, 0): b.T, (0, 1): scale, (0, 2): scale, (1, 3): ca.DM.eye(len(self.soft))}
        residuals = [residual] if self.is_implicit else []
        return ca.Function(
            f"{self.name}_stage_step",
            [z, w, p],
            [
                ca.vertcat(end, u, u - before, s, *residuals),
                _blocks(rows, sizes, sizes),
                _blocks(inputs, [nu, len(self.soft)], sizes),
            ],
            {"always_inline": True},
        )

    def _error(self, functions: ModelFunctions | NativeFunctions) -> ca.Function:
        """(z_end, p, goal) -> weighted errors, their Jacobian by dz_end, dense."""
        model = self.model
        z, p = ca.MX.sym("z", self.size), ca.MX.sym("p", model.p.size)
        goal = ca.MX.sym("goal", self.goal_size)
        x, u, change, slacks, _ = self.split(z)
        sources = {"x": model.x.split(x), "u": model.u.split(u)}
        if any(penalty.source == "y" for penalty in self.penalties):
            sources["y"] = model.y.split(functions.output(x, u, p))
        sizes = [penalty.part.size for penalty in self.penalties]
        goals = ca.vertsplit(goal, np.cumsum([0, *sizes]).tolist())
        errors = [
            penalty.error(sources[penalty.source][penalty.part.name], wanted)
            for penalty, wanted in zip(self.penalties, goals, strict=True)
        ]
        moved = np.flatnonzero(self.moves > 0)
        errors.append(ca.DM(np.sqrt(self.moves[moved])) * change[moved.tolist(), :])
        excess = [(limit.weight or 0.0) ** 0.5 * limit.unit for limit in self.soft]
        errors.append(ca.DM(excess) * slacks if excess else ca.MX(0, 1))
        value = ca.vertcat(*errors)
        slope = ca.jacobian(value, z) @ self._from_error(z)
        return ca.Function(f"{self.name}_stage_error", [z, p, goal], [value, ca.densify(slope)])

    def _terminal(self, terminal: Terminal) -> ca.Function:
        """(z_end) -> weighted error of the end, its Jacobian by dz_end, dense."""
        z = ca.MX.sym("z", self.size)
        x, u, *_ = self.split(z)
        away = ca.vertcat(difference(self.model, ca.MX(ca.DM(terminal.x)), x), u - terminal.u)
        value = ca.DM(terminal.factor) @ away
        slope = ca.jacobian(value, z) @ self._from_error(z)
        return ca.Function(f"{self.name}_stage_terminal", [z], [value, ca.densify(slope)])

    def _limits(self, functions: ModelFunctions | NativeFunctions) -> ca.Function:
        """(z, w, z_end, p) -> what is bounded, its transposed Jacobian by (dz, w, dz_end)."""
        model, nu = self.model, self.model.u.size
        n = self.size
        z, w, end = ca.MX.sym("z", n), ca.MX.sym("w", self.nw), ca.MX.sym("end", n)
        p = ca.MX.sym("p", model.p.size)
        x, u, change, _, residual = self.split(end)
        sources: dict[str, ca.MX] = {"x": x}
        if any(limit.source == "y" for limit in self.limits):
            sources["y"] = functions.output(x, u, p)
        if any(limit.source == "angles" for limit in self.limits) and functions.angles:
            sources["angles"] = ca.MX(functions.angles(x))
        if any(limit.source == "rate" for limit in self.limits):
            applied = ca.diag(ca.DM(self.scale)) @ w[:nu]
            sources["rate"] = functions.xdot(self.split(z)[0], applied, p)
        values, slack = [ca.MX(0, 1)], nu
        for limit in self.limits:
            value = sources[limit.source][limit.rows.tolist(), :] / limit.unit
            if limit.weight is None:
                values.append(value)
                continue
            below, above = (
                np.flatnonzero(np.isfinite(side)).tolist() for side in (limit.lower, limit.upper)
            )
            values += [value[above, :] - w[slack], value[below, :] + w[slack]]
            slack += 1
        rates = self._rate_rows
        values.append(change[rates.tolist(), :] / ca.DM(self.scale[rates]))
        values.append(residual / RESIDUAL)
        value = ca.vertcat(*values)
        slopes = ca.horzcat(
            ca.jacobian(value, z) @ self._from_error(z),
            ca.jacobian(value, w),
            ca.jacobian(value, end) @ self._from_error(end),
        )
        return ca.Function(f"{self.name}_stage_limits", [z, w, end, p], [value, slopes.T])

    def _from_error(self, z: ca.MX) -> Any:
        """d z / d dz."""
        sizes = self._sizes[1:]
        return ca.diagcat(_from_error(self.model.x, self.split(z)[0]), ca.DM.eye(sum(sizes)))


def _blocks(blocks: dict[tuple[int, int], Any], rows: list[int], columns: list[int]) -> ca.MX:
    """A matrix of blocks by place, empty elsewhere."""
    lines = [
        ca.horzcat(*(ca.MX(blocks.get((i, j), ca.DM(r, c))) for j, c in enumerate(columns)))
        for i, r in enumerate(rows)
    ]
    return ca.vertcat(*lines)


def _from_error(layout: Layout, x: ca.MX) -> Any:
    """d x / d dx: q ∘ (1, dx/2) of a quaternion, 1 of everything else."""
    values = layout.split(x)
    return ca.diagcat(
        *(
            _half_turn(values[part.name]) if part.attitude else ca.DM.eye(part.size)
            for part in layout.parts
        )
    )


def _half_turn(q: ca.MX) -> ca.MX:
    """½ q ∘ (0, ·), (4, 3)."""
    columns = [quaternion.product(q, ca.MX(ca.DM.eye(4)[:, i])) for i in (1, 2, 3)]
    return ca.horzcat(*columns) / 2
