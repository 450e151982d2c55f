"""Descriptions of beams, sections, and mirror images."""

from __future__ import annotations

from dataclasses import FrozenInstanceError, replace

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose

import curvcasadi as cc
from tests.support import oracle

SECTION = cc.Section(GJ=1e4, EI_y=2e4, EI_z=4e6)


def beam(**fields):
    basis = cc.ChannelBasis(out_of_plane=cc.Legendre(2))
    return cc.Beam(**{"length": 16.0, "basis": basis, "grid": cc.Grid.uniform(4), **fields})


@pytest.mark.parametrize(
    "fields, message",
    [
        ({"length": -1}, r"Beam\.length: expected a number above zero, found -1"),
        ({"length": 0}, r"Beam\.length: expected a number above zero, found 0"),
        ({"length": np.nan}, r"Beam\.length: expected finite numbers, found nan"),
        ({"length": [1, 2]}, r"Beam\.length: expected shape \(1, 1\), found \(2, 1\)"),
        ({"length": ca.SX.sym("L", 2)}, r"Beam\.length: expected shape \(1, 1\), found \(2, 1\)"),
        ({"length": "long"}, r"Beam\.length: expected numbers"),
        ({"grid": 16}, r"Beam\.grid: expected a Grid, found 16"),
        ({"root": np.eye(4)}, r"Beam\.root: expected a Pose, found"),
        ({"section": 3.0}, r"Beam\.section: expected a Section, found 3\.0"),
        ({"basis": None}, r"Beam\.basis: expected a basis.*found None"),
        ({"basis": cc.Legendre(3)}, r"Beam\.basis: expected a basis.*found Legendre"),
        ({"initial_curvature": [0, 1]}, r"Beam\.initial_curvature: expected shape \(3, 1\)"),
        ({"initial_curvature": [0, np.inf, 0]}, r"Beam\.initial_curvature: expected finite"),
        ({"weight_bounds": -0.1}, r"Beam\.weight_bounds: expected lower.*found"),
        ({"weight_bounds": [0.1, 0.1, 0.1]}, r"Beam\.weight_bounds: expected a number, 2 numbers"),
        ({"weight_bounds": (0.2, 0.1)}, r"Beam\.weight_bounds: expected lower.*0\.2.*0\.1"),
        ({"weight_bounds": np.nan}, r"Beam\.weight_bounds: expected lower.*nan"),
        ({"weight_bounds": (0.1,)}, r"Beam\.weight_bounds: expected"),
        ({"weight_bounds": "wide"}, r"Beam\.weight_bounds: expected"),
    ],
)
def test_beam_refuses_bad_input(fields, message):
    with pytest.raises(ValueError, match=message):
        beam(**fields)


@pytest.mark.parametrize("length", [16, 16.0, np.float64(16), np.array([16.0]), [16.0], ca.DM(16)])
def test_every_accepted_length_gives_a_shape(length):
    tip = cc.shape_map(beam(length=length), [0, 0]).tip
    assert_allclose(tip.position, [[16], [0], [0]], atol=1e-14)  # rounding


@pytest.mark.parametrize(
    "bounds, lower, upper",
    [
        (None, [-np.inf, -np.inf], [np.inf, np.inf]),
        (0.1, [-0.1, -0.1], [0.1, 0.1]),
        ([0.1, 0.2], [-0.1, -0.2], [0.1, 0.2]),
        ((-0.1, 0.3), [-0.1, -0.1], [0.3, 0.3]),
        (([-0.1, 0], [0.3, 0]), [-0.1, 0], [0.3, 0]),
        ((-0.1, np.inf), [-0.1, -0.1], [np.inf, np.inf]),
    ],
)
def test_bounds_take_a_number_numbers_or_a_pair(bounds, lower, upper):
    got = beam(weight_bounds=bounds).bounds
    assert_allclose(got[0], lower, rtol=0)
    assert_allclose(got[1], upper, rtol=0)


@pytest.mark.parametrize("bounds", [0.1, (-0.1, 0.1), (-0.1, np.inf), ([-0.1, 0], [0.1, 0])])
def test_weights_may_miss_their_bounds_by_a_solver_tolerance(bounds):
    limited = beam(weight_bounds=bounds)
    # Solvers leave 1e-6 in double precision, whatever the size of a bound below 1.
    cc.shape_map(limited, [-0.1 - 0.99e-6, 0.99e-6])
    with pytest.raises(ValueError, match=r"q\[0\].*Beam\.weight_bounds"):
        cc.shape_map(limited, [-0.1 - 1.01e-6, 0])


def test_large_bounds_may_be_missed_by_a_fraction():
    limited = beam(weight_bounds=10.0, grid=cc.Grid.uniform(400))
    cc.shape_map(limited, [10 * (1 + 0.99e-6), 0])
    with pytest.raises(ValueError, match=r"q\[0\].*Beam\.weight_bounds"):
        cc.shape_map(limited, [10 * (1 + 1.01e-6), 0])


