"""What one sensor reads at its station, as `casadi.Function`s built from SX, one per kind."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import casadi as ca

from curvcasadi.kinematics.motion import unpack_motion
from curvcasadi.kinematics.state import StateLayout, StationMotion
from curvcasadi.lie import so3
from curvcasadi.sensors.frames import Frames, Mount
from curvcasadi.sensors.sensor import Sensor

_FRAMES = (9, 3, 9, 3, 6, 3)


@lru_cache(maxsize=64)
def value_function(kind: type[Sensor]) -> ca.Function:
    """(state, frames, mount) -> value (m, 1).

    The state is that of a march of the sensor's own order, without sums; frames are the fields of
    `Frames`, and the mount is `Sensor.mount`, stacked.
    """
    state = StateLayout(kind.order).symbol()
    frames, mount = ca.SX.sym("frames", sum(_FRAMES)), ca.SX.sym("mount", _mount_size(kind))
    at = unpack_motion(state, kind.order)
    value = kind.value(at, _unpack_frames(frames), _unpack_mount(kind, mount))
    return ca.Function(f"read_{kind.prefix}", [state, frames, mount], [value], {"cse": True})


@lru_cache(maxsize=256)
def derivative_function(
    kind: type[Sensor],
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
    kind: type[Sensor], order: int, n: int, columns: tuple[tuple[str, int], ...], still: bool
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


def _symbols(kind: type[Sensor], order: int, n: int) -> tuple[ca.SX, list[ca.SX], tuple[Any, ...]]:
    """State of a march with sums; frames, mount and sample; and what the first three mean."""
    state = StateLayout(order, n).symbol()
    frames, mount = ca.SX.sym("frames", sum(_FRAMES)), ca.SX.sym("mount", _mount_size(kind))
    measured = ca.SX.sym("measured", len(kind.components))
    meaning = unpack_motion(state, order), _unpack_frames(frames), _unpack_mount(kind, mount)
    return state, [frames, mount, measured], meaning


def _derivatives(
    kind: type[Sensor],
    columns: tuple[tuple[str, int], ...],
    measured: ca.SX,
    at: StationMotion,
    frames: Frames,
    mount: Mount,
) -> list[ca.SX]:
    """Value, residual, and its derivatives, one per column set."""
    value = kind.value(at, frames, mount)
    slopes = kind.slopes(at, frames, mount)
    if "twist" in slopes:
        slopes["root_gyro_bias"] = -slopes["twist"][:, :3]  # taken off a twist that is measured
    rows = len(kind.residual_components)
    error = kind.residual(value, measured)
    there = ca.logic_or(error < 0, error >= 0)
    by_variation = kind.residual_by_variation(ca.if_else(there, error, 0))
    if kind.may_be_hidden:
        seen = kind.in_view(at, frames, mount)
        slopes = {name: ca.if_else(seen, slope, 0) for name, slope in slopes.items()}
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


def _unpack_frames(vector: ca.SX) -> Frames:
    parts = _split(vector, _FRAMES)
    return Frames(ca.reshape(parts[0], 3, 3), parts[1], ca.reshape(parts[2], 3, 3), *parts[3:])


def _mount_size(kind: type[Sensor]) -> int:
    return sum(rows * columns for rows, columns in kind.mount_shapes().values())


def _unpack_mount(kind: type[Sensor], vector: ca.SX) -> Mount:
    shapes = kind.mount_shapes()
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
