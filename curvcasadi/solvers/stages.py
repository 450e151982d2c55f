"""Least squares over the stages of a model in time, condensed to its inputs.

With x_{k+1} = F(x_k, u_k, p) from a given x_0, the unknowns are the inputs u = (u_0, …, u_{N−1}):

    ½ Σ |r(x_{k+1}, p, goals_k)|² + ½ moves Σ |u_k − u_{k−1}|² + ½ inputs Σ |u_k|²

    limits of c(x_k, u_k, x_{k+1}, p)

Linearized along the rollout of u, dx_{k+1} = A_k dx_k + B_k du_k = G_{k+1} du, so that the
quadratic program has inputs alone. dx is the error state, which is shorter than the state where
that holds attitudes. Inputs may be held over several stages, and p may differ from stage to stage.
Rows of G and of the limits keep the pattern that the sparsities of the stage's derivatives leave
them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import casadi as ca

Rows = list[list[int]]


@dataclass(frozen=True, eq=False, kw_only=True)
class Stages:
    """A model's stages, each of three Functions that are evaluated in a loop.

    Attributes
    ----------
    count : int
        Number N of stages.
    error : casadi.Function
        (x_end, p, goal, …) -> residual (nr, 1), its Jacobian by dx_end (nr, nd), dense.
    step : casadi.Function
        (x, u, p) -> x_end (nx, 1), Aᵀ (nd, nd), Bᵀ (nu, nd), sparse.
    limits : casadi.Function
        (x, u, x_end, p) -> values (nc, 1), their transposed Jacobian by (dx, u, dx_end), sparse.
    move_weight : float
        Weight of |u_k − u_{k−1}|².
    input_weight : float
        Weight of |u_k|².
    damping : float
        Weight of |u − guess|², for the Hessian of every program.
    relative : bool
        Whether the damping of an objective with a Hessian below 1 shrinks with its largest diagonal
        entry, so that no factor of all weights changes the plan.
    hold : tuple of int
        For each stage the index of its input among the unknown ones, ascending from zero by at most
        one; empty where each stage has its own.
    varying : bool
        Whether the parameters hold one p for each stage, or the same for all.
    terminal : casadi.Function or None
        (x_end) -> residual (nt, 1), its Jacobian by dx_end (nt, nd), dense; of the last stage, in
        addition to its `error`.
    """

    count: int
    error: ca.Function
    step: ca.Function
    limits: ca.Function
    move_weight: float
    input_weight: float = 0.0
    damping: float = 0.0
    relative: bool = False
    hold: tuple[int, ...] = ()
    varying: bool = False
    terminal: ca.Function | None = None

    @property
    def nx(self) -> int:
        """Entries of the state."""
        return int(self.step.size1_in(0))

    @property
    def nu(self) -> int:
        """Entries of the input."""
        return int(self.step.size1_in(1))

    @property
    def nd(self) -> int:
        """Entries of the error state."""
        return int(self.step.size1_out(1))

    @property
    def held(self) -> tuple[int, ...]:
        """Index of the input of each stage."""
        return self.hold or tuple(range(self.count))

    @property
    def inputs(self) -> int:
        """Number of inputs that differ."""
        return self.held[-1] + 1

    @property
    def parameter_sizes(self) -> list[int]:
        """Entries of x_0, p, u_previous and of the goals of all stages."""
        goals = (self.error.nnz_in(i) for i in range(2, self.error.n_in()))
        parameters = self.step.nnz_in(2) * (self.count if self.varying else 1)
        return [self.nx, parameters, self.nu, *(self.count * size for size in goals)]

    @cached_property
    def sensitivities(self) -> list[Rows]:
        """Columns of du on which each row of G_0 … G_N depends, ascending."""
        a, b = (_rows(self.step.sparsity_out(i)) for i in (1, 2))
        found: list[Rows] = [[[] for _ in range(self.nd)]]
        for first in (k * self.nu for k in self.held):
            before = found[-1]
            found.append(
                [
                    sorted({c for i in a[row] for c in before[i]} | {first + j for j in b[row]})
                    for row in range(self.nd)
                ]
            )
        return found

    @cached_property
    def limit_rows(self) -> Rows:
        """Columns of du on which each limit depends, stage after stage, ascending."""
        found: Rows = []
        for k in range(self.count):
            start, end = self.sensitivities[k : k + 2]
            first = self.held[k] * self.nu
            by = [*start, *([first + j] for j in range(self.nu)), *end]
            for row in _rows(self.limits.sparsity_out(1)):
                found.append(sorted({column for entry in row for column in by[entry]}))
        return found

    def split(self, parameters: ca.MX) -> list[ca.MX]:
        """x_0, p, u_previous, goals … of stacked parameters."""
        sizes = self.parameter_sizes
        ends = [sum(sizes[:i]) for i in range(len(sizes) + 1)]
        return [parameters[a:b] for a, b in pairwise(ends)]

    def parameter(self, parts: Sequence[ca.MX], k: int) -> ca.MX:
        """p of stage k."""
        size = self.step.nnz_in(2)
        return parts[1][k * size : (k + 1) * size] if self.varying else parts[1]

    def goals(self, parts: Sequence[ca.MX], k: int) -> list[ca.MX]:
        """Arguments of `error` after p at the end of stage k."""
        found = []
        for i, part in enumerate(parts[3:], start=2):
            size, shape = self.error.nnz_in(i), self.error.size_in(i)
            found.append(ca.reshape(part[k * size : (k + 1) * size], *shape))
        return found

    def evaluate(self, name: str) -> ca.Function:
        """(u, parameters) -> objective, gradient, hessian, values, slopes: see `Linearization`."""
        n, nu = self.inputs * self.nu, self.nu
        inputs, parameters = ca.MX.sym("u", n), ca.MX.sym("p", sum(self.parameter_sizes))
        parts = self.split(parameters)
        x, last = parts[0], parts[2]
        G, before = ca.MX(self.nd, n), ca.DM(nu, n)
        f, g = self.input_weight * ca.sumsqr(inputs) / 2, self.input_weight * inputs
        H = ca.MX(self.input_weight * ca.DM.eye(n))
        values, slopes = [ca.MX(0, 1)], [ca.MX(n, 0)]
        for k, first in enumerate(i * nu for i in self.held):
            u, p = inputs[first : first + nu], self.parameter(parts, k)
            end, at, bt = self.step(x, u, p)
            choose = ca.DM.eye(n)[first : first + nu, :]
            G_end = at.T @ G + bt.T @ choose
            value, ct = self.limits(x, u, end, p)
            values.append(value)
            slopes.append(ca.vertcat(G, choose, G_end).T @ ct)
            errors = [self.error(end, p, *self.goals(parts, k))]
            errors += [self.terminal(end)] if self.terminal and k == self.count - 1 else []
            for residual, J in errors:
                M = J @ G_end
                f += ca.sumsqr(residual) / 2
                g += M.T @ residual
                H += M.T @ M
            if self.move_weight:
                move, both = u - last, (choose - before).T
                f += self.move_weight * ca.sumsqr(move) / 2
                g += self.move_weight * (both @ move)
                H += self.move_weight * (both @ both.T)
            x, G, last, before = end, G_end, u, choose
        if self.damping:
            H += self._damping(H) * ca.DM.eye(n)
        pattern = _pattern(self.limit_rows, n)
        return linearization(
            name,
            inputs,
            parameters,
            f,
            g,
            H,
            ca.vertcat(*values),
            ca.project(ca.horzcat(*slopes), pattern),
        )

    def _damping(self, H: ca.MX) -> ca.MX | float:
        """What is added to the diagonal of a Hessian."""
        if not self.relative:
            return self.damping
        largest = ca.mmax(ca.diag(H))
        return self.damping * (ca.fmin(largest, 1) + (largest == 0))

    def rollout(self, name: str) -> ca.Function:
        """(u, parameters) -> values (m, 1) of the limits, states (nx, N + 1)."""
        inputs = ca.MX.sym("u", self.inputs * self.nu)
        parameters = ca.MX.sym("p", sum(self.parameter_sizes))
        parts = self.split(parameters)
        states, values = [parts[0]], [ca.MX(0, 1)]
        for k, first in enumerate(i * self.nu for i in self.held):
            u, p = inputs[first : first + self.nu], self.parameter(parts, k)
            end = self.step(states[-1], u, p)[0]
            values.append(self.limits(states[-1], u, end, p)[0])
            states.append(end)
        return ca.Function(name, [inputs, parameters], [ca.vertcat(*values), ca.horzcat(*states)])


def linearization(
    name: str,
    unknowns: ca.MX,
    parameters: ca.MX,
    objective: ca.MX,
    gradient: ca.MX,
    hessian: ca.MX,
    values: ca.MX,
    slopes: ca.MX,
) -> ca.Function:
    """A problem at a point, in the order in which the solver in C stores it.

    Parameters
    ----------
    hessian : MX, shape (n, n)
        Of the objective; its lower triangle is given out by rows.
    values : MX, shape (m, 1)
        Of the constraints.
    slopes : MX, shape (n, m)
        Their transposed Jacobian, by columns: the rows that the solver stores.

    Returns
    -------
    casadi.Function
        (x, p) -> objective, gradient, hessian (upper triangle), values, slopes.
    """
    triangle = ca.project(hessian, ca.Sparsity.upper(unknowns.shape[0]))
    return ca.Function(
        name,
        [unknowns, parameters],
        [objective, ca.densify(gradient), triangle, ca.densify(values), slopes],
        ["x", "p"],
        ["objective", "gradient", "hessian", "values", "slopes"],
    )


def _rows(transposed: ca.Sparsity) -> Rows:
    """Columns of the entries of each row of a matrix, from the sparsity of its transpose."""
    begin, entries = transposed.colind(), transposed.row()
    return [entries[a:b] for a, b in pairwise(begin)]


def _pattern(rows: Rows, n: int) -> ca.Sparsity:
    """Sparsity (n, m) of the transpose of a matrix of such rows."""
    ends = [sum(len(row) for row in rows[:i]) for i in range(len(rows) + 1)]
    return ca.Sparsity(n, len(rows), ends, [c for row in rows for c in row])
