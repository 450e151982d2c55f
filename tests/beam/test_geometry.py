"""Geometry of wings: signs of angles, both sides, kinks and twist."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

import curvcasadi as cc
from curvcasadi.reference_wings import RIGHT_WING_ROOT

SWEEP, DIHEDRAL, INCIDENCE = 0.5, 0.2, 0.1


def right_axes(sweep, dihedral, twist):
    """The axes of the docstring by scipy's rotations."""
    about = Rotation.from_rotvec
    turned = about([-dihedral, 0, 0]) * about([0, 0, sweep])
    unswept = np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1.0]])
    return turned.as_matrix() @ unswept @ about([twist, 0, 0]).as_matrix()


def test_the_unswept_root_is_that_of_the_reference_wing():
    root = cc.wing_root()
    assert_allclose(root.rotation, RIGHT_WING_ROOT.rotation, atol=0)
    assert_allclose(root.position, np.zeros((3, 1)), atol=0)


@pytest.mark.parametrize("side, y", [("right", 1), ("left", -1)])
def test_signs_of_the_angles(side, y):
    swept = cc.wing_root(side=side, sweep=SWEEP).rotation.full()
    assert_allclose(swept[:, 0], [-np.sin(SWEEP), y * np.cos(SWEEP), 0], atol=1e-15)  # tip aft
    raised = cc.wing_root(side=side, dihedral=DIHEDRAL).rotation.full()
    assert_allclose(
        raised[:, 0], [0, y * np.cos(DIHEDRAL), -np.sin(DIHEDRAL)], atol=1e-15
    )  # tip up
    nose_up = cc.wing_root(side=side, incidence=INCIDENCE).rotation.full()
    assert_allclose(nose_up[:, 1], [np.cos(INCIDENCE), 0, -np.sin(INCIDENCE)], atol=1e-15)


def test_the_left_root_is_the_mirror_image():
    angles = {"sweep": SWEEP, "dihedral": DIHEDRAL, "incidence": INCIDENCE}
    right = cc.wing_root(side="right", position=[1, 0.5, -0.2], **angles)
    left = cc.wing_root(side="left", position=[1, -0.5, -0.2], **angles)
    beam = cc.Beam(
        length=1,
        basis=cc.ChannelBasis(torsion=cc.Legendre(1)),
        grid=cc.Grid.uniform(2),
        root=right,
    )
    assert_allclose(cc.mirror(beam).root.rotation, left.rotation, atol=1e-15)
    assert_allclose(cc.mirror(beam).root.position, left.position, atol=0)
    assert_allclose(right.rotation, right_axes(SWEEP, DIHEDRAL, INCIDENCE), atol=1e-15)


def test_angles_may_be_symbols():
    sweep = ca.SX.sym("sweep")
    root = cc.wing_root(sweep=sweep)
    slope = ca.Function("slope", [sweep], [ca.jacobian(root.rotation[:, 0], sweep)])(0.0)
    assert_allclose(slope, [[-1], [0], [0]], atol=1e-15)


KINKED = cc.WingGeometry(
    length=10.0,
    sweep=cc.Piecewise([0, 0.4, 1], [0.1, 0.5]),
    dihedral=cc.Piecewise([0, 0.7, 1], [0.0, 0.6]),
    twist=cc.Piecewise([0, 0.5, 1], [0.1, 0.08, -0.05]),
    position=[0.3, 0.5, 0],
)


def wing_of(geometry):
    return cc.Beam(
        length=geometry.length,
        basis=cc.ChannelBasis(torsion=cc.Legendre(2), out_of_plane=cc.Legendre(2)),
        grid=cc.Grid.uniform(10),
        root=geometry.root,
        initial_curvature=geometry.initial_curvature,
    )


@pytest.mark.parametrize(
    "xi, sweep, dihedral, twist",
    [(0.0, 0.1, 0, 0.1), (0.2, 0.1, 0, 0.092), (0.5, 0.5, 0, 0.08), (0.9, 0.5, 0.6, -0.024)],
)
def test_attitudes_of_a_kinked_wing_are_exact(xi, sweep, dihedral, twist):
    pose = cc.pose_at(wing_of(KINKED), np.zeros(4), xi)
    # Constant curvature within each interval, which exponentials integrate exactly; beyond a kink
    # the twist is that of its own station, so nothing but rounding remains.
    assert_allclose(pose.rotation, right_axes(sweep, dihedral, twist), atol=1e-12)


