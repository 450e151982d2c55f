"""What one sensor reads at its station, as `casadi.Function`s built from SX, one per kind."""

from __future__ import annotations

from dataclasses import fields
from functools import lru_cache
from typing import Any

import casadi as ca

from curvcasadi.expressions import AnyExpr
from curvcasadi.kinematics import StationMotion, unpack_motion
from curvcasadi.lie import so3
from curvcasadi.pose import Pose
from curvcasadi.sensors.descriptions import AttitudeSensor, Sensor
from curvcasadi.sensors.readings import READINGS, Frames, Mount

#: Shapes of the fields of a sensor that may be symbols; that of a bias is its residual's.
_MOUNT = {"offset": (3, 1), "mounting": (3, 3), "pose": (3, 4)}
_FRAMES = (9, 3, 9, 3, 6, 3)


def mount_fields(sensor: Sensor) -> dict[str, AnyExpr]:
    """Fields of `sensor` that may be symbols, by name; a pose as (R, p), (3, 4)."""
    found = {}
    for entry in fields(sensor):
        value = getattr(sensor, entry.name)
        if isinstance(value, Pose):
            value = ca.horzcat(value.rotation, value.position)
        if entry.name in (*_MOUNT, "bias"):
            found[entry.name] = value
    return found


@lru_cache(maxsize=64)
def value_function(kind: Any) -> ca.Function:
    """(state, frames, mount) -> value (m, 1).

    The state is that of a march of the sensor's own order, without sums; frames are the fields of
    `Frames`, and the mount is `mount_fields`, stacked.
    """
    state = ca.SX.sym("state", 12 + 6 * kind.order)
    frames, mount = ca.SX.sym("frames", sum(_FRAMES)), ca.SX.sym("mount", _mount_size(kind))
    at = unpack_motion(state, kind.order)
    value = READINGS[kind].value(at, _unpack_frames(frames), _unpack_mount(kind, mount))
    return ca.Function(f"read_{kind.prefix}", [state, frames, mount], [value], {"cse": True})


@lru_cache(maxsize=256)
def derivative_function(
    kind: Any,
    order: int,
    n: int,
    columns: tuple[tuple[str, int], ...],
    *,
    short: bool = False,
    still: bool = False,
) -> ca.Function:
    """(state, frames, mount, measured) -> value, residual, and its derivatives, one per column set.

    The state is that of a march of `order` with the sums of n weights. `columns` are names of what
    is varied, with sizes; what a sensor does not depend on gives zeros. With `short` the outputs
    are the residual and all derivatives, stacked and transposed. An accelerometer after a march of
    order 1 has a further input, (q_dot, q_ddot, twist rate): see `_accelerated`; `still` says that
    the root is at rest.
    """
    state = ca.SX.sym("state", 12 + 6 * order + 6 * n * (order + 1))
    frames, mount = ca.SX.sym("frames", sum(_FRAMES)), ca.SX.sym("mount", _mount_size(kind))
    measured = ca.SX.sym("measured", len(kind.components))
    inputs = [state, frames, mount, measured]
    at, unpacked = unpack_motion(state, order), _unpack_frames(frames)
    if kind.order > order:
        inputs.append(ca.SX.sym("rates", 2 * n + 6))
        at = _accelerated(at, inputs[-1], None if still else unpacked.twist)
    arguments = at, unpacked, _unpack_mount(kind, mount)
    value = READINGS[kind].value(*arguments)
    slopes = READINGS[kind].slopes(*arguments)
    rows = len(kind.residual_components)
    error = residual(kind, value, measured)
    by_variation = ca.DM.eye(rows)
    if kind is AttitudeSensor:
        by_variation = so3.right_jacobian_inverse(error)
    blocks = [
        ca.densify(by_variation @ slopes[name]) if name in slopes else ca.SX.zeros(rows, size)
        for name, size in columns
    ]
    outputs = [value, error, *blocks]
    if short:
        outputs = [error, ca.vertcat(*(block.T for block in blocks))]
    return ca.Function(f"differentiate_{kind.prefix}", inputs, outputs, {"cse": True})


