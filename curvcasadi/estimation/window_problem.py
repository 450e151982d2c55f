"""The least-squares problem of a window of samples, and what it leaves to the next window."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import casadi as ca
import numpy as np

from curvcasadi.beam import Beam
from curvcasadi.estimation import ud
from curvcasadi.estimation.process import Process, predict_function
from curvcasadi.estimation.sample_residual import KNOWN_SHAPES, sample_residual
from curvcasadi.estimation.samples import samples_function
from curvcasadi.expressions import Array
from curvcasadi.layout import Layout
from curvcasadi.ocp.sqp import TOLERANCES, Bounds, GaussNewton, gauss_newton_sqp
from curvcasadi.sensors import Channels, RootMotion, Sensor, sensor_channels


@dataclass(frozen=True, eq=False, kw_only=True)
class WindowProblem:
    """Checked description of a moving-horizon estimator.

    A node is the state at a sample, then what else the sample depends on and the state does not
    hold: the unknowns.
    """

    name: str
    beam: Beam
    sensors: tuple[Sensor, ...]
    root: RootMotion | None
    known: tuple[str, ...]  #: inputs of `KNOWN_SHAPES` that come with a sample
    process: Process
    node: Layout
    unknown: Mapping[str, Array]  #: standard deviations (n,)
    moves: Array  #: bounds (n,) of |q_{k+1} − q_k|, rad/m; infinite where there is none
    nodes: int
    dt: float

    @property
    def size(self) -> int:
        """Of the state."""
        return self.process.state.size

    @property
    def channels(self) -> Channels:
        return sensor_channels(self.sensors)

    @cached_property
    def residual(self) -> ca.Function:
        """Of one sample."""
        name = f"{self.name}_residual"
        return sample_residual(name, self.beam, self.sensors, self.node, self.known, self.root)

    @property
    def transition(self) -> Array:
        """F (x, x): the state a step later, undriven."""
        one = [[1.0]] if self.process.kind == "random_walk" else [[1.0, self.dt], [0.0, 1.0]]
        return np.kron(one, np.eye(self.process.n))

    @property
    def noise_root(self) -> Array:
        """R (x, x) with RᵀR = Q⁻¹.

        Random walk: Q = S dt. White acceleration: Q = S T, T = [[dt³/3, dt²/2], [dt²/2, dt]],
        T⁻¹ = [[12/dt³, −6/dt²], [−6/dt², 4/dt]].
        """
        one = [[self.dt**-0.5]]
        if self.process.kind == "white_acceleration":
            a = 12**0.5 * self.dt**-1.5
            one = [[a, -a * self.dt / 2], [0.0, self.dt**-0.5]]
        root: Array = np.kron(one, np.diag(1 / self.process.density))
        return root

    def linear_rows(self) -> ca.DM:
        """Rows, sparse: R (x_{k+1} − F x_k) of every step, and unknown/deviation of every node."""
        size, other = self.size, self.node.size - self.size
        before, after = -self.noise_root @ self.transition, self.noise_root
        rows = ca.DM(size * (self.nodes - 1), self.node.size * self.nodes)
        for k in range(self.nodes - 1):
            place, column = slice(size * k, size * (k + 1)), self.node.size * k
            rows[place, column : column + size] = before
            column += self.node.size
            rows[place, column : column + size] = after
        deviations = np.concatenate([np.zeros(0), *self.unknown.values()])
        prior = ca.horzcat(ca.DM(other, size), ca.diag(ca.DM(1 / deviations)))
        return ca.sparsify(ca.vertcat(rows, ca.diagcat(*[prior] * self.nodes)))

    def data(self) -> dict[str, ca.MX]:
        """Symbols of what comes with the samples, one sample a column."""
        rows = {"samples": self.channels.layout.size, "seen": self.channels.residual_layout.size}
        shapes = {**{key: (size, 1) for key, size in rows.items()}, **self.known_shapes}
        return {key: ca.MX.sym(key, r, c * self.nodes) for key, (r, c) in shapes.items()}

    @property
    def known_shapes(self) -> dict[str, tuple[int, int]]:
        return {key: KNOWN_SHAPES[key] for key in self.known}

    def by_node(self, data: Mapping[str, ca.MX]) -> list[tuple[ca.MX, ...]]:
        """Arguments of `residual` after the node, for every node."""
        columns = (ca.horzsplit(m, m.shape[1] // self.nodes) for m in data.values())
        return list(zip(*columns, strict=True))

    def typical(self) -> ca.DM:
        """Parameters of `window_solver` with all samples there and nothing known before."""
        absent = ca.DM.nan(self.channels.layout.size)
        samples, seen = samples_function(self.sensors)(absent)
        motion = [
            ca.DM.eye(3) if k == "attitude" else ca.DM(*s) for k, s in self.known_shapes.items()
        ]
        parts = [ca.repmat(ca.densify(m), 1, self.nodes) for m in (samples, seen + 1, *motion)]
        before = ca.DM.zeros(self.size + self.size * (self.size + 1) // 2)
        return ca.veccat(before, *parts)


def window_solver(problem: WindowProblem, iterations: int | None, qp_solver: str) -> GaussNewton:
    """Solver over the nodes, stacked.

    Parameters: x̄, the entries of the upper triangular M with MᵀM = P̄⁻¹, and `problem.data()`.
    """
    size, width = problem.size, problem.node.size
    window = ca.MX.sym("window", width * problem.nodes)
    mean, entries = ca.MX.sym("mean", size), ca.MX.sym("root", size * (size + 1) // 2)
    root = ca.MX(ca.Sparsity.upper(size), entries)
    data = problem.data()
    nodes, arguments = ca.vertsplit(window, width), problem.by_node(data)
    rows = problem.linear_rows()
    residuals = [problem.residual(s, *given) for s, given in zip(nodes, arguments, strict=True)]
    arrival = root @ (nodes[0][:size] - mean)
    objective = ca.sumsqr(ca.vertcat(arrival, rows @ window, *residuals)) / 2

    gram = _gram(problem)
    blocks = [gram(s, *given) for s, given in zip(nodes, arguments, strict=True)]
    blocks[0] += ca.diagcat(root.T @ root, ca.MX(width - size, width - size))
    hessian = ca.diagcat(*blocks) + rows.T @ rows

    finite = [int(i) for i in np.flatnonzero(np.isfinite(problem.moves))]
    moves = [b[finite] - a[finite] for a, b in pairwise(nodes)]
    lower, upper = (np.tile(side, problem.nodes) for side in problem.node.bounds)
    most = np.tile(problem.moves[finite], problem.nodes - 1)
    return gauss_newton_sqp(
        f"{problem.name}_solver",
        window,
        ca.veccat(mean, entries, *data.values()),
        objective,
        hessian,
        ca.vertcat(ca.MX(0, 1), *(moves if finite else [])),
        Bounds(lower, upper, -most, most),
        nominal=(0, problem.typical()),
        real=problem.beam.grid.real,
        iterations=iterations,
        qp_solver=qp_solver,
    )


def _gram(problem: WindowProblem) -> ca.Function:
    """JᵀJ of the residual of one sample."""
    f = problem.residual
    symbols = [ca.MX.sym(key, *f.size_in(key)) for key in f.name_in()]
    jacobian = ca.jacobian(f(*symbols), symbols[0])
    return ca.Function(f"{problem.name}_gram", symbols, [jacobian.T @ jacobian])


def arrival_function(problem: WindowProblem) -> ca.Function:
    """(x̄, factor of P̄, node_0, its sample) -> the same of the next window, filtered.

    The sample, linearized at the node, corrects x̄ and P̄ row by row; then a step of the process.
    The unknowns stand before the state, where leaving them out marginalizes.
    """
    f, size, other = problem.residual, problem.size, problem.node.size - problem.size
    mean, factor = ca.MX.sym("mean", size), ca.MX.sym("factor", ca.Sparsity.upper(size))
    symbols = [ca.MX.sym(key, *f.size_in(key)) for key in f.name_in()]
    node = symbols[0]
    state, unknown = node[:size], node[size:]
    residual = f(*symbols)
    slope = ca.jacobian(residual, node)
    rows = ca.densify(ca.horzcat(slope[:, size:], slope[:, :size]).T)

    variances = np.concatenate([np.zeros(0), *problem.unknown.values()]) ** 2
    both = ca.diagcat(ca.MX(ca.diag(ca.DM(variances))), factor)
    after = ca.project(both, ca.Sparsity.upper(both.shape[0]))
    error = ca.vertcat(-unknown, mean - state)
    measure = ud.measure(problem.node.size, np.inf)
    for k in range(residual.shape[0]):
        error, after, *_ = measure(error, after, rows[:, k], residual[k], 1, 1)
    predict = predict_function(f"{problem.name}_predict", problem.process)
    outputs = predict(state + error[other:], after[other:, other:], problem.dt)
    return ca.Function(
        f"{problem.name}_arrival", [mean, factor, *symbols], [*outputs], {"cse": True}
    )


def information_root(size: int) -> ca.Function:
    """factor of P = U D Uᵀ -> M = D^{-1/2} U⁻¹, upper triangular, with MᵀM = P⁻¹."""
    factor = ca.SX.sym("factor", ca.Sparsity.upper(size))
    root = ca.SX(factor.sparsity())
    for i in range(size):
        root[i, i] = 1 / ca.sqrt(factor[i, i])
        for j in range(i + 1, size):
            root[i, j] = -sum(root[i, k] * factor[k, j] for k in range(i, j))
    return ca.Function("information_root", [factor], [root], {"cse": True})


def step_function(problem: WindowProblem, iterations: int | None, qp_solver: str) -> ca.Function:
    """What `ShapeMhe.step` is."""
    size, nodes = problem.size, problem.nodes
    inputs = {
        "arrival_mean": ca.MX.sym("arrival_mean", size),
        "arrival_factor": ca.MX.sym("arrival_factor", ca.Sparsity.upper(size)),
        "measured": ca.MX.sym("measured", problem.channels.layout.size, nodes),
        "guess": ca.MX.sym("guess", problem.node.size, nodes),
    }
    known = {key: ca.MX.sym(key, r, c * nodes) for key, (r, c) in problem.known_shapes.items()}
    mean, factor, measured, guess = inputs.values()
    clean = samples_function(problem.sensors)
    pairs = [clean(sample) for sample in ca.horzsplit(measured)]
    samples, seen = (ca.horzcat(*columns) for columns in zip(*pairs, strict=True))
    data = {"samples": samples, "seen": seen, **known}

    solver = window_solver(problem, iterations, qp_solver)
    root = information_root(size)(factor)
    parameters = ca.veccat(mean, root.nz[:], *data.values())
    found, violation, stationarity = solver(ca.vec(guess), parameters)
    window = ca.reshape(found, problem.node.size, nodes)
    states, last = window[:size, :], window[:, -1]
    after = arrival_function(problem)(mean, factor, window[:, 0], *problem.by_node(data)[0])
    ahead = ca.vertcat(ca.DM(ca.sparsify(ca.DM(problem.transition))) @ last[:size], last[size:])
    outputs = {
        "state": last[:size],
        "states": states,
        "arrival_mean_after": after[0],
        "arrival_factor_after": after[1],
        "guess_after": ca.horzcat(window[:, 1:], ahead),
        "violation": violation / TOLERANCES[problem.beam.grid.real].limit,
        "stationarity": stationarity,
    }
    arguments = {**inputs, **known}
    return ca.Function(
        problem.name, [*arguments.values()], [*outputs.values()], [*arguments], [*outputs]
    )
