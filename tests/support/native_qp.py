"""The quadratic-program solver of exported C, compiled by gcc for this machine."""

from __future__ import annotations

import ctypes
import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from curvcasadi.solvers.qp import QuadraticProgram, qp_source
from curvcasadi.symbolic.expressions import Array, choice

#: What the solver says of a program, by its status in C.
STATUSES = ("solved", "infeasible", "limit", "not convex")

_ENTRY = """
int solve(const qp_problem *p, qp_real *x, qp_real *lam, int *side, qp_real *w, int *set,
          int *changes) {
  return (int)qp_solve(p, x, lam, side, w, set, changes);
}
int is_optimal(const qp_problem *p, const qp_real *x, const qp_real *lam, qp_real *w) {
  return qp_is_optimal(p, x, lam, w);
}
"""


class NativeResult(NamedTuple):
    """What the C code found."""

    status: str  #: one of `STATUSES`
    x: Array
    lam: Array  #: (n + m,), above zero at upper limits
    side: Array  #: (n + m,), -1 at lower limits, 1 at upper ones, 0 where idle
    changes: int  #: of the active set


@dataclass(frozen=True, eq=False, kw_only=True)
class NativeQp:
    """The solver in one precision; `compiled` makes it."""

    library: Any
    kind: Any  #: numpy's type of the numbers

    @classmethod
    def compiled(cls, folder: Path, real: str, *options: str) -> NativeQp:
        """Compile the solver into `folder`."""
        choice("real", real, ("double", "float"))
        source, library = folder / f"qp_{real}.c", folder / f"qp_{real}.so"
        source.write_text(f"#include <math.h>\n{qp_source(real)}{_ENTRY}")
        flags = ("-std=c99", "-O2", "-shared", "-fPIC", *options)
        subprocess.run(["gcc", *flags, str(source), "-o", str(library), "-lm"], check=True)
        kind = {"double": np.float64, "float": np.float32}[real]
        return cls(library=ctypes.CDLL(str(library)), kind=kind)

    def __call__(
        self, program: QuadraticProgram, guess: Array | None = None, *, max_changes: int = 0
    ) -> NativeResult:
        """Solve `program`, from a guess of the active set."""
        problem, kept = self._problem(program, max_changes)
        n, m = problem.n, problem.m
        x, lam = np.zeros(n, self.kind), np.zeros(n + m, self.kind)
        side = np.zeros(n + m, np.int32) if guess is None else np.array(guess, np.int32)
        work = np.zeros(n * n + n * (n + 1) // 2 + 5 * n, self.kind)
        changes = ctypes.c_int()
        pointers = (ctypes.c_void_p(v.ctypes.data) for v in (x, lam, side, work))
        chosen = np.zeros(n, np.int32)
        status = self.library.solve(
            ctypes.byref(problem),
            *pointers,
            ctypes.c_void_p(chosen.ctypes.data),
            ctypes.byref(changes),
        )
        del kept
        return NativeResult(STATUSES[status], x, lam, side, changes.value)

    def is_optimal(self, program: QuadraticProgram, x: Array, lam: Array) -> bool:
        """The certificate alone, at any point and multipliers."""
        problem, kept = self._problem(program, 0)
        point = [np.array(v, self.kind) for v in (x, lam, np.zeros(2 * problem.n))]
        pointers = [ctypes.c_void_p(v.ctypes.data) for v in point]
        found = bool(self.library.is_optimal(ctypes.byref(problem), *pointers))
        del kept
        return found

    def _problem(self, program: QuadraticProgram, max_changes: int) -> tuple[Any, Any]:
        """The program as a struct, and the arrays that it points to."""
        real = ctypes.c_double if self.kind is np.float64 else ctypes.c_float
        n, m = program.size
        used = program.A != 0
        arrays = {
            "row": np.concatenate([[0], np.cumsum(used.sum(axis=1))]).astype(np.int16),
            "col": np.nonzero(used)[1].astype(np.int16),
            "a": program.A[used].astype(self.kind),
            "h": program.H[np.tril_indices(n)].astype(self.kind),
            "g": program.g.astype(self.kind),
            "lo": np.clip(program.lower, -1e30, 1e30).astype(self.kind),
            "up": np.clip(program.upper, -1e30, 1e30).astype(self.kind),
        }
        numbers = ("reach", "primal", "dual")

        class Problem(ctypes.Structure):
            _fields_ = (
                [(key, ctypes.c_int) for key in ("n", "m")]
                + [(key, ctypes.c_void_p) for key in arrays]
                + [(key, real) for key in numbers]
                + [("max_changes", ctypes.c_int)]
            )

        tolerances = program.tolerances("float" if self.kind is np.float32 else "double")
        problem = Problem(
            n=n,
            m=m,
            max_changes=max_changes or 10 * (n + m) + 20,
            **dict(zip(numbers, tolerances, strict=True)),
            **{key: value.ctypes.data for key, value in arrays.items()},
        )
        return problem, arrays
