"""Induced flow on a bent wing: slopes against AD, mirror images, still air, what it refuses."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose

import curvcasadi as cc
from curvcasadi.reference_wings import RIGHT_WING_ROOT
from curvcasadi.statics.balance import balance, parameter_slopes, root_wrench
from tests.support.oracle import CURLED_WEIGHTS

WEIGHTS = CURLED_WEIGHTS / 4
SECTION = cc.Section(GJ=1e4, EI_y=2e4, EI_z=4e6, mass_per_length=0.75)
FLAP = cc.ControlSurface(name="flap", lift=3.0, moment=-0.6, drag=0.1, start=0.5, end=0.9)
STRIPS = cc.StripAerodynamics(
    chord=lambda xi: 1.2 - 0.5 * xi,
    aerodynamic_center=lambda xi: 0.3 - 0.1 * xi,
    lift_slope=5.8,
    zero_lift_angle=-0.04,
    profile_drag=0.02,
    controls=(FLAP,),
    stations=4,
    upper_side=1,
)


def loaded(velocity=(24, 0, 2), flap=0.1, strips=STRIPS, **line):
    flow = cc.Flow(density=1.1, velocity=velocity, angular_rate=[0.1, -0.2, 0])
    air = cc.LiftingLine(**{"panels": 3, **line})
    return cc.AerodynamicLoad(
        strips=strips, flow=flow, deflections={"flap": flap}, induced_flow=air
    )


@pytest.fixture
def right(wing):
    root = cc.Pose(rotation=RIGHT_WING_ROOT.rotation, position=[0.2, 0.4, -0.1])
    return wing(6, kind="lobatto", section=SECTION, root=root)


@pytest.mark.parametrize("frozen", [False, True])
def test_mirrored_wing_has_mirrored_loads(right, frozen):
    left, strips = cc.mirror(right), cc.mirror_aero(STRIPS)
    flow = cc.Flow(density=1.1, velocity=[24, 0, 2], angular_rate=[0, -0.2, 0])
    wrenches = []
    for beam, airfoils in ((right, STRIPS), (left, strips)):
        air = cc.LiftingLine(panels=3, frozen=frozen)
        load = cc.AerodynamicLoad(strips=airfoils, flow=flow, induced_flow=air)
        wrenches.append(root_wrench(beam, WEIGHTS, [load]).full().ravel())
    one, other = wrenches
    assert_allclose(other, one * [-1, 1, -1, 1, -1, 1], atol=1e-12 * np.abs(one).max())


def test_load_is_the_same_in_every_kind(right, evaluate):
    expected = balance(right, ca.DM(WEIGHTS), [loaded()]).residual.full()
    got = evaluate(lambda q: balance(right, q, [loaded()]).residual, WEIGHTS)
    assert_allclose(got, expected, rtol=1e-11, atol=1e-8)


@pytest.mark.parametrize(
    ("velocity", "line"),
    [
        ((24, 0, 2), {}),
        ((0, 0, 0), {}),
        ((24, 0, 2), {"frozen": True}),
        ((24, 1, 2), {"image": False}),
    ],
    ids=str,
)
def test_tangent_is_the_derivative_also_in_still_air(right, velocity, line):
    load = loaded(velocity, **line)
    q = ca.MX.sym("q", 12)
    parts = balance(right, q, [load], tangent=True)
    wrench, residual = root_wrench(right, q, [load]), balance(right, q, [load]).residual
    slopes = [parts.residual_slope, parts.wrench_slope]
    by_ad = [ca.jacobian(residual, q), ca.jacobian(wrench, q)]
    f = ca.Function("f", [q], [*slopes, *by_ad, parts.residual - residual, parts.wrench - wrench])
    *slopes, residual_gap, wrench_gap = (m.full() for m in f(WEIGHTS))
    for got, expected in zip(slopes[:2], slopes[2:], strict=True):
        assert np.all(np.isfinite(got)) and np.all(np.isfinite(expected))
        # Another order of the same sums.
        assert_allclose(got, expected, atol=1e-11 * np.abs(expected).max())
    assert_allclose(residual_gap, 0, atol=1e-8)
    assert_allclose(wrench_gap, 0, atol=1e-9)


@pytest.mark.parametrize("frozen", [False, True])
def test_parameter_slopes_are_the_derivatives(right, frozen):
    q, p = ca.MX.sym("q", 12), ca.MX.sym("p", 7)
    flow = cc.Flow(density=1.1, velocity=p[:3], angular_rate=p[3:6], wind=[1, 2, 3])
    air = cc.LiftingLine(panels=3, frozen=frozen)
    load = cc.AerodynamicLoad(
        strips=STRIPS, flow=flow, deflections={"flap": p[6]}, induced_flow=air
    )
    loads = [load, cc.Gravity([0, 0, 9.81])]
    got = parameter_slopes(right, q, loads, p)
    passed = balance(right, q, loads)
    expected = ca.jacobian(passed.residual, p), ca.jacobian(passed.wrench, p)
    f = ca.Function("f", [q, p], [*got, *expected])
    values = [m.full() for m in f(WEIGHTS, [24, 1, 2, 0.3, 0.2, 0.1, 0.1])]
    for a, b in zip(values[:2], values[2:], strict=True):
        assert_allclose(a, b, atol=1e-11 * np.abs(b).max())


def test_frozen_influence_is_that_of_the_unbent_wing_in_level_flow(right):
    straight = np.zeros(12)
    got, expected = (
        root_wrench(right, straight, [loaded((24, 0, 0), frozen=frozen)]).full()
        for frozen in (True, False)
    )
    # What the interpolation of a straight line leaves.
    assert_allclose(got, expected, atol=1e-11 * np.abs(expected).max())


def test_flap_between_the_panels_acts_where_it_is(right):
    # The more panels, the sharper the step that a flap makes in u; its lift converges.
    straight = np.zeros(12)
    strips = replace(STRIPS, stations=12)
    lifts = []
    for panels in (6, 8):
        up, down = (
            root_wrench(right, straight, [loaded(flap=a, strips=strips, panels=panels)])[5]
            for a in (0.1, -0.1)
        )
        lifts.append(float(down - up))
    assert_allclose(lifts[0], lifts[1], rtol=0.015)  # 4 panels: 3 %


def test_induced_angle_of_an_elliptic_wing_is_lift_over_aspect_ratio(wing):
    # w/V = C_L/(π AR) everywhere; the stations at which it is wanted are any.
    beam = wing(6, kind="lobatto", section=SECTION, root=RIGHT_WING_ROOT)
    strips = cc.StripAerodynamics(
        chord=lambda xi: 1.5 * np.sqrt(1 - xi**2) + 1e-9,
        aerodynamic_center=0.0,
        lift_slope=2 * np.pi,
        stations=8,
    )
    flow = cc.Flow(density=1.0, velocity=[20, 0, 20 * np.tan(0.05)])
    air = cc.LiftingLine(panels=8)
    load = cc.AerodynamicLoad(strips=strips, flow=flow, induced_flow=air)
    found = cc.strip_forces(beam, np.zeros(12), load, stations=[0.0, 0.3, 0.7, 0.95])
    aspect = 32 / (1.5 * np.pi / 4)
    lift_slope = 2 * np.pi / (1 + 2 / aspect)
    # Of eight panels. The angle is a tenth of that of attack: it magnifies errors of lift tenfold.
    assert_allclose(found.induced_angle, -0.05 * lift_slope / (np.pi * aspect), rtol=0.02)


def test_drag_of_the_induced_flow_is_that_of_prandtls_equation():
    # D = (1 + δ) L²/(π q b²); δ = Σ n (A_n/A_1)² of the sine series of a rectangular wing.
    beam = cc.Beam(
        length=16.0,
        basis=cc.ChannelBasis(out_of_plane=cc.Legendre(1)),
        grid=cc.Grid.uniform(2),
        section=cc.Section(GJ=1, EI_y=1, EI_z=1),
    )
    theta, odd = np.arange(1, 400, 2) * np.pi / 800, np.arange(1, 400, 2)
    mu = 2 * np.pi / (4 * 32)
    matrix = np.sin(np.outer(theta, odd)) * (odd * mu + np.sin(theta)[:, None])
    series = np.linalg.solve(matrix, mu * np.sin(theta))
    delta = odd[1:] @ (series[1:] / series[0]) ** 2
    stream = 25 * np.array([0, np.cos(0.02), -np.sin(0.02)])
    load = cc.AerodynamicLoad(
        strips=cc.StripAerodynamics(chord=1.0, aerodynamic_center=0.25, lift_slope=2 * np.pi),
        flow=cc.Flow(density=1.0, velocity=stream),
        induced_flow=cc.LiftingLine(panels=6),
    )
    force = root_wrench(beam, [0.0], [load]).full().ravel()[3:]
    lift, drag = force[2] * np.cos(0.02) + force[1] * np.sin(0.02), -force @ stream / 25
    elliptic = (2 * lift) ** 2 / (np.pi * 25**2 / 2 * 32**2)
    assert_allclose(2 * drag / elliptic, 1 + delta, rtol=0.01)  # six panels, six stations


def test_a_rolling_wing_with_its_own_image_is_damped_a_little_too_much():
    # The image of a rolling wing lifts the other way: a line from tip to tip knows.
    def damping(left, length, line, stations):
        beam = cc.Beam(
            length=length,
            basis=cc.ChannelBasis(out_of_plane=cc.Legendre(1)),
            grid=cc.Grid.uniform(2),
            section=cc.Section(GJ=1, EI_y=1, EI_z=1),
            root=cc.Pose(rotation=RIGHT_WING_ROOT.rotation, position=[0, left, 0]),
        )
        strips = cc.StripAerodynamics(
            chord=1.0, aerodynamic_center=0.0, lift_slope=2 * np.pi, stations=stations
        )
        flow = cc.Flow(density=1.0, velocity=[25, 0, 0], angular_rate=[0.05, 0, 0])
        load = cc.AerodynamicLoad(strips=strips, flow=flow, induced_flow=line)
        return float(root_wrench(beam, [0.0], [load])[0])

    whole = damping(-16.0, 32.0, cc.LiftingLine(panels=16, image=False), 24) / 2
    own = damping(0.0, 16.0, cc.LiftingLine(panels=8), 12)
    strips = damping(0.0, 16.0, None, 12)
    assert whole < 0
    assert 1.015 < own / whole < 1.025
    assert 1.2 < strips / whole < 1.25


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({}, "LiftingLine.plane is None, found an expression of sweep; give the field"),
        ({"plane": [0, 1, 0], "frozen": True}, "LiftingLine.velocity is None, .* of sweep; give"),
    ],
)
def test_symbols_of_the_root_need_plane_and_stream(right, fields, message):
    swept = replace(right, root=cc.wing_root(sweep=ca.MX.sym("sweep")))
    line = cc.LiftingLine(panels=3, **fields)
    load = cc.AerodynamicLoad(strips=STRIPS, flow=cc.Flow(density=1), induced_flow=line)
    with pytest.raises(ValueError, match=message):
        root_wrench(swept, np.zeros(12), [load])


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"velocity": [-24, 0, 0]}, "LiftingLine.velocity: expected one toward the leading edge"),
        ({"velocity": [0, 0, 24]}, "LiftingLine.velocity: expected one toward the leading edge"),
        ({"shape": np.full(12, 9.0)}, "LiftingLine.shape: expected every element to turn at most"),
    ],
)
def test_shape_and_stream_of_a_frozen_line_must_make_sense(right, fields, message):
    line = cc.LiftingLine(panels=3, frozen=True, **fields)
    load = cc.AerodynamicLoad(strips=STRIPS, flow=cc.Flow(density=1), induced_flow=line)
    with pytest.raises(ValueError, match=message):
        root_wrench(right, np.zeros(12), [load])


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (
            lambda: loaded(strips=replace(STRIPS, tip_loss=cc.ExponentialTipLoss(decay=9.0))),
            "StripAerodynamics.tip_loss",
        ),
        (
            lambda: cc.AerodynamicLoad(strips=STRIPS, flow=cc.Flow(density=1), induced_flow=6),
            "AerodynamicLoad.induced_flow",
        ),
    ],
)
def test_bad_input_is_named(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def test_a_lift_slope_of_zero_is_named(right):
    strips = replace(STRIPS, lift_slope=cc.Steps([0, 0.7, 1], [6.0, 0.0]), controls=())
    flow = cc.Flow(density=1.1, velocity=[24, 0, 2])
    load = cc.AerodynamicLoad(strips=strips, flow=flow, induced_flow=cc.LiftingLine(panels=3))
    with pytest.raises(ValueError, match=r"StripAerodynamics.lift_slope at xi = "):
        root_wrench(right, WEIGHTS, [load])


def test_a_control_surface_without_lift_slope_is_named(right):
    load = cc.AerodynamicLoad(
        strips=replace(STRIPS, lift_slope=0.0), flow=cc.Flow(density=1), deflections={"flap": 0.1}
    )
    with pytest.raises(ValueError, match=r"StripAerodynamics.lift_slope at xi = "):
        root_wrench(right, WEIGHTS, [load])
