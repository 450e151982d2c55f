"""`curvcasadi flutter` of the wing file that the template makes."""

from __future__ import annotations

import csv

import numpy as np
import pytest

import curvcasadi as cc
from curvcasadi.cli.main import main
from curvcasadi.cli.template import template


@pytest.fixture
def wing(tmp_path):
    path = tmp_path / "wing.toml"
    text = template("wing").replace("n = 3", "n = 2")
    for line in ("[airstream]", "density", "velocity"):
        text = text.replace(f"# {line}", line)
    path.write_text(text.replace("elements = 12", "elements = 8"))
    return path


def test_a_sweep_prints_and_writes_what_flutter_finds(wing, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    sweep = ["--speed", "10:18:2", "--damping", "0.002", "--weight-only"]
    assert main(["flutter", str(wing), *sweep, "--plot", "--out", "roots.csv"]) == 0
    printed = capsys.readouterr().out
    file = cc.load_wing(wing)
    model = cc.wing_model(
        cc.Wing(name="wing", beam=file.beam, strips=file.strips),
        density=1.225,
        damping=0.002,
        outputs=(),
    )
    found = cc.flutter(model, np.arange(10, 19, 2.0), p={"pitch": np.arctan2(0.1, 10.0)})
    assert f"{found.speed:.5g} m/s, {found.frequency:.5g} rad/s" in printed
    with (tmp_path / "roots.csv").open() as rows:
        read = np.array(list(csv.reader(rows))[1:], dtype=float)
    np.testing.assert_array_equal(read[:, 0], found.speeds)
    values = read[:, 1::2] + 1j * read[:, 2::2]
    np.testing.assert_allclose(values, found.roots, rtol=1e-7)
    assert (tmp_path / "flutter.png").stat().st_size > 10000


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--speed", "20:30:5", "--weight-only"], "that grows at 20 m/s; begin at a lower speed"),
        (["--speed", "6:9:1", "--density", "-1"], "density: expected"),
        (["--speed", "6:9"], "expected FIRST:LAST:STEP in m/s"),
        (["--speed", "6:9:0"], "expected FIRST:LAST:STEP in m/s"),
    ],
)
def test_wrong_options_are_named(wing, capsys, options, message):
    try:
        code = main(["flutter", str(wing), *options])
    except SystemExit as error:  # of argparse
        code = error.code
    assert code == 2
    assert message in capsys.readouterr().err


def _without(text, table):
    start = text.index(f"[{table}]")
    end = text.find("\n[", start)
    return text[:start] + (text[end + 1 :] if end > 0 else "")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda text: _without(text, "airstream"), "[airstream] or the option --density"),
        (
            lambda text: text.replace("velocity = [10, 0, 0.1]", "velocity = [10, 1, 0.1]"),
            "in the plane of symmetry",
        ),
        (
            lambda text: text.replace(
                "acceleration = [0, 0, 9.80665]", "acceleration = [0, 9.8, 0]"
            ),
            "expected gravity along z",
        ),
    ],
)
def test_wrong_files_are_named(wing, capsys, change, message):
    wing.write_text(change(wing.read_text()))
    assert main(["flutter", str(wing), "--speed", "6:9:1"]) == 2
    assert message in capsys.readouterr().err
