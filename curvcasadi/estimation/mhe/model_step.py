"""One step of moving-horizon estimation on a control model."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from curvcasadi.estimation import ud
from curvcasadi.estimation.mhe.model_window import ModelWindow
from curvcasadi.estimation.mhe.solver import TOLERANCE
from curvcasadi.estimation.mhe.step import deviation_root, triangular_solve
from curvcasadi.estimation.model_process import model_predict_function
from curvcasadi.estimation.samples import samples_function
from curvcasadi.solvers.certificate import TOLERANCES, Bounds
from curvcasadi.solvers.embedded import EmbeddedSolver, SolverFunction, solver_function
from curvcasadi.solvers.gauss_newton import GaussNewton
from curvcasadi.solvers.settings import SqpSettings
from curvcasadi.symbolic.expressions import AnyExpr


def model_step_function(
    window: ModelWindow, settings: SqpSettings, compiled: bool
) -> SolverFunction:
    """What `ShapeMhe.step` is with a control model."""
    inputs = _inputs(window)
    solver = EmbeddedSolver(
        problem=_solver(window, settings, compiled),
        begin=_begin(window, inputs),
        finish=_finish(window, inputs),
    )
    return solver_function(window.name, solver)


def _inputs(window: ModelWindow) -> dict[str, ca.MX]:
    nodes, size = window.nodes, window.errors
    inputs = {
        "arrival_mean": ca.MX.sym("arrival_mean", window.size),
        "arrival_factor": ca.MX.sym("arrival_factor", ca.Sparsity.upper(size)),
        "measured": ca.MX.sym("measured", window.channels.layout.size, nodes),
        "guess": ca.MX.sym("guess", window.input.size, nodes),
    }
    inputs |= {key: ca.MX.sym(key, n, nodes) for key, n in window.given_shapes.items()}
    shapes = window.data_shapes
    for key in window.observation.inputs:
        rows, columns = shapes[key]
        inputs[key] = ca.MX.sym(key, rows, columns * nodes)
    return inputs


def _solver(window: ModelWindow, settings: SqpSettings, compiled: bool) -> GaussNewton:
    """Solver over the inputs of all stages."""
    real = window.dynamics.model.real
    stages = window.stages(compiled)
    rows, _ = window.bounded
    sides = (np.tile(side[rows], window.nodes) for side in (window.lower, window.upper))
    return GaussNewton(
        name=f"{window.name}_solver",
        linearization=stages.evaluate(f"{window.name}_linearization"),
        values=stages.rollout(f"{window.name}_rollout"),
        bounds=Bounds(-ca.inf, ca.inf, *sides),
        real=real,
        residual_unit=TOLERANCE[real] / TOLERANCES[real].decrement,
        flat=0.0,
        stationarity=0.0,
        stages=stages,
        relative=True,
        **vars(settings),
    )


def _samples(window: ModelWindow, measured: ca.MX) -> list[AnyExpr]:
    """Samples without NaN, and which there are, a column a sample."""
    clean = samples_function(window.channels)
    pairs = [clean(sample) for sample in ca.horzsplit(measured)]
    return [ca.horzcat(*columns) for columns in zip(*pairs, strict=True)]


def _begin(window: ModelWindow, inputs: dict[str, ca.MX]) -> ca.Function:
    """The step's inputs -> inputs of the stages to start from, parameters."""
    mean, factor, measured, guess, *rest = inputs.values()
    given, motion = rest[: len(window.given_shapes)], rest[len(window.given_shapes) :]
    root = deviation_root(window.errors)(factor)
    others = ca.MX.zeros(len(window.deviations))
    parameters = [
        ca.vertcat(mean, others, 1),
        window.parameters(root, given),
        ca.MX.zeros(window.input.size),
        *_samples(window, measured),
        *motion,
    ]
    return ca.Function(
        f"{window.name}_solver_begin",
        [*inputs.values()],
        [ca.vec(guess), ca.veccat(*parameters)],
        [*inputs],
        ["start", "parameters"],
    )


