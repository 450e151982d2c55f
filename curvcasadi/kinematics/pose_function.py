"""Poses of stations as `casadi.Function`s with their structured Jacobian attached.

CasADi's own derivatives of anything built on these Functions use the sums of `kinematics` instead
of differentiating the chain.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any, Literal

import casadi as ca
import numpy as np

from curvcasadi.beam.beam import Beam
from curvcasadi.beam.pose import unpack_pose
from curvcasadi.kinematics import chain, jacobian as kinematics
from curvcasadi.kinematics.element import ON_GROUP
from curvcasadi.kinematics.shape import poses
from curvcasadi.kinematics.state import StateLayout
from curvcasadi.lie import so3
from curvcasadi.symbolic.derivatives import with_jacobian
from curvcasadi.symbolic.expressions import (
    AnyExpr,
    choice,
    function_name,
    instance,
    is_numeric,
    station,
)
from curvcasadi.symbolic.functions import free_symbols, function, identities

Form = Literal["compact", "unrolled"]
KINDS: dict[str, Any] = {"compact": ca.MX, "unrolled": ca.SX}


def tip_function(
    beam: Beam,
    form: Form = "compact",
    parameters: Mapping[str, AnyExpr] | None = None,
    jacobian: bool = False,
) -> ca.Function:
    """The tip pose as a Function "tip": q, parameters … -> position, rotation.

    Parameters
    ----------
    beam : Beam
        Beam whose tip pose is asked for.
    form : {"compact", "unrolled"}
        "compact" is a chain of calls in MX (small C, least memory), "unrolled" is SX (fastest in
        CasADi's virtual machine).
    parameters : mapping of str to symbol, optional
        Design symbols in the fields of `beam` (length, root, initial curvature), by the name of
        their input; MX for the compact form, SX for the unrolled one.
    jacobian : bool
        Whether to add an output "jacobian", the body Jacobian (6, n). It is a value only: its own
        derivatives are NaN, never silently zero.

    Returns
    -------
    casadi.Function
        Outputs position (3, 1), m, and rotation (3, 3), local to parent. The structured Jacobian is
        attached for every input; the approximate exponentials, which leave SO(3), have none, and
        CasADi differentiates their chain. Like every `casadi.Function` it takes any numbers: weight
        bounds and element angles are checked by `shape_map`, not here.

    Raises
    ------
    ValueError
        If a design symbol is of the other kind, or not among `parameters`.
    """
    return pose_function("tip", beam, (1.0,), form=form, parameters=parameters, jacobian=jacobian)


def pose_function(
    name: str,
    beam: Beam,
    stations: Sequence[float],
    form: Form = "compact",
    parameters: Mapping[str, AnyExpr] | None = None,
    jacobian: bool = False,
) -> ca.Function:
    """Poses of M numeric stations, q, parameters … -> position (3, M), rotation (3, 3 M).

    Columns stand in the order of `stations`.

    Parameters
    ----------
    name : str
        Name of the Function, also in generated C.
    beam : Beam
        Beam whose poses are asked for.
    stations : sequence of float
        Stations s/L in [0, 1], on or off the grid.
    form, parameters : optional
        As of `tip_function`.
    jacobian : bool
        Whether to add an output "jacobian", the body Jacobians on top of each other (6 M, n).

    Returns
    -------
    casadi.Function
        As that of `tip_function`.
    """
    function_name("name", name)
    instance("beam", beam, Beam)
    if not np.iterable(stations) or not len(stations):
        raise ValueError(f"stations: expected one or more numbers in [0, 1], found {stations!r}")
    stations = tuple(station("stations", xi) for xi in stations)
    kind = KINDS[choice("form", form, KINDS)]
    _check_parameters(beam, form, parameters or {})
    inputs = {"q": kind.sym("q", beam.basis.n), **(parameters or {})}
    values = _values(beam, stations, inputs["q"], jacobian)
    if beam.grid.exponential not in ON_GROUP:
        return function(name, inputs, values)
    return with_jacobian(name, inputs, values, _slopes(beam, stations, *inputs.values()))


def _values(
    beam: Beam, stations: tuple[float, ...], q: AnyExpr, jacobian: bool
) -> dict[str, AnyExpr]:
    """Outputs of a pose function by name."""
    if not jacobian:
        frames = poses(beam, q, stations)
        return {
            "position": ca.horzcat(*(frame.position for frame in frames)),
            "rotation": ca.horzcat(*(frame.rotation for frame in frames)),
        }
    states = kinematics.jacobian_states(chain.build(beam, stations), q)
    root = beam.root.packed
    finish = _pose_and_body_jacobian(beam.basis.n)
    position, rotation, body = zip(*(finish(state, root) for state in states), strict=True)
    return {
        "position": ca.horzcat(*position),
        "rotation": ca.horzcat(*rotation),
        "jacobian": ca.vertcat(*body),
    }


def _check_parameters(beam: Beam, form: Form, parameters: Mapping[str, AnyExpr]) -> None:
    kind = KINDS[form]
    instance("parameters", parameters, Mapping)
    taken = sorted({"q", "position", "rotation", "jacobian"} & set(parameters))
    if taken:
        raise ValueError(f"parameters: expected names of their own, found {', '.join(taken)}")
    for name, symbol in parameters.items():
        if not isinstance(symbol, kind) or not symbol.is_valid_input():
            raise ValueError(
                f"parameters[{name!r}]: form {form!r} takes {kind.__name__} symbols, "
                f"found {type(symbol).__name__} {symbol}"
            )
    if len(set(identities(parameters.values()))) < len(identities(parameters.values())):
        raise ValueError(f"parameters: expected each symbol once, found {dict(parameters)}")
    for field, value in beam.design_symbols.items():
        if not isinstance(value, kind):
            raise ValueError(
                f"{field}: form {form!r} takes {kind.__name__} symbols, "
                f"found {type(value).__name__} {value}"
            )
        missing = free_symbols(value, parameters.values())
        if missing:
            raise ValueError(
                f"{field}: expected its symbols among parameters, found {', '.join(missing)}"
            )


def _slopes(
    beam: Beam, stations: tuple[float, ...], q: AnyExpr, *symbols: AnyExpr
) -> dict[str, AnyExpr]:
    """Derivatives of position and rotation by q and design symbols, by name of the output."""
    parameters = ca.veccat(*symbols) if symbols else None
    beam_chain = chain.build(beam, stations, parameters)
    root = beam.root.packed
    d_root = _root_jacobian(root, parameters)
    finish = _derivatives(beam_chain.pattern.n, beam_chain.pattern.n_parameters)
    at_stations = [finish(s, root, d_root) for s in kinematics.jacobian_states(beam_chain, q)]
    position, rotation = (ca.vertcat(*part) for part in zip(*at_stations, strict=True))
    return {"position": position, "rotation": rotation}


def _root_jacobian(root: AnyExpr, parameters: AnyExpr | None) -> AnyExpr:
    if parameters is None:
        return ca.DM(12, 0)
    if is_numeric(root):
        return ca.DM.zeros(12, parameters.numel())
    return ca.densify(ca.jacobian(root, parameters))


@lru_cache(maxsize=64)
def _pose_and_body_jacobian(n: int) -> ca.Function:
    """(state relative to the root, root) -> p = p_0 + R_0 p_rel, R = R_0 R_rel, body Jacobian."""
    state, root = StateLayout(columns=n).symbol(), ca.SX.sym("root", 12)
    root_rotation, root_position = unpack_pose(root)
    rotation, position = unpack_pose(state)
    return ca.Function(
        "station_pose",
        [state, root],
        [
            root_position + root_rotation @ position,
            root_rotation @ rotation,
            kinematics.body_jacobian_of(state),
        ],
        ["state", "root"],
        ["position", "rotation", "jacobian"],
        {"cse": True},
    )


@lru_cache(maxsize=64)
def _derivatives(n: int, n_parameters: int) -> ca.Function:
    """(state relative to the root, root, d root) -> derivatives of p and vec R.

    p = p_0 + R_0 p_rel, R = R_0 R_rel, with dp_rel = B − [p_rel×] A and dR_rel = [A×] R_rel; the
    root's own derivatives enter by the parameters alone.
    """
    columns = n + n_parameters
    state = StateLayout(columns=columns).symbol()
    root, d_root = ca.SX.sym("root", 12), ca.SX.sym("d_root", 12, n_parameters)
    root_rotation, _ = unpack_pose(root)
    rotation, position = unpack_pose(state)
    a, b = kinematics.unpack_sums(state)
    d_position = root_rotation @ (b - so3.hat(position) @ a)
    d_rotation = ca.vertcat(*(-root_rotation @ so3.hat(rotation[:, k]) @ a for k in range(3)))
    unit = ca.SX.eye(3)
    d_position += ca.horzcat(ca.SX(3, n), ca.horzcat(ca.kron(position.T, unit), unit) @ d_root)
    d_rotation += ca.horzcat(ca.SX(9, n), ca.kron(rotation.T, unit) @ d_root[:9, :])
    return ca.Function(
        "station_derivatives",
        [state, root, d_root],
        [d_position, d_rotation],
        ["state", "root", "d_root"],
        ["d_position", "d_rotation"],
        {"cse": True},
    )
