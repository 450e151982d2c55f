"""Logs as loggers write them: units of time, repeated times, quaternions."""

from __future__ import annotations

import numpy as np
import pytest

from curvcasadi.files.log import read_log
from curvcasadi.lie import so3

ENTRIES = [f"imu_R_{row}{column}" for column in "xyz" for row in "xyz"]


def rows(tmp_path, text, columns=("gauge",)):
    path, warnings = tmp_path / "log.csv", []
    path.write_text(text)
    return list(read_log(path, columns, warnings.append)), warnings


@pytest.mark.parametrize(
    ("column", "times"),
    [
        ("time", ("0.5", "0.51")),
        ("time_s", ("0.5", "0.51")),
        ("time_ms", ("500", "510")),
        ("time [us]", ("500000", "510000")),
        ("timestamp_ns", ("500000000", "510000000")),
    ],
)
def test_the_name_of_the_time_column_says_its_unit(tmp_path, column, times):
    found, warnings = rows(tmp_path, f"{column},gauge\n{times[0]},1\n{times[1]},2\n")
    # One rounding of the product.
    np.testing.assert_allclose([row.time for row in found], [0.5, 0.51], rtol=1e-15)
    assert not warnings


def test_whole_steps_of_many_seconds_are_named(tmp_path):
    _, warnings = rows(tmp_path, "time,gauge\n0,1\n10,2\n20,3\n")
    (warning,) = warnings
    assert "line 3, column time: the first step of 10 is taken as seconds" in warning
    assert "time_ms" in warning


@pytest.mark.parametrize(("time", "unit"), [("1.7e12", "ms"), ("1.7e15", "us"), ("1.7e18", "ns")])
def test_times_since_1970_that_are_no_seconds_are_refused_by_their_unit(tmp_path, time, unit):
    with pytest.raises(ValueError, match=f"looks like {unit} since 1970: .* time_{unit}"):
        rows(tmp_path, f"time,gauge\n{time},1\n")
    found, _ = rows(tmp_path, f"time_{unit},gauge\n{time},1\n")
    assert found[0].time == pytest.approx(1.7e9)


def test_lines_of_one_time_are_samples_of_that_time(tmp_path):
    found, warnings = rows(tmp_path, "time,a,b\n0,1,\n0,,2\n0.1,3,\n", ("a", "b"))
    assert [row.time for row in found] == [0, 0, 0.1]
    np.testing.assert_array_equal([row.values for row in found[:2]], [[1, np.nan], [np.nan, 2]])
    assert not warnings


def test_a_line_that_repeats_the_one_before_is_left_out(tmp_path):
    found, warnings = rows(tmp_path, "time,gauge\n0,1\n0,1\n0.1,1\n0.1,1\n0.1,2\n")
    assert [(row.time, *row.values) for row in found] == [(0, 1), (0.1, 1), (0.1, 2)]
    assert warnings[0].endswith("left out 2 lines that repeat the line before")


def test_a_quaternion_is_the_rotation_of_its_matrix(tmp_path):
    angle, axis = 0.7, np.array([2.0, -1.0, 2.0]) / 3
    w, x, y, z = np.cos(angle / 2), *np.sin(angle / 2) * axis
    text = f"time,imu_q_x,imu_q_y,imu_q_z,imu_q_w\n0,{x},{y},{z},{w}\n1,,,,\n"
    found, _ = rows(tmp_path, text, ENTRIES)
    expected = so3.exp(angle * axis).full().ravel(order="F")
    # Rounding of a few products.
    np.testing.assert_allclose(found[0].values, expected, atol=1e-14)
    assert np.isnan(found[1].values).all() and len(found[1].values) == 9


def test_what_is_no_unit_quaternion_is_refused(tmp_path):
    with pytest.raises(ValueError, match=r"line 2, columns imu_q_w to imu_q_z: .* length 2"):
        rows(tmp_path, "time,imu_q_w,imu_q_x,imu_q_y,imu_q_z\n0,2,0,0,0\n", ENTRIES)
