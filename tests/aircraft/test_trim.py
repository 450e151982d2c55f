"""Trim: against hand-written equations, independent balances, and brute force."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import fsolve

import curvcasadi as cc
from curvcasadi.aero import ControlSurface, Flow, StripAerodynamics
from curvcasadi.aircraft import trim_problem
from curvcasadi.aircraft.balance import aircraft_wrench, wing_loads
from curvcasadi.aircraft.parts import (
    Aircraft,
    Flight,
    LiftingSurface,
    RigidBody,
    Thrust,
    Wing,
    mirror_wing,
)
from curvcasadi.aircraft.trim import trim, trim_sweep
from curvcasadi.aircraft.trim_case import Case
from curvcasadi.aircraft.trim_problem import TipHeight, attitude_matrix
from curvcasadi.aircraft.trim_result import trim_table
from curvcasadi.aircraft.trim_solver import TrimSolver
from curvcasadi.reference_wings import RIGHT_WING_ROOT, hale_wing

AIR = {"speed": 26.0, "density": 0.0889}
LEVEL = {"gravity": 9.80665, "flight_path": 0.0, "free": (), "bounds": {}}
WEIGHT = (50 + 2 * 16 * 0.75) * 9.80665
AIRFOIL = StripAerodynamics(
    chord=1.0, aerodynamic_center=0.25, lift_slope=2 * np.pi, profile_drag=0.01
)
FLAP = ControlSurface(name="flap", lift=3.0, moment=-0.5, start=0.5)
AILERON = ControlSurface(name="aileron", lift=1.0, start=0.6, antisymmetric=True)


def surface(name, position, rotation, area, *controls, **fields):
    strips = StripAerodynamics(
        chord=0.5,
        aerodynamic_center=0.0,
        lift_slope=5.0,
        profile_drag=0.01,
        controls=controls,
        **fields,
    )
    pose = cc.Pose(rotation=rotation, position=position)
    return LiftingSurface(name=name, area=area, pose=pose, strips=strips)


TAIL = surface(
    "tail", [-10, 0, 0], RIGHT_WING_ROOT.rotation, 2.5, ControlSurface(name="elevator", lift=3.0)
)
# Span up, leading edge forward: z = x × y, and with it the upper side, is to the left.
FIN = surface(
    "fin",
    [-10, 0, -1],
    [[0, 1, 0], [0, 0, -1], [-1, 0, 0]],
    1.5,
    ControlSurface(name="rudder", lift=3.0),
    upper_side=1,
)
LEFT_WING_ROTATION = [[0, 1, 0], [-1, 0, 0], [0, 0, 1]]
BODY = RigidBody(mass=50.0, center_of_mass=[0, 0, 0])


def aircraft(*controls, stiffness=1.0, body=BODY, surfaces=(TAIL,)):
    section = cc.Section(
        GJ=1e4 * stiffness, EI_y=2e4 * stiffness, EI_z=4e6 * stiffness, mass_per_length=0.75
    )
    beam = replace(hale_wing(grid=cc.Grid.lobatto(10)), section=section)
    right = Wing(name="right", beam=beam, strips=replace(AIRFOIL, controls=controls))
    wings = (right, mirror_wing(right, "left"))
    return Aircraft(body=body, beams=wings, surfaces=surfaces, thrusts=(Thrust(),))


@pytest.fixture(scope="module")
def level():
    return trim(aircraft(), **AIR)


def rigid_trim(speed):
    """α, thrust and elevator of the rigid aircraft, written out in the plane of symmetry."""

    def balance(unknown):
        alpha, thrust, elevator = unknown
        pressure = 0.0889 / 2 * speed**2
        up, back = (
            np.array([np.sin(alpha), -np.cos(alpha)]),
            -np.array([np.cos(alpha), np.sin(alpha)]),
        )
        wing = pressure * 32 * (2 * np.pi * alpha * up + 0.01 * back)
        tail = pressure * 2.5 * ((5 * alpha + 3 * elevator) * up + 0.01 * back)
        weight = WEIGHT * np.array([-np.sin(alpha), np.cos(alpha)])
        force = wing + tail + weight + [thrust, 0]
        return [*force, -0.25 * wing[1] + 10 * tail[1]]

    return fsolve(balance, [0.1, 10, 0], xtol=1e-13)


def rigid_aircraft():
    wing = LiftingSurface(name="wing", area=32.0, pose=RIGHT_WING_ROOT, strips=AIRFOIL)
    body = RigidBody(mass=50 + 2 * 16 * 0.75, center_of_mass=[0, 0, 0])
    return Aircraft(body=body, beams=(), surfaces=(wing, TAIL), thrusts=(Thrust(),))


def unknowns_of(result):
    return [result.angle_of_attack, result.inputs["thrust"], result.inputs["elevator"]]


def test_rigid_aircraft_trims_where_the_equations_by_hand_do():
    result = trim(rigid_aircraft(), **AIR)
    # The balances hold to 1e-8 of the weight.
    assert_allclose(unknowns_of(result), rigid_trim(26.0), rtol=1e-6)


def test_stiff_wings_approach_the_rigid_aircraft():
    rigid = rigid_trim(26.0)
    away = [unknowns_of(trim(aircraft(stiffness=s), **AIR)) - rigid for s in (1e3, 1e4)]
    # Deflections are inversely proportional to the stiffness.
    assert_allclose(away[0], 10 * away[1], rtol=0.02)


def flight_of(result):
    alpha = result.angle_of_attack
    velocity = result.speed * ca.DM([np.cos(alpha), 0, np.sin(alpha)])
    return Flight(
        flow=Flow(density=0.0889, velocity=velocity),
        attitude=attitude_matrix(ca.DM(result.roll), ca.DM(result.pitch)),
        gravity=9.80665,
    )


def test_everything_balances(level):
    wrench = aircraft_wrench(aircraft(), level.q, flight_of(level), level.inputs).full().ravel()
    # The tolerance of the trim: 1e-8 of the weight, at a tenth of the wing for moments.
    assert_allclose(wrench[3:], 0, atol=1e-8 * WEIGHT)
    assert_allclose(wrench[:3], 0, atol=1.6e-8 * WEIGHT)
    assert level.trimmed and level.message == "trimmed"
    assert_allclose([*level.balances.values()], 0, atol=1.6e-8 * WEIGHT)


def test_wings_are_in_equilibrium_and_alike(level):
    wing = aircraft().beams[0]
    flight = flight_of(level)
    loads = wing_loads(wing, flight, level.inputs)
    found = cc.solve_equilibrium(wing.beam, loads, level.q["right"], attitude=flight.attitude)
    # Residuals of 1e-8 W L² over stiffnesses of 1e4 L.
    assert_allclose(level.q["right"], found.q, atol=1e-7)
    assert_allclose(level.q["right"], level.q["left"], atol=1e-9)


def test_a_left_wing_described_by_itself_trims_as_a_mirrored_one():
    strips = replace(AIRFOIL, zero_lift_angle=-0.03, moment_coefficient=-0.02, controls=(FLAP,))
    right = aircraft().beams[0].beam
    left = replace(right, root=cc.Pose(rotation=LEFT_WING_ROTATION, position=[0, 0, 0]))
    wings = [Wing(name="right", beam=right, strips=strips)]
    held = {**AIR, "inputs": {"flap": 0.05}}
    trims = [
        trim(
            Aircraft(body=BODY, beams=(*wings, other), surfaces=(TAIL,), thrusts=(Thrust(),)),
            **held,
        )
        for other in (mirror_wing(wings[0], "left"), Wing(name="left", beam=left, strips=strips))
    ]
    mirrored, described = trims
    # Both to 1e-8 of the weight, over the stiffness of the balances.
    assert_allclose(unknowns_of(described), unknowns_of(mirrored), rtol=1e-6)
    assert_allclose(described.tip_height("left"), mirrored.tip_height("left"), rtol=1e-6)
    assert_allclose(described.tip_height("left"), described.tip_height("right"), rtol=1e-6)


@pytest.mark.parametrize(("tilt", "side"), [(0.2, 1), (1.5, 1), (1.7, -1), (np.pi, -1)])
def test_the_upper_side_is_that_of_the_root(tilt, side):
    c, s = np.cos(tilt), np.sin(tilt)
    turned = cc.Pose(rotation=np.array([[0, 1, 0], [c, 0, s], [s, 0, -c]]), position=[0, 0, 0])
    wing = Wing(name="wing", beam=replace(hale_wing(), root=turned), strips=AIRFOIL)
    tail = LiftingSurface(name="tail", area=1.0, pose=turned, strips=AIRFOIL)
    assert wing.strips.upper_side == tail.strips.upper_side == side
    assert mirror_wing(wing, "other").strips.upper_side == -side
    given = replace(AIRFOIL, upper_side=-side)
    assert Wing(name="wing", beam=wing.beam, strips=given).strips.upper_side == -side


def test_an_upright_root_needs_the_upper_side():
    upright = [[0, 1, 0], [0, 0, -1], [-1, 0, 0]]
    with pytest.raises(ValueError, match=r"upper_side of the surface 'fin': .*root is upright"):
        surface("fin", [-10, 0, -1], upright, 1.5)
    beam = replace(hale_wing(), root=cc.Pose(rotation=upright, position=[0, 0, 0]))
    with pytest.raises(ValueError, match=r"upper_side of the wing 'fin': .*root is upright"):
        Wing(name="fin", beam=beam, strips=AIRFOIL)


def test_level_flight_is_level_and_thrust_carries_the_drag(level):
    assert_allclose(level.flight_path, 0, atol=1e-8)
    assert_allclose(level.pitch, level.angle_of_attack, atol=1e-8)
    thrust = level.inputs["thrust"] * np.cos(level.angle_of_attack)
    assert_allclose(level.drag, thrust, rtol=1e-6)


def test_root_moment_is_that_of_the_curvature_there(level):
    beam = aircraft().beams[0].beam
    moment = beam.section.stiffness(0.0) @ cc.curvature(beam, level.q["right"], 0.0)
    # Four weights: the curvature at an end is the worst that they represent.
    assert_allclose(level.root_loads["right"][1], float(moment[1]), rtol=0.02)
    assert level.root_loads["right"][1] < 0 < level.root_loads["left"][1]  # tips up


def test_airloads_carry_the_weight(level):
    loads = level.airloads["right"]
    lift = np.trapezoid(loads.lift.full().ravel(), 16 * loads.xi)
    tip_up = 1 - level.shapes["right"].positions.full()[1, -1] / 16
    # More than half of the weight, since bent wings lift sideways; the tail takes its small share.
    assert WEIGHT / 2 < lift < WEIGHT / 2 / (1 - 2 * tip_up)


def test_climb_and_glide():
    climbing = trim(aircraft(), **AIR, flight_path=0.05)
    assert_allclose(climbing.flight_path, 0.05, atol=1e-8)
    assert_allclose(climbing.pitch - climbing.angle_of_attack, 0.05, atol=1e-8)
    gliding = trim(aircraft(), **AIR, flight_path=None, inputs={"thrust": 0.0})
    # Without thrust the weight along the path carries the drag.
    assert_allclose(WEIGHT * np.sin(-gliding.flight_path), gliding.drag, rtol=1e-6)


def test_warm_start_finds_the_same_trim_in_fewer_iterations(level):
    again = trim(aircraft(), **AIR, guess=level)
    assert again.iterations < level.iterations
    assert_allclose(unknowns_of(again), unknowns_of(level), rtol=1e-6)


@pytest.fixture(scope="module")
def flapped():
    """Trims of an aircraft with flaps by their angle; the solver is built once."""
    return TrimSolver(aircraft(FLAP), None, "exact")


@pytest.mark.parametrize(
    ("objective", "value"),
    [
        ("strain_energy", lambda r: r.strain_energy),
        ("root_bending", lambda r: r.root_loads["right"][1] ** 2),
        ("drag", lambda r: r.drag),
    ],
)
def test_objective_is_least_among_all_trims(flapped, objective, value):
    best = trim(aircraft(FLAP), **AIR, objective=objective, bounds={"flap": (-0.5, 0.2)})

    assert best.trimmed and best.converged
    for angle in (-0.5, -0.3, -0.1, 0.1, 0.2, best.inputs["flap"] - 0.01):
        if angle >= -0.5:
            case = Case(**AIR, inputs={"flap": angle}, **LEVEL)
            other = flapped.solve(case, best, True)
            # To what the solver leaves at an active bound.
            assert value(best) <= value(other) * (1 + 1e-6)


def test_tip_height_is_met():
    result = trim(aircraft(FLAP), **AIR, objective=TipHeight(wing="right", height=4.0))
    assert_allclose(-float(result.shapes["right"].tip.position[2]), 4.0, atol=1e-3)


def test_lateral_trim_holds_a_body_off_the_plane_of_symmetry():
    body = RigidBody(mass=50.0, center_of_mass=[0, 0.05, 0])
    lopsided = aircraft(AILERON, body=body, surfaces=(TAIL, FIN))
    result = trim(lopsided, **AIR, free=("roll",), inputs={})
    assert result.trimmed and result.sideslip == 0
    assert abs(result.inputs["aileron"]) > 1e-3
    # Without sideslip the unbalanced weight needs an aileron, which needs a rudder and a bank.
    with pytest.raises(cc.ConvergenceError, match=r"moment about x \(roll\).*free sideslip"):
        trim(lopsided, **AIR, inputs={"aileron": 0.0, "rudder": 0.0})


def test_too_slow_a_flight_says_what_does_not_balance():
    with pytest.raises(cc.ConvergenceError, match="no trim at 12 m/s: force along z") as failure:
        trim(aircraft(), speed=12.0, density=0.0889)
    message, result = str(failure.value), failure.value.result
    assert "equilibrium" not in message  # the wings are
    assert "% of the weight" in message and "angle_of_attack at its upper bound" in message
    assert not result.trimmed and result.converged
    assert result.balances["force along z"] > 0.1 * WEIGHT


def test_a_trim_that_does_not_converge_says_so(monkeypatch):
    monkeypatch.setitem(trim_problem._IPOPT, "ipopt.max_iter", 1)
    with pytest.raises(cc.ConvergenceError) as failure:
        trim(aircraft(), speed=12.0, density=0.0889)
    message, result = str(failure.value), failure.value.result
    assert message.startswith("trim at 12 m/s did not converge in ")
    assert "Where it stopped, " in message and "force along z is left with" in message
    # Neither that there is no trim nor what holds it is known.
    assert "no trim" not in message and "held by" not in message
    assert not result.trimmed and not result.converged


def test_sweep_is_a_row_of_trims_and_a_table(level):
    results = trim_sweep(aircraft(), [30.0, 26.0, 12.0], density=0.0889, progress=False)
    assert [r.trimmed for r in results] == [True, True, False]
    assert_allclose(unknowns_of(results[1]), unknowns_of(level), rtol=1e-6)
    lines = trim_table(results).splitlines()
    assert len(lines) == 4 and lines[3].endswith("no")
    assert f"{results[1].inputs['thrust']:.3f}" in lines[2]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"speed": -1}, "speed"),
        ({"density": 0}, "density"),
        ({"inputs": {"flaps": 0.1}}, "inputs.*'flaps'"),
        ({"free": ("yaw",)}, "free.*'yaw'"),
        ({"bounds": {"rudder": (0, 1)}}, "bounds.*'rudder'"),
        ({"bounds": {"elevator": (1, 0)}}, "lower <= upper"),
        ({"bounds": {"roll": (0, 1)}}, "'roll' is held"),
        ({"objective": "cost"}, "objective"),
        ({"objective": TipHeight(wing="middle", height=1)}, "TipHeight.wing"),
        ({"hessian": "none", "objective": "drag"}, "hessian"),
        ({"inputs": {"thrust": float("nan")}}, r"inputs\['thrust'\]"),
        ({"guess": 1}, "guess"),
    ],
)
def test_bad_arguments_are_named(arguments, message):
    with pytest.raises(ValueError, match=message):
        trim(aircraft(), **{**AIR, **arguments})


def test_more_free_inputs_than_balances_need_an_objective():
    with pytest.raises(ValueError, match="or give an objective"):
        trim(aircraft(FLAP), **AIR)


@pytest.mark.parametrize("objective", [None, "root_bending"])
def test_inputs_that_roll_and_yaw_are_zero_in_straight_flight(level, objective):
    controls = (AILERON,) if objective is None else (AILERON, FLAP)
    agile = aircraft(*controls, surfaces=(TAIL, FIN))
    found = trim(agile, **AIR, objective=objective)
    assert found.success
    assert_allclose([found.inputs["aileron"], found.inputs["rudder"]], 0, atol=1e-9)
    if objective is None:
        held = trim(agile, **AIR, inputs={"aileron": 0.0, "rudder": 0.0})
        assert_allclose(unknowns_of(found), unknowns_of(held), rtol=1e-9)
    else:
        assert abs(found.inputs["flap"]) > 0.1


def test_two_engines_share_the_thrust(level):
    engines = [
        Thrust(name=name, position=[0, y, 0]) for name, y in (("right", 2.0), ("left", -2.0))
    ]
    named = replace(aircraft(), thrusts=tuple(replace(e, name=f"{e.name}_engine") for e in engines))
    found = trim(named, **AIR)
    assert_allclose([found.inputs[f"{side}_engine"] for side in ("right", "left")],
                    level.inputs["thrust"] / 2, rtol=1e-7)  # fmt: skip


def test_names_of_inputs_and_angles_differ():
    with pytest.raises(ValueError, match="names of wings and inputs"):
        trim(aircraft(replace(FLAP, name="pitch")), **AIR)


def test_failed_trim_of_a_wing_without_bounds_says_what_failed():
    plain = aircraft()
    wings = tuple(replace(w, beam=replace(w.beam, weight_bounds=None)) for w in plain.beams)
    with pytest.raises(cc.ConvergenceError, match="force along z"):
        trim(replace(plain, beams=wings), speed=8.0, density=0.0889)


def test_a_held_deflection_in_degrees_is_refused():
    words = (
        r"inputs\['elevator'\]: expected within -0.5 to 0.5 rad, found 5; 5 degrees are 0.08727 rad"
    )
    with pytest.raises(ValueError, match=words):
        trim(aircraft(), **AIR, inputs={"elevator": 5.0})