def test_positions_of_a_kinked_wing_are_those_of_straight_parts():
    tip = np.array([0.3, 0.5, 0])
    for length, sweep, dihedral in ((4, 0.1, 0), (3, 0.5, 0), (3, 0.5, 0.6)):
        tip = tip + length * right_axes(sweep, dihedral, 0)[:, 0]
    found = cc.pose_at(wing_of(KINKED), np.zeros(4), 1.0).position.full().ravel()
    # Two kinks of 0.4 and 0.5 rad are bent over 1 cm each.
    assert_allclose(found, tip, atol=0.01 * 0.5)


def test_the_left_half_of_a_kinked_wing_is_the_mirror_image():
    left = replace(KINKED, side="left", position=[0.3, -0.5, 0])
    q = [0.01, -0.02, 0.03, 0.01]
    ours, mirrored = wing_of(left), cc.mirror(wing_of(KINKED))
    for xi in (0.3, 0.75, 1.0):
        a, b = cc.pose_at(ours, np.zeros(4), xi), cc.pose_at(mirrored, np.zeros(4), xi)
        assert_allclose(a.rotation, b.rotation, atol=1e-12)
        assert_allclose(a.position, b.position, atol=1e-12)
    assert np.all(np.isfinite(cc.pose_at(ours, q, 1.0).position.full()))


def test_a_straight_wing_has_no_initial_curvature():
    assert cc.WingGeometry(length=10.0, sweep=0.3, twist=0.05).initial_curvature is None


def test_washout_is_a_twist_that_falls():
    washed = cc.WingGeometry(length=8.0, twist=cc.Piecewise([0, 1], [0.0, -0.1]))
    assert_allclose(washed.initial_curvature(0.5), [-0.1 / 8, 0, 0], atol=1e-15)


@pytest.mark.parametrize(
    "fields, message",
    [
        (
            {"sweep": 25},
            r"WingGeometry.sweep: expected an angle between -π/2 and π/2, rad, found 25",
        ),
        (
            {"sweep": cc.Piecewise([0, 1], [0.1, 0.2])},
            r"WingGeometry.sweep: .* one value per inter",
        ),
        ({"twist": cc.Piecewise([0, 1], [0.1])}, r"WingGeometry.twist: .* one value per station"),
        ({"twist": cc.Piecewise([0, 1], [0.1, 30])}, r"WingGeometry.twist: .* found 30; degrees"),
        ({"side": "port"}, r"WingGeometry.side: expected one of 'right', 'left'"),
        ({"length": 0}, r"WingGeometry.length: expected a number above zero"),
        ({"kink": 0.5, "sweep": cc.Piecewise([0, 0.4, 1], [0, 1])}, r"WingGeometry.kink: .* 0.4"),
        ({"sweep": lambda xi: 0.1}, r"WingGeometry.sweep: expected a number or a Piecewise"),
        ({"twist": cc.Piecewise([0, 0.5, 0.5, 1], [0, 0, 1, 1])}, r"twist without jumps"),
    ],
)
def test_wrong_geometry_is_refused_by_name(fields, message):
    with pytest.raises(ValueError, match=message):
        cc.WingGeometry(**{"length": 10.0, **fields})


@pytest.mark.parametrize("name", ["sweep", "dihedral", "incidence"])
def test_degrees_are_refused(name):
    with pytest.raises(ValueError, match=rf"{name}: expected an angle .* found 10; degrees"):
        cc.wing_root(**{name: 10})


@pytest.mark.parametrize("name", ["sweep", "dihedral", "incidence"])
def test_an_angle_of_implausible_size_is_named_with_its_unit(name):
    with pytest.warns(UserWarning, match=f"{name}: 1.4 rad is implausibly large; degrees are"):
        cc.wing_root(**{name: 1.4})


def test_built_in_twist_of_implausible_size_is_named_with_its_unit():
    twist = cc.Piecewise((0.0, 1.0), (0.0, -1.0))
    with pytest.warns(UserWarning, match=r"WingGeometry.twist: 1 rad is implausibly large"):
        cc.WingGeometry(side="right", length=10.0, twist=twist)
