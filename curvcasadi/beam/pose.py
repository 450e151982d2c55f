"""Poses: attitude and position of one frame in another."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from curvcasadi.symbolic.expressions import (
    AnyExpr,
    Expr,
    Number,
    copied,
    expression,
    instance,
    is_numeric,
    rotation_matrix,
)
from curvcasadi.symbolic.text import shown


@dataclass(frozen=True, eq=False, kw_only=True)
class Pose:
    """A local frame in a parent frame, T = (R, p). Fields may be CasADi expressions.

    Attributes
    ----------
    rotation : array or expression, shape (3, 3)
        Rotation R from local to parent axes; its columns are the local axes. Numbers must be a
        rotation to 1e-2, and are orthonormalized.
    position : array or expression, shape (3, 1)
        Position p, m, parent axes.
    """

    rotation: Number
    position: Number

    def __post_init__(self) -> None:
        rotation = rotation_matrix("Pose.rotation", self.rotation)
        position = expression("Pose.position", self.position, (3, 1))
        for name, value in (("rotation", rotation), ("position", position)):
            value = value if is_numeric(value) else copied(value)  # numbers are a copy already
            object.__setattr__(self, name, value)

    def __str__(self) -> str:
        if not is_numeric(self.rotation):
            return f"{shown(self.position, 'm')}, symbolic rotation, parent axes"
        axes = "x axis along {}, z axis along {}".format(
            *(shown(self.rotation[:, k]) for k in (0, 2))
        )
        return f"{shown(self.position, 'm')}, {axes}, parent axes"

    @property
    def packed(self) -> AnyExpr:
        """(vec R, p) (12, 1), as `unpack_pose` reads it."""
        return ca.veccat(self.rotation, self.position)

    @classmethod
    def identity(cls) -> Pose:
        """The parent frame itself.

        Returns
        -------
        Pose
            With the identity rotation at the origin.
        """
        return cls(rotation=ca.DM.eye(3), position=ca.DM.zeros(3))

    @property
    def deformation_map(self) -> AnyExpr:
        """D = Rᵀ (3, 3), parent to local (Eqs. 2 and 9)."""
        return self.rotation.T

    def __matmul__(self, other: Pose) -> Pose:
        """This pose followed by `other`, which is given in this local frame."""
        return pose_of(
            self.rotation @ other.rotation, self.position + self.rotation @ other.position
        )

    def inverse(self) -> Pose:
        """The parent frame in the local frame, (Rᵀ, −Rᵀ p).

        Returns
        -------
        Pose
            Of the parent frame.
        """
        return pose_of(self.rotation.T, -(self.rotation.T @ self.position))


def pose_of(rotation: AnyExpr, position: AnyExpr) -> Pose:
    """A pose of matrices that nobody else holds and that need no check: results of the library."""
    pose = object.__new__(Pose)
    object.__setattr__(pose, "rotation", rotation)
    object.__setattr__(pose, "position", position)
    return pose


def unpack_pose(state: Expr) -> tuple[Expr, Expr]:
    """(R, p) of a vector that begins with (vec R, p)."""
    rotation: Expr = ca.reshape(state[:9], 3, 3)
    return rotation, state[9:12]


def checked_pose(name: str, pose: Pose) -> Pose:
    """`pose` with a rotation by `rotation_matrix`: numbers with a few digits orthonormalized."""
    rotation = rotation_matrix(f"{name}.rotation", instance(name, pose, Pose).rotation)
    return Pose(rotation=rotation, position=pose.position) if is_numeric(rotation) else pose
