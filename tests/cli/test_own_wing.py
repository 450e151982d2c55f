"""The way to one's own wing: template, info, target."""

from __future__ import annotations

import re

import numpy as np
import pytest

import curvcasadi as cc
from curvcasadi.cli import main
from curvcasadi.cli.template import KINDS, template
from curvcasadi.files.estimation import load_estimation
from curvcasadi.lie import so3


@pytest.fixture
def wing(tmp_path):
    path = tmp_path / "wing.toml"
    path.write_text(template("wing"))
    return path


@pytest.mark.parametrize("kind", KINDS)
def test_templates_are_files_that_can_be_read(tmp_path, capsys, kind):
    assert main(["template", kind]) == 0
    printed = capsys.readouterr().out
    path = tmp_path / "new.toml"
    assert main(["template", kind, "--out", str(path)]) == 0
    assert path.read_text() == printed
    reader = {"wing": cc.load_wing, "aircraft": cc.load_aircraft, "sensors": load_estimation}
    assert reader[kind](path)
    assert main(["template", kind, "--out", str(path)]) == 2
    assert "expected a new file, found one" in capsys.readouterr().err


def test_the_wing_of_the_template_finds_its_shape(wing, capsys):
    assert main(["equilibrium", str(wing)]) == 0
    assert "tip position" in capsys.readouterr().out


def test_the_aircraft_of_the_template_flies(tmp_path, capsys):
    path = tmp_path / "aircraft.toml"
    path.write_text(template("aircraft"))
    assert main(["trim", str(path), "--speed", "20", "--no-progress"]) == 0
    assert "elevator" in capsys.readouterr().out


def test_info_says_weights_mass_and_frequencies(wing, capsys):
    assert main(["info", str(wing)]) == 0
    printed = capsys.readouterr().out
    beam = cc.load_beam(wing)
    assert "torsion: Legendre 0 to 2" in printed and "8 m" in printed
    assert "mass               5.2 kg" in printed  # 8 m of 0.6 kg/m, and a body of 0.4 kg
    first = float(re.search(r"frequencies\s+([\d.]+)", printed)[1])
    assert first == pytest.approx(cc.natural_frequencies(beam)[0], rel=1e-3)  # four digits


def test_info_of_an_aircraft_shows_wings_and_planform(tmp_path, capsys):
    path = tmp_path / "aircraft.toml"
    path.write_text(template("aircraft"))
    assert main(["info", str(path)]) == 0
    printed = capsys.readouterr().out
    assert "mass of all: 14 kg" in printed  # 8 kg and twice 5 m of 0.6 kg/m
    assert printed.count("area 1.75 m²") == 2  # 5 m of 0.45 m to 0.25 m


def test_info_of_a_wing_without_inertia_says_so(wing, capsys):
    text = re.sub(r"(?m)^(mass_per_length|inertia|center_of_mass).*$", "", wing.read_text())
    wing.write_text(text[: text.index("[[bodies]]")])
    assert main(["info", str(wing)]) == 0
    assert "frequencies        none: " in capsys.readouterr().out


def test_a_target_is_reached_by_the_weights_that_are_printed(wing, tmp_path, capsys):
    arguments = ["--position", "-0.5,7.5,-2", "--out", str(tmp_path / "p.npz")]
    assert main(["target", str(wing), *arguments, "--plot", str(tmp_path / "p.png")]) == 0
    printed = capsys.readouterr().out
    weights = re.search(r"weights\s+(\S+)", printed)[1]
    tip = cc.pose_at(cc.load_beam(wing), [float(w) for w in weights.split(",")], 1.0)
    np.testing.assert_allclose(tip.position.full().ravel(), [-0.5, 7.5, -2], atol=1e-6)
    with np.load(tmp_path / "p.npz") as arrays:
        np.testing.assert_allclose(arrays["p"][0, :, -1], [-0.5, 7.5, -2], atol=1e-6)
    assert main(["shape", str(wing), "--weights", weights]) == 0


def test_a_turned_target_turns_the_section(wing, capsys):
    """The pose of known weights: the turn against the unloaded section is what is asked for."""
    beam = cc.load_beam(wing)
    shape = [0.01, 0.0, 0.0, -0.05, 0.02, 0.0, 0.0, 0.0, 0.0]
    unloaded, bent = (cc.pose_at(beam, q, 1.0) for q in (np.zeros(9), shape))
    turn = so3.log(bent.rotation @ unloaded.rotation.T)
    texts = [",".join(f"{x:.12g}" for x in v.full().ravel()) for v in (bent.position, turn)]
    assert main(["target", str(wing), f"--position={texts[0]}", f"--turn={texts[1]}"]) == 0
    weights = re.search(r"weights\s+(\S+)", capsys.readouterr().out)[1]
    found = cc.pose_at(beam, [float(w) for w in weights.split(",")], 1.0)
    np.testing.assert_allclose(found.rotation, bent.rotation, atol=1e-6)
    np.testing.assert_allclose(found.position, bent.position, atol=1e-6)


def test_a_turn_in_degrees_is_refused(wing, capsys):
    assert main(["target", str(wing), "--position=-0.5,7.5,-2", "--turn", "0,90,0"]) == 2
    assert re.search("--turn: expected .*2π rad.*degrees\\?", capsys.readouterr().err)


def test_every_command_takes_no_progress(wing, capsys):
    assert main(["info", str(wing), "--no-progress"]) == 0
    arguments = ["template", "wing", "--no-progress"]
    assert main(arguments) == 0


def test_a_target_out_of_reach_ends_with_code_3(wing, capsys):
    assert main(["target", str(wing), "--position", "0,20,0"]) == 3
    assert "curvcasadi: error: " in capsys.readouterr().err


@pytest.mark.parametrize(
    "arguments, message",
    [
        (["target", "WING", "--position", "1,2"], "--position: expected three numbers x,y,z"),
        (["target", "WING", "--position", "1,2,x"], "--position: expected three numbers x,y,z"),
        (["target", "WING", "--position", "1,2,3", "--xi", "7"], "--xi: expected a station s/L"),
        (["target", "WING"], "--position"),
        (["shape", "WING", "--out", "p.txt"], "--out: expected a file name that ends in .csv or"),
        (["shape", "WING", "--plot", "p.gif"], "--plot: expected a file name that ends in .png"),
        (["shape", "WING", "--out", "none/p.csv"], "--out: expected a file to write, found no f"),
        (["trim", "WING", "--speed", "20", "--out", "t.npz"], "--out: expected a file name that"),
        (["equilibrium", "WING", "--plot", "p"], "--plot: expected a file name that ends in .png"),
        (["template", "boat"], "invalid choice: 'boat'"),
    ],
)
def test_wrong_options_are_refused_before_anything_is_computed(wing, capsys, arguments, message):
    with pytest.raises(SystemExit) as stop:
        main([str(wing) if a == "WING" else a for a in arguments])
    assert stop.value.code == 2
    assert message in capsys.readouterr().err


def test_the_version_is_that_of_the_package(capsys):
    with pytest.raises(SystemExit) as stop:
        main(["--version"])
    assert stop.value.code == 0
    assert capsys.readouterr().out == f"curvcasadi {cc.__version__}\n"
