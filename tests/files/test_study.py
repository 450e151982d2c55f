"""Study files: every combination of cases, each as one wing alone meets its gust."""

from __future__ import annotations

import csv
import shutil

import numpy as np
import pytest
import scipy.optimize
from numpy.testing import assert_allclose, assert_array_equal

import curvcasadi as cc
from curvcasadi.cli import main
from curvcasadi.files.study import RESULT_COLUMNS

pytestmark = pytest.mark.skipif(shutil.which("g++") is None, reason="compiles C++")

WING = """\
[beam]
length = 16.0
root = { rotation = [[0, 1, 0], [1, 0, 0], [0, 0, -1]] }
[basis]
torsion = { family = "legendre", n = 1 }
out_of_plane = { family = "legendre", n = 2 }
[grid]
kind = "lobatto"
elements = 3
[section]
GJ = 1e4
EI_y = 2e4
EI_z = 4e6
mass_per_length = 0.75
inertia = [[0.1, 0, 0], [0, 0.0005, 0], [0, 0, 0.0995]]
[aerodynamics]
chord = 1.0
aerodynamic_center = 0.25
lift_slope = 6.283185307179586
"""
STUDY = """\
wing = "wing.toml"
[cases]
airspeeds = [20, 24]
gust_lengths = [8.0]
gust_amplitudes = [0.0, 1.5]
stiffness_factors = [1.0, 1.3]
[simulation]
density = 0.0889
duration = 0.6
step = 0.004
pitch = 0.05
damping = 0.005
modes = 2
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("study")
    (folder / "wing.toml").write_text(WING)
    (folder / "study.toml").write_text(STUDY)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(folder))
        yield folder


def test_every_combination_is_a_case(folder):
    cases = cc.load_study(folder / "study.toml").cases
    assert cases.shape == (8, 5)
    assert len({tuple(row) for row in cases}) == 8
    assert_array_equal(cases[:, 4], 1)


def test_a_case_is_the_motion_of_that_wing_alone(folder):
    study = cc.load_study(folder / "study.toml")
    case = np.array([24.0, 8.0, 1.5, 1.0, 1.0])
    (result,) = study([case])
    model = cc.wing_model(
        cc.Wing(name="wing", beam=study.wing.beam, strips=study.wing.strips),
        density=study.density,
        lag=cc.IndicialLag(poles=2, modes=2),
        damping=study.damping,
        gust=cc.GustEntry(modes=2),
        outputs=("tip_position",),
    )
    # Steady flight by another solver, without structured slopes.
    calm = {"airspeed": 24.0, "pitch": 0.05, "gust": 0.0}
    held = model.p.join(calm)
    start, _, found, _ = scipy.optimize.fsolve(
        lambda x: model.xdot(x, [], held).full().ravel(),
        np.zeros(model.x.size),
        xtol=1e-13,
        full_output=True,
    )
    assert found == 1
    gust = cc.OneMinusCosine(amplitude=1.5, duration=8 / 24)
    step, x, tips = cc.rk4_step(model, study.step), start, []
    for k in range(150):
        p = model.p.join({**calm, "gust": float(gust((k + 0.5) * study.step))})
        x = step(x, [], p)
        tips.append(-float(model.y.split(model.output(x, [], p))["tip_position"][2]))
    # Both solvers end within 1e-10 of the deflection.
    assert_allclose(result[0], max(tips), rtol=1e-9)


def test_the_command_writes_all_cases_and_goes_on_from_a_record(folder, capsys):
    out, record = folder / "cases.csv", folder / "study.sqlite"
    command = ["sweep", str(folder / "study.toml"), "--out", str(out), "--record", str(record)]
    assert main([*command, "--no-progress"]) == 0
    printed = capsys.readouterr().out
    assert "8 cases, 0 failed" in printed
    with out.open() as file:
        rows = list(csv.DictReader(file))
    table = np.array([[float(row[name]) for name in RESULT_COLUMNS] for row in rows])
    assert [row["error"] for row in rows] == [""] * 8
    amplitude = np.array([float(row["gust_amplitude"]) for row in rows])
    stiffness = np.array([float(row["stiffness_factor"]) for row in rows])
    calm, soft = amplitude == 0, stiffness == 1
    # Without a gust the wing stays where it is, and a stiffer one bends less.
    assert_allclose(table[calm, 0], table[calm, 1], atol=1e-6)
    assert np.all(table[~calm, 0] > table[calm, 0] + 0.01)
    assert np.all(table[soft, 0] > table[~soft, 0])
    out.unlink()
    assert main([*command, "--no-progress"]) == 0
    assert capsys.readouterr().out == printed


def test_steps_with_which_a_mode_grows_are_failed_cases_before_they_overflow(folder, capsys):
    path = folder / "coarse.toml"
    coarse = STUDY.replace("step = 0.004", "step = 0.2")
    path.write_text(coarse.replace("[1.0, 1.3]", "[1.0]"))
    assert main(["sweep", str(path), "--no-progress"]) == 3
    assert "ValueError: step: expected at most" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "airspeeds = [20, 24]",
            "airspeeds = [20, -1]",
            r"\[cases\] airspeeds: expected numbers ab",
        ),
        ("airspeeds = [20, 24]", "airspeeds = []", r"\[cases\] airspeeds: expected numbers above"),
        ("airspeeds", "speeds", r"\[cases\] speeds: .*unknown key, nearest to airspeeds"),
        ("step = 0.004", "step = 0", r"\[simulation\] step: expected a number above zero, found 0"),
        ("duration = 0.6", "duration = 1e9", r"duration: expected 1 to 1000000 steps of 0.004 s"),
        ("step = 0.004", "step = 5", r"duration: expected 1 to 1000000 steps of 5 s, found 0.6"),
        ("modes = 2", "poles = 7", r"\[simulation\] poles"),
        ('"wing.toml"', '"bare.toml"', r"wing: expected a wing file with \[section\] and \[aero"),
    ],
)
def test_bad_files_are_named(folder, old, new, message):
    (folder / "bare.toml").write_text(WING.partition("[aerodynamics]")[0])
    path = folder / "bad.toml"
    path.write_text(STUDY.replace(old, new))
    with pytest.raises(ValueError, match=message):
        cc.load_study(path)
