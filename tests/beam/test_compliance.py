"""A basis of moments: smooth where the section jumps, and what it becomes without jumps."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose

import curvcasadi as cc

JUMP = 0.4
INNER = np.array([[3.0, 0.4, -0.2], [0.4, 2.0, 0.1], [-0.2, 0.1, 9.0]])
OUTER = np.array([[1.0, -0.1, 0.3], [-0.1, 0.5, 0.2], [0.3, 0.2, 4.0]])
FAMILIES = {"torsion": cc.Legendre(2), "out_of_plane": cc.Legendre(3), "in_plane": cc.Legendre(1)}


@pytest.fixture
def section():
    return cc.Section.from_stiffness(cc.Steps([0, JUMP, 1], [INNER, OUTER]))


def test_moments_of_each_weight_are_functions_of_its_channel(section):
    basis, channels = cc.ComplianceBasis(section, **FAMILIES), cc.ChannelBasis(**FAMILIES)
    stiffness = JUMP * np.linalg.inv(INNER) + (1 - JUMP) * np.linalg.inv(OUTER)
    mean = np.diag(1 / np.diag(stiffness))
    for xi in (0.0, 0.3, JUMP - 1e-9, JUMP, 0.9, 1.0):
        moments = section.stiffness(xi).full() @ basis(xi)
        assert_allclose(moments, mean @ channels(xi), atol=1e-13)  # rounding


def test_the_mean_curvature_of_constant_moments_is_the_weight(section):
    only = cc.ComplianceBasis(section, out_of_plane=cc.Legendre(1))
    mean = JUMP * only(0.1) + (1 - JUMP) * only(0.9)
    assert_allclose(mean[1, 0], 1, rtol=1e-14)


def test_on_a_uniform_uncoupled_section_it_is_the_channel_basis():
    basis = cc.ComplianceBasis(cc.Section(GJ=1e4, EI_y=2e4, EI_z=4e6), **FAMILIES)
    channels = cc.ChannelBasis(**FAMILIES)
    assert basis.labels == channels.labels and basis.n == channels.n == 6
    for xi in (0.0, 0.37, 1.0):
        assert_allclose(basis(xi), channels(xi), atol=1e-14)


def test_breaks_are_those_of_the_section_and_of_the_families(section):
    basis = cc.ComplianceBasis(section, torsion=cc.PiecewiseConstant(2))
    assert basis.breaks == (JUMP, 0.5)


def test_constant_moments_are_held_exactly_over_a_jump(section):
    """A follower moment at the tip of a jumping beam: two arcs, by two weights of each kind."""
    ei = {"GJ": 1.0, "EI_z": 1.0}
    stepped = cc.Section(EI_y=cc.Steps([0, JUMP, 1], [2.0, 0.5]), **ei)
    beam = cc.Beam(
        length=1.0,
        basis=cc.ComplianceBasis(stepped, out_of_plane=cc.Legendre(1)),
        grid=cc.Grid.uniform(8),
        section=stepped,
    )
    found = cc.solve_equilibrium(beam, [cc.PointMoment(1.0, [0, 0.8, 0], frame="follower")])
    for xi, stiffness in ((0.2, 2.0), (0.8, 0.5)):
        k = cc.curvature(beam, found.q, xi).full().ravel()
        assert_allclose(k, [0, 0.8 / stiffness, 0], atol=1e-9)  # the solver's tolerance


def test_the_mirror_image_has_mirrored_curvatures_for_the_same_weights(section, wing):
    right = wing(8, basis=cc.ComplianceBasis(section, **FAMILIES), section=section)
    left = cc.mirror(right)
    rebuilt = cc.ComplianceBasis(left.section, **FAMILIES)
    q = np.linspace(-0.1, 0.1, 6)
    signs = np.diag([-1, -1, 1])
    for xi in (0.1, 0.7):
        k = [cc.curvature(beam, q, xi).full() for beam in (right, left)]
        assert_allclose(k[1], signs @ k[0], atol=1e-15)
        # The basis of the mirrored section counts moments of its own axes.
        own = rebuilt(xi) @ np.diag([-1, -1, -1, -1, -1, 1])
        assert_allclose(left.basis(xi), own, atol=1e-13)


def test_shapes_take_every_kind_of_weights(section, wing, evaluate):
    beam = wing(4, basis=cc.ComplianceBasis(section, **FAMILIES), section=section)
    q = np.linspace(-0.1, 0.1, 6)
    tip = evaluate(lambda q: cc.shape_map(beam, q).tip.position, q)
    assert_allclose(tip, cc.tip_function(beam)(q)[0].full(), atol=1e-12)


def test_a_design_symbol_in_the_beams_section_leaves_the_basis_numeric(section, wing):
    beam = wing(4, basis=cc.ComplianceBasis(section, **FAMILIES), section=section)
    soft = replace(beam, section=cc.Section(GJ=ca.SX.sym("GJ"), EI_y=2.0, EI_z=9.0))
    energy = cc.strain_energy(soft, np.linspace(-0.1, 0.1, 6))
    assert isinstance(energy, ca.SX)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"section": None}, r"ComplianceBasis\.section: expected a Section, found None"),
        (
            {"section": cc.Section(GJ=ca.SX.sym("GJ"), EI_y=1, EI_z=1)},
            r"ComplianceBasis\.section: expected numbers, found symbols: GJ",
        ),
        ({"torsion": None}, "expected a family for torsion, out_of_plane or in_plane"),
        ({"torsion": 3}, r"torsion: expected a family such as Legendre\(4\), found 3"),
    ],
)
def test_wrong_arguments_are_named(arguments, message):
    defaults = {"section": cc.Section(GJ=1, EI_y=1, EI_z=1), "torsion": cc.Legendre(2)}
    with pytest.raises(ValueError, match=message):
        cc.ComplianceBasis(**{**defaults, **arguments})
