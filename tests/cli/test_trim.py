"""`curvcasadi trim`."""

import csv
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from PIL import Image

from curvcasadi.aircraft.trim import trim
from curvcasadi.aircraft.turn import Turn
from curvcasadi.cli.main import main
from curvcasadi.files.aircraft import load_aircraft
from curvcasadi.plotting import plot_trim

EXAMPLE = Path(__file__).parents[2] / "ocp_examples" / "hale_aircraft.toml"
#: The aircraft of the example on a coarse grid, which trims in a fraction of the time, and without
#: inertia of the body, so that no modes are computed.
FOLDER = TemporaryDirectory()
HALE_AIRCRAFT = str(Path(FOLDER.name) / "hale_aircraft.toml")
COARSE = EXAMPLE.read_text().replace("elements = 16", "elements = 5")
Path(HALE_AIRCRAFT).write_text(COARSE.replace("inertia = [[200, 0", "# [[200, 0"))
DENSITY = 0.0889  # kg/m³, at 20 km
FLAPS = '[[beams.aerodynamics.controls]]\nname = "flap"\nlift = 3.0\n\n[[beams]]\nname = "left"'


@pytest.fixture(scope="module")
def aircraft():
    return load_aircraft(HALE_AIRCRAFT)


@pytest.fixture
def flapped(tmp_path):
    """The aircraft with flaps along the whole wing: one input more than the balances settle."""
    path = tmp_path / "flapped.toml"
    path.write_text(Path(HALE_AIRCRAFT).read_text().replace('[[beams]]\nname = "left"', FLAPS))
    return str(path)


AGILE = """
[[beams.aerodynamics.controls]]
name = "aileron"
lift = 3.0
start = 0.7
antisymmetric = true

[[beams]]
name = "left"
"""
FIN = """
[[surfaces]]
name = "fin"
area = 1.5
pose = { position = [-10, 0, -1], rotation = [[0, 1, 0], [0, 0, -1], [-1, 0, 0]] }

[surfaces.aerodynamics]
chord = 0.5
aerodynamic_center = 0.0
lift_slope = 5.0
upper_side = 1

[[surfaces.aerodynamics.controls]]
name = "rudder"
lift = 3.0
"""


@pytest.fixture(scope="module")
def agile(tmp_path_factory):
    """The aircraft with ailerons, a fin and a rudder, and with inertia."""
    path = tmp_path_factory.mktemp("agile") / "agile.toml"
    path.write_text(COARSE.replace('\n[[beams]]\nname = "left"\n', AGILE) + FIN)
    return str(path)


def run(*arguments, aircraft=HALE_AIRCRAFT, density=DENSITY):
    return main(["trim", aircraft, "--density", str(density), *map(str, arguments)])


def refused(capsys, *arguments, code=2, **options):
    """The message of a command that must fail."""
    assert run(*arguments, **options) == code
    *_, message = capsys.readouterr().err.partition("curvcasadi: error: ")
    return message.strip()


def cells(line):
    """Texts of a line of a table, which two spaces or more separate."""
    return [cell.strip() for cell in line.split("  ") if cell.strip()]


def columns(text, key):
    """Columns of the printed table that has a column `key`, as texts."""
    lines = text.splitlines()
    (first,) = (k for k, line in enumerate(lines) if key in cells(line))
    rows = []
    for line in lines[first + 1 :]:
        if not line.strip() or line.startswith("wrote"):
            break
        rows.append(cells(line))
    return dict(zip(cells(lines[first]), zip(*rows, strict=True), strict=True))


def test_modes_are_printed_where_the_body_has_inertia(capsys, tmp_path):
    heavy, light = tmp_path / "heavy.toml", tmp_path / "light.toml"
    heavy.write_text(COARSE)
    assert run("--speed", 25, aircraft=str(heavy)) == 0
    found = columns(capsys.readouterr().out, "mode")
    modes = ("phugoid", "short period", "dutch roll", "spiral", "roll")
    assert found["mode"][:5] == modes
    assert float(found["real [1/s]"][0]) < 0 < float(found["real [1/s]"][2])
    assert found["halves or doubles in [s]"][2].endswith("x2")  # no fin
    assert run("--speed", 25) == 0
    assert "no flight modes: [body] has no inertia" in capsys.readouterr().out
    light.write_text(COARSE.replace("inertia = [[0.1, 0", "# [[0.1, 0"))
    assert run("--speed", 25, aircraft=str(light)) == 0
    assert "no flight modes: Section.inertia: expected" in capsys.readouterr().out


