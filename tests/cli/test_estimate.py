"""`curvcasadi estimate`: sensors in wing files, logs, estimates, and what users get wrong."""

import os
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from curvcasadi.cli import estimate as estimate_command
from curvcasadi.cli.main import main
from curvcasadi.estimation.ekf.run import run_ekf
from curvcasadi.estimation.ekf.stream import History, Point, RowStepper, row_function
from curvcasadi.files.estimation import load_estimation
from curvcasadi.files.log import read_log
from curvcasadi.files.sensors import SENSOR_KINDS
from curvcasadi.kinematics.jacobian import body_jacobian
from curvcasadi.kinematics.shape import pose_at
from curvcasadi.sensors import RootMotion, measure
from tests.support.sensor_logs import write_log

HALE_WING = Path(__file__).parents[2] / "ocp_examples" / "hale_wing_imus.toml"
#: Two weights and two gauges: a row takes a tenth of a millisecond.
BEAM = """
[beam]
length = 2.0
weight_bounds = 0.8
[basis]
out_of_plane = { family = "legendre", n = 2 }
[grid]
kind = "uniform"
elements = 4
"""
FILTER = """
[estimation]
process = "random_walk"
density = 0.1
[estimation.deviation]
q = 0.3
"""
GAUGES = """
[[sensors]]
kind = "strain_gauge"
name = "root"
xi = 0.1
offset = [0, 0.05]
noise = 1e-4
[[sensors]]
kind = "strain_gauge"
xi = 0.8
offset = [0, 0.05]
noise = 1e-4
"""
ALL_KINDS = """
[estimation]
process = "white_acceleration"
density = 0.1
acceleration = 1.0
attitude = true
root_gyro_density = 1e-3
gyro_bias = true
bias_density = 1e-5
root_inputs = ["position", "twist"]
gravity = [0, 0, 9.81]
magnetic_field = [2e-5, 0, 4e-5]
gate = 6.0
iterations = 2
[estimation.deviation]
q = [0.1, 0.2]
q_dot = 0.3
attitude = 0.1
gyro_bias = 0.01
root_gyro_bias = 0.01
[estimation.mean]
q = [0.1, -0.1]
attitude = [[1, 0, 0], [0, 0, -1], [0, 1, 0]]
[[sensors]]
kind = "rate_gyro"
name = "imu"
xi = 0.5
noise_density = [1e-4, 1e-4, 2e-4]
rate = 100.0
offset = [0, 0.1, 0]
mounting = [[0, 1, 0], [-1, 0, 0], [0, 0, 1]]
bias = [0.01, 0, 0]
[[sensors]]
kind = "accelerometer"
xi = 0.5
noise_density = 1e-3
rate = 100.0
mounting = { rotation_vector = [0, 0, 1.5707963267948966] }
[[sensors]]
kind = "magnetometer"
xi = 1.0
noise_density = 1e-8
rate = 10.0
[[sensors]]
kind = "attitude"
xi = 1.0
noise = 0.01
[[sensors]]
kind = "strain_gauge"
xi = 0.2
offset = [0.1, 0.05]
noise = 1e-5
bias = 1e-4
[[sensors]]
kind = "shear_gauge"
xi = 0.2
noise = 1e-4
[[sensors]]
kind = "marker"
xi = 1.0
noise = [1e-3, 1e-3, 2e-3]
offset = [0, 0, 0.1]
[[sensors]]
kind = "camera"
xi = 1.0
noise = 1e-3
pose = { position = [1, 0, -3], rotation_vector = [0.1, 0, 0] }
"""


def curvatures(times):
    """Weights (T, 2) of the small wing."""
    return np.column_stack([-0.3 + 0.1 * np.sin(3 * times), 0.1 * np.cos(2 * times)])


