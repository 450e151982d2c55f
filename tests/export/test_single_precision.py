"""Solvers in single precision: what a model for it gives as C, called from Python."""

from __future__ import annotations

import ctypes
import re
import subprocess

import casadi as ca
import numpy as np
import pytest

import curvcasadi as cc

N, SAMPLES = 6, 200
FLOATS = ctypes.POINTER(ctypes.c_float)


def _wing(real="float"):
    two = cc.Legendre(2)
    return cc.Beam(
        length=16.0,
        basis=cc.ChannelBasis(torsion=two, out_of_plane=two, in_plane=two),
        grid=cc.Grid.uniform(16, real=real, max_angle=0.4),
        weight_bounds=0.1,
    )


@pytest.fixture(scope="module")
def wing():
    return _wing()


@pytest.fixture(scope="module")
def solve(wing, tmp_path_factory):
    """Solver of a position to be met."""
    target = cc.Target(xi=1.0, position=[15.0, 0, 3])
    f = cc.shape_target_function(wing, [target], max_iter=12)
    return _compiled(wing, f, tmp_path_factory.mktemp("met"))


def _compiled(wing, f, folder):
    """(guess, position) -> status, q, distance, of the C of `f` in single precision."""
    samples = {f.name(): [[np.full(N, 0.01), cc.tip_function(wing)(np.full(N, 0.02))[0]]]}
    cc.export_c([f], folder, real="float", beam=wing, reference_inputs=samples)
    command = "gcc -O1 -shared -fPIC curv.c curv_functions.c -o library.so -lm"
    subprocess.run(command.split(), cwd=folder, check=True)
    library = ctypes.CDLL(str(folder / "library.so"))

    def call(guess, position):
        values = [np.asarray(v, dtype=np.float32).ravel() for v in (guess, position)]
        out = np.full(N + 3, np.nan, dtype=np.float32)
        arguments = [array.ctypes.data_as(FLOATS) for array in (*values, out)]
        status = library.curv_shape_target(*arguments)
        return status, out[:N].astype(float), float(out[N])

    return call


def test_targets_within_reach_are_met_in_single_precision(wing, solve):
    random, tip = np.random.default_rng(5), cc.tip_function(wing)
    missed = 0
    for _ in range(SAMPLES):
        goal = tip(random.uniform(-0.04, 0.04, N))[0].full().ravel()
        status, q, distance = solve(np.full(N, 0.01), goal)
        if status:
            missed += 1
            continue
        found = tip(q)[0].full().ravel()
        # Met to 1e-5 of the length in each coordinate, as single precision computes it; that and
        # double differ by rounding, some 1e-6 of the length.
        assert np.max(np.abs(found - goal)) <= 1.2e-5 * 16
        assert distance == pytest.approx(np.linalg.norm(found - goal), abs=3e-5)
    # A guess far from the target may need more iterations than it has.
    assert missed <= 0.02 * SAMPLES


def test_weights_that_targets_do_not_see_are_those_of_double_arithmetic(wing, solve):
    """Three conditions, six weights: the preference determines the others."""
    random, tip = np.random.default_rng(6), cc.tip_function(wing)
    f = cc.shape_target_function(wing, [cc.Target(xi=1.0, position=[15.0, 0, 3])], max_iter=12)
    for guess in (np.full(N, 0.01), np.zeros(N)):
        for _ in range(10):
            goal = tip(random.uniform(-0.04, 0.04, N))[0].full().ravel()
            status, q, _ = solve(guess, goal)
            assert status == 0
            # Positions are rounded to 1e-7 of the length, and the last step is damped by 1e-6 of
            # what the stiffest direction moves.
            np.testing.assert_allclose(q, f(guess, goal)[0].full().ravel(), atol=2e-4)


def test_targets_out_of_reach_are_refused_in_single_precision(solve):
    statuses = {solve(np.full(N, 0.01), position)[0] for position in ([17, 0, 0], [0, 0, 20])}
    assert statuses == {1}  # infeasible


def test_what_is_solved_in_single_precision_is_at_the_optimum(wing, tmp_path):
    # Gradients along soft directions are small whatever the error: the decrement tells.
    target = [cc.Target(xi=1.0, position=[15.0, 0, 3], weight=1.0)]
    options = {"regularization": 1e-6}
    call = _compiled(wing, cc.shape_target_function(wing, target, max_iter=8, **options), tmp_path)
    best = cc.shape_target_function(_wing("double"), target, max_iter=400, **options)
    random, tip = np.random.default_rng(5), cc.tip_function(_wing("double"))
    solved, refused = [], 0
    for _ in range(100):
        goal = tip(random.uniform(-0.06, 0.06, N))[0].full().ravel()
        status, q, _ = call(random.uniform(-0.05, 0.05, N), goal)
        refused += status != 0
        if status == 0:
            optimum = best(q_guess=q, positions=goal)["q"]
            solved.append(float(ca.norm_2(tip(q)[0] - tip(optimum)[0])) / 16)
    assert len(solved) > 20 and refused > 5  # both happen
    # The decrement is kept below 1e-4; steps of Gauss-Newton converge linearly, so some more.
    assert max(solved) <= 3e-4


def test_a_solver_of_double_precision_is_named_where_it_becomes_single(tmp_path):
    beam = _wing("double")
    f = cc.shape_target_function(beam, [cc.Target(xi=1.0, position=[15.0, 0, 3], weight=1.0)])
    samples = {f.name(): [[np.full(N, 0.01), [15.5, 0, 2]]]}
    with pytest.warns(UserWarning, match="'shape_target' solves to tolerances of double precision"):
        cc.export_c([f], tmp_path, real="float", beam=beam, reference_inputs=samples)


def test_self_tests_begin_at_rest(wing, tmp_path):
    """Weights of zero beside the samples that are given, once, for maps and solvers."""
    target = cc.Target(xi=1.0, position=[15.0, 0, 3], weight=1.0)
    step = cc.shape_target_function(wing, [target], iterations=1, name="step")
    samples = {"step": [[np.full(N, 0.01), [15.5, 0, 2]]], "tip": [[np.full(N, 0.01)]]}
    for given in (samples, {**samples, "tip": [*samples["tip"], [np.zeros(N)]]}):
        functions = [cc.tip_function(wing), step]
        cc.export_c(functions, tmp_path, real="float", beam=wing, reference_inputs=given)
        text = (tmp_path / "check.c").read_text()
        for name in ("step", "tip"):
            (rows,) = re.findall(rf"{name}_in0\[\]\[6\] = (.*);", text)
            assert rows.count("}") == 3  # two samples
            assert rows.endswith("{0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f}}")
    cc.export.run_check(tmp_path, optimization="-O0")


def test_solvers_with_and_without_damping_share_an_export(wing, tmp_path):
    target = cc.Target(xi=1.0, position=[15.0, 0, 3], weight=1.0)
    functions = [
        cc.shape_target_function(
            wing, [target], iterations=1, damping=damping, regularization=1e-3, name=name
        )
        for name, damping in (("damped", 1e-3), ("undamped", 0.0))
    ]
    samples = {f.name(): [[np.full(N, 0.01), [15.5, 0, 2]]] for f in functions}
    cc.export_c(functions, tmp_path, real="float", beam=wing, reference_inputs=samples)
    cc.export.run_check(tmp_path, optimization="-O0")
