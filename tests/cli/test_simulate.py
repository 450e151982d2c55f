"""`curvcasadi simulate`: motions that wing files describe, and what users get wrong."""

from __future__ import annotations

import re
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose

import curvcasadi as cc
from curvcasadi.cli.main import main

WING = """
[beam]
length = 4.0
weight_bounds = 0.5
[basis]
torsion = { family = "legendre", n = 1 }
out_of_plane = { family = "legendre", n = 2 }
[grid]
kind = "lobatto"
elements = 4
[section]
GJ = 200.0
EI_y = 300.0
EI_z = 1e5
mass_per_length = 0.5
inertia = [[0.01, 0, 0], [0, 1e-4, 0], [0, 0, 0.0099]]
[[loads]]
type = "gravity"
acceleration = [0, 0, -9.81]
"""
MOTION = """
[simulation]
duration = 0.25
interval = 0.1
"""
PUSH = """
[[simulation.loads]]
type = "point_force"
xi = 1.0
force = [0, 0, 10.0]
"""


@pytest.fixture
def run(tmp_path, monkeypatch, capsys):
    """Run the command on a file of these tables; exit code and what was printed."""
    monkeypatch.chdir(tmp_path)

    def call(text, *options):
        Path("wing.toml").write_text(text)
        code = main(["simulate", "wing.toml", "--no-progress", *options])
        printed = capsys.readouterr()
        return code, printed.out + printed.err

    return call


def table(path):
    lines = Path(path).read_text().splitlines()
    names, rows = lines[0].split(","), np.array([line.split(",") for line in lines[1:]], float)
    return dict(zip(names, rows.T, strict=True))


def test_the_motion_is_that_of_simulate(run):
    """Samples at multiples of the interval and at the end; a factor with a jump; damping."""
    jump = "time = [0.0, 0.05, 0.05]\nfactor = [0.0, 1.0, 2.0]\n"
    code, text = run(WING + MOTION + "damping = 0.01\n" + PUSH + jump, "--out", "m.csv")
    assert code == 0 and "reached the last time" in text and "wrote m.csv" in text
    found = table("m.csv")
    assert_allclose(found["time"], [0, 0.1, 0.2, 0.25])
    wing = cc.load_wing("wing.toml")
    force = ca.MX.sym("force")
    loads = [*wing.loads, cc.PointForce(1.0, ca.vertcat(0, 0, 10 * force))]
    model = cc.beam_model(wing.beam, loads, inputs={"force": force}, damping=0.01)
    expected = cc.simulate(
        model,
        None,
        found["time"],
        u=lambda t: [np.interp(t, [0, 0.05, 0.05], [0, 1, 2])],
        method="implicit_midpoint",
        dt=0.005,
    )
    for k in range(3):
        assert_allclose(found[f"q{k}"], expected.part("q")[k], rtol=1e-9, atol=1e-12)
    assert_allclose(found["u_load_1_factor0"], [0, 2, 2, 2])
    assert_allclose(found["y_root_force2"], expected.part("root_force")[2], rtol=1e-9)


def test_a_wing_rests_in_its_equilibrium(run):
    """Under the loads of time 0, those of tables and of options included."""
    course = "time = [0.0, 1.0]\nfactor = [2.0, 2.0]\n"
    code, _ = run(
        WING + MOTION + 'start = "equilibrium"\n' + PUSH + course,
        *("--load", "point_force xi=0.5 force=0,0,-5", "--out", "m.npz"),
    )
    assert code == 0
    with np.load("m.npz") as motion:
        assert np.max(np.abs(motion["q"])) > 0.01
        assert_allclose(motion["q"], np.tile(motion["q"][:1], (4, 1)), atol=1e-10)


def test_a_table_of_factors_may_be_a_file(run):
    Path("push.csv").write_text("factor,time\n0,0\n1,0.1\n")
    code, _ = run(WING + MOTION + PUSH + 'file = "push.csv"\n')
    assert code == 0
    timed = cc.load_scenario("wing.toml").timed[0]
    assert [timed.factor(t) for t in (-1, 0.05, 3)] == [0, 0.5, 1]


def test_options_replace_the_table(run):
    scenario_of = lambda: cc.load_scenario("wing.toml", duration=0.1, method="rk4", step=1e-3)  # noqa: E731
    code, text = run(WING, "--duration", "0.02", "--method", "rk4", "--step", "0.001")
    assert code == 0 and "2 times from 0 to 0.02 s" in text
    scenario = scenario_of()
    assert scenario.method == "rk4" and len(scenario.times) == 6
    assert_allclose(scenario.start["q"], 0)


def test_ratios_of_modes_are_those_of_the_start(run):
    Path("wing.toml").write_text(WING + MOTION + "damping_ratios = [0.02, 0.01]\n")
    scenario = cc.load_scenario("wing.toml")
    assert_allclose(
        scenario.damping, cc.modal_damping(scenario.beam, [0.02, 0.01], None, scenario.loads)
    )