def gauge_lines(wing_file, times, seed=3):
    """Lines of a log of the small wing, with its header."""
    wing, rng = load_estimation(wing_file), np.random.default_rng(seed)
    lines = ["time,root,strain_2"]
    # The gauges are linear in q.
    rows = measure(wing.sensors, wing.beam, np.zeros(2)).values.full()[:, 0]
    slopes = np.column_stack(
        [measure(wing.sensors, wing.beam, e).values.full()[:, 0] - rows for e in 0.5 * np.eye(2)]
    )
    values = rows + curvatures(times) @ (2 * slopes).T
    values += 1e-4 * rng.normal(size=values.shape)
    return lines + [f"{t:.9g},{a:.9g},{b:.9g}" for t, (a, b) in zip(times, values, strict=True)]


@pytest.fixture
def wing(tmp_path):
    path = tmp_path / "wing.toml"
    path.write_text(BEAM + FILTER + GAUGES)
    return path


@pytest.fixture
def log(tmp_path, wing):
    """Writes a log of a header and 19 samples, some changed; `changes` go by number of the line."""
    lines = gauge_lines(wing, 0.01 * np.arange(19))

    def write(changes=None, *, end="\n", encoding="utf-8"):
        path = tmp_path / "log.csv"
        given = [(changes or {}).get(k, line) for k, line in enumerate(lines, start=1)]
        path.write_bytes(("\n".join(given) + end).encode(encoding))
        return path

    return write


def run(*arguments):
    return main(["estimate", *map(str, arguments)])


def refused(capsys, *arguments):
    """The message of a command that must fail."""
    assert run(*arguments) == 2
    error = capsys.readouterr().err
    assert error.startswith("curvcasadi: error: ")
    return error.removeprefix("curvcasadi: error: ").strip()


def table(path):
    return np.genfromtxt(path, delimiter=",", names=True)


# Estimates -------------------------------------------------------------------------------------


def test_a_wing_that_flaps_is_followed_by_four_imus_within_their_deviations(tmp_path, capsys):
    times, log, out = np.arange(300) * 0.01, tmp_path / "log.csv", tmp_path / "shape.csv"
    q = write_log(log, HALE_WING, times, missing=0.1)
    assert run(HALE_WING, log, "--out", out, "--plot", tmp_path / "shape.png") == 0
    found = table(out)
    np.testing.assert_allclose(found["time"], times, rtol=1e-8)  # nine digits in the log
    for k in range(6):
        normalized = (found[f"q{k}"] - q[k]) / found[f"std_q{k}"]
        # Errors of successive samples are alike: some of them, not 300, are independent.
        assert np.sqrt(np.mean(normalized**2)) < 2.0
    wing = load_estimation(HALE_WING).beam
    tip = pose_at(wing, q[:, -1], 1.0).position.full()[:, 0]
    for k, axis in enumerate("xyz"):
        assert abs(found[f"tip_{axis}"][-1] - tip[k]) < 4 * found[f"std_tip_{axis}"][-1]
    assert Image.open(tmp_path / "shape.png").format == "PNG"
    printed = capsys.readouterr()
    assert "300 samples of 2.99 s" in printed.out and printed.err == ""
    cells = next(line for line in printed.out.splitlines() if line.startswith("all")).split()
    values, missing, gated, used = map(int, cells[1:5])
    assert values == 24 * 300 and used == values - missing - gated
    holes = sum(line.count(",,") + line.endswith(",") for line in log.read_text().split("\n"))
    assert missing >= holes and 0.5 < float(cells[5]) < 1.5
    assert "check its unit" not in printed.out


