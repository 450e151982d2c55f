"""Flexible aircraft: symmetry, sums of wrenches, and Functions with structured derivatives."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose

import curvcasadi as cc
from curvcasadi.aero import ControlSurface, Flow, StripAerodynamics
from curvcasadi.aircraft.balance import aircraft_wrench, rigid_wrenches, wing_balance, wing_function
from curvcasadi.aircraft.parts import (
    Aircraft,
    Flight,
    LiftingSurface,
    RigidBody,
    Thrust,
    Wing,
    mirror_wing,
)
from curvcasadi.reference_wings import RIGHT_WING_ROOT, hale_wing

FLAP = ControlSurface(name="flap", lift=3.0, moment=-0.5, drag=0.05, start=0.4, end=0.8)
ELEVATOR = ControlSurface(name="elevator", lift=3.0)
WING_STRIPS = StripAerodynamics(
    chord=1.0,
    aerodynamic_center=0.25,
    lift_slope=2 * np.pi,
    zero_lift_angle=-0.03,
    profile_drag=0.01,
    moment_coefficient=-0.02,
    controls=(FLAP,),
)
HEAVY = cc.Section(
    GJ=1e4, EI_y=2e4, EI_z=4e6, coupling_xy=2e3, mass_per_length=0.75, center_of_mass=[0, 0.1, 0.05]
)
RIGHT = Wing(name="right", beam=replace(hale_wing(), section=HEAVY), strips=WING_STRIPS)
TAIL = LiftingSurface(
    name="tail",
    area=2.5,
    pose=cc.Pose(rotation=RIGHT_WING_ROOT.rotation, position=[-10, 0, 0]),
    strips=StripAerodynamics(
        chord=0.5, aerodynamic_center=0.0, lift_slope=5.0, profile_drag=0.01, controls=(ELEVATOR,)
    ),
)
AIRCRAFT = Aircraft(
    body=RigidBody(mass=50.0, center_of_mass=[0.1, 0, 0.2]),
    beams=(RIGHT, mirror_wing(RIGHT, "left")),
    surfaces=(TAIL,),
    thrusts=(Thrust(position=[0, 0, 0.3]),),
)
WEIGHTS = np.array([0.002, -0.001, 0.0005, -0.03, 0.012, 0.004, -0.002, 0.001, -0.0006])
INPUTS = {"thrust": 12.0, "flap": 0.1, "elevator": -0.05}


def flight(pitch=0.08, velocity=(24.9, 0.0, 2.0), rate=(0.0, 0.05, 0.0)):
    c, s = np.cos(pitch), np.sin(pitch)
    return Flight(
        flow=Flow(density=0.0889, velocity=velocity, angular_rate=rate),
        attitude=ca.DM([[c, 0, s], [0, 1, 0], [-s, 0, c]]),
        gravity=9.81,
    )


def test_symmetric_aircraft_has_no_side_force_roll_or_yaw():
    q = {"right": ca.DM(WEIGHTS), "left": ca.DM(WEIGHTS)}
    wrench = aircraft_wrench(AIRCRAFT, q, flight(), INPUTS).full().ravel()
    weight, span = (50 + 2 * 16 * 0.75) * 9.81, 32.0
    assert abs(wrench[4]) <= 1e-12 * weight
    assert np.all(np.abs(wrench[[0, 2]]) <= 1e-12 * weight * span)
    assert np.abs(wrench[[1, 3, 5]]).max() > 1.0  # while the others are there


def test_sideslip_of_the_mirrored_flight_mirrors_the_wrench():
    q = {"right": ca.DM(WEIGHTS), "left": ca.DM(0.5 * WEIGHTS)}
    swapped = {"right": q["left"], "left": q["right"]}
    one = flight(velocity=(24.9, 1.5, 2.0), rate=(0.1, 0.05, 0.02))
    other = flight(velocity=(24.9, -1.5, 2.0), rate=(-0.1, 0.05, -0.02))
    wrench = aircraft_wrench(AIRCRAFT, q, one, INPUTS).full().ravel()
    mirrored = aircraft_wrench(AIRCRAFT, swapped, other, INPUTS).full().ravel()
    scale = np.abs(wrench).max()
    assert_allclose(mirrored, wrench * [-1, 1, -1, 1, -1, 1], atol=1e-13 * scale)


def test_mirrored_wing_has_the_same_residual():
    left = AIRCRAFT.beams[1]
    residuals = [wing_balance(w, ca.DM(WEIGHTS), flight(), INPUTS).residual for w in (RIGHT, left)]
    assert_allclose(residuals[0], residuals[1], atol=1e-13 * float(ca.norm_inf(residuals[0])))


def test_still_air_leaves_the_weight():
    still = flight(velocity=(0, 0, 0), rate=(0, 0, 0))
    q = {"right": ca.DM(WEIGHTS), "left": ca.DM(WEIGHTS)}
    wrench = aircraft_wrench(AIRCRAFT, q, still, {}).full().ravel()
    weight = (50 + 2 * 16 * 0.75) * 9.81
    down = weight * np.array([-np.sin(0.08), 0, np.cos(0.08)])
    assert_allclose(wrench[3:], down, atol=1e-12 * weight)


def test_tail_lifts_as_the_formula_says():
    """½ ρ S a α V² normal to the stream, 10 m behind the origin; drag along the stream."""
    found = rigid_wrenches(AIRCRAFT, flight(rate=(0, 0, 0)), {"elevator": 0.1})["tail"].full()
    speed_squared, angle = 24.9**2 + 2.0**2, np.arctan2(2.0, 24.9)
    pressure = 0.0889 / 2 * speed_squared * 2.5
    lift, drag = pressure * (5.0 * angle + 0.3), pressure * 0.01
    c, s = np.cos(angle), np.sin(angle)
    force = lift * np.array([s, 0, -c]) - drag * np.array([c, 0, s])
    assert_allclose(found.ravel()[3:], force, rtol=1e-13, atol=1e-13)
    assert_allclose(found.ravel()[:3], np.cross([-10, 0, 0], force), rtol=1e-13, atol=1e-12)


def test_wing_function_has_the_derivatives_of_ad_without_differentiating_the_chain():
    y = ca.MX.sym("y", 6)
    symbolic = Flight(
        flow=Flow(density=y[0], velocity=y[1:4]),
        attitude=flight().attitude,
        gravity=y[4],
    )
    function = wing_function(RIGHT, symbolic, {"flap": y[5]}, y)
    q = ca.MX.sym("q", 9)
    stacked = ca.veccat(q, y)
    structured = ca.Function("J", [q, y], [ca.jacobian(ca.vertcat(*function(q, y)), stacked)])
    names = {f.name() for f in structured.find_functions()}
    assert "jac_balance_right" in names
    assert not [name for name in names if name.startswith(("fwd", "adj"))]

    parts = wing_balance(RIGHT, q, symbolic, {"flap": y[5]})
    by_ad = ca.jacobian(ca.vertcat(parts.residual, parts.wrench), stacked)
    values = WEIGHTS, [0.0889, 24.9, 0.5, 2.0, 9.81, 0.1]
    expected = ca.Function("J", [q, y], [by_ad])(*values).full()
    # Sums in another order: rounding, row by row.
    scale = np.abs(expected).max(axis=1, keepdims=True)
    assert_allclose(structured(*values).full() / scale, expected / scale, atol=1e-11)


def test_wrench_is_the_same_in_every_kind(evaluate):
    def total(q):
        return aircraft_wrench(AIRCRAFT, {"right": q, "left": q}, flight(), INPUTS)

    expected = total(ca.DM(WEIGHTS)).full()
    assert_allclose(evaluate(total, WEIGHTS), expected, rtol=1e-12, atol=1e-9)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: RigidBody(mass=0, center_of_mass=[0, 0, 0]), "RigidBody.mass"),
        (lambda: RigidBody(mass=1, center_of_mass=[0, 0]), "RigidBody.center_of_mass"),
        (
            lambda: RigidBody(mass=1, center_of_mass=[0, 0, 0], inertia=np.triu(np.ones((3, 3)))),
            "RigidBody.inertia",
        ),
        (
            lambda: RigidBody(mass=1, center_of_mass=[0, 0, 0], inertia=np.diag([9, 1, 1])),
            "RigidBody.inertia: expected principal moments",
        ),
        (lambda: Thrust(direction=[1, 0]), "Thrust.direction"),
        (lambda: replace(TAIL, area=-1), "LiftingSurface.area"),
        (lambda: replace(RIGHT, beam=replace(RIGHT.beam, section=None)), "Wing 'right'"),
        (lambda: replace(RIGHT, name="right wing"), "Wing.name"),
        (lambda: replace(AIRCRAFT, body=None), "Aircraft.body"),
        (lambda: replace(AIRCRAFT, beams=(RIGHT, RIGHT)), "Aircraft.beams: expected different"),
        (lambda: replace(AIRCRAFT, beams=(RIGHT.beam,)), r"Aircraft.beams\[0\]"),
        (lambda: replace(AIRCRAFT, thrusts=(Thrust(name="flap"),)), "'flap'"),
        (lambda: mirror_wing(replace(RIGHT, loads=[cc.PointMoment(1.0, [1, 0, 0])]), "l"), "loads"),
    ],
)
def test_bad_input_is_named(make, message):
    with pytest.raises(ValueError, match=message):
        make()