def test_the_tables_have_the_trim(aircraft, capsys):
    assert run("--speed", 25) == 0
    text = capsys.readouterr().out
    found = trim(aircraft, speed=25.0, density=DENSITY)
    flight, wings = columns(text, "alpha [deg]"), columns(text, "wing")
    # Half of the last digit that is printed.
    digits = {"abs": 0.51e-3}
    assert float(flight["alpha [deg]"][0]) == pytest.approx(
        np.degrees(found.angle_of_attack), **digits
    )
    assert float(flight["pitch [deg]"][0]) == pytest.approx(np.degrees(found.pitch), **digits)
    assert float(flight["thrust [N]"][0]) == pytest.approx(found.inputs["thrust"], **digits)
    elevator = np.degrees(found.inputs["elevator"])
    assert float(flight["elevator [deg]"][0]) == pytest.approx(elevator, **digits)
    assert flight["state"] == ("trimmed",)
    assert wings["wing"] == ("right", "left")
    for k, axis in enumerate("xyz"):
        printed = [float(value) for value in wings[f"M_{axis} [N m]"]]
        loads = [found.root_loads[wing][k] for wing in ("right", "left")]
        np.testing.assert_allclose(printed, loads, atol=0.51e-2)


def test_tips_are_above_the_roots(aircraft, capsys):
    assert run("--speed", 25) == 0
    wings = columns(capsys.readouterr().out, "wing")
    found = trim(aircraft, speed=25.0, density=DENSITY)
    height = -float(found.shapes["right"].tip.position[2])  # the root is at the origin
    assert height > 1
    np.testing.assert_allclose(np.array(wings["tip height [m]"], float), height, atol=0.51e-4)


def test_what_is_left_is_printed_and_small(capsys):
    assert run("--speed", 25) == 0
    text = capsys.readouterr().out
    flight, wings = columns(text, "alpha [deg]"), columns(text, "wing")
    # 1e-8 of the weight, 727 N, of 1.6 m times it, and of 16 m squared times it.
    assert float(flight["unbalanced [N]"][0]) < 7e-6
    assert float(flight["unbalanced [N m]"][0]) < 1.2e-5
    assert max(map(float, wings["residual [N m2]"])) < 2e-3


def test_speeds_add_up_and_ranges_include_their_ends(capsys, terminal):
    assert run("--speed", 33, "--speed", "24:30:2", "--speed", "25:25.5:1") == 0
    captured = capsys.readouterr()
    assert columns(captured.out, "alpha [deg]")["V [m/s]"] == ("33", "24", "26", "28", "30", "25")
    assert "6/6" in captured.err  # the progress bar


def test_a_range_of_too_many_speeds_is_refused(capsys):
    message = refused(capsys, "--speed", "10:40:1e-6")
    assert message == "--speed: expected at most 2000 steps, found 3e+07 in '10:40:1e-6'"


def test_one_speed_has_no_progress_bar(capsys, terminal):
    assert run("--speed", 25) == 0
    assert capsys.readouterr().err == ""


def test_held_inputs_stay(capsys, flapped):
    assert run("--speed", 25, "--hold", "flap=0.05", aircraft=flapped) == 0
    flight = columns(capsys.readouterr().out, "alpha [deg]")
    assert float(flight["flap [deg]"][0]) == pytest.approx(np.degrees(0.05), abs=0.51e-3)


