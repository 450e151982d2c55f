"""Steady turns and sideslip: against equations by hand, by symmetry, energy and kinematics."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from numpy.polynomial.legendre import leggauss
from numpy.testing import assert_allclose
from scipy.optimize import fsolve

import curvcasadi as cc
from curvcasadi.aircraft.trim_case import Case
from curvcasadi.aircraft.trim_problem import attitude_matrix
from curvcasadi.aircraft.trim_solver import TrimSolver
from curvcasadi.reference_wings import RIGHT_WING_ROOT
from tests.aircraft.test_trim import (
    AILERON,
    AIR,
    FIN,
    LEVEL,
    TAIL,
    WEIGHT,
    aircraft,
    rigid_aircraft,
)

G = 9.80665
INERTIA = np.array([[100.0, 0, -8], [0, 150, 0], [-8, 0, 200]])
CENTER = np.array([0.1, 0.0, 0.05])
BODY = cc.RigidBody(mass=50.0, center_of_mass=CENTER, inertia=INERTIA)
ROTARY = np.diag([0.1, 0.005, 0.095])
TURNS = {"rate": 0.1, "bank": 0.3, "radius": 220.0, "load_factor": 1.04}


def craft(stiffness=1.0, surfaces=(TAIL, FIN)):
    plane = aircraft(AILERON, stiffness=stiffness, body=BODY, surfaces=surfaces)
    right = plane.beams[0]
    section = replace(right.beam.section, inertia=ROTARY)
    right = replace(right, beam=replace(right.beam, section=section))
    return replace(plane, beams=(right, cc.mirror_wing(right, "left")))


@pytest.fixture(scope="module")
def plane():
    return craft()


@pytest.fixture(scope="module")
def turned(plane):
    """Trims in a turn, by a solver that is built once."""
    solver = TrimSolver(plane, None, "exact", turning=True)

    def solve(guess=None, **fields):
        return solver.solve(Case(**{**AIR, **LEVEL, "inputs": {}, **fields}), guess, True)

    return solve


@pytest.fixture(scope="module")
def turns(turned):
    """Turns of every kind, to the right."""
    return {key: turned(turn=cc.Turn(**{key: value})) for key, value in TURNS.items()}


def motion_of(result):
    """Attitude (3, 3), angular rate and velocity (3,) of the body, its axes."""
    alpha, beta = result.angle_of_attack, result.sideslip
    attitude = attitude_matrix(ca.DM(result.roll), ca.DM(result.pitch)).full()
    velocity = result.speed * np.array(
        [np.cos(alpha) * np.cos(beta), np.sin(beta), np.sin(alpha) * np.cos(beta)]
    )
    return attitude, result.turn_rate * attitude[2], velocity


# Equations by hand


def strip(rotation, position, span, chord, center, slope, lift, profile_drag, omega, velocity):
    """Moment and force of a quasi-steady strip with leading-edge suction about the body origin."""
    R, p = np.asarray(rotation, dtype=float), np.asarray(position, dtype=float)
    side = 1.0 if R[2, 2] <= 0 else -1.0  # z of the wing is up or down; of the fin to the left
    v, w = R.T @ (velocity + np.cross(omega, p)), (R.T @ omega)[0]
    ahead, up = v[1], side * v[2]
    there = up + side * w * (center - chord / 2)
    speed = np.hypot(ahead, there)
    u = speed * (np.arctan2(-there, ahead) + lift / slope)
    k = 0.0889 / 2 * chord * span
    forward, upward = R[:, 1], side * R[:, 2]
    u_s = u - chord / 4 * side * w
    force = k * slope * ((u_s**2 - u**2 - there * u) * forward + ahead * u * upward)
    force -= k * profile_drag * speed * (ahead * forward + up * upward)
    cambered = -np.pi / 8 * k * chord**2 * ahead * side * w  # −π ρ b³/2 V_y Ω_x
    moment = np.cross(p + center * forward, force) + cambered * np.cross(forward, upward)
    return np.r_[moment, force]


def rigid_wrench(velocity, omega, down, aileron, elevator, rudder, thrust):
    """All that acts on the aircraft with rigid wings, less the rate of its momentum."""
    total = np.r_[np.zeros(3), thrust, 0, 0]
    nodes, weights = leggauss(8)
    for side in (1, -1):
        R = RIGHT_WING_ROOT.rotation.full() * [[1, 1, 1], [side] * 3, [1, 1, side]]
        for start, end in ((0, 9.6), (9.6, 16)):
            for x, w in zip((nodes + 1) / 2, weights / 2, strict=True):
                p = (start + (end - start) * x) * R[:, 0]
                lift = side * aileron * (start > 0)
                air = (1.0, 0.25, 2 * np.pi, lift, 0.01, omega, velocity)
                total = total + strip(R, p, (end - start) * w, *air)
    for part, deflection in ((TAIL, elevator), (FIN, rudder)):
        R, p = part.pose.rotation.full(), part.pose.position.full().ravel()
        area = float(ca.DM(part.area))
        air = (0.5, 0.0, 5.0, 3 * deflection, 0.01, omega, velocity)
        total = total + strip(R, p, area / 0.5, *air)
    mass, first = 50 + 24.0, 50 * CENTER
    second = INERTIA + 50 * (CENTER @ CENTER * np.eye(3) - np.outer(CENTER, CENTER))
    # Two rods of 12 kg along y, whose sections have their rotary inertia about x, y, z = y, x, −z.
    rods = 2 * 12.0 * 16**2 / 3
    second = second + np.diag([rods + 32 * 0.005, 32 * 0.1, rods + 32 * 0.095])
    felt = np.cross(omega, velocity) - G * down
    force = mass * felt + np.cross(omega, np.cross(omega, first))
    moment = np.cross(first, felt) + np.cross(omega, second @ omega)
    return total - np.r_[moment, force]


NAMES = ("angle_of_attack", "pitch", "sideslip", "roll", "thrust", "aileron", "elevator", "rudder")


def rigid_flight(rate, sideslip=None):
    """NAMES of the rigid aircraft in a coordinated turn, or with a sideslip in straight flight."""

    def left(z):
        alpha, pitch, beta, roll, thrust, aileron, elevator, rudder = z
        velocity = 26 * np.array(
            [np.cos(alpha) * np.cos(beta), np.sin(beta), np.sin(alpha) * np.cos(beta)]
        )
        down = np.array(
            [-np.sin(pitch), np.sin(roll) * np.cos(pitch), np.cos(roll) * np.cos(pitch)]
        )
        omega = rate * down
        wrench = rigid_wrench(velocity, omega, down, aileron, elevator, rudder, thrust)
        side = np.cross(omega, velocity)[1] - G * down[1]
        return [*wrench, down @ velocity, side if sideslip is None else beta - sideslip]

    found, _, status, message = fsolve(
        left, [0.1, 0.1, 0, 26 * rate / G, 10, 0, -0.2, 0], xtol=1e-13, full_output=True
    )
    assert status == 1 or np.max(np.abs(left(found))) < 1e-9, message
    return found


def values_of(result):
    every = {**result.inputs, **{name: getattr(result, name) for name in NAMES[:4]}}
    return np.array([every[name] for name in NAMES])


@pytest.mark.parametrize("conditions", [{"turn": cc.Turn(rate=0.12)}, {"sideslip": 0.06}], ids=str)
def test_stiff_wings_approach_the_rigid_aircraft_in_turns_and_sideslip(conditions):
    turn = conditions.get("turn")
    rigid = rigid_flight(0.0 if turn is None else turn.rate, conditions.get("sideslip"))
    away = [values_of(cc.trim(craft(s), **AIR, **conditions)) - rigid for s in (1e4, 1e5)]
    # Deflections are inversely proportional to the stiffness: what is left of the difference.
    assert_allclose(away[1], away[0] / 10, atol=2e-3 * np.abs(away[0]).max())
    assert np.max(np.abs(away[1][[0, 1, 2, 3, 5, 6, 7]])) < 1e-4


def test_side_force_of_a_rigid_sideslip_is_the_weight_across():
    # Of a keel at the body origin: the rudder takes the force of the fin away, which would yaw.
    keel = replace(FIN, name="keel", area=2.0, pose=replace(FIN.pose, position=[0, 0, 0]))
    keel = replace(keel, strips=replace(keel.strips, controls=()))
    plane = rigid_aircraft()
    plane = replace(plane, surfaces=(*plane.surfaces, FIN, keel))
    found = cc.trim(plane, **AIR, sideslip=0.06)
    assert found.sideslip == 0.06 and found.turn_rate == 0 and not found.coordinated
    _, _, (u, v, _) = motion_of(found)
    speed = np.hypot(u, v)
    force = 0.0889 / 2 * 2.0 * speed * (5 * u * np.arctan(v / u) + 0.01 * v)
    weight = WEIGHT * np.sin(found.roll) * np.cos(found.pitch)
    # The balances hold to 1e-8 of the weight.
    assert_allclose(weight, force, atol=2e-8 * WEIGHT)
    assert force > 0.01 * WEIGHT
    assert_allclose(found.inputs["rudder"], -5 / 3 * 0.06, rtol=0.02)


# Symmetry, and straight flight as a limit


def test_a_turn_of_no_rate_is_straight_flight(plane, turned):
    straight = cc.trim(plane, **AIR, inputs={"aileron": 0.0, "rudder": 0.0})
    still = turned(turn=cc.Turn(rate=0.0))
    assert_allclose(values_of(still), values_of(straight), rtol=1e-12, atol=1e-14)
    assert_allclose(still.drag, straight.drag, rtol=1e-12)
    for wing, q in straight.q.items():
        assert_allclose(still.q[wing], q, atol=1e-14)
    # And the limit is approached: differences are of second order in the rate.
    slow, slower = (values_of(turned(turn=cc.Turn(rate=r)))[[0, 1, 4, 6]] for r in (2e-3, 1e-3))
    limit = values_of(straight)[[0, 1, 4, 6]]
    assert_allclose(slow - limit, 4 * (slower - limit), rtol=1e-3)


@pytest.mark.parametrize("induced_flow", [None, cc.LiftingLine(panels=2)], ids=["strips", "line"])
def test_left_and_right_turns_are_mirror_images(plane, induced_flow):
    solver = TrimSolver(plane, None, "exact", induced_flow, turning=True)
    cases = [Case(**AIR, **LEVEL, inputs={}, turn=cc.Turn(rate=rate)) for rate in (0.1, -0.1)]
    right, left = (solver.solve(case, None, True) for case in cases)
    signs = np.array([1, 1, -1, -1, 1, -1, 1, -1])
    assert_allclose(values_of(left), signs * values_of(right), rtol=0, atol=1e-10)
    assert_allclose(left.q["left"], right.q["right"], atol=1e-10)
    assert_allclose(left.q["right"], right.q["left"], atol=1e-10)
    assert_allclose(left.drag, right.drag, rtol=1e-10)
    assert left.turn_radius == -right.turn_radius and left.load_factor == right.load_factor


# Kinematics and energy


def test_a_coordinated_turn_has_no_side_force_and_its_bank_angle(turns):
    for found in turns.values():
        attitude, omega, velocity = motion_of(found)
        felt = np.cross(omega, velocity) - G * attitude[2]
        assert_allclose(felt[1], 0, atol=1e-8 * G)
        assert_allclose((attitude @ velocity)[2], 0, atol=1e-8 * 26)
        u, _, w = velocity
        # The y component written out: exact, and V ψ̇/g where pitch and attack are small.
        tangent = found.turn_rate / G * (u + w * np.tan(found.pitch) / np.cos(found.roll))
        assert_allclose(np.tan(found.roll), tangent, rtol=1e-8)
        assert_allclose(np.tan(found.roll), 26 * found.turn_rate / G, rtol=0.02)


def test_load_factor_is_the_force_across_the_path(turns):
    for found in turns.values():
        attitude, omega, velocity = motion_of(found)
        felt = np.cross(omega, velocity) - G * attitude[2]
        along = velocity / 26
        across = felt - (felt @ along) * along
        assert_allclose(found.load_factor, np.linalg.norm(across) / G, rtol=1e-12)
        # Of a level turn 1/cos of the bank about the path, which the roll angle nearly is.
        assert_allclose(found.load_factor, 1 / np.cos(np.arctan(26 * found.turn_rate / G)))
        assert_allclose(found.load_factor, 1 / np.cos(found.roll), rtol=5e-3)
        assert_allclose(found.turn_radius * found.turn_rate, 26, rtol=1e-9)


def test_every_number_of_a_turn_gives_the_same_turn(turned, turns):
    for key, found in turns.items():
        numbers = {
            "rate": found.turn_rate,
            "bank": found.roll,
            "radius": found.turn_radius,
            "load_factor": found.load_factor,
        }
        assert_allclose(numbers[key], TURNS[key], rtol=1e-9)
    again = turned(turns["rate"], turn=cc.Turn(bank=turns["rate"].roll))
    assert_allclose(again.turn_rate, 0.1, rtol=1e-7)
    assert_allclose(values_of(again), values_of(turns["rate"]), rtol=1e-7, atol=1e-9)


@pytest.mark.parametrize("flight_path", [0.0, 0.03])
def test_thrust_pays_drag_and_climb_in_a_turn(turned, flight_path):
    found = turned(turn=cc.Turn(rate=0.1), flight_path=flight_path)
    _, _, velocity = motion_of(found)
    power = found.inputs["thrust"] * velocity[0]  # along x, through the origin
    weight = (50 + 24) * G * 26 * np.sin(flight_path)
    assert_allclose(power, 26 * found.drag + weight, rtol=1e-7)


def test_turning_wings_carry_more_and_the_outer_one_its_faster_air(turns):
    found = turns["rate"]
    lifts = {
        wing: float(ca.DM(16 * loads.weights).T @ loads.lift.T)
        for wing, loads in found.airloads.items()
    }
    assert sum(lifts.values()) > WEIGHT  # bent wings lift sideways as well
    straight = rigid_flight(0.0)
    assert found.angle_of_attack > straight[0]
    # Without ailerons the outer, left wing would lift more and roll further into the turn.
    assert found.inputs["aileron"] > 0


# What a turn may leave free, and errors


def test_without_a_rudder_the_sideslip_is_free():
    bare = craft(surfaces=(TAIL, replace(FIN, strips=replace(FIN.strips, controls=()))))
    with pytest.raises(cc.ConvergenceError, match=r"Without a rudder it turns with a free sidesl"):
        cc.trim(bare, **AIR, turn=cc.Turn(rate=0.1))
    found = cc.trim(bare, **AIR, turn=cc.Turn(rate=0.1), free=("sideslip",))
    assert found.trimmed and not found.coordinated and found.sideslip != 0


def test_a_turn_may_slip(turned):
    found = turned(turn=cc.Turn(rate=0.1), sideslip=0.02)
    assert_allclose(found.sideslip, 0.02)
    attitude, omega, velocity = motion_of(found)
    side = (np.cross(omega, velocity) - G * attitude[2])[1]
    assert abs(side) > 1e-3 * G


def test_an_aircraft_that_cannot_turn_says_so(plane, turned):
    with pytest.raises(cc.ConvergenceError, match=r"turn with rate 0.1 rad/s: .*that roll and"):
        cc.trim(aircraft(body=BODY), **AIR, turn=cc.Turn(rate=0.1))
    with pytest.raises(cc.ConvergenceError, match=r"with bank 1.2 rad.*force along z"):
        turned(turn=cc.Turn(bank=1.2))
    light = replace(plane, body=cc.RigidBody(mass=50.0, center_of_mass=[0, 0, 0]))
    with pytest.raises(ValueError, match=r"RigidBody.inertia: expected .* turns, found None"):
        cc.trim(light, **AIR, turn=cc.Turn(rate=0.1))


def test_a_sweep_of_turns_and_its_table(plane):
    rows = cc.trim_sweep(
        plane, [28.0, 26.0], density=0.0889, turn=cc.Turn(bank=0.2), progress=False
    )
    assert [row.trimmed for row in rows] == [True, True]
    assert_allclose([row.roll for row in rows], 0.2)
    table = cc.trim_table(rows)
    assert "bank [deg]" in table and f"{rows[1].load_factor:.4f}" in table
    assert f"radius {rows[0].turn_radius:.5g} m" in str(rows[0])


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda p: cc.Turn(), "Turn: expected one of rate, bank, .* found none"),
        (lambda p: cc.Turn(rate=1, bank=0.1), "found rate and bank"),
        (lambda p: cc.Turn(bank=30), r"Turn.bank: .* 30 degrees are 0.5236 rad"),
        (lambda p: cc.Turn(rate=np.nan), "Turn.rate"),
        (lambda p: cc.Turn(rate="fast"), "Turn.rate"),
        (lambda p: cc.Turn(radius=0), "Turn.radius: expected a number other than zero"),
        (lambda p: cc.Turn(load_factor=-2), "Turn.load_factor: expected a number above zero"),
        (
            lambda p: cc.trim(p, **AIR, turn=cc.Turn(load_factor=0.9)),
            "Turn.load_factor: expected at least 1,",
        ),
        (
            lambda p: cc.trim(p, **AIR, flight_path=None, turn=cc.Turn(radius=200)),
            "turn: expected rate or bank where flight_path is None",
        ),
        (lambda p: cc.trim(p, **AIR, turn=0.1), "turn: expected a Turn"),
        (lambda p: cc.trim(p, **AIR, sideslip=5.0), r"sideslip: .* 5 degrees are 0.08727 rad"),
        (lambda p: cc.trim(p, **AIR, sideslip=np.nan), "sideslip"),
        (
            lambda p: cc.trim(p, **AIR, sideslip=0.1, free=("sideslip",)),
            "free: .* 'sideslip' beside a sideslip",
        ),
        (
            lambda p: cc.trim(p, **AIR, turn=cc.Turn(bank=0.1), free=("roll",)),
            "free: .* 'roll' beside a turn with a bank angle",
        ),
        (
            lambda p: cc.trim(p, **AIR, turn=cc.Turn(rate=0.1), bounds={"turn_rate": (0, 1)}),
            "'turn_rate' is held",
        ),
    ],
)
def test_bad_turns_are_named(plane, make, message):
    with pytest.raises(ValueError, match=message):
        make(plane)