def test_breaks_gather_basis_initial_curvature_and_section():
    class Kinked:
        breaks = (0.7,)

        def __call__(self, xi):
            return np.array([0, abs(xi - 0.7), 0])

    full = beam(
        basis=cc.ChannelBasis(torsion=cc.PiecewiseConstant(4)),
        section=replace(SECTION, breaks=(0.5, 0.6)),
        initial_curvature=Kinked(),
    )
    assert full.breaks == (0.25, 0.5, 0.6, 0.7, 0.75)
    assert set(full.breaks) <= set(full.stations.tolist())


@pytest.mark.parametrize("breaks", [(1.5,), (-0.2,), (np.nan,)])
def test_breaks_outside_the_beam_are_refused(breaks):
    with pytest.raises(ValueError, match=r"breaks: expected .*found"):
        _ = beam(section=replace(SECTION, breaks=breaks)).stations


def test_beams_and_sections_are_frozen():
    for description in (beam(), SECTION):
        with pytest.raises(FrozenInstanceError):
            description.length = 2.0


@pytest.mark.parametrize("name", ["GJ", "EI_y", "EI_z", "mass_per_length"])
@pytest.mark.parametrize("value", [0, -1.0, np.nan, [1, 2]])
def test_section_refuses_bad_input(name, value):
    with pytest.raises(ValueError, match=rf"Section\.{name}: expected"):
        replace(SECTION, **{name: value})


def test_section_refuses_a_bad_value_along_the_span():
    section = replace(SECTION, EI_y=lambda xi: 0.5 - xi)
    with pytest.raises(ValueError, match=r"Section\.EI_y at xi = 0\.75: expected .*found -0\.25"):
        section.stiffness(0.75)


def test_section_stiffness_stands_in_the_order_of_the_curvatures():
    section = cc.Section(GJ=lambda xi: 2 - xi, EI_y=3, EI_z=5)
    assert_allclose(section.stiffness(0.5), np.diag([1.5, 3, 5]), rtol=0)


# Mirror ----------------------------------------------------------------------------------------


def bent(**fields):
    basis = cc.ChannelBasis(
        torsion=cc.Legendre(2), out_of_plane=cc.Legendre(3), in_plane=cc.Legendre(2)
    )
    root = cc.Pose(rotation=oracle.rotation([0.4, -1.2, 0.8]), position=[0.3, 1.0, -0.2])
    return beam(basis=basis, root=root, **fields)


WEIGHTS = [0.02, -0.01, -0.04, 0.03, 0.01, 0.02, 0.01]
S, S_LOCAL = np.diag([1, -1, 1]), np.diag([1, 1, -1])
INITIAL = {
    "none": None,
    "constant": [0.01, -0.02, 0.005],
    "function": lambda xi: [0.01 * xi, -0.02, 0.005 * xi**2],
}


@pytest.mark.parametrize("initial", INITIAL)
def test_mirror_gives_the_mirror_image_at_equal_weights(initial):
    right = bent(initial_curvature=INITIAL[initial])
    left = cc.mirror(right)
    for xi in (0.0625, 0.3, 1.0):
        a, b = cc.pose_at(right, WEIGHTS, xi), cc.pose_at(left, WEIGHTS, xi)
        # A mirror image is exact but for rounding, some 16 m × 1e-16 an element.
        assert_allclose(b.position, S @ a.position.full(), atol=2e-14)
        assert_allclose(b.rotation, S @ a.rotation.full() @ S_LOCAL, atol=5e-15)


@pytest.mark.parametrize("initial", INITIAL)
def test_mirroring_twice_gives_the_same_wing(initial):
    right = bent(initial_curvature=INITIAL[initial])
    twice = cc.mirror(cc.mirror(right))
    assert twice.basis is right.basis
    a, b = (cc.shape_map(wing, WEIGHTS) for wing in (right, twice))
    assert_allclose(b.positions, a.positions, rtol=0, atol=1e-14)  # rounding
    assert_allclose(b.curvatures, a.curvatures, rtol=0, atol=1e-16)


def test_mirror_keeps_breaks_of_the_initial_curvature():
    def initial(xi):
        return [0, 0.01 * (xi > 0.3), 0]

    initial.breaks = (0.3,)
    right = bent(initial_curvature=initial)
    assert cc.mirror(right).breaks == cc.mirror(cc.mirror(right)).breaks == (0.3,)


def test_mirror_of_a_symbolic_initial_curvature(symbolic):
    k0 = symbolic.sym("k0", 3)
    left = cc.mirror(bent(initial_curvature=k0))
    got = ca.Function("f", [k0], [left.initial_curvature_at(0.4)])([1, 2, 3])
    assert_allclose(got, [[-1], [-2], [3]], rtol=0)
