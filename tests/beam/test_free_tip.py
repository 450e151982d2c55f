"""Functions for a tip that carries nothing, and what beams that have them refuse there."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.special import eval_legendre

import curvcasadi as cc

SECTION = cc.Section(GJ=1e4, EI_y=2e4, EI_z=4e6)
BENDING = cc.ChannelBasis(torsion=cc.Legendre(2), out_of_plane=cc.FreeTip(3))
TORSION = cc.ChannelBasis(torsion=cc.FreeTip(2, order=1), out_of_plane=cc.Legendre(3))


@pytest.mark.parametrize("order", [1, 2])
def test_functions_are_legendre_polynomials_times_a_zero_at_the_tip(order):
    f = cc.FreeTip(5, order=order)
    for xi in (0.0, 0.123, 0.77, 1.0):
        expected = (1 - xi) ** order * eval_legendre(np.arange(5), 2 * xi - 1)
        assert_allclose(f(xi), expected, atol=1e-15)


def test_one_weight_holds_the_moment_of_a_uniform_load():
    """A small uniform load bends a cantilever by m = w L² (1 − xi)²/2: the first function."""
    basis = cc.ChannelBasis(out_of_plane=cc.FreeTip(1))
    beam = cc.Beam(length=2.0, basis=basis, grid=cc.Grid.lobatto(8), section=SECTION)
    load = 1e-3
    found = cc.solve_equilibrium(beam, [cc.DistributedForce([0, 0, load], frame="follower")])
    # Deflections of 1e-7 m change the moment by 1e-14 of itself; what remains is the solver's.
    assert_allclose(float(found.q), -load * 2**2 / 2 / 2e4, rtol=1e-8)


def test_the_mirror_image_refuses_the_same(wing):
    left = cc.mirror(wing(4, basis=BENDING, section=SECTION))
    with pytest.raises(ValueError, match=r"PointForce: expected none at the tip.*out_of_plane"):
        cc.equilibrium_residual(left, np.zeros(5), [cc.PointForce(1.0, [0, 0, 1])])


def test_a_basis_of_moments_refuses_the_same(wing):
    basis = cc.ComplianceBasis(SECTION, torsion=cc.FreeTip(2, order=1))
    with pytest.raises(ValueError, match=r"Beam\.bodies: expected none at the tip.*torsion"):
        wing(4, basis=basis, section=SECTION, bodies=[cc.Body(xi=1.0, mass=1, offset=[0, 1, 0])])


INERTIA = np.diag([0.1, 0.1, 0.2])
BODIES = [
    cc.Body(xi=1.0, mass=1.0),
    cc.Body(xi=1.0, mass=1.0, offset=[0, 0.1, 0]),
    cc.Body(xi=1.0, mass=0.0, inertia=INERTIA),
    cc.Body(xi=1.0, mass=ca.MX.sym("mass")),
]
LOADS = [
    cc.PointForce(1.0, [0, 0, 1]),
    cc.PointForce(1.0, [0, 0, 1], frame="follower", offset=[0, 0.1, 0]),
    cc.PointMoment(1.0, [0, 1, 0]),
    cc.PointForce(1.0, ca.MX.sym("force", 3)),
]


@pytest.mark.parametrize("body", BODIES)
def test_bending_functions_refuse_a_tip_body(wing, body):
    with pytest.raises(ValueError, match=r"Beam\.bodies: .*tip.*basis\.out_of_plane.*order 2"):
        wing(4, basis=BENDING, bodies=[body])


@pytest.mark.parametrize("load", LOADS)
def test_bending_functions_refuse_a_tip_load(wing, load):
    beam = wing(4, basis=BENDING, section=SECTION)
    with pytest.raises(ValueError, match=rf"{type(load).__name__}: .*tip.*basis\.out_of_plane"):
        cc.equilibrium_residual(beam, np.zeros(5), [load])


@pytest.mark.parametrize("index", [1, 2])
def test_torsion_functions_refuse_what_twists_the_tip(wing, index):
    beam = wing(4, basis=TORSION, section=SECTION)
    with pytest.raises(ValueError, match=r"tip.*basis\.torsion.*order 1"):
        cc.equilibrium_residual(beam, np.zeros(5), [LOADS[index]])
    with pytest.raises(ValueError, match=r"Beam\.bodies.*basis\.torsion"):
        replace(beam, bodies=[BODIES[index]])


def test_torsion_functions_hold_a_force_or_mass_on_the_reference_curve(wing):
    beam = wing(4, basis=TORSION, section=SECTION, bodies=[BODIES[0]])
    residual = cc.equilibrium_residual(beam, np.zeros(5), [LOADS[0]])
    assert np.abs(residual.full()[2:]).max() > 0


def test_nothing_at_the_tip_and_loads_inboard_are_held(wing):
    inboard = [cc.Body(xi=0.9, mass=1.0, inertia=INERTIA), cc.Body(xi=1.0, mass=0.0)]
    beam = wing(4, basis=BENDING, section=SECTION, bodies=inboard)
    loads = [cc.PointForce(0.9, [0, 0, 1]), cc.PointForce(1.0, [0, 0, 0])]
    cc.equilibrium_residual(beam, np.zeros(5), [*loads, cc.PointMoment(0.5, [1, 1, 1])])


@pytest.mark.parametrize("order", [0, 3, "two"])
def test_a_wrong_order_is_named(order):
    with pytest.raises(ValueError, match=r"FreeTip\.order: expected one of 1, 2; found"):
        cc.FreeTip(3, order=order)
