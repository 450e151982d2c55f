"""Many cases of one function: on the processors of this machine, or of many by dask.distributed."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from curvcasadi.symbolic.batch import Batch
from curvcasadi.symbolic.expressions import Array, count
from curvcasadi.symbolic.fleet import Chunk, on_dask, on_processes
from curvcasadi.symbolic.sweep_record import Record


@dataclass(frozen=True, eq=False, kw_only=True)
class Sweep:
    """What a function made of each case.

    Attributes
    ----------
    cases : array or tuple
        The cases, in the order of the results.
    results : tuple
        Result of each case; None where it failed.
    errors : dict of int to str
        Why a case failed, by its index: the exception, or that the process died.
    """

    cases: Any
    results: tuple[Any, ...]
    errors: dict[int, str]

    @property
    def success(self) -> bool:
        """Whether no case failed."""
        return not self.errors

    @property
    def array(self) -> Array:
        """Results that are arrays of one shape, a row a case; NaN where a case failed."""
        shapes = {np.shape(result) for i, result in enumerate(self.results) if i not in self.errors}
        if len(shapes) != 1:
            raise ValueError(
                f"results: expected arrays of one shape, found {sorted(shapes) or 'none'}"
            )
        rows = np.full((len(self.results), *shapes.pop()), np.nan)
        for i, result in enumerate(self.results):
            if i not in self.errors:
                rows[i] = result
        return rows

    def __repr__(self) -> str:
        return f"<Sweep of {len(self.results)} cases: {len(self.errors)} failed>"


def sweep(
    function: Callable[..., Any],
    cases: Any,
    client: Any = None,
    *,
    batched: bool | None = None,
    chunk: int | None = None,
    processes: int | None = None,
    record: str | Path | None = None,
    progress: bool = True,
) -> Sweep:
    """A function of each of many cases, in processes of this machine or of many.

    Cases travel in chunks. An exception ends one case, not the others: the cases of its chunk run
    again one by one, and the error of each that fails stands in the result. So it is with a case
    at which a process dies; the chunks of a worker that is lost run again elsewhere.

    Parameters
    ----------
    function : callable or Batch
        `function(case)`. A `Batch` takes whole chunks: a row of `cases` holds its inputs one after
        another, matrices by columns, and its result is the output, or the tuple of outputs. A
        result of it that is not finite counts as a failure.
    cases : array or sequence
        A case a row of an array, or an entry of a sequence.
    client : distributed.Client, optional
        Client of a dask cluster, which runs the chunks; the extra `fleet` installs it. Without
        one, processes of this machine do.
    batched : bool, optional
        Whether `function` takes a chunk of cases, and returns a result for each. By default a
        `Batch` does.
    chunk : int, optional
        Cases of a chunk; by default so many that each process has some chunks.
    processes : int, optional
        Processes of this machine; by default one for each processor that is free to use.
    record : str or Path, optional
        File that keeps the results as they come. With the same function and cases a sweep that was
        interrupted goes on from there, and failed cases run again. It holds pickled objects: open
        files of your own only.
    progress : bool
        Show a bar of finished cases.

    Returns
    -------
    Sweep
        Results in the order of the cases, and what failed.

    Raises
    ------
    ValueError
        If there are no cases, or `record` is that of another sweep.
    ImportError
        If there is a `client` but no dask.distributed.
    """
    from tqdm import tqdm

    if not callable(function):
        raise ValueError(f"function: expected a callable, found {function!r}")
    rows = _rows(cases)
    whole = isinstance(function, Batch) if batched is None else batched
    evaluate = _OfRows(function, rows) if isinstance(function, Batch) else function
    workers = count("processes", processes) if processes is not None else _processors()
    size = count("chunk", chunk) if chunk is not None else _chunk(len(rows), workers, whole)
    kept = Record.open(record, function, rows) if record is not None else None
    results: dict[int, Any] = dict(kept.results) if kept is not None else {}
    missing = [i for i in range(len(rows)) if i not in results]
    errors: dict[int, str] = {}
    chunks = [
        Chunk(tuple(missing[k : k + size]), [rows[i] for i in missing[k : k + size]])
        for k in range(0, len(missing), size)
    ]
    engine = on_processes if client is None else on_dask
    with tqdm(total=len(rows), initial=len(results), unit="case", disable=not progress) as bar:
        for outcome in engine(evaluate, chunks, whole, client if client is not None else workers):
            results |= outcome.results
            errors |= outcome.errors
            if kept is not None:
                kept.keep(outcome.results)
            bar.update(len(outcome.results) + len(outcome.errors))
    ordered = tuple(results.get(i) for i in range(len(rows)))
    return Sweep(cases=cases, results=ordered, errors=dict(sorted(errors.items())))


def _rows(cases: Any) -> list[Any]:
    try:
        rows = list(cases)
    except TypeError:
        raise ValueError(f"cases: expected an array or a sequence, found {cases!r}") from None
    if not rows:
        raise ValueError("cases: expected at least one case, found none")
    return rows


class _OfRows:
    """A Batch as a function of rows of numbers: (chunk, m) -> a result a row."""

    def __init__(self, batch: Batch, rows: Sequence[Any]) -> None:
        f = batch.function
        if batch.axis != 0:
            raise ValueError("function: expected a Batch with axis=0, found axis=-1")
        self.batch = batch
        self.shapes = [f.size_in(i) for i in range(f.n_in())]
        width = sum(r * c for r, c in self.shapes)
        found = {np.shape(row) for row in rows}
        if found != {(width,)} and not (width == 1 and found == {()}):
            inputs = ", ".join(f"{f.name_in(i)} {r * c}" for i, (r, c) in enumerate(self.shapes))
            raise ValueError(
                f"cases: expected rows of {width} numbers ({inputs}), found shape"
                f"{'' if len(found) == 1 else 's'} {', '.join(map(str, sorted(found)))}"
            )

    def __call__(self, rows: Sequence[Any]) -> list[Any]:
        table = np.asarray(rows, dtype=float).reshape(len(rows), -1)
        parts = np.split(table, np.cumsum([r * c for r, c in self.shapes])[:-1], axis=1)
        inputs = [
            part.reshape(len(rows), c, r).swapaxes(1, 2)
            for part, (r, c) in zip(parts, self.shapes, strict=True)
        ]
        outputs = self.batch(*(a[..., 0] if a.shape[2] == 1 else a for a in inputs))
        outputs = outputs if isinstance(outputs, tuple) else (outputs,)
        rows_out = [tuple(output[k] for output in outputs) for k in range(len(rows))]
        return [self._finite(row[0] if len(row) == 1 else row) for row in rows_out]

    def _finite(self, result: Any) -> Any:
        """A result, or what is not finite of it as an error."""
        parts = result if isinstance(result, tuple) else (result,)
        names = self.batch.function.name_out()
        bad = [n for n, part in zip(names, parts, strict=True) if not np.all(np.isfinite(part))]
        return ArithmeticError(f"not finite: {', '.join(bad)}") if bad else result


def _chunk(cases: int, workers: int, batched: bool) -> int:
    """Cases of a chunk: some chunks for each process; of batches enough to fill the lanes."""
    share = -(-cases // (4 * workers))
    return min(max(share, 64), 4096) if batched else share


def _processors() -> int:
    """Processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
