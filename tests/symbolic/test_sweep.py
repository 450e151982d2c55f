"""Sweeps: no case is lost, whatever happens to the others or to the processes."""

from __future__ import annotations

import os
import shutil
import signal
import time

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_array_equal

import curvcasadi as cc

needs_compiler = pytest.mark.skipif(shutil.which("g++") is None, reason="compiles C++")
QUIET = {"progress": False}


def square(x):
    return x**2


def test_results_stand_in_the_order_of_the_cases():
    result = cc.sweep(square, np.arange(50.0), processes=2, **QUIET)
    assert result.success
    assert_array_equal(result.array, np.arange(50.0) ** 2)
    assert repr(result) == "<Sweep of 50 cases: 0 failed>"


def test_cases_may_be_of_any_kind_and_functions_without_a_name():
    offset = 3
    cases = [{"a": 1}, {"a": 2, "b": "text"}]
    result = cc.sweep(lambda case: (len(case) + offset, case), cases, processes=1, **QUIET)
    assert result.results == ((4, cases[0]), (5, cases[1]))


def test_a_failed_case_is_reported_and_the_others_are_there():
    def inverse(x):
        if x == 7:
            raise ZeroDivisionError("no inverse of seven")
        return 1 / (x - 7)

    result = cc.sweep(inverse, np.arange(20.0), processes=2, chunk=5, **QUIET)
    assert result.errors == {7: "ZeroDivisionError: no inverse of seven"}
    assert not result.success
    assert result.results[7] is None
    assert np.isnan(result.array[7])
    assert_array_equal(np.delete(result.array, 7), 1 / (np.delete(np.arange(20.0), 7) - 7))


@pytest.mark.parametrize("batched", [False, True])
def test_a_case_that_ends_its_process_is_found(batched):
    def deadly(x):
        if np.any(np.asarray(x) == 11):
            os.kill(os.getpid(), signal.SIGKILL)
        return [2 * value for value in x] if batched else 2 * x

    result = cc.sweep(deadly, np.arange(24.0), processes=2, chunk=4, batched=batched, **QUIET)
    assert result.errors == {11: "its process ended with exit code -9"}
    assert_array_equal(np.delete(result.array, 11), 2 * np.delete(np.arange(24.0), 11))


def test_a_process_that_is_ended_from_outside_loses_no_case(tmp_path):
    flag = tmp_path / "killed"

    def once(x):
        if x == 3 and not flag.exists():
            flag.touch()
            os.kill(os.getpid(), signal.SIGKILL)
        return x

    assert cc.sweep(once, range(12), processes=2, chunk=1, **QUIET).results == tuple(range(12))


def test_results_that_do_not_travel_are_errors_of_their_cases():
    result = cc.sweep(lambda x: lambda: x, [1, 2], processes=1, **QUIET)
    assert set(result.errors) == {0, 1}
    assert "does not travel between processes" in result.errors[0]


# Batches -----------------------------------------------------------------------------------------


def shapes():
    x, y = ca.SX.sym("x", 2, 3), ca.SX.sym("y", 2)
    return ca.Function("shapes", [x, y], [x.T @ y, ca.sqrt(y[0])], ["x", "y"], ["a", "root"])


