"""Equations of motion: nodes, generated C, exactness, frequencies, and times beside a tip pose."""

from __future__ import annotations

import json
import shutil
from functools import lru_cache
from pathlib import Path

import casadi as ca
import numpy as np

import curvcasadi as cc
from benchmarks.generated_c import KIB, NO_GCC, compiled
from benchmarks.table import Check, Table, checked, compared
from benchmarks.timing import seconds
from curvcasadi.beam.basis import ChannelBasis
from curvcasadi.reference_wings import hale_wing
from curvcasadi.symbolic.expressions import AnyExpr, Array
from tests.support.lagrangian import lagrange_function

ELEMENTS = 16
WEIGHT = [cc.Gravity([0.0, 0.0, 9.80665])]
#: Weights of torsion, out-of-plane and in-plane bending, by their number.
COUNTS = {8: (2, 4, 2), 12: (4, 4, 4), 24: (8, 8, 8)}
REFERENCE = Path(__file__).parents[1] / "tests" / "reference"


def _wing(n: int) -> cc.Beam:
    return hale_wing(*COUNTS[n], grid=cc.Grid.lobatto(ELEMENTS))


def _symbols(n: int, kind: type, count: int = 3) -> list[AnyExpr]:
    return [kind.sym(name, n) for name in ("q", "q_dot", "q_ddot")[:count]]  # type: ignore[attr-defined]


@lru_cache(maxsize=16)
def _inverse(n: int, kind: type) -> ca.Function:
    x = _symbols(n, kind)
    return ca.Function("inverse", x, [cc.inverse_dynamics(_wing(n), *x, WEIGHT)], {"cse": True})


def _mass(n: int) -> ca.Function:
    (q,) = _symbols(n, ca.SX, 1)
    return ca.Function("mass", [q], [cc.mass_matrix(_wing(n), q)], {"cse": True})


@lru_cache(maxsize=16)
def _forward(n: int, kind: type) -> ca.Function:
    x = _symbols(n, kind, 2)
    return ca.Function("forward", x, [cc.forward_dynamics(_wing(n), *x, WEIGHT)], {"cse": True})


@lru_cache(maxsize=16)
def _derivative(n: int, form: str, small: bool = False) -> ca.Function:
    """(q, q_dot, q_ddot) -> the residual's derivatives by each."""
    f = cc.inverse_dynamics_function(_wing(n), WEIGHT, form=form, small=small)  # type: ignore[arg-type]
    return f.jacobian()


def nodes() -> Table:
    """Nodes of the unrolled equations of motion."""
    rows = [
        Check(
            what=f"inverse dynamics, {n} weights: nodes per element",
            value=_inverse(n, ca.SX).n_instructions() / ELEMENTS,
            high=high,
            form="{:.0f}",
        )
        for n, high in ((8, 950), (24, 1250))
    ]
    rows += [
        Check(
            what=f"mass matrix, {n} weights: nodes per element",
            value=_mass(n).n_instructions() / ELEMENTS,
            high=high,
            form="{:.0f}",
        )
        for n, high in ((8, 1400), (12, 2150), (24, 5600))
    ]
    forward = _forward(8, ca.SX).n_instructions()
    ratio = _derivative(8, "unrolled").n_instructions() / _inverse(8, ca.SX).n_instructions()
    rows += [
        Check(what="forward dynamics, 8 weights: nodes", value=forward, high=33_000, form="{:.0f}"),
        Check(
            what="full derivative, 8 weights: nodes over those of inverse dynamics",
            value=ratio,
            high=12,
            form="{:.1f}",
        ),
        Check(
            what="full derivative, of AD of Lagrange's equations: error",
            value=_error_of_derivative(),
            high=1e-13,
            form="{:.1e}",
        ),
    ]
    note = (
        f"HALE wing with gravity, {ELEMENTS} Lobatto elements of magnus4. The error on 4 elements."
    )
    return checked("Equations of motion: nodes", rows, (note,))


def _error_of_derivative() -> float:
    """Largest difference over the largest entry of each block."""
    beam = hale_wing(*COUNTS[8], grid=cc.Grid.lobatto(4))
    gravity = WEIGHT[0].acceleration
    rng = np.random.default_rng(0)
    values = [ca.DM(scale * rng.normal(size=8)) for scale in (0.03, 0.1, 0.3)]
    x = _symbols(8, ca.MX)
    functions = cc.inverse_dynamics_function(beam, WEIGHT), lagrange_function(beam, gravity)
    found, expected = (
        ca.Function("J", x, [ca.jacobian(f.call(x)[0], y) for y in x]).call(values)
        for f in functions
    )
    pairs = zip(found, expected, strict=True)
    return max(float(ca.mmax(ca.fabs(a - b)) / ca.mmax(ca.fabs(b))) for a, b in pairs)


