"""Whole solvers as Functions: on a host a graph of CasADi, in C a loop around generated parts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca

from curvcasadi.solvers.gauss_newton import GaussNewton

#: Of solvers with a single round.
_ONE_ROUND = ca.Function()


@dataclass(frozen=True, eq=False, kw_only=True)
class EmbeddedSolver:
    """A problem, what its parameters are made of, and what is made of its solution.

    Attributes
    ----------
    problem : GaussNewton
        What is solved, once a round.
    begin : casadi.Function
        The solver's inputs -> guess (n, 1), parameters of the first round.
    finish : casadi.Function
        The solver's inputs, then x, states, violation, stationarity and that of the round before ->
        the solver's outputs.
    advance : casadi.Function
        (x, parameters, settings) -> parameters of the next round; where there are more than one.
    rounds : sequence of sequences of float
        Settings of each round after the first.
    """

    problem: GaussNewton
    begin: ca.Function
    finish: ca.Function
    advance: ca.Function = _ONE_ROUND
    rounds: Sequence[Sequence[float]] = ()

    @property
    def is_exportable(self) -> bool:
        """Whether the solver in C takes its place."""
        return self.problem.is_embeddable

    def solve(self, inputs: list[ca.MX]) -> list[ca.MX]:
        """Outputs as a graph."""
        x, parameters = self.begin.call(inputs)
        found = self.problem(x, parameters)
        before = found.stationarity
        for settings in self.rounds:
            (parameters,) = self.advance.call([found.x, parameters, ca.DM([*settings])])
            before, found = found.stationarity, self.problem(found.x, parameters)
        ends = [found.x, found.states, found.violation, found.stationarity, before]
        return list(self.finish.call([*inputs, *ends]))


class SolverFunction(ca.Function):
    """A casadi.Function that knows what it solves, so that `export_c` writes its own C."""

    def __init__(self, function: ca.Function, solver: EmbeddedSolver) -> None:
        super().__init__(function)
        self.solver = solver


def solver_function(name: str, solver: EmbeddedSolver) -> SolverFunction:
    """The solver as a Function, with the inputs of its `begin` and the outputs of its `finish`."""
    begin, finish = solver.begin, solver.finish
    inputs = [ca.MX.sym(key, begin.sparsity_in(key)) for key in begin.name_in()]
    options: dict[str, Any] = {}
    graph = ca.Function(
        name, inputs, solver.solve(inputs), begin.name_in(), finish.name_out(), options
    )
    return SolverFunction(graph, solver)
