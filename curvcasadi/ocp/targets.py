"""Where stations shall be: targets and their residuals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from curvcasadi.beam.beam import Beam, numeric_length
from curvcasadi.kinematics.element import ON_GROUP
from curvcasadi.kinematics.pose_function import pose_function
from curvcasadi.lie import so3
from curvcasadi.ocp.pose_error import attitude_error, position_error
from curvcasadi.symbolic.expressions import (
    AnyExpr,
    Array,
    Number,
    expression,
    function_name,
    instance,
    numeric,
    own_fields,
    positive,
    rotation_defect,
    rotation_matrix,
    station,
)
from curvcasadi.symbolic.functions import function

#: Fraction of the length, and rad, within which a target counts as met unless it says otherwise.
TOLERANCE = 1e-6
_TOLERANCES = {"double": TOLERANCE, "float": 10 * TOLERANCE}


@dataclass(frozen=True, eq=False, kw_only=True)
class Target:
    """A position, an attitude, or both, for the local frame at one station; parent axes.

    Without `weight` it is to be met to its tolerance; with `weight` it is least squares,
    ½ weight (|Δp|²/L² + |Δφ|²), Δφ the rotation vector between the two attitudes.

    Attributes
    ----------
    xi : float
        Station s/L in [0, 1].
    position : array, symbol or None, shape (3, 1)
        Position, m, parent axes.
    rotation : array, symbol or None, shape (3, 3)
        Rotation from local to parent axes.
    weight : float or None
        Weight of a least-squares target, dimensionless; None for one that is to be met.
    tolerance : float or None
        Fraction of the length, and rad. Unless given 1e-6, and in `shape_target_function` of a beam
        for single precision 1e-5.
    """

    xi: float
    position: Number | None = None
    rotation: Number | None = None
    weight: float | None = None
    tolerance: float | None = None

    def __post_init__(self) -> None:
        own_fields(self)
        object.__setattr__(self, "xi", station("Target.xi", self.xi))
        if self.position is None and self.rotation is None:
            raise ValueError("Target: expected a position, a rotation or both, found neither")
        if self.position is not None:
            position = expression("Target.position", self.position, (3, 1))
            numeric("Target.position", position)
            object.__setattr__(self, "position", position)
        if self.rotation is not None:
            rotation = rotation_matrix("Target.rotation", self.rotation)
            numeric("Target.rotation", rotation)
            object.__setattr__(self, "rotation", rotation)
        for name in ("weight", "tolerance"):
            if getattr(self, name) is not None:
                numeric(f"Target.{name}", positive(f"Target.{name}", getattr(self, name)))
        if self.weight is not None and self.tolerance is not None:
            raise ValueError(
                "Target: expected a tolerance (to be met) or a weight (least squares), found both"
            )


@dataclass(frozen=True, eq=False, kw_only=True)
class Residuals:
    """Errors of targets as expressions of the weights and of the targets' values.

    Entries are fractions of the length and rad. The values are symbols, so that one solver serves
    every value of the same kind of targets.
    """

    positions: ca.MX  #: (3, P) desired positions, targets with a position in order
    rotations: ca.MX  #: (3, 3 R) desired attitudes, targets with a rotation in order
    to_meet: ca.MX  #: errors of the unweighted targets
    tolerances: Array  #: of `to_meet`, entry by entry
    leverages: Array  #: of curvature on `to_meet`, over that on the tip: xi² of positions, or xi
    weighted: ca.MX  #: errors of the weighted targets, times √weight
    missed: ca.MX  #: the same without their weights, over the tolerance of a target to be met
    distances: ca.MX  #: (P, 1) distances to the positions, m
    angles: ca.MX  #: (R, 1) angles to the attitudes, rad


def residuals(beam: Beam, targets: Sequence[Target], q: ca.MX) -> Residuals:
    """Residuals of `targets` at the MX weights `q`, with structured derivatives."""
    length = numeric_length(beam, "a shape target")
    stations = sorted({float(target.xi) for target in targets})
    position, rotation = pose_function("target_poses", beam, stations)(q)
    desired_positions = ca.MX.sym("positions", 3, sum(t.position is not None for t in targets))
    desired_rotations = ca.MX.sym("rotations", 3, 3 * sum(t.rotation is not None for t in targets))
    columns = iter(ca.horzsplit(desired_positions))
    frames = iter(ca.horzsplit(desired_rotations, 3))

    parts: dict[str, list[AnyExpr]] = {
        "to_meet": [],
        "tolerances": [],
        "leverages": [],
        "weighted": [],
        "missed": [],
        "distances": [],
        "angles": [],
    }
    for target in targets:
        k = stations.index(float(target.xi))
        errors, leverages = [], []
        arm = float(target.xi) or 1.0  # nothing moves the root
        if target.position is not None:
            error = position[:, k] - next(columns)
            errors.append(error / length)
            leverages += [arm**2] * 3
            parts["distances"].append(ca.norm_2(error))
        if target.rotation is not None:
            error = so3.log_error(rotation[:, 3 * k : 3 * k + 3], so3.orthonormal(next(frames)))
            errors.append(error)
            leverages += [arm] * 3
            parts["angles"].append(ca.norm_2(error))
        if target.weight is None:
            parts["to_meet"] += errors
            tolerance = float(target.tolerance or _TOLERANCES[beam.grid.real])
            parts["tolerances"] += [tolerance] * (3 * len(errors))
            parts["leverages"] += leverages
        else:
            parts["weighted"] += [np.sqrt(float(target.weight)) * error for error in errors]
            parts["missed"] += [error / _TOLERANCES[beam.grid.real] for error in errors]
    return Residuals(
        positions=desired_positions,
        rotations=desired_rotations,
        to_meet=_stack(parts["to_meet"]),
        tolerances=np.array(parts["tolerances"], dtype=float),
        leverages=np.array(parts["leverages"], dtype=float),
        weighted=_stack(parts["weighted"]),
        missed=_stack(parts["missed"]),
        distances=_stack(parts["distances"]),
        angles=_stack(parts["angles"]),
    )


def slopes(
    beam: Beam, targets: Sequence[Target], q: ca.MX, problem: Residuals
) -> tuple[tuple[ca.MX, ca.MX], tuple[ca.MX, ca.MX]]:
    """(errors to meet, their slopes by q), (weighted ones, theirs), of one march along the beam."""
    if beam.grid.exponential not in ON_GROUP:
        both = problem.to_meet, problem.weighted
        return tuple((e, ca.densify(ca.jacobian(e, q))) for e in both)  # type: ignore[return-value]
    length, n = numeric_length(beam, "a shape target"), beam.basis.n
    stations = sorted({float(target.xi) for target in targets})
    poses = pose_function("target_poses", beam, stations, jacobian=True)
    position, rotation, jacobian = poses(q)
    columns = iter(ca.horzsplit(problem.positions))
    frames = iter(ca.horzsplit(problem.rotations, 3))
    met: list[tuple[ca.MX, ca.MX]] = [(ca.MX(0, 1), ca.MX(0, n))]
    weighted = [*met]
    for target in targets:
        k = stations.index(float(target.xi))
        R, J = rotation[:, 3 * k : 3 * k + 3], jacobian[6 * k : 6 * k + 6, :]
        found, to = [], met if target.weight is None else weighted
        if target.position is not None:
            error, slope = position_error(n)(position[:, k], R, J, next(columns))
            found.append((error / length, slope / length))
        if target.rotation is not None:
            turned, by_q = attitude_error(n)(R, J, so3.orthonormal(next(frames)))
            found.append((turned, by_q))
        scale = 1.0 if target.weight is None else float(target.weight) ** 0.5
        to += [(scale * error, scale * slope) for error, slope in found]
    return tuple(  # type: ignore[return-value]
        tuple(ca.vertcat(*parts) for parts in zip(*pairs, strict=True)) for pairs in (met, weighted)
    )


def target_residual_function(
    beam: Beam, targets: Sequence[Target], *, name: str = "target_residual"
) -> ca.Function:
    """Errors of targets with what a Gauss–Newton step of one's own needs, for any of their values.

    Parameters
    ----------
    beam : Beam
        Beam whose stations have targets.
    targets : sequence of Target
        Stations and kinds; their numbers arrive as inputs.
    name : str
        Name of the Function, also in generated C.

    Returns
    -------
    casadi.Function
        Inputs: q (n, 1), rad/m; positions (3, P), m, if any; rotations (3, 3 R), if any. Outputs:
        residual e (m, 1), fractions of the length and rad, unweighted targets first, weighted ones
        times √weight; jacobian J = de/dq (m, n), structured; gradient Jᵀ e (n, 1) and hessian
        Jᵀ J (n, n) of ½ |e|².
    """
    function_name("name", name)
    q = ca.MX.sym("q", instance("beam", beam, Beam).basis.n)
    problem = residuals(beam, checked_problem(beam, targets), q)
    error = ca.vertcat(problem.to_meet, problem.weighted)
    jacobian = ca.jacobian(error, q)
    values = {"positions": problem.positions, "rotations": problem.rotations}
    inputs = {"q": q, **{key: value for key, value in values.items() if value.numel()}}
    outputs = {
        "residual": error,
        "jacobian": jacobian,
        "gradient": jacobian.T @ error,
        "hessian": jacobian.T @ jacobian,
    }
    return function(name, inputs, outputs)


def rotations_defect(rotations: ca.MX) -> ca.MX:
    """By how much (3, 3 R) matrices are no rotations, over 1e-2: at most 1 where all are ones."""
    defects = [rotation_defect(ca.vec(matrix)) for matrix in ca.horzsplit(rotations, 3)]
    return ca.mmax(ca.vertcat(ca.MX(0), *defects))


def _stack(parts: list[AnyExpr]) -> ca.MX:
    return ca.vertcat(ca.MX(0, 1), *parts)


def values_of(targets: Sequence[Target]) -> tuple[ca.DM, ca.DM]:
    """Numeric (positions, rotations) of `targets`, in the order of `Residuals`."""
    positions = [t.position for t in targets if t.position is not None]
    rotations = [t.rotation for t in targets if t.rotation is not None]
    return (
        ca.horzcat(*positions) if positions else ca.DM(3, 0),
        ca.horzcat(*rotations) if rotations else ca.DM(3, 0),
    )


def rest_values(beam: Beam, targets: Sequence[Target]) -> ca.DM:
    """Values, positions before rotations, that the straight or pre-bent beam, q = 0, meets."""
    stations = [float(target.xi) for target in targets]
    position, rotation = pose_function("target_poses", beam, stations)(0)
    positions = [position[:, k] for k, t in enumerate(targets) if t.position is not None]
    rotations = [
        rotation[:, 3 * k : 3 * k + 3] for k, t in enumerate(targets) if t.rotation is not None
    ]
    return ca.DM(ca.veccat(*positions, *rotations))


def checked_problem(beam: Beam, targets: Sequence[Target]) -> list[Target]:
    """`targets` as a list, for a numeric beam."""
    symbols = instance("beam", beam, Beam).design_symbols
    if symbols:
        field, symbol = next(iter(symbols.items()))
        raise ValueError(f"{field}: a shape target needs numbers, found the symbol {symbol}")
    found = list(targets) if np.iterable(targets) else []
    if not found or not all(isinstance(target, Target) for target in found):
        raise ValueError(f"targets: expected one or more Target, found {targets!r}")
    return found
