"""Parameters that are not given: nominal where the model says so, asked for by name elsewhere."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose

import curvcasadi as cc
from curvcasadi.control.signals import with_nominal
from tests.support.strip_wings import hale

LAYOUT = cc.Layout(
    (
        cc.Part("airspeed", 1, "m/s"),
        cc.Part("wind", 3, "m/s", nominal=0.0),
        cc.Part("density", 1, "kg/m3", nominal=1.2),
        cc.Part("pitch", 1, "rad"),
    )
)
SPEEDS = [15.0, 20.0]


@pytest.fixture(scope="module")
def wing():
    """With a flap and a design parameter, in air that may hold a gust."""
    plain, stiffness = hale((2, 2, 0), 3), ca.MX.sym("GJ")
    flap = cc.ControlSurface(name="flap", lift=3.5, start=0.6)
    beam = replace(plain.beam, section=replace(plain.beam.section, GJ=stiffness))
    strips = replace(plain.strips, controls=(flap,))
    return replace(plain, beam=beam, strips=strips), stiffness


@pytest.fixture(scope="module")
def model(wing):
    lag = cc.IndicialLag(poles=2, modes=1)
    return cc.wing_model(
        wing[0],
        density=0.0889,
        lag=lag,
        gust=cc.GustEntry(kind="lag", modes=1),
        parameters={"GJ": wing[1]},
        outputs=("tip_position",),
    )


def test_what_is_not_given_is_nominal():
    found = with_nominal("p", LAYOUT, {"pitch": 0.1, "airspeed": 20.0, "wind": [1.0, 2.0, 3.0]})
    assert {key: np.ravel(value).tolist() for key, value in found.items()} == {
        "airspeed": [20.0],
        "wind": [1.0, 2.0, 3.0],
        "density": [1.2],
        "pitch": [0.1],
    }
    found = with_nominal("p", LAYOUT, {"pitch": 0.1}, ["airspeed"])
    assert found.keys() == {"wind", "density", "pitch"}
    assert found["wind"].tolist() == [0.0, 0.0, 0.0]
    column = np.arange(6.0)
    assert with_nominal("p", LAYOUT, column) is column


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (None, r"p: expected airspeed \(m/s\), pitch \(rad\), which .* p=\{'airspeed': …, 'pitch'"),
        ({"pitch": 0.0}, r"p: expected airspeed \(m/s\), which the model has no nominal value of"),
        ({"airspeed": None, "pitch": 0.0}, r"p: expected airspeed \(m/s\), which"),
        ({"air_speed": 20.0}, r"p: expected parts among .*, found 'air_speed'"),
    ],
    ids=str,
)
def test_what_has_no_nominal_value_is_asked_for(given, message):
    with pytest.raises(ValueError, match=message):
        with_nominal("p", LAYOUT, given)


def test_a_motion_and_a_linear_model_take_nominal_values(model):
    given = {"airspeed": 15.0, "pitch": 0.02, "GJ": 1e4}
    every = cc.linearize(model, {}, p={**given, "gust": 0.0})
    assert_allclose(cc.linearize(model, {}, p=given).A, every.A, rtol=0)
    motions = [
        cc.simulate(model, {}, [0.0, 0.01], p=p, method="implicit_midpoint")
        for p in (given, {**given, "gust": lambda t: 0.0})
    ]
    assert_allclose(motions[0].x, motions[1].x, rtol=0)
    assert np.abs(motions[0].x).max() > 0


def _mpc(model):
    return cc.Mpc(model, dt=0.05, horizon=2, outputs={"tip_position": 1.0}, inputs={"flap": 1.0})


@pytest.mark.parametrize(
    ("call", "names"),
    [
        (lambda m, path: cc.linearize(m, {}), "airspeed, pitch, GJ"),
        (lambda m, path: cc.simulate(m, {}, [0.0, 0.01]), "airspeed, pitch, GJ"),
        (lambda m, path: cc.simulate(m, {}, [0, 0.01], p={"gust": np.sin}), "airspeed, pitch, GJ"),
        (lambda m, path: cc.simulate(m, {}, [0.0, 0.01], p={"airspeed": 9.0}), "pitch, GJ"),
        (lambda m, path: cc.flutter(m, SPEEDS), "pitch, GJ"),
        (lambda m, path: cc.flutter(m, SPEEDS, p={"GJ": 1e4}), "pitch"),
        (lambda m, path: cc.flutter_speed_function(m, ["GJ"], SPEEDS), "pitch"),
        (lambda m, path: cc.flutter_speed_function(m, [], SPEEDS), "pitch, GJ"),
        (lambda m, path: cc.export_fmu(m, path / "wing.fmu", dt=0.01), "airspeed, pitch, GJ"),
        (lambda m, path: _mpc(m).step({}), "airspeed, pitch, GJ"),
        (lambda m, path: _mpc(m).step({}, preview={"pitch": 0.0}), "airspeed, GJ"),
        (
            lambda m, path: cc.attitude_feedback(m, hale((2, 2, 0), 3).beam, {}, time_constant=1.0),
            "airspeed, pitch, GJ",
        ),
    ],
)  # fmt: skip
def test_every_call_names_what_it_needs(model, tmp_path, call, names):
    listed = ", ".join(rf"{name} \([^)]*\)" for name in names.split(", "))
    with pytest.raises(ValueError, match=f"^p: expected {listed}, which the model has no nominal"):
        call(model, tmp_path)


@pytest.fixture(scope="module", params=[cc.shape_ekf, cc.shape_mhe], ids=["filter", "window"])
def estimator(request):
    plain = hale((2, 2, 0), 3)
    lag = cc.IndicialLag(poles=2, modes=1)
    model = cc.wing_model(plain, density=0.0889, lag=lag, outputs=(), gust=cc.GustEntry(modes=1))
    process = cc.ModelProcess(
        model=model,
        density={"q_dot": 0.1, "airspeed": 0.1, "gust": 1.0},
        estimated={"airspeed": None, "gust": 2.0},
        method="implicit_midpoint",
    )
    more = {"dt": 0.02, "window": 2} if request.param is cc.shape_mhe else {}
    return request.param(
        plain.beam, [cc.RateGyro(xi=1.0, noise_density=1e-3, rate=50.0)], process=process, **more
    )


def test_an_estimated_parameter_starts_from_what_is_given(estimator):
    deviation = {part.name: 0.1 for part in estimator.error_layout.parts}
    with pytest.raises(ValueError, match=r"^mean: expected airspeed \(m/s\), which the model has"):
        estimator.initial(deviation)
    start = estimator.initial(deviation, {"airspeed": 15.0})
    where = estimator.layout.slices
    assert start.state[where["airspeed"]] == 15.0 and start.state[where["gust"]] == 0.0


def test_inputs_that_are_not_given_are_zero(model):
    given = {"airspeed": 15.0, "pitch": 0.02, "GJ": 1e4}
    assert cc.linearize(model, {}, p=given).u.tolist() == [0.0]
