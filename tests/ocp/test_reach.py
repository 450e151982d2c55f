"""Weights that bring stations to targets."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import least_squares, minimize

import curvcasadi as cc
from curvcasadi.ocp.limits import regularizer_matrix
from curvcasadi.reference_wings import hale_wing
from tests.support import oracle

WING = hale_wing()
KINDS = {
    "position": ((1.0, "p"),),
    "attitude": ((1.0, "r"),),
    "pose": ((1.0, "pr"),),
    "several": ((0.37, "p"), (1.0, "p")),
}


def _targets(beam, q, stations, **fields):
    """Targets at the poses that the weights `q` give."""
    targets = []
    for xi, parts in stations:
        pose = cc.pose_at(beam, q, xi)
        given = {
            key: value
            for key, value in (("position", pose.position), ("rotation", pose.rotation))
            if key[0] in parts
        }
        targets.append(cc.Target(xi=xi, **given, **fields))
    return targets


def _missed(beam, q, targets):
    """Largest error of the targets, by numeric poses: fractions of the length and rad."""
    errors = []
    for target in targets:
        pose = cc.pose_at(beam, q, target.xi)
        if target.position is not None:
            errors.append(np.abs((pose.position - target.position).full()).max() / beam.length)
        if target.rotation is not None:
            turn = _rotation_vector((target.rotation.T @ pose.rotation).full())
            errors.append(np.abs(turn).max())
    return max(errors)


def _rotation_vector(R):
    """Rotation vector of a small rotation."""
    return 0.5 * np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])


def _preference(beam, q, regularizer):
    q = q.full().ravel()
    return q @ regularizer_matrix(beam, regularizer).full() @ q / 2


@pytest.mark.parametrize("hessian", ["gauss_newton", "limited_memory"])
@pytest.mark.parametrize("regularizer", ["smoothness", "strain_energy"])
@pytest.mark.parametrize("kind", KINDS)
def test_random_reachable_targets_are_reached(kind, regularizer, hessian):
    random = np.random.default_rng([len(kind), len(regularizer), len(hessian)])
    for scale in (0.02, 0.05, 0.1):
        q = random.uniform(-scale, scale, 9)
        targets = _targets(WING, q, KINDS[kind])
        result = cc.reach_shape(WING, targets, regularizer=regularizer, hessian=hessian)
        assert result.reached
        assert result.message.startswith("reached")
        assert _missed(WING, result.q, targets) <= 1e-6
        assert np.all(np.abs(result.q.full()) <= 0.15)
        assert len(result.distances) == sum("p" in parts for _, parts in KINDS[kind])
        assert len(result.angles) == sum("r" in parts for _, parts in KINDS[kind])


def test_nine_conditions_on_nine_weights_are_met():
    # Two stations, position and attitude: the guess converges slowly, and least squares stop early.
    q = [-0.0093, 0.0176, -0.0093, 0.0081, -0.0148, 0.0126, -0.0153, 0.0006, -0.0190]
    targets = _targets(WING, q, ((0.5, "p"), (1.0, "pr")))
    assert cc.reach_shape(WING, targets).reached


def test_random_poses_and_midspan_positions_are_met():
    random = np.random.default_rng(7)
    missed = []
    for trial in range(20):
        q = random.uniform(-0.05, 0.05, 9)
        targets = _targets(WING, q, ((0.5, "p"), (1.0, "pr")))
        if not cc.reach_shape(WING, targets, throw=False).reached:
            missed.append(trial)
            assert cc.reach_shape(WING, targets, q_guess=0.99 * q).reached
    # Nine conditions on nine weights have other valleys, into which nine starts may all lead: one
    # of these ends 0.2 mm from its targets.
    assert len(missed) <= 1


@pytest.mark.parametrize("kind", KINDS)
def test_sqpmethod_reaches_the_same_targets(kind):
    random = np.random.default_rng(len(kind))
    for _ in range(4):
        targets = _targets(WING, random.uniform(-0.05, 0.05, 9), KINDS[kind])
        result = cc.reach_shape(WING, targets, solver="sqpmethod")
        assert _missed(WING, result.q, targets) <= 1e-6


def test_solver_options_reach_the_solver():
    targets = _targets(WING, np.full(9, 0.02), KINDS["pose"])
    result = cc.reach_shape(WING, targets, solver_options={"ipopt.max_iter": 1}, throw=False)
    assert not result.converged  # one iteration is too few


@pytest.mark.parametrize("seed", range(4))
def test_the_strain_energy_is_the_least_that_reaches_the_position(seed):
    random = np.random.default_rng(seed)
    tip = cc.tip_function(WING)
    goal = cc.pose_at(WING, random.uniform(-0.04, 0.04, 9), 1.0).position
    result = cc.reach_shape(
        WING, [cc.Target(xi=1, position=goal, tolerance=1e-8)], regularizer="strain_energy"
    )
    S = regularizer_matrix(WING, "strain_energy").full()
    jacobian = tip.jacobian()
    scale = 1 / _preference(WING, result.q, "strain_energy")
    # SLSQP with its own starting point beside the found one.
    found = minimize(
        lambda q: scale * (q @ S @ q) / 2,
        result.q.full().ravel() + 1e-3 * random.normal(size=9),
        jac=lambda q: scale * S @ q,
        bounds=[(-0.15, 0.15)] * 9,
        constraints={
            "type": "eq",
            "fun": lambda q: (tip(q)[0] - goal).full().ravel() / 16,
            "jac": lambda q: jacobian(q, *tip(q))[0].full() / 16,
        },
        method="SLSQP",
        options={"ftol": 1e-15, "maxiter": 1000},
    )
    # The target may be missed by 1e-10 L, a hundredth of its tolerance: of the energy, 1e-6 at
    # most on these shapes.
    assert_allclose(1.0, found.fun, rtol=1e-5)
    assert_allclose(result.q.full().ravel(), found.x, atol=1e-5)


@pytest.mark.parametrize("regularizer", ["smoothness", "strain_energy"])
@pytest.mark.parametrize("kind", ["position", "attitude", "pose"])
def test_the_gradient_of_the_regularizer_vanishes_along_the_target(kind, regularizer):
    beam = replace(WING, weight_bounds=None)
    q = np.random.default_rng(5).uniform(-0.01, 0.01, 9)
    result = cc.reach_shape(beam, _targets(beam, q, KINDS[kind]), regularizer=regularizer)
    assert result.active_bounds == ()
    rows = {"position": slice(3, 6), "attitude": slice(0, 3), "pose": slice(0, 6)}[kind]
    J = cc.body_jacobian(beam, result.q).full()[rows]
    null_space = np.linalg.svd(J)[2][np.linalg.matrix_rank(J) :].T
    gradient = (regularizer_matrix(beam, regularizer) @ result.q).full().ravel()
    # IPOPT's tolerance of 1e-9 on a scaled gradient.
    assert np.abs(null_space.T @ gradient).max() <= 1e-5 * np.abs(gradient).max()


def test_a_full_pose_with_four_out_of_plane_weights_is_redundant_and_reached():
    beam = replace(WING, basis=cc.ChannelBasis(out_of_plane=cc.Legendre(4)))
    q = np.array([-0.03, 0.02, 0.01, -0.01])
    for hessian in ("gauss_newton", "limited_memory"):
        targets = _targets(beam, q, KINDS["pose"])
        result = cc.reach_shape(beam, targets, hessian=hessian)
        assert _missed(beam, result.q, targets) <= 1e-6
        repeated = cc.reach_shape(beam, 3 * targets, hessian=hessian)
        # The same problem three times: both stay within a hundredth of the tolerance of 1e-6.
        assert_allclose(repeated.q, result.q, atol=1e-5)


def test_the_regularizer_never_moves_a_reachable_target():
    targets = _targets(WING, np.random.default_rng(6).uniform(-0.05, 0.05, 9), KINDS["pose"])
    for regularization in (1e-12, 1.0, 1e6):
        for regularizer in ("smoothness", "strain_energy"):
            result = cc.reach_shape(
                WING, targets, regularizer=regularizer, regularization=regularization
            )
            assert _missed(WING, result.q, targets) <= 1e-6


def test_a_coarse_tolerance_is_kept_and_a_fine_one_too():
    q = np.random.default_rng(7).uniform(-0.05, 0.05, 9)
    for tolerance in (1e-10, 1e-3):
        targets = _targets(WING, q, KINDS["pose"], tolerance=tolerance)
        assert _missed(WING, cc.reach_shape(WING, targets).q, targets) <= tolerance


@pytest.mark.parametrize("goal", [[0, 17, 0], [0, 16.001, 0], [0, 40, 0]])
def test_a_straight_pull_ends_at_the_tip_of_the_straight_wing(goal):
    with pytest.raises(cc.ConvergenceError, match=r"targets\[0\] is out of reach: ") as failure:
        cc.reach_shape(WING, [cc.Target(xi=1, position=goal)])
    result = failure.value.result
    # Nearest is the straight wing; the error is flat there: 1e-6 of the distance.
    assert_allclose(result.distances, goal[1] - 16, rtol=1e-5)
    assert not result.reached
    assert f"{goal[1]:.6g} m from the root, the beam ends at most 16 m from it" in result.message


def test_a_pull_on_a_displaced_and_turned_root_is_measured_from_that_root():
    R, p = oracle.rotation([0.4, -0.8, 1.1]), np.array([3.0, -2.0, 1.0])
    beam = replace(WING, root=cc.Pose(rotation=R, position=p))
    result = cc.reach_shape(beam, [cc.Target(xi=1, position=p + 19 * R[:, 0])], throw=False)
    assert_allclose(result.distances, 3, rtol=1e-5)  # flat at the nearest shape
    assert "19 m from the root" in result.message


def test_an_unreachable_target_inside_the_sphere_names_the_bounds_that_hold_it():
    beam = replace(WING, weight_bounds=0.005)
    result = cc.reach_shape(beam, [cc.Target(xi=1, position=[0, 10, -9])], throw=False)
    assert not result.reached
    assert "q[3] (out_of_plane: Legendre 0) at its lower bound -0.005" in result.active_bounds
    assert "bounds hold it: " in result.message

    tip = cc.tip_function(beam)

    def distance(q):
        return tip(q)[0].full().ravel() - [0, 10, -9]

    random = np.random.default_rng(8)
    nearest = min(
        least_squares(distance, random.uniform(-0.004, 0.004, 9), bounds=(-0.005, 0.005)).cost
        for _ in range(3)
    )
    # Another solver's default tolerances, 1e-8 of the cost.
    assert_allclose(result.distances, np.sqrt(2 * nearest), rtol=1e-6)


def test_only_missed_targets_are_listed_as_missed():
    targets = [cc.Target(xi=0.5, position=[0, 8, 0]), cc.Target(xi=1, position=[0, 17, 0])]
    result = cc.reach_shape(WING, targets, throw=False)
    assert_allclose(result.distances, [0, 1], atol=1e-5)  # flat at the straight wing
    assert "targets[1]" in result.message
    assert "targets[0]" not in result.message


def test_contradicting_targets_end_in_the_middle():
    targets = [cc.Target(xi=1, position=[0, 14, z]) for z in (-5, -6)]
    with pytest.raises(cc.ConvergenceError, match="no bound holds it") as failure:
        cc.reach_shape(WING, targets)
    assert_allclose(failure.value.result.distances, 0.5, rtol=1e-6)  # least squares


def test_curvature_bounds_hold_and_are_reported():
    goal = cc.Target(xi=1, position=[0, 14, -5])
    free = cc.reach_shape(WING, [goal])
    result = cc.reach_shape(WING, [goal], curvature_bound=[np.inf, 0.06, np.inf])
    assert np.abs(free.shape.curvatures.full()[1]).max() > 0.0601
    # IPOPT's tolerance on constraints.
    assert np.abs(result.shape.curvatures.full()[1]).max() <= 0.06 + 1e-8
    assert result.reached
    assert any(name.startswith("K_y at xi") for name in result.active_bounds)
    assert not any(name.startswith("K_z at xi") for name in result.active_bounds)


def test_a_curvature_bound_that_holds_the_target_off_is_the_reason():
    with pytest.raises(cc.ConvergenceError, match=r"bounds hold it: .*K_y at xi = 0 at its lower"):
        cc.reach_shape(WING, [cc.Target(xi=1, position=[0, 10, -9])], curvature_bound=0.01)


def test_element_angles_keep_within_the_largest_of_the_grid():
    beam = replace(WING, grid=cc.Grid.uniform(4, max_angle=0.3))
    result = cc.reach_shape(beam, [cc.Target(xi=1, position=[0, 5, -5])], throw=False)
    angles = np.sqrt(cc.squared_element_angles(beam, result.q).full())
    assert angles.max() <= 0.3 * (1 + 1e-6)  # the slack of solvers that shape_map grants
    assert "angle of element 0 at its upper bound 0.09" in result.active_bounds
    assert not result.reached


@pytest.mark.parametrize("goal", [[0, 40, 0], [0, -20, 3], [3, 10, -6]])
def test_weighted_targets_never_raise(goal):
    for weight in (1e-3, 1.0, 1e3):
        result = cc.reach_shape(WING, [cc.Target(xi=1, position=goal, weight=weight)])
        assert result.reached


def test_a_compromise_of_weights_is_told_in_words():
    """Targets with weights that are missed were once called reached."""
    near, far = [0, 16, 0], [0, 16.11, 0]
    result = cc.reach_shape(WING, [cc.Target(xi=1, position=far, weight=1.0)])
    assert result.compromise
    assert result.success
    assert result.message == "a compromise of weights: targets[0] (xi = 1) by 0.11 m"
    both = [cc.Target(xi=1, position=near), cc.Target(xi=1, position=far, weight=1.0)]
    result = cc.reach_shape(WING, both)
    assert result.reached
    assert result.message == "a compromise of weights: targets[1] (xi = 1) by 0.11 m"
    assert not cc.reach_shape(WING, both[:1]).compromise


def test_weighted_targets_are_the_least_squares_of_another_solver():
    q = np.random.default_rng(9).uniform(-0.04, 0.04, 9)
    turn = oracle.rotation([0.2, 0.1, -0.3])
    tip, middle = cc.pose_at(WING, q, 1.0), cc.pose_at(WING, q, 0.5)
    targets = [
        cc.Target(xi=0.5, position=middle.position + np.array([0.3, 0.2, -0.4]), weight=3.0),
        cc.Target(xi=1, position=tip.position, rotation=tip.rotation @ turn, weight=0.5),
    ]
    poses = cc.pose_function("poses", WING, (0.5, 1.0))

    def errors(q):
        position, rotation = (part.full() for part in poses(q))
        R = targets[1].rotation.full().T @ rotation[:, 3:]
        angle = np.arccos((np.trace(R) - 1) / 2)
        log = _rotation_vector(R) * angle / np.sin(angle)
        return np.concatenate(
            [
                np.sqrt(3.0) * (position[:, 0] - targets[0].position.full().ravel()) / 16,
                np.sqrt(0.5) * (position[:, 1] - targets[1].position.full().ravel()) / 16,
                np.sqrt(0.5) * log,
            ]
        )

    result = cc.reach_shape(WING, targets, regularization=1e-12)
    # From the same start: the problem has several valleys.
    other = least_squares(
        errors, result.q.full().ravel() + 1e-3, bounds=(-0.15, 0.15), xtol=1e-14, ftol=1e-14
    )
    # Nine errors and nine weights, regularized by 1e-12: the costs agree to the regularizer.
    cost = np.sum(errors(result.q.full().ravel()) ** 2) / 2
    assert cost <= other.cost + 1e-9


def test_weighted_targets_yield_to_unweighted_ones():
    targets = [
        cc.Target(xi=0.5, position=[0, 7.5, -2]),
        cc.Target(xi=1, position=[0, 13, -7], weight=100.0),
    ]
    result = cc.reach_shape(WING, targets)
    assert result.distances[0] <= 16e-6 * np.sqrt(3)
    assert result.distances[1] > 0.01  # the two are not compatible
    alone = cc.reach_shape(WING, targets[:1])
    toward = [
        float(ca.norm_2(cc.pose_at(WING, r.q, 1).position - targets[1].position))
        for r in (result, alone)
    ]
    assert toward[0] < toward[1]


@pytest.mark.parametrize("kind", ["position", "pose"])
def test_mirrored_wings_reach_mirrored_targets_with_the_same_weights(kind):
    left = cc.mirror(WING)
    q = np.random.default_rng(10).uniform(-0.04, 0.04, 9)
    results = [
        cc.reach_shape(beam, _targets(beam, q, KINDS[kind]), regularizer="strain_energy")
        for beam in (WING, left)
    ]
    # Rounding changes the path of the solver; both end within IPOPT's tolerance.
    assert_allclose(results[1].q, results[0].q, atol=1e-5)


def test_displaced_roots_and_initial_curvature_are_reached():
    beam = replace(
        WING,
        root=cc.Pose(rotation=oracle.rotation([0.4, -0.8, 1.1]), position=[3, -2, 1]),
        initial_curvature=lambda xi: [0.01, 0.05 * xi, -0.02],
    )
    targets = _targets(beam, np.random.default_rng(11).uniform(-0.04, 0.04, 9), KINDS["pose"])
    assert _missed(beam, cc.reach_shape(beam, targets).q, targets) <= 1e-6


def test_a_target_at_the_unloaded_shape_needs_no_weights():
    beam = replace(WING, initial_curvature=[0.01, -0.05, 0.02])
    for kind in KINDS:
        result = cc.reach_shape(beam, _targets(beam, np.zeros(9), KINDS[kind]))
        # A hundredth of the tolerance lets |q| be 1e-8 over the sensitivity.
        assert_allclose(result.q, 0, atol=1e-7)


def test_a_target_at_the_root_is_met_by_every_shape():
    target = cc.Target(xi=0, position=[0, 0, 0], rotation=WING.root.rotation)
    assert_allclose(cc.reach_shape(WING, [target]).q, 0, atol=1e-7)  # IPOPT's tolerance


def test_half_a_turn_is_reached():
    turned = WING.root.rotation @ np.diag([-1.0, 1.0, -1.0])
    result = cc.reach_shape(WING, [cc.Target(xi=1, rotation=turned)])
    assert_allclose(result.shape.tip.rotation, turned, atol=3e-6)  # the tolerance of 1e-6 rad


def test_guesses_outside_the_bounds_are_brought_inside():
    targets = _targets(WING, np.full(9, 0.01), KINDS["position"])
    result = cc.reach_shape(WING, targets, q_guess=np.full(9, 10.0))
    assert result.reached
    assert np.all(np.abs(result.q.full()) <= 0.15)


def test_the_result_holds_numbers_of_the_shape_that_it_describes():
    targets = _targets(WING, np.full(9, 0.01), KINDS["pose"])
    result = cc.reach_shape(WING, targets)
    tip = cc.shape_map(WING, result.q).tip
    assert_allclose(result.shape.tip.position, tip.position, rtol=0)  # the same call
    distance = float(ca.norm_2(tip.position - targets[0].position))
    assert_allclose(result.distances, [distance], atol=1e-13)  # rounding of 16 m
    assert result.converged
    assert result.iterations > 0


GOAL = cc.Target(xi=1, position=[0, 14, -5])


@pytest.mark.parametrize(
    "arguments, message",
    [
        (
            {"regularizer": "flat"},
            r"regularizer: expected one of 'smoothness', 'strain_energy'; fo",
        ),
        ({"hessian": "exact"}, r"hessian: expected one of 'gauss_newton', 'limited_memory'; found"),
        ({"regularization": 0}, r"regularization: expected a number above zero, found 0"),
        ({"regularization": np.nan}, r"regularization: expected finite numbers, found"),
        ({"curvature_bound": -1}, r"curvature_bound: expected .* above zero, rad/m, found -1"),
        ({"curvature_bound": [1, 2]}, r"curvature_bound: expected one or three numbers"),
        ({"curvature_bound": np.nan}, r"curvature_bound: expected one or three numbers"),
        ({"curvature_bound": ca.SX.sym("b")}, r"curvature_bound: expected one or three numbers"),
        ({"q_guess": np.zeros(3)}, r"q_guess: expected shape \(9, 1\), found \(3, 1\)"),
        ({"q_guess": np.full(9, np.nan)}, r"q_guess: expected finite numbers, found"),
        ({"q_guess": ca.MX.sym("q", 9)}, r"q_guess: expected numbers, found"),
        ({"targets": []}, r"targets: expected one or more Target, found \[\]"),
        ({"targets": [1.0]}, r"targets: expected one or more Target, found \[1\.0\]"),
        ({"targets": GOAL}, r"targets: expected one or more Target, found"),
        ({"length": ca.SX.sym("L")}, r"Beam\.length: a shape target needs numbers, found .* L"),
    ],
    ids=lambda value: next(iter(value)) if isinstance(value, dict) else "",
)
def test_wrong_arguments_are_refused(arguments, message):
    options = {"targets": [GOAL], **arguments}
    beam = replace(WING, **{k: options.pop(k) for k in ("length",) if k in options})
    with pytest.raises(ValueError, match=message):
        cc.reach_shape(beam, **options)


def test_strain_energy_needs_a_numeric_section():
    with pytest.raises(ValueError, match=r"Beam\.section: expected a Section with stiffness"):
        cc.reach_shape(replace(WING, section=None), [GOAL], regularizer="strain_energy")
    soft = replace(WING, section=replace(WING.section, GJ=ca.SX.sym("GJ")))
    with pytest.raises(ValueError, match=r"Beam\.section: a regularizer needs numbers"):
        cc.reach_shape(soft, [GOAL], regularizer="strain_energy")


# Out of reach ----------------------------------------------------------------------------------

BOUND = 1.54665314
STIFF_IN_PLANE = cc.Beam(
    length=1.0,
    basis=cc.ChannelBasis(out_of_plane=cc.Legendre(3), in_plane=cc.Legendre(1)),
    grid=cc.Grid.uniform(16),
    weight_bounds=BOUND,
)
MISSED = np.array([-0.869, -0.0702, -0.3664])


def test_the_nearest_shape_is_the_best_of_the_starts_and_no_worse_than_the_guess():
    target = [cc.Target(xi=1.0, position=MISSED)]
    corner = np.array([1, -1, -1, -1]) * BOUND
    at_corner = cc.pose_at(STIFF_IN_PLANE, corner, 1.0).position.full().ravel()
    for guess in (None, corner):
        found = cc.reach_shape(STIFF_IN_PLANE, target, q_guess=guess, throw=False)
        assert not found.reached
        assert found.distances[0] <= np.linalg.norm(at_corner - MISSED) + 1e-6


def test_the_nearest_shape_does_not_depend_on_the_axes_of_the_parent():
    turn = oracle.rotation([0.7, -0.4, 1.1])
    turned = replace(STIFF_IN_PLANE, root=cc.Pose(rotation=turn, position=[1, 2, 3]))
    target = cc.Target(xi=1.0, position=MISSED)
    image = cc.Target(xi=1.0, position=turn @ MISSED + [1, 2, 3])
    distances = [
        cc.reach_shape(beam, [goal], throw=False).distances[0]
        for beam, goal in ((STIFF_IN_PLANE, target), (turned, image))
    ]
    np.testing.assert_allclose(*distances, rtol=1e-6)


def test_a_target_beyond_the_length_of_the_beam_is_answered_by_one_solve():
    near = cc.reach_shape(STIFF_IN_PLANE, [cc.Target(xi=1.0, position=MISSED)], throw=False)
    far = [cc.Target(xi=1.0, position=[1.5, 0.2, 0.1])]
    found = cc.reach_shape(STIFF_IN_PLANE, far, throw=False)
    assert "targets[0] is out of reach: 1.51658 m from the root" in found.message
    assert found.iterations < near.iterations / 3  # of one start, not of nine