def test_the_rows_are_those_of_the_filter_in_python(tmp_path, wing):
    """Irregular times, sensors of different rates, a row without any value."""
    rng = np.random.default_rng(0)
    times = np.cumsum(rng.uniform(0.001, 0.1, 40))
    lines = gauge_lines(wing, times)
    for k in range(1, 41):
        time, first, second = lines[k].split(",")
        lines[k] = f"{time},{first if k % 2 else ''},{second if k % 5 else 'nan'}"
    log, out = tmp_path / "log.csv", tmp_path / "shape.csv"
    log.write_text("\n".join([*lines, ""]))
    assert run(wing, log, "--out", out, "--stations", "0.5,0.75") == 0
    file = load_estimation(wing)
    rows = list(read_log(log, file.columns.values, print))
    start = file.start._replace(time=rows[0].time)
    expected = list(run_ekf(file.ekf, start, ((row.time, row.values) for row in rows)))
    found = table(out)
    for k, estimate in enumerate(expected):
        q, P = file.ekf.part(estimate, "q"), file.ekf.covariance(estimate, "q")
        row = found[k]
        # Nine digits are written.
        np.testing.assert_allclose([row["q0"], row["q1"]], q, rtol=1e-8, atol=1e-12)
        deviations = np.sqrt(np.diag(P))
        np.testing.assert_allclose([row["std_q0"], row["std_q1"]], deviations, rtol=1e-8)
        for name, xi in (("tip", 1.0), ("xi_05", 0.5), ("xi_075", 0.75)):
            pose = pose_at(file.beam, q, xi)
            J = (pose.rotation @ body_jacobian(file.beam, q, xi)[3:, :]).full()
            place = [row[f"{name}_{axis}"] for axis in "xyz"]
            np.testing.assert_allclose(place, pose.position.full()[:, 0], rtol=1e-8, atol=1e-9)
            spread = [row[f"std_{name}_{axis}"] for axis in "xyz"]
            np.testing.assert_allclose(spread, np.sqrt(np.diag(J @ P @ J.T)), rtol=1e-7, atol=1e-9)


@pytest.mark.skipif(shutil.which("gcc") is None, reason="needs gcc")
def test_a_compiled_filter_gives_the_same(tmp_path, wing, log):
    for name, options in (("a.csv", []), ("b.csv", ["--compile"])):
        assert run(wing, log(), "--out", tmp_path / name, *options) == 0
    a, b = (np.array(table(tmp_path / name).tolist()) for name in ("a.csv", "b.csv"))
    # Rounding, and the ninth digit.
    np.testing.assert_allclose(a, b, rtol=1e-8, atol=1e-12)


def test_a_log_without_a_value_is_a_prediction(tmp_path, wing, capsys):
    log = tmp_path / "log.csv"
    log.write_text("time,root,strain_2\n0,,\n4,,\n")
    assert run(wing, log, "--out", tmp_path / "shape.csv") == 0
    # A random walk of 0.1 rad/(m √s) for 4 s, from 0.3 rad/m.
    deviations = table(tmp_path / "shape.csv")["std_q0"]
    np.testing.assert_allclose(deviations, [0.3, np.sqrt(0.3**2 + 0.1**2 * 4)], rtol=1e-8)
    printed = capsys.readouterr()
    assert "no sensor has a value" in printed.out
    assert f"warning: {log}: no cell has a sample" in printed.err


def test_columns_may_stand_in_any_order(tmp_path, wing, log):
    path = log()
    assert run(wing, path, "--out", tmp_path / "a.csv") == 0
    lines = [line.split(",") for line in path.read_text().splitlines()]
    turned = tmp_path / "turned.csv"
    text = "\r\n".join(f'"{b}", {time} ,{a}' for time, a, b in lines)
    turned.write_bytes(b"\xef\xbb\xbf" + text.encode() + b"\r\n\r\n")
    assert run(wing, turned, "--out", tmp_path / "b.csv") == 0
    assert (tmp_path / "a.csv").read_text() == (tmp_path / "b.csv").read_text()


# The wing file ---------------------------------------------------------------------------------


