"""What runs the chunks of a sweep: processes of this machine, or dask.distributed.

Both yield what came of each chunk as it comes, and both find the case that ends a process: a chunk
whose process died runs again case by case, and a case whose process dies once more has failed.
"""

from __future__ import annotations

import multiprocessing
import pickle
import signal
from collections import Counter, deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from importlib import import_module
from multiprocessing.connection import Connection, wait
from typing import Any

#: How often a single case may lose its process, which something else may have ended.
ATTEMPTS = 2


@dataclass(frozen=True)
class Chunk:
    """Cases that travel together, and their indices."""

    indices: tuple[int, ...]
    rows: Sequence[Any]

    def alone(self) -> list[Chunk]:
        """A chunk for each case."""
        return [Chunk((i,), [row]) for i, row in zip(self.indices, self.rows, strict=True)]


@dataclass(frozen=True)
class Outcome:
    """Results and errors by the index of the case."""

    results: dict[int, Any] = field(default_factory=dict)
    errors: dict[int, str] = field(default_factory=dict)


def evaluated(function: Callable[..., Any], chunk: Chunk, batched: bool) -> Outcome:
    """What `function` makes of a chunk; an exception is the error of its case alone."""
    values: Sequence[Any]
    together = batched and len(chunk.rows) > 1
    try:
        values = _checked(function(chunk.rows), len(chunk.rows)) if together else ()
    except Exception:
        together = False
    if not together:
        values = [_alone(function, row, batched) for row in chunk.rows]
    pairs = list(zip(chunk.indices, values, strict=True))
    return Outcome(
        {i: value for i, value in pairs if not isinstance(value, Exception)},
        {i: _words(value) for i, value in pairs if isinstance(value, Exception)},
    )


def _alone(function: Callable[..., Any], row: Any, batched: bool) -> Any:
    """The result of a case, or its exception."""
    try:
        return _checked(function([row]), 1)[0] if batched else function(row)
    except Exception as error:
        return error


def _checked(values: Any, size: int) -> Sequence[Any]:
    if not hasattr(values, "__len__") or len(values) != size:
        raise ValueError(f"function: expected a result for each of {size} cases, found {values!r}")
    return values  # type: ignore[no-any-return]


def _words(error: BaseException) -> str:
    return f"{type(error).__name__}: {error}" if str(error) else type(error).__name__


# Processes of this machine -----------------------------------------------------------------------


def on_processes(
    function: Callable[..., Any], chunks: Sequence[Chunk], batched: bool, processes: int
) -> Iterator[Outcome]:
    """Outcomes of chunks from as many `processes`, each of which works on one chunk at a time.

    Where processes are forked, the function need not be picklable.
    """
    methods = multiprocessing.get_all_start_methods()
    context: Any = multiprocessing.get_context("fork" if "fork" in methods else None)
    waiting, lost = deque(chunks), Counter[int]()
    busy: dict[Any, tuple[Any, Chunk]] = {}

    def start(process: Any = None, connection: Any = None) -> None:
        """Hand the next chunk to a process, to a new one where there is none."""
        if process is None:
            connection, other = context.Pipe()
            copied = [connection, *busy] if context.get_start_method() == "fork" else []
            arguments = (other, function, batched, copied)
            process = context.Process(target=_serve, args=arguments, daemon=True)
            process.start()
            other.close()
        chunk = waiting.popleft()
        busy[connection] = process, chunk
        try:
            connection.send(chunk)
        except OSError:  # it ended meanwhile, which is met where its answer is awaited
            pass

    try:
        while waiting or busy:
            while waiting and len(busy) < processes:
                start()
            ready: Any = wait(list(busy))
            for connection in ready:
                process, chunk = busy.pop(connection)
                try:
                    outcome = connection.recv()
                except (EOFError, OSError):
                    process.join()
                    yield from _after_a_death(
                        chunk, waiting, lost, f"its process ended with exit code {process.exitcode}"
                    )
                    continue
                if waiting:
                    start(process, connection)
                else:
                    connection.close()
                yield outcome
    finally:
        for process, _ in busy.values():
            process.kill()


def _serve(
    connection: Connection,
    function: Callable[..., Any],
    batched: bool,
    copied: Sequence[Connection],
) -> None:
    """Evaluate chunks until nobody sends any, which `copied` ends would keep others from seeing."""
    for end in copied:
        end.close()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent ends at Ctrl-C, and this with it
    while True:
        try:
            chunk = connection.recv()
        except EOFError:
            return
        outcome = evaluated(function, chunk, batched)
        try:
            connection.send(outcome)
        except (pickle.PicklingError, AttributeError, TypeError) as error:
            said = f"its result does not travel between processes: {_words(error)}"
            connection.send(Outcome(errors=dict.fromkeys(chunk.indices, said)))


def _after_a_death(
    chunk: Chunk, waiting: deque[Chunk], lost: Counter[int], why: str
) -> Iterator[Outcome]:
    """Put the cases of a lost chunk back, one by one; yield the one that was lost too often."""
    for one in chunk.alone():
        (i,) = one.indices
        lost[i] += len(chunk.indices) == 1
        if lost[i] < ATTEMPTS:
            waiting.append(one)
        else:
            yield Outcome(errors={i: why})


# dask.distributed --------------------------------------------------------------------------------


def on_dask(
    function: Callable[..., Any], chunks: Sequence[Chunk], batched: bool, client: Any
) -> Iterator[Outcome]:
    """Outcomes of chunks from a dask cluster, which runs those of lost workers again."""
    try:
        cloudpickle, distributed = map(import_module, ("cloudpickle", "distributed"))
    except ImportError as missing:
        raise ImportError(
            'client: sweep needs dask.distributed for it: pip install "curvcasadi[fleet]"'
        ) from missing
    if not isinstance(client, distributed.Client):
        raise ValueError(f"client: expected a distributed.Client, found {client!r}")
    payload = cloudpickle.dumps((function, batched))
    waiting, lost = deque(chunks), Counter[int]()
    futures: dict[Any, Chunk] = {}
    finished = distributed.as_completed()

    def submit() -> None:
        while waiting:
            chunk = waiting.popleft()
            future = client.submit(_evaluated_there, payload, chunk, pure=False)
            futures[future] = chunk
            finished.add(future)

    submit()
    try:
        for future in finished:
            chunk = futures.pop(future)
            error = future.exception() if future.status == "error" else None
            if future.status == "finished":
                yield future.result()
            elif isinstance(error, distributed.KilledWorker) or error is None:
                yield from _after_a_death(chunk, waiting, lost, "its workers were lost")
                submit()
            else:
                yield Outcome(errors=dict.fromkeys(chunk.indices, _words(error)))
    finally:
        client.cancel(list(futures))


def _evaluated_there(payload: bytes, chunk: Chunk) -> Outcome:
    """`evaluated`, on a worker of a cluster."""
    function, batched = _unpacked(payload)
    return evaluated(function, chunk, batched)


@lru_cache(maxsize=4)
def _unpacked(payload: bytes) -> tuple[Callable[..., Any], bool]:
    """A function is unpacked once on a worker, which for a `Batch` compiles it."""
    function, batched = pickle.loads(payload)
    return function, batched
