"""What a shape target costs on a Cortex-M4F by the project's own programs and by CasADi's qrqp."""

from __future__ import annotations

import numpy as np

import curvcasadi as cc
from benchmarks.qp import instructions
from benchmarks.table import Check, Table, checked
from codegen import benchmark_functions, toolchain

#: Programs by name: to convergence, and one real-time iteration.
KINDS = {"shape_target": None, "shape_target_step": 1}


def against_qrqp() -> Table:
    """Largest instructions of a call over five samples, the solvers in one run."""
    title = "A shape target of 8 magnus4 elements, Cortex-M4F, float: million instructions"
    missing = toolchain.missing_tools()
    if missing:
        return checked(title, [], missing)
    beam, checks = benchmark_functions.FEW_ELEMENTS, []
    samples = benchmark_functions.shape_target_samples(beam)
    rest = np.zeros(beam.basis.n)  # where it is already: no other sample at rest is added
    still = (rest, cc.tip_function(beam)(rest)[0])
    target = cc.Target(xi=1.0, position=[15.0, 0, 3], weight=1.0)
    for name, iterations in KINDS.items():
        cost = {}
        for solver in ("own", "qrqp"):
            function = cc.shape_target_function(
                beam,
                [target],
                regularization=1e-6,
                max_iter=11,
                iterations=iterations,
                qp_solver=solver,
                name=name,
            )
            calls = instructions(function, beam, [*samples[name], still])
            cost[solver] = max(calls[: len(samples[name])]) / 1e6
            checks.append(Check(what=f"{name}: {solver}", value=cost[solver]))
        ratio = cost["own"] / cost["qrqp"]
        checks.append(Check(what=f"{name}: own over qrqp", value=ratio, high=1))
    return checked(title, checks)