def test_every_kind_of_sensor_and_every_option_has_a_key(tmp_path):
    path = tmp_path / "wing.toml"
    path.write_text(BEAM + ALL_KINDS)
    file = load_estimation(path)
    assert {type(sensor) for sensor in file.sensors} == set(SENSOR_KINDS.values())
    gyro, accelerometer, *_, camera = file.sensors
    np.testing.assert_array_equal(gyro.noise, [1e-3, 1e-3, 2e-3])
    np.testing.assert_array_equal(np.array(gyro.mounting), [[0, 1, 0], [-1, 0, 0], [0, 0, 1]])
    np.testing.assert_allclose(
        np.array(accelerometer.mounting), [[0, -1, 0], [1, 0, 0], [0, 0, 1]], atol=1e-15
    )
    np.testing.assert_array_equal(np.array(camera.pose.position)[:, 0], [1, 0, -3])
    np.testing.assert_array_equal(file.ekf.part(file.start, "q"), [0.1, -0.1])
    covariance = file.ekf.covariance(file.start, "q")
    np.testing.assert_allclose(covariance, np.diag([0.01, 0.04]), rtol=1e-14)
    assert file.columns.inputs == (
        *(f"root_omega_{axis}" for axis in "xyz"),
        *(f"parent_position_{axis}" for axis in "xyz"),
        *(f"root_v_{axis}" for axis in "xyz"),
    )
    assert file.columns.values[:6] == (
        *("imu_x", "imu_y", "imu_z"),
        *("accelerometer_1_x", "accelerometer_1_y", "accelerometer_1_z"),
    )


def test_motion_of_the_root_stands_in_the_log_and_keeps_its_last_value(tmp_path, capsys):
    path, log, out = (tmp_path / name for name in ("wing.toml", "log.csv", "shape.csv"))
    path.write_text(BEAM + ALL_KINDS)
    file = load_estimation(path)
    q, root = (
        np.array([0.1, -0.1]),
        RootMotion(gravity=[0, 0, 9.81], magnetic_field=[2e-5, 0, 4e-5]),
    )
    values = measure(file.sensors, file.beam, q, np.zeros(2), None, root).values.full()[:, 0]
    names = ["time", *file.columns.inputs, *file.columns.values]
    measured = ",".join(map(repr, values.tolist()))
    rest = ",".join("0" * len(file.columns.inputs))
    nothing = "," * (len(file.columns.inputs) - 1)
    rows = [f"0.1,{rest},{measured}", f"0.2,{nothing},{measured}", f"0.3,{rest},{measured}"]
    log.write_text("\n".join([",".join(names), *rows, ""]))
    # The attitude starts a quarter turn off in the file.
    upright = path.read_text().replace(
        "[[1, 0, 0], [0, 0, -1], [0, 1, 0]]", "[[1,0,0],[0,1,0],[0,0,1]]"
    )
    path.write_text(upright)
    assert run(path, log, "--out", out) == 0
    found = table(out)
    # At the truth from the start: the filter stays there, but for the 1e-9 of the last digit.
    np.testing.assert_allclose(found["q0"], 0.1, atol=1e-6)
    np.testing.assert_allclose(found["gyro_bias1_x"], 0.0, atol=1e-6)

    log.write_text("\n".join([",".join(names), rows[1], rows[2], ""]))
    message = refused(capsys, path, log, "--out", out)
    assert f"{log}: line 2, column root_omega_x: expected a number in the first sample" in message