def test_an_objective_settles_free_inputs(capsys, flapped):
    moments = []
    for more in (["--hold", "flap=0"], ["--objective", "root_bending"]):
        assert run("--speed", 25, *more, aircraft=flapped) == 0
        wings = columns(capsys.readouterr().out, "wing")
        moments.append(abs(float(wings["M_y [N m]"][0])))
    assert moments[1] < moments[0]


def test_gravity_of_another_planet_is_taken(capsys):
    assert run("--speed", 25, "--gravity", 3.71) == 0
    out = capsys.readouterr().out
    assert "gravity 3.71 m/s2" in out
    found = trim(load_aircraft(HALE_AIRCRAFT), speed=25.0, density=DENSITY, gravity=3.71)
    alpha = float(columns(out, "alpha [deg]")["alpha [deg]"][0])
    assert alpha == pytest.approx(np.degrees(found.angle_of_attack), abs=0.51e-3)


def test_the_csv_file_has_a_line_for_each_speed_in_si_units(aircraft, tmp_path, capsys):
    path = tmp_path / "trim.csv"
    assert run("--speed", "24:26:2", "--out", path) == 0
    assert f"wrote {path}" in capsys.readouterr().out
    with path.open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [float(row["speed"]) for row in rows] == [24, 26]
    found = trim(aircraft, speed=26.0, density=DENSITY)
    row = {key: float(value) for key, value in rows[1].items()}
    assert row["trimmed"] == 1
    # Another start of Newton's method: equal to its tolerance, 1e-8, with a margin.
    assert row["angle_of_attack"] == pytest.approx(found.angle_of_attack, rel=1e-6)
    assert row["input_elevator"] == pytest.approx(found.inputs["elevator"], rel=1e-6)
    weights = [row[f"left_q{k}"] for k in range(9)]
    np.testing.assert_allclose(weights, found.q["left"].full().ravel(), rtol=1e-6, atol=1e-9)
    assert row["right_root_moment_y"] == pytest.approx(found.root_loads["right"][1], rel=1e-6)


def test_the_figure_has_both_half_wings_and_their_lift(aircraft):
    results = [trim(aircraft, speed=speed, density=DENSITY) for speed in (25.0, 30.0)]
    front, lift = plot_trim(aircraft, results).axes
    assert (
        "[m]" in front.get_ylabel() and "[N/m]" in lift.get_ylabel() and "[m]" in lift.get_xlabel()
    )
    lines = [line.get_xydata() for line in front.lines]
    right, left = lines[1], lines[4]  # of each wing: undeformed, 25 m/s, 30 m/s
    np.testing.assert_allclose(left, right * [-1, 1], atol=1e-9)
    tip = results[0].shapes["right"].tip.position.full().ravel()
    np.testing.assert_allclose(right[-1], [tip[1], -tip[2]], atol=1e-9)
    airload = results[0].airloads["right"]
    np.testing.assert_array_equal(lift.lines[0].get_ydata(), airload.lift.full().ravel())


def test_the_figure_is_written(tmp_path, capsys):
    path = tmp_path / "trim.png"
    assert run("--speed", 25, "--plot", path) == 0
    assert f"wrote {path}" in capsys.readouterr().out
    with Image.open(path) as image:
        assert min(image.size) > 500


def test_a_legend_of_many_speeds_names_some(aircraft):
    results = [trim(aircraft, speed=25.0, density=DENSITY)] * 20
    (legend,) = plot_trim(aircraft, results).legends
    assert len(legend.get_texts()) == 8  # the undeformed wing and seven speeds


def test_an_impossible_trim_names_the_balance_and_exits_with_3(capsys, tmp_path):
    path = tmp_path / "trim.csv"
    message = refused(capsys, "--speed", 5, "--out", path, code=3)
    assert message.startswith("no trim at 5 m/s: ")
    assert "force along z is left with" in message and "% of the weight" in message
    assert not path.exists()


def test_a_sweep_with_an_impossible_speed_shows_the_others_and_exits_with_3(capsys, tmp_path):
    path = tmp_path / "trim.csv"
    assert run("--speed", 25, "--speed", 5, "--out", path) == 3
    captured = capsys.readouterr()
    assert columns(captured.out, "alpha [deg]")["state"] == ("trimmed", "not trimmed")
    assert "error: no trim at 5 m/s: " in captured.err
    with path.open(newline="") as file:
        assert [row["trimmed"] for row in csv.DictReader(file)] == ["1", "0"]