def test_pictures_are_written(run):
    code, text = run(WING + MOTION, "--plot", "m.png", "--animate", "m.gif", "--half")
    assert code == 0 and "wrote m.gif" in text
    assert Path("m.png").stat().st_size > 5000 and Path("m.gif").read_bytes()[:3] == b"GIF"


def test_what_was_reached_is_written_and_limits_are_named(run):
    """An explicit method with steps that are too long: the wing leaves its bounds first."""
    stiff = WING.replace("EI_y = 300.0", "EI_y = 1.1e5")
    code, text = run(stiff, "--duration", "1", "--method", "rk4", "--out", "m.csv")
    assert code == 3
    assert re.search(r"at t = .* s with steps of 0.005 s the state is not finite: take", text)
    assert re.search(r"warning: at t = .* s the motion leaves a limit: q\[\d\].*bounds", text)
    found = table("m.csv")
    assert 2 <= len(found["time"]) < 51 and np.all(np.isfinite(found["q0"]))


@pytest.mark.parametrize(
    "tables, message",
    [
        ("", r"simulation: expected a table \[simulation\] with duration, found none"),
        ("simulation = 3", r"simulation: expected a table of duration, found 3"),
        ("[simulation]\nstep = 0.1", r"\[simulation\] duration: expected a finite number"),
        ("[simulation]\nduration = 0.0", r"duration: expected a time above zero, s, found 0"),
        (MOTION + "step = -1.0", r"step: expected a time above zero, s, found -1"),
        (MOTION.replace("0.1", "1.0"), r"interval: expected no more than the duration of 0.25 s"),
        (MOTION.replace("0.25", "1e9"), r"duration: expected at most 1000000 intervals of"),
        (MOTION + "start = [0.1]", r"start: expected 3 numbers \(torsion: .*found 1"),
        (MOTION + "start = [0, 9, 9]", r"start: expected every element to turn at most"),
        (MOTION + 'start = "bent"', r"start: expected one of unloaded, equilibrium, found 'bent'"),
        (MOTION + "rates = [1]", r"rates: expected 3 numbers"),
        (MOTION + 'method = "euler"', r"method: expected one of implicit_midpoint, rk4, cvodes"),
        (MOTION + "damping = -1", r"damping: expected a time of at least zero, s, found -1"),
        (MOTION + "damping_ratios = -1", r"damping_ratios: ratios: expected numbers of at least"),
        (MOTION + "damping = 1\ndamping_ratios = 1", r"expected no damping beside it, found both"),
        (MOTION + PUSH, r"\[simulation.loads 1\] expected time and factor, or file, found none"),
        (MOTION + PUSH + "time = [0, 1]\nfactor = [1]", r"factor: expected 2 numbers, found 1"),
        (MOTION + PUSH + "time = [1, 0]\nfactor = [1, 1]", r"expected increasing times, s, found"),
        (MOTION + PUSH + 'file = "no.csv"', r"no.csv: expected a readable file"),
        (
            "[aerodynamics]\nchord = 1.0\naerodynamic_center = 0.2\nlift_slope = 6.0\n"
            "[airstream]\ndensity = 1.0\nvelocity = [9, 0, 0]" + MOTION,
            r"airstream: expected a wing without one",
        ),
    ],
)
def test_wrong_tables_are_refused_by_name(run, tables, message):
    # A key of the file itself stands above its tables.
    text = f"{tables}\n{WING}" if tables.startswith("simulation") else WING + tables
    code, printed = run(text)
    assert (code == 2 and "wing.toml" in printed) or "no.csv" in printed
    assert re.search(message, printed), printed


@pytest.mark.parametrize(
    "content, message",
    [
        (
            "t,factor\n0,1\n",
            r"push.csv: line 1: expected the columns time and factor, found no",
        ),
        ("time,factor\n", r"push.csv: line 2: expected a line of time and factor, found none"),
        ("time,factor\n0,1\n1,x\n", r"push.csv: line 3, column factor: expected a finite"),
        (
            "time,factor\n1,1\n0,1\n",
            r"push.csv: line 3, column time: expected at least 1 s, found",
        ),
    ],
)
def test_wrong_tables_of_factors_are_refused_by_line(run, content, message):
    Path("push.csv").write_text(content)
    code, printed = run(WING + MOTION + PUSH + 'file = "push.csv"')
    assert code == 2 and re.search(message, printed), printed


def test_masses_must_resist_all_weights(run):
    heavy = WING.replace("mass_per_length = 0.5", "")
    code, printed = run(heavy + MOTION + "[[bodies]]\nxi = 1.0\nmass = 1.0\n")
    assert code == 2 and "Section.inertia: expected a rotary inertia" in printed
    bodies = "[[bodies]]\nxi = 1.0\nmass = 1.0\n"
    bending = heavy.replace('torsion = { family = "legendre", n = 1 }', "")
    bending = bending.replace("n = 2", "n = 4")
    code, printed = run(bending + MOTION + bodies)
    assert code == 2 and "expected mass that resists each of the 4 weights" in printed
