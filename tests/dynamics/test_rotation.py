"""Inertial forces in a steady rotation, against the equations of motion."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

import curvcasadi as cc
from curvcasadi.lie import se3
from tests.support.moving_wing import GRAVITY, N, close, evaluated, motion, wing

TWIST = np.random.default_rng(1).normal(size=6)
LOADS = [cc.Gravity(GRAVITY), cc.SteadyRotation(angular_rate=TWIST[:3], velocity=TWIST[3:])]


@pytest.mark.parametrize("kind", ["SX", "MX", "DM"])
def test_residual_is_that_of_the_equations_of_motion_at_rest_in_a_turning_parent(kind):
    beam, q = wing(), motion()[0]
    inward = beam.root.inverse()
    twist = se3.adjoint(se3.matrix(inward.rotation, inward.position)) @ ca.DM(TWIST)
    still, root = np.zeros(N), cc.RootMotion(twist=twist)
    expected = cc.inverse_dynamics(beam, q, still, still, LOADS[:1], root)
    (found,) = evaluated(kind, [q], lambda q: [cc.equilibrium_residual(beam, q, LOADS)])
    close(found, expected, 1e-14)


def test_tangent_is_the_derivative():
    beam, symbol = wing(), ca.MX.sym("q", N)
    _, tangent = cc.equilibrium_tangent(beam, symbol, LOADS)
    by_ad = ca.jacobian(cc.equilibrium_residual(beam, symbol, LOADS), symbol)
    close(*ca.Function("f", [symbol], [tangent, by_ad])(motion()[0]))


def test_a_turning_mass_pulls_outward():
    beam = replace(wing(), root=cc.Pose.identity())
    load = cc.SteadyRotation(angular_rate=[0, 0, 3.0])
    wrench = cc.root_wrench(beam, np.zeros(N), [load]).full().ravel()
    # The mass along x, 3 and 1 kg of bodies included, at its distance from the axis, in ω².
    moments = [0.3**2 / 2 * 1.1, (1 - 0.3**2) / 2 * 0.75]
    expected = 9 * (16**2 * sum(moments) + 16 * 0.02 * (0.3 * 1.1 + 0.7 * 0.75))
    expected += 9 * (2.0 * 16.1 + 1.0 * 4.8)
    np.testing.assert_allclose(wrench[3], expected, rtol=1e-12)


def test_what_is_wrong_is_named():
    with pytest.raises(ValueError, match="loads: expected no SteadyRotation in dynamics"):
        cc.inverse_dynamics(wing(), *motion(), LOADS)
    with pytest.raises(ValueError, match=r"SteadyRotation.angular_rate: expected shape \(3, 1\)"):
        cc.SteadyRotation(angular_rate=3.0)
    light = replace(wing(), section=cc.Section(GJ=1, EI_y=1, EI_z=1), bodies=())
    with pytest.raises(ValueError, match="need mass"):
        cc.equilibrium_residual(light, np.zeros(N), LOADS[1:])