@pytest.mark.parametrize("speed", ["fast", "0", "nan", "20:30", "20:30:0", "20:30:2:1", "-3", ""])
def test_a_wrong_speed_is_refused(capsys, speed):
    message = refused(capsys, f"--speed={speed}")
    assert message.startswith("--speed: expected a speed in m/s, or first:last:step")
    assert message.endswith(f"found {speed!r}")


def test_a_range_that_runs_backwards_is_refused(capsys):
    assert "first <= last; found '30:20:2'" in refused(capsys, "--speed", "30:20:2")


@pytest.mark.parametrize("hold", ["rudder=0.1", "elevator", "elevator=up", "elevator=nan", "=1"])
def test_a_wrong_input_to_hold_is_refused(capsys, hold):
    message = refused(capsys, "--speed", 25, "--hold", hold)
    assert message.startswith("--hold: expected ") and message.endswith(f"found {hold!r}")


def test_an_input_held_twice_is_refused(capsys):
    message = refused(capsys, "--speed", 25, "--hold", "elevator=0", "--hold", "elevator=1")
    assert "each of the inputs thrust, elevator once" in message


@pytest.mark.parametrize("density", [0, -1, "nan"])
def test_a_wrong_density_is_refused(capsys, density):
    assert refused(capsys, "--speed", 25, density=density).startswith("density: expected")


def test_too_many_free_inputs_are_refused_with_the_options_that_help(capsys, flapped):
    message = refused(capsys, "--speed", 25, aircraft=flapped)
    assert "hold others by --hold, or give --objective" in message


def test_a_wrong_file_is_refused_with_its_key(capsys, tmp_path):
    path = tmp_path / "aircraft.toml"
    path.write_text(Path(HALE_AIRCRAFT).read_text().replace("mass = 50.0", "mas = 50.0"))
    message = refused(capsys, "--speed", 25, aircraft=str(path))
    assert message.startswith(f"{path}: [body] mas: ") and "nearest to mass" in message


def test_a_missing_file_is_refused(capsys, tmp_path):
    path = str(tmp_path / "none.toml")
    assert refused(capsys, "--speed", 25, aircraft=path).startswith(path)


def test_a_speed_is_required(capsys):
    with pytest.raises(SystemExit) as caught:
        main(["trim", HALE_AIRCRAFT])
    assert caught.value.code == 2
    assert "--speed" in capsys.readouterr().err


def test_a_turn_is_trimmed_with_its_modes_table_and_figure(capsys, tmp_path, agile):
    files = tmp_path / "turn.csv", tmp_path / "turn.png"
    assert (
        run(
            "--speed", 25, "--turn-rate", "5deg/s", "--out", files[0], "--plot", files[1],
            aircraft=agile,
        )
        == 0
    )  # fmt: skip
    text = capsys.readouterr().out
    found = trim(load_aircraft(agile), speed=25.0, density=DENSITY, turn=Turn(rate=np.deg2rad(5.0)))
    flight = columns(text, "alpha [deg]")
    assert flight["turn [deg/s]"] == ("5.000",)
    assert float(flight["bank [deg]"][0]) == pytest.approx(np.degrees(found.roll), abs=0.51e-3)
    assert float(flight["radius [m]"][0]) == pytest.approx(found.turn_radius, rel=1e-3)
    assert float(flight["load factor"][0]) == pytest.approx(found.load_factor, abs=0.51e-4)
    aileron = np.degrees(found.inputs["aileron"])
    assert float(flight["aileron [deg]"][0]) == pytest.approx(aileron, abs=0.51e-3)
    assert columns(text, "mode")["mode"][:5] == (
        "phugoid", "short period", "dutch roll", "spiral", "roll"
    )  # fmt: skip
    with files[0].open(newline="") as file:
        (row,) = csv.DictReader(file)
    assert float(row["turn_rate"]) == pytest.approx(np.deg2rad(5.0), rel=1e-12)
    assert float(row["load_factor"]) == pytest.approx(found.load_factor, rel=1e-9)
    with Image.open(files[1]) as image:
        assert min(image.size) > 500


