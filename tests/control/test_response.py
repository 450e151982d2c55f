"""Frequency responses and turbulence: against motions, and spectra against covariances."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

import curvcasadi as cc
from tests.support.strip_wings import hale

SPEED, PITCH = 20.0, 0.03


@pytest.fixture(scope="module")
def model():
    return cc.wing_model(
        hale((2, 2, 1), 3),
        density=0.0889,
        lag=cc.IndicialLag(poles=2, modes=2),
        gust=cc.GustEntry(kind="kussner", modes=2),
        damping=0.002,
        outputs=("tip_position", "root_moment"),
    )


@pytest.fixture(scope="module")
def linear(model):
    rest = cc.flutter(model, [15.0, SPEED], p={"pitch": PITCH}).equilibria[-1]
    return cc.linearize(model, rest, p={"airspeed": SPEED, "pitch": PITCH})


def turbulence(**changes):
    return cc.Turbulence(**{"intensity": 0.5, "scale": 150.0, "speed": SPEED, **changes})


def test_a_motion_in_a_sinusoidal_gust_has_the_amplitude_of_the_response(model, linear):
    amplitude, omega, dt = 1e-3, 5.0, 2 * np.pi / 5.0 / 80
    times = dt * np.arange(80 * 15 + 1)
    motion = cc.simulate(
        model,
        linear.x,
        times,
        p={"airspeed": SPEED, "pitch": PITCH, "gust": lambda t: amplitude * np.cos(omega * t)},
        method="implicit_midpoint",
    )
    last = slice(-81, -1)  # one period, after the slowest root, −0.45 1/s, has let go
    waves = np.exp(-1j * omega * times[last])
    found = 2 * (motion.part("root_moment")[:, last] * waves).mean(axis=1) / amplitude
    # The midpoint rule moves at 2/dt tan(ω dt/2), and its gust is the mean over a step.
    moved = 2 / dt * np.tan(omega * dt / 2)
    expected = cc.frequency_response(linear, [moved], "gust", "root_moment")[:, 0, 0]
    expected = expected / np.cos(omega * dt / 2)
    assert_allclose(found, expected, atol=2e-3 * np.abs(expected).max())


def test_responses_to_what_is_held_are_changes_of_the_equilibrium(model, linear):
    change = 1e-4
    rests = [
        cc.flutter(model, [15.0, SPEED], p={"pitch": PITCH + sign * change}).equilibria[-1]
        for sign in (1, -1)
    ]
    moments = [
        model.output(x, [], [SPEED, PITCH + sign * change, 0]).full()[3:].ravel()
        for x, sign in zip(rests, (1, -1), strict=True)
    ]
    expected = (moments[0] - moments[1]) / (2 * change)
    held = cc.frequency_response(linear, [0.0], "pitch", "root_moment")[:, 0, 0]
    assert_allclose(held, expected, atol=1e-5 * np.abs(expected).max())


@pytest.mark.parametrize("component", ["vertical", "longitudinal"])
def test_the_spectrum_has_the_mean_square_of_the_covariance(component, linear):
    # Lyapunov's equation against quadrature over the frequencies.
    air = turbulence(component=component)
    omega = np.logspace(-6, 4, 5001)
    spectrum = cc.power_spectrum(linear, air, omega, "root_moment")
    square = np.trapezoid(spectrum * omega, np.log(omega), axis=1)
    assert_allclose(cc.rms_in_turbulence(linear, air, "root_moment"), np.sqrt(square), rtol=1e-4)


def test_turbulence_of_von_karman_is_integrated(linear):
    air = turbulence(model="von_karman")
    omega = np.logspace(-6, 4, 5001)
    spectrum = cc.power_spectrum(linear, air, omega, "tip_position")
    square = np.trapezoid(spectrum * omega, np.log(omega), axis=1)
    assert_allclose(cc.rms_in_turbulence(linear, air, "tip_position"), np.sqrt(square), rtol=1e-4)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda lin: cc.frequency_response(lin, [-1.0]), "omega: expected frequencies"),
        (lambda lin: cc.frequency_response(lin, [1.0], "wind"), "source: expected one of"),
        (lambda lin: cc.frequency_response(lin, [1.0], output="moment"), "output: expected one"),
        (lambda lin: cc.rms_in_turbulence(lin, turbulence(speed=25.0)), "Turbulence.speed"),
    ],
)
def test_bad_input_is_named(call, message, linear):
    with pytest.raises(ValueError, match=message):
        call(linear)


def test_turbulence_of_an_unstable_wing_is_refused(model):
    unstable = cc.linearize(model, np.zeros(model.x.size), p={"airspeed": 45.0, "pitch": 0.0})
    with pytest.raises(ValueError, match="linear: expected a stable model"):
        cc.rms_in_turbulence(unstable, turbulence(speed=45.0))