def _accelerated(at: StationMotion, rates: ca.SX, root_twist: ca.SX | None) -> StationMotion:
    """A station with its acceleration, from a march without, and rates (q_dot, q_ddot, V̇_0).

    V̇ = V̇_0 + J_t q_dot + J q_ddot, exactly. Of the second rate of J = [A; B] only what a turning
    root does to it, with V_0 the root's twist and ad(ω, v) (a, b) = (ω × a, v × a + ω × b):

        J_tt ≈ ad(V̇_0) J + 2 ad(V_0) J_t − ad(V_0)² J

    What is left out is the second rate of J relative to the root.
    """
    j, j_t = (ca.vertcat(*block) for block in at.sums)
    n = j.shape[1]
    q_dot, q_ddot, twist_rate = _split(rates, (n, n, 6))
    acceleration = twist_rate + j_t @ q_dot + j @ q_ddot
    j_tt = ca.SX(6, n)
    if root_twist is not None:
        ad = _ad(root_twist)
        j_tt = _ad(twist_rate) @ j + 2 * (ad @ j_t) - ad @ (ad @ j)
    sums = (*at.sums, (j_tt[:3, :], j_tt[3:, :]))
    return at._replace(acceleration=acceleration, sums=sums)


def _ad(twist: ca.SX) -> ca.SX:
    omega, v = so3.hat(twist[:3]), so3.hat(twist[3:])
    return ca.blockcat([[omega, ca.SX(3, 3)], [v, omega]])


@lru_cache(maxsize=64)
def turning_function(n: int, rows: int, first: int) -> ca.Function:
    """(state of a march of order 1, offset, mounting, slope) -> slope with what turns added.

    Rᵀ (B_t + A_t × P), transposed, from row `first` of a slope (rows, 3).
    """
    state = ca.SX.sym("state", 18 + 12 * n)
    offset, mounting = ca.SX.sym("offset", 3), ca.SX.sym("mounting", 3, 3)
    slope = ca.SX.sym("slope", rows, 3)
    at = unpack_motion(state, 1)
    a_t, b_t = at.sums[1]
    point = at.position + at.rotation @ offset
    turned = mounting.T @ at.rotation.T @ (b_t - so3.hat(point) @ a_t)
    after = slope[:, :]
    after[first : first + n, :] += turned.T
    return ca.Function("turning", [state, offset, mounting, slope], [after], {"cse": True})


def residual(kind: Any, value: AnyExpr, measured: AnyExpr) -> AnyExpr:
    """Prediction minus measurement; of an attitude log(R_measuredᵀ R)."""
    if kind is not AttitudeSensor:
        return value - measured
    predicted: Any = ca.reshape(value, 3, 3)
    return so3.log_error(predicted, ca.reshape(measured, 3, 3))


def _unpack_frames(vector: ca.SX) -> Frames:
    parts = _split(vector, _FRAMES)
    return Frames(ca.reshape(parts[0], 3, 3), parts[1], ca.reshape(parts[2], 3, 3), *parts[3:])


def _shapes(kind: Any) -> dict[str, tuple[int, int]]:
    shapes = {**_MOUNT, "bias": (len(kind.residual_components), 1)}
    return {entry.name: shapes[entry.name] for entry in fields(kind) if entry.name in shapes}


def _mount_size(kind: Any) -> int:
    return sum(rows * columns for rows, columns in _shapes(kind).values())


def _unpack_mount(kind: Any, vector: ca.SX) -> Mount:
    shapes = _shapes(kind)
    parts = _split(vector, tuple(rows * columns for rows, columns in shapes.values()))
    return Mount(
        **{
            name: ca.reshape(part, *shape)
            for (name, shape), part in zip(shapes.items(), parts, strict=True)
        }
    )


def _split(vector: ca.SX, sizes: tuple[int, ...]) -> list[ca.SX]:
    offsets = [0]
    for size in sizes:
        offsets.append(offsets[-1] + size)
    return list(ca.vertsplit(vector, offsets))
