"""Limits that shapes keep while they reach for targets, and preferences among shapes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, cast

import casadi as ca
import numpy as np

from curvcasadi.beam.beam import Beam, numeric_length
from curvcasadi.beam.section import Section
from curvcasadi.kinematics.resolution import elements_that_may_exceed
from curvcasadi.kinematics.shape import curvature, squared_element_angles
from curvcasadi.statics.energy import stiffness_matrix
from curvcasadi.symbolic.expressions import (
    Array,
    Number,
    choice,
    is_numeric,
)

Regularizer = Literal["smoothness", "strain_energy"]
REGULARIZERS = ("smoothness", "strain_energy")


@dataclass(frozen=True, eq=False, kw_only=True)
class Limits:
    """Constraints lower ≤ expression ≤ upper on the shape, beside the bounds of the weights."""

    expression: ca.MX
    lower: Array
    upper: Array
    names: tuple[str, ...]  #: what each entry limits


def shape_limits(beam: Beam, q: ca.MX, curvature_bound: Number | None) -> Limits:
    """Limits of curvature at the stations, and of the elements that may exceed `Grid.max_angle`.

    Parameters
    ----------
    curvature_bound : rad/m, on |K_x|, |K_y|, |K_z|: one number, three (inf for none), or None
    """
    parts, lower, upper = [ca.MX(0, 1)], [np.zeros(0)], [np.zeros(0)]
    names: list[str] = []
    if curvature_bound is not None:
        bounds = _curvature_bounds(curvature_bound)
        rows = [int(row) for row in np.flatnonzero(np.isfinite(bounds))]
        for xi in beam.stations:
            parts.append(curvature(beam, q, xi)[rows])
            names += [f"K_{'xyz'[row]} at xi = {xi:.3g}" for row in rows]
            lower.append(-bounds[rows])
            upper.append(bounds[rows])
    beyond = elements_that_may_exceed(beam)
    if beyond:
        parts.append(squared_element_angles(beam, q)[beyond])
        names += [f"angle of element {e}" for e in beyond]
        lower.append(np.full(len(beyond), -np.inf))  # 0 would cut, linearized, what is allowed
        upper.append(np.full(len(beyond), beam.grid.max_angle**2))
    return Limits(
        expression=ca.vertcat(*parts),
        lower=np.concatenate(lower),
        upper=np.concatenate(upper),
        names=tuple(names),
    )


def _curvature_bounds(value: Number) -> Array:
    try:
        bounds = np.array(np.broadcast_to(np.asarray(value, dtype=float), (3,)))
    except (TypeError, ValueError):
        bounds = np.full(3, np.nan)
    if not np.all(bounds > 0):
        raise ValueError(
            f"curvature_bound: expected one or three numbers above zero, rad/m, found {value!r}"
        )
    return bounds


def regularizer_matrix(beam: Beam, regularizer: Regularizer) -> ca.DM:
    """Dimensionless matrix W (n, n), m² rad⁻², of the preference ½ qᵀ W q among shapes.

    "smoothness": L² ∫ |K − K_0|² + |d(K − K_0)/dxi|² dxi, slopes by differences between samples;
    "strain_energy": the strain energy over (largest rigidity)/L.
    """
    choice("regularizer", regularizer, REGULARIZERS)
    length = numeric_length(beam, "a regularizer")
    if regularizer == "smoothness":
        samples = np.linspace(0, 1, 201)
        phi = np.array([beam.basis(xi) for xi in samples])
        slope = np.diff(phi, axis=0) / np.diff(samples)[:, None, None]
        middle = (phi[1:] + phi[:-1]) / 2
        gram = sum(np.einsum("sij,sik->jk", f, f) for f in (middle, slope)) / len(slope)
        return ca.DM(length**2 * gram)
    matrix, section = stiffness_matrix(beam), cast(Section, beam.section)
    if not is_numeric(matrix):
        raise ValueError("Beam.section: a regularizer needs numbers, found symbols")
    largest = max(float(ca.mmax(section.stiffness(xi))) for xi in beam.stations)
    return ca.DM(matrix * length / largest)
