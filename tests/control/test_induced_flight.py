"""Induced flow of a flying aircraft: trimmed flight, downwash at the tail, what is refused."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose

import curvcasadi as cc
from tests.support.flying_aircraft import aircraft as askew, anywhere

DENSITY, SPEED = 0.0889, 26.0
LINE = cc.LiftingLine(panels=4)
#: A state for each strip: lag functions along the span cannot follow every distribution.
EACH = cc.IndicialLag(poles=2, modes=None)


def straight_aircraft():
    section = cc.Section(
        GJ=4e4,
        EI_y=8e4,
        EI_z=4e6,
        mass_per_length=0.75,
        inertia=np.diag([0.1, 5e-4, 0.0995]),
    )
    beam = cc.Beam(
        length=16.0,
        basis=cc.ChannelBasis(torsion=cc.Legendre(2), out_of_plane=cc.Legendre(2)),
        grid=cc.Grid.lobatto(4),
        section=section,
        root=cc.wing_root(side="right", position=[0, 0, 0]),
    )
    strips = cc.StripAerodynamics(
        chord=1.0, aerodynamic_center=0.1, lift_slope=2 * np.pi, profile_drag=0.01
    )
    right = cc.Wing(name="right", beam=beam, strips=strips)
    elevator = cc.ControlSurface(name="elevator", lift=3.0)
    tail = cc.LiftingSurface(
        name="tail",
        area=2.5,
        pose=cc.wing_root(side="right", position=[-10, 0, -0.5]),
        strips=cc.StripAerodynamics(
            chord=0.5, aerodynamic_center=0.0, lift_slope=5.0, controls=(elevator,)
        ),
    )
    body = cc.RigidBody(mass=30.0, center_of_mass=[0.1, 0, 0], inertia=np.diag([200.0] * 3))
    return cc.Aircraft(
        body=body,
        beams=(right, cc.mirror_wing(right, "left")),
        surfaces=(tail,),
        thrusts=(cc.Thrust(),),
    )


AIRCRAFT = straight_aircraft()


@pytest.fixture(scope="module")
def trimmed():
    return cc.trim(AIRCRAFT, speed=SPEED, density=DENSITY, induced_flow=LINE)


@cache
def model_of(line, lag=EACH, aircraft=AIRCRAFT):
    return cc.aircraft_model(aircraft, density=DENSITY, lag=lag, induced_flow=line, outputs=())


@pytest.mark.parametrize("lag", [EACH, None], ids=["lag", "none"])
def test_trimmed_state_of_the_model_is_the_trim_with_the_same_line(trimmed, lag):
    model = model_of(LINE, lag)
    state = cc.trimmed_state(model, trimmed)
    parts, inputs = model.x.split(state.x), model.u.split(state.u)
    # Both are solutions of Newton's method to their own tolerances.
    for name, q in trimmed.q.items():
        assert_allclose(parts[f"q_{name}"].full().ravel(), q.full().ravel(), atol=1e-10)
    for name, value in trimmed.inputs.items():
        assert_allclose(float(inputs[name]), value, rtol=1e-7, atol=1e-9)
    velocity = parts["twist"].full().ravel()[3:]
    alpha = np.arctan2(velocity[2], velocity[0])
    assert_allclose(alpha, trimmed.angle_of_attack, atol=1e-9)
    rates = model.xdot(state.x, state.u, []).full().ravel()
    assert np.abs(np.delete(rates, slice(4, 7))).max() < 1e-6


def test_a_line_frozen_at_the_trim_flies_as_the_moving_one(trimmed):
    alpha = trimmed.angle_of_attack
    velocity = [SPEED * np.cos(alpha), 0, SPEED * np.sin(alpha)]
    line = cc.LiftingLine(panels=4, frozen=True, shape=trimmed.q, velocity=velocity)
    again = cc.trim(AIRCRAFT, speed=SPEED, density=DENSITY, induced_flow=line)
    # Poses along a few elements, which end at the stations of the air in one of them.
    assert_allclose(again.angle_of_attack, alpha, atol=1e-7)
    state = cc.trimmed_state(model_of(line), again)
    other = cc.trimmed_state(model_of(LINE), trimmed)
    assert_allclose(state.x, other.x, atol=1e-4)


def test_symmetric_flight_stays_symmetric(trimmed):
    model = model_of(LINE)
    x, u = cc.trimmed_state(model, trimmed)
    rng, parts, change = np.random.default_rng(0), model.x.slices, np.zeros(model.x.size)
    for name in ("q", "q_dot", "lag"):
        both = 0.01 * rng.standard_normal(change[parts[f"{name}_right"]].size)
        change[parts[f"{name}_right"]] = change[parts[f"{name}_left"]] = both
    rates = model.xdot(x + change, u, []).full().ravel()
    # Roll and yaw rates, and the velocity to the right.
    assert_allclose(rates[parts["twist"]][[0, 2, 4]], 0, atol=1e-10 * np.abs(rates).max())


@pytest.mark.parametrize("lag", [cc.IndicialLag(poles=2, modes=2), None], ids=["lag", "none"])
def test_derivatives_are_those_of_differences(lag):
    gust = cc.GustField(lambda at, time: ca.vertcat(0, 0, -ca.sin(0.2 * at[0] + time)))
    model = cc.aircraft_model(
        askew(), density=0.9, gravity=0, lag=lag, gust=gust, induced_flow=LINE, outputs=()
    )
    x, u, p = anywhere(model)
    symbols = [ca.MX.sym(k, getattr(model, k).size) for k in "xup"]
    stacked = ca.vertcat(*symbols)
    slope = ca.Function("slope", symbols, [ca.jacobian(model.xdot(*symbols), stacked)])
    used = {f.name() for f in slope.find_functions()}
    assert {"jac_aircraft_right", "jac_aircraft_right_wash"} <= used
    matrix, rng = slope(x, u, p).full(), np.random.default_rng(3)
    for _ in range(3):
        ends = [rng.normal(size=value.size) for value in (x, u, p)]
        h = 1e-5
        pairs = [*zip((x, u, p), ends, strict=True)]
        ahead, behind = (model.xdot(*(v + s * h * d for v, d in pairs)) for s in (1, -1))
        expected = matrix @ np.concatenate(ends)
        # Errors of h² and of rounding over h.
        found = ((ahead - behind) / (2 * h)).full().ravel()
        assert_allclose(found, expected, atol=1e-7 * np.abs(expected).max())


def test_still_air_is_finite():
    model = model_of(LINE)
    symbol = ca.MX.sym("x", model.x.size)
    x = np.zeros(model.x.size)
    x[model.x.slices["quaternion_wxyz"].start] = 1
    rates = model.xdot(symbol, np.zeros(model.u.size), [])
    f = ca.Function("f", [symbol], [rates, ca.jacobian(rates, symbol)])
    assert all(np.all(np.isfinite(m.full())) for m in f(x))


def lopsided():
    right, left = AIRCRAFT.beams
    return replace(AIRCRAFT, beams=(right, replace(left, beam=replace(left.beam, length=12.0))))


@pytest.mark.parametrize(
    "make",
    [
        lambda aircraft: model_of(LINE, aircraft=aircraft),
        lambda aircraft: cc.trim(aircraft, speed=SPEED, density=DENSITY, induced_flow=LINE),
    ],
    ids=["model", "trim"],
)
@pytest.mark.parametrize(
    "aircraft", [lopsided, lambda: replace(AIRCRAFT, beams=AIRCRAFT.beams[:1])], ids=["two", "one"]
)
def test_an_aircraft_without_mirror_image_is_named(make, aircraft):
    message = r"LiftingLine.image: expected a mirror image of the wing 'right' beyond the plane"
    with pytest.raises(ValueError, match=message):
        make(aircraft())
