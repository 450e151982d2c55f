"""Gusts: their shapes, spectra and refusals."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import quad

import curvcasadi as cc


def test_discrete_gusts_have_their_shape(kind):
    bell = cc.OneMinusCosine(amplitude=3.0, duration=2.0, start=1.0)
    step = cc.StepGust(amplitude=-1.5, start=1.0)
    times = [0.0, 0.999, 1.0, 1.5, 2.0, 2.5, 3.0, 3.001, 9.0]
    if kind is ca.DM:
        found = np.array([[float(gust(t)) for t in times] for gust in (bell, step)])
    else:
        t = kind.sym("t")
        f = ca.Function("f", [t], [bell(t), step(t)])
        found = np.array([[float(x) for x in f(t)] for t in times]).T
    assert_allclose(found[0], [0, 0, 0, 1.5, 3, 1.5, 0, 0, 0], atol=1e-14)
    assert_allclose(found[1], [0, 0, *[-1.5] * 7], atol=0)


def test_bell_has_a_derivative_everywhere(symbolic):
    t = symbolic.sym("t")
    gust = cc.OneMinusCosine(amplitude=3.0, duration=2.0)(t)
    slope = ca.Function("slope", [t], [ca.jacobian(gust, t)])
    for time in (-1.0, 0.0, 2.0, 3.0):
        assert_allclose(slope(time), 0, atol=1e-14)
    assert_allclose(slope(0.5), 3 / 2 * np.pi, rtol=1e-14)


def test_frozen_gust_is_met_where_it_stands():
    profile = cc.OneMinusCosine(amplitude=2.0, duration=1.5, start=1.0)
    field = cc.frozen_gust(profile, speed=20.0)
    position = ca.DM([35.0, 4.0, -100.0])
    # Down is positive in inertial axes, and the gust blows up.
    assert_allclose(field(position, 7.0).full().ravel(), [0, 0, -float(profile(35 / 20))])


@pytest.mark.parametrize("model", ["dryden", "von_karman"])
@pytest.mark.parametrize("component", ["vertical", "lateral", "longitudinal"])
def test_spectrum_integrates_to_the_square_of_the_intensity(model, component):
    air = cc.Turbulence(intensity=1.7, scale=150.0, speed=30.0, model=model, component=component)
    # The tail of von Kármán's spectra falls with the power 5/3: integrated over log ω to its end.
    whole, _ = quad(lambda x: np.exp(x) * air.spectrum(np.exp(x)), -25, 25, limit=200)
    assert_allclose(whole, 1.7**2, rtol=1e-3)  # von Kármán's 1.339 has four digits


@pytest.mark.parametrize("model", ["dryden", "von_karman"])
def test_samples_have_the_spectrum(model):
    air = cc.Turbulence(intensity=1.7, scale=50.0, speed=25.0, model=model)
    duration, dt = 400.0, 0.05
    found = air.sample(duration=duration, dt=dt, seed=4)
    assert len(found.velocities) == 8000
    band, _ = quad(lambda w: air.spectrum(w), np.pi / duration, np.pi / dt, limit=500)
    # A sum over harmonics instead of the integral.
    assert_allclose(np.mean(found.velocities**2), band, rtol=2e-3)
    again = air.sample(duration=duration, dt=dt, seed=4)
    assert np.array_equal(found.velocities, again.velocities)
    other = air.sample(duration=duration, dt=dt, seed=5).velocities
    assert np.corrcoef(found.velocities, other)[0, 1] < 0.3


def test_sampled_gust_is_linear_between_samples_and_periodic():
    gust = cc.SampledGust(times=[0.0, 0.5, 1.0], velocities=[1.0, 3.0, -1.0])
    assert_allclose([gust(t) for t in (0.0, 0.25, 1.25, 1.5, -0.25)], [1, 2, 0, 1, 0], atol=1e-12)
    t = ca.MX.sym("t")
    f = ca.Function("f", [t], [gust(t)])
    assert_allclose(
        [float(f(t)) for t in (0.0, 0.25, 1.25, 1.5, -0.25)], [1, 2, 0, 1, 0], atol=1e-12
    )


def test_kussners_function_starts_at_zero_and_ends_at_one():
    assert_allclose(cc.kussner([0.0, 1e4]), [0, 1], atol=1e-15)
    # κussner's mean lag of two poles: ½/0.13 + ½.
    s = np.linspace(0, 200, 200001)
    assert_allclose(np.trapezoid(1 - cc.kussner(s), s), 0.5 / 0.13 + 0.5, rtol=1e-6)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: cc.OneMinusCosine(amplitude=1, duration=-2), "OneMinusCosine.duration"),
        (lambda: cc.OneMinusCosine(amplitude=[1, 2], duration=2), "OneMinusCosine.amplitude"),
        (lambda: cc.GustField(3.0), "GustField.function"),
        (lambda: cc.GustField(lambda p, t: ca.DM([1, 2]))(ca.DM.zeros(3), 0.0), "GustField"),
        (lambda: cc.GustEntry(kind="wagner"), "GustEntry.kind"),
        (lambda: cc.GustEntry(modes=0), "GustEntry.modes"),
        (lambda: cc.Turbulence(intensity=1, scale=-1, speed=20), "Turbulence.scale"),
        (
            lambda: cc.Turbulence(intensity=1, scale=1, speed=20).sample(
                duration=1, dt=0.3, seed=0
            ),
            "duration",
        ),
        (lambda: cc.SampledGust(times=[0, 1, 3], velocities=[0, 0, 0]), "equal intervals"),
        (lambda: cc.frozen_gust(cc.StepGust(amplitude=1), speed=0.0), "speed"),
        (lambda: cc.IndicialLag(poles=5), "IndicialLag.poles"),
        (lambda: cc.IndicialLag(modes=0), "IndicialLag.modes"),
    ],
)
def test_bad_input_is_named(make, message):
    with pytest.raises(ValueError, match=message):
        make()