@pytest.mark.parametrize(
    ("options", "key", "value"),
    [
        (("--bank=-10deg",), "bank [deg]", "-10.000"),
        (("--turn-radius", "300m"), "radius [m]", "300"),
        (("--load-factor", 1.02), "load factor", "1.0200"),
        (("--sideslip", "0.05rad"), "sideslip [deg]", "2.865"),
        (("--turn-rate", 0.05, "--sideslip", "1deg"), "sideslip [deg]", "1.000"),
        (("--turn-rate", 0.05, "--free", "sideslip", "--hold", "rudder=2deg"), "rudder [deg]",
         "2.000"),
    ],
)  # fmt: skip
def test_turns_and_sideslip_by_options(capsys, agile, tmp_path, options, key, value):
    path = tmp_path / "still.toml"  # without inertia of the wings' sections: no modes
    path.write_text(Path(agile).read_text().replace("inertia = [[0.1, 0", "# [[0.1, 0"))
    assert run("--speed", 25, *options, aircraft=str(path)) == 0
    assert columns(capsys.readouterr().out, "alpha [deg]")[key] == (value,)


def test_the_legend_of_a_figure_names_bank_angles(agile):
    found = trim(load_aircraft(agile), speed=25.0, density=DENSITY, turn=Turn(bank=0.2))
    (legend,) = plot_trim(load_aircraft(agile), [found]).legends
    assert [text.get_text() for text in legend.get_texts()] == ["undeformed", "25 m/s, bank 11.5°"]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--bank", "30"), "--bank: expected an angle within ±π/2 rad, found 30; 30 degrees are"),
        (("--sideslip", "5"), "--sideslip: expected within -0.35 to 0.35 rad, found 5; 5 degrees"),
        (("--load-factor", "0.5"), "--load-factor: expected at least 1, that of straight flight"),
        (("--turn-radius", "0"), "--turn-radius: expected a number other than zero"),
        (("--sideslip", "2deg", "--free", "sideslip"), "--free: expected what is not held"),
    ],
)
def test_wrong_values_of_a_turn_are_refused_in_one_line(capsys, agile, options, message):
    found = refused(capsys, "--speed", 25, *options, aircraft=agile)
    assert found.startswith(message) and "\n" not in found


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--turn-rate", "5deg"), "--turn-rate: expected a number in rad/s, or in deg/s as 5deg/s"),
        (("--bank", "30deg/s"), "--bank: expected a number in rad, or in deg as 5deg, found"),
        (("--bank", "steep"), "--bank: expected a number in rad"),
        (("--turn-radius", "nan"), "--turn-radius: expected a number in m, found 'nan'"),
        (("--load-factor", "2g"), "--load-factor: expected a number without a unit, found '2g'"),
        (("--bank", "0.1", "--turn-rate", "0.1"), "--turn-rate: not allowed with argument --bank"),
    ],
)
def test_wrong_units_of_a_turn_are_refused(capsys, agile, options, message):
    with pytest.raises(SystemExit) as caught:
        run("--speed", 25, *options, aircraft=agile)
    assert caught.value.code == 2
    assert message in capsys.readouterr().err


def test_an_aircraft_that_cannot_turn_says_what_it_lacks(capsys, agile):
    light = refused(capsys, "--speed", 25, "--turn-rate", 0.1)
    assert light.startswith("inertia under [body]: expected (3, 3)")
    path = Path(agile).with_name("plain.toml")
    path.write_text(COARSE)
    message = refused(capsys, "--speed", 25, "--turn-rate", 0.1, aircraft=str(path), code=3)
    assert message.startswith("no trim at 25 m/s in a turn with rate 0.1 rad/s: ")
    assert "are there inputs that roll and yaw the aircraft?" in message
