"""Flutter sweeps: modes that are followed, equilibria, and what is refused."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose

import curvcasadi as cc
from curvcasadi.cli.template import template
from tests.support.strip_wings import hale

SPEEDS = np.arange(20, 40, 2.0)


@pytest.fixture(scope="module")
def model():
    lag = cc.IndicialLag(poles=2, modes=2)
    return cc.wing_model(hale((3, 3, 2), 4), density=0.0889, lag=lag, outputs=("root_moment",))


@pytest.fixture(scope="module")
def sweep(model):
    return cc.flutter(model, SPEEDS, p={"pitch": 0.02})


def test_equilibria_are_at_rest_and_roots_are_those_of_the_linear_model(model, sweep):
    for speed, x, roots in zip(sweep.speeds, sweep.equilibria, sweep.roots, strict=True):
        p = [speed, 0.02]
        # Rates of 1e-9 of those of the straight wing, of whose forces the equilibrium is the zero.
        scale = np.abs(model.xdot(np.zeros(len(x)), [], p).full()).max()
        assert_allclose(model.xdot(x, [], p), 0, atol=1e-9 * scale)
        expected = cc.linearize(model, x, p=p).eigenvalues
        distance = np.abs(roots[:, None] - expected).min(axis=0)
        assert_allclose(distance / np.abs(expected), 0, atol=1e-7)


def test_at_the_flutter_speed_an_oscillation_keeps_its_size(model, sweep):
    linear = cc.linearize(model, sweep.equilibrium, p=[sweep.speed, 0.02])
    root = 1j * sweep.frequency
    # The root is on the axis to 1e-5 of its size, where growth begins to count.
    assert_allclose(
        linear.A @ sweep.mode, root * sweep.mode, atol=3e-5 * np.abs(linear.A @ sweep.mode).max()
    )
    assert np.abs(sweep.mode[:8]).max() == pytest.approx(1, rel=1e-12)
    assert sweep.success and sweep.linearizations <= 3 * len(SPEEDS)
    assert "flutter" in str(sweep) and "rad/s" in str(sweep)


def test_modes_are_followed_as_in_a_sweep_of_small_steps(model, sweep):
    fine = cc.flutter(model, np.linspace(20, 38, 91), p={"pitch": 0.02})
    assert_allclose(fine.roots[::10], sweep.roots, rtol=1e-6)
    assert_allclose(fine.speed, sweep.speed, rtol=1e-8)


@pytest.fixture(scope="module")
def straight():
    lag = cc.IndicialLag(poles=2, modes=None)
    return cc.wing_model(hale((2, 2, 0), 3), density=0.0889, gravity=0.0, lag=lag, outputs=())


def test_a_straight_wing_diverges_where_its_steady_tangent_is_singular(straight):
    found = cc.flutter(straight, np.arange(20, 45, 5.0), p={"pitch": 0.0})
    flow = cc.Flow(density=0.0889, velocity=[found.divergence_speed, 0, 0])
    air = cc.AerodynamicLoad(strips=hale((2, 2, 0), 3).strips, flow=flow)
    _, tangent = cc.equilibrium_tangent(hale((2, 2, 0), 3).beam, np.zeros(4), [air])
    values = np.linalg.eigvals(tangent.full())
    assert np.abs(values).min() < 1e-7 * np.abs(values).max()


def test_without_growth_there_is_no_speed(model):
    quiet = cc.flutter(model, [10.0, 12.0], p={"pitch": 0.0})
    assert quiet.speed is None and quiet.frequency is None and quiet.mode is None
    assert quiet.divergence_speed is None


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"speeds": [30.0, 31.0], "p": {"pitch": 0.02}}, "that grows at 30 m/s"),
        ({"speeds": [30.0, 20.0]}, "speeds: expected increasing"),
        ({"speeds": [0.0, 20.0]}, "speeds: expected airspeeds above zero"),
        ({"speeds": [20.0, 30.0], "p": {"airspeed": 20.0}}, "p: expected parameters other"),
        ({"speeds": [20.0, 30.0], "p": {"angle": 0.1}}, "p: expected parts among"),
        ({"speeds": [20.0, np.nan]}, "speeds"),
        ({"speeds": [20.0]}, "speeds: expected at least two airspeeds, found 1"),
        ({"speeds": [20.0, 30.0], "p": 0.1}, "p: expected a Mapping, found 0.1"),
        ({"speeds": [20.0, 30.0], "p": {"pitch": 4.0}}, "pitch.* 4 degrees are 0.06981 rad"),
    ],
)
def test_bad_input_is_named(model, arguments, message):
    with pytest.raises(ValueError, match=message):
        cc.flutter(model, **arguments)


def test_a_sweep_that_starts_beyond_divergence_is_named(straight):
    with pytest.raises(ValueError, match="found 45 m/s beyond divergence"):
        cc.flutter(straight, [45.0, 50.0], p={"pitch": 0.0})


def test_a_model_without_airspeed_is_refused():
    with pytest.raises(ValueError, match="parameter airspeed"):
        cc.flutter(cc.beam_model(hale((2, 2, 0), 3).beam), [20.0, 30.0])


def test_beyond_flutter_motions_settle_on_one_limit_cycle():
    # From a small push and from a large one: bending stiffens the wing against its own growth.
    model = cc.wing_model(
        hale((2, 3, 2), 4),
        density=0.0889,
        lag=cc.IndicialLag(poles=2, modes=2),
        damping=0.0005,
        outputs=("tip_position",),
    )
    pitch = {"pitch": np.radians(3.0)}
    found = cc.flutter(model, np.arange(15, 27, 2.0), p=pitch)
    speed = 1.03 * found.speed
    rest = cc.flutter(model, [15.0, 19.0, speed], p=pitch).equilibria[-1]
    times = np.arange(0, 60.01, 0.02)
    starts, ends = [], []
    for size in (0.002, 0.03):
        motion = cc.simulate(
            model,
            rest + size * found.mode.real,
            times,
            p={"airspeed": speed, **pitch},
            method="implicit_midpoint",
        )
        height = motion.part("tip_position")[2]
        starts.append(np.ptp(height[:200]) / 2)
        ends.append(np.ptp(height[-500:]) / 2)
    assert starts[0] < 0.5 * ends[0] and starts[1] > 1.5 * ends[1]
    # What is left of the approach after a minute.
    assert_allclose(ends[0], ends[1], rtol=0.01)


def test_modes_that_change_much_between_speeds_are_followed_by_way_of_speeds_between(tmp_path):
    # From 6 to 9 m/s the wing of the template, bent down by its weight, rises by metres: over that
    # step alone its second and third oscillations look like each other.
    text = template("wing").replace("elements = 12", "elements = 3").replace("n = 4 }", "n = 3 }")
    (tmp_path / "wing.toml").write_text(text, encoding="utf-8")
    file = cc.load_wing(tmp_path / "wing.toml")
    wing = cc.Wing(name="wing", beam=file.beam, strips=file.strips)
    model = cc.wing_model(wing, density=1.225, damping=0.002, outputs=())
    coarse = cc.flutter(model, [6.0, 9.0], p={"pitch": 0.0})
    fine = cc.flutter(model, np.linspace(6.0, 9.0, 7), p={"pitch": 0.0})
    assert_allclose(coarse.roots, fine.roots[[0, -1]], rtol=1e-6)


def test_equilibria_of_coarse_sweeps_are_on_the_path_of_fine_ones():
    # Weight bends this wing, swept forward, down; its lift turns it up near the speed at which it
    # would diverge if it were straight. There three equilibria are near each other.
    angle = 0.05
    turned = [[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]]
    wing = hale((2, 2, 1), 3)
    root = cc.Pose(rotation=wing.beam.root.rotation @ ca.DM(turned), position=[0, 0, 0])
    strips = replace(wing.strips, upper_side=1)
    model = cc.wing_model(
        replace(wing, beam=replace(wing.beam, root=root), strips=strips),
        density=0.0889,
        lag=cc.IndicialLag(poles=2, modes=2),
        outputs=(),
    )
    for pitch in (0.0125, 0.0135):
        p = {"pitch": pitch}
        fine = cc.flutter(model, np.arange(20, 40.1, 0.5), p=p)
        coarse = cc.flutter(model, np.arange(20, 40.1, 4.0), p=p)
        assert coarse.success and coarse.divergence_speed is None
        assert_allclose(coarse.equilibria, fine.equilibria[::8], atol=1e-7)
