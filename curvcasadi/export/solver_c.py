"""C of whole solvers: tables and an entry around the generated parts, and the shared source."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from itertools import pairwise

import casadi as ca
import numpy as np

from curvcasadi.solvers.embedded import EmbeddedSolver, SolverFunction
from curvcasadi.solvers.gauss_newton import DAMPING, STILL, GaussNewton
from curvcasadi.solvers.qp import QP_TOLERANCES, qp_source
from curvcasadi.solvers.stages import Rows, Stages
from curvcasadi.symbolic.expressions import Real

#: Changes of the active set of one program, at most, for every unknown and constraint.
CHANGES = 10
#: What `finish` has beside the inputs.
_RESULTS = 5
_NONE = 1e30


@dataclass(frozen=True, eq=False, kw_only=True)
class SolverC:
    """A solver under the names of an export."""

    function: SolverFunction
    symbol: Callable[[ca.Function], str]
    real: Real

    @property
    def solver(self) -> EmbeddedSolver:
        return self.function.solver

    @property
    def problem(self) -> GaussNewton:
        return self.function.solver.problem

    @property
    def parts(self) -> list[ca.Function]:
        """Functions that CasADi generates for it."""
        problem, solver = self.problem, self.solver
        stages = problem.stages
        found = [solver.begin, solver.finish]
        found += [solver.advance] if solver.rounds else []
        direct = [problem.linearization, problem.values]
        if not stages:
            return found + direct
        last = [stages.terminal] if stages.terminal else []
        return [*found, stages.error, stages.step, stages.limits, *last]

    def sizes(self, work: Mapping[str, int]) -> dict[str, int]:
        """Lengths of its buffers, for those of the work vectors of its parts."""
        f, solver, problem = self.function, self.solver, self.problem
        n, m, packed = problem.n, problem.m, problem.n * (problem.n + 1) // 2
        parts = self.parts
        parameters = solver.begin.nnz_out(1)
        kept = parameters * (2 if solver.rounds else 1) + problem.values.nnz_out(1) + 3
        kept += 3 * n + 3 * (n + m) + n + packed + m + problem.linearization.nnz_out("slopes")
        generated = self._stage_reals + max(work[part.name()] for part in parts)
        own = f.n_in() + _RESULTS
        return {
            "arg": max(own + max(part.sz_arg() for part in parts), solver.finish.sz_arg()),
            "res": f.n_out() + max(part.sz_res() for part in parts),
            "iw": 2 * n + m + max(part.sz_iw() for part in parts),
            "w": kept + max(n * n + packed + 5 * n, generated),
        }

    @property
    def _stage_reals(self) -> int:
        stages = self.problem.stages
        if stages is None:
            return 0
        nr, n = max(stages.error.nnz_out(0), _terminal_size(stages)), self.problem.n
        entries = max(sum(map(len, rows)) for rows in stages.sensitivities)
        derivatives = stages.step.nnz_out(1) + stages.step.nnz_out(2) + stages.limits.nnz_out(1)
        return 2 * entries + nr + nr * stages.nd + derivatives + n + nr * n + 2 * stages.nx

    def text(self) -> str:
        """Its tables and its entry."""
        name = self.function.name()
        return "\n".join(
            [
                *(self._stages(name, self.problem.stages) if self.problem.stages else []),
                *self._problem(name),
                *self._solver(name),
                f"{prototype(self.symbol(self.function))} {{",
                "  (void)mem;",
                f"  return gn_run(&{name}_solver, arg, res, iw, w);",
                "}\n",
            ]
        )

    def _stages(self, name: str, stages: Stages) -> list[str]:
        slopes = {
            "a": stages.step.sparsity_out(1),
            "b": stages.step.sparsity_out(2),
            "c": stages.limits.sparsity_out(1),
        }
        lines = [
            table
            for key, sparsity in slopes.items()
            for table in _rows(f"{name}_{key}", _by_columns(sparsity))
        ]
        after = [row for rows in stages.sensitivities[1:] for row in rows]
        goals = [stages.error.nnz_in(i) for i in range(2, stages.error.n_in())]
        lines += [*_rows(f"{name}_g", after), _shorts(f"{name}_goals", goals)]
        lines += [_shorts(f"{name}_held", stages.held)]
        fields = [
            *(stages.count, stages.inputs, stages.nx, stages.nd, stages.nu),
            *(stages.parameter_sizes[1], stages.error.nnz_out(0), stages.limits.nnz_out(0)),
            *(_terminal_size(stages), len(goals)),
            stages.step.nnz_in(2) if stages.varying else 0,
            *(f"{name}_held", f"{name}_goals"),
            *(self.symbol(f) for f in (stages.error, stages.step, stages.limits)),
            self.symbol(stages.terminal) if stages.terminal else 0,
            *(f"{name}_{key}_{part}" for key in "abcg" for part in ("row", "col")),
            *map(_real, (stages.move_weight, stages.input_weight, stages.damping)),
            int(stages.relative),
        ]
        return [*lines, _struct("gn_stages", f"{name}_stages", fields)]

    def _problem(self, name: str) -> list[str]:
        problem = self.problem
        n, m, tolerances = problem.n, problem.m, problem.tolerances
        lower, upper = problem.limits
        stages = problem.stages
        periods = (n // stages.inputs, m // stages.count) if stages else (n, m)
        slopes = stages.limit_rows if stages else _slopes(problem)
        sides = {
            "x_lower": lower[: periods[0]],
            "x_upper": upper[: periods[0]],
            "c_lower": lower[n : n + periods[1]],
            "c_upper": upper[n : n + periods[1]],
        }
        lines = [*_rows(name, slopes), *(_reals(f"{name}_{key}", x) for key, x in sides.items())]
        direct = (problem.linearization, problem.values)
        functions = ["0", "0"] if stages else [self.symbol(f) for f in direct]
        qp = QP_TOLERANCES[self.real]
        step = STILL * tolerances.step
        decrement = (problem.residual_unit or 0) * tolerances.decrement
        fields = [
            *(n, m, f"{name}_row", f"{name}_col", max(periods[0], 1), max(periods[1], 1)),
            *(f"{name}_{key}" for key in sides),
            *functions,
            *(f"&{name}_stages" if stages else "0", self._stage_reals),
            *(problem.iterations or 0, problem.passes, problem.halvings, _changes(problem)),
            *map(_real, qp),
            *map(_real, (step, tolerances.limit, problem.flatness, problem.still)),
            *map(_real, (problem.enough, decrement, problem.noise)),
            _real(DAMPING * problem.first_damping),
            int(problem.relative),
        ]
        return [*lines, _struct("gn_problem", f"{name}_problem", fields)]

    def _solver(self, name: str) -> list[str]:
        solver, f = self.solver, self.function
        advance = self.symbol(solver.advance) if solver.rounds else "0"
        settings = [x for row in solver.rounds for x in row]
        fields = [
            *(f"&{name}_problem", f.n_in(), f.n_out(), solver.begin.nnz_out(1)),
            *(self.problem.values.nnz_out(1), self.symbol(solver.begin), advance),
            *(self.symbol(solver.finish), f"{name}_settings" if settings else "0"),
            *(len(solver.rounds), len(solver.rounds[0]) if solver.rounds else 0),
        ]
        lines = [_reals(f"{name}_settings", settings)] if settings else []
        return [*lines, _struct("gn_solver", f"{name}_solver", fields)]


def iteration_bounds(function: SolverFunction) -> dict[str, int]:
    """Linearizations in all rounds at most; after so many changes of its set a program is given up.

    By the name of the function, and by that with "_qp" behind it.
    """
    solver, name = function.solver, function.name()
    rounds = 1 + len(solver.rounds)
    return {name: rounds * solver.problem.passes, f"{name}_qp": _changes(solver.problem)}


def _changes(problem: GaussNewton) -> int:
    """Of the active set of one program, at most."""
    return CHANGES * (problem.n + problem.m)


def prototype(symbol: str) -> str:
    """Head of a solver's entry."""
    return (
        f"int {symbol}(const casadi_real** arg, casadi_real** res, casadi_int* iw, "
        "casadi_real* w, int mem)"
    )


