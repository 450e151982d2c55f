"""Strain energy of a beam, and the stiffness of its weights."""

from __future__ import annotations

from itertools import pairwise

import casadi as ca
import numpy as np

from curvcasadi.beam.beam import Beam
from curvcasadi.beam.section import Section
from curvcasadi.symbolic.expressions import AnyExpr, expression, same_kind

#: Gauss points per panel beyond the number of basis functions, for bases that are not polynomial.
_EXTRA_POINTS = 12


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

    Gauss points between the breaks of basis and section, independent of the grid: exact for
    polynomial bases and constant sections.
    """
    if not isinstance(beam.section, Section):
        raise ValueError("Beam.section: expected a Section with stiffness, found None")
    basis, section = beam.basis, beam.section
    nodes, weights = np.polynomial.legendre.leggauss(basis.n + _EXTRA_POINTS)
    total = 0
    for left, right in pairwise([0.0, *beam.breaks, 1.0]):
        for node, weight in zip(nodes, weights, strict=True):
            xi = left + (right - left) * (1 + node) / 2
            phi = ca.sparsify(ca.DM(basis(xi)))
            total += weight * (right - left) / 2 * (phi.T @ section.stiffness(xi) @ phi)
    return beam.length * total
