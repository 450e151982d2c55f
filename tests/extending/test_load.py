"""A load of the user's, defined in this file alone: a spring between the wing and an anchor."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose

import curvcasadi as cc


@dataclass(frozen=True, eq=False, kw_only=True)
class Spring(cc.Load):
    """A spring without a length of its own, from the reference curve to an anchor."""

    xi: float  #: station s/L
    stiffness: Any  #: N/m; a number or a symbol
    anchor: Any  #: (3,), m, parent axes

    @property
    def breaks(self):
        return (self.xi,)

    def is_distributed(self, beam):
        return False

    def contributions(self, beam, mesh, to_parent):
        yield mesh.node(self.xi), ca.vertcat(self.stiffness, ca.vertcat(*self.anchor))

    @staticmethod
    def wrench(rotation, position, data):
        force = data[0] * (data[1:] - position)
        return ca.vertcat(ca.cross(position, force), force)


WING = cc.Beam(
    length=16.0,
    basis=cc.ChannelBasis(torsion=cc.Legendre(1), out_of_plane=cc.Legendre(3)),
    grid=cc.Grid.lobatto(8),
    section=cc.Section(GJ=1e4, EI_y=2e4, EI_z=4e6, mass_per_length=0.75),
    root=cc.Pose(rotation=[[0, 1, 0], [1, 0, 0], [0, 0, -1]], position=[0, 0, 0]),
)
SHAPE = 0.03 * np.sin(1 + np.arange(4))
ANCHOR = [1.0, 14.0, -9.0]
SPRING = Spring(xi=0.7, stiffness=20.0, anchor=ANCHOR)


def test_its_work_is_the_gradient_of_its_energy(kind):
    q = ca.MX.sym("q", WING.basis.n)
    stretched = ca.vertcat(*ANCHOR) - cc.pose_at(WING, q, 0.7).position
    energy = 20.0 * ca.sumsqr(stretched) / 2
    expected = -ca.Function("g", [q], [ca.gradient(energy, q)])(SHAPE)
    found = cc.generalized_force(WING, ca.DM(SHAPE), [SPRING])
    # The station is one of the loaded mesh, and an element's part of the beam's: magnus4's error.
    assert_allclose(found, expected, rtol=1e-5, atol=1e-5 * float(ca.norm_inf(expected)))


def test_its_slope_is_that_of_its_work():
    q = ca.MX.sym("q", WING.basis.n)
    residual, tangent = cc.equilibrium_tangent(WING, q, [SPRING])
    found, by_ad = ca.Function("f", [q], [tangent, ca.jacobian(residual, q)])(SHAPE)
    assert_allclose(found, by_ad, rtol=0, atol=1e-12 * float(ca.norm_inf(by_ad)))


def test_the_wing_rests_where_a_dead_force_of_its_size_would_hold_it():
    gravity = cc.Gravity([0, 0, 9.81])
    rest = cc.solve_equilibrium(WING, [SPRING, gravity])
    assert float(ca.norm_2(rest.q)) > 1e-2
    pulled = ca.DM(ANCHOR) - _at_spring(rest.q)
    same = cc.solve_equilibrium(WING, [cc.PointForce(0.7, 20.0 * pulled), gravity], q_guess=rest.q)
    assert_allclose(same.q, rest.q, atol=1e-9)


def _at_spring(q):
    """Position of the spring's end on the mesh of the loaded beam."""
    force = cc.root_wrench(WING, q, [SPRING])[3:] / 20.0
    return ca.DM(ANCHOR) - force


def test_its_stiffness_may_be_a_parameter_in_exported_c(tmp_path):
    stiffness = ca.MX.sym("stiffness")
    spring = Spring(xi=0.7, stiffness=stiffness, anchor=ANCHOR)
    rest = cc.equilibrium_function(WING, [spring], {"stiffness": stiffness})
    start = cc.solve_equilibrium(WING, [SPRING]).q
    assert_allclose(rest(start, 20.0), start, atol=1e-9)
    slope = ca.Function("s", [stiffness], [ca.jacobian(rest(start, stiffness), stiffness)])
    step = 1e-3
    difference = (rest(start, 20 + step) - rest(start, 20 - step)) / (2 * step)
    assert_allclose(slope(20.0), difference, rtol=1e-6, atol=1e-9)
    export = cc.CFunction(function=rest, unchecked=True)
    cc.export_c([export], tmp_path, reference_inputs={"equilibrium": [(start, 20.0)]})
    assert cc.export.run_check(tmp_path)["equilibrium"] <= 1e-12


def test_what_is_no_load_is_refused():
    with pytest.raises(ValueError, match=r"loads: expected loads such as PointForce.*found 3"):
        cc.solve_equilibrium(WING, [3])


class Damper(Spring):
    """Force −c v at the station, c in the place of the stiffness, N s/m."""

    order = 1

    @staticmethod
    def wrench(rotation, position, data, twist):
        force = -data[0] * (rotation @ twist[3:])
        return ca.vertcat(ca.cross(position, force), force)


def test_damping_acts_in_motion_and_not_at_rest():
    damper, rate = Damper(xi=0.7, stiffness=3.0, anchor=ANCHOR), 0.1 * np.cos(np.arange(4))
    assert_allclose(cc.generalized_force(WING, SHAPE, [damper]), 0, atol=0)
    section = replace(WING.section, inertia=np.diag([0.1, 0.05, 0.05]))
    wing = replace(WING, section=section, grid=cc.Grid.lobatto(32))
    free, damped = (
        cc.inverse_dynamics(wing, SHAPE, rate, np.zeros(4), loads) for loads in ([], [damper])
    )
    # r = … − Q, so damping adds the power c |v|² to q_dotᵀ r.
    velocity = cc.body_twist(wing, SHAPE, rate, 0.7)[3:]
    power = float(ca.dot(ca.DM(rate), damped - free))
    assert_allclose(
        power, 3.0 * float(ca.sumsqr(velocity)), rtol=1e-6
    )  # of magnus4 on another mesh
