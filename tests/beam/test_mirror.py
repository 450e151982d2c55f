"""The other half wing: mirrored section, bodies and loads give the mirrored shape, q unchanged."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import curvcasadi as cc
from tests.support.oracle import CURLED_WEIGHTS, rotation

#: Reflection at y = 0 in parent axes, of local vectors, and of local axial vectors.
PARENT, LOCAL, AXIAL = np.diag([1, -1, 1]), np.diag([1, 1, -1]), np.diag([-1, -1, 1])
#: Axial vectors in parent axes: det(S) S.
PARENT_AXIAL = -PARENT
STIFFNESS = np.array([[2e4, 5e3, -2e3], [5e3, 4e4, 3e3], [-2e3, 3e3, 4e5]])
INERTIA = np.array([[3.0, 0.2, -0.1], [0.2, 2.0, 0.3], [-0.1, 0.3, 4.0]])
BODIES = (
    cc.Body(xi=0.4, mass=4.0, offset=[0.1, -0.5, 0.3], inertia=INERTIA),
    cc.Body(xi=1.0, mass=1.0, offset=[-0.2, 0.4, 0.2]),
)


@pytest.fixture
def right(wing):
    """A wing with every coupling: stiffness, centres of mass, bodies, twist and bend at rest."""
    section = cc.Section.from_stiffness(
        cc.Steps([0, 0.6, 1], [STIFFNESS, 0.5 * STIFFNESS]),
        mass_per_length=lambda xi: 2 - xi,
        center_of_mass=lambda xi: ca.DM([0.02, -0.1 * (1 + xi), 0.05]),
        inertia=INERTIA,
    )
    return wing(
        12,
        kind="lobatto",
        section=section,
        bodies=BODIES,
        initial_curvature=lambda xi: [0.01, 0.02 * xi, -0.03],
        root=cc.Pose(rotation=rotation([0.2, -0.4, 1.3]), position=[1.0, 0.5, -0.2]),
    )


def assert_mirrored(a, b, **tolerance):
    assert_allclose(b.position.full(), PARENT @ a.position.full(), **tolerance)
    assert_allclose(b.rotation.full(), PARENT @ a.rotation.full() @ LOCAL, **tolerance)


#: A load, and its mirror image.
PAIRS = {
    "gravity": (cc.Gravity([1.0, 2.0, -9.0]), cc.Gravity([1.0, -2.0, -9.0])),
    "dead force": (
        cc.PointForce(0.7, [20.0, 30.0, 40.0], offset=[0.1, 0.2, 0.3]),
        cc.PointForce(0.7, [20.0, -30.0, 40.0], offset=[0.1, 0.2, -0.3]),
    ),
    "body force": (
        cc.PointForce(0.7, [20.0, 30.0, 40.0], "body", [0.1, 0.2, 0.3]),
        cc.PointForce(0.7, [20.0, -30.0, 40.0], "body", [0.1, 0.2, -0.3]),
    ),
    "follower force": (
        cc.PointForce(1.0, [5.0, 10.0, 40.0], "follower", [0.1, 0.2, 0.3]),
        cc.PointForce(1.0, [5.0, 10.0, -40.0], "follower", [0.1, 0.2, -0.3]),
    ),
    "dead moment": (
        cc.PointMoment(1.0, [100.0, 200.0, 300.0]),
        cc.PointMoment(1.0, PARENT_AXIAL @ [100.0, 200.0, 300.0]),
    ),
    "follower moment": (
        cc.PointMoment(1.0, [100.0, 200.0, 300.0], "follower"),
        cc.PointMoment(1.0, AXIAL @ [100.0, 200.0, 300.0], "follower"),
    ),
    "distributed force": (
        cc.DistributedForce(lambda xi: [1 + xi, 2.0, 3.0], offset=[0.0, 0.2, 0.1]),
        cc.DistributedForce(lambda xi: [1 + xi, -2.0, 3.0], offset=[0.0, 0.2, -0.1]),
    ),
    "distributed moment": (
        cc.DistributedMoment([10.0, 20.0, 30.0], "follower"),
        cc.DistributedMoment([-10.0, -20.0, 30.0], "follower"),
    ),
}


@pytest.mark.parametrize("name", PAIRS)
def test_mirrored_loads_do_the_same_work(right, name):
    load, image = PAIRS[name]
    a = cc.generalized_force(right, CURLED_WEIGHTS, [load]).full()
    b = cc.generalized_force(cc.mirror(right), CURLED_WEIGHTS, [image]).full()
    assert_allclose(b, a, atol=1e-13 * np.abs(a).max())  # rounding


def test_a_mirrored_wing_under_mirrored_loads_takes_the_mirrored_shape(right):
    left = cc.mirror(right)
    a = cc.solve_equilibrium(right, [load for load, _ in PAIRS.values()])
    b = cc.solve_equilibrium(left, [image for _, image in PAIRS.values()])
    # Both to a residual of 1e-11; the wing bends by a third of its length.
    assert_allclose(b.q.full(), a.q.full(), atol=1e-11)
    assert np.abs(a.q.full()).max() * right.length > 0.3
    for one, other in zip(a.shape.poses, b.shape.poses, strict=True):
        assert_mirrored(one, other, atol=1e-9)


def test_gravity_of_a_level_aircraft_bends_both_wings_alike(right):
    weight = [cc.Gravity([0.0, 0.0, -9.0])]
    a, b = (cc.solve_equilibrium(wing, weight) for wing in (right, cc.mirror(right)))
    assert_allclose(b.q.full(), a.q.full(), atol=1e-11)


def test_the_same_weights_store_the_same_energy(right):
    a, b = (cc.strain_energy(wing, CURLED_WEIGHTS) for wing in (right, cc.mirror(right)))
    assert_allclose(float(b), float(a), rtol=1e-14)


def test_section_of_the_mirrored_wing(right):
    section, image = right.section, cc.mirror(right).section
    for xi in (0.1, 0.59, 0.61, 1.0):
        expected = AXIAL @ section.stiffness(xi).full() @ AXIAL
        assert_array_equal(image.stiffness(xi).full(), expected)
        assert image.mass_at(xi) == section.mass_at(xi)
        expected = LOCAL @ section.center_of_mass_at(xi).full()
        assert_array_equal(image.center_of_mass_at(xi).full(), expected)
    assert_array_equal(ca.DM(image.inertia).full(), LOCAL @ INERTIA @ LOCAL)
    assert image.breaks == section.breaks


def test_bodies_of_the_mirrored_wing(right):
    for body, image in zip(right.bodies, cc.mirror(right).bodies, strict=True):
        assert (image.xi, image.mass) == (body.xi, body.mass)
        assert_array_equal(image.offset.full(), LOCAL @ body.offset.full())
        assert_array_equal(ca.DM(image.inertia).full(), LOCAL @ np.array(body.inertia) @ LOCAL)


def test_the_mirror_image_of_the_mirror_image_is_the_wing(right):
    twice = cc.mirror(cc.mirror(right))
    assert twice.basis is right.basis
    for one, other in zip(
        cc.shape_map(right, CURLED_WEIGHTS).poses,
        cc.shape_map(twice, CURLED_WEIGHTS).poses,
        strict=True,
    ):
        assert_array_equal(one.position.full(), other.position.full())
        assert_array_equal(one.rotation.full(), other.rotation.full())
    for xi in (0.2, 0.8):
        assert_array_equal(twice.section.stiffness(xi).full(), right.section.stiffness(xi).full())


def test_symbols_are_mirrored_too(right, symbolic):
    offset, coupling = symbolic.sym("r", 3), symbolic.sym("c")
    section = cc.Section(GJ=1, EI_y=1, EI_z=1, coupling_xz=coupling, center_of_mass=offset)
    image = cc.mirror(replace(right, section=section, bodies=())).section
    f = ca.Function("f", [offset, coupling], [image.center_of_mass, image.coupling_xz])
    r, c = f([1, 2, 3], 0.5)
    assert_array_equal(r.full().ravel(), [1, 2, -3])
    assert float(c) == -0.5
