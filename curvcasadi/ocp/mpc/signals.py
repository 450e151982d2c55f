"""What a step is told of the stages to come: parameters and references, a column a stage."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from curvcasadi.control.signals import is_clock, stacked, with_nominal
from curvcasadi.ocp.mpc.problem import MpcProblem
from curvcasadi.ocp.mpc.terms import Penalty
from curvcasadi.symbolic.expressions import Array, Number, instance, numbers, rotation_matrix
from curvcasadi.symbolic.layout import Layout, Part

#: What the length of a quaternion may differ from 1.
_LENGTH = 5e-3


def parameters(
    layout: Layout, p: Any, preview: Mapping[str, Number], horizon: int, dt: float
) -> Array:
    """(np, N) parameters of the stages: previewed, given, or nominal; the time goes on.

    Raises
    ------
    ValueError
        If a parameter without a nominal value is not given, among others.
    """
    for key in instance("preview", preview, Mapping):
        _known("preview", layout.parts, key)
    given = with_nominal("p", layout, p, preview)
    values = np.tile(stacked("p", layout, given)[:, None], horizon)
    if is_clock(layout):
        values[layout.slices["time"]] += dt * (np.arange(horizon) + 0.5)
    for key, value in preview.items():
        part = _known("preview", layout.parts, key)
        values[layout.slices[key]] = _columns(f"preview[{key!r}]", part, value, horizon)
    return values


def rest(problem: MpcProblem, u_trim: Array) -> Array:
    """The reference (ng,) unless one is given: of the terminal equilibrium, or zero.

    Of attitudes the identity, of inputs the trimmed one.
    """
    if problem.terminal:
        return problem.goal(problem.terminal.x, problem.terminal.u, problem.terminal.y)
    return np.concatenate(
        [np.zeros(0), *(_neutral(problem, u_trim, penalty) for penalty in problem.penalties)]
    )


def references(problem: MpcProblem, at_rest: Array, given: Mapping[str, Number]) -> Array:
    """(ng, N) references of the stages; those at rest unless given."""
    penalties, horizon = problem.penalties, problem.count
    for key in instance("reference", given, Mapping):
        _known("reference", tuple(penalty.part for penalty in penalties), key)
    found, first = np.tile(at_rest[:, None], horizon), 0
    for penalty in penalties:
        part, name = penalty.part, f"reference[{penalty.part.name!r}]"
        if part.name in given:
            value = given[part.name]
            if penalty.is_rotation and _shape(value) == (3, 3):
                value = rotation_matrix(name, value).full().ravel(order="F")
            columns = _columns(name, part, value, horizon)
            _check_attitudes(name, penalty, columns)
            found[first : first + part.size] = columns
        first += part.size
    return found


def _neutral(problem: MpcProblem, u_trim: Array, penalty: Penalty) -> Array:
    if penalty.is_rotation:
        return np.tile(np.eye(3).ravel(), penalty.part.size // 9)
    if penalty.source == "u":
        return u_trim[problem.model.u.slices[penalty.part.name]]
    size = penalty.part.size
    return np.eye(size)[0] if penalty.part.attitude else np.zeros(size)


def _known(name: str, parts: Sequence[Part], key: str) -> Part:
    for part in parts:
        if part.name == key:
            return part
    names = ", ".join(part.name for part in parts) or "none"
    raise ValueError(f"{name}: expected names among {names}, found {key!r}")


def _shape(value: Number) -> tuple[int, ...]:
    """Shape of an array or of a DM, which numpy is not asked for."""
    return tuple(value.shape) if hasattr(value, "shape") else np.shape(value)


def _columns(name: str, part: Part, value: Number, n: int) -> Array:
    """(size, n) of numbers that are held, or of columns."""
    array = numbers(name, value)
    if array.size == part.size and (array.ndim < 2 or array.shape == (part.size, 1)):
        return np.tile(array.reshape(-1, 1), n)
    if array.shape == (part.size, n) or (part.size == 1 and array.shape == (n,)):
        return array.reshape(part.size, n)
    raise ValueError(
        f"{name}: expected {part.size} numbers or columns ({part.size}, {n}), "
        f"found shape {array.shape}"
    )


def _check_attitudes(name: str, penalty: Penalty, columns: Array) -> None:
    """Refuse columns of rotations that are none, and quaternions of another length than 1."""
    if penalty.is_rotation:
        for matrix in columns.T.reshape(-1, 3, 3):
            rotation_matrix(name, matrix.T)
    elif penalty.part.attitude:
        lengths = np.linalg.norm(columns, axis=0)
        worst = lengths[np.argmax(np.abs(lengths - 1))]
        if abs(worst - 1) > _LENGTH:
            raise ValueError(f"{name}: expected unit quaternions, found one of length {worst:g}")
