"""The command `curvcasadi export`."""

from __future__ import annotations

import re
import subprocess
from dataclasses import replace
from pathlib import Path

import pytest

import curvcasadi as cc
from curvcasadi.cli import main
from curvcasadi.export import run_check
from curvcasadi.export.wing import write_wing_c

ROOT = Path(__file__).parents[2]


def test_the_export_writes_c_of_a_wing_file_that_agrees_with_python(tmp_path):
    beam = cc.load_beam(ROOT / "ocp_examples" / "hale_wing.toml")
    beam = replace(beam, grid=replace(beam.grid, real="float"))
    assert set(write_wing_c(beam, tmp_path)["functions"]) == {
        "tip",
        "shape_target",
        "tip_path_step",
    }
    # Rounding of single precision, over the length, and what it makes of a solver's last step.
    assert max(run_check(tmp_path, optimization="-O0").values()) <= 1e-3


HALE = (ROOT / "ocp_examples" / "hale_wing.toml").read_text()


@pytest.fixture(autouse=True)
def few_stages(monkeypatch):
    """Of the controller: less to compile."""
    monkeypatch.setattr("curvcasadi.export.wing.STAGES", 2)


def export(tmp_path, text, *options):
    wing = tmp_path / "wing.toml"
    wing.write_text(text)
    return main(["export", str(wing), "--out", str(tmp_path / "c"), *options])


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("weight_bounds = 0.15", ""),
        ("weight_bounds = 0.15", "weight_bounds = 8.6"),
        ("weight_bounds = 0.15", "weight_bounds = 1e-3"),
        ("elements = 16", "elements = 5"),
        ("length = 16.0", "length = 0.5"),
        ('n = 4 }\nin_plane = { family = "legendre", n = 2 }', "n = 1 }"),
    ],
    ids=["unbounded", "wide", "narrow", "coarse", "short", "few weights"],
)
def test_the_export_finds_shapes_to_test_within_the_limits_of_a_wing(tmp_path, old, new):
    assert old in HALE
    assert export(tmp_path, HALE.replace(old, new)) == 0
    assert max(run_check(tmp_path / "c", optimization="-O0").values()) <= 1e-3


@pytest.mark.parametrize(
    ("text", "options", "message"),
    [
        (
            HALE,
            ["--max-angle", "0"],
            r"--max-angle: expected an angle in \(0, π\] rad",
        ),
        (
            HALE.replace("= 0.15", "= { lower = 5, upper = 8 }"),
            [],
            r"expected a grid whose elements",
        ),
        (
            HALE.replace("\nlength", "\nspan"),
            [],
            r"\[beam\] span: expected one of",
        ),
        (HALE, ["--max-angle", "90"], r"--max-angle: expected an angle in \(0, π\] rad, found 90"),
    ],
    ids=["no angle", "bent bounds", "unknown key", "degrees"],
)
def test_the_export_says_in_a_line_what_it_cannot_do(tmp_path, capsys, text, options, message):
    assert export(tmp_path, text, *options) == 2
    printed = capsys.readouterr().err
    assert re.fullmatch(rf"curvcasadi: error: .*{message}.*\n", printed), printed


@pytest.mark.parametrize("real", ["double", "float"])
def test_the_sample_program_prints_the_tip(tmp_path, real):
    assert export(tmp_path, HALE, "--real", real) == 0
    gcc = ["gcc", "-std=c99", "-O1", "-Wall", "-Wextra", "-Wno-unused-parameter", "-Werror"]
    sources = ["-I.", "example/main.c", "curv.c", "curv_functions.c"]
    subprocess.run([*gcc, *sources, "-lm", "-o", "wing"], cwd=tmp_path / "c", check=True)
    done = subprocess.run(
        ["./wing"], cwd=tmp_path / "c", check=True, capture_output=True, text=True
    )
    text = (tmp_path / "c" / "example" / "main.c").read_text()
    weights = re.search(r"= \{(.*)\};", text)[1].replace("f", "").split(",")
    beam = cc.load_beam(ROOT / "ocp_examples" / "hale_wing.toml")
    position = cc.tip_function(beam)([float(w) for w in weights])[0].full().ravel()
    printed = [float(x) for x in re.search(r"\((.*)\) m", done.stdout)[1].split(",")]
    assert printed == pytest.approx(position, abs=1e-4)  # four decimals are printed


def test_a_file_in_place_of_the_folder_is_refused(tmp_path, capsys):
    (tmp_path / "c").write_text("")
    assert export(tmp_path, HALE) == 2
    assert "--out: expected a folder, found the file" in capsys.readouterr().err
