"""Ctrl-C ends a solve and the command, wherever they are."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading

import casadi as ca
import pytest

from curvcasadi.solvers.interrupt import solved

ENDLESS = {
    "print_time": False,
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
    "ipopt.max_iter": 10**6,
    "ipopt.tol": 1e-300,
    "ipopt.acceptable_iter": 0,
    "ipopt.hessian_approximation": "limited-memory",
}


def test_an_interrupted_solve_raises_and_leaves_the_signal_as_it_was():
    x = ca.MX.sym("x", 200)
    valley = ca.sumsqr(10 * (x[1:] - x[:-1] ** 2)) + ca.sumsqr(1 - x[:-1])
    nlp = ca.nlpsol("endless", "ipopt", {"x": x, "f": valley}, ENDLESS)
    handler = signal.getsignal(signal.SIGINT)
    threading.Timer(0.3, os.kill, (os.getpid(), signal.SIGINT)).start()
    with pytest.raises(KeyboardInterrupt):
        solved(nlp, x0=-1)
    assert signal.getsignal(signal.SIGINT) is handler


def test_an_error_of_a_solve_that_was_not_interrupted_stays_what_it_is():
    x = ca.MX.sym("x")
    nlp = ca.nlpsol("plain", "ipopt", {"x": x, "f": x**2}, ENDLESS | {"ipopt.tol": 1e-8})
    solution, stats = solved(nlp, x0=3)
    assert stats["success"]
    assert abs(float(solution["x"])) < 1e-8
    with pytest.raises(RuntimeError, match="nonsense"):
        solved(nlp, nonsense=1)


#: Sends Ctrl-C to itself as soon as CasADi is imported, which the package does on its way.
AT_IMPORT = """
import builtins, os, runpy, signal, sys
plain = builtins.__import__
def importing(name, *rest, **more):
    if name == "casadi":
        os.kill(os.getpid(), signal.SIGINT)
    return plain(name, *rest, **more)
builtins.__import__ = importing
sys.argv = ["curvcasadi", "--help"]
runpy.run_module("curvcasadi", run_name="__main__", alter_sys=False)
"""


def test_an_interrupted_import_of_the_command_ends_it_without_a_traceback():
    ended = subprocess.run(
        [sys.executable, "-c", AT_IMPORT], capture_output=True, text=True, check=False
    )
    assert (ended.returncode, ended.stdout) == (130, "")
    assert ended.stderr == "curvcasadi: error: interrupted\n"
