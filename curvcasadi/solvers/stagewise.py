"""Gauss–Newton on the stages themselves: programs that keep the states, by HPIPM.

A program of `Stages` has a node for each stage, with what the next stage needs of the state as s
and the unknowns as u, and one for the end of the last stage:

    min ½ Σ |M_k (s_k, u_k)|² + gᵀu

    s_{k+1} = F_k (s_k, u_k),   limits of C_k (s_k, u_k)

Inputs that are held are states of the nodes after their first. Sums over the nodes take the place
of the condensed Hessian and slopes, so that the cost of a step grows with the number of stages,
where that of a condensed one grows with its cube.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from curvcasadi.solvers.gauss_newton import PLUGINS, GaussNewton
from curvcasadi.solvers.stages import Stages


class Node(NamedTuple):
    """Slopes of a node by (s, u)."""

    F: ca.MX  #: of the state of the next node
    C: ca.MX  #: of the limits
    M: ca.MX  #: of the errors


class Size(NamedTuple):
    """Sizes of a node."""

    ns: int  #: of its state s
    nu: int  #: of its unknowns u
    n_next: int  #: of the state of the next node
    nc: int  #: of its limits
    nr: int  #: of its errors


def sizes(stages: Stages) -> list[Size]:
    """Sizes of the nodes: of each stage, then of the end."""
    carried, held = len(_carried(stages)), stages.held
    end = carried if stages.terminal else 0
    errors, limits = stages.error.nnz_out(0), stages.limits.nnz_out(0)
    goes_on = [before == after for before, after in pairwise([-1, *held])]
    states = [carried * (k > 0) + stages.nu * is_held for k, is_held in enumerate(goes_on)]
    found = [
        Size(ns, 0 if is_held else stages.nu, n_next, limits, errors)
        for ns, n_next, is_held in zip(states, [*states[1:], end], goes_on, strict=True)
    ]
    last = int(stages.terminal.nnz_out(0)) if stages.terminal else 0
    return [*found, Size(end, 0, 0, 0, last)]


def _carried(stages: Stages) -> list[int]:
    """Entries of dx on which the next stage depends."""
    used = {
        row for f, i in ((stages.step, 1), (stages.limits, 1)) for row in f.sparsity_out(i).row()
    }
    return [i for i in range(stages.nd) if i in used]


def node_linearization(stages: Stages, name: str) -> ca.Function:
    """As `Stages.evaluate`, with packed slopes of the nodes in place of the condensed matrices.

    (u, parameters) -> objective, gradient; M of all nodes, what is added to the diagonal of the
    Hessian, and its largest diagonal entry; values; F, then C of all nodes.
    """
    unknowns = ca.MX.sym("u", stages.inputs * stages.nu)
    parameters = ca.MX.sym("p", sum(stages.parameter_sizes))
    parts, chosen, held = stages.split(parameters), _carried(stages), stages.held
    x, f, values, nodes, errors = parts[0], ca.MX(0), [ca.MX(0, 1)], [], []
    for k, size in enumerate(sizes(stages)[:-1]):
        first = held[k] * stages.nu
        u, p = unknowns[first : first + stages.nu], stages.parameter(parts, k)
        end, at, bt = stages.step(x, u, p)
        value, ct = stages.limits(x, u, end, p)
        by_x, by_u, by_end = ca.horzsplit(ct.T, [0, stages.nd, stages.nd + stages.nu, ct.size1()])
        error, J = stages.error(end, p, *stages.goals(parts, k))
        AB = ca.densify(ca.horzcat(at.T[:, chosen] if k else ca.MX(stages.nd, 0), bt.T))
        C = by_end @ AB + ca.horzcat(by_x[:, chosen] if k else ca.MX(value.numel(), 0), by_u)
        keep = ca.horzcat(ca.MX(stages.nu, AB.shape[1] - stages.nu), ca.MX.eye(stages.nu))
        F = ca.vertcat(AB[chosen, :], keep)[: size.n_next, :]
        nodes.append(Node(F, C, J @ AB))
        errors.append(error)
        values.append(value)
        f += ca.sumsqr(error) / 2
        x = end
    nodes.append(Node(*(ca.MX(0, sizes(stages)[-1].ns) for _ in range(3))))
    errors.append(ca.MX(0, 1))
    if stages.terminal:
        errors[-1], J = stages.terminal(x)
        nodes[-1] = nodes[-1]._replace(M=J[:, chosen])
        f += ca.sumsqr(errors[-1]) / 2
    largest = ca.mmax(_diagonal(sizes(stages), nodes))
    added = stages.damping * ((ca.fmin(largest, 1) + (largest == 0)) if stages.relative else 1)
    pulled = [node.M.T @ error for node, error in zip(nodes, errors, strict=True)]
    return ca.Function(
        name,
        [unknowns, parameters],
        [
            f,
            _backward(sizes(stages), nodes, pulled),
            ca.vertcat(*(ca.vec(ca.densify(node.M)) for node in nodes), added, largest + added),
            ca.densify(ca.vertcat(*values)),
            ca.vertcat(*(ca.vec(ca.densify(part)) for node in nodes for part in (node.F, node.C))),
        ],
        ["x", "p"],
        ["objective", "gradient", "hessian", "values", "slopes"],
    )


def _forward(shape: list[Size], nodes: list[Node], d: ca.MX) -> list[ca.MX]:
    """(s, u) of the nodes, of the unknowns d."""
    found, state = [], ca.MX(0, 1)
    ends = np.cumsum([0, *(size.nu for size in shape)]).tolist()
    for node, u in zip(nodes, ca.vertsplit(d, ends), strict=True):
        found.append(ca.vertcat(state, u))
        state = node.F @ found[-1]
    return found


def _backward(shape: list[Size], nodes: list[Node], slopes: list[ca.MX]) -> ca.MX:
    """Slope by all unknowns, of slopes by the (s, u) of the nodes."""
    found, after = [], ca.MX(0, 1)
    for size, node, slope in zip(shape[::-1], nodes[::-1], slopes[::-1], strict=True):
        after, own = ca.vertsplit(slope + node.F.T @ after, [0, size.ns, size.ns + size.nu])
        found.append(own)
    return ca.densify(ca.vertcat(*found[::-1]))


def _diagonal(shape: list[Size], nodes: list[Node]) -> ca.MX:
    """Diagonal of the condensed Hessian."""
    found, after = [], ca.MX(0, 0)
    for size, node in zip(shape[::-1], nodes[::-1], strict=True):
        Z = node.M.T @ node.M + node.F.T @ after @ node.F
        found.append(ca.diag(Z)[size.ns :])
        after = Z[: size.ns, : size.ns]
    return ca.vertcat(*found[::-1])


@dataclass(frozen=True, eq=False, kw_only=True)
class Stagewise(GaussNewton):
    """A `GaussNewton` problem whose programs keep the states of its `stages`.

    Its `linearization` is `node_linearization`.

    Attributes
    ----------
    stages : Stages
        Where the nodes come from.
    """

    stages: Stages

    @property
    def is_embeddable(self) -> bool:
        """HPIPM becomes no C of its own."""
        return False

    @cached_property
    def _sizes(self) -> list[Size]:
        return sizes(self.stages)

    def _nodes(self, H: ca.MX, At: ca.MX) -> list[Node]:
        found, of_m, of_s = [], 0, 0
        for size in self._sizes:
            n = size.ns + size.nu
            M = H[of_m : (of_m := of_m + size.nr * n)]
            F = At[of_s : (of_s := of_s + size.n_next * n)]
            C = At[of_s : (of_s := of_s + size.nc * n)]
            found.append(
                Node(
                    ca.reshape(F, size.n_next, n),
                    ca.reshape(C, size.nc, n),
                    ca.reshape(M, size.nr, n),
                )
            )
        return found

    def unit(self, H: ca.MX) -> ca.MX | float:
        """Size of the objective."""
        return H[-1] if self.relative else 1.0

    def divided(self, H: ca.MX, unit: ca.MX | float) -> ca.MX:
        """H of the objective in units of its size."""
        return ca.vertcat(H[:-2] / ca.sqrt(unit), H[-2:] / unit)

    def damped(self, H: ca.MX, damping: ca.MX) -> ca.MX:
        """H with a damping, over the size of the objective."""
        return ca.vertcat(H[:-2], H[-2] + damping * self.unit(H), H[-1] + damping * self.unit(H))

    def curved(self, H: ca.MX, At: ca.MX, d: ca.MX) -> ca.MX:
        """H d."""
        nodes = self._nodes(H, At)
        reached = _forward(self._sizes, nodes, d)
        slopes = [node.M.T @ (node.M @ v) for node, v in zip(nodes, reached, strict=True)]
        return _backward(self._sizes, nodes, slopes) + H[-2] * d

    def changed(self, H: ca.MX, At: ca.MX, d: ca.MX) -> ca.MX:
        """A d, changes of the values."""
        nodes = self._nodes(H, At)
        reached = _forward(self._sizes, nodes, d)
        return ca.vertcat(*(node.C @ v for node, v in zip(nodes, reached, strict=True)))

    def pulled(self, H: ca.MX, At: ca.MX, multipliers: ca.MX) -> ca.MX:
        """Aᵀ times multipliers of the values."""
        nodes = self._nodes(H, At)
        ends = np.cumsum([0, *(size.nc for size in self._sizes)]).tolist()
        pieces = ca.vertsplit(multipliers, ends)
        slopes = [node.C.T @ piece for node, piece in zip(nodes, pieces, strict=True)]
        return _backward(self._sizes, nodes, slopes)

    @cached_property
    def program(self) -> ca.Function:
        """(H, g, At, lower, upper) -> d, multipliers: one quadratic program with all states."""
        n, m, nodes = self.n, self.m, self._sizes
        H, At = (ca.MX.sym(k, self.linearization.nnz_out(k)) for k in ("hessian", "slopes"))
        g, lower, upper = ca.MX.sym("g", n), ca.MX.sym("lower", n + m), ca.MX.sym("upper", n + m)
        h, a = _curvature(nodes, self._nodes(H, At), H[-2]), _rows(nodes, self._nodes(H, At))
        options: dict[str, Any] = {
            **PLUGINS["hpipm"][1],
            "error_on_fail": False,
            "N": len(nodes) - 1,
            "nx": [node.ns for node in nodes],
            "nu": [node.nu for node in nodes],
            "ng": [node.nc for node in nodes],
        }
        shapes = {"h": h.sparsity(), "a": a.sparsity()}
        # Wrapped, so that all outputs have a place: multipliers of no rows would go nowhere.
        solve = ca.conic(f"{self.name}_qp", "hpipm", shapes, options).wrap()
        # Of all variables those that are unknowns, of all rows those that are limits.
        u = np.concatenate([np.repeat([False, True], [node.ns, node.nu]) for node in nodes])
        c = np.concatenate([np.repeat([False, True], [node.n_next, node.nc]) for node in nodes])
        low, high = self.sides(lower, upper)
        found = solve(
            h=h,
            g=_spread(g, u, 0.0),
            a=a,
            lbx=_spread(low[:n], u, -np.inf),
            ubx=_spread(high[:n], u, np.inf),
            lba=_spread(low[n:], c, 0.0),
            uba=_spread(high[n:], c, 0.0),
        )
        rows = np.flatnonzero(u).tolist()
        multipliers = ca.vertcat(found["lam_x"][rows], found["lam_a"][np.flatnonzero(c).tolist()])
        return ca.Function(
            f"{self.name}_program",
            [H, g, At, lower, upper],
            [found["x"][rows], multipliers],
            {"never_inline": True},
        )


def _curvature(sizes: list[Size], nodes: list[Node], added: ca.MX) -> ca.MX:
    """Block diagonal of the nodes' Hessians."""
    blocks = [
        ca.densify(node.M.T @ node.M) + added * ca.diag(ca.DM([0] * size.ns + [1] * size.nu))
        for size, node in zip(sizes, nodes, strict=True)
    ]
    return ca.diagcat(*blocks)


def _rows(sizes: list[Size], nodes: list[Node]) -> ca.MX:
    """Rows F − 1 and C of the nodes, as HPIPM wants them."""
    total, at, found = sum(size.ns + size.nu for size in sizes), 0, []
    for size, node in zip(sizes, nodes, strict=True):
        width = size.ns + size.nu
        for slope, after in ((node.F, -ca.MX.eye(size.n_next)), (node.C, ca.MX(size.nc, 0))):
            rest = total - at - width - after.size2()
            row = [ca.MX(slope.size1(), at), slope, after, ca.MX(slope.size1(), rest)]
            found.append(ca.horzcat(*row))
        at += width
    return ca.vertcat(*found)


def _spread(values: ca.MX, where: Any, other: float) -> ca.MX:
    """A vector of `values` at the places `where`, of `other` elsewhere."""
    places = np.where(where, np.cumsum(where) - 1, where.sum()).tolist()
    return ca.vertcat(ca.vec(values), other)[places]