def test_an_attitude_that_is_no_rotation_is_refused(tmp_path, capsys):
    path, log, out = (tmp_path / name for name in ("wing.toml", "log.csv", "shape.csv"))
    sensor = '[[sensors]]\nkind = "attitude"\nxi = 1.0\nnoise = 0.01\n'
    path.write_text(BEAM + FILTER + sensor)
    names = ",".join(load_estimation(path).columns.values)
    for entries, fault in (
        ("1,0,0,0,1,0,0,0,1.1", "expected orthonormal columns, to 0.01; found"),
        ("1,0,0,0,1,0,0,0,-1", "expected a right-handed frame, found the reflection"),
    ):
        log.write_text(f"time,{names}\n0,1,0,0,0,1,0,0,0,1\n1,{entries}\n2,{',' * 8}\n")
        message = refused(capsys, path, log, "--out", out)
        expected = "line 3, columns attitude_1_R_xx to attitude_1_R_zz of a rotation: "
        assert message.startswith(f"{log}: {expected}{fault} [[1.0, ")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (GAUGES, "", "sensors: expected one or more tables [[sensors]], found none"),
        (FILTER, "", "estimation: expected a table [estimation] with process"),
        ('"strain_gauge"\nname', '"strain"\nname', "[sensors 1] kind: expected one of rate_gyro, "),
        ("xi = 0.8", "xi = 1.8", "[sensors 2] xi: expected "),
        ("xi = 0.8", "x = 0.8", "[sensors 2] x: expected one of the keys kind, xi, noise, offset"),
        ("noise = 1e-4", "noise = -1", "[sensors 1] noise: expected "),
        ("offset = [0, 0.05]", "offset = [0, 0, 1]", "[sensors 1] offset: expected y and z"),
        ('name = "root"', 'name = "a b"', "[sensors 1] name: expected "),
        ('name = "root"', 'name = "strain_2"', "sensors: expected different names"),
        ('name = "root"', 'name = "time"', "sensors: expected other names than columns"),
        ("random_walk", "random", "[estimation] process: expected "),
        ("density = 0.1", "", "[estimation] density: expected a finite number or a list"),
        (
            "density = 0.1",
            "density = 0.1\ngates = 3",
            "[estimation] gates: expected one of the keys",
        ),
        ("density = 0.1", "density = [1, 2, 3]", "[estimation] density: expected 1 number or 2"),
        ("q = 0.3", "q_dot = 1\nq = 1", "[estimation] deviation: expected "),
        ("q = 0.3", "r = 1", "[estimation.deviation] r: expected one of the keys q,"),
        ("q = 0.3", "q = 0", "[estimation] deviation['q']: expected "),
        (
            "q = 0.3",
            "q = 0.3\n[estimation.mean]\nq = [0, 0.9]",
            "[estimation] mean['q'][1] (out_of_plane: Legendre 1): expected within Beam.weight_",
        ),
    ],
)
def test_a_wrong_wing_file_is_refused(tmp_path, wing, log, capsys, old, new, message):
    path = log()
    text = wing.read_text()
    assert old in text
    wing.write_text(text.replace(old, new, 1))
    assert refused(capsys, wing, path, "--out", tmp_path / "shape.csv").startswith(
        f"{wing}: {message}"
    )


def test_other_commands_take_a_wing_with_sensors(wing, capsys):
    assert main(["shape", str(HALE_WING)]) == 0


def test_a_wing_file_with_sensors_is_parsed_once(wing, monkeypatch):
    parsed, parse = [], tomllib.loads

    def loads(text):
        parsed.append(text)
        return parse(text)

    monkeypatch.setattr(tomllib, "loads", loads)
    load_estimation(wing)
    assert len(parsed) == 1


# The log ---------------------------------------------------------------------------------------

NUMBER = "expected a finite number, or an empty cell for a missing sample, found"


@pytest.mark.parametrize(
    ("line", "text", "message"),
    [
        (17, "0.15,abc,0", f"line 17, column root: {NUMBER} 'abc'"),
        (17, "0.15,1_000,0", f"line 17, column root: {NUMBER} '1_000'"),
        (17, "0.15,0,1.5e-", f"line 17, column strain_2: {NUMBER} '1.5e-'"),
        (17, "0.15,inf,0", "line 17, column root: expected a finite number"),
        (17, "0.15,0", "line 17: expected 3 cells, as in line 1, found 2"),
        (17, "0.15,0,0,0", "line 17: expected 3 cells, as in line 1, found 4"),
        (17, "0.02,0,0", "line 17, column time: expected no less than 0.14 s, the time of the s"),
        (
            17,
            "1.7e12,0,0",
            "line 17, column time: expected a time in s, found 1.7e+12, which l",
        ),
        (17, ",0,0", "line 17, column time: expected a time, s, found a missing one"),
        (17, "0.15,0,\0", "line 17: expected text, found a zero byte"),
        (17, "0.15,0,µ", "line 17: expected UTF-8 text, found the byte 0xb5"),
        (20, "0.18,0,abc", f"line 20, column strain_2: {NUMBER} 'abc'"),
        (1, "time,root", "line 1: expected names of columns, found no strain_2; all columns"),
        (1, "time,root,strain", "line 1: expected names of columns, found no strain_2; the unkno"),
        (1, "time,root,root", "line 1: expected names of columns, found no strain_2; twice root"),
        (1, "time;root;strain_2", "line 1: expected names of columns, found semicolons"),
        (1, "time\troot\tstrain_2", "line 1: expected names of columns, found tabs"),
        (1, "0,1,2", "line 1: expected names of columns, found only numbers"),
        (1, "", "line 1: expected names of columns, found an empty line"),
    ],
)
def test_a_wrong_log_is_refused_by_line_column_and_reason(
    tmp_path, wing, log, capsys, line, text, message
):
    out = tmp_path / "shape.csv"
    path = log({line: text}, encoding="latin-1")
    found = refused(capsys, wing, path, "--out", out)
    assert found.startswith(f"{path}: {message}")
    if line == 1:
        assert "time,root,strain_2" in found and not out.exists()
    else:
        # A header and what stood before.
        assert len(out.read_text().splitlines()) == line - 1
        assert f"samples before that line: {line - 2}, estimates of all of them in {out}" in found


