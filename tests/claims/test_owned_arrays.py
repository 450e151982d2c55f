"""Descriptions own their arrays: what is changed after it was given changes nothing of them."""

from __future__ import annotations

from dataclasses import fields, is_dataclass, replace

import casadi as ca
import numpy as np
import pytest

import curvcasadi as cc

BASIS = cc.ChannelBasis(out_of_plane=cc.Legendre(2))
GRID = cc.Grid.uniform(4)


def strips(**changes):
    return cc.StripAerodynamics(
        **{"chord": 1.0, "aerodynamic_center": 0.1, "lift_slope": 6.0} | changes
    )


def beam(**changes):
    return cc.Beam(**{"length": 1.0, "basis": BASIS, "grid": GRID} | changes)


#: (description, field) -> an array or expression for it.
FIELDS = {
    "initial curvature": (lambda v: beam(initial_curvature=v), 3),
    "bounds": (lambda v: beam(weight_bounds=v), 2),
    "pair of bounds": (lambda v: beam(weight_bounds=(-v, v)), 2),
    "root": (lambda v: beam(root=cc.Pose(rotation=np.eye(3), position=v)), 3),
    "body": (lambda v: cc.Body(xi=0.5, mass=1.0, offset=v), 3),
    "inertia of a body": (lambda v: cc.Body(xi=0.5, mass=1.0, inertia=v), (3, 3)),
    "inertia": (lambda v: cc.Section(GJ=1, EI_y=1, EI_z=1, inertia=v), (3, 3)),
    "centre": (lambda v: cc.Section(GJ=1, EI_y=1, EI_z=1, center_of_mass=v), 3),
    "stiffness": (cc.Section.from_stiffness, (3, 3)),
    "steps": (lambda v: cc.Steps([0, 0.5, 1], [v, 2 * v]), 3),
    "values of steps": (lambda v: cc.Steps([0, 0.5, 1], v), 2),
    "table": (lambda v: cc.Tabulated([0, 0.5, 1], v), (3, 3)),
    "gravity": (cc.Gravity, 3),
    "force": (lambda v: cc.PointForce(1.0, v, offset=v), 3),
    "moment": (lambda v: cc.PointMoment(1.0, v), 3),
    "line load": (lambda v: cc.DistributedForce(v, offset=v), 3),
    "line moment": (cc.DistributedMoment, 3),
    "target": (lambda v: cc.Target(xi=1.0, position=v), 3),
    "attitude": (lambda v: cc.Target(xi=1.0, rotation=v), (3, 3)),
    "flow": (lambda v: cc.Flow(density=1.0, velocity=v, wind=v), 3),
    "airfoil": (lambda v: strips(lift_slope=v), 1),
    "control": (lambda v: strips(controls=(cc.ControlSurface(name="a", lift=v),)), 1),
    "rigid body": (lambda v: cc.RigidBody(mass=1.0, center_of_mass=v), 3),
    "thrust": (lambda v: cc.Thrust(position=v), 3),
    "gyro": (lambda v: cc.RateGyro(xi=1.0, noise_density=v, rate=1.0, bias=v), 3),
    "mounting": (lambda v: cc.RateGyro(xi=1.0, noise_density=1, rate=1.0, mounting=v), (3, 3)),
    "marker": (lambda v: cc.Marker(xi=1.0, noise=v, offset=v), 3),
    "motion of the root": (lambda v: cc.RootMotion(twist=v, twist_rate=v), 6),
}


def value_of(shape):
    """An array that every field takes: rotations, inertias and stiffnesses are identities."""
    return np.eye(3) if shape == (3, 3) else np.arange(1.0, shape + 1)


def leaves(value):
    """Numbers of a description, text by text."""
    if is_dataclass(value):
        return [leaf for f in fields(value) for leaf in leaves(getattr(value, f.name, None))]
    if isinstance(value, (list, tuple)):
        return [leaf for entry in value for leaf in leaves(entry)]
    return [str(value)]


ARRAYS_ALONE = ("bounds", "pair of bounds", "values of steps", "table")
CASES = [(name, kind) for name in FIELDS for kind in (np.array, list)]
CASES += [(name, ca.DM) for name in FIELDS if name not in ARRAYS_ALONE]
CASES.remove(("pair of bounds", list))


@pytest.mark.parametrize("name, kind", CASES)
def test_an_array_that_is_changed_later_changes_nothing(name, kind):
    make, shape = FIELDS[name]
    value = value_of(shape).tolist() if kind is list else kind(value_of(shape))
    description = make(value)
    before = leaves(description)
    if kind is list:
        value[0] = [9.0] * 3 if shape == (3, 3) else 9.0
    else:
        value[0] = 9.0
    assert leaves(description) == before


def test_a_symbol_whose_entries_are_replaced_later_changes_nothing(symbolic):
    curvature = symbolic.sym("k", 3)
    wing = beam(initial_curvature=curvature)
    curvature[1] = 7
    assert "7" not in str(wing.initial_curvature_at(0.5))


def test_half_a_beam_does_not_follow_a_changed_initial_curvature():
    k_0 = np.array([0.0, 0.1, 0.0])
    wing = beam(initial_curvature=k_0)
    before = cc.pose_at(wing, [0, 0], 1.0).position.full()
    k_0[1] = -0.5
    np.testing.assert_array_equal(cc.curvature(wing, [0, 0], 0.5).full().ravel(), [0, 0.1, 0])
    np.testing.assert_array_equal(cc.pose_at(wing, [0, 0], 1.0).position.full(), before)
    again = replace(wing, length=2.0)
    np.testing.assert_array_equal(again.initial_curvature_at(0.5).full().ravel(), [0, 0.1, 0])
