"""The least-squares problem of a window of samples, described."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import casadi as ca
import numpy as np

from curvcasadi.beam.beam import Beam
from curvcasadi.estimation.mhe.residual import sample_residual
from curvcasadi.estimation.process import Process
from curvcasadi.estimation.samples import samples_function
from curvcasadi.kinematics.root_motion import ROOT_INPUTS
from curvcasadi.sensors import Channels, RootMotion, Sensor, sensor_channels
from curvcasadi.symbolic.expressions import Array
from curvcasadi.symbolic.layout import Layout

#: Scale of the constraints on steps of weights: in single precision `qrqp` gave up on 8 of 40
#: windows with 1, on 2 with 0.3, and on 3 with 0.05; in double on 6 of 40 with 20, on none below 1.
MOVES = 0.3


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
    known: tuple[str, ...]  #: inputs of `ROOT_INPUTS` that come with a sample
    process: Process
    node: Layout
    unknown: Mapping[str, Array]  #: standard deviations (n,)
    moves: Array  #: bounds (n,) of |q_{k+1} − q_k|, rad/m; infinite where there is none
    nodes: int  #: of a window, N + 1
    dt: float  #: between nodes, s

    @property
    def size(self) -> int:
        """Of the state."""
        return self.process.state.size

    @property
    def channels(self) -> Channels:
        """Rows of a sample."""
        return sensor_channels(self.sensors)

    @cached_property
    def residual(self) -> ca.Function:
        """Of one sample."""
        name = f"{self.name}_residual"
        return sample_residual(name, self.beam, self.sensors, self.node, self.known, self.root)

    @property
    def deviations(self) -> Array:
        """Of the unknowns, stacked."""
        return np.concatenate([np.zeros(0), *self.unknown.values()])

    @property
    def transition(self) -> Array:
        """F (x, x): the state a step later, undriven."""
        one = [[1.0]] if self.process.kind == "random_walk" else [[1.0, self.dt], [0.0, 1.0]]
        return np.asarray(np.kron(one, np.eye(self.process.n)))

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
        return np.asarray(np.kron(one, np.diag(1 / self.process.density)))

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
        prior = ca.horzcat(ca.DM(other, size), ca.diag(ca.DM(1 / self.deviations)))
        return ca.sparsify(ca.vertcat(rows, ca.diagcat(*[prior] * self.nodes)))

    def limited_moves(self, nodes: Sequence[ca.MX]) -> tuple[ca.MX, Array]:
        """q_{k+1} − q_k of the weights that have a bound of it, and these bounds, times `MOVES`."""
        finite = [int(i) for i in np.flatnonzero(np.isfinite(self.moves))]
        moves = [MOVES * (b[finite] - a[finite]) for a, b in pairwise(nodes)] if finite else []
        return ca.vertcat(ca.MX(0, 1), *moves), np.tile(MOVES * self.moves[finite], len(moves))

    def data(self) -> dict[str, ca.MX]:
        """Symbols of what comes with the samples, one sample a column."""
        rows = {"samples": self.channels.layout.size, "seen": self.channels.residual_layout.size}
        shapes = {**{key: (size, 1) for key, size in rows.items()}, **self.known_shapes}
        return {key: ca.MX.sym(key, r, c * self.nodes) for key, (r, c) in shapes.items()}

    @property
    def known_shapes(self) -> dict[str, tuple[int, int]]:
        """Of `known`, at one node."""
        return {key: ROOT_INPUTS[key] for key in self.known}

    def by_node(self, data: Mapping[str, ca.MX]) -> list[tuple[ca.MX, ...]]:
        """Arguments of `residual` after the node, for every node."""
        columns = (ca.horzsplit(m, m.shape[1] // self.nodes) for m in data.values())
        return list(zip(*columns, strict=True))

    def typical(self) -> ca.DM:
        """Parameters of a solver with all samples there and nothing known before."""
        absent = ca.DM.nan(self.channels.layout.size)
        samples, seen = samples_function(self.sensors)(absent)
        motion = [
            ca.DM.eye(3) if k == "attitude" else ca.DM(*s) for k, s in self.known_shapes.items()
        ]
        parts = [ca.repmat(ca.densify(m), 1, self.nodes) for m in (samples, seen + 1, *motion)]
        before = ca.DM.zeros(self.size + self.size * (self.size + 1) // 2)
        return ca.veccat(before, *parts)