def source(solvers: Sequence[SolverC], prefix: str, real: Real) -> str:
    """What all solvers share, then each one's own."""
    folder = files("curvcasadi.solvers").joinpath("templates")
    staged = any(s.problem.stages for s in solvers)
    fields = dict.fromkeys(("STAGES", "CONDENSED", "ROLLED"), "")
    if staged:
        fields = {
            "STAGES": folder.joinpath("stages.c").read_text(),
            "CONDENSED": _CONDENSED.format(
                call="gn_condense(problem->stages, problem->row, problem->col, x, s->p, &s->at, "
                "s->stage,\n                         &s->scratch)"
            ),
            "ROLLED": _CONDENSED.format(
                call="gn_rollout(problem->stages, x, s->p, s->at.c, states, s->stage, &s->scratch)"
            ),
        }
    used = {"converge" if s.problem.iterations is None else "iterate" for s in solvers}
    for way in ("iterate", "converge"):
        fields[way.upper()] = folder.joinpath(f"{way}.c").read_text() if way in used else ""
    fields["SOLVE"] = _SOLVE[" or ".join(sorted(used, reverse=True))]
    loop = folder.joinpath("gauss_newton.c").read_text()
    for key, value in fields.items():
        loop = loop.replace(f"@{key}@\n", value)
    text = "\n".join([qp_source(real, "casadi_real"), loop, *(s.text() for s in solvers)])
    return re.sub(
        r"\b(qp|gn|QP|GN)_(?=\w)",
        lambda found: f"{prefix if found[1].islower() else prefix.upper()}_{found[0]}",
        text,
    )


