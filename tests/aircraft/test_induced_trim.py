"""Trim with induced flow: balances, induced drag, downwash at the tail, structured derivatives."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose

import curvcasadi as cc
from curvcasadi.aircraft.balance import surface_points, wing_balance, wing_function, wing_wash
from curvcasadi.aircraft.trim_problem import attitude_matrix
from curvcasadi.reference_wings import RIGHT_WING_ROOT

LINE = cc.LiftingLine(panels=4)
DENSITY, SPEED = 0.0889, 26.0
TAIL_STRIPS = cc.StripAerodynamics(
    chord=0.5,
    aerodynamic_center=0.0,
    lift_slope=5.0,
    controls=(cc.ControlSurface(name="elevator", lift=3.0),),
)


def half_wing():
    beam = cc.Beam(
        length=16.0,
        basis=cc.ChannelBasis(
            torsion=cc.Legendre(2), out_of_plane=cc.Legendre(3), in_plane=cc.Legendre(1)
        ),
        grid=cc.Grid.lobatto(5),
        section=cc.Section(GJ=4e4, EI_y=8e4, EI_z=4e6, mass_per_length=0.75),
        root=cc.Pose(rotation=RIGHT_WING_ROOT.rotation, position=[0, 0, 0]),
    )
    strips = cc.StripAerodynamics(chord=1.0, aerodynamic_center=0.1, lift_slope=2 * np.pi)
    return cc.Wing(name="right", beam=beam, strips=strips)


@pytest.fixture(scope="module")
def aircraft():
    right = half_wing()
    pose = cc.Pose(rotation=RIGHT_WING_ROOT.rotation, position=[-10, 0, -0.5])
    tail = cc.LiftingSurface(name="tail", area=2.5, pose=pose, strips=TAIL_STRIPS)
    return cc.Aircraft(
        body=cc.RigidBody(mass=30.0, center_of_mass=[0.1, 0, 0]),
        beams=(right, cc.mirror_wing(right, "left")),
        surfaces=(tail,),
        thrusts=(cc.Thrust(),),
    )


@pytest.fixture(scope="module")
def found(aircraft):
    return cc.trim(aircraft, speed=SPEED, density=DENSITY, induced_flow=LINE)


def flight_of(result):
    alpha = result.angle_of_attack
    velocity = SPEED * np.array([np.cos(alpha), 0, np.sin(alpha)])
    flow = cc.Flow(density=DENSITY, velocity=velocity)
    return cc.Flight(flow=flow, attitude=attitude_matrix(0.0, ca.DM(result.pitch)), gravity=9.80665)


def test_everything_balances(aircraft, found):
    wrench = cc.aircraft_wrench(aircraft, found.q, flight_of(found), found.inputs, LINE)
    assert_allclose(wrench, np.zeros((6, 1)), atol=1e-5)  # of 530 N of weight


def test_thrust_carries_the_induced_drag(found):
    # Strips have no profile drag here, and without induced flow none that is worth a name.
    lift = (30 + 24) * 9.80665
    elliptic = lift**2 / (np.pi * DENSITY / 2 * SPEED**2 * 32**2)
    # Wing and tail share the lift, the wing is rectangular and bent: 1.1 to 1.6 of the least.
    assert 1.1 * elliptic < found.drag < 1.6 * elliptic
    thrust = found.inputs["thrust"] * np.cos(found.angle_of_attack)
    assert_allclose(thrust, found.drag, rtol=1e-4)


def test_wings_blow_down_on_the_tail(aircraft, found):
    points = surface_points(aircraft)
    flight = flight_of(found)
    right, left = (
        wing_wash(wing, found.q[wing.name], flight, found.inputs, LINE, points).value.full()
        for wing in aircraft.beams
    )
    assert_allclose(left, right * [[1], [-1], [1]], atol=1e-9)  # y is the other way
    assert right[2] > 0  # down
    # Ten chords behind: the wash of the fully developed wake, twice that at the wing, is near.
    lift = (30 + 24) * 9.80665
    at_wing = lift / (np.pi * DENSITY / 2 * SPEED * 32**2)
    assert 0.8 * at_wing < 2 * right[2, 0] < 2.2 * at_wing


def test_wing_function_has_the_derivatives_of_ad(aircraft):
    wing = aircraft.beams[0]
    y = ca.MX.sym("y", 5)
    flow = cc.Flow(density=y[3], velocity=y[:3])
    flight = cc.Flight(flow=flow, attitude=attitude_matrix(0.0, y[4]), gravity=9.8)
    points = surface_points(aircraft)
    function = wing_function(wing, flight, {}, y, LINE, points)
    q = ca.MX.sym("q", wing.beam.basis.n)
    outputs = function(q, y)
    attached = [ca.jacobian(ca.vec(output), by) for output in outputs for by in (q, y)]
    parts = wing_balance(wing, q, flight, {}, induced_flow=LINE)
    wash = wing_wash(wing, q, flight, {}, LINE, points).value
    plain = [parts.residual, parts.wrench, wash]
    by_ad = [ca.jacobian(ca.vec(output), by) for output in plain for by in (q, y)]
    f = ca.Function("f", [q, y], [*attached, *by_ad])
    at = f(0.01 * np.arange(1, 7) * (-1) ** np.arange(6), [25, 1, 2, 0.09, 0.05])
    for got, expected in zip(at[:6], at[6:], strict=True):
        scale = np.abs(expected.full()).max()
        assert_allclose(got, expected, atol=1e-11 * scale)


def test_another_thing_than_a_line_is_named(aircraft):
    with pytest.raises(ValueError, match="induced_flow"):
        cc.trim(aircraft, speed=SPEED, density=DENSITY, induced_flow=6)
