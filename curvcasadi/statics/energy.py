"""Strain energy of a beam, and the stiffness of its weights."""

from __future__ import annotations

from itertools import pairwise
from typing import cast, overload
from weakref import WeakKeyDictionary

import casadi as ca
import numpy as np

from curvcasadi.beam.beam import Beam
from curvcasadi.beam.resolved import UNKNOWN, Resolved, resolved_points
from curvcasadi.beam.section import Section
from curvcasadi.symbolic.expressions import (
    AnyExpr,
    Array,
    Expr,
    Numbers,
    expression,
    is_numeric,
    same_kind,
)


@overload
def strain_energy(beam: Beam, q: Expr) -> Expr: ...
@overload
def strain_energy(beam: Beam, q: Numbers) -> ca.DM: ...
def strain_energy(beam: Beam, q: AnyExpr) -> AnyExpr:
    """Strain energy U = ½ L ∫ (K − K_0)ᵀ C (K − K_0) dxi = ½ qᵀ S q, for any weights.

    Parameters
    ----------
    beam : Beam
        With a section.
    q : SX, MX, DM or array, shape (n, 1)
        Curvature weights, rad/m.

    Returns
    -------
    SX, MX or DM, shape (1, 1)
        Strain energy, J.

    Raises
    ------
    ValueError
        If the beam has no section.
    """
    q = expression("q", q, (beam.basis.n, 1))
    matrix = stiffness_matrix(beam)
    same_kind(**{"q": q, "Beam.section and Beam.length": matrix})
    return q.T @ matrix @ q / 2


def stiffness_matrix(beam: Beam) -> AnyExpr:
    """Stiffness of the weights S = L ∫ Φᵀ C Φ dxi, (n, n), N m³: S q is the generalized moment.

    Integrated to 1e-11 on panels between the breaks and knots of basis and section, independent of
    the grid; a narrow function or table makes them as small as it needs.
    """
    if beam in _NUMBERS:
        return ca.DM(_NUMBERS[beam])
    if not isinstance(beam.section, Section):
        raise ValueError("Beam.section: expected a Section with stiffness, found None")
    matrix = _integrated(beam, beam.section)
    if isinstance(matrix, ca.DM):
        _NUMBERS[beam] = ca.DM(matrix)
    return matrix


#: Stiffness of beams without symbols, as long as these live.
_NUMBERS: WeakKeyDictionary[Beam, ca.DM] = WeakKeyDictionary()


def _integrated(beam: Beam, section: Section) -> AnyExpr:
    stiffness = section.stiffness
    points = _points(beam)
    phi = [beam.basis(float(xi)) for xi in points.xi]
    if not section.stiffness_varies:
        gram = np.einsum("p,pik,pjl->ijkl", points.weights, phi, phi)
        constant = stiffness(0.5)
        sums = [
            constant[i, j] * ca.sparsify(ca.DM(gram[i, j]))
            for i, j in np.argwhere(np.any(gram, axis=(2, 3))).tolist()
        ]
        return beam.length * sum(sums)
    total = 0
    for xi, weight, rows in zip(points.xi, points.weights, map(ca.DM, phi), strict=True):
        sparse = ca.sparsify(rows)
        total += weight * (sparse.T @ stiffness(float(xi)) @ sparse)
    return beam.length * total


def _points(beam: Beam) -> Resolved:
    """Gauss points that resolve basis and stiffness, symbols in it counted as ones."""
    basis, section = beam.basis, cast(Section, beam.section)
    knots = getattr(basis, "knots", None)
    known = knots is not None and section.stiffness_is_smooth_between_breaks
    stations = [*beam.breaks, *(knots or ())]

    counts = section.stiffness_varies and not (known and _is_symbolic(section))

    def integrand(xi: Array) -> Array:
        phi = np.array([basis(x) for x in xi.tolist()])
        if not counts:  # tables are linear between the stations at least: 16 points suffice
            return np.asarray(np.einsum("pik,pil->pkl", phi, phi))
        stiffness = _in_numbers([section.stiffness(x) for x in xi.tolist()])
        return np.asarray(np.einsum("pik,pij,pjl->pkl", phi, stiffness, phi, optimize=True))

    name = "Beam.basis and Beam.section" if section.stiffness_varies else "Beam.basis"
    return resolved_points(name, integrand, stations, 1 if known else UNKNOWN)


def _is_symbolic(section: Section) -> bool:
    stations = [0.0, *section.breaks, 1.0]
    middles = [(left + right) / 2 for left, right in pairwise(stations)]
    return any(not is_numeric(section.stiffness(xi)) for xi in middles)


def _in_numbers(stiffness: list[AnyExpr]) -> Array:
    """Matrices (P, 3, 3), their symbols replaced by ones."""
    stacked: AnyExpr = ca.horzcat(*stiffness)
    if not is_numeric(stacked):
        symbols = ca.symvar(stacked)
        stacked = ca.Function("at_ones", symbols, [stacked])(*[1] * len(symbols))
    return np.asarray(ca.DM(stacked).full().reshape(3, -1, 3).transpose(1, 0, 2))
