"""Strain energy against closed forms and quadrature."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from numpy.testing import assert_allclose
from scipy.integrate import quad

import curvcasadi as cc
from curvcasadi.statics.balance import balance, parameter_slopes, root_wrench
from curvcasadi.statics.energy import stiffness_matrix
from tests.support.oracle import CURLED_WEIGHTS, curled_curvature, rotation

SECTION = cc.Section(GJ=1e4, EI_y=2e4, EI_z=4e6)


def by_quadrature(beam, curvature, stiffness, breaks=()):
    """½ L ∫ Kᵀ C K dxi, with K the curvature above the initial one."""
    edges = [0.0, *breaks, 1.0]
    total = sum(
        quad(lambda x: curvature(x) @ stiffness(x) @ curvature(x), a, b, epsabs=0, epsrel=1e-12)[0]
        for a, b in pairwise(edges)
    )
    return float(beam.length) * total / 2


def test_energy_of_legendre_weights_is_a_weighted_sum_of_squares(wing, evaluate):
    beam = wing(3, section=SECTION)
    # ∫ P_j P_k dxi = δ_jk/(2 k + 1).
    squares = CURLED_WEIGHTS.reshape(3, 4) ** 2 / (2 * np.arange(4) + 1)
    expected = 16.0 / 2 * np.array([1e4, 2e4, 4e6]) @ squares.sum(axis=1)
    got = evaluate(lambda q: cc.strain_energy(beam, q), CURLED_WEIGHTS)
    assert_allclose(got.item(), expected, rtol=1e-14)  # exact by Gauss points: rounding


@pytest.mark.parametrize("row", range(6))
def test_energy_of_the_roll_up_case_01(published, row):
    case = published("01")["reference"][row]
    beam = cc.Beam(
        length=1.0,
        basis=cc.ChannelBasis(out_of_plane=cc.Legendre(1)),
        grid=cc.Grid.uniform(1),
        section=cc.Section(GJ=1, EI_y=1, EI_z=1),
    )
    # Ten digits. The energy does not ask whether one element could turn that far.
    assert_allclose(cc.strain_energy(beam, [case["K_const"]]), case["strain_energy"], rtol=1e-9)


def test_energy_does_not_depend_on_the_grid_or_the_initial_curvature(wing):
    beam = wing(1, "trapezoid", section=SECTION)
    fine = wing(64, "magnus6", kind="lobatto", section=SECTION, initial_curvature=[0.1, 0.2, 0.3])
    a, b = (cc.strain_energy(x, CURLED_WEIGHTS) for x in (beam, fine))
    assert_allclose(a, b, rtol=1e-15)


def test_energy_with_sections_along_the_span_and_breaks(wing):
    def stiffness(xi):
        return np.diag([1e4 * (2 - xi), 2e4 * (1 - 0.8 * xi) ** 3, 4e6 if xi < 0.37 else 1e6])

    section = cc.Section(
        GJ=lambda xi: stiffness(xi)[0, 0],
        EI_y=lambda xi: stiffness(xi)[1, 1],
        EI_z=lambda xi: stiffness(xi)[2, 2],
        breaks=(0.37,),
    )
    beam = wing(4, section=section)
    expected = by_quadrature(beam, curled_curvature, stiffness, (0.37,))
    # Polynomials between the breaks: rounding of the quadrature.
    assert_allclose(cc.strain_energy(beam, CURLED_WEIGHTS), expected, rtol=1e-12)


@pytest.mark.parametrize(
    "family",
    [
        cc.Chebyshev(4),
        cc.Monomial(5),
        cc.BSpline(6),
        cc.PiecewiseConstant(5),
        cc.CantileverModes(5),
    ],
    ids=str,
)
def test_energy_of_every_family(family):
    basis = cc.ChannelBasis(out_of_plane=family)
    beam = cc.Beam(length=3.0, basis=basis, grid=cc.Grid.uniform(2), section=SECTION)
    q = 0.1 * np.cos(np.arange(family.n))
    expected = by_quadrature(
        beam,
        lambda xi: np.array([0, family(xi) @ q, 0]),
        lambda xi: np.diag([1e4, 2e4, 4e6]),
        family.breaks,
    )
    # Exact for polynomials; seventeen Gauss points leave 1e-11 of the fifth cantilever mode.
    assert_allclose(cc.strain_energy(beam, q), expected, rtol=1e-10)


def test_energy_of_coupled_functions():
    def function(xi):
        return np.array([[0.5, xi], [-1, xi**2], [0.2, 1 - xi]])

    beam = cc.Beam(
        length=3.0, basis=cc.VectorBasis(function, 2), grid=cc.Grid.uniform(2), section=SECTION
    )
    q = np.array([0.1, -0.3])
    expected = by_quadrature(beam, lambda xi: function(xi) @ q, lambda xi: np.diag([1e4, 2e4, 4e6]))
    assert_allclose(cc.strain_energy(beam, q), expected, rtol=1e-12)  # polynomials: rounding


def test_stiffness_and_length_may_be_symbols(wing, symbolic):
    EI_y, length = symbolic.sym("EI_y"), symbolic.sym("L")
    beam = wing(2, length=length, section=replace(SECTION, EI_y=EI_y))
    q = symbolic.sym("q", 12)
    energy = cc.strain_energy(beam, q)
    f = ca.Function("f", [q, EI_y, length], [energy, ca.jacobian(energy, EI_y)])
    value, slope = f(CURLED_WEIGHTS, 3e4, 10.0)
    numeric = wing(2, length=10.0, section=replace(SECTION, EI_y=3e4))
    assert_allclose(value, cc.strain_energy(numeric, CURLED_WEIGHTS), rtol=1e-14)  # rounding
    # The energy is linear in EI_y: the slope is the out-of-plane part over EI_y.
    squares = CURLED_WEIGHTS[4:8] ** 2 / (2 * np.arange(4) + 1)
    assert_allclose(slope, 10.0 / 2 * squares.sum(), rtol=1e-14)


def test_stiffness_symbols_along_the_span(wing, symbolic):
    EI_y = symbolic.sym("EI_y")
    section = replace(SECTION, EI_y=lambda xi: EI_y * (1 - xi / 2))
    f = ca.Function("f", [EI_y], [cc.strain_energy(wing(2, section=section), CURLED_WEIGHTS)])
    expected = by_quadrature(
        wing(2), curled_curvature, lambda xi: np.diag([1e4, 2e4 * (1 - xi / 2), 4e6])
    )
    assert_allclose(f(2e4), expected, rtol=1e-12)  # polynomials: rounding


def test_mirrored_wing_has_the_same_energy(wing):
    beam = wing(2, section=SECTION)
    a, b = (cc.strain_energy(x, CURLED_WEIGHTS) for x in (beam, cc.mirror(beam)))
    assert_allclose(a, b, rtol=1e-15)


@settings(deadline=None, max_examples=15, derandomize=True)
@given(st.lists(st.floats(-1, 1), min_size=3, max_size=3), st.floats(-3, 3))
def test_energy_is_quadratic_and_not_negative(q, factor):
    beam = cc.Beam(
        length=2.0,
        basis=cc.ChannelBasis(torsion=cc.Monomial(3)),
        grid=cc.Grid.uniform(2),
        section=SECTION,
    )
    once = float(cc.strain_energy(beam, q))
    assert once >= 0
    got = float(cc.strain_energy(beam, factor * np.array(q)))
    assert_allclose(got, factor**2 * once, rtol=1e-10, atol=1e-9)  # rounding of up to 1e5 J


@pytest.mark.parametrize("q", [[1, 2], np.full(12, np.nan), 0.0], ids=str)
def test_weights_of_a_wrong_shape_are_refused(wing, q):
    with pytest.raises(ValueError, match=r"q: expected"):
        cc.strain_energy(wing(2, section=SECTION), q)


def test_a_beam_without_a_section_is_refused(wing):
    with pytest.raises(ValueError, match=r"Beam\.section: expected a Section.*found None"):
        cc.strain_energy(wing(2), CURLED_WEIGHTS)


def test_kinds_that_do_not_mix_are_named(wing):
    beam = wing(2, section=replace(SECTION, EI_y=ca.MX.sym("EI_y")))
    with pytest.raises(ValueError, match=r"q is SX.*Beam\.section.* is MX"):
        cc.strain_energy(beam, ca.SX.sym("q", 12))


ROOT = cc.Pose(rotation=rotation([0.3, -0.5, 1.1]), position=[1.0, -2.0, 0.5])


def test_the_stiffness_of_the_weights_is_the_second_derivative_of_the_energy(wing):
    beam = wing(2, section=replace(SECTION, coupling_xy=3e3, EI_z=lambda xi: 4e6 * (2 - xi)))
    q = ca.SX.sym("q", 12)
    hessian = ca.Function("f", [q], [ca.hessian(cc.strain_energy(beam, q), q)[0]])
    matrix = stiffness_matrix(beam).full()
    assert_allclose(hessian(CURLED_WEIGHTS).full(), matrix, atol=1e-14 * matrix.max())


def test_the_root_carries_the_sum_of_all_wrenches(wing, evaluate):
    beam = wing(8, section=SECTION, root=ROOT)
    loads = [
        cc.PointForce(0.5, [1.0, 2.0, 3.0], "follower", [0.1, 0.2, 0.3]),
        cc.PointForce(0.0, [4.0, 5.0, 6.0]),
        cc.PointMoment(1.0, [7.0, 8.0, 9.0]),
    ]
    middle, start = (cc.pose_at(beam, CURLED_WEIGHTS, xi) for xi in (0.5, 0.0))
    force = (middle.rotation @ ca.DM([1, 2, 3])).full().ravel()
    arm = (middle.position + middle.rotation @ ca.DM([0.1, 0.2, 0.3])).full().ravel()
    moment = np.cross(arm, force) + np.cross(start.position.full().ravel(), [4, 5, 6]) + [7, 8, 9]
    got = evaluate(lambda q: root_wrench(beam, q, loads), CURLED_WEIGHTS).ravel()
    assert_allclose(got, [*moment, *np.add(force, [4, 5, 6])], rtol=1e-13)


def test_the_root_carries_the_weight(wing):
    section = replace(SECTION, mass_per_length=0.75)
    beam = wing(8, kind="lobatto", section=section, bodies=(cc.Body(xi=0.3, mass=2),))
    got = root_wrench(beam, CURLED_WEIGHTS, [cc.Gravity([0, 0, -10])]).full().ravel()
    assert_allclose(got[3:], [0, 0, -10 * (0.75 * 16 + 2)], atol=1e-12)


def test_derivatives_of_the_balance_are_those_of_ad(wing, symbolic):
    EI_y, mass, force = symbolic.sym("EI_y"), symbolic.sym("mass"), symbolic.sym("F", 3)
    turn = symbolic.sym("R", 3, 3)
    section = replace(SECTION, EI_y=EI_y, mass_per_length=mass, center_of_mass=[0, 0.1, 0.2])
    beam = wing(6, section=section, root=ROOT)
    loads = [
        cc.Gravity([1.0, 2.0, -9.0]),
        cc.PointForce(0.5, force, "follower", offset=[0, 0.3, 0]),
        cc.PointForce(1.0, force),
        cc.PointMoment(1.0, force),
    ]
    q = symbolic.sym("q", 12)
    designs = [EI_y, mass, force, turn]
    found = balance(beam, q, loads, turn, tangent=True)
    got = [found.residual_slope, found.wrench_slope]
    by_ad = [ca.jacobian(x, q) for x in (found.residual, found.wrench)]
    for symbol in designs:
        got += parameter_slopes(beam, q, loads, symbol, turn)
        by_ad += [ca.jacobian(x, symbol) for x in (found.residual, found.wrench)]
    numbers = [CURLED_WEIGHTS, 2e4, 0.75, [1.0, 2.0, 3.0], rotation([0.2, 0.3, 0.4])]
    values, expected = (ca.Function("f", [q, *designs], x)(*numbers) for x in (got, by_ad))
    for a, b in zip(values, expected, strict=True):
        assert_allclose(a.full(), b.full(), atol=1e-12 * max(1, np.abs(b.full()).max()))


# Quadrature of the strain energy --------------------------------------------------------------

#: A constant and a narrow bump, as tables.
SAMPLES = np.linspace(0, 1, 41)
BUMP = np.column_stack([np.ones(41), np.exp(-(((SAMPLES - 0.5) / 0.06) ** 2))])


def exact_stiffness(basis, rigidity, points):
    """∫ EI φ_i φ_j dxi by adaptive quadrature between `points`."""
    total = np.zeros((basis.n, basis.n))
    for i, j in np.ndindex(*total.shape):

        def integrand(x, i=i, j=j):
            phi = basis(x)[1]
            return rigidity(x) * phi[i] * phi[j]

        for left, right in pairwise(points):
            total[i, j] += quad(integrand, left, right, epsabs=1e-13, epsrel=1e-12, limit=200)[0]
    return total


def bending_beam(basis, EI_y, elements=8):
    section = cc.Section(GJ=1, EI_y=EI_y, EI_z=1)
    return cc.Beam(length=1.0, basis=basis, grid=cc.Grid.uniform(elements), section=section)


@pytest.mark.parametrize(
    "family, points",
    [
        (cc.Tabulated(SAMPLES, BUMP, 1), SAMPLES),
        (cc.Tabulated(SAMPLES, BUMP, 3), SAMPLES),
        (cc.BSpline(5), np.linspace(0, 1, 3)),
        (cc.CantileverModes(6), [0, 0.5, 1]),
    ],
    ids=["linear table", "cubic table", "spline", "modes"],
)
def test_the_strain_energy_resolves_narrow_functions_on_any_grid(family, points):
    basis = cc.ChannelBasis(out_of_plane=family)
    exact = exact_stiffness(basis, lambda x: 1.0, points)
    for elements in (2, 30):
        found = stiffness_matrix(bending_beam(basis, 1.0, elements))
        assert_allclose(found, exact, rtol=0, atol=1e-10 * np.abs(exact).max())


def test_a_narrow_feature_of_the_section_counts_in_the_strain_energy():
    def rigidity(xi):
        return 1 + 50 * np.exp(-(((xi - 0.37) / 0.01) ** 2))

    basis = cc.ChannelBasis(out_of_plane=cc.Legendre(2))
    exact = exact_stiffness(basis, rigidity, [0, 0.3, 0.37, 0.44, 1])
    assert_allclose(stiffness_matrix(bending_beam(basis, rigidity)), exact, atol=1e-10)
    # A symbol in the field changes nothing of the points.
    factor = ca.SX.sym("factor")
    symbolic = stiffness_matrix(bending_beam(basis, lambda xi: factor * rigidity(xi)))
    assert_allclose(ca.Function("S", [factor], [symbolic])(3), 3 * exact, atol=1e-10)


def test_a_jump_of_the_section_without_a_break_is_resolved_and_noise_refused():
    basis = cc.ChannelBasis(out_of_plane=cc.Legendre(1))
    jump = bending_beam(basis, lambda xi: 1.0 if xi < 1 / 3 else 5.0)
    assert_allclose(stiffness_matrix(jump), [[1 / 3 + 5 * 2 / 3]], rtol=1e-10)
    noise = np.random.default_rng(0)
    rough = cc.VectorBasis(lambda xi: [[0], [noise.uniform(1, 2)], [0]], 1)
    with pytest.raises(ValueError, match=r"Beam.basis: expected functions .* as breaks"):
        stiffness_matrix(bending_beam(rough, 1.0))


def test_a_tip_moment_finds_its_curvature_among_narrow_functions():
    beam = bending_beam(cc.ChannelBasis(out_of_plane=cc.Tabulated(SAMPLES, BUMP, 3)), 1.0, 40)
    found = cc.solve_equilibrium(beam, [cc.PointMoment(1.0, [0, -0.5, 0])]).q.full().ravel()
    assert_allclose(found, [-0.5, 0], atol=1e-8)
