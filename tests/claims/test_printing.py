"""What `print` shows of descriptions and results: names, units and symbols, on one screen."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

import curvcasadi as cc
from curvcasadi.files import load_aircraft
from curvcasadi.reference_wings import hale_wing
from curvcasadi.symbolic.text import WIDTH, grouped, shown

AIRCRAFT = Path(__file__).parents[2] / "ocp_examples" / "hale_aircraft.toml"
SCREEN = 24  #: lines
WING = hale_wing()
SECTION = cc.Section(
    GJ=cc.Steps([0, 0.5, 1], [1e4, 2e3]),
    EI_y=ca.SX.sym("EI_y"),
    EI_z=lambda xi: 3e5 * (1 - xi / 2),
    mass_per_length=0.75,
)
SOFT = replace(WING, length=ca.SX.sym("span"), section=SECTION)
MANY = cc.ChannelBasis(**dict.fromkeys(("torsion", "out_of_plane", "in_plane"), cc.Legendre(20)))
#: Out-of-plane bending alone: every solve takes milliseconds.
ROD = cc.Beam(
    length=2.0,
    basis=cc.ChannelBasis(out_of_plane=cc.Legendre(2)),
    grid=cc.Grid.uniform(4),
    section=cc.Section(GJ=1.0, EI_y=1.0, EI_z=1.0),
    weight_bounds=0.6,
)
GAUGES = [cc.StrainGauge(xi=xi, offset=(0.0, 0.01), noise=1e-5) for xi in (0.1, 0.5, 0.9)]


def lagging(beam):
    return cc.kinematic_model(beam, time_constant=0.2)


def motion():
    return cc.simulate(lagging(ROD), None, [0.0, 0.1, 0.2])


def mpc_step():
    mpc = cc.Mpc(lagging(ROD), dt=0.1, horizon=3, outputs={"position": 1.0}, compiled=False)
    return mpc.step([0.1, 0.0], reference={"position": [1.9, 0.0, 0.5]})


def vibrations(torsion):
    section = cc.Section(
        GJ=1.0, EI_y=1.0, EI_z=1.0, mass_per_length=1.0, inertia=np.diag([0.1, 0.05, 0.05])
    )
    basis = cc.ChannelBasis(torsion=cc.Legendre(torsion), out_of_plane=cc.Legendre(4))
    return cc.vibration_modes(replace(ROD, section=section, basis=basis, weight_bounds=None))


def mhe_estimate():
    mhe = cc.shape_mhe(ROD, GAUGES, dt=0.1, window=1, process="random_walk", density=0.1)
    readings = cc.measure(GAUGES, ROD, [0.1, 0.0]).values
    return next(cc.run_mhe(mhe, mhe.initial({"q": 0.1}), [readings]))


def ekf_estimate():
    ekf = cc.shape_ekf(ROD, GAUGES, process="random_walk", density=0.1)
    readings = cc.measure(GAUGES, ROD, [0.1, 0.0]).values
    return next(cc.run_ekf(ekf, ekf.initial({"q": 0.1}), [(0.0, readings)]))


RESULTS = {
    "reached": lambda: cc.reach_shape(ROD, [cc.Target(xi=1, position=[1.9, 0, 0.5], weight=1.0)]),
    "missed": lambda: cc.reach_shape(
        ROD,
        [cc.Target(xi=1, position=[9.0, 0, 0])],
        solver_options={"ipopt.max_iter": 10},
        throw=False,
    ),
    "equilibrium": lambda: cc.solve_equilibrium(ROD, [cc.PointForce(xi=1, force=[0, 0, 0.1])]),
    "fit": lambda: cc.fit_shape(ROD, GAUGES, cc.measure(GAUGES, ROD, [0.1, 0.0]).values),
    "placement": lambda: cc.place_sensors(ROD, GAUGES, 1, shapes=[0.1, 0.0], prior=0.1),
    "window": mhe_estimate,
    "motion": motion,
    "predictive control": mpc_step,
}
DESCRIPTIONS = {
    "beam": lambda: WING,
    "symbolic beam": lambda: SOFT,
    "beam of 60 weights": lambda: replace(WING, basis=MANY, weight_bounds=np.arange(1.0, 61.0)),
    "basis": lambda: WING.basis,
    "mirrored basis": lambda: cc.mirror(WING).basis,
    "coupled basis": lambda: cc.VectorBasis(lambda xi: np.ones((3, 40)), 40),
    "grid": lambda: WING.grid,
    "custom grid": lambda: cc.Grid(boundaries=np.linspace(0, 1, 301)),
    "section": lambda: SECTION,
    "shape": lambda: cc.shape_map(WING, np.zeros(9)),
    "symbolic shape": lambda: cc.shape_map(WING, ca.SX.sym("q", 9)),
    "pose": lambda: WING.root,
    "aircraft": lambda: load_aircraft(AIRCRAFT),
    "filter's estimate": ekf_estimate,
    "vibrations": lambda: vibrations(2),
    "linear model": lambda: cc.linearize(lagging(ROD), [0.1, 0.0]),
}


@cache
def result(name):
    return RESULTS[name]()


@pytest.mark.parametrize("name", [*DESCRIPTIONS, *RESULTS])
def test_what_is_printed_fits_on_a_screen(name):
    thing = DESCRIPTIONS[name]() if name in DESCRIPTIONS else result(name)
    lines = str(thing).splitlines()
    assert len(lines) <= SCREEN
    assert max(map(len, lines)) <= 2 * WIDTH  # messages of a fit are sentences
    assert "casadi" not in str(thing) and "0x" not in str(thing)


@pytest.mark.parametrize("name", RESULTS)
def test_results_say_whether_and_what(name):
    found = result(name)
    assert isinstance(found.success, bool)
    assert found.message and isinstance(found.message, str)
    first = found.message.splitlines()[0]
    assert first in " ".join(str(found).split())
    assert len(repr(found).splitlines()) == 1


def test_success_is_what_was_asked_for():
    assert result("equilibrium").success and result("window").success
    missed = result("missed")
    assert not missed.success and "out of reach" in missed.message


def test_a_failed_equilibrium_carries_the_last_one_and_says_why():
    with pytest.raises(cc.ConvergenceError) as failure:
        cc.solve_equilibrium(ROD, [cc.PointForce(xi=1, force=[0, 0, 10.0])])
    last = failure.value.result
    assert not last.success and 0 < last.load_factor < 1
    assert last.message == str(failure.value)


def test_a_beam_tells_names_units_and_symbols():
    text = str(SOFT)
    assert "span m" in text and "EI_y EI_y N m²" in text
    assert "GJ 10000 N m² at the root, 2000 N m² at the tip" in " ".join(text.split())
    assert "out_of_plane: Legendre 0 to 3" in text and "from -0.15 to 0.15 rad/m" in text
    assert repr(SOFT) == "<Beam: span m, 9 weights, 16 elements>"


def test_values_are_shown_on_a_line():
    assert shown(None, "m") == "none"
    assert shown(0.1 + 0.2, "m") == "0.3 m"
    assert shown([0.0, -0.0, 2.5], "N") == "[0, 0, 2.5] N"
    assert shown(ca.MX.sym("x"), "m") == "x m"
    assert shown(ca.sin(ca.SX.sym("x", 3, 3)), "m") == "3x3 symbolic expression m"
    assert "\n" not in shown(np.arange(100.0))


def test_labels_that_differ_by_a_number_stand_together():
    assert grouped(["a: 0", "a: 1", "a: 2", "b", "c 7"]) == "a: 0 to 2, b, c 7"
