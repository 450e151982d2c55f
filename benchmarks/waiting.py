"""What users wait for: the import of the package, and numeric shapes from Python."""

from __future__ import annotations

import gc
import os
import resource
import subprocess
import sys
import tempfile
import time
import weakref
from collections.abc import Callable
from statistics import median
from typing import Any

import casadi as ca
import numpy as np

import curvcasadi as cc
from benchmarks.table import Check, Table, checked, compared
from curvcasadi.beam.quadrature import lobatto_points
from curvcasadi.kinematics import chain
from tests.support.wing import WEIGHTS, wing

#: Rounds of an interleaved comparison, of which the median counts.
ROUNDS = 15


def memory() -> Table:
    """Beams that are alive after they were used and dropped."""
    references = []
    for _ in range(100):
        beam = wing(4)
        cc.shape_map(beam, WEIGHTS)
        cc.pose_at(beam, WEIGHTS, 0.3)
        cc.body_jacobian(beam, WEIGHTS)
        references.append(weakref.ref(beam))
    del beam
    gc.collect()
    alive = sum(reference() is not None for reference in references)
    what = "beams alive after 100 were built, used and dropped"
    return checked("Memory", [Check(what=what, value=alive, high=0, form="{:.0f}")])


def ratios() -> Table:
    """Times over that of a cached Function of all stations, and of the import."""
    beam, q = wing(16), ca.DM(WEIGHTS)
    every = cc.pose_function("every", beam, beam.stations)
    stations = iter(np.random.default_rng(0).uniform(0.3, 0.7, 100 * ROUNDS))

    def reference() -> Any:
        return every(q)

    rows = [
        ("import curvcasadi over import casadi, numpy", _import_ratio(), "2.2"),
        ("numeric shape_map", _ratio(lambda: cc.shape_map(beam, q), reference), "3"),
        ("numeric pose_at(0.5)", _ratio(lambda: cc.pose_at(beam, q, 0.5), reference), "3"),
        (
            "pose_at, first call at a new station, over a call of each element",
            _ratio(
                lambda: cc.pose_at(beam, q, next(stations)),
                lambda: _by_calls(beam, q, next(stations)),
                calls=3,
            ),
            "1",
        ),
        (
            "numeric body_jacobian over a cached Function of the tip's pose and Jacobian",
            _ratio(lambda: cc.body_jacobian(beam, q), _with_jacobian(beam, q)),
            "",
        ),
        (
            "Lobatto points of 200 elements over those of 16",
            _ratio(
                lambda: lobatto_points.__wrapped__(200),
                lambda: lobatto_points.__wrapped__(16),
                calls=5,
            ),
            "20",
        ),
    ]
    return compared(
        "Waiting: ratios of processor times, 16 magnus4 elements, 12 weights",
        ("what", "ratio", "at most"),
        [(what, f"{value:.2f}", limit) for what, value, limit in rows],
        (
            "Shapes are compared with a cached Function of the poses of all 17 stations. Imports",
            "are whole processes with compiled bytecode.",
        ),
    )


def _with_jacobian(beam: cc.Beam, q: ca.DM) -> Callable[[], Any]:
    tip = cc.tip_function(beam, jacobian=True)
    return lambda: tip(q)


def _by_calls(beam: cc.Beam, q: ca.DM, xi: float) -> ca.DM:
    """Pose at a station by numeric calls of each element, as if nothing but the steps were kept."""
    to_station = chain.build(beam, (xi,), boundaries=beam.stations)
    angles = chain.build(beam, (1.0,), boundaries=beam.stations)
    squared = chain.squared_angle(angles.pattern)
    ca.horzcat(*(squared(q, data) for data in angles.data))
    (state,) = to_station.march([chain.pose_step(to_station.pattern)], beam.root.packed, q)
    return state


def _ratio(call: Callable[[], Any], reference: Callable[[], Any], calls: int = 40) -> float:
    """Median of the ratios of interleaved rounds."""
    call(), reference()
    return median(_seconds(call, calls) / _seconds(reference, calls) for _ in range(ROUNDS))


def _seconds(call: Callable[[], Any], calls: int) -> float:
    start = time.process_time()
    for _ in range(calls):
        call()
    return time.process_time() - start


def _import_ratio() -> float:
    """Least processor times of whole processes, the bytecode compiled before."""
    with tempfile.TemporaryDirectory() as folder:
        own, base = (
            min(_process(code, folder) for _ in range(6))
            for code in ("import curvcasadi", "import casadi, numpy")
        )
    return own / base


def _process(code: str, bytecode: str) -> float:
    environment = {**os.environ, "PYTHONPYCACHEPREFIX": bytecode}
    environment.pop("PYTHONDONTWRITEBYTECODE", None)
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([sys.executable, "-c", code], env=environment, check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
