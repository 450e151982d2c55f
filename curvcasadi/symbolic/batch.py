"""Functions over batches of wings: numpy arrays in and out, as many wings at once as fit."""

from __future__ import annotations

import os
import shutil
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from curvcasadi.symbolic import lanes
from curvcasadi.symbolic.batch_code import Evaluate, mapped, native
from curvcasadi.symbolic.compiled import refuse_foreign
from curvcasadi.symbolic.expressions import Real, choice, count, instance

_TYPES: dict[str, type[np.floating[Any]]] = {"double": np.float64, "float": np.float32}


@dataclass(frozen=True, eq=False, kw_only=True)
class Batch:
    """A Function over batches, from `compile_batch`; call it with numpy arrays.

    Attributes
    ----------
    function : casadi.Function
        What it evaluates for each member of a batch.
    real : {"double", "float"}
        Arithmetic, and the type of the results.
    axis : {0, -1}
        Which axis of every array is the batch.
    is_native : bool
        Whether it is native code over the lanes of vector registers, or CasADi's `map`.
    compiler : str
        Of the native code.
    """

    function: ca.Function
    real: Real
    axis: Literal[0, -1]
    is_native: bool
    compiler: str
    _evaluate: Evaluate

    def __call__(
        self,
        *inputs: ArrayLike,
        threads: int | None = 1,
        out: Sequence[NDArray[Any]] | None = None,
    ) -> Any:
        """The outputs of the Function for each member of the batch.

        Parameters
        ----------
        *inputs : array
            An array for each input of the Function, in its order. With the batch first an input of
            shape (n, 1) is an array (batch, n), one of shape (r, c) an array (batch, r, c), a
            scalar an array (batch,); with the batch last (n, batch), (r, c, batch) and (batch,).
            Without the axis of the batch a value is that of every member. Arrays need not be
            contiguous; integers and the other precision are converted.
        threads : int or None
            Threads that share the batch; None for one on each processor that is free to use.
        out : sequence of arrays, optional
            Where to write the outputs: of the shapes and the type of the results.

        Returns
        -------
        array or tuple of arrays
            One array for each output, shapes as of inputs; the array itself where there is one. A
            batch of length zero gives arrays of length zero.

        Raises
        ------
        ValueError
            If an array does not fit its input: names it, what is expected and what was found.
        """
        f, kind = self.function, _TYPES[self.real]
        if len(inputs) != f.n_in():
            raise ValueError(
                f"{f.name()}: expected {f.n_in()} arrays ({', '.join(f.name_in())}), "
                f"found {len(inputs)}"
            )
        arrays = [self._input(i, value) for i, value in enumerate(inputs)]
        sizes = {f.name_in(i): len(a) for i, (a, is_shared) in enumerate(arrays) if not is_shared}
        if len(set(sizes.values())) > 1:
            found = ", ".join(f"{name} {size}" for name, size in sizes.items())
            raise ValueError(f"{f.name()}: expected batches of one length, found {found}")
        if not sizes:
            raise ValueError(
                f"{f.name()}: expected an array with the axis of the batch "
                f"({', '.join(self._shape(f.size_in(i)) for i in range(f.n_in())) or 'no input'}), "
                "found values without it only"
            )
        size = next(iter(sizes.values()))
        workers = _processors() if threads is None else count("threads", threads)
        results = self._outputs(size, kind, out)
        views = [self._view(y, f.size_out(i)) for i, y in enumerate(results)]
        if size:
            self._evaluate([array for array, _ in arrays], views, workers)
        return results[0] if len(results) == 1 else tuple(results)

    def __reduce__(self) -> tuple[Any, ...]:
        return _again, (self.function, self.real, self.axis, self.compiler)

    def __repr__(self) -> str:
        how = "native" if self.is_native else "mapped"
        return f"<Batch of {self.function.name()}: {how}, {self.real}, axis {self.axis}>"

    def _input(self, i: int, value: ArrayLike) -> tuple[NDArray[Any], bool]:
        """An input as (batch, rows, columns), and whether all members share it."""
        name, shape = self.function.name_in(i), self.function.size_in(i)
        array = np.asarray(value)
        if array.dtype.kind not in "fiu":
            raise ValueError(f"{name}: expected an array of numbers, found dtype {array.dtype}")
        array = array.astype(_TYPES[self.real], copy=False)
        own = _own_shape(shape)
        if array.shape == own:
            return array.reshape(1, *shape), True
        rest = array.shape[1:] if self.axis == 0 else array.shape[:-1]
        if array.ndim == 0 or rest not in (own, shape, own or (1,)):
            raise ValueError(
                f"{name}: expected an array {self._shape(shape)}, or {own or '()'} for a value "
                f"that all members share, found {array.shape}; axis={-1 - self.axis} takes the "
                f"batch {'last' if self.axis == 0 else 'first'}"
            )
        return self._view(array, shape), False

    def _view(self, array: NDArray[Any], shape: tuple[int, int]) -> NDArray[Any]:
        """An array as (batch, rows, columns), in the memory that it has."""
        array = np.moveaxis(array, self.axis, 0)
        while array.ndim < 3:
            array = array[..., np.newaxis]
        return array

    def _shape(self, shape: tuple[int, int]) -> str:
        """Shape of the array of an input or output, in words."""
        own = [str(length) for length in _own_shape(shape)]
        names = ["batch", *own] if self.axis == 0 else [*own, "batch"]
        return f"({', '.join(names)}{',' if len(names) == 1 else ''})"

    def _outputs(
        self, size: int, kind: type[np.floating[Any]], out: Sequence[NDArray[Any]] | None
    ) -> list[NDArray[Any]]:
        """Arrays for the results: new ones, or those that were given."""
        f = self.function
        shapes = []
        for i in range(f.n_out()):
            own = _own_shape(f.size_out(i))
            shapes.append((size, *own) if self.axis == 0 else (*own, size))
        if out is None:
            return [
                (np.empty if f.sparsity_out(i).is_dense() else np.zeros)(shape, kind)
                for i, shape in enumerate(shapes)
            ]
        if len(out) != len(shapes):
            raise ValueError(f"out: expected {len(shapes)} arrays, found {len(out)}")
        for i, (array, shape) in enumerate(zip(out, shapes, strict=True)):
            if not isinstance(array, np.ndarray) or array.shape != shape or array.dtype != kind:
                found = getattr(array, "shape", array), getattr(array, "dtype", "")
                raise ValueError(
                    f"out[{i}]: expected an array of shape {shape} and dtype {np.dtype(kind)}, "
                    f"found {found[0]} {found[1]}"
                )
            if not array.flags.writeable:
                raise ValueError(f"out[{i}]: expected an array that may be written")
            if not f.sparsity_out(i).is_dense():
                array[...] = 0
        return list(out)