@pytest.mark.parametrize(
    ("last", "end", "lost"),
    [
        ("0.19,0.01,0.0", "", "expected a line end, found none"),
        ("0.19,0.0", "", "expected a line end, found none"),
        ("", "\0\0\0\0", "expected a line end, found none"),
        ("0.1", "\n", "expected 3 cells, found 1"),
        ("0.19,0.01,-", "\n", "expected a number at the end, found '-'"),
        ("0.19,0.01,1.5e-", "\n", "expected a number at the end, found '1.5e-'"),
        ("0.19,0.01,na", "\n", "expected a number at the end, found 'na'"),
    ],
)
def test_a_last_line_that_was_cut_off_loses_nothing_before_it(
    tmp_path, wing, log, capsys, last, end, lost
):
    whole, out = tmp_path / "whole.csv", tmp_path / "shape.csv"
    assert run(wing, log(), "--out", whole) == 0
    capsys.readouterr()
    path = log({20: last}, end=end)
    assert run(wing, path, "--out", out) == 0
    assert capsys.readouterr().err.startswith(f"curvcasadi: warning: {path}: line 20: {lost}; ")
    assert out.read_text().splitlines() == whole.read_text().splitlines()[:19]


def test_a_log_without_a_sample_is_refused_and_keeps_an_older_result(tmp_path, wing, capsys):
    log, out = tmp_path / "log.csv", tmp_path / "shape.csv"
    out.write_text("older")
    for text, message in [
        ("time,root,strain_2\n", "line 2: expected a sample, found the end of the file"),
        ("time,root,strain_2\n0,1", "line 2: expected a line end, found none, and no sample"),
        ("", "line 1: expected names of columns, found an empty line or file"),
    ]:
        log.write_text(text)
        assert refused(capsys, wing, log, "--out", out).startswith(f"{log}: {message}")
    assert out.read_text() == "older"


def test_what_is_no_text_is_refused_without_reading_all_of_it(wing, tmp_path, capsys):
    log = tmp_path / "log.csv"
    log.write_bytes(b"x" * 3_000_000)
    message = refused(capsys, wing, log, "--out", tmp_path / "shape.csv")
    assert "line 1: expected a CSV file, found 1048576 bytes a line" in message


def test_digits_of_other_scripts_are_refused(tmp_path, wing, log, capsys):
    message = refused(capsys, wing, log({17: "0.15,0,\u0661"}), "--out", tmp_path / "shape.csv")
    assert f"line 17, column strain_2: {NUMBER} '\u0661'" in message


