"""Trimmed flight of the HALE aircraft: it stays there, is mirror symmetric, and has named modes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose

import curvcasadi as cc
from curvcasadi.lie import quaternion

FILE = Path(__file__).parents[2] / "ocp_examples" / "hale_aircraft.toml"
DENSITY, SPEED = 0.0889, 25.0


@pytest.fixture(scope="module")
def hale():
    """The aircraft of the example with ailerons."""
    plane = cc.load_aircraft(FILE)
    aileron = cc.ControlSurface(name="aileron", lift=3.0, start=0.7, antisymmetric=True)
    right = plane.beams[0]
    right = replace(right, strips=replace(right.strips, controls=(aileron,)))
    return replace(plane, beams=(right, cc.mirror_wing(right, "left")))


@pytest.fixture(scope="module")
def model(hale):
    """With a state of the air for each strip, so that steady flight is that of `trim`."""
    lag = cc.IndicialLag(poles=2, modes=None)
    return cc.aircraft_model(hale, density=DENSITY, lag=lag)


@pytest.fixture(scope="module")
def trimmed(hale):
    return cc.trim(hale, speed=SPEED, density=DENSITY, inputs={"aileron": 0.0})


@pytest.fixture(scope="module")
def start(model, trimmed):
    return cc.trimmed_state(model, trimmed)


@pytest.fixture(scope="module")
def modes(model, trimmed):
    return cc.flight_modes(model, trimmed)


def test_a_steady_trim_is_an_equilibrium_of_the_model(model, trimmed, start):
    assert_allclose(model.u.split(ca.DM(start.u))["thrust"], trimmed.inputs["thrust"], rtol=1e-10)
    assert_allclose(
        model.u.split(ca.DM(start.u))["elevator"], trimmed.inputs["elevator"], rtol=1e-10
    )
    parts = model.x.split(ca.DM(start.x))
    for name, q in trimmed.q.items():
        assert_allclose(parts[f"q_{name}"], q, atol=1e-11)
    rates = model.x.split(model.xdot(start.x, start.u, []))
    assert_allclose(rates["position"], [[SPEED], [0], [0]], atol=1e-11)
    # Rounding of forces of some kN, over masses of kg and weights that weigh little.
    for name in set(rates) - {"position"}:
        assert_allclose(rates[name], 0, atol=1e-11, err_msg=name)


def test_outputs_of_trimmed_flight_are_those_of_the_trim(model, trimmed, start):
    found = model.y.split(model.output(start.x, start.u, []))
    assert_allclose(float(found["airspeed"]), SPEED, rtol=1e-13)
    assert_allclose(float(found["angle_of_attack"]), trimmed.angle_of_attack, rtol=1e-10)
    assert_allclose(float(found["sideslip"]), 0, atol=1e-12)
    assert_allclose(float(found["load_factor"]), np.cos(trimmed.pitch), rtol=1e-12)
    for wing, load in trimmed.root_loads.items():
        own = ca.vertcat(found[f"root_moment_{wing}"], found[f"root_force_{wing}"])
        assert_allclose(own.full().ravel(), load, atol=1e-9 * np.abs(load).max())
        tip = trimmed.shapes[wing].tip.position
        assert_allclose(found[f"tip_position_{wing}"], tip, atol=1e-10)


def test_lag_functions_move_the_equilibrium_little(hale, trimmed):
    model = cc.aircraft_model(hale, density=DENSITY, lag=cc.IndicialLag(poles=2, modes=3))
    x, u = cc.trimmed_state(model, trimmed)
    rates = model.x.split(model.xdot(x, u, []))
    for name in set(rates) - {"position"}:
        assert_allclose(rates[name], 0, atol=1e-11, err_msg=name)
    # Three Legendre functions leave some 1e-3 of the distribution of the angle of attack.
    found = dict(zip([part.name for part in model.u.parts], u, strict=True))
    for name in ("thrust", "elevator"):
        value = trimmed.inputs[name]
        assert 1e-6 < abs(found[name] / value - 1) < 2e-3


def test_trimmed_flight_stays_trimmed(model, start):
    """The long run is benchmarks/flight.py; the dutch roll grows, rounding with it."""
    times = np.linspace(0, 5, 6)
    found = cc.simulate(model, start.x, times, u=start.u, method="implicit_midpoint", dt=0.02)
    speed = np.linalg.norm(found.part("twist")[3:], axis=0)
    assert_allclose(speed / SPEED, 1, atol=1e-10)
    assert_allclose(found.part("position")[2], 0, atol=1e-10 * SPEED * times[-1])


@pytest.fixture(scope="module")
def turning(hale):
    """A turn to the right; without a rudder the sideslip is free."""
    turn = cc.Turn(rate=0.08)
    return cc.trim(hale, speed=SPEED, density=DENSITY, turn=turn, free=("sideslip",))


def test_a_steady_turn_is_an_equilibrium_of_the_model(model, turning):
    x, u = cc.trimmed_state(model, turning)
    found = model.u.split(ca.DM(u))
    for name, value in turning.inputs.items():
        assert_allclose(float(found[name]), value, rtol=1e-9)
    parts = model.x.split(ca.DM(x))
    for name, q in turning.q.items():
        assert_allclose(parts[f"q_{name}"], q, atol=1e-11)
    rates = model.x.split(model.xdot(x, u, []))
    for name in set(rates) - {"position", "quaternion_wxyz"}:
        assert_allclose(rates[name], 0, atol=1e-11, err_msg=name)
    omega, velocity = parts["twist"][:3], parts["twist"][3:]
    rotation = quaternion.rotation(parts["quaternion_wxyz"])
    # The heading turns, nothing else; the flight stays level and as fast.
    assert_allclose(rotation @ omega, [[0], [0], [0.08]], atol=1e-15)
    assert_allclose((rotation @ velocity)[2], 0, atol=1e-12)
    assert_allclose(ca.norm_2(velocity), SPEED, rtol=1e-14)


def test_a_turning_aircraft_flies_a_circle(model, turning):
    x, u = cc.trimmed_state(model, turning)
    times = np.linspace(0, 2, 5)
    found = cc.simulate(model, x, times, u=u, method="implicit_midpoint", dt=0.02)
    for name in {part.name for part in model.x.parts} - {"quaternion_wxyz", "position"}:
        start = found.part(name)[:, :1]
        assert_allclose(found.part(name) - start, 0, atol=1e-10, err_msg=name)
    # Where it flew at the start: sideslip turns the path away from the heading.
    path = model.xdot(x, u, [])[model.x.slices["position"]].full().ravel()
    course = np.arctan2(path[1], path[0])
    at = turning.turn_radius * np.exp(1j * course) * (np.exp(0.08j * times) - 1) / 1j
    north, east, down = found.part("position")
    # The attitude turns by the rule's order 2: a relative (ω dt)²/12 of the rate.
    assert_allclose(north + 1j * east, at, atol=1e-6 * SPEED)
    assert_allclose(down, 0, atol=1e-10)


def test_modes_of_a_turn_are_named(model, turning, modes):
    turned = cc.flight_modes(model, turning)
    for name in ("phugoid", "short period", "dutch roll"):
        assert_allclose(turned[name].eigenvalue, modes[name].eigenvalue, rtol=0.5)


def mirrored(model, x):
    """The mirror image of a state: wings change sides, and what is lateral its sign."""
    signs = {
        "quaternion_wxyz": [1, -1, 1, -1],
        "position": [1, -1, 1],
        "twist": [-1, 1, -1, 1, -1, 1],
    }
    parts = {name: part.full().ravel() for name, part in model.x.split(ca.DM(x)).items()}
    other = {"right": "left", "left": "right"}
    image = {}
    for name, value in parts.items():
        stem, _, wing = name.rpartition("_")
        image[f"{stem}_{other[wing]}" if wing in other else name] = value * signs.get(name, 1)
    return np.concatenate([image[part.name] for part in model.x.parts])


def test_a_mirror_image_has_the_same_eigenvalues(model, start):
    rng = np.random.default_rng(0)
    x = start.x + 0.02 * rng.normal(size=start.x.size)
    x[:4] /= np.linalg.norm(x[:4])
    both = [cc.linearize(model, state, start.u).A for state in (x, mirrored(model, x))]
    roots = [np.linalg.eigvals(matrix) for matrix in both]
    near = np.abs(roots[0][:, None] - roots[1]).min(axis=1)
    assert np.max(near) < 1e-12 * np.max(np.abs(roots[0]))


def test_symmetric_flight_stays_symmetric(model, start):
    x = start.x.copy()
    x[model.x.slices["twist"]] += [0, 0.05, 0, 1.0, 0, -0.5]
    times = np.linspace(0, 10, 3)
    found = cc.simulate(model, x, times, u=start.u, method="implicit_midpoint", dt=0.02)
    assert np.ptp(found.part("position")[2]) > 1  # it does move
    for name, rows in {"quaternion_wxyz": [1, 3], "position": [1], "twist": [0, 2, 4]}.items():
        assert_allclose(found.part(name)[rows], 0, atol=1e-10)
    for name in ("q", "q_dot", "lag"):
        right, left = (found.part(f"{name}_{side}") for side in ("right", "left"))
        assert_allclose(right, left, atol=1e-10)


def test_modes_have_their_names(model, modes):
    named = [mode.name for mode in modes][:5]
    assert named == ["phugoid", "short period", "dutch roll", "spiral", "roll"]
    assert len(modes.eigenvalues) + np.sum(modes.eigenvalues.imag > 0) == model.x.errors.size - 4
    # Lanchester's phugoid, √2 g/V, of an aircraft without short period and drag.
    phugoid = modes["phugoid"].eigenvalue
    assert_allclose(abs(phugoid), np.sqrt(2) * 9.80665 / SPEED, rtol=0.5)
    rows = model.x.errors.slices
    for name in ("phugoid", "short period"):
        shape = modes[name].shape
        assert_allclose(shape[rows["q_right"]], shape[rows["q_left"]], atol=1e-9)
    for name in ("dutch roll", "spiral", "roll"):
        shape = modes[name].shape
        assert_allclose(shape[rows["q_right"]], -shape[rows["q_left"]], atol=1e-9)
    assert modes["dutch roll"].time_to_half < 0 < modes["spiral"].time_to_half
    assert not modes.stable
    assert "dutch roll" in str(modes)


def test_induced_flow_does_not_change_which_mode_is_the_short_period(hale):
    """An aperiodic bending of the wings pitches more, with less heave."""
    found = []
    for line in (None, cc.LiftingLine(panels=6)):
        trim = cc.trim(hale, speed=SPEED, density=DENSITY, induced_flow=line)
        model = cc.aircraft_model(hale, density=DENSITY, induced_flow=line, outputs=())
        found.append(cc.flight_modes(model, trim))
    for name in ("phugoid", "short period", "dutch roll"):
        alone, induced = (modes[name].eigenvalue for modes in found)
        assert_allclose(induced, alone, rtol=0.2)


def test_a_mode_is_an_eigenvector_of_the_linear_model(model, start, modes):
    matrix = cc.linearize(model, start.x, start.u).A
    rows = model.x.errors.slices
    free = np.ones(len(matrix), dtype=bool)
    free[rows["position"]] = False
    free[rows["quaternion_wxyz"]] = False  # heading follows
    for mode in modes.modes[:5]:
        left = matrix @ mode.shape - mode.eigenvalue * mode.shape
        assert_allclose(left[free], 0, atol=1e-9)


def test_the_trim_of_another_air_is_named(hale, trimmed):
    lag = cc.IndicialLag(poles=2, modes=None)
    denser = cc.aircraft_model(hale, density=1.5 * DENSITY, lag=lag, outputs=())
    with pytest.warns(
        UserWarning, match="angle_of_attack is .* instead of .* are density, gravity and"
    ):
        cc.trimmed_state(denser, trimmed)


def test_an_equilibrium_beyond_bounds_is_refused_by_name(hale, trimmed):
    lag = cc.IndicialLag(poles=2, modes=1)  # moves the equilibrium: one function for a wing
    model = cc.aircraft_model(hale, density=DENSITY, lag=lag, outputs=())
    _, u = cc.trimmed_state(model, trimmed)
    moved = dict(zip([part.name for part in model.u.parts], u, strict=True))
    sides = {}
    for name in ("elevator", "thrust"):
        ends = sorted([trimmed.inputs[name], (trimmed.inputs[name] + moved[name]) / 2])
        sides[name] = tuple(ends)
    tight = replace(trimmed, bounds={**trimmed.bounds, **sides})
    with pytest.raises(cc.ConvergenceError) as failure:
        cc.trimmed_state(model, tight)
    for name, (low, high) in sides.items():
        side = f"below {low:g}" if moved[name] < low else f"above {high:g}"
        assert f"{name} would be {moved[name]:.6g} " in str(failure.value)
        assert side in str(failure.value)
    assert len(failure.value.result.x) == model.x.size


def test_an_input_at_its_bound_stays_there(hale):
    flap = cc.ControlSurface(name="flap", lift=3.0, start=0.5)
    right = hale.beams[0]
    right = replace(right, strips=replace(right.strips, controls=(flap,)))
    plane = replace(hale, beams=(right, cc.mirror_wing(right, "left")))
    flight = {"speed": SPEED, "density": DENSITY, "bounds": {"flap": (-0.1, 0.1)}}
    least = cc.trim(plane, **flight, objective="root_bending")
    lag = cc.IndicialLag(poles=2, modes=1)
    model = cc.aircraft_model(plane, density=DENSITY, lag=lag, outputs=())
    with pytest.warns(UserWarning, match=r"flap is -0.07\d* rad instead of -0.1;"):
        _, u = cc.trimmed_state(model, least)
    flown = float(model.u.split(ca.DM(u))["flap"])
    # One bound that is in the way: the other inputs balance without the flap.
    held = replace(least, bounds={**least.bounds, "flap": (-0.5, flown - 0.01)})
    with pytest.warns(UserWarning, match="elevator is"):
        x, u = cc.trimmed_state(model, held)
    assert_allclose(model.u.split(ca.DM(u))["flap"], flown - 0.01, rtol=1e-14)
    assert_allclose(model.x.split(model.xdot(x, u, []))["twist"], 0, atol=1e-10)


def test_what_is_no_trim_of_the_model_is_named(model, trimmed):
    with pytest.raises(ValueError, match="trim: expected a flight in balance"):
        cc.trimmed_state(model, replace(trimmed, trimmed=False))
    with pytest.raises(ValueError, match=r"model: expected an aircraft_model with the wings"):
        cc.flight_modes(model, replace(trimmed, q={"right": trimmed.q["right"]}))
    with pytest.raises(ValueError, match=r"model: expected the inputs \['elevator'\] of the trim"):
        cc.flight_modes(model, replace(trimmed, inputs={"elevator": 0.0}))
    shorter = {name: q[:-1] for name, q in trimmed.q.items()}
    with pytest.raises(ValueError, match=r"expected 8 weights of the wing 'right'.*found 9"):
        cc.trimmed_state(model, replace(trimmed, q=shorter))
    with pytest.raises(KeyError, match="short period"):
        cc.flight_modes(model, trimmed)["short_period"]


@pytest.mark.parametrize("call", [cc.trimmed_state, cc.flight_modes])
def test_the_time_of_a_gust_is_asked_for(model, trimmed, call):
    gusty = replace(model, p=cc.Layout((cc.Part("time", 1, "s"),)))
    with pytest.raises(
        ValueError, match=r"^p: expected time \(s\), which the model has no nominal"
    ):
        call(gusty, trimmed)
