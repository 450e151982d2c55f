"""Forces of a strip: Theodorsen's formulas, steady flow, both sides, still air."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose

import curvcasadi as cc
from curvcasadi.aero.section import (
    SectionData,
    apparent_wrench,
    circulation,
    circulatory_wrench,
    gust_velocity,
    unpack,
)

DENSITY, CHORD, AHEAD = 1.1, 0.8, 0.27
HALF = CHORD / 2


def section(**changes):
    fields = {
        "upper": 1.0,
        "pressure": DENSITY * CHORD / 2,
        "chord": CHORD,
        "center": AHEAD,
        "slope": 2 * np.pi,
        "shift": 0.0,
        "drag": 0.0,
        "moment": 0.0,
        "moment_slope": 0.0,
        "suction": 1.0,
        "apparent": 1.0,
    }
    return SectionData(**{**fields, **changes})


def quasi_steady(velocity, omega, data):
    u = circulation(velocity, omega, data).velocity
    return circulatory_wrench(velocity, omega, data, u, u)


@pytest.mark.parametrize("poles", [2, 3, 4])
def test_small_harmonic_motion_gives_theodorsens_lift_and_moment(poles):
    lag, speed, a = cc.IndicialLag(poles=poles), 21.0, AHEAD / HALF - 1 / 2
    data = section()
    # Velocity and rate of the section as they follow from plunge h (down) and pitch: linearised.
    motion = ca.SX.sym("motion", 6)  # h_dot, h_ddot, pitch, its rates
    h1, h2, pitch, rate, rate2 = motion[0], motion[1], motion[2], motion[3], motion[4]
    velocity = ca.vertcat(0, speed * ca.cos(pitch), -speed * ca.sin(pitch) - h1)
    velocity_rate = ca.vertcat(0, 0, -speed * rate - h2)
    omega, omega_rate = ca.vertcat(rate, 0, 0), ca.vertcat(rate2, 0, 0)
    u = circulation(velocity, omega, data).velocity
    followed = motion[5]  # u_e − u, which the lag states make of u
    wrench = circulatory_wrench(velocity, omega, data, u, u + followed)
    wrench += apparent_wrench(velocity, omega, velocity_rate, omega_rate, data)
    slopes = ca.Function(
        "slopes", [motion], [ca.jacobian(wrench[[5, 0]], motion), ca.jacobian(u, motion)]
    )
    by_motion, u_by_motion = (m.full() for m in slopes(ca.DM.zeros(6)))
    for k in (0.05, 0.4, 1.5):
        s = 1j * k * speed / HALF
        c = lag.theodorsen(k)
        for plunge, angle in ((1.0, 0.0), (0.0, 1.0)):
            x = np.array([s * plunge, s**2 * plunge, angle, s * angle, s**2 * angle, 0])
            x[5] = (c - 1) * (u_by_motion[0] @ x)
            lift, moment = by_motion @ x
            h1, h2, rate, rate2 = s * plunge, s**2 * plunge, s * angle, s**2 * angle
            wash = h1 + speed * angle + HALF * (1 / 2 - a) * rate
            mass, circulatory = np.pi * DENSITY * HALF**2, 2 * np.pi * DENSITY * speed * HALF * c
            expected = mass * (h2 + speed * rate - HALF * a * rate2) + circulatory * wash
            assert_allclose(lift, expected, rtol=1e-12)
            expected = mass * (
                HALF * a * h2 - speed * HALF * (1 / 2 - a) * rate - HALF**2 * (1 / 8 + a**2) * rate2
            )
            expected += circulatory * HALF * (a + 1 / 2) * wash
            assert_allclose(moment, expected, rtol=1e-12)


@pytest.mark.parametrize("angle", np.radians([-40, 3, 25]))
def test_steady_flow_gives_lift_normal_to_it_and_drag_along(angle):
    speed, drag, camber = 30.0, 0.02, 0.05
    data = section(drag=drag, shift=camber, moment=-0.04, moment_slope=0.1)
    velocity = speed * ca.DM([0, np.cos(angle), -np.sin(angle)])
    moment, force = ca.vertsplit(quasi_steady(velocity, ca.DM.zeros(3), data), 3)
    pressure = DENSITY / 2 * CHORD * speed**2
    along = np.array([0, np.cos(angle), -np.sin(angle)])
    normal = np.array([0, np.sin(angle), np.cos(angle)])
    lift = pressure * 2 * np.pi * (angle + camber)
    assert_allclose(force.full().ravel(), lift * normal - pressure * drag * along, rtol=1e-12)
    nose_up = pressure * CHORD * (-0.04 + 0.1 * (angle + camber))
    expected = np.cross([0, AHEAD, 0], force.full().ravel())
    expected[0] += nose_up
    assert_allclose(moment.full().ravel(), expected, rtol=1e-12, atol=1e-12)


def test_without_suction_the_lift_stands_normal_to_the_chord():
    velocity, omega = ca.DM([0, 28.0, -3.0]), ca.DM([0.4, 0, 0])
    bare, full = (quasi_steady(velocity, omega, section(suction=s)) for s in (0.0, 1.0))
    assert float(bare[4]) == 0
    assert float(full[4]) > 0
    assert_allclose(bare[5], full[5], rtol=0)


def test_force_in_pitching_is_the_suction_of_thin_airfoil_theory():
    # S² π ρ with S = (2 Q − b rate)/√2, Q the wash at three quarters of the chord (Garrick).
    rate, rise = 0.6, 1.3
    velocity, omega = ca.DM([0, 30.0, -rise]), ca.DM([rate, 0, 0])
    data = section()
    u = float(circulation(velocity, omega, data).velocity)
    force = quasi_steady(velocity, omega, data)
    thrust = np.pi * DENSITY * HALF * (2 * u - HALF * rate) ** 2 / 2
    # For small angles, u = −V3: what is left of F_y is of the square of the angle beside one.
    assert_allclose(float(force[4]), thrust, rtol=4e-3)


def test_other_side_is_the_mirror_image():
    rng = np.random.default_rng(2)
    flip = np.array([-1, -1, 1, 1, 1, -1.0])  # moment and force of the mirror image, its local axes
    v, w, a, b = rng.standard_normal((4, 3))
    v[1] += 20
    fields = {"shift": 0.03, "drag": 0.01, "moment": 0.02, "moment_slope": -0.1}
    one, other = section(**fields), section(upper=-1.0, **fields)

    def wrench(v, w, a, b, data):
        u = circulation(ca.DM(v), ca.DM(w), data).velocity
        total = circulatory_wrench(ca.DM(v), ca.DM(w), data, u, 0.7 * u)
        return (total + apparent_wrench(*map(ca.DM, (v, w, a, b)), data)).full().ravel()

    # A left wing: its x axis points the other way along the reflected span, and its z is down;
    # velocities keep y and reverse z, rates about x reverse.
    left = wrench(v * [1, 1, -1], w * [-1, -1, 1], a * [1, 1, -1], b * [-1, -1, 1], other)
    assert_allclose(left, wrench(v, w, a, b, one) * flip, rtol=1e-13, atol=1e-13)


def test_still_air_does_nothing_to_first_order(symbolic):
    motion = symbolic.sym("motion", 6)
    data = unpack(ca.DM(list(section(shift=0.1, drag=0.02, moment=0.05))))
    wrench = quasi_steady(motion[:3], motion[3:], data)
    f = ca.Function("f", [motion], [wrench, ca.jacobian(wrench, motion)])
    force, slope = f(ca.DM.zeros(6))
    assert not np.any(force.full()) and not np.any(slope.full())


def test_gust_ends_in_the_flow_that_it_makes():
    velocity, omega, gust = ca.DM([0, 25, -1]), ca.DM([0.2, 0, 0]), ca.DM([0.3, -1, 4])
    data = section(shift=0.02)
    u = circulation(velocity, omega, data).velocity
    found = u + gust_velocity(velocity, omega, gust, data)
    assert_allclose(found, circulation(velocity - gust, omega, data).velocity, rtol=1e-14)
    # A small upward gust is what it adds.
    small = gust_velocity(ca.DM([0, 25, 0]), ca.DM.zeros(3), ca.DM([0, 0, 1e-4]), section())
    assert_allclose(small, 1e-4, rtol=1e-6)
