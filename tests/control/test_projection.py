"""The state of a coarser model of the same wing."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

import curvcasadi as cc
from tests.support.flying_aircraft import DENSITY, aircraft
from tests.support.strip_wings import hale

RNG = np.random.default_rng(3)
GUST = cc.GustEntry(modes=3)


def model(weights, lag, gust=None):
    return cc.wing_model(hale(weights, 4), density=0.0889, lag=lag, gust=gust, outputs=())


COARSE = model((2, 3, 0), cc.IndicialLag(poles=2, modes=3))
FINE = model((3, 4, 2), cc.IndicialLag(poles=2, modes=None))


def finer(x):
    """The state of FINE that is the same motion as the state `x` of COARSE."""
    parts = {key: np.asarray(value).ravel() for key, value in COARSE.x.split(x).items()}
    found = {key: np.r_[parts[key][:2], 0, parts[key][2:], 0, 0, 0] for key in ("q", "q_dot")}
    spans = COARSE.spans["lag"]
    stations = FINE.spans["lag"][0].points[0]
    values = [
        span.at(stations) @ lag for span, lag in zip(spans, parts["lag"].reshape(2, 3), strict=True)
    ]
    return {**found, "lag": np.concatenate(values)}


def test_what_the_coarser_model_can_represent_is_kept():
    x = RNG.normal(size=COARSE.x.size)
    assert_allclose(cc.project_state(FINE, finer(x), COARSE), x, atol=1e-12)
    assert_allclose(cc.project_state(COARSE, x, COARSE), x, atol=1e-12)


def test_the_rest_is_orthogonal_to_its_functions():
    x = RNG.normal(size=FINE.x.size)
    found = cc.project_state(FINE, x, COARSE)
    xi, measures = FINE.spans["q"][0].points
    differences = FINE.spans["q"][0].at(xi) @ x[:9] - COARSE.spans["q"][0].at(xi) @ found[:5]
    weighted = np.repeat(measures, 3) * differences
    assert np.abs(differences).max() > 0.1
    # Least squares leave a residual that no function of the model can lessen.
    assert_allclose(COARSE.spans["q"][0].at(xi).T @ weighted, 0, atol=1e-12)


def test_poles_that_the_plant_has_not_are_interpolated():
    plant = model((2, 3, 0), cc.IndicialLag(poles=4, modes=3))
    lag = np.repeat([1.0, 2.0, 3.0, 4.0], 3)  # of the poles in the order of ascending rates
    found = cc.project_state(plant, {"lag": lag}, COARSE)[10:].reshape(2, 3)
    rates = cc.IndicialLag(poles=4).rates
    expected = np.interp(np.log(cc.IndicialLag(poles=2).rates), np.log(rates), [1, 2, 3, 4])
    assert_allclose(found, np.tile(expected[:, None], 3), rtol=1e-12)


def test_a_model_with_states_that_the_plant_has_not_is_refused():
    with pytest.raises(ValueError, match="x: expected the state of 'wing', found None"):
        cc.project_state(COARSE, None, COARSE)
    entry = model((2, 3, 0), cc.IndicialLag(poles=2, modes=3), cc.GustEntry(kind="lag", modes=1))
    with pytest.raises(ValueError, match="plant: expected the entry into a gust in 'lag'"):
        cc.project_state(COARSE, np.zeros(COARSE.x.size), entry)
    wing = cc.kinematic_model(hale((2, 3, 0), 4).beam, time_constant=1.0)
    with pytest.raises(ValueError, match="model: expected parts of the plant's state, q, found"):
        cc.project_state(wing, np.zeros(5), COARSE)


def test_states_of_surfaces_follow_poles_as_those_of_wings():
    lags = {poles: cc.IndicialLag(poles=poles, modes=3) for poles in (2, 4)}
    models = {
        poles: cc.aircraft_model(
            aircraft((1, 1, 1)), density=DENSITY, lag=lag, gust=GUST, outputs=()
        )
        for poles, lag in lags.items()
    }
    # On the tail one state for a pole, then those of the entry into a gust.
    entry = [5.0, 6.0]
    x = {"lag_tail": [1.0, 2.0, 3.0, 4.0, *entry], "position": [1.0, 2.0, 3.0]}
    found = models[2].x.split(cc.project_state(models[4], x, models[2]))
    rates = [np.log(lags[poles].rates) for poles in (2, 4)]
    expected = np.interp(*rates, [1.0, 2.0, 3.0, 4.0])
    assert_allclose(found["lag_tail"].full().ravel(), [*expected, *entry], rtol=1e-12)
    assert_allclose(found["position"].full().ravel(), [1, 2, 3])
    again = cc.project_state(models[4], x, models[4])
    assert_allclose(again[models[4].x.slices["lag_tail"]], x["lag_tail"], rtol=1e-12)
