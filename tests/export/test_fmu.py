"""Functional mock-up units against `simulate`; FMPy checks and runs them."""

import zipfile
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_allclose

import curvcasadi as cc
from curvcasadi.symbolic.compiled import compile_c
from tests.support import models
from tests.support.strip_wings import hale

fmpy = pytest.importorskip("fmpy", reason="fmpy, of the extra test")
validation = pytest.importorskip("fmpy.validation")

TIMES = np.linspace(0, 0.5, 11)
START = {"configuration": [1.0, 0.02], "rates": [-0.5, 0.1], "lag": [0.3]}


@pytest.fixture(scope="module")
def pendulum(tmp_path_factory):
    """A stiff model with an input, a parameter and a lag state, without outputs, and its FMU."""
    model = models.pendulum(stiffness=100.0, damping=0.2)
    path = tmp_path_factory.mktemp("fmu") / "pendulum.fmu"
    options = {"method": "implicit_midpoint", "dt": 0.005}
    cc.export_fmu(model, path, x0=START, u=[0.4], p=[9.81], **options)
    return SimpleNamespace(model=model, path=path, options=options)


@pytest.fixture(scope="module")
def wing(tmp_path_factory):
    """A wing in a stream with a flap, whose gust is an input of the FMU."""
    base = hale((1, 2, 0), 3)
    flap = cc.ControlSurface(name="flap", lift=3.5, moment=-0.6, start=0.6, end=0.95)
    described = replace(base, strips=replace(base.strips, controls=(flap,)))
    model = cc.wing_model(
        described,
        density=0.0889,
        lag=cc.IndicialLag(poles=2, modes=1),
        gust=cc.GustEntry(kind="kussner", modes=1),
    )
    path = tmp_path_factory.mktemp("fmu") / "wing.fmu"
    at = {"airspeed": [22.0], "pitch": [0.05]}
    cc.export_fmu(model, path, dt=0.005, p=at, inputs=["gust"])
    return SimpleNamespace(model=model, path=path, at=at)


def test_fmus_are_valid(pendulum, wing):
    for unit in (pendulum, wing):
        assert validation.validate_fmu(str(unit.path)) == []


def test_co_simulation_is_simulate(pendulum):
    names = ["x.configuration[0]", "x.configuration[1]", "x.lag"]
    run = fmpy.simulate_fmu(
        str(pendulum.path), fmi_type="CoSimulation", stop_time=0.5, output_interval=0.05,
        output=names,
    )  # fmt: skip
    expected = cc.simulate(pendulum.model, START, TIMES, u=[0.4], p=[9.81], **pendulum.options)
    assert_allclose(run["time"], TIMES, atol=1e-12)
    # The same steps, compiled twice.
    assert_allclose(run[names[0]], expected.x[0], atol=1e-12)
    assert_allclose(run[names[1]], expected.x[1], atol=1e-12)
    assert_allclose(run[names[2]], expected.part("lag")[0], atol=1e-12)


def test_model_exchange_is_simulate(pendulum):
    run = fmpy.simulate_fmu(
        str(pendulum.path), fmi_type="ModelExchange", stop_time=0.5, output_interval=0.05,
        output=["x.configuration[0]", "x.rates[1]"], relative_tolerance=1e-9,
    )  # fmt: skip
    expected = cc.simulate(
        pendulum.model, START, TIMES, u=[0.4], p=[9.81], method="cvodes", tolerance=1e-10
    )
    # Two multistep integrators of tolerance 1e-9 and 1e-10 over tens of steps.
    assert_allclose(run["x.configuration[0]"], expected.x[0], atol=1e-6)
    assert_allclose(run["x.rates[1]"], expected.part("rates")[1], atol=1e-6)


def test_inputs_over_time_are_held(wing):
    # A flap and a gust that change at every communication step, as `simulate` holds columns.
    flap, gust = 0.1 * np.sin(9 * TIMES), 1 - np.cos(12 * TIMES)
    signals = np.array(
        list(zip(TIMES, flap, gust, strict=True)),
        dtype=[("time", float), ("u.flap", float), ("p.gust", float)],
    )
    outputs = [f"x.q[{k}]" for k in range(3)]
    run = fmpy.simulate_fmu(
        str(wing.path), fmi_type="CoSimulation", stop_time=0.5, output_interval=0.05,
        input=signals, output=outputs,
    )  # fmt: skip
    expected = cc.simulate(
        wing.model, None, TIMES, u=flap[None], p={**wing.at, "gust": gust[None]}, dt=0.005
    )
    bend = np.array([run[name] for name in outputs])
    assert np.abs(bend).max() > 1e-3  # it moves
    assert_allclose(bend, expected.part("q"), atol=1e-12)


