"""What the exported functions are, in numbers: for manifest.json."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Mapping, Sequence
from typing import Any

import casadi as ca
import numpy as np

from curvcasadi.beam.beam import Beam
from curvcasadi.export import solver_c
from curvcasadi.export.wrappers import Wrapper
from curvcasadi.kinematics.resolution import largest_element_angles
from curvcasadi.solvers.embedded import SolverFunction

#: How generated code bounds its loops: the outer ones of `sqpmethod`, those of `qrqp`, of Newton.
_LOOPS = (
    re.compile(r"if \(iter_count >= (\d+)\) break;"),
    re.compile(r"p\.max_iter = (\d+);"),
    re.compile(r"for \(iter=0; iter<(\d+); \+\+iter\)"),
)
_PART = re.compile(
    r"^/\* (\w+):\([^\n]*\*/\nstatic int (\w+)\(const casadi_real\*\* arg.*?^}$", re.S | re.M
)


def manifest(wrappers: list[Wrapper], source: str, files: list[str], real: str) -> dict[str, Any]:
    """The manifest of an export, the same bytes for the same functions."""
    return {
        "files": files,
        "casadi": ca.CasadiMeta.version(),
        "real": real,
        "sha256": hashlib.sha256(source.encode()).hexdigest(),
        "recursion": False,
        "dynamic_memory": False,
        "constant_tables": "const",
        "static_state": False,
        "iterations": iteration_bounds([w.export.function for w in wrappers], source),
        "functions": {w.export.name: _described(w) for w in wrappers},
    }


def iteration_bounds(functions: Sequence[ca.Function], source: str) -> dict[str, int]:
    """Largest number of iterations of every solver, by its name: of CasADi's in generated C first.

    CasADi calls all quadratic programs "qpsol": here they have the name of their SQP before it.
    """
    own = [f for f in functions if isinstance(f, SolverFunction) and f.solver.is_exportable]
    bounds = _generated_bounds(source)
    for function in own:
        bounds |= solver_c.iteration_bounds(function)
    return bounds


def _generated_bounds(source: str) -> dict[str, int]:
    parts = list(_PART.finditer(source))
    bounds: dict[str, int] = {}
    for part in parts:
        found = [int(m[1]) for loop in _LOOPS for m in loop.finditer(part[0])]
        callers = [p[1] for p in parts if p is not part and f"{part[2]}(" in p[0]]
        names = [f"{caller}_qpsol" for caller in callers] if part[1] == "qpsol" else [part[1]]
        if found:
            bounds |= dict.fromkeys(names, found[0])
    return bounds


def nodes(f: ca.Function) -> int:
    """Instructions of one evaluation, calls included; of a solver, of one iteration."""
    if f.class_name() == "SXFunction":
        return int(f.n_instructions())
    if f.class_name() != "MXFunction":
        return sum(nodes(part) for part in f.find_functions(0))
    calls = [
        f.instruction_MX(k).which_function()
        for k in range(f.n_instructions())
        if f.instruction_id(k) == ca.OP_CALL
    ]
    known = {g.__hash__(): nodes(g) for g in {g.__hash__(): g for g in calls}.values()}
    return int(f.n_instructions()) - len(calls) + sum(known[g.__hash__()] for g in calls)


def _described(wrapper: Wrapper) -> dict[str, Any]:
    f = wrapper.export.function
    return {
        "inputs": {f.name_in(i): list(f.size_in(i)) for i in range(f.n_in())},
        "outputs": {f.name_out(i): list(f.size_out(i)) for i in range(f.n_out())},
        "buffers": wrapper.sizes,
        "nodes": nodes(f),
        "solver": wrapper.export.is_solver,
        "weights": {key: _limits(beam) for key, beam in wrapper.export.weights.items()},
    }


def _limits(beam: Beam) -> Mapping[str, Any]:
    rule = beam.grid.rule
    lower, upper = (_finite(side.tolist()) for side in beam.bounds)
    return {
        "lower": lower,
        "upper": upper,
        "elements": beam.grid.elements,
        "rule": rule if isinstance(rule, str) else type(rule).__name__,
        "largest_element_angle": _finite([float(np.max(largest_element_angles(beam)))])[0],
        "allowed_element_angle": beam.grid.max_angle,
    }


def _finite(values: list[float]) -> list[float | None]:
    """JSON has no infinity: None for a bound that is none."""
    return [x if np.isfinite(x) else None for x in values]
