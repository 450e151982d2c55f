"""Free flight as a control model: momentum, energy, and what is refused."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose

import curvcasadi as cc
from curvcasadi.lie import quaternion
from curvcasadi.reference_wings import hale_wing
from curvcasadi.statics.energy import stiffness_matrix


@pytest.fixture(scope="module")
def aircraft():
    right = replace(hale_wing(torsion=1, out_of_plane=2, in_plane=1), grid=cc.Grid.lobatto(4))
    body = cc.RigidBody(mass=50.0, center_of_mass=[0.1, 0, 0.2], inertia=np.diag([40.0, 30, 50]))
    wing = cc.Wing(name="right", beam=right)
    return cc.Aircraft(body=body, beams=(wing, cc.mirror_wing(wing, "left")))


@pytest.fixture(scope="module")
def flying(aircraft):
    strips = cc.StripAerodynamics(chord=1.0, aerodynamic_center=0.25, lift_slope=6.0, stations=3)
    wing = replace(aircraft.beams[0], strips=strips)
    return replace(aircraft, beams=(wing, cc.mirror_wing(wing, "left")))


@pytest.fixture(scope="module")
def model(aircraft):
    return cc.aircraft_model(aircraft, density=0, gravity=0)


START = {
    "quaternion_wxyz": [1, 0, 0, 0],
    "q_right": [0, -0.03, 0.01, 0],
    "q_left": [0, -0.03, 0, 0],
    "twist": [0.3, 0.2, -0.15, 1.0, 0.5, -0.2],
    "q_dot_right": [0.02, 0, 0, 0.002],
}


def momentum(model, x):
    """Linear and angular momentum (6,), inertial axes, about the inertial origin."""
    body = model.second_order.momenta(x)[0].full().ravel()[:6]
    rotation = quaternion.rotation(x[:4]).full()
    linear = rotation @ body[3:]
    return np.concatenate([linear, rotation @ body[:3] + np.cross(x[4:7], linear)])


def test_parts_are_those_of_body_and_wings(model):
    names = [part.name for part in model.x.parts]
    assert names == [
        "quaternion_wxyz", "position", "q_right", "q_left", "twist", "q_dot_right", "q_dot_left",
    ]  # fmt: skip
    assert model.x.errors.size == 2 * 14


@pytest.mark.parametrize(
    "method, dt, limit",
    # The variational rule keeps momentum to rounding; the others to their order (5 ms at 50 rad/s).
    [("variational", 0.005, 1e-12), ("implicit_midpoint", 0.005, 1e-4), ("rk4", 0.002, 1e-5)],
)
def test_momentum_without_loads(model, method, dt, limit):
    result = cc.simulate(model, START, np.linspace(0, 0.5, 3), method=method, dt=dt)
    first, last = (momentum(model, result.x[:, k]) for k in (0, -1))
    for part in (slice(0, 3), slice(3, 6)):
        change = np.linalg.norm(last[part] - first[part]) / np.linalg.norm(first[part])
        assert change < limit
    assert_allclose(np.linalg.norm(result.part("quaternion_wxyz"), axis=0), 1, rtol=1e-13)


def test_all_methods_find_the_same_motion(model):
    ends = [
        cc.simulate(model, START, [0, 0.2], method=method, dt=dt).x[:, -1]
        for method, dt in (("variational", 1e-3), ("implicit_midpoint", 1e-3), ("rk4", 1e-3))
    ]
    # (ω h)² of the second-order rules at 50 rad/s over 0.2 s, of velocities of about one.
    for end in ends[:2]:
        assert_allclose(end, ends[2], atol=5e-3)


def test_a_falling_aircraft_falls_freely(aircraft):
    """Gravity alone bends nothing: every part falls alike."""
    model = cc.aircraft_model(aircraft, density=0)
    rest = {"quaternion_wxyz": [1, 0, 0, 0]}
    for method in ("variational", "implicit_midpoint", "rk4"):
        result = cc.simulate(model, rest, [0, 0.1, 0.2], method=method, dt=0.01)
        assert_allclose(
            result.part("position")[2], 9.80665 * np.array([0, 0.1, 0.2]) ** 2 / 2, atol=1e-9
        )
        assert_allclose(result.part("q_right"), 0, atol=1e-9)


def test_the_variational_rule_needs_momenta():
    beam = cc.beam_model(hale_wing(torsion=1, out_of_plane=1, in_plane=1))
    with pytest.raises(ValueError, match=r"'variational' needs a model with momenta, .*'beam'"):
        cc.simulate(beam, {}, [0, 1], method="variational")


def test_wings_are_damped_as_those_of_a_wing_model(aircraft):
    """One β, a matrix for each wing, or either by name: the force on the weights is C q_dot."""
    rng, wings = np.random.default_rng(2), aircraft.beams
    stiffness = ca.DM(stiffness_matrix(wings[0].beam)).full()
    modal = cc.modal_damping(wings[0].beam, [0.02, 0.05])
    expected = {
        0.003: (0.003 * stiffness, 0.003 * stiffness),
        "matrix": (modal, modal),
        "names": (modal, 0.003 * stiffness),
    }
    given = {0.003: 0.003, "matrix": modal, "names": {"right": modal, "left": 0.003}}
    still = cc.aircraft_model(aircraft, density=0, outputs=())
    x, a = rng.normal(size=still.x.size), np.zeros(14)
    x[:4] = [1, 0, 0, 0]
    before = still.second_order.balance(x, a, [], [])[0].full().ravel()
    rates = [x[still.x.slices[f"q_dot_{wing.name}"]] for wing in wings]
    for key, matrices in expected.items():
        damped = cc.aircraft_model(aircraft, density=0, damping=given[key], outputs=())
        after = damped.second_order.balance(x, a, [], [])[0].full().ravel()
        forces = [matrix @ rate for matrix, rate in zip(matrices, rates, strict=True)]
        assert_allclose(after - before, np.r_[np.zeros(6), *forces], atol=1e-9)
        found = damped.second_order.matrices(x, [])[1].full()
        assert_allclose(found[6:10, 6:10], matrices[0], rtol=1e-12, atol=1e-12)
        assert_allclose(found[10:, 10:], matrices[1], rtol=1e-12, atol=1e-12)
        assert not np.any(found[:6]) and not np.any(found[6:10, 10:])


@pytest.mark.parametrize(
    ("damping", "message"),
    [
        (-1.0, "damping: expected a time of at least zero"),
        (np.eye(3), r"damping: expected a number or a matrix \(4, 4\), found \(3, 3\)"),
        (-np.eye(4), "damping: expected a matrix that takes energy out"),
        ({"right": 0.1}, r"damping: expected the wings \['right', 'left'\], found \['right'\]"),
        ({"right": 0.1, "left": 0.1, "tail": 0.1}, "damping: expected the wings"),
        (np.nan, "damping: expected finite"),
        (ca.MX.sym("beta"), "damping: expected numbers, found the symbol beta"),
    ],
)
def test_wrong_damping_is_named(aircraft, damping, message):
    with pytest.raises(ValueError, match=message):
        cc.aircraft_model(aircraft, density=0, damping=damping, outputs=())


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"gravity": np.nan}, "gravity: expected finite numbers, found nan"),
        ({"lag": 3}, "lag: expected an IndicialLag, found 3"),
        ({"entry": 3}, "entry: expected a GustEntry, found 3"),
        ({"gust": lambda t: [1.0, 2.0]}, r"gust: expected shape \(1, 1\), found \(2, 1\)"),
        ({"gust": lambda t: np.nan}, "gust: expected finite numbers"),
        ({"density": ca.MX.sym("density")}, "density: expected numbers, found the symbol density"),
    ],
)
def test_wrong_air_and_gravity_are_named(flying, changes, message):
    with pytest.raises(ValueError, match=message):
        cc.aircraft_model(flying, **{"density": 1.0, "outputs": ("height",), **changes})


def test_a_gust_in_time_comes_without_being_told_the_time(flying):
    gust = cc.OneMinusCosine(amplitude=5.0, duration=0.05)
    model = cc.aircraft_model(flying, density=1.0, lag=None, gust=gust, outputs=("height",))
    start = {"twist": [0, 0, 0, 20.0, 0, 0]}
    times, options = [0.0, 0.02, 0.04], {"method": "implicit_midpoint", "dt": 0.01}
    found = cc.simulate(model, start, times, **options)
    told = cc.simulate(model, start, times, p={"time": lambda t: t}, **options)
    frozen = cc.simulate(model, start, times, p={"time": 0.0}, **options)
    assert_allclose(found.x, told.x, rtol=0, atol=0)
    assert abs(found.y[0, -1] - frozen.y[0, -1]) > 1e-4  # m, higher in the gust
