"""Shape histories: many weight vectors, one shape map."""

import re

import numpy as np
import pytest

from curvcasadi.kinematics.history import shape_history
from curvcasadi.kinematics.shape import pose_at, shape_map, squared_element_angles
from curvcasadi.reference_wings import hale_wing

WING = hale_wing()
WEIGHTS = np.random.default_rng(1).uniform(-0.04, 0.04, (5, WING.basis.n))


def test_every_sample_is_the_shape_map_of_its_weights():
    history = shape_history(WING, WEIGHTS, times=[0, 1, 2, 3, 5])
    assert history.positions.shape == (5, 3, 17) and history.deformation_maps.shape == (5, 17, 3, 3)
    np.testing.assert_array_equal(history.times, [0, 1, 2, 3, 5])
    for k, q in enumerate(WEIGHTS):
        shape = shape_map(WING, q)
        # The same arithmetic on 16 m: only rounding, some 1e-15 of the length, remains.
        np.testing.assert_allclose(history.positions[k], shape.positions.full(), atol=1e-13)
        maps = [pose.deformation_map.full() for pose in shape.poses]
        np.testing.assert_allclose(history.deformation_maps[k], maps, atol=1e-14)
        squared = squared_element_angles(WING, q).full().ravel()
        np.testing.assert_allclose(history.element_angles[k] ** 2, squared, rtol=1e-12)


def test_stations_off_the_grid_are_those_of_pose_at():
    history = shape_history(WING, WEIGHTS[0], stations=[0.0, 0.123, 1.0])
    pose = pose_at(WING, WEIGHTS[0], 0.123)
    np.testing.assert_allclose(history.positions[0, :, 1:2], pose.position.full(), atol=1e-13)
    maps = history.deformation_maps[0, 1]
    np.testing.assert_allclose(maps, pose.deformation_map.full(), atol=1e-14)


def test_samples_without_times_are_numbered():
    np.testing.assert_array_equal(shape_history(WING, WEIGHTS).times, [0, 1, 2, 3, 4])


@pytest.mark.parametrize(
    ("row", "message"),
    [
        ([0.2] + [0] * 8, "line 7: q[0] (torsion: Legendre 0): expected within"),
        ([np.nan] + [0] * 8, "line 7: q: expected finite numbers"),
    ],
)
def test_a_row_that_the_shape_map_refuses_is_named(row, message):
    with pytest.raises(ValueError, match=re.escape(message)):
        shape_history(WING, [WEIGHTS[0], row], names=["line 6: q", "line 7: q"])


def test_an_element_that_turns_too_far_is_refused_with_its_row():
    stiff = hale_wing(grid=type(WING.grid).uniform(2, max_angle=0.3))
    row = np.zeros(9)
    row[3] = 0.05  # 0.05 rad/m over 8 m: 0.4 rad an element
    with pytest.raises(ValueError, match=r"weights\[1\]: expected every element .* found 0\.4 rad"):
        shape_history(stiff, [np.zeros(9), row])


def test_weights_beyond_their_bounds_by_solver_tolerance_pass():
    row = np.zeros(9)
    row[0] = 0.15 * (1 + 1e-7)
    assert shape_history(WING, row).weights[0, 0] > 0.15


@pytest.mark.parametrize("weights", [np.zeros(8), np.zeros((2, 3, 9)), np.zeros((0, 9))])
def test_weights_of_another_shape_are_refused(weights):
    with pytest.raises(ValueError, match=r"weights: expected shape \(T, 9\), found"):
        shape_history(WING, weights)


@pytest.mark.parametrize(
    ("times", "message"),
    [
        ([0, 1], r"expected shape \(3,\), found \(2,\)"),
        ([0, 1, 1], "increasing"),
        ([0, 1, np.nan], "finite"),
    ],
)
def test_wrong_times_are_refused(times, message):
    with pytest.raises(ValueError, match=f"times: .*{message}"):
        shape_history(WING, np.zeros((3, 9)), times)