def test_a_state_is_kept_and_an_impossible_step_discarded(pendulum, tmp_path):
    from fmpy.fmi3 import FMU3Slave

    folder = fmpy.extract(str(pendulum.path), str(tmp_path / "unit"))
    description = fmpy.read_model_description(str(pendulum.path))
    by_name = {v.name: v.valueReference for v in description.modelVariables}
    unit = FMU3Slave(
        guid=description.guid,
        unzipDirectory=folder,
        modelIdentifier=description.coSimulation.modelIdentifier,
        instanceName="test",
    )
    unit.instantiate()
    unit.enterInitializationMode()
    unit.exitInitializationMode()
    states = [by_name[f"x.configuration[{k}]"] for k in range(2)]
    kept = unit.getFMUState()
    assert_allclose(unit.getFloat64(states), START["configuration"])
    unit.doStep(0.0, 0.05)
    moved = unit.getFloat64(states)
    assert not np.allclose(moved, START["configuration"], atol=1e-3)
    unit.setFMUState(kept)
    assert_allclose(unit.getFloat64(states), START["configuration"], rtol=0)
    unit.doStep(0.0, 0.05)
    assert_allclose(unit.getFloat64(states), moved, rtol=0)
    with pytest.raises(Exception, match="SetFloat64"):
        unit.setFloat64([by_name["der(x.lag)"]], [1.0])
    with pytest.raises(Exception, match="SetFloat64"):
        unit.setFloat64(states[:1], [np.nan])
    unit.setFloat64([by_name["x.rates[0]"]], [1e200])
    with pytest.raises(Exception, match="DoStep"):
        unit.doStep(0.05, 0.05)
    assert unit.getFloat64([by_name["x.rates[0]"]]) == [1e200]
    unit.freeFMUState(kept)
    unit.terminate()
    unit.freeInstance()


def test_sources_are_strict_c_and_the_same_every_time(wing, tmp_path):
    again = tmp_path / "again.fmu"
    cc.export_fmu(wing.model, again, dt=0.005, p=wing.at, inputs=["gust"], compiler=None)
    with zipfile.ZipFile(wing.path) as first, zipfile.ZipFile(again) as second:
        names = set(second.namelist())
        assert {n for n in first.namelist() if not n.startswith("binaries/")} == names
        for name in names:
            assert first.read(name) == second.read(name)
        second.extractall(tmp_path)
    strict = ["-std=c99", "-pedantic", "-Wall", "-Wextra", "-Wshadow", "-Wconversion", "-Werror"]
    source = f"{wing.model.name}_fmu.c"
    compile_c([source], "fmu.o", ["-c", *strict], folder=tmp_path / "sources")


def test_variables_are_named_by_the_layouts(wing):
    description = fmpy.read_model_description(str(wing.path))
    by_name = {v.name: v for v in description.modelVariables}
    assert by_name["u.flap"].causality == by_name["p.gust"].causality == "input"
    assert by_name["p.airspeed"].causality == "parameter"
    assert float(by_name["p.airspeed"].start) == 22.0
    assert by_name["x.q[0]"].unit == "rad/m"
    assert by_name["der(x.q[1])"].derivative is by_name["x.q[1]"]
    assert len(description.derivatives) == wing.model.x.size
    assert len(description.outputs) == wing.model.y.size


def test_wrong_arguments_are_refused(pendulum, tmp_path):
    model, path = pendulum.model, tmp_path / "model.fmu"
    for changed, message in (
        ({"dt": 0.0}, "dt: expected"),
        ({"method": "euler"}, "method: expected"),
        ({"inputs": ["gust"]}, r"inputs: expected parts of p among \['gravity'\]"),
        ({"x0": {"lag": [1, 2]}}, "x0"),
        ({"inputs": "gust"}, r"inputs: expected a sequence of names, found 'gust'"),
        ({"compiler": "no-such-compiler"}, None),
    ):
        with pytest.raises((ValueError, FileNotFoundError), match=message):
            cc.export_fmu(model, path, **{"dt": 0.01, **changed})
    with pytest.raises(FileNotFoundError, match=r"path: .* found no folder .*no"):
        cc.export_fmu(model, tmp_path / "no" / "model.fmu", dt=0.01)
    with pytest.raises(ValueError, match=r"path: expected a file that ends with .fmu"):
        cc.export_fmu(model, tmp_path / "model.zip", dt=0.01)
