"""A window of samples of a control model, in stages whose inputs have unit variance beforehand.

A stage ends at a sample. With f the model's step and S dt the variance of what drives it, half
before the step and half behind (`model_process`), the input w of a stage is (a, b), and v, which is
what else a sample depends on, the accelerations that the model does not know:

    z_0 = z̄ ⊕ M⁻¹ w_0,   z_k = f(z_{k−1} ⊕ G a_k) ⊕ G b_k,   q_ddot_k = q_ddot(z_k) + σ v_k,
    M⁻¹ M⁻ᵀ = P̄,  G Gᵀ = dt/2 S

so that the objective is ½ Σ |w_k|² + |v_k|² + 2 ρ(residual/noise). One formula serves the first
stage, too: it takes no time, and its noise is that of the arrival. The loss ρ is a square, or less
for large residuals, Huber's, smooth: with c = √(1 + r²/κ²)

    ρ(r) = κ² (c − 1) = ½ r̃²,   r̃ = r √(2/(1 + c)),   dr̃/dr = √((1 + c)/2)/c
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from curvcasadi.control.error_state import add
from curvcasadi.estimation.model_process import Dynamics, flow_function
from curvcasadi.estimation.model_readings import ModelObservation, ModelReadings
from curvcasadi.estimation.process import DEGREE
from curvcasadi.estimation.samples import or_zero
from curvcasadi.kinematics.root_motion import ROOT_INPUTS
from curvcasadi.lie import so3
from curvcasadi.sensors import Channels
from curvcasadi.solvers.stages import Stages
from curvcasadi.symbolic.compiled import compile_function
from curvcasadi.symbolic.expressions import AnyExpr, Array
from curvcasadi.symbolic.layout import Layout, Part


@dataclass(frozen=True, eq=False, kw_only=True)
class ModelWindow:
    """Checked description of a moving-horizon estimator on a control model."""

    name: str
    observation: ModelObservation
    nodes: int  #: of a window, N + 1
    dt: float  #: between nodes, s
    lower: Array  #: bounds (x,) of the state
    upper: Array
    scale: float  #: κ, of residuals over their noise; infinite for squares

    @property
    def dynamics(self) -> Dynamics:
        """The model as a process."""
        return self.observation.dynamics

    @property
    def channels(self) -> Channels:
        """Rows of a sample."""
        return self.observation.channels

    @property
    def size(self) -> int:
        """Of the state."""
        return self.dynamics.whole.size

    @property
    def errors(self) -> int:
        """Of the error state."""
        return self.dynamics.error.size

    @property
    def deviations(self) -> Array:
        """Of the unknown accelerations, stacked."""
        return np.concatenate([np.zeros(0), *self.observation.unknown.values()])

    @cached_property
    def drive(self) -> Array:
        """G (errors, m), of a half of the noise of a step."""
        columns = np.zeros((self.errors, 0))
        for name, density in self.dynamics.density.items():
            block = np.zeros((self.errors, density.size))
            block[self.dynamics.error.slices[name]] = np.diag(density * (self.dt / 2) ** 0.5)
            columns = np.hstack([columns, block[:, density > 0]])
        return columns

    @property
    def input(self) -> Layout:
        """Unknowns of a stage: w and v."""
        noise = max(self.errors, 2 * self.drive.shape[1])
        return Layout((Part("noise", noise, "1"), Part("acceleration", len(self.deviations), "1")))

    @property
    def data_shapes(self) -> dict[str, tuple[int, int]]:
        """Of what comes with a sample beside u and p."""
        rows = {"samples": self.channels.layout.size, "seen": self.channels.residual_layout.size}
        known = {key: ROOT_INPUTS[key] for key in self.observation.inputs}
        return {**{key: (size, 1) for key, size in rows.items()}, **known}

    @property
    def given_shapes(self) -> dict[str, int]:
        """Entries of u and p at a sample, where the model has any."""
        return {key: symbol.numel() for key, symbol in self.dynamics.inputs.items()}

    def stages(self, compiled: bool) -> Stages:
        """The window as stages; of native code, which cannot be exported, where `compiled`."""
        functions = [self._error(), self._step(), self._limits()]
        if compiled:
            functions = [compile_function(f, derivatives=0) for f in functions]
        error, step, limits = functions
        return Stages(
            count=self.nodes,
            error=error,
            step=step,
            limits=limits,
            move_weight=0.0,
            input_weight=1.0,
            varying=True,
        )

    def parameters(self, root: AnyExpr, given: list[ca.MX]) -> ca.MX:
        """Parameters of all stages: M⁻¹ of the first, then u and p of each."""
        entries = self.errors * (self.errors + 1) // 2
        first = ca.sparsity_cast(root, ca.Sparsity.dense(entries))
        columns = [ca.horzsplit(values) for values in given]
        found = []
        for k in range(self.nodes):
            found += [first if k == 0 else ca.DM.zeros(entries), *(at[k] for at in columns)]
        return ca.vertcat(*found)

    @property
    def _state(self) -> list[int]:
        """Entries of the state of a stage: z, accelerations, and 1 before the first."""
        return [self.size, len(self.deviations), 1]

    def _symbols(self) -> tuple[ca.MX, ca.MX, list[ca.MX]]:
        """State of a stage, its parameters, and the parts of these."""
        state = ca.MX.sym("state", sum(self._state))
        sizes = [self.errors * (self.errors + 1) // 2, *self.given_shapes.values()]
        p = ca.MX.sym("p", sum(sizes))
        return state, p, ca.vertsplit(p, np.cumsum([0, *sizes]).tolist())

    def _step(self) -> ca.Function:
        """(state, input, p) -> state_end, Aᵀ, Bᵀ in error states."""
        dynamics, layout, nd = self.dynamics, self.dynamics.whole, self.errors
        state, p, (entries, *given) = self._symbols()
        z, _, first = ca.vertsplit(state, np.cumsum([0, *self._state]).tolist())
        u = ca.MX.sym("input", self.input.size)
        noise, v = self.input.split(u).values()
        width, m = noise.numel(), self.drive.shape[1]
        root = ca.sparsity_cast(entries, ca.Sparsity.upper(nd))
        G, rest = ca.sparsify(ca.DM(self.drive)), width - 2 * m
        before = (1 - first) * ca.horzcat(G, ca.DM(nd, m + rest))
        behind = (1 - first) * ca.horzcat(ca.DM(nd, m), G, ca.DM(nd, rest))
        behind += first * ca.horzcat(root, ca.DM(nd, width - nd))

        a, b = before @ noise, behind @ noise
        start, start_by_z, start_by_a = _moved(layout, z, a)
        middle, F = flow_function(dynamics)(start, (1 - first) * self.dt, *given)
        end, end_by_middle, end_by_b = _moved(layout, middle, b)
        by_state = end_by_middle @ F @ start_by_z
        by_noise = end_by_middle @ F @ start_by_a @ before + end_by_b @ behind
        sigma, others = ca.diag(ca.DM(self.deviations)), len(self.deviations)
        slopes = (
            ca.diagcat(by_state, ca.DM(others + 1, others + 1)),
            ca.vertcat(ca.diagcat(by_noise, sigma), ca.DM(1, u.numel())),
        )
        return ca.Function(
            f"{self.name}_stage_step",
            [state, u, p],
            [ca.vertcat(end, sigma @ v, 0), *(slope.T for slope in slopes)],
            {"cse": True},
        )

    @cached_property
    def residual(self) -> ca.Function:
        """(z, v, u, p, samples, seen, root inputs) -> residuals over their noise, and their slope
        by error state and accelerations; zero where there is no sample."""
        z, v = ca.MX.sym("z", self.size), ca.MX.sym("v", len(self.deviations))
        given = dict(self.dynamics.inputs)
        data = {key: ca.MX.sym(key, *shape) for key, shape in self.data_shapes.items()}
        samples, seen, *_ = data.values()
        known = {**given, **{key: data[key] for key in self.observation.inputs}}
        readings = ModelReadings(self.observation, z, samples, known, self._accelerations(v))
        stacked = ca.horzcat(*(row for group in readings.rows() for row in group.rows)).T
        weight = seen / ca.DM(self.channels.noise)
        others = v.numel()
        residual = weight * stacked[:, -1]
        if any(sensor.may_be_hidden for sensor in self.channels.sensors):
            residual = or_zero(residual.numel())(residual)
        slope = ca.diag(weight) @ ca.horzcat(stacked[:, others:-1], stacked[:, :others])
        return ca.Function(
            f"{self.name}_residual",
            [z, v, *given.values(), *data.values()],
            [residual, ca.densify(slope)],
            {"cse": True},
        )

    def _accelerations(self, v: ca.MX) -> Mapping[str, ca.MX]:
        sizes = [len(x) for x in self.observation.unknown.values()]
        pieces = ca.vertsplit(v, np.cumsum([0, *sizes]).tolist()) if sizes else []
        return dict(zip(self.observation.unknown, pieces, strict=True))

    def _error(self) -> ca.Function:
        """(state_end, p, sample …) -> residual, and its slope by the error of state_end."""
        state, p, (_, *given) = self._symbols()
        z, v, _ = ca.vertsplit(state, np.cumsum([0, *self._state]).tolist())
        data = [ca.MX.sym(key, *shape) for key, shape in self.data_shapes.items()]
        value, slope = self.residual(z, v, *given, *data)
        if self.scale < np.inf:
            c = ca.sqrt(1 + (value / self.scale) ** 2)
            slope = ca.diag(ca.sqrt((1 + c) / 2) / c) @ slope
            value = value * ca.sqrt(2 / (1 + c))
        slope = ca.horzcat(ca.densify(slope), ca.MX.zeros(value.numel()))
        return ca.Function(f"{self.name}_stage_error", [state, p, *data], [value, slope])

    def weighted(self, value: ca.MX, slope: ca.MX) -> tuple[ca.MX, ca.MX]:
        """The same as least squares with the gradient of the loss: times √ρ'(r)/r."""
        if self.scale == np.inf:
            return value, slope
        root = (1 + (value / self.scale) ** 2) ** -0.25
        return root * value, ca.diag(root) @ slope

    def _limits(self) -> ca.Function:
        """(start, input, end, p) -> bounded entries of the state at the end, their slopes."""
        end, p, _ = self._symbols()
        start, u = ca.MX.sym("start", end.numel()), ca.MX.sym("input", self.input.size)
        nd, n = self.errors, self.errors + len(self.deviations) + 1
        rows, columns = self.bounded
        by_end = ca.sparsify(ca.DM.eye(nd)[columns, :])
        slopes = ca.horzcat(ca.DM(len(rows), n + u.numel()), by_end, ca.DM(len(rows), n - nd))
        values = end[rows, :] if rows else ca.MX(0, 1)
        return ca.Function(
            f"{self.name}_stage_limits", [start, u, end, p], [values, ca.MX(slopes.T)]
        )

    @property
    def bounded(self) -> tuple[list[int], list[int]]:
        """Entries of the state that have bounds, and of its error."""
        layout, bounded = self.dynamics.whole, np.isfinite(self.lower) | np.isfinite(self.upper)
        rows, columns = [], []
        for name, where in layout.slices.items():
            first = layout.errors.slices[name].start - where.start
            found = [i for i in range(where.start, where.stop) if bounded[i]]
            rows += found
            columns += [first + i for i in found]
        return rows, columns


def _moved(layout: Layout, z: ca.MX, step: ca.MX) -> tuple[ca.MX, AnyExpr, AnyExpr]:
    """z ⊕ step, and the derivatives of its error by that of z and by the step.

    On the group q ∘ exp(δ) ∘ exp(s) = q ∘ exp(s) ∘ exp(exp(s)ᵀ δ), and exp(s + σ) =
    exp(s) ∘ exp(J_r(s) σ) to first order.
    """
    steps = layout.errors.split(step)
    by_z: list[AnyExpr] = []
    by_step: list[AnyExpr] = []
    for part in layout.parts:
        turn = steps[part.name]
        one = ca.DM.eye(turn.numel())
        by_z.append(so3.exp(turn, DEGREE).T if part.attitude else one)
        by_step.append(so3.right_jacobian(turn, DEGREE) if part.attitude else one)
    return add(layout, z, step), ca.diagcat(*by_z), ca.diagcat(*by_step)
