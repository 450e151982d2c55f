"""The least-squares problem of a window of samples, described."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from curvcasadi.beam.beam import Beam
from curvcasadi.estimation.mhe.residual import sample_residual
from curvcasadi.estimation.process import Process
from curvcasadi.kinematics.root_motion import ROOT_INPUTS
from curvcasadi.sensors import Channels, RootMotion, Sensor, sensor_channels
from curvcasadi.symbolic.expressions import Array
from curvcasadi.symbolic.layout import Layout


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
    def drive(self) -> Array:
        """B (x, x) with B Bᵀ = Q, upper triangular: the state a step later is F x + B w.

        Random walk: Q = S dt. White acceleration: Q = S T, T = [[dt³/3, dt²/2], [dt²/2, dt]].
        """
        one = [[self.dt**0.5]]
        if self.process.kind == "white_acceleration":
            one = [[(self.dt**3 / 12) ** 0.5, self.dt**1.5 / 2], [0.0, self.dt**0.5]]
        return np.asarray(np.kron(one, np.diag(self.process.density)))

    def data_shapes(self) -> dict[str, tuple[int, int]]:
        """Of what comes with a sample and the residual needs."""
        rows = {"samples": self.channels.layout.size, "seen": self.channels.residual_layout.size}
        return {**{key: (size, 1) for key, size in rows.items()}, **self.known_shapes}

    @property
    def known_shapes(self) -> dict[str, tuple[int, int]]:
        """Of `known`, at one node."""
        return {key: ROOT_INPUTS[key] for key in self.known}
