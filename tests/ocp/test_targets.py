"""Targets, their residuals and the limits of shape problems."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose

import curvcasadi as cc
from curvcasadi.ocp.limits import regularizer_matrix, shape_limits
from curvcasadi.ocp.targets import residuals, values_of
from curvcasadi.reference_wings import hale_wing
from tests.support import oracle

Q = np.random.default_rng(2).uniform(-0.04, 0.04, 9)
POSITION = [1.0, 14.0, -3.0]
ROTATION = oracle.rotation([0.3, -0.4, 0.5])
S = ca.SX.sym("S")


@pytest.mark.parametrize(
    "fields, message",
    [
        ({}, r"Target: expected a position, a rotation or both, found neither"),
        ({"xi": 1.5, "position": POSITION}, r"Target\.xi: expected a number in \[0, 1\], found 1"),
        ({"xi": np.nan, "position": POSITION}, r"Target\.xi: expected finite numbers, found"),
        ({"xi": S, "position": POSITION}, r"Target\.xi: expected a number .*, found the symbol S"),
        ({"position": [1, 2]}, r"Target\.position: expected shape \(3, 1\), found \(2, 1\)"),
        ({"position": 5.0}, r"Target\.position: expected shape \(3, 1\), found \(1, 1\)"),
        ({"position": [1, np.nan, 0]}, r"Target\.position: expected finite numbers, found"),
        ({"position": ca.MX.sym("S", 3)}, r"Target\.position: expected numbers, found the symbol"),
        ({"rotation": np.eye(2)}, r"Target\.rotation: expected shape \(3, 3\), found \(2, 2\)"),
        (
            {"rotation": 1.01 * np.eye(3)},
            r"Target\.rotation: expected orthonormal columns, to 0.01",
        ),
        ({"rotation": np.diag([1, 1, -1])}, r"Target\.rotation: expected a right-handed frame"),
        ({"rotation": ca.SX.eye(3) * S}, r"Target\.rotation: expected numbers, found the symbol"),
        ({"position": POSITION, "weight": -1}, r"Target\.weight: expected .* above zero, found -1"),
        ({"position": POSITION, "weight": 0}, r"Target\.weight: expected .* above zero, found 0"),
        (
            {"position": POSITION, "weight": S},
            r"Target\.weight: expected numbers, found the symbol",
        ),
        ({"position": POSITION, "tolerance": 0}, r"Target\.tolerance: expected .* above zero"),
        (
            {"position": POSITION, "tolerance": np.inf},
            r"Target\.tolerance: expected finite numbers",
        ),
        (
            {"position": POSITION, "weight": 1, "tolerance": 1},
            r"Target: expected a tolerance .* or a weight .*, found both",
        ),
    ],
    ids=str,
)
def test_wrong_targets_are_refused(fields, message):
    with pytest.raises(ValueError, match=message):
        cc.Target(**{"xi": 1.0, **fields})


def _evaluated(beam, targets, q=Q):
    symbol = ca.MX.sym("q", beam.basis.n)
    r = residuals(beam, targets, symbol)
    outputs = [r.to_meet, r.weighted, r.distances, r.angles]
    f = ca.Function("f", [symbol, r.positions, r.rotations], outputs)
    return r, [part.full().ravel() for part in f(q, *values_of(targets))]


def test_errors_are_fractions_of_the_length_and_rotation_vectors():
    beam = hale_wing()
    at_tip, inside = cc.pose_at(beam, Q, 1.0), cc.pose_at(beam, Q, 0.4)
    turn = np.array([0.3, -0.2, 0.1])
    targets = [
        cc.Target(xi=1, position=POSITION, rotation=at_tip.rotation @ oracle.rotation(-turn)),
        cc.Target(xi=0.4, position=[0, 1, 2], weight=4.0),
    ]
    r, (to_meet, weighted, distances, angles) = _evaluated(beam, targets)
    p = at_tip.position.full().ravel() - POSITION
    # Rounding of 16 m, and of the logarithm.
    assert_allclose(to_meet[:3], p / 16, atol=1e-14)
    assert_allclose(to_meet[3:], turn, atol=1e-14)
    assert_allclose(weighted, 2 * (inside.position.full().ravel() - [0, 1, 2]) / 16, atol=1e-14)
    assert_allclose(distances, [np.linalg.norm(p), 8 * np.linalg.norm(weighted)], rtol=1e-13)
    assert_allclose(angles, np.linalg.norm(turn), rtol=1e-13)
    assert_allclose(r.tolerances, 6 * [1e-6], rtol=0)


def test_tolerances_belong_to_their_targets_whatever_the_order_of_stations():
    targets = [
        cc.Target(xi=1, position=POSITION, tolerance=1e-3),
        cc.Target(xi=0.2, rotation=ROTATION),
        cc.Target(xi=0.6, position=POSITION, weight=1),
        cc.Target(xi=0.1, position=POSITION, tolerance=1e-2),
    ]
    r, (to_meet, *_) = _evaluated(hale_wing(), targets)
    assert_allclose(r.tolerances, np.repeat([1e-3, 1e-6, 1e-2], 3), rtol=0)
    early = cc.pose_at(hale_wing(), Q, 0.1).position.full().ravel()
    assert_allclose(to_meet[6:], (early - POSITION) / 16, atol=1e-14)  # rounding of 16 m


def test_residuals_have_the_structured_jacobian():
    q = ca.MX.sym("q", 9)
    r = residuals(hale_wing(), [cc.Target(xi=1, position=POSITION, rotation=ROTATION)], q)
    J = ca.Function("J", [q, r.positions, r.rotations], [ca.jacobian(r.to_meet, q)])
    names = {f.name() for f in J.find_functions()}
    assert "jac_target_poses" in names
    assert not [n for n in names if n.startswith(("fwd", "adj")) and "element" in n]


def test_smoothness_is_the_integral_of_curvature_and_slope_squared():
    # Legendre functions on [0, 1]: ∫ P_j P_k = δ/(2k + 1), ∫ P_j' P_k' = 2 j (j + 1), j ≤ k even.
    beam = hale_wing(1, 4, 1)
    mass = np.diag([1, 1 / 3, 1 / 5, 1 / 7])
    slope = np.array([[0, 0, 0, 0], [0, 4, 0, 4], [0, 0, 12, 0], [0, 4, 0, 24]])
    W = regularizer_matrix(beam, "smoothness").full()
    # Differences between 201 samples: (1/200)² times the squared slopes.
    assert_allclose(W[1:5, 1:5], 16**2 * (mass + slope), atol=16**2 * 24 * 2e-4)
    assert_allclose(W, W.T, rtol=1e-14)
    assert_allclose(W[0, 1:], 0, atol=1e-12)


def test_the_strain_energy_regularizer_is_the_strain_energy_over_rigidity_by_length():
    beam = hale_wing()
    W = regularizer_matrix(beam, "strain_energy").full()
    # U = ½ qᵀ S q, a polynomial integrated exactly.
    energy = float(cc.strain_energy(beam, Q))
    assert_allclose(Q @ W @ Q / 2, energy * 16 / 4e6, rtol=1e-12)


def test_limits_name_curvatures_and_angles():
    beam = replace(hale_wing(grid=cc.Grid.uniform(2)), weight_bounds=0.1)
    q = ca.MX.sym("q", 9)
    limits = shape_limits(beam, q, [np.inf, 0.02, np.inf])
    assert limits.names == (
        *(f"K_y at xi = {xi:.3g}" for xi in (0, 0.5, 1)),
        *("angle of element 0", "angle of element 1"),
    )
    assert_allclose(limits.lower, [-0.02] * 3 + [-np.inf] * 2, rtol=0)
    assert_allclose(limits.upper, [0.02] * 3 + [1] * 2, rtol=0)
    values = ca.Function("f", [q], [limits.expression])(Q).full().ravel()
    assert_allclose(values[:3], [(beam.basis(xi) @ Q)[1] for xi in (0, 0.5, 1)], atol=1e-16)


def test_beams_whose_elements_cannot_turn_too_far_need_no_limits():
    beam = replace(hale_wing(), weight_bounds=0.02)
    assert shape_limits(beam, ca.MX.sym("q", 9), None).names == ()


def test_a_target_at_the_root_is_measured_there():
    target = cc.Target(xi=0, position=[0, 0.5, 0])
    _, (to_meet, *_) = _evaluated(hale_wing(), [target])
    assert_allclose(to_meet, [0, -0.5 / 16, 0], rtol=1e-15)  # one division


def test_residual_functions_have_the_structured_jacobian_and_the_blocks_of_gauss_newton():
    beam = hale_wing()
    targets = [
        cc.Target(xi=1.0, position=[0, 14, -5], weight=4.0),
        cc.Target(xi=0.5, rotation=beam.root.rotation),
    ]
    f = cc.target_residual_function(beam, targets)
    assert f.name_in() == ["q", "positions", "rotations"]
    q = np.random.default_rng(1).uniform(-0.03, 0.03, 9)
    values = f(q=q, positions=targets[0].position, rotations=targets[1].rotation)
    e, J = values["residual"].full(), values["jacobian"].full()
    tip = cc.pose_at(beam, q, 1.0).position.full().ravel()
    assert_allclose(e[3:, 0], 2 * (tip - [0, 14, -5]) / 16, atol=1e-14)  # rounding
    step = 1e-6
    for k in range(9):
        shifted = [
            f(q=q + s * np.eye(9)[k], positions=targets[0].position, rotations=targets[1].rotation)
            for s in (step, -step)
        ]
        difference = (shifted[0]["residual"] - shifted[1]["residual"]).full() / (2 * step)
        # Rounding over the step, 1e-10, and the step squared times a third derivative, L³.
        assert_allclose(J[:, [k]], difference, atol=1e-8)
    assert_allclose(values["gradient"], J.T @ e, rtol=1e-13)
    assert_allclose(values["hessian"], J.T @ J, rtol=1e-13)
    names = {g.name() for g in f.find_functions()}
    assert "jac_target_poses" in names
    assert not [n for n in names if "element" in n and n.startswith(("fwd", "adj"))]