def test_a_time_in_milliseconds_is_found_where_it_begins_to_matter(tmp_path, capsys):
    log = tmp_path / "log.csv"
    write_log(log, HALE_WING, np.arange(40) * 0.01)
    header, *lines = log.read_text().splitlines()
    cells = [line.partition(",") for line in lines]
    late = [f"{1000 * float(time):g},{rest}" for time, _, rest in cells]
    log.write_text("\n".join([header, *late, ""]))
    message = refused(capsys, HALE_WING, log, "--out", tmp_path / "shape.csv")
    pattern = r"no number; weights left weight_bounds in line \d+, 10 s after the one before: "
    assert re.search(pattern + r"check the units of the log, time in s", message)


def test_wrong_units_are_named_by_their_sensor(tmp_path, capsys):
    """Degrees instead of radians: the gyros are gated."""
    log, out = tmp_path / "log.csv", tmp_path / "shape.csv"
    write_log(log, HALE_WING, np.arange(100) * 0.01)
    header, *lines = log.read_text().splitlines()
    gyros = np.array([name.startswith("gyro") for name in header.split(",")])
    rows = np.array([line.split(",") for line in lines], dtype=float)
    rows[:, gyros] = np.degrees(rows[:, gyros])
    np.savetxt(log, rows, delimiter=",", header=header, comments="")
    assert run(HALE_WING, log, "--out", out) == 0
    printed = capsys.readouterr().out
    for k in range(1, 5):
        pattern = rf"gyro_{k}: [5-9]\d\.\d% of its values are gated.*check its unit \(rad/s\)"
        assert re.search(pattern, printed)


# Files and ends --------------------------------------------------------------------------------


def test_wrong_paths_are_refused_before_anything_is_read_or_destroyed(tmp_path, wing, log, capsys):
    path, out = log(), tmp_path / "shape.csv"
    text = path.read_text()
    linked = tmp_path / "linked.csv"
    os.link(path, linked)
    for arguments, message in [
        (["--out", path], f"--out {path}: expected another file than the input {path}"),
        (["--out", linked], f"--out {linked}: expected another file than the input {path}"),
        (
            ["--out", tmp_path / "shape.npz"],
            f"--out {tmp_path / 'shape.npz'}: expected a file name",
        ),
        (
            ["--out", tmp_path / "no" / "s.csv"],
            f"--out {tmp_path / 'no' / 's.csv'}: expected an ex",
        ),
        (["--out", out, "--plot", tmp_path / "a.txt"], f"--plot {tmp_path / 'a.txt'}: expected a "),
        (["--out", out, "--stations", "0.5,2"], "--stations: expected numbers from 0 to 1"),
        (["--out", out, "--stations", "0.5,0.50"], "--stations: expected each station once"),
    ]:
        assert refused(capsys, wing, path, *arguments).startswith(message)
    assert path.read_text() == text and not out.exists()
    for missing in (tmp_path, tmp_path / "none.csv"):
        message = refused(capsys, wing, missing, "--out", out)
        assert message.startswith(f"{missing}: expected a readable file, found: ")


def test_an_interrupted_run_leaves_whole_lines_and_its_summary(
    tmp_path, wing, log, capsys, monkeypatch
):
    class Interrupted(RowStepper):
        calls = 0

        def step(self):
            Interrupted.calls += 1
            if Interrupted.calls == 8:
                raise KeyboardInterrupt
            super().step()

    whole, out = tmp_path / "whole.csv", tmp_path / "shape.csv"
    assert run(wing, log(), "--out", whole) == 0
    monkeypatch.setattr(estimate_command, "RowStepper", Interrupted)
    assert run(wing, log(), "--out", out) == 130
    assert out.read_text().splitlines() == whole.read_text().splitlines()[:8]
    printed = capsys.readouterr()
    assert "7 samples of 0.06 s" in printed.out
    assert "warning: interrupted: the log was read up to 0.06 s" in printed.err


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a full device")
def test_a_full_disk_is_named(tmp_path, wing, log, capsys):
    out = tmp_path / "full.csv"
    out.symlink_to("/dev/full")
    assert refused(capsys, wing, log(), "--out", out) == f"{out}: No space left on device"


