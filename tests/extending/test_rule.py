"""A rule of elements of the user's, defined in this file alone: Magnus' series by Simpson."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose

import curvcasadi as cc

E_X = ca.DM([1, 0, 0])


@dataclass(frozen=True)
class Simpson:
    """θ = h/6 (K_1 + 4 K_2 + K_3) + h²/12 K_1 × K_3, v = h e_x + h²/12 (K_1 − K_3) × e_x.

    With the moments M_1 = h/6 (K_1 + 4 K_2 + K_3), M_2 = h K_1, M_3 = h K_3.
    """

    points = (0.0, 0.5, 1.0)
    weights = ((1 / 6, 4 / 6, 1 / 6), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    order = 4

    def strain(self, h, moments):
        mean, first, last = moments[:, 0], moments[:, 1], moments[:, 2]
        theta = mean + ca.cross(first, last) / 12
        return theta, h * (E_X + ca.cross(first - last, E_X) / 12)


def beam(elements, rule):
    return cc.Beam(
        length=2.0,
        basis=cc.ChannelBasis(cc.Legendre(2), cc.Legendre(3), cc.Legendre(1)),
        grid=cc.Grid.uniform(elements, rule=rule),
        section=cc.Section(GJ=3.0, EI_y=5.0, EI_z=50.0),
    )


Q = [0.4, -0.3, 0.5, 0.8, -0.4, 0.2]


def test_its_error_has_the_order_that_it_states():
    exact = cc.shape_map(beam(64, "magnus6"), Q).tip
    errors = []
    for elements in (8, 16, 32):
        tip = cc.shape_map(beam(elements, Simpson()), Q).tip
        errors.append(np.linalg.norm((tip.position - exact.position).full()))
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    assert_allclose(orders, Simpson.order, atol=0.15)


def test_its_poses_are_rotations_with_their_structured_jacobian():
    wing, q = beam(8, Simpson()), ca.MX.sym("q", 6)
    tip = cc.tip_function(wing)
    position, _ = tip(q)
    assert "jac_tip" in {
        f.name() for f in ca.Function("j", [q], [ca.jacobian(position, q)]).find_functions()
    }
    R = tip(Q)[1].full()
    assert_allclose(R.T @ R, np.eye(3), atol=1e-14)
    plain = cc.pose_at(wing, q, 1.0).position
    found, by_ad = ca.Function("f", [q], [ca.jacobian(p, q) for p in (position, plain)])(Q)
    assert_allclose(found, by_ad, atol=1e-13)


def test_statics_use_it():
    loads = [cc.PointForce(1.0, [0.3, 1.0, -2.0], frame="follower")]
    q = ca.MX.sym("q", 6)
    wing = beam(8, Simpson())
    residual, tangent = cc.equilibrium_tangent(wing, q, loads)
    found, by_ad = ca.Function("f", [q], [tangent, ca.jacobian(residual, q)])(Q)
    assert_allclose(found, by_ad, atol=1e-12 * float(ca.norm_inf(by_ad)))
    fine = cc.solve_equilibrium(beam(32, "magnus6"), loads).q
    assert_allclose(cc.solve_equilibrium(beam(32, Simpson()), loads).q, fine, atol=1e-5)


def test_it_runs_as_c_and_the_manifest_names_it(tmp_path):
    wing = beam(8, Simpson())
    manifest = cc.export_c(
        [cc.CFunction(function=cc.tip_function(wing), weights={"q": wing})], tmp_path
    )
    assert cc.export.run_check(tmp_path)["tip"] <= 1e-13
    assert "Simpson" in str(manifest)


class Wrong(Simpson):
    points = (0.0, 0.5)


class Outside(Simpson):
    points = (0.0, 0.5, 1.5)


@pytest.mark.parametrize(
    ("rule", "message"),
    [
        (Wrong(), r"Grid\.rule\.weights: expected 2 numbers a row"),
        (Outside(), r"Grid\.rule\.points: expected numbers in \[0, 1\]"),
        (3, r"Grid\.rule: expected one of 'trapezoid'"),
    ],
)
def test_what_is_no_rule_is_refused(rule, message):
    with pytest.raises(ValueError, match=message):
        cc.Grid.uniform(4, rule=rule)
