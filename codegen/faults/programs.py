"""Does the quadratic-program solver of exported C ever claim what is not so?

    python -m codegen.faults.programs [--programs 100000] [--seed 0]

Solves random programs in both precisions, cold and from wrong active sets: duplicate and dependent
rows, no interior, equalities, condition 1e6, no solution. Their feasibility is known from how they
are made. Fails where a feasible one is called infeasible, where a solution violates the optimality
conditions, where an infeasible one gets another status, or where too many remain unsolved.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np

from curvcasadi.solvers.qp import QP_TOLERANCES
from tests.support.native_qp import NativeQp
from tests.support.quadratic_programs import KINDS, random_program, residuals

REALS = {"double": np.float64, "float": np.float32}
#: Part of the feasible programs that may remain unsolved.
UNSOLVED = {"double": 0.0, "float": 0.001}


def fuzz(real: str, numbers: range, seed: int) -> Counter[str]:
    """How the programs of these numbers ended."""
    kind_of_number, tolerances = REALS[real], QP_TOLERANCES[real]
    counts: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as folder:
        solve = NativeQp.compiled(Path(folder), real)
    for k in numbers:
        random = np.random.default_rng([seed, k])
        program, is_feasible = random_program(random, KINDS[k % len(KINDS)], kind_of_number)
        guess = random.integers(-1, 2, sum(program.size)) if random.random() < 0.5 else None
        result = solve(program, guess)
        counts["feasible" if is_feasible else "infeasible"] += 1
        if is_feasible and result.status == "solved":
            miss, left, idle = residuals(program, result.x, result.lam)
            size = 1 + np.abs(result.lam).sum()  # of the terms, whose rounding remains
            is_right = (
                miss <= 1.01 * tolerances.primal
                and left <= tolerances.dual + 8 * np.finfo(kind_of_number).eps * size
                and idle <= max(tolerances.dual, tolerances.primal)
            )
            counts["solved" if is_right else "wrongly solved"] += 1
        elif is_feasible:
            is_claimed = result.status == "infeasible"
            counts["wrongly infeasible" if is_claimed else "unsolved"] += 1
        else:
            counts["proved" if result.status == "infeasible" else "not proved"] += 1
    return counts


def wrong(real: str, counts: Counter[str]) -> list[str]:
    """What must not be."""
    keys = ("wrongly solved", "wrongly infeasible", "not proved")
    found = [f"{real}: {counts[key]} {key}" for key in keys if counts[key]]
    if counts["unsolved"] > UNSOLVED[real] * counts["feasible"]:
        found.append(f"{real}: {counts['unsolved']} unsolved of {counts['feasible']}")
    return found


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--programs", type=int, default=100_000)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    halves = [range(start, options.programs, 2) for start in (0, 1)]
    failed = []
    with ProcessPoolExecutor(2) as pool:
        for real in REALS:
            parts = pool.map(fuzz, [real] * 2, halves, [options.seed] * 2)
            counts = sum(parts, Counter())
            print(real, ", ".join(f"{key} {counts[key]}" for key in sorted(counts)))
            failed += wrong(real, counts)
    print("\n".join(["Wrong:", *failed]) if failed else "No false claim.")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
