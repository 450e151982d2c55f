"""Motions in time against exact and published ones, one case a section."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose

import curvcasadi as cc
from curvcasadi.lie import quaternion
from tests.published.test_published_statics import case, legendre

# D04, a sine force at the tip of a cantilever, from rest. Its rows have no rotary inertia.


def sine_loaded(n):
    data = case("D04")["section"]
    section = cc.Section(
        GJ=1.0,
        EI_y=data["EI_N_m2"],
        EI_z=data["EI_N_m2"],
        mass_per_length=data["mass_per_length_kg_m"],
    )
    beam = cc.Beam(
        length=1.0, basis=legendre(out_of_plane=n), grid=cc.Grid.lobatto(8), section=section
    )
    force = ca.MX.sym("force", 3)
    return cc.beam_model(beam, [cc.PointForce(1.0, force)], inputs={"force": force})


@pytest.fixture(scope="module")
def sine_motion():
    """Four weights, twenty periods of the force."""
    times = np.linspace(0, 40 * np.pi / 200, 1257)
    push = lambda t: [0, 0, 1000 * np.sin(200 * t)]  # noqa: E731
    return cc.simulate(sine_loaded(4), None, times, u=push, method="implicit_midpoint", dt=1e-4)


def test_d04_four_weights_follow_the_exact_modal_sum(sine_motion):
    exact = case("D04")["reference"]
    height = sine_motion.part("position")[2]
    largest = exact["max_tip_z_m_over_20_periods"]
    found = np.interp(exact["t_s"], sine_motion.t, height)
    assert_allclose(found, exact["tip_z_m"], atol=3e-3 * largest)
    # Of extremes the times are not known to better than a sample of the case.
    assert_allclose(height.max(), largest, rtol=5e-3)
    assert_allclose(height.min(), exact["min_tip_z_m_over_20_periods"], rtol=5e-3)


# D05, a free beam that is pushed and turned at one end, then let go.

SIZE = 11.0  #: largest displacement, lengths of the case


def spaghetti(n, pushed):
    """The beam, and the model of its flight under the loads of the first 2.5 s or none."""
    section = cc.Section(
        GJ=500, EI_y=100, EI_z=100, mass_per_length=1, inertia=np.diag([20, 10, 10])
    )
    root = cc.Pose(rotation=[[0.6, 0, 0.8], [0, 1, 0], [-0.8, 0, 0.6]], position=[0, 0, 0])
    beam = cc.Beam(
        length=10.0,
        basis=legendre(out_of_plane=n),
        grid=cc.Grid.lobatto(16),
        section=section,
        root=root,
    )
    loads = (cc.PointForce(1.0, [8, 0, 0]), cc.PointMoment(1.0, [0, 80, 0])) if pushed else ()
    wing = cc.Wing(name="beam", beam=beam, loads=loads)
    alone = cc.Aircraft(body=cc.NoBody(), beams=(wing,))
    return beam, cc.aircraft_model(alone, density=0, gravity=0, outputs=["tip_position_beam"])


@pytest.fixture(scope="module")
def flight():
    """Times, positions of the loaded tip and of the centre of mass over time."""
    beam, model = spaghetti(8, pushed=True)
    start, steps = {"quaternion_wxyz": [1, 0, 0, 0]}, {"method": "rk4", "dt": 0.002}
    pushed = cc.simulate(model, start, np.linspace(0, 2.5, 51), **steps)
    _, model = spaghetti(8, pushed=False)
    free = cc.simulate(model, pushed.x[:, -1], np.linspace(2.5, 7.5, 101), **steps)
    states = np.hstack([pushed.x, free.x[:, 1:]])
    tips = np.hstack([pushed.y, free.y[:, 1:]])

    q = ca.MX.sym("q", 8)
    # The potential in gravity along −x, −y and −z is the mass moment along these.
    moments = [cc.potential_energy(beam, q, [cc.Gravity(-axis)]) for axis in np.eye(3)]
    center_of = ca.Function(
        "center", [q], [(ca.vertcat(*moments) - cc.strain_energy(beam, q)) / 10]
    )
    turns = [quaternion.rotation(ca.DM(x[:4])).full() for x in states.T]
    places = [x[4:7] for x in states.T]
    centers = [center_of(x[7:15]).full().ravel() for x in states.T]
    times = np.concatenate([pushed.t, free.t[1:]])
    tip, center = (
        np.array([R @ point + p for R, point, p in zip(turns, points, places, strict=True)])
        for points in (tips.T, centers)
    )
    return times, tip - tip[0], center - center[0]


def test_d05_the_centre_of_mass_moves_as_newton_says(flight):
    times, _, center = flight
    exact = np.where(times < 2.5, 0.4 * times**2, 2.5 + 2 * (times - 2.5))
    # RK4 at 3 750 steps, of fourth order: 3e-8.
    assert_allclose(center, np.column_stack([exact, 0 * exact, 0 * exact]), atol=1e-7)


def test_d05_the_loaded_tip_flies_as_far_as_in_aerobeams(flight):
    _, moved, _ = flight
    code = case("D05")["reference"]["AeroBeams_2D_tip"]
    found = [moved[:, 0].min(), moved[:, 0].max(), moved[:, 2].max()]
    # Its beam shears and stretches, and its step of 10 ms is coarse.
    assert_allclose(found, [code["u1_min"], code["u1_max"], code["u3_max"]], atol=5e-3 * SIZE)
    at_end = [moved[-1, 0], moved[-1, 2]]
    assert_allclose(at_end, [code["u1_at_t7.5"], code["u3_at_t7.5"]], atol=0.02 * SIZE)
    assert np.all(moved[1, [0, 2]] < 0)  # the sign of the moment
