"""Poses: attitude and position of one frame in another."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

import curvcasadi as cc
from tests.support import oracle

coordinates = st.floats(-3, 3, width=32)
poses = st.builds(
    lambda k, p: cc.Pose(rotation=Rotation.from_rotvec(k).as_matrix(), position=p),
    st.tuples(coordinates, coordinates, coordinates),
    st.tuples(coordinates, coordinates, coordinates),
)
property_test = settings(deadline=None, max_examples=25, derandomize=True)


def matrix(pose):
    return oracle.homogeneous(pose.rotation.full(), pose.position.full())


@property_test
@given(poses, poses)
def test_composition_is_the_product_of_homogeneous_matrices(a, b):
    assert_allclose(matrix(a @ b), matrix(a) @ matrix(b), atol=5e-15)  # rounding


@property_test
@given(poses, poses, poses)
def test_composition_is_associative(a, b, c):
    assert_allclose(matrix((a @ b) @ c), matrix(a @ (b @ c)), atol=2e-14)  # rounding


@property_test
@given(poses)
def test_inverse_and_identity(a):
    assert_allclose(matrix(a @ a.inverse()), np.eye(4), atol=1e-14)  # rounding of 5 m
    assert_allclose(matrix(a.inverse() @ a), np.eye(4), atol=1e-14)
    assert_allclose(matrix(a @ cc.Pose.identity()), matrix(a), rtol=0)


def test_deformation_map_is_the_transpose():
    R = oracle.rotation([0.3, -0.4, 0.5])
    pose = cc.Pose(rotation=R, position=[1, 2, 3])
    assert_allclose(pose.deformation_map, R.T, rtol=0)


def test_poses_hold_expressions(symbolic):
    p = symbolic.sym("p", 3)
    pose = cc.Pose(rotation=np.eye(3), position=p) @ cc.Pose(rotation=np.eye(3), position=[1, 2, 3])
    f = ca.Function("f", [p], [pose.position])
    assert_allclose(f([1, 1, 1]), [[2], [3], [4]], rtol=0)


@pytest.mark.parametrize(
    "fields, message",
    [
        (
            {"rotation": np.eye(2), "position": [0, 0, 0]},
            r"Pose\.rotation: expected shape \(3, 3\)",
        ),
        (
            {"rotation": np.diag([1, 1, -1]), "position": [0, 0, 0]},
            r"Pose\.rotation: expected a right-handed frame, found the reflection",
        ),
        (
            {"rotation": np.zeros((3, 3)), "position": [0, 0, 0]},
            r"Pose\.rotation: expected orthonormal columns, to 0.01; found",
        ),
        ({"rotation": np.eye(3), "position": [0, 0]}, r"Pose\.position: expected shape \(3, 1\)"),
        ({"rotation": np.eye(3), "position": [[0, 0, 0]]}, r"Pose\.position: .*found \(1, 3\)"),
        ({"rotation": np.eye(3), "position": [0, np.nan, 0]}, r"Pose\.position: expected finite"),
        ({"rotation": np.eye(3), "position": "abc"}, r"Pose\.position: expected numbers"),
        ({"rotation": ca.SX.sym("R", 9), "position": [0, 0, 0]}, r"Pose\.rotation: .*found \(9, 1"),
    ],
)
def test_pose_refuses_bad_input(fields, message):
    with pytest.raises(ValueError, match=message):
        cc.Pose(**fields)