def _finish(window: ModelWindow, inputs: dict[str, ca.MX]) -> ca.Function:
    """The step's inputs and the solution -> the step's outputs."""
    nodes, size = window.nodes, window.size
    width = size + len(window.deviations)
    ends = ca.MX.sym("ends", width + 1, nodes + 1)
    found = ca.MX.sym("found", window.input.size * nodes)
    violation, stationarity, before = (ca.MX.sym(key) for key in ("v", "s", "before"))
    states, unknown = ends[:size, 1:], ends[size:width, 1]
    mean, factor, measured, _, *rest = inputs.values()
    given, motion = rest[: len(window.given_shapes)], rest[len(window.given_shapes) :]
    columns = [ca.horzsplit(values) for values in given]
    first = [ca.horzsplit(part, part.shape[1] // nodes)[0] for part in motion]
    sample = samples_function(window.channels)(measured[:, 0])
    after = _arrival(window)(
        mean, factor, states[:, 0], unknown,
        *(at[0] for at in columns), *sample, *first, *(at[1] for at in columns),
    )  # fmt: skip
    noise = ca.reshape(found, window.input.size, nodes)
    outputs = {
        "state": states[:, -1],
        "states": states,
        "arrival_mean_after": after[0],
        "arrival_factor_after": after[1],
        "guess_after": _ahead(window, noise, states[:, 1], *after),
        "noise": noise,
        "violation": violation / TOLERANCES[window.dynamics.model.real].limit,
        "stationarity": stationarity,
    }
    return ca.Function(
        f"{window.name}_solver_finish",
        [*inputs.values(), found, ends, violation, stationarity, before],
        [*outputs.values()],
        [*inputs, "found", "ends", "excess", "distance", "before"],
        [*outputs],
    )


def _ahead(window: ModelWindow, noise: ca.MX, second: ca.MX, mean: ca.MX, factor: ca.MX) -> AnyExpr:
    """Inputs of the next window that lead along the same states, and on without noise."""
    size, count = window.errors, window.input.parts[0].size
    away = window.dynamics.difference()(mean, second)
    moved = triangular_solve(size)(deviation_root(size)(factor), away)
    first = ca.vertcat(moved, ca.MX.zeros(count - size), noise[count:, 1])
    return ca.horzcat(first, noise[:, 2:], ca.MX.zeros(noise.shape[0]))


def _arrival(window: ModelWindow) -> ca.Function:
    """(z̄, factor of P̄, z_0, its accelerations, u, p, its sample, u and p of the next) -> z̄ and
    factor of the next window, filtered.

    The sample, linearized at z_0, corrects z̄ and P̄ row by row; then a step of the process. The
    accelerations stand before the error state, where leaving them out marginalizes.
    """
    f, dynamics, size = window.residual, window.dynamics, window.errors
    mean, factor = ca.MX.sym("mean", window.size), ca.MX.sym("factor", ca.Sparsity.upper(size))
    symbols = [ca.MX.sym(f"at{i}", *f.size_in(i)) for i in range(f.n_in())]
    following = [ca.MX.sym(f"next_{key}", n) for key, n in window.given_shapes.items()]
    z, unknown, others = symbols[0], symbols[1], symbols[1].numel()
    residual, slope = window.weighted(*f(*symbols))
    rows: Any = ca.densify(ca.horzcat(slope[:, size:], slope[:, :size], residual)).T

    variances = ca.MX(ca.diag(ca.DM(window.deviations**2)))
    both = ca.project(ca.diagcat(variances, factor), ca.Sparsity.upper(others + size))
    belief = ud.belief_of(both, ca.vertcat(-unknown, dynamics.difference()(z, mean)))
    columns = ca.horzsplit(rows)
    belief, _ = ud.measure_rows(belief, columns, np.ones(len(columns)), np.inf)
    after, error = ud.split_belief(belief, others + size)
    corrected = dynamics.retraction()(z, error[others:])
    predict = model_predict_function(f"{window.name}_predict", dynamics)
    outputs = predict(corrected, after[others:, others:], window.dt, *following)
    return ca.Function(
        f"{window.name}_arrival",
        [mean, factor, *symbols, *following],
        [*outputs],
        {"cse": True},
    )
