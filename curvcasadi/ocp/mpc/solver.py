"""A predictive controller's step as one Function, in Python and in C."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any, Literal

import casadi as ca
import numpy as np

from curvcasadi.lie import quaternion, so3
from curvcasadi.ocp.mpc.functions import ModelFunctions, NativeFunctions
from curvcasadi.ocp.mpc.problem import MpcProblem
from curvcasadi.ocp.targets import rotations_defect
from curvcasadi.solvers.certificate import TOLERANCES, Bounds, larger
from curvcasadi.solvers.embedded import EmbeddedSolver, SolverFunction, solver_function
from curvcasadi.solvers.gauss_newton import GaussNewton
from curvcasadi.solvers.interior_point import InteriorPoint
from curvcasadi.solvers.stagewise import Stagewise, node_linearization
from curvcasadi.symbolic.expressions import Real

Solver = Literal["rti", "sqp", "ipopt"]

#: Tolerance of the optimality conditions, over half the ranges of inputs, where that of the
#: precision is finer than errors in metres are known in.
_STATIONARITY: dict[Real, float] = {"float": 1e-5}
#: What a quaternion's squared length may differ from 1, as of a rotation's columns.
_LENGTH = 1e-2


@dataclass(frozen=True, eq=False, kw_only=True)
class MpcSolver:
    """How the problem is solved.

    Attributes
    ----------
    problem : MpcProblem
        What is solved.
    functions : ModelFunctions
        Of its model.
    solver : {"rti", "sqp", "ipopt"}
        One quadratic program with a full step, programs until it converges, or IPOPT.
    qp_solver : str
        Of quadratic programs.
    max_iter : int
        Programs at most where it converges.
    tolerance : float
        Excess of limits over their units that counts as none.
    compiled : bool
        Whether the model's Functions are native code in Python.
    """

    problem: MpcProblem
    functions: ModelFunctions
    solver: Solver
    qp_solver: str
    max_iter: int
    tolerance: float
    compiled: bool

    @cached_property
    def function(self) -> SolverFunction:
        """A step, of expressions.

        (x, p, u_previous, reference, guess) -> u, plan, states, slack, violation, stationarity.
        """
        return self._function(self.functions)

    @cached_property
    def host(self) -> SolverFunction:
        """The same for Python; of native code, which cannot be exported, where compiled."""
        return self._function(self.functions.native) if self.compiled else self.function

    def _function(self, functions: ModelFunctions | NativeFunctions) -> SolverFunction:
        described, name = self.problem, self.problem.name
        model = described.model
        stages = described.stages(functions)
        lower, upper = described.unknown_bounds
        limits = described.limit_bounds
        kind: Any = InteriorPoint if self.solver == "ipopt" else GaussNewton
        evaluate = stages.evaluate
        if kind is GaussNewton and self.qp_solver == "hpipm":
            kind, evaluate = Stagewise, partial(node_linearization, stages)
        problem = kind(
            name=f"{name}_solver",
            linearization=evaluate(f"{name}_linearization"),
            values=stages.rollout(f"{name}_rollout"),
            bounds=Bounds(lower, upper, *limits),
            real=model.real,
            iterations=1 if self.solver == "rti" else None,
            max_iter=self.max_iter,
            stages=stages,
            relative=True,
            stationarity=_STATIONARITY.get(model.real),
            qp_solver=self.qp_solver,
        )
        begin, finish = self._begin(), self._finish()
        return solver_function(name, EmbeddedSolver(problem=problem, begin=begin, finish=finish))

    def _inputs(self) -> dict[str, ca.MX]:
        problem, model = self.problem, self.problem.model
        sizes = {
            "x": (model.x.size, 1),
            "p": (model.p.size, problem.count),
            "u_previous": (model.u.size, 1),
            "reference": (problem.goal_size, problem.count),
            "guess": (model.u.size, problem.count),
        }
        return {key: ca.MX.sym(key, *size) for key, size in sizes.items()}

    def _begin(self) -> ca.Function:
        """Inputs -> unknowns to start from, parameters of the stages."""
        problem, inputs = self.problem, self._inputs()
        model, slacks = problem.model, len(problem.soft)
        firsts = [problem.hold.index(i) for i in range(problem.hold[-1] + 1)]
        scale = ca.DM(problem.scale)
        start = [ca.vertcat(inputs["guess"][:, k] / scale, ca.MX.zeros(slacks)) for k in firsts]
        x = model.x.split(inputs["x"])
        state = [
            quaternion.normalize(x[part.name]) if part.attitude else x[part.name]
            for part in model.x.parts
        ]
        rest = ca.MX.zeros(problem.size - model.x.size - model.u.size)
        z = ca.vertcat(*state, inputs["u_previous"], rest)
        goals = [self._proper(column) for column in ca.horzsplit(inputs["reference"])]
        parameters = ca.veccat(z, inputs["p"], ca.MX.zeros(problem.nw), *goals)
        return ca.Function(
            f"{problem.name}_begin",
            [*inputs.values()],
            [ca.vertcat(*start), parameters],
            [*inputs],
            ["start", "parameters"],
        )

    def _pieces(self, column: ca.MX) -> list[ca.MX]:
        sizes = [penalty.part.size for penalty in self.problem.penalties]
        pieces: list[ca.MX] = ca.vertsplit(column, np.cumsum([0, *sizes]).tolist())
        return pieces

    def _proper(self, goal: ca.MX) -> ca.MX:
        """A stage's reference with the attitudes that numbers of few digits mean."""
        found = []
        for penalty, piece in zip(self.problem.penalties, self._pieces(goal), strict=True):
            if penalty.is_rotation:
                matrices = [ca.reshape(part, 3, 3) for part in ca.vertsplit(piece, 9)]
                piece = ca.veccat(*map(so3.orthonormal, matrices))
            elif penalty.part.attitude:
                piece = quaternion.normalize(piece)
            found.append(piece)
        return ca.vertcat(*found)

    def _defects(self, inputs: dict[str, ca.MX]) -> list[ca.MX]:
        """By how much attitudes among the inputs are none, over what is allowed."""
        x, model = self.problem.model.x.split(inputs["x"]), self.problem.model
        found = [_length_defect(x[part.name]) for part in model.x.parts if part.attitude]
        for column in ca.horzsplit(inputs["reference"]):
            for penalty, piece in zip(self.problem.penalties, self._pieces(column), strict=True):
                if penalty.is_rotation:
                    found.append(rotations_defect(ca.reshape(piece, 3, -1)))
                elif penalty.part.attitude:
                    found.append(_length_defect(piece))
        return found

    def _finish(self) -> ca.Function:
        """Inputs and what was found -> what the step gives."""
        problem, inputs = self.problem, self._inputs()
        model, nu, count = problem.model, problem.model.u.size, problem.count
        found = ca.MX.sym("found", problem.nw * (problem.hold[-1] + 1))
        rolled = ca.MX.sym("rolled", problem.size, count + 1)
        excess, distance, before = (ca.MX.sym(key) for key in ("excess", "distance", "before"))
        blocks = ca.horzsplit(ca.reshape(found, problem.nw, problem.hold[-1] + 1))
        held = [blocks[i] for i in problem.hold]
        scale = ca.diag(ca.DM(problem.scale))
        plan = [scale @ w[:nu] for w in held]
        units = ca.DM([limit.unit for limit in problem.soft])
        slacks = [units * ca.fmax(w[nu:], 0) if problem.soft else ca.MX(0, 1) for w in held]
        violation = excess / self.tolerance
        for defect in self._defects(inputs):
            violation = larger(violation, defect)
        outputs = {
            "u": plan[0],
            "plan": ca.horzcat(*plan[1:], plan[-1]),
            "states": rolled[: model.x.size, :],
            "slack": ca.horzcat(*slacks),
            "violation": violation,
            "stationarity": distance,
        }
        ends = [found, rolled, excess, distance, before]
        names = ["found", "rolled", "excess", "distance", "before"]
        return ca.Function(
            f"{problem.name}_finish",
            [*inputs.values(), *ends],
            [*outputs.values()],
            [*inputs, *names],
            [*outputs],
        )


def default_tolerance(real: Any, solver: Solver) -> float:
    """Excess of limits, over their units, that counts as none."""
    return 1e-2 if solver == "rti" else TOLERANCES[real].limit


def _length_defect(q: ca.MX) -> ca.MX:
    return ca.fabs(ca.sumsqr(q) - 1) / _LENGTH
