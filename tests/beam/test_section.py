"""Sections, tables along the span, discrete bodies."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.linalg import block_diag

import curvcasadi as cc

COUPLED = np.array([[3.0, 0.5, -0.2], [0.5, 2.0, 0.4], [-0.2, 0.4, 9.0]])
PLAIN = cc.Section(GJ=1, EI_y=2, EI_z=3)


def beam(section, **fields):
    return cc.Beam(
        length=2.0,
        basis=cc.ChannelBasis(
            torsion=cc.Legendre(2), out_of_plane=cc.Legendre(2), in_plane=cc.Legendre(2)
        ),
        grid=cc.Grid.lobatto(4),
        section=section,
        **fields,
    )


def test_rigidities_and_couplings_make_the_stiffness():
    section = cc.Section(GJ=3, EI_y=2, EI_z=9, coupling_xy=0.5, coupling_xz=-0.2, coupling_yz=0.4)
    assert_array_equal(section.stiffness(0.3).full(), COUPLED)
    assert_array_equal(cc.Section.from_stiffness(COUPLED).stiffness(0.3).full(), COUPLED)


def test_a_full_stiffness_may_vary_and_jump_along_the_span():
    section = cc.Section.from_stiffness(cc.Steps([0, 0.4, 1], [COUPLED, 2 * COUPLED]))
    assert section.breaks == (0.4,)
    assert_array_equal(section.stiffness(0.399).full(), COUPLED)
    assert_array_equal(section.stiffness(0.401).full(), 2 * COUPLED)
    smooth = cc.Section.from_stiffness(lambda xi: (1 + xi) * COUPLED)
    assert_allclose(smooth.stiffness(0.25).full(), 1.25 * COUPLED, rtol=1e-15)


def test_the_energy_of_coupled_curvatures():
    q = np.array([0.3, -0.1, 0.2, 0.4, -0.5, 0.1])
    # ½ L ∫ (Φ q)ᵀ C Φ q, with ∫ P_j P_k dxi = δ_jk/(2 k + 1).
    means, slopes = q[::2], q[1::2]
    expected = 2.0 / 2 * (means @ COUPLED @ means + slopes @ COUPLED @ slopes / 3)
    got = cc.strain_energy(beam(cc.Section.from_stiffness(COUPLED)), q)
    assert_allclose(float(got), expected, rtol=1e-14)  # rounding


def test_the_energy_of_a_table_is_the_sum_over_its_intervals():
    table = cc.Section.from_stiffness(cc.Steps([0, 0.3, 1], [COUPLED, np.eye(3)]))
    mean = np.array([0.3, 0, -0.2, 0, 0.5, 0])
    k = mean[::2]
    expected = 2.0 / 2 * (0.3 * k @ COUPLED @ k + 0.7 * k @ k)
    assert_allclose(float(cc.strain_energy(beam(table), mean)), expected, rtol=1e-14)


def test_elements_end_at_jumps_and_bodies():
    section = replace(PLAIN, mass_per_length=cc.Steps([0, 0.37, 1], [1, 2]), breaks=(0.61,))
    rod = beam(section, bodies=(cc.Body(xi=0.83, mass=1),))
    assert section.breaks == (0.37, 0.61)
    assert rod.breaks == (0.37, 0.61, 0.83)
    assert {0.37, 0.61, 0.83} <= set(rod.stations.tolist())


def test_stiffness_symbols_and_functions_of_symbols(symbolic):
    C = symbolic.sym("C", 3, 3)
    section = cc.Section.from_stiffness(C)
    f = ca.Function("f", [C], [section.stiffness(0.5)])
    assert_array_equal(f(COUPLED).full(), COUPLED)
    varying = cc.Section.from_stiffness(lambda xi: (2 - xi) * C)
    f = ca.Function("f", [C], [varying.stiffness(0.5)])
    assert_array_equal(f(COUPLED).full(), 1.5 * COUPLED)


def test_axial_strain_is_condensed_as_a_minimum_of_the_energy():
    rng = np.random.default_rng(3)
    half = rng.normal(size=(4, 4))
    full = half @ half.T + np.diag([50.0, 1, 1, 1])
    condensed = cc.condense_axial(full)
    for curvature in rng.normal(size=(5, 3)):
        # min over ε of ½ (ε, K)ᵀ S (ε, K), by a dense constrained solve with multipliers.
        constraint = np.hstack([np.zeros((3, 1)), np.eye(3)])
        matrix = np.block([[full, constraint.T], [constraint, np.zeros((3, 3))]])
        strain = np.linalg.solve(matrix, [0, 0, 0, 0, *curvature])[:4]
        assert_allclose(curvature @ condensed @ curvature, strain @ full @ strain, rtol=1e-12)
        assert_allclose(full[0] @ strain, 0, atol=1e-12 * np.abs(full).max())  # no axial force
    uncoupled = block_diag(5.0, COUPLED)
    assert_array_equal(cc.condense_axial(uncoupled), COUPLED)


def test_mass_and_centre_of_mass_along_the_span():
    section = replace(
        PLAIN,
        mass_per_length=cc.Steps([0, 0.5, 1], [1.0, 3.0]),
        center_of_mass=lambda xi: [0, xi, 0],
    )
    assert (section.mass_at(0.2), section.mass_at(0.7)) == (1.0, 3.0)
    assert_array_equal(section.center_of_mass_at(0.2).full().ravel(), [0, 0.2, 0])


def test_a_body_without_inertia_or_offset_is_a_point_mass():
    body = cc.Body(xi=0.5, mass=2)
    assert_array_equal(body.inertia, np.zeros((3, 3)))
    assert_array_equal(body.offset.full(), np.zeros((3, 1)))


UNSYMMETRIC = [[1, 0.5, 0], [0.4, 1, 0], [0, 0, 1]]
INDEFINITE = [[1, 2, 0], [2, 1, 0], [0, 0, 1]]


@pytest.mark.parametrize(
    "make, message",
    [
        (lambda: cc.Section(GJ=0, EI_y=1, EI_z=1), r"Section\.GJ: expected .*above zero, found 0"),
        (lambda: cc.Section(GJ=1, EI_y=-1, EI_z=1), r"Section\.EI_y: .*above zero, found -1"),
        (lambda: cc.Section(GJ=1, EI_y=1, EI_z=[1, 2]), r"Section\.EI_z: expected shape \(1, 1\)"),
        (lambda: cc.Section(GJ=1, EI_y=1, EI_z=np.nan), r"Section\.EI_z: expected finite"),
        (
            lambda: cc.Section(GJ=1, EI_y=1, EI_z=1, coupling_xy=[1, 2]),
            r"Section\.coupling_xy: expected shape \(1, 1\), found \(2,",
        ),
        (
            lambda: cc.Section(GJ=1, EI_y=1, EI_z=1, coupling_xy=1.5),
            r"Section stiffness.*: expected a positive definite matrix, found \[\[1\.0, 1\.5",
        ),
        (
            lambda: cc.Section.from_stiffness(UNSYMMETRIC),
            r"stiffness: expected a symmetric matrix, to 1e-08 of .*; found 0\.5 and 0\.4",
        ),
        (
            lambda: cc.Section.from_stiffness(INDEFINITE),
            r"stiffness: expected a positive definite matrix, found \[\[1\.0, 2\.0",
        ),
        (lambda: cc.Section.from_stiffness(np.eye(4)), r"stiffness: expected shape \(3, 3\)"),
        (
            lambda: replace(PLAIN, mass_per_length=-0.5),
            r"mass_per_length: .*zero, found -0\.5",
        ),
        (lambda: replace(PLAIN, inertia=UNSYMMETRIC), r"Section\.inertia: expected a symmetric"),
        (lambda: replace(PLAIN, inertia=np.eye(2)), r"Section\.inertia: expected shape \(3, 3\)"),
        (lambda: replace(PLAIN, center_of_mass=[0, 1]), r"Section\.center_of_mass: .*\(3, 1\)"),
        (lambda: cc.Body(xi=1.5, mass=1), r"Body\.xi: expected .*\[0, 1\], found 1\.5"),
        (lambda: cc.Body(xi=1, mass=-1), r"Body\.mass: expected .*not below zero, found -1"),
        (lambda: cc.Body(xi=1, mass=1, offset=[1]), r"Body\.offset: expected shape \(3, 1\)"),
        (lambda: cc.Body(xi=1, mass=1, inertia=UNSYMMETRIC), r"Body\.inertia: .*symmetric"),
        (
            lambda: cc.Body(xi=1, mass=1, inertia=np.diag([1, 1, 2.1])),
            r"Body\.inertia: expected principal moments of which none .*found 1, 1 and 2\.1",
        ),
        (lambda: cc.condense_axial(np.eye(3)), r"stiffness: expected shape \(4, 4\)"),
        (lambda: cc.condense_axial(-np.eye(4)), r"stiffness: expected a positive definite"),
        (
            lambda: cc.Steps([0, 0.5], [1.0]),
            r"Steps\.xi: expected increasing .*found \[0\.0, 0\.5\]",
        ),
        (lambda: cc.Steps([0.1, 1], [1.0]), r"Steps\.xi: .*0 to 1, found \[0\.1, 1\.0\]"),
        (
            lambda: cc.Steps([0, 0.6, 0.4, 1], [1, 2, 3]),
            r"Steps\.xi: expected increasing",
        ),
        (lambda: cc.Steps([0, 0.5, 1], [1.0]), r"Steps\.values: expected 2 values, .*found 1"),
    ],
)
def test_bad_sections_are_refused(make, message):
    with pytest.raises(ValueError, match=message):
        make()


@pytest.mark.parametrize(
    "section, message",
    [
        (replace(PLAIN, GJ=lambda xi: 0.9 - xi), r"Section\.GJ at xi = .*above zero, found -"),
        (
            replace(PLAIN, GJ=lambda xi: 1.0, coupling_xy=lambda xi: 3 * xi),
            r"Section stiffness at xi = .*expected a positive definite matrix",
        ),
        (
            cc.Section.from_stiffness(lambda xi: np.array(UNSYMMETRIC)),
            r"stiffness at xi = .*expected a symmetric matrix",
        ),
        (
            cc.Section.from_stiffness(cc.Steps([0, 0.5, 1], [np.eye(3), INDEFINITE])),
            r"stiffness at xi = 0\.[5-9].*expected a positive definite matrix",
        ),
    ],
    ids=["rigidity", "coupling", "unsymmetric", "table"],
)
def test_a_bad_stiffness_along_the_span_names_the_station(section, message):
    with pytest.raises(ValueError, match=message):
        cc.strain_energy(beam(section), np.zeros(6))


def test_mass_is_asked_for_where_it_is_needed():
    with pytest.raises(ValueError, match=r"Section\.mass_per_length: expected kg/m, found None"):
        PLAIN.mass_at(0.5)


def test_a_beam_refuses_what_is_no_section():
    with pytest.raises(ValueError, match=r"Beam\.section: expected a Section, found"):
        beam(COUPLED)