def test_a_history_keeps_every_kth_row_of_all():
    history = History(["q0"], 8)
    for k in range(100):
        history.add(float(k), np.array([2.0 * k]))
    series = history.series
    # 16 rows apart: 100 rows do not fit in 8 at any smaller power of two.
    np.testing.assert_array_equal(series["time"], np.arange(0, 100, 16))
    np.testing.assert_array_equal(series["q0"], 2 * series["time"])


def test_memory_does_not_grow_with_the_log(tmp_path, wing):
    """Resident memory of the program, whole: 40 000 lines, which fill its buffers, and 160 000."""
    status = Path("/proc/self/status")
    if not status.exists():
        pytest.skip("needs /proc")
    # VmHWM and not ru_maxrss, which begins at the memory of the process that started this one.
    code = (
        "import sys; from curvcasadi.cli import main; assert main(sys.argv[1:]) == 0;"
        f"print(*[line.split()[1] for line in open({str(status)!r}) if line.startswith('VmHWM')])"
    )
    used = []
    for lines in (40_000, 160_000):
        log = tmp_path / f"{lines}.csv"
        log.write_text("\n".join([*gauge_lines(wing, 0.01 * np.arange(lines)), ""]))
        command = [sys.executable, "-c", code, "estimate", str(wing), str(log)]
        command += ["--out", str(tmp_path / "out.csv"), "--plot", str(tmp_path / "out.png")]
        done = subprocess.run(command, capture_output=True, text=True, check=True)
        used.append(int(done.stdout.split()[-1]))
        assert done.stderr == ""  # no bar where there is no terminal
        assert len((tmp_path / "out.csv").read_text().splitlines()) == lines + 1
    # kB. A list of the numbers of all rows would take 120 000 × 11 × 32 B = 42 MB more; figures of
    # one length differ by up to 7 MB from run to run.
    assert used[1] - used[0] < 15_000


def test_a_row_is_one_function_with_named_inputs(wing):
    file = load_estimation(wing)
    function, columns = row_function(file.ekf, [Point("tip", 1.0)])
    assert function.name_in() == ["state", "factor", "measured", "dt"]
    assert function.size1_out("shown") == len(columns) == 2 * 2 + 2 * 3


def test_samples_of_one_time_on_several_lines_count_as_those_of_one_line(tmp_path, wing, log):
    whole = log()
    header, *lines = whole.read_text().splitlines()
    split = tmp_path / "split.csv"
    rows = [
        part
        for time, root, strain in (line.split(",") for line in lines)
        for part in (f"{time},{root},", f"{time},,{strain}", f"{time},,{strain}")
    ]
    split.write_text("\n".join([header, *rows, ""]))
    for path, name in ((whole, "whole"), (split, "split")):
        assert run(wing, path, "--out", tmp_path / f"{name}_q.csv", "--no-progress") == 0
    one, other = (
        np.genfromtxt(tmp_path / f"{name}_q.csv", delimiter=",", names=True)
        for name in ("whole", "split")
    )
    assert one.dtype.names == other.dtype.names
    for name in one.dtype.names:
        # Gauges are linear in the weights: the order of updates does not matter. Nine digits are
        # written, of numbers below one.
        np.testing.assert_allclose(one[name], other[name], atol=3e-9)


def test_weights_that_no_sensor_sees_are_named(tmp_path, wing, log, capsys):
    torsion = '[basis]\ntorsion = { family = "legendre", n = 1 }'
    wing.write_text(wing.read_text().replace("[basis]", torsion))
    assert run(wing, log(), "--out", tmp_path / "q.csv", "--no-progress") == 0
    out = capsys.readouterr().out
    assert "torsion: Legendre 0: no reading changes with it" in out
    assert "out_of_plane" not in out[out.index("do not see") :].splitlines()[1]


def test_nothing_is_said_of_weights_that_sensors_see(tmp_path, wing, log, capsys):
    assert run(wing, log(), "--out", tmp_path / "q.csv", "--no-progress") == 0
    assert "do not see" not in capsys.readouterr().out
