"""The quadratic-program solver of exported C: solutions, proofs, certificate and limits."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose

from curvcasadi.solvers.qp import QP_TOLERANCES, QuadraticProgram
from tests.support.native_qp import NativeQp
from tests.support.quadratic_programs import KINDS, random_program, residuals

REALS = {"double": np.float64, "float": np.float32}
WARNINGS = ("-pedantic", "-Wall", "-Wextra", "-Wconversion", "-Wdouble-promotion", "-Wshadow")


@pytest.fixture(scope="module")
def solvers(tmp_path_factory):
    """The solver in both precisions, compiled without a warning."""
    folder = tmp_path_factory.mktemp("qp")
    return {real: NativeQp.compiled(folder, real, *WARNINGS, "-Werror") for real in REALS}


def _program(**parts):
    """Two unknowns within ±1, one row: min ½ |x|² + gᵀx."""
    usual = {
        "H": np.eye(2),
        "g": np.zeros(2),
        "A": np.ones((1, 2)),
        "lower": np.array([-1.0, -1.0, -np.inf]),
        "upper": np.array([1.0, 1.0, np.inf]),
    }
    return QuadraticProgram(**{k: np.asarray(v, float) for k, v in (usual | parts).items()})


def _by_daqp(program, tolerance):
    """Solution of CasADi's DAQP, an independent implementation of another method."""
    n, m = program.size
    shapes = {"h": ca.Sparsity.dense(n, n), "a": ca.Sparsity.dense(m, n)}
    solve = ca.conic("qp", "daqp", shapes, {"daqp": {"primal_tol": tolerance}})
    limits = {"lbx": program.lower[:n], "ubx": program.upper[:n]}
    rows = {"lba": program.lower[n:], "uba": program.upper[n:]}
    return solve(h=program.H, g=program.g, a=program.A, **limits, **rows)["x"].full().ravel()


@pytest.mark.parametrize("real", REALS)
def test_units_of_unknowns_do_not_matter(solvers, real):
    """An unknown in units 1e5 times as large has entries of H that are 1e-10 of the others."""
    unit = np.array([1.0, 1e-5])
    H = np.array([[2.0, 0.5], [0.5, 1.0]]) * np.outer(unit, unit)
    goal = np.array([0.25, -0.5]) / unit
    far = np.array([1e6, 1e6, np.inf])
    program = _program(H=H, g=-H @ goal, lower=-far, upper=far)
    result = solvers[real](program)
    assert result.status == "solved"
    assert_allclose(result.x, goal, rtol=1e-5)  # rounding of single precision


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != "infeasible"])
@pytest.mark.parametrize("real", REALS)
def test_solutions_are_those_of_an_independent_solver(solvers, kind, real):
    random = np.random.default_rng(1)
    for _ in range(8):
        program, _ = random_program(random, kind, REALS[real])
        # Limits without interior cross by the rounding of single precision.
        result = solvers[real](program)
        x = _by_daqp(program, 1e-10 if real == "double" else 1e-6)
        assert result.status == "solved"

        def objective(x, program=program):
            return x @ program.H @ x / 2 + program.g @ x

        # Objectives, as ill-conditioned programs leave directions that hardly matter; a limit
        # missed by the tolerance is worth its multiplier times that.
        room = 2 * QP_TOLERANCES[real].primal * np.abs(result.lam).sum() + 1e-9
        assert abs(objective(x) - objective(result.x.astype(float))) <= room


@pytest.mark.parametrize("real", REALS)
@pytest.mark.parametrize("warm", [False, True], ids=["cold", "from wrong sets"])
def test_random_programs_are_solved_or_proved_infeasible(solvers, real, warm):
    tolerances = QP_TOLERANCES[real]
    for k in range(60 * len(KINDS)):
        random = np.random.default_rng([5, k])
        program, is_feasible = random_program(random, KINDS[k % len(KINDS)], REALS[real])
        guess = random.integers(-1, 2, sum(program.size)) if warm else None
        result = solvers[real](program, guess)
        assert result.status == ("solved" if is_feasible else "infeasible")
        if is_feasible:
            miss, left, idle = residuals(program, result.x, result.lam)
            size = 1 + np.abs(result.lam).sum()  # of the terms, whose rounding remains
            assert miss <= 1.01 * tolerances.primal  # 1 %: values rounded in the solver
            assert left <= tolerances.dual + 8 * np.finfo(REALS[real]).eps * size
            assert idle <= max(tolerances.dual, tolerances.primal)


