"""The test wing in soromox, a soft-robot library on JAX; both are optional (the `compare` extra).

soromox's geometric-variable-strain model takes the same unknowns: six strains (curvature first, the
axis along x), of which only the curvatures are active, Legendre polynomials of 2 xi − 1 as their
basis, a reference strain e_x, a fixed root. It advances by the same two-point Magnus rule, in cells
between Gauss points of the link; their number is all that is chosen here.
"""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from soromox.systems.components import JointSpec, LinkSpec
from soromox.systems.gvs import GVS, GVSSegment, StrainBasisSpec

import curvcasadi as cc
from benchmarks.contender import Contender, batch_weights
from tests.support.wing import LENGTH, WEIGHTS, on_grid, position_error, tip_pose

jax.config.update("jax_enable_x64", True)


def contender(error: float) -> Contender:
    """soromox with the least number of Gauss points whose tip error is at most `error` (in L)."""
    points = _gauss_points(error)
    model = _model(points)

    def pose(q: Any) -> Any:
        return model.forward_kinematics(q, LENGTH)

    def pose_and_jacobian(q: Any) -> Any:
        return pose(q), model.jacobian_bodyframe(q, LENGTH)

    def position(q: Any) -> Any:
        return pose(q)[:3, 3]

    def finite() -> tuple[bool, bool]:
        first, zero = jax.jacfwd(position), jnp.zeros(WEIGHTS.size)
        values = first(zero), jax.jit(jax.jacfwd(first))(zero)
        return bool(np.all(np.isfinite(values[0]))), bool(np.all(np.isfinite(values[1])))

    return Contender(
        name="soromox on JAX (jit)",
        size=f"{points + 1} cells",
        point=jnp.asarray(WEIGHTS),
        batch=jnp.asarray(batch_weights().T),
        position=lambda q: np.asarray(position(jnp.asarray(q))),
        pose=_compiled(pose),
        pose_and_jacobian=_compiled(pose_and_jacobian),
        pose_batch=_compiled(jax.vmap(pose)),
        pose_and_jacobian_batch=_compiled(jax.vmap(pose_and_jacobian)),
        finite=finite,
    )


def _compiled(function: Any) -> Any:
    """`function` compiled; a call returns when the result is there."""
    jitted = jax.jit(function)
    return lambda q: jax.block_until_ready(jitted(q))


def _model(points: int) -> GVS:
    link = LinkSpec.circular(
        length=LENGTH,
        radius=0.1,  # radius, density and stiffness do not enter the kinematics
        density=1.0,
        reference_strain=[0, 0, 0, 1, 0, 0],
        stiffness=np.eye(WEIGHTS.size),
    )
    basis = StrainBasisSpec("legendre", ("kappa_x", "kappa_y", "kappa_z"), 3)
    segment = GVSSegment(
        link=link, joint=JointSpec(type="fixed"), basis=basis, num_gauss_points=points
    )
    return GVS.from_segments([segment], base_pose=jnp.array([0.0, 0, 0, 1, 0, 0, 0]))


def _gauss_points(error: float) -> int:
    """Found with this package's magnus4 on the same cells, which saves a compilation each."""
    points = 5
    while _error(points) > error:
        points += 1
    return points


def _error(points: int) -> float:
    nodes, _ = np.polynomial.legendre.leggauss(points)
    cells = cc.Grid(boundaries=np.concatenate([[0.0], (1 + nodes) / 2, [1.0]]))
    return position_error(tip_pose(on_grid(cells))[1])