def bytes_of_c() -> Table:
    """Generated C of the compact Functions."""
    title = f"Generated C of the equations of motion: 8 weights, {ELEMENTS} elements, gcc -Os"
    if not shutil.which("gcc"):
        return checked(title, [], (NO_GCC,))
    rows = (
        ("forward dynamics", _forward(8, ca.MX), 42),
        ("inverse dynamics", _inverse(8, ca.MX), 24),
        ("its derivative", _derivative(8, "compact"), 160),
        ("its derivative by reverse sweeps", _derivative(8, "compact", small=True), 72),
    )
    checks = []
    for what, f, high in rows:
        result = compiled(f, "-Os")
        size = result.text / KIB
        checks.append(Check(what=f"{what}: text, KiB", value=size, high=high, form="{:.1f}"))
        checks.append(Check(what=f"{what}: work doubles", value=result.work, form="{:.0f}"))
    return checked(title, checks)


def frequencies() -> Table:
    """Natural frequencies against exact values."""
    exact = json.loads((REFERENCE / "D01_cantilever_linear_frequencies.json").read_text())
    rows = exact["reference"]
    first = sorted([*rows["flap_exact"][:3], rows["torsion_exact"][0], rows["edge_exact"][0]])
    checks = [
        Check(
            what=f"D01, {what}: largest error of the first five, %",
            value=100 * float(np.max(np.abs(_cantilever(basis)[:5] / first - 1))),
            high=high,
            form="{:.3f}",
        )
        for what, basis, high in (
            ("six Legendre weights a channel", _channels(cc.Legendre(6), cc.Legendre(6)), 0.1),
            (
                "four FreeTip weights a channel",
                _channels(cc.FreeTip(4, order=1), cc.FreeTip(4)),
                0.15,
            ),
        )
    ]
    table = json.loads((REFERENCE / "D03_rotating_beam_southwell.json").read_text())["reference"]
    checks += [
        Check(
            what=f"D03, {n} weights: largest error, %",
            value=100 * max(_rotor_error(table, row, n) for row in ("flap_hub0", "flap_hub1")),
            high=high,
            form="{:.4f}",
        )
        for n, high in ((6, 0.3), (8, 0.01))
    ]
    return checked("Natural frequencies", checks)


def _channels(torsion: AnyExpr, bending: AnyExpr) -> ChannelBasis:
    return ChannelBasis(torsion=torsion, out_of_plane=bending, in_plane=bending)


def _cantilever(basis: ChannelBasis) -> Array:
    """Frequencies of the HALE wing without rotary inertia of bending, which exact values lack."""
    section = cc.Section(
        GJ=1e4, EI_y=2e4, EI_z=4e6, mass_per_length=0.75, inertia=np.diag([0.1, 0, 0])
    )
    grid = cc.Grid.lobatto(ELEMENTS)
    return cc.natural_frequencies(cc.Beam(length=16.0, basis=basis, grid=grid, section=section))


def _rotor_error(table: dict[str, dict[str, list[float]]], row: str, n: int) -> float:
    basis = ChannelBasis(out_of_plane=cc.Legendre(n))
    section = cc.Section(GJ=1, EI_y=1, EI_z=1, mass_per_length=1)
    beam = cc.Beam(length=1.0, basis=basis, grid=cc.Grid.lobatto(32), section=section)
    modes = [values for key, values in table[row].items() if key.startswith("lambda")]
    hub, worst = float(row == "flap_hub1"), 0.0
    for k, eta in enumerate(table[row]["eta"]):
        motion = cc.RootMotion(twist=[0, 0, eta, 0, eta * hub, 0])
        found = cc.natural_frequencies(beam, root=motion)
        worst = max(worst, *(abs(found[i] / mode[k] - 1) for i, mode in enumerate(modes)))
    return float(worst)


def times() -> Table:
    """Compiled equations of motion beside a compiled tip pose, in one run."""
    title = f"Compiled equations of motion: 8 weights, {ELEMENTS} elements, over a tip pose"
    if not shutil.which("gcc"):
        return compared(title, ("what", "ratio"), [], (NO_GCC,))
    (q,) = _symbols(8, ca.MX, 1)
    tip = ca.Function("tip", [q], [cc.shape_map(_wing(8), q).tip.position])
    forward = cc.forward_dynamics_function(_wing(8), WEIGHT)
    rows = (
        ("inverse dynamics", _inverse(8, ca.MX), ""),
        ("forward dynamics", _forward(8, ca.MX), "≤ 20"),
        ("derivative of forward dynamics", forward.jacobian(), "≤ 110"),
        ("derivative of inverse dynamics", _derivative(8, "compact"), ""),
        ("the same by reverse sweeps", _derivative(8, "compact", small=True), ""),
    )
    once = _seconds(tip)
    cells = [(what, f"{_seconds(f) / once:.1f}", limit) for what, f, limit in rows]
    return compared(title, ("what", "ratio", "asked for"), cells)


def _seconds(f: ca.Function) -> float:
    """Seconds of one call of the native code, without Python's own."""
    native = cc.compile_function(f, derivatives=0)
    buffer, evaluate = native.buffer()
    rng = np.random.default_rng(0)
    arrays = [0.01 * rng.normal(size=max(1, f.nnz_in(i))) for i in range(f.n_in())]
    results = [np.zeros(max(1, f.nnz_out(i))) for i in range(f.n_out())]
    for i, array in enumerate(arrays):
        buffer.set_arg(i, memoryview(array))
    for i, array in enumerate(results):
        buffer.set_res(i, memoryview(array))
    return seconds(evaluate)