def compile_batch(
    f: ca.Function, real: Real = "double", *, axis: Literal[0, -1] = 0, compiler: str = "g++"
) -> Batch:
    """`f` over batches of numpy arrays, as native code that evaluates a wing in each vector lane.

    The C that CasADi generates is compiled for the vector registers of this machine: eight wings at
    once in double precision and sixteen in single precision with AVX-512. Poses, Jacobians, forward
    dynamics, steps of simulations, sensors and steps of filters are such Functions. The library is
    cached as that of `compile_function`.

    Parameters
    ----------
    f : casadi.Function
        A Function without free symbols, of arithmetic, comparisons and selection (`if_else`), sqrt,
        exp, trigonometric functions and their inverses, the linear solver 'ldl', `map`, `fold` and
        branches in two ways. Other functions of libm, solvers, callbacks and Functions that are
        compiled already are refused.
    real : {"double", "float"}
        Arithmetic. Single precision is up to twice as fast; numbers below the smallest normal one
        then count as zero.
    axis : {0, -1}
        Whether the batch is the first or the last axis of arrays. Last is a little faster.
    compiler : str
        Name or path of a C++ compiler that takes the options of gcc.

    Returns
    -------
    Batch
        To be called with an array for each input; it may be pickled for another process. Results
        are those of the virtual machine but for rounding. A member that is NaN, or infinite, leaves
        the others as they are. Without a compiler it is CasADi's `map` in the virtual machine, and
        a warning says so.

    Raises
    ------
    ValueError
        If `f` has free symbols, or a part that does not work on lanes; the message names it.
    RuntimeError
        If the compiler fails.
    """
    instance("f", f, ca.Function)
    choice("real", real, tuple(_TYPES))
    choice("axis", axis, (0, -1))
    refuse_foreign(f)
    lanes.refuse(f)
    is_native = shutil.which(compiler) is not None
    if not is_native:
        warnings.warn(
            f"compile_batch: found no {compiler!r} on the PATH, so {f.name()!r} is mapped in "
            "CasADi's virtual machine; Debian: apt-get install g++",
            stacklevel=2,
        )
    evaluate = native(f, real, compiler) if is_native else mapped(f)
    return Batch(
        function=f, real=real, axis=axis, is_native=is_native, compiler=compiler, _evaluate=evaluate
    )


def _own_shape(shape: tuple[int, int]) -> tuple[int, ...]:
    """Shape of the array of one member: () of a scalar, (n,) of a column, (rows, columns)."""
    rows, columns = shape
    return (rows, columns) if columns != 1 else () if rows == 1 else (rows,)


def _again(f: ca.Function, real: Real, axis: Literal[0, -1], compiler: str) -> Batch:
    return compile_batch(f, real, axis=axis, compiler=compiler)


def _processors() -> int:
    """Processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
