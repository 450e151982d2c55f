"""Every example runs headless in an empty folder and answers its question."""

import runpy
from pathlib import Path

import numpy as np
import pytest

EXAMPLES = Path(__file__).parents[1] / "ocp_examples"


def run(name, folder):
    return runpy.run_path(str(EXAMPLES / f"{name}.py"))["main"](folder / "out")


def test_every_example_is_tested():
    assert {path.stem for path in EXAMPLES.glob("*.py")} == {
        "match_measured_shape",
        "reach_tip_pose",
        "track_tip_path_mpc",
    }


def test_reach_tip_pose_meets_the_pose(tmp_path):
    result = run("reach_tip_pose", tmp_path)
    assert result.reached
    assert result.distances[0] < 16e-6 and result.angles[0] < 1e-6  # the default tolerance
    assert (tmp_path / "out" / "reach_tip_pose.png").exists()


def test_match_measured_shape_leaves_the_noise(tmp_path):
    ratio = run("match_measured_shape", tmp_path)
    # 21 degrees of freedom: the residual's standard deviation is 1/sqrt(42) of it; three of these.
    assert ratio == pytest.approx(1, abs=3 / np.sqrt(42))


def test_track_tip_path_recovers_from_the_disturbance(tmp_path):
    distance = run("track_tip_path_mpc", tmp_path)
    # The disturbance moves the tip by half a metre; each step the observer leaves 0.7 of the error.
    assert distance.max() > 0.3
    assert distance[-1] < 1e-3
    assert (tmp_path / "out" / "track_tip_path_mpc.png").exists()
