"""What one sensor reads at its station, as `casadi.Function`s built from SX, one per kind."""

from __future__ import annotations

from dataclasses import fields
from functools import lru_cache
from typing import Any

import casadi as ca

from curvcasadi.beam.pose import Pose
from curvcasadi.kinematics.motion import StationMotion, unpack_motion
from curvcasadi.lie import so3
from curvcasadi.sensors.kinds import AttitudeSensor, Camera, Sensor
from curvcasadi.sensors.readings import READINGS, Frames, Mount, in_view
from curvcasadi.symbolic.expressions import AnyExpr

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
) -> ca.Function:
    """(state, frames, mount, measured) -> value, residual, and its derivatives, one per column set.

    The state is that of a march of `order` with the sums of n weights. `columns` are names of what
    is varied, with sizes; what a sensor does not depend on gives zeros.
    """
    state, inputs, arguments = _symbols(kind, order, n)
    outputs = _derivatives(kind, columns, inputs[-1], *arguments)
    return ca.Function(f"differentiate_{kind.prefix}", [state, *inputs], [*outputs], {"cse": True})


@lru_cache(maxsize=256)
def row_function(
    kind: Any, order: int, n: int, columns: tuple[tuple[str, int], ...], still: bool
) -> ca.Function:
    """(state, frames, mount, measured) -> a row (columns + 1, 1) per residual.

    A row has the derivatives of the residual, then itself. An accelerometer after a march
    of order 1 has two inputs more, (q_dot, twist rate), without the latter where the root is
    `still`: see `_accelerated`; and (A_t, B_t) along q_ddot: see `_turning`.
    """
    state, inputs, (at, frames, mount) = _symbols(kind, order, n)
    measured, turned = inputs[-1], ca.SX(len(kind.residual_components), n)
    if kind.order > order:
        rates, sums = ca.SX.sym("rates", n if still else n + 6), ca.SX.sym("sums", 6 * n)
        inputs += [rates, sums]
        at = _accelerated(at, rates, None if still else frames.twist)
        turned = _turning(at, mount, sums)
    _, error, *blocks = _derivatives(kind, columns, measured, at, frames, mount)
    slopes = dict(zip(dict(columns), blocks, strict=True))
    slopes["q"] += turned
    rows = ca.horzsplit(ca.vertcat(*(slope.T for slope in slopes.values()), error.T))
    return ca.Function(f"read_{kind.prefix}", [state, *inputs], rows, {"cse": True})


def _symbols(kind: Any, order: int, n: int) -> tuple[ca.SX, list[ca.SX], tuple[Any, ...]]:
    """State of a march with sums; frames, mount and sample; and what the first three mean."""
    state = ca.SX.sym("state", 12 + 6 * order + 6 * n * (order + 1))
    frames, mount = ca.SX.sym("frames", sum(_FRAMES)), ca.SX.sym("mount", _mount_size(kind))
    measured = ca.SX.sym("measured", len(kind.components))
    meaning = unpack_motion(state, order), _unpack_frames(frames), _unpack_mount(kind, mount)
    return state, [frames, mount, measured], meaning


def _derivatives(
    kind: Any,
    columns: tuple[tuple[str, int], ...],
    measured: ca.SX,
    at: StationMotion,
    frames: Frames,
    mount: Mount,
) -> list[ca.SX]:
    """Value, residual, and its derivatives, one per column set."""
    value = READINGS[kind].value(at, frames, mount)
    slopes = READINGS[kind].slopes(at, frames, mount)
    if "twist" in slopes:
        slopes["root_gyro_bias"] = -slopes["twist"][:, :3]  # taken off a twist that is measured
    rows = len(kind.residual_components)
    error = residual(kind, value, measured)
    by_variation = ca.DM.eye(rows)
    if kind is AttitudeSensor:
        there = ca.logic_or(error < 0, error >= 0)
        by_variation = so3.right_jacobian_inverse(ca.if_else(there, error, 0))
    if kind is Camera:
        slopes["q"] = ca.if_else(in_view(at, frames, mount), slopes["q"], 0)
    blocks = [
        ca.densify(by_variation @ slopes[name]) if name in slopes else ca.SX.zeros(rows, size)
        for name, size in columns
    ]
    return [value, error, *blocks]


def _accelerated(at: StationMotion, rates: ca.SX, root_twist: ca.SX | None) -> StationMotion:
    """A station with its acceleration, from a march without, and rates (q_dot, V̇_0), no q_ddot.

    V̇ = V̇_0 + J_t q_dot, exactly. Of the second rate of J = [A; B] only what a turning root does to
    it, with V_0 the root's twist and ad(ω, v) (a, b) = (ω × a, v × a + ω × b):

        J_tt ≈ ad(V̇_0) J + 2 ad(V_0) J_t − ad(V_0)² J

    What is left out is the second rate of J relative to the root.
    """
    j, j_t = (ca.vertcat(*block) for block in at.sums)
    n = j.shape[1]
    acceleration, j_tt = j_t @ rates[:n], ca.SX(6, n)
    if root_twist is not None:
        ad, twist_rate = _ad(root_twist), rates[n:]
        acceleration += twist_rate
        j_tt = _ad(twist_rate) @ j + 2 * (ad @ j_t) - ad @ (ad @ j)
    sums = (*at.sums, (j_tt[:3, :], j_tt[3:, :]))
    return at._replace(acceleration=acceleration, sums=sums)


def _turning(at: StationMotion, mount: Mount, sums: ca.SX) -> ca.SX:
    """What q_ddot does to the derivative of an accelerometer by q: Rᵀ (B_t + A_t × P).

    `sums` are rates (A_t, B_t) of the spatial Jacobian along q_ddot.
    """
    a_t, b_t = (ca.reshape(part, 3, -1) for part in ca.vertsplit(sums, sums.numel() // 2))
    point = at.position + at.rotation @ mount.offset
    return mount.mounting.T @ at.rotation.T @ (b_t - so3.hat(point) @ a_t)


def _ad(twist: ca.SX) -> ca.SX:
    omega, v = so3.hat(twist[:3]), so3.hat(twist[3:])
    return ca.blockcat([[omega, ca.SX(3, 3)], [v, omega]])


def residual(kind: Any, value: AnyExpr, measured: AnyExpr) -> AnyExpr:
    """Prediction minus measurement; of an attitude log(R_measuredᵀ R).

    An attitude of a few digits is orthonormalized by one Newton step: of errors of 1e-3 it leaves
    1e-6.
    """
    if kind is not AttitudeSensor:
        return value - measured
    predicted: Any = ca.reshape(value, 3, 3)
    desired: Any = ca.reshape(measured, 3, 3)
    return so3.log_error(predicted, so3.orthonormal(desired))


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
