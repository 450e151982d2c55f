"""The certificate that solvers give with their result."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

import curvcasadi as cc
from curvcasadi.reference_wings import hale_wing
from curvcasadi.solvers.certificate import TOLERANCES, Bounds, larger
from curvcasadi.solvers.gauss_newton import GaussNewton
from curvcasadi.solvers.stages import linearization

WING = hale_wing()
TIP = cc.Target(xi=1.0, position=[0, 14, -5], weight=1.0)


def _solver(objective, hessian, constraints, x, p, bounds, **options):
    linearized = linearization(
        "linearization",
        x,
        p,
        objective,
        ca.gradient(objective, x),
        hessian,
        constraints,
        ca.jacobian(constraints, x).T,
    )
    values = ca.Function("values", [x, p], [constraints, ca.MX(0, 1)])
    return GaussNewton(
        name="disc",
        linearization=linearized,
        values=values,
        bounds=bounds,
        real="double",
        **options,
    )


def _disc(**options):
    """min ½ |x − p|² with x0 + x1 ≤ 1 and −2 ≤ x ≤ 2."""
    x, p = ca.MX.sym("x", 2), ca.MX.sym("p", 2)
    bounds = Bounds(-2, 2, -ca.inf, 1)
    hessian = ca.MX(ca.DM.eye(2))
    solver = _solver(ca.sumsqr(x - p) / 2, hessian, ca.sum1(x), x, p, bounds, **options)
    start = ca.MX.sym("start", 2)
    found = solver(start, p)
    outputs = [found.x, found.violation, found.stationarity]
    return ca.Function("solve", [start, p], outputs), solver


def _certificate(solver, x, p, lam_x, lam_g):
    """(violation, stationarity) of any point and multipliers."""
    multipliers = ca.vertcat(ca.DM(lam_x), ca.DM(lam_g))
    _, g, H, c, At = solver.linearization(ca.DM(x), ca.DM(p))
    reached = ca.vertcat(ca.DM(x), c)
    distance = solver.distance(*map(ca.MX, (H, g, At, reached, multipliers)))
    violation = solver.violation(ca.MX(ca.DM(x)), ca.MX(c))
    return [float(ca.evalf(value)) for value in (violation, distance)]


@pytest.mark.parametrize(
    "p, expected",
    [((0, 0.5), (0, 0.5)), ((2, 1), (1, 0)), ((-5, 0), (-2, 0)), ((9, 9), (0.5, 0.5))],
)
def test_solutions_are_certified(p, expected):
    solve, _ = _disc()
    x, violation, stationarity = solve([0, 0], p)
    np.testing.assert_allclose(x, np.reshape(expected, (2, 1)), atol=1e-8)  # of the solver
    assert float(violation) <= 1e-9
    assert float(stationarity) <= 1


@pytest.mark.parametrize(
    "x, lam_x, lam_g, violation, stationarity",
    [
        ((1, 0), (0, 0), 1.0, 0, 0),  # the optimum of p = (2, 1)
        ((1, 0), (0, 0), 0.9, 0, 0.1 * np.sqrt(2)),  # gradient and multiplier out of balance
        ((0.5, 0.5), (0, 0), 1.0, 0, np.sqrt(0.5)),  # on the constraint, at the wrong place
        ((2, 1), (0, 0), 0.0, 2, 0),  # the free optimum, beyond the constraint
        ((1, -0.5), (0, 0.5), 1.0, 0, np.sqrt(0.5)),  # multipliers of limits that are not reached
        ((np.nan, 0), (0, 0), 1.0, None, np.nan),
    ],
)
def test_the_certificate_is_that_of_the_optimality_conditions(
    x, lam_x, lam_g, violation, stationarity
):
    _, solver = _disc()
    found = _certificate(solver, x, (2, 1), lam_x, lam_g)
    if violation is not None:
        assert found[0] == pytest.approx(violation, abs=1e-15)  # rounding
    left = found[1] * TOLERANCES["double"].stationarity
    assert left == pytest.approx(stationarity, abs=1e-12, nan_ok=True)  # rounding over 1e-8


def test_constraints_that_are_no_number_are_not_kept():
    """A difference of infinities, which a largest excess would overlook."""
    x, p = ca.MX.sym("x"), ca.MX.sym("p")
    solver = _solver(x**2 / 2, ca.MX(1), x + p, x, p, Bounds(-1, 1, 0, 0))
    assert np.isnan(_certificate(solver, 0, np.nan, 0, 0)[0])
    assert _certificate(solver, 0, np.inf, 0, 0)[0] == np.inf
    path = larger(ca.MX.sym("a"), ca.MX(2.0))
    f = ca.Function("f", ca.symvar(path), [path])
    assert (float(f(1)), float(f(3)), np.isnan(float(f(np.nan)))) == (2, 3, True)


def test_too_few_iterations_are_not_certified():
    targets = [TIP]
    few, enough = (
        cc.shape_target_function(WING, targets, regularization=1e-4, max_iter=n) for n in (2, 60)
    )
    arguments = {"q_guess": 0.001, "positions": [0, 13, -7]}
    assert float(few(**arguments)["stationarity"]) > 1
    assert float(enough(**arguments)["stationarity"]) <= 1


def test_a_real_time_iteration_is_certified_by_its_program():
    options = {"regularization": 1e-4, "damping": 0.0}
    step = cc.shape_target_function(WING, [TIP], iterations=1, **options)
    first = step(q_guess=0.001, positions=[0, 13, -7])
    # The step is that of the program, exactly, though the tip is not there yet.
    assert float(first["stationarity"]) <= 1
    assert float(first["distances"]) > 0.1
    q = first["q"]
    for _ in range(30):
        q = step(q_guess=q, positions=[0, 13, -7])["q"]
    whole = cc.shape_target_function(WING, [TIP], regularization=1e-4)
    expected = whole(q_guess=0.001, positions=[0, 13, -7])["q"]
    # The converging solver starts from a bend of 1e-5/L and ends at 1e-8 of the stiffest direction;
    # the regularizer is 1e-4 of that, so soft weights may differ by 1e-4, and do by 6e-7.
    np.testing.assert_allclose(q, expected, atol=1e-6)


def test_several_programs_are_as_many_real_time_iterations():
    one, three = (
        cc.shape_target_function(WING, [TIP], iterations=n, regularization=1e-4) for n in (1, 3)
    )
    q = ca.DM(np.full(9, 0.001))
    for _ in range(3):
        q = one(q_guess=q, positions=[0, 13, -7])["q"]
    found = three(q_guess=0.001, positions=[0, 13, -7])["q"]
    np.testing.assert_allclose(found, q, atol=1e-12)  # programs started at their multipliers


def test_targets_to_be_met_take_no_single_programs():
    with pytest.raises(ValueError, match="iterations: expected None, or a weight for every target"):
        cc.shape_target_function(WING, [replace(TIP, weight=None)], iterations=1)


BOUNDS = {"rate_bound": 0.1, "curvature_bound": 0.08}


@pytest.mark.parametrize("solver, unsolved", [("own", 0), ("qrqp", 15)])
def test_what_is_not_solved_is_not_certified_and_the_rest_is_right(solver, unsolved):
    """Of 60 tight programs far from the path; qrqp, an option, gives up a quarter of them."""
    model = cc.kinematic_model(WING, time_constant=0.3)
    quick, sure = (
        cc.tip_path_step_function(model, dt=0.1, horizon=4, iterations=1, qp_solver=name, **BOUNDS)
        for name in (solver, "qpoases")
    )
    random = np.random.default_rng(1)
    refused = 0
    for _ in range(60):
        x, q = random.uniform(-0.005, 0.005, 9), random.uniform(-0.03, 0.03, 9)
        tip = cc.pose_at(WING, q, 1.0)
        path = [ca.repmat(part, 1, 4) for part in (tip.position, tip.rotation)]
        found, best = (
            f.call([x, ca.DM.zeros(9), x, *path, ca.DM.zeros(72)]) for f in (quick, sure)
        )
        assert float(best[3]) <= 1
        assert float(best[4]) <= 1
        if float(found[3]) <= 1 and float(found[4]) <= 1:
            # Where both are optimal to 1e-8 of the stiffest direction, the softest, 6e-7 of it by
            # the weight of moves, leaves that much; the path's direction is stiff.
            tips = [cc.pose_at(WING, f[2][:, 1], 1.0).position for f in (found, best)]
            assert float(ca.norm_2(tips[0] - tips[1])) <= 1e-2
        else:
            refused += 1
    assert refused <= unsolved


@pytest.mark.parametrize(
    "matrix",
    [np.zeros((3, 3)), 2 * np.eye(3), -np.eye(3), np.diag([1, 1, -1]), np.ones((3, 3))],
    ids=str,
)
def test_rotations_that_are_none_are_no_solution(matrix):
    model = cc.kinematic_model(WING, time_constant=0.3)
    step = cc.tip_path_step_function(model, dt=0.1, horizon=2, iterations=1)
    attitude = cc.shape_target_function(WING, [cc.Target(xi=1.0, rotation=np.eye(3), weight=1.0)])
    path = {"positions": ca.repmat(WING.root.position, 1, 2), "rotations": np.tile(matrix, 2)}
    found = step(x=0.001, p=0, u_previous=0.001, guess=0, **path)["violation"]
    assert not float(found) <= 1
    assert not float(attitude(q_guess=0.001, rotations=matrix)["violation"]) <= 1
    # Rotations in single precision are ones.
    true = WING.root.rotation.full().astype(np.float32)
    assert float(attitude(q_guess=0.001, rotations=true)["violation"]) <= 1


@pytest.mark.parametrize(
    "x, lam_x, lam_g, stationarity",
    [
        ((1, 0), (0, 0), 1.0, 0),  # the optimum of p = (2, 1)
        ((1, 0), (0, 0), 0.9, 0.1 * np.sqrt(2)),  # what the gradient leaves
        ((1, -0.5), (0, 0), 1.0, np.sqrt(0.25 + 0.5)),  # and a multiplier times its slack
    ],
)
def test_what_is_left_of_the_residual_bounds_the_distance(x, lam_x, lam_g, stationarity):
    """For a Hessian of one: |r|² + λ slack; the optimum is (1, 0)."""
    _, solver = _disc(stationarity=0.0, residual_unit=1.0)
    found = _certificate(solver, x, (2, 1), lam_x, lam_g)[1] * TOLERANCES["double"].decrement
    assert found == pytest.approx(stationarity, rel=1e-6, abs=1e-12)
    assert np.linalg.norm(np.subtract(x, (1, 0))) <= np.sqrt(2) * found + 1e-12