@pytest.mark.parametrize("real", REALS)
def test_a_warm_start_from_the_active_set_changes_nothing(solvers, real):
    random = np.random.default_rng(2)
    for _ in range(10):
        program, _ = random_program(random, "plain", REALS[real], n=20, m=30)
        first = solvers[real](program)
        again = solvers[real](program, first.side)
        assert again.status == "solved"
        assert again.changes == 0
        assert np.array_equal(again.side, first.side)
        assert_allclose(again.x, first.x, atol=QP_TOLERANCES[real].primal)  # of both


@pytest.mark.parametrize("real", REALS)
def test_the_certificate_refuses_what_is_no_solution(solvers, real):
    solve, random = solvers[real], np.random.default_rng(3)
    for _ in range(10):
        program, _ = random_program(random, "plain", REALS[real], n=10, m=15)
        result = solve(program)
        assert solve.is_optimal(program, result.x, result.lam)
        off = 1e-3 * random.normal(size=10)
        assert not solve.is_optimal(program, result.x + off, result.lam)
        assert not solve.is_optimal(program, result.x, result.lam + 1e-3)
        assert not solve.is_optimal(program, result.x * np.nan, result.lam)


@pytest.mark.parametrize("real", REALS)
@pytest.mark.parametrize(
    "parts, x, lam",
    [
        ({}, (0, 0), (0, 0, 0)),
        ({"g": (-3, 0)}, (1, 0), (2, 0, 0)),  # at an upper limit: its multiplier is above zero
        ({"g": (3, 0)}, (-1, 0), (-2, 0, 0)),
        ({"lower": (-1, -1, 1), "upper": (1, 1, 1)}, (0.5, 0.5), (0, 0, -0.5)),  # an equality
        ({"lower": (-1, 0.25, -9), "upper": (1, 0.25, 9)}, (0, 0.25), (0, -0.25, 0)),
        ({"lower": (1, 1, 2), "upper": (1, 1, 2)}, (1, 1), None),  # dependent equalities
    ],
    ids=["free", "upper", "lower", "equality", "frozen unknown", "dependent"],
)
def test_solutions_by_hand(solvers, real, parts, x, lam):
    result = solvers[real](_program(**parts))
    assert result.status == "solved"
    assert_allclose(result.x, x, atol=QP_TOLERANCES[real].primal)
    if lam is not None:
        assert_allclose(result.lam, lam, atol=QP_TOLERANCES[real].primal)


@pytest.mark.parametrize("real", REALS)
@pytest.mark.parametrize(
    "limits",
    [
        ((-1, -1, 2.01), (1, 1, 9)),  # the row beyond what the limits of x allow
        ((1, 1, -9), (1, 1, 1.9)),  # two frozen unknowns against it
        ((-np.inf, -np.inf, 1), (np.inf, np.inf, 0.9)),  # a row against itself
    ],
    ids=["limits", "frozen", "crossed"],
)
def test_what_cannot_be_kept_is_proved_infeasible(solvers, real, limits):
    lower, upper = limits
    assert solvers[real](_program(lower=lower, upper=upper)).status == "infeasible"


@pytest.mark.parametrize("real", REALS)
def test_unknowns_without_limits_get_proofs_too(solvers, real):
    A = np.array([[1.0, 1.0], [1.0, 1.0]])
    free = [np.inf, np.inf]
    program = _program(A=A, lower=[*(-np.array(free)), 1, -np.inf], upper=[*free, np.inf, 0.99])
    assert solvers[real](program).status == "infeasible"
    nearly = replace(program, upper=np.array([*free, np.inf, 1 - QP_TOLERANCES[real].primal / 2]))
    assert solvers[real](nearly).status == "solved"  # within the tolerance of limits


@pytest.mark.parametrize("real", REALS)
def test_the_changes_of_the_active_set_are_bounded(solvers, real):
    program, _ = random_program(np.random.default_rng(4), "plain", REALS[real], n=24, m=50)
    needed = solvers[real](program).changes
    assert needed > 4
    stopped = solvers[real](program, max_changes=4)
    assert stopped.status == "limit"
    assert stopped.changes <= 5


@pytest.mark.parametrize("real", REALS)
@pytest.mark.parametrize(
    "parts, status",
    [
        ({"H": [[1, 2], [2, 1]]}, "not convex"),
        ({"H": np.zeros((2, 2))}, "not convex"),
        ({"H": [[1, np.nan], [np.nan, 1]]}, "not convex"),
        ({"g": [np.nan, 0]}, "limit"),
        ({"A": [[np.nan, 1]], "lower": (-1, -1, 0.5)}, "limit"),
    ],
    ids=str,
)
def test_what_is_no_convex_program_is_not_solved(solvers, real, parts, status):
    assert solvers[real](_program(**parts)).status == status
