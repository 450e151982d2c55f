"""`curvcasadi fly`."""

import csv
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from curvcasadi.cli.main import main

EXAMPLE = Path(__file__).parents[2] / "ocp_examples" / "hale_aircraft.toml"


@pytest.fixture(scope="module")
def hale(tmp_path_factory):
    """The aircraft of the example on a coarse grid with few weights."""
    text = EXAMPLE.read_text().replace("elements = 16", "elements = 4")
    for n in ("n = 3", "n = 4", "n = 2"):
        text = text.replace(n, "n = 1")
    path = tmp_path_factory.mktemp("aircraft") / "hale.toml"
    path.write_text(text)
    return str(path)


def run(hale, *arguments):
    return main(["fly", hale, "--speed", "25", *map(str, arguments), "--no-progress"])


def refused(capsys, hale, *arguments):
    assert run(hale, *arguments) == 2
    return capsys.readouterr().err


def test_a_flight_through_a_gust_is_printed_written_and_drawn(hale, capsys, tmp_path):
    table, figure, film = (tmp_path / name for name in ("f.csv", "f.png", "f.gif"))
    options = ("--duration", 1.2, "--interval", 0.1, "--step", 0.02)
    gust = ("--gust", "amplitude=3,length=15,start=5,side=right")
    files = ("--out", table, "--plot", figure, "--animate", film)
    assert run(hale, *options, *gust, *files) == 0
    printed = capsys.readouterr().out
    assert "13 times from 0 to 1.2 s; reached the last time; trimmed at 25 m/s" in printed
    assert "root M_y of left [N m]" in printed
    with table.open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 13
    bending = np.array([float(row["y_root_moment_right1"]) for row in rows])
    # Until it meets the gust it flies as trimmed; then the right wing bends up, and it rolls left.
    early = [row for row in rows if 25 * float(row["time"]) < 5]
    assert len(early) > 1
    np.testing.assert_allclose(bending[: len(early)], bending[0], rtol=1e-9)
    assert bending.min() < bending[0] - 50
    assert min(float(row["twist0"]) for row in rows) < -0.02
    for path in (figure, film):
        with Image.open(path) as image:
            assert min(image.size) > 300


@pytest.mark.parametrize(
    "options, message",
    [
        (("--gust", "amplitude=3"), "--gust: expected length, found 'amplitude=3'"),
        (("--gust", "amplitude=3,length=-1"), "--gust: expected a length above zero, m, found -1"),
        (("--gust", "amplitude=x,length=1"), "--gust: expected a number for amplitude, found 'x'"),
        (("--gust", "height=3"), "expected each of amplitude, length, start, side once; found"),
        (("--gust", "amplitude=3,length=9,side=up"), "expected side=both, right or left, found"),
        (("--turbulence", "intensity=1"), "--turbulence: expected scale, found 'intensity=1'"),
        (("--turbulence", "intensity=1,scale=0"), "Turbulence.scale: expected"),
    ],
)
def test_a_wrong_gust_is_refused(hale, capsys, options, message):
    assert message in refused(capsys, hale, *options)


@pytest.mark.parametrize("option", ["--duration", "--step", "--interval", "--density"])
def test_numbers_are_above_zero(hale, capsys, option):
    with pytest.raises(SystemExit) as caught:
        run(hale, option, "-1")
    assert caught.value.code == 2
    assert "expected a number above zero, found '-1'" in capsys.readouterr().err


def test_an_aircraft_without_inertia_is_refused(hale, capsys, tmp_path):
    path = tmp_path / "light.toml"
    path.write_text(Path(hale).read_text().replace("inertia = [[200, 0", "# [[200, 0"))
    assert "RigidBody.inertia: expected (3, 3) for free flight" in refused(capsys, str(path))
