"""Exported functions called on this machine, in the arithmetic that a target computes in."""

from __future__ import annotations

import ctypes
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

import curvcasadi as cc
from curvcasadi.symbolic.compiled import compile_c

STATUSES = ("OK", "INFEASIBLE", "NOT_CONVERGED", "BAD_INPUT")
KINDS = {"double": np.float64, "float": np.float32}


@dataclass(frozen=True, eq=False, kw_only=True)
class NativeFunction:
    """One function of an export, compiled; `compiled` makes it."""

    function: ca.Function
    kind: Any  #: numpy's type of its numbers
    call: Any  #: its entry in the library

    @classmethod
    def compiled(
        cls, function: ca.Function, beam: cc.Beam, sample: list[Any], *, optimization: str = "-O1"
    ) -> NativeFunction:
        """Export `function` of `beam`, compile and load it; `sample` is for its self-test."""
        real = beam.grid.real
        with tempfile.TemporaryDirectory() as folder:
            samples = {function.name(): [sample]}
            cc.export_c([function], folder, real=real, beam=beam, reference_inputs=samples)
            library = Path(folder, "curv.so")
            options = ("-std=c99", optimization, "-fPIC", "-shared", "-Wl,-Bsymbolic")
            compile_c(["curv.c", "curv_functions.c"], library, options, folder=folder)
            entry = getattr(ctypes.CDLL(str(library)), f"curv_{function.name()}")
        return cls(function=function, kind=KINDS[real], call=entry)

    def __call__(self, *inputs: Any) -> tuple[str, dict[str, Any]]:
        """Status and outputs, those of the call before where the status is not OK."""
        f = self.function
        given = [np.ravel(np.asarray(x, self.kind), order="F") for x in inputs]
        sizes = [f.numel_out(i) for i in range(f.n_out())]
        out = np.full(sum(sizes), np.nan, self.kind)
        pointers = [ctypes.c_void_p(x.ctypes.data) for x in (*given, out)]
        status = STATUSES[self.call(*pointers)]
        parts = np.split(out.astype(float), np.cumsum(sizes)[:-1])
        return status, dict(zip(f.name_out(), parts, strict=True))