@needs_compiler
def test_a_batch_takes_rows_of_its_inputs_and_names_what_is_not_finite(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    f = shapes()
    rows = np.random.default_rng(0).uniform(0.1, 1, (200, 8))
    rows[77, 6] = -1
    result = cc.sweep(cc.compile_batch(f), rows, processes=2, **QUIET)
    assert result.errors == {77: "ArithmeticError: not finite: root"}
    for k in (0, 199):
        a, root = f(rows[k, :6].reshape(3, 2).T, rows[k, 6:])
        np.testing.assert_allclose(result.results[k][0], a.full()[:, 0], rtol=1e-14)
        np.testing.assert_allclose(result.results[k][1], float(root), rtol=1e-14)
    with pytest.raises(ValueError, match=r"cases: expected rows of 8 numbers \(x 6, y 2\), found"):
        cc.sweep(cc.compile_batch(f), rows[:, :7], **QUIET)
    with pytest.raises(ValueError, match="function: expected a Batch with axis=0"):
        cc.sweep(cc.compile_batch(f, axis=-1), rows, **QUIET)


def test_an_exception_in_a_chunk_is_that_of_one_case():
    def doubled(rows):
        if 5 in rows:
            raise RuntimeError("five")
        return [2 * row for row in rows]

    result = cc.sweep(doubled, range(9), batched=True, chunk=9, processes=1, **QUIET)
    assert result.errors == {5: "RuntimeError: five"}
    assert result.results[8] == 16
    result = cc.sweep(lambda rows: rows[1:], range(4), batched=True, processes=1, **QUIET)
    assert "expected a result for each of 1 cases" in result.errors[0]


# Records -----------------------------------------------------------------------------------------


def test_a_sweep_goes_on_from_its_record(tmp_path):
    calls, record = tmp_path / "calls", tmp_path / "study.sqlite"

    def logged(x):
        with calls.open("a") as file:
            file.write(f"{x}\n")
        if x == 4 and calls.read_text().count("\n") < 12:
            raise RuntimeError("not yet")
        return -x

    options = {"processes": 1, "record": record, **QUIET}
    first = cc.sweep(logged, range(10), **options)
    assert first.errors == {4: "RuntimeError: not yet"}
    calls.write_text("\n" * 12)
    again = cc.sweep(logged, range(10), **options)
    assert again.results == tuple(-x for x in range(10))
    assert calls.read_text().split() == ["4"]
    with pytest.raises(ValueError, match="record: expected the file of this sweep, found other ca"):
        cc.sweep(logged, range(11), **options)
    with pytest.raises(ValueError, match="found other function in"):
        cc.sweep(square, range(10), **options)


def test_what_is_written_outlives_an_interrupted_sweep(tmp_path):
    record = tmp_path / "study.sqlite"

    def slow_end(x):
        if x >= 6:
            time.sleep(3)
        return x

    pid = os.fork()
    if pid == 0:
        try:
            cc.sweep(slow_end, range(8), processes=2, chunk=1, record=record, **QUIET)
        finally:
            os._exit(1)
    deadline = time.monotonic() + 30
    while time.monotonic() < deadline and _finished(record) < 6:
        time.sleep(0.05)
    os.kill(pid, signal.SIGKILL)
    os.waitpid(pid, 0)
    assert _finished(record) == 6


def _finished(record):
    import sqlite3

    try:
        with sqlite3.connect(record) as database:
            return database.execute("SELECT COUNT(*) FROM results").fetchone()[0]
    except sqlite3.Error:
        return 0


# dask.distributed --------------------------------------------------------------------------------


def slow_root(x):
    time.sleep(0.05)
    if x == 13:
        raise ValueError("unlucky")
    return float(np.sqrt(x))


@pytest.mark.filterwarnings("ignore")
def test_a_killed_worker_of_a_cluster_loses_no_case(tmp_path):
    distributed = pytest.importorskip("distributed")
    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, dashboard_address=None, local_directory=tmp_path
        ) as cluster,
        distributed.Client(cluster) as client,
    ):
        victim = next(iter(client.run(os.getpid).values()))
        started = time.monotonic()
        killer = client.submit(_kill, victim, 0.4, pure=False, workers=[_other(client, victim)])
        result = cc.sweep(slow_root, np.arange(60.0), client, chunk=3, **QUIET)
        assert time.monotonic() - started > 0.4
        assert victim not in client.run(os.getpid).values()
        del killer
    assert result.errors == {13: "ValueError: unlucky"}
    assert_array_equal(np.delete(result.array, 13), np.sqrt(np.delete(np.arange(60.0), 13)))


def _other(client, victim):
    return next(address for address, pid in client.run(os.getpid).items() if pid != victim)


def _kill(pid, delay):
    time.sleep(delay)
    os.kill(pid, signal.SIGKILL)


def test_a_client_without_dask_names_the_extra(monkeypatch):
    import sys

    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(ImportError, match=r'pip install "curvcasadi\[fleet\]"'):
        cc.sweep(square, [1.0], client="tcp://scheduler:8786", **QUIET)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"function": 3}, "function: expected a callable, found 3"),
        ({"cases": 3.0}, "cases: expected an array or a sequence, found 3.0"),
        ({"cases": np.zeros((0, 2))}, "cases: expected at least one case, found none"),
        ({"processes": 0}, "processes: expected a whole number of at least 1"),
        ({"chunk": 1.5}, "chunk: expected a whole number of at least 1"),
        ({"record": "/no/such/folder/record"}, "record: expected the file of a sweep, found"),
        ({"record": __file__}, "record: expected the file of a sweep, found"),
    ],
)
def test_arguments_are_checked(arguments, message):
    with pytest.raises(ValueError, match=message):
        cc.sweep(**{"function": square, "cases": [1.0], **QUIET, **arguments})


def test_results_of_different_shapes_are_no_array():
    result = cc.sweep(np.ones, [2, 3], processes=1, **QUIET)
    with pytest.raises(ValueError, match=r"results: expected arrays of one shape, found"):
        _ = result.array
