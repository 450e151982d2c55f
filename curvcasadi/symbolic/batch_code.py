"""What evaluates a Function over arrays: native code on vector lanes, or CasADi's `map`."""

from __future__ import annotations

import ctypes
import os
from collections.abc import Callable, Sequence
from functools import cache, lru_cache
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from curvcasadi.symbolic import lanes
from curvcasadi.symbolic.compiled import loaded, run
from curvcasadi.symbolic.expressions import Real

#: Vectors of this machine, fused products, and the functions of libm without a global error code.
#: Nothing here changes what is done with a NaN, an infinity or a signed zero.
OPTIONS = (
    "-std=c++17", "-O2", "-march=native", "-ffp-contract=fast", "-fno-math-errno",
    "-fno-trapping-math", "-fPIC", "-shared", "-pthread", "-w", "-Wl,-Bsymbolic",
)  # fmt: skip

#: (inputs, outputs, threads): fills the outputs; arrays are (batch, rows, columns).
Evaluate = Callable[[Sequence[NDArray[Any]], Sequence[NDArray[Any]], int], None]


def native(f: ca.Function, real: Real, compiler: str) -> Evaluate:
    """Native code over a batch."""
    source = lanes.source(f, real)
    library = loaded(source, (*OPTIONS, _processor(compiler)), compiler, "cpp")
    evaluate = library.batch
    evaluate.restype = ctypes.c_int
    name = f.name()

    def call(inputs: Sequence[NDArray[Any]], outputs: Sequence[NDArray[Any]], threads: int) -> None:
        size = len(outputs[0])
        arrays = [array if _is_even(array) else np.ascontiguousarray(array) for array in inputs]
        results = [array if _is_even(array) else np.empty_like(array) for array in outputs]
        failed = evaluate(
            *_pointers(arrays), *_pointers(results), ctypes.c_ssize_t(size), min(threads, size)
        )
        if failed:
            raise MemoryError(f"{name}: no memory for {threads} threads")
        for array, result in zip(outputs, results, strict=True):
            if result is not array:
                array[...] = result

    return call


def _pointers(arrays: Sequence[NDArray[Any]]) -> tuple[Any, Any]:
    """Addresses of arrays (batch, rows, columns), and strides in numbers; 0 for a shared one."""
    n = max(len(arrays), 1)
    addresses, strides = (ctypes.c_void_p * n)(), ((ctypes.c_ssize_t * 3) * n)()
    for i, array in enumerate(arrays):
        addresses[i] = array.ctypes.data
        steps = [step // array.itemsize for step in array.strides]
        strides[i] = (ctypes.c_ssize_t * 3)(0 if len(array) == 1 else steps[0], *steps[1:])
    return addresses, strides


def _is_even(array: NDArray[Any]) -> bool:
    """Whether an array lies in memory in steps of whole numbers."""
    return array.flags.aligned and not any(step % array.itemsize for step in array.strides)


def mapped(f: ca.Function) -> Evaluate:
    """CasADi's `map` over a batch, in double precision."""

    @lru_cache(maxsize=8)
    def over(size: int, threads: int) -> ca.Function:
        return f.map(size, "thread", threads) if threads > 1 else f.map(size)

    def call(inputs: Sequence[NDArray[Any]], outputs: Sequence[NDArray[Any]], threads: int) -> None:
        size = len(outputs[0])
        columns = []
        for i, array in enumerate(inputs):
            rows, _ = f.size_in(i)
            every = np.broadcast_to(array, (size, *array.shape[1:]))
            columns.append(ca.DM(np.moveaxis(every, 0, 1).reshape(rows, -1).astype(float)))
        for i, result in enumerate(over(size, min(threads, size)).call(columns)):
            rows, _ = f.size_out(i)
            outputs[i][...] = np.moveaxis(result.full().reshape(rows, size, -1), 1, 0)

    return call


@cache
def _processor(compiler: str) -> str:
    """A macro that tells libraries for one processor from those for another."""
    import hashlib

    macros = run([compiler, "-march=native", "-dM", "-E", "-x", "c++", os.devnull])
    return f"-DLANES_PROCESSOR=0x{hashlib.sha256(macros.encode()).hexdigest()[:8]}"
