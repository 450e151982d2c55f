"""Strip aerodynamics: forces against plain numpy, derivatives against AD, mirrored wings."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.special import beta

import curvcasadi as cc
from curvcasadi.aero import (
    AerodynamicLoad,
    ControlSurface,
    ExponentialTipLoss,
    Flow,
    StripAerodynamics,
    mirror_aero,
    strip_forces,
)
from curvcasadi.aero.section import speed_and_angle
from curvcasadi.aero.stations import air_stations
from curvcasadi.loads.stations import loaded_mesh
from curvcasadi.reference_wings import RIGHT_WING_ROOT
from curvcasadi.statics.balance import balance, parameter_slopes, root_wrench
from tests.support.oracle import CURLED_WEIGHTS

SECTION = cc.Section(GJ=1e4, EI_y=2e4, EI_z=4e6, mass_per_length=0.75)
FLAP = ControlSurface(name="flap", lift=3.0, moment=-0.6, drag=0.1, start=0.5, end=0.9)
STRIPS = StripAerodynamics(
    chord=cc.Steps([0, 0.4, 1], [1.2, 0.8]),
    aerodynamic_center=lambda xi: 0.3 - 0.1 * xi,
    lift_slope=5.8,
    zero_lift_angle=-0.04,
    profile_drag=0.02,
    moment_coefficient=-0.05,
    moment_slope=0.08,
    suction=0.9,
    controls=(FLAP,),
    tip_loss=ExponentialTipLoss(decay=20.0),
    upper_side=1,
)
FLOW = Flow(density=1.1, velocity=[24, 1, 2], angular_rate=[0.3, -0.2, 0.1], wind=[-1.0, 0.5, 0.4])
WEIGHTS = CURLED_WEIGHTS / 4


def loaded(velocity=(24, 1, 2), **fields):
    flow = Flow(density=1.1, velocity=velocity, **fields)
    return AerodynamicLoad(strips=STRIPS, flow=flow, deflections={"flap": 0.1})


@pytest.fixture
def right(wing):
    return wing(12, kind="lobatto", section=SECTION, root=RIGHT_WING_ROOT)


def wrench_by_hand(beam, q, strips, flow, flap, side):
    """The formulas of the load with numpy: `side` +1 for a right wing, −1 for a left one."""
    load = AerodynamicLoad(strips=strips, flow=flow)
    mesh = loaded_mesh(beam, [load])
    total = np.zeros(6)
    same_elements = replace(beam, grid=cc.Grid(boundaries=mesh.stations))
    for xi, weight in air_stations(strips):
        pose = cc.pose_at(same_elements, q, xi)
        R, p = pose.rotation.full(), pose.position.full().ravel()
        air = flow.velocity.full().ravel() - flow.wind.full().ravel()
        rate = flow.angular_rate.full().ravel()
        v, roll = R.T @ (air + np.cross(rate, p)), (R.T @ rate)[0]
        flapped = 0.5 < xi < 0.9
        c, center = 1.2 if xi < 0.4 else 0.8, 0.3 - 0.1 * xi
        # The angle of attack is that at three quarters of the chord.
        ahead, up, there = v[1], side * v[2], side * (v[2] + roll * (center - c / 2))
        speed = np.hypot(ahead, there)
        u = speed * (np.arctan2(-there, ahead) + 0.04 + 3.0 * flap * flapped / 5.8)
        tip = 1 - np.exp(-20 * (1 - xi))
        pressure = 1.1 / 2 * c * weight * beam.length
        k, u_s = pressure * 5.8 * tip, u - c / 4 * side * roll
        drag, moment = 0.02 + 0.1 * flap * flapped, -0.05 - 0.6 * flap * flapped
        moment = moment * speed**2 + 0.08 * u * speed
        # In a steady rotation a section is cambered by it, −π ρ b³/2 V_y Ω_x nose-up.
        moment -= np.pi / 8 * c * ahead * side * roll
        forward, upward = R[:, 1], side * R[:, 2]
        force = k * (0.9 * (u_s**2 - u**2 - there * u) * forward + ahead * u * upward)
        force -= pressure * drag * speed * (ahead * forward + up * upward)
        nose_up = np.cross(forward, upward)
        arm = p + center * forward
        total += np.r_[np.cross(arm, force) + pressure * c * moment * nose_up, force]
    return total


def test_wrench_is_that_of_the_formulas_on_both_wings(right):
    for beam, side, strips in ((right, 1, STRIPS), (cc.mirror(right), -1, mirror_aero(STRIPS))):
        load = AerodynamicLoad(strips=strips, flow=FLOW, deflections={"flap": 0.1})
        got = root_wrench(beam, WEIGHTS, [load]).full().ravel()
        expected = wrench_by_hand(beam, WEIGHTS, strips, FLOW, 0.1, side)
        assert_allclose(got, expected, rtol=1e-10, atol=1e-9)  # rounding of a sum of strips


def test_airfoil_data_without_a_wing_are_mirrored_with_their_side_alone():
    with pytest.raises(ValueError, match=r"upper_side: expected 1 or -1.*mirror_wing"):
        mirror_aero(replace(STRIPS, upper_side=None))


def test_weights_of_strip_forces_integrate_along_the_span(right):
    straight, load = (
        np.zeros(12),
        AerodynamicLoad(strips=STRIPS, flow=Flow(density=1.1, velocity=[24, 0, 2])),
    )
    found = strip_forces(right, straight, load)
    assert_allclose(found.weights.sum(), 1, rtol=1e-14)
    # All strips of a straight wing see the same flow, to which lift is normal and drag parallel.
    lift, drag = (right.length * float(part @ found.weights) for part in (found.lift, found.drag))
    force = root_wrench(right, straight, [load]).full().ravel()[3:]
    assert_allclose(np.hypot(lift, drag), np.linalg.norm(force), rtol=1e-12)
    assert strip_forces(right, straight, load, stations=[0.5]).weights is None


def test_mirrored_wing_has_mirrored_loads(right):
    left, q = cc.mirror(right), WEIGHTS
    aileron = ControlSurface(name="aileron", lift=2.0, moment=-0.3, antisymmetric=True)
    strips = StripAerodynamics(
        chord=1.0,
        aerodynamic_center=0.25,
        lift_slope=6.0,
        profile_drag=0.01,
        controls=(aileron,),
        upper_side=1,
    )
    flow = Flow(density=1.1, velocity=[24, 0, 2], angular_rate=[0, 0.2, 0])

    def wrench(beam, strips, angle):
        load = AerodynamicLoad(strips=strips, flow=flow, deflections={"aileron": angle})
        return root_wrench(beam, q, [load]).full().ravel()

    one = wrench(right, strips, 0.1)
    other = wrench(left, mirror_aero(strips), -0.1)
    # Reflection at y = 0: a force changes its y, a moment its x and z. Rounding alone is left.
    scale = np.abs(one).max()
    assert_allclose(other, one * [-1, 1, -1, 1, -1, 1], atol=1e-13 * scale)
    assert abs(one[5] - wrench(left, mirror_aero(strips), 0.1)[5]) > 1e-2 * scale


def test_load_is_the_same_in_every_kind(right, evaluate):
    expected = balance(right, ca.DM(WEIGHTS), [loaded()]).residual.full()
    got = evaluate(lambda q: balance(right, q, [loaded()]).residual, WEIGHTS)
    assert_allclose(got, expected, rtol=1e-12, atol=1e-9)


@pytest.mark.parametrize("velocity", [(24, 1, 2), (0, 0, 0), (-24, 0.5, -2)], ids=str)
def test_tangent_is_the_derivative_also_in_still_air_and_reversed_flow(right, symbolic, velocity):
    load = loaded(velocity)
    q = symbolic.sym("q", 12)
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


def test_still_air_does_nothing_to_first_order(right, symbolic):
    velocity = symbolic.sym("velocity", 3)
    wrench = root_wrench(right, ca.DM(WEIGHTS), [loaded(velocity)])
    f = ca.Function("f", [velocity], [wrench, ca.jacobian(wrench, velocity)])
    force, slope = f([0, 0, 0])
    assert not np.any(force.full()) and not np.any(slope.full())
    # Of degree two: a thousandth of the speed makes a millionth of the force.
    assert_allclose(f([0.024, 1e-3, 2e-3])[0], f([24, 1, 2])[0] * 1e-6, rtol=1e-12)


def test_parameter_slopes_are_the_derivatives(right, symbolic):
    q, p = symbolic.sym("q", 12), symbolic.sym("p", 8)
    flow = Flow(density=1.1, velocity=p[:3], angular_rate=p[3:6], wind=[1, 2, 3])
    load = AerodynamicLoad(strips=STRIPS, flow=flow, deflections={"flap": p[6]})
    c, s = ca.cos(p[7]), ca.sin(p[7])
    pitch = ca.vertcat(ca.horzcat(c, 0, s), ca.horzcat(0, 1, 0), ca.horzcat(-s, 0, c))
    loads = [load, cc.Gravity([0, 0, 9.81])]
    got = parameter_slopes(right, q, loads, p, pitch)
    passed = balance(right, q, loads, pitch)
    expected = ca.jacobian(passed.residual, p), ca.jacobian(passed.wrench, p)
    f = ca.Function("f", [q, p], [*got, *expected])
    values = [m.full() for m in f(WEIGHTS, [24, 1, 2, 0.3, 0.2, 0.1, 0.1, 0.05])]
    for a, b in zip(values[:2], values[2:], strict=True):
        assert_allclose(a, b, atol=1e-12 * np.abs(b).max())


def test_cost_of_airloads_is_linear_in_the_elements(wing):
    def nodes(elements):
        beam = wing(elements, kind="lobatto", section=SECTION, root=RIGHT_WING_ROOT)
        strips = StripAerodynamics(chord=1.0, aerodynamic_center=0.25, lift_slope=6.0)
        load = AerodynamicLoad(strips=strips, flow=FLOW)
        q = ca.SX.sym("q", 12)
        residual = balance(beam, q, [load]).residual
        return ca.Function("r", [q], [residual], {"cse": True}).n_instructions()

    counts = np.array([nodes(8), nodes(16), nodes(32)])
    assert_allclose((counts[2] - counts[1]) / 16, (counts[1] - counts[0]) / 8, rtol=0.02)


def test_forces_along_the_span_integrate_to_the_force_at_the_root(right):
    load = replace(loaded((24, 0, 2)), strips=replace(STRIPS, suction=1.0))
    straight = np.zeros(12)
    found = strip_forces(right, straight, load)
    measures = np.array([right.length * station.weight for station in air_stations(load.strips)])
    angle = np.arctan2(2, 24)  # of a straight wing everywhere
    assert_allclose(found.angle_of_attack, np.full((1, len(measures)), angle), rtol=1e-14)
    lift, drag = (x.full().ravel() @ measures for x in (found.lift, found.drag))
    along, across = np.array([24, 0, 2]) / np.hypot(24, 2), np.array([2, 0, -24]) / np.hypot(24, 2)
    force = root_wrench(right, straight, [load]).full().ravel()[3:]
    assert_allclose(force, lift * across - drag * along, rtol=1e-12)


def test_aerodynamic_stations_are_those_of_the_airfoil_data_alone(right):
    load = loaded()
    # Intervals end at 0.4, 0.5 and 0.9, and each has a station.
    counts = np.histogram(load.points, [0, 0.4, 0.5, 0.9, 1])[0]
    assert counts.sum() == 6 and np.all(counts >= 1)
    structure = replace(SECTION, GJ=cc.Steps(np.linspace(0, 1, 16), [1e4] * 15))
    for beam in (right, replace(right, section=structure)):
        mesh = loaded_mesh(beam, [load])
        assert set(load.points) <= set(mesh.stations)
        plain = loaded_mesh(beam, [])
        assert len(mesh.stations) == len(plain.stations) + 6
        # The quadrature of the structure stays as it is.
        for panel, before in zip(mesh.panels, plain.panels, strict=True):
            assert_allclose(panel.weights, before.weights, rtol=0)
            assert_allclose(mesh.stations[[*panel.nodes]], plain.stations[[*before.nodes]], rtol=0)


@pytest.mark.parametrize("stations", [3, 6, 9])
def test_aerodynamic_stations_integrate_what_vanishes_like_a_root_at_the_tip(stations):
    strips = replace(STRIPS, chord=1.0, controls=(), stations=stations, tip_loss=None)
    xi, weights = np.array(air_stations(strips)).T
    powers = np.arange(stations)
    assert_allclose(xi ** powers[:, None] @ weights, 1 / (1 + powers), rtol=1e-13)
    # ∫ √(1 − ξ) ξ^k dξ is Euler's beta function.
    roots = np.sqrt(1 - xi) * xi ** powers[: stations - 1, None]
    assert_allclose(roots @ weights, beta(powers[: stations - 1] + 1, 1.5), rtol=1e-13)


def test_load_factor_scales_the_airloads(right):
    flow = Flow(density=1.1, velocity=[80, 0, 6])
    strips = StripAerodynamics(chord=1.0, aerodynamic_center=0.0, lift_slope=6.0)
    found = cc.solve_equilibrium(right, [AerodynamicLoad(strips=strips, flow=flow)])
    assert found.load_steps > 1 and found.load_factor == 1


def test_equilibrium_in_a_stream_is_differentiable_by_its_speed(wing):
    beam = wing(10, kind="lobatto", section=SECTION, root=RIGHT_WING_ROOT)
    strips = StripAerodynamics(chord=1.0, aerodynamic_center=0.25, lift_slope=6.0)

    def loads(speed):
        flow = Flow(density=0.09, velocity=ca.vertcat(speed, 0, 0.05 * speed))
        return [AerodynamicLoad(strips=strips, flow=flow), cc.Gravity([0, 0, 9.81])]

    speed = ca.MX.sym("speed")
    equilibrium = cc.equilibrium_function(beam, loads(speed), {"speed": speed})
    guess = cc.solve_equilibrium(beam, loads(25.0)).q
    slope = ca.Function("slope", [speed], [ca.jacobian(equilibrium(guess, speed), speed)])(25.0)
    ends = [cc.solve_equilibrium(beam, loads(v), guess).q for v in (25.001, 24.999)]
    # Central differences over a step of 1e-3: its square, and rounding of the equilibria over it.
    assert_allclose(slope, (ends[0] - ends[1]) / 0.002, atol=1e-6 * float(ca.norm_inf(slope)))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Flow(density=-1), "Flow.density"),
        (lambda: Flow(density=1, velocity=[1, 2]), "Flow.velocity"),
        (
            lambda: StripAerodynamics(chord=0, aerodynamic_center=0, lift_slope=6),
            "StripAerodynamics.chord",
        ),
        (
            lambda: StripAerodynamics(chord=1, aerodynamic_center=0, lift_slope=6, upper_side=0),
            "StripAerodynamics.upper_side",
        ),
        (lambda: ControlSurface(name="flap", lift=1, start=0.5, end=0.4), "ControlSurface.end"),
        (lambda: ExponentialTipLoss(decay=-1), "ExponentialTipLoss.decay"),
        (lambda: replace(STRIPS, suction=1.5), "StripAerodynamics.suction: expected .* 0 to 1"),
        (lambda: replace(STRIPS, profile_drag=-0.01), "StripAerodynamics.profile_drag: .* -0.01"),
        (
            lambda: AerodynamicLoad(strips=STRIPS, flow=FLOW, deflections={"rudder": 1}),
            "found 'rudder'",
        ),
        (lambda: AerodynamicLoad(strips=STRIPS, flow=[25, 0, 0]), "AerodynamicLoad.flow"),
        (
            lambda: StripAerodynamics(
                chord=1, aerodynamic_center=0, lift_slope=6, controls=["flap"]
            ),
            "StripAerodynamics.controls",
        ),
    ],
)
def test_bad_input_is_named(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def test_chord_below_zero_along_the_span_is_named(right):
    strips = StripAerodynamics(chord=lambda xi: 1 - 2 * xi, aerodynamic_center=0, lift_slope=6)
    with pytest.raises(ValueError, match=r"StripAerodynamics.chord at xi = "):
        root_wrench(right, WEIGHTS, [AerodynamicLoad(strips=strips, flow=FLOW)])


@pytest.mark.parametrize("kind", [ca.SX, ca.MX])
def test_the_angle_of_attack_has_a_finite_derivative_in_still_air(kind):
    v = kind.sym("v", 2)
    speed, angle = speed_and_angle(v[0], v[1])
    slope = ca.Function("slope", [v], [ca.jacobian(ca.vertcat(speed, angle), v)])
    assert_allclose(slope([0, 0]), np.zeros((2, 2)), atol=0)
    # Beside it they are those of the norm and of atan2(−V3, V2).
    assert_allclose(slope([3, -4]), [[0.6, -0.8], [-4 / 25, -3 / 25]], rtol=1e-14)
