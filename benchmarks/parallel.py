"""Independent elements (the paper's section 3.2): what evaluating in parallel brings."""

from __future__ import annotations

import os

import casadi as ca
import numpy as np

import curvcasadi as cc
from benchmarks.contender import batch_weights
from benchmarks.table import Table, compared
from benchmarks.timing import seconds
from curvcasadi.beam.pose import unpack_pose
from curvcasadi.kinematics import chain
from curvcasadi.kinematics.pose_function import Form
from curvcasadi.symbolic.expressions import Array
from tests.support.wing import WEIGHTS, wing

SAMPLES = 1000


def many_weights() -> Table:
    """`map` over many weight vectors against a loop of calls."""
    beam, batch = wing(16), batch_weights(SAMPLES)
    rows = []
    forms: tuple[Form, ...] = ("unrolled", "compact")
    for form in forms:
        for jacobian in (False, True):
            tip = cc.tip_function(beam, form=form, jacobian=jacobian)
            name = f"pose{' and Jacobian' if jacobian else ''}, {form}"
            rows.append((name, *_speedups(tip, batch)))
    headers = ("of", "loop of f(q)", "map serial", f"map thread, {_threads()}", "map openmp")
    notes = (
        f"Speed over a Python loop of calls, {SAMPLES} weight vectors, 16 magnus4 elements, ratios",
        "of one run: what time histories and sampling gain. CasADi's threads start at every call.",
    )
    return compared(f"`map` over {SAMPLES} weight vectors", headers, rows, notes)


def _speedups(tip: ca.Function, batch: Array) -> tuple[str, ...]:
    columns = [ca.DM(column) for column in batch.T]
    loop = seconds(lambda: [tip(q) for q in columns])
    stacked = ca.DM(batch)
    serial = loop / seconds(tip.map(SAMPLES), stacked)
    thread = loop / seconds(tip.map(SAMPLES, "thread", _threads()), stacked)
    if "WITH_OPENMP" in ca.CasadiMeta.compiler_flags():
        openmp = f"{loop / seconds(tip.map(SAMPLES, 'openmp'), stacked):.1f}"
    else:
        openmp = "not in this build"
    return "1", f"{serial:.1f}", f"{thread:.1f}", openmp


def within_one_wing() -> Table:
    """Element exponentials by `map`, composed as a tree of products, against the chain."""
    rows = [_one_wing_row(elements) for elements in (32, 128, 512)]
    headers = (
        "magnus4 elements",
        "chain, unrolled",
        "chain, compact",
        "map serial, tree",
        f"map thread {_threads()}, tree",
        "largest difference of the tips",
    )
    notes = (
        "Time of one tip pose over that of the unrolled chain, of one run (above 1: slower). Map",
        "and tree: all element poses at once by `map`, with threads in the last but one column,",
        "then log2(N) levels of pairwise products. An element is too little work for a thread.",
    )
    return compared("Independent elements within one wing", headers, rows, notes)


def _one_wing_row(elements: int) -> tuple[str, ...]:
    beam, q = wing(elements), ca.DM(WEIGHTS)
    ways = [
        cc.tip_function(beam, form="unrolled"),
        cc.tip_function(beam, form="compact"),
        tree(beam, "serial"),
        tree(beam, "thread"),
    ]
    times = [seconds(way, q) for way in ways]
    tips = [way.call([q])[0].full() for way in ways]
    difference = max(float(np.abs(tip - tips[0]).max()) for tip in tips)
    return (
        str(elements),
        *(f"{time / times[0]:.2f}" for time in times),
        f"{difference:.0e} m",
    )


def tree(beam: cc.Beam, mode: str) -> ca.Function:
    """Tip position: element poses by `map`, then pairs of poses multiplied until one is left."""
    beam_chain = chain.build(beam, (1.0,))
    n = len(beam_chain.data)
    q = ca.MX.sym("q", beam.basis.n)
    element = chain.pose_step(beam_chain.pattern)
    mapped = element.map(n, mode, _threads()) if mode == "thread" else element.map(n)
    poses = mapped(
        ca.repmat(q, 1, n), ca.repmat(chain.IDENTITY, 1, n), ca.horzcat(*beam_chain.data)
    )
    product = _product()
    while n > 1:
        n //= 2  # the numbers of elements are powers of two
        poses = product.map(n)(poses[:, ::2], poses[:, 1::2])
    return ca.Function("tip", [q], [poses[9:12]])


def _product() -> ca.Function:
    """(R, p) (R', p') = (R R', p + R p'), each packed as (vec R, p)."""
    left, right = ca.SX.sym("left", 12), ca.SX.sym("right", 12)
    (r, p), (r_next, p_next) = unpack_pose(left), unpack_pose(right)
    return ca.Function("product", [left, right], [ca.veccat(r @ r_next, p + r @ p_next)])


def _threads() -> int:
    return os.cpu_count() or 1