#: By the ways that the solvers of an export take.
_SOLVE = {
    "iterate": "  failed = gn_iterate(s, &found);\n",
    "converge": "  failed = gn_converge(s, &found);\n",
    "iterate or converge": "  failed = s->problem->iterations > 0 ? gn_iterate(s, &found) : "
    "gn_converge(s, &found);\n",
}
_CONDENSED = """\
  if (problem->stages) {{
    failed = {call};
  }} else
"""


def _terminal_size(stages: Stages) -> int:
    return int(stages.terminal.nnz_out(0)) if stages.terminal else 0


def _by_columns(transposed: ca.Sparsity) -> Rows:
    begin, entries = transposed.colind(), transposed.row()
    return [entries[a:b] for a, b in pairwise(begin)]


def _slopes(problem: GaussNewton) -> Rows:
    return _by_columns(problem.linearization.sparsity_out("slopes"))


def _rows(name: str, rows: Rows) -> list[str]:
    ends = np.cumsum([0, *(len(row) for row in rows)]).tolist()
    columns = [column for row in rows for column in row]
    return [_shorts(f"{name}_row", ends), _shorts(f"{name}_col", columns)]


def _shorts(name: str, values: Iterable[int]) -> str:
    numbers = [*values] or [0]
    return f"static const short {name}[{len(numbers)}] = {{{', '.join(map(str, numbers))}}};"


def _reals(name: str, values: Iterable[float]) -> str:
    numbers = [_real(x) for x in values] or ["0"]
    return f"static const casadi_real {name}[{len(numbers)}] = {{{', '.join(numbers)}}};"


def _real(value: float) -> str:
    """A number; infinite limits are those of the solver."""
    return repr(float(np.clip(value, -_NONE, _NONE)))


def _struct(kind: str, name: str, fields: Iterable[object]) -> str:
    return f"static const {kind} {name} = {{{', '.join(map(str, fields))}}};"
