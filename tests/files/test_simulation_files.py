"""Simulations in files and pictures."""

from __future__ import annotations

import numpy as np
import pytest
from PIL import Image

import curvcasadi as cc
from curvcasadi.files import load_weights
from curvcasadi.reference_wings import hale_wing

TIMES = np.linspace(0, 0.2, 3)


@pytest.fixture(scope="module")
def wing():
    return hale_wing(1, 1, 1)


@pytest.fixture(scope="module")
def motion(wing):
    model = cc.kinematic_model(wing, time_constant=0.5)
    return cc.simulate(model, {"q": [0, -0.03, 0]}, TIMES, u={"q_command": [0, -0.05, 0]})


def test_csv_has_a_column_for_each_entry_and_npz_an_array_for_each_part(tmp_path, motion):
    cc.write_simulation(tmp_path / "motion.csv", motion)
    table = np.genfromtxt(tmp_path / "motion.csv", delimiter=",", names=True)
    np.testing.assert_array_equal(table["time"], TIMES)
    np.testing.assert_array_equal(table["q1"], motion.x[1])
    np.testing.assert_array_equal(table["u_q_command1"], motion.u[1])
    cc.write_simulation(tmp_path / "motion.npz", motion)
    with np.load(tmp_path / "motion.npz") as arrays:
        np.testing.assert_array_equal(arrays["q"], motion.part("q").T)
        np.testing.assert_array_equal(arrays["y_position"], motion.part("position").T)


def test_weights_of_a_dynamic_simulation_are_read_back(tmp_path):
    path = tmp_path / "motion.csv"
    path.write_text("time,q0,q_dot0,u_flap0\n0,0.1,0,0\n1,0.2,0,0\n")
    times, weights = load_weights(path, 1)
    np.testing.assert_array_equal(times, [0, 1])
    np.testing.assert_array_equal(weights, [[0.1], [0.2]])


def test_another_ending_is_refused(tmp_path, motion):
    with pytest.raises(ValueError, match=r"ends in .csv or .npz, found .txt"):
        cc.write_simulation(tmp_path / "motion.txt", motion)


def test_pictures_take_simulations(tmp_path, wing, motion):
    figure = cc.plot_shape(wing, motion)
    last = cc.plot_shape(wing, motion.part("q")[:, -1])
    assert figure.get_suptitle() == last.get_suptitle()
    cc.animate_shape(wing, None, motion, tmp_path / "motion.gif", progress=False)
    with Image.open(tmp_path / "motion.gif") as image:
        assert image.n_frames == 3
    with pytest.raises(ValueError, match="times: expected None with a Simulation"):
        cc.animate_shape(wing, TIMES, motion, tmp_path / "motion.gif")
