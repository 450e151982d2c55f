"""The chain of calls to one element step."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose

import curvcasadi as cc
from curvcasadi.kinematics import chain
from tests.support.oracle import CURLED_WEIGHTS


def compact(beam):
    q = ca.MX.sym("q", beam.basis.n)
    tip = cc.shape_map(beam, q).tip
    return ca.Function("f", [q], [tip.position, tip.rotation], {"cse": True})


def test_one_step_serves_all_beams_of_a_rule_and_basis(wing):
    beams = [wing(4), wing(9, kind="lobatto"), replace(wing(4), length=3.0), cc.mirror(wing(4))]
    patterns = [chain.build(beam, (1.0,)).pattern for beam in beams[:3]]
    steps = {id(chain.pose_step(pattern)) for pattern in patterns}
    assert len(steps) == 1
    for beam in beams:
        functions = compact(beam).find_functions()
        assert [f.name() for f in functions].count("element_pose") == 1


def test_channels_of_one_family_share_their_data(wing):
    one = cc.Beam(
        length=16.0,
        basis=cc.ChannelBasis(in_plane=cc.Legendre(4)),
        grid=cc.Grid.uniform(16, max_angle=1.5),
    )
    three = wing(16)
    sizes = [chain.build(beam, (1.0,)).data[0].numel() for beam in (one, three)]
    assert sizes[0] == sizes[1]


def test_compact_form_takes_a_fixed_number_of_nodes_an_element(wing):
    counts = [compact(wing(n)).n_instructions() for n in (8, 16, 32)]
    assert counts[2] - counts[1] == 2 * (counts[1] - counts[0])
    assert counts[2] <= 6 * 32  # a call, its data, and what goes between them


@pytest.mark.parametrize("rule", ["trapezoid", "midpoint", "magnus4", "magnus6"])
def test_other_stations_do_not_change_a_pose(wing, rule):
    beam = wing(4, rule)
    several = cc.pose_function("poses", beam, (0.3, 0.31, 0.9, 1.0))(CURLED_WEIGHTS)[0]
    alone = [cc.pose_at(beam, CURLED_WEIGHTS, xi).position for xi in (0.3, 0.31, 0.9, 1.0)]
    assert_allclose(several, ca.horzcat(*alone), rtol=0, atol=1e-14)  # rounding


def test_functions_are_evaluated_on_their_own_side_of_a_jump():
    seen = []

    def function(xi):
        seen.append(xi)
        return np.full((3, 1), 0.1 if xi < 0.4 else -0.1)

    basis = cc.VectorBasis(function, 1, breaks=(0.4,))
    beam = cc.Beam(length=1.0, basis=basis, grid=cc.Grid.uniform(5, rule="trapezoid"))
    seen.clear()
    chain.build(beam, (1.0,))
    assert 0.4 not in seen
    assert min(abs(xi - 0.4) for xi in seen) < 1e-15


def test_a_basis_that_vanishes_leaves_the_straight_wing(kind):
    basis = cc.VectorBasis(lambda xi: np.zeros((3, 2)), 2)
    beam = cc.Beam(length=2.0, basis=basis, grid=cc.Grid.uniform(3))
    q = [0.3, 0.4] if kind is ca.DM else kind.sym("q", 2)
    tip = ca.evalf(cc.shape_map(beam, q).tip.position) if kind is ca.DM else None
    if tip is None:
        tip = ca.Function("f", [q], [cc.shape_map(beam, q).tip.position])([0.3, 0.4])
    assert_allclose(tip, [[2], [0], [0]], atol=1e-15)
    assert_allclose(cc.body_jacobian(beam, [0.3, 0.4]), np.zeros((6, 2)), atol=0)
