"""Tables of full section matrices, and what an inextensible, unshearable beam leaves out of them.

A section of a finite-element or multibody model has a stiffness S (6, 6) of its curvature K and its
strain ε = (stretch, shear in y, shear in z),

    (m, f) = S (K, ε).

The beam of this package has ε = 0. With the forces as they come, f = 0 to leading order, the
stiffness of its curvature is the Schur complement S_KK − S_Kε S_εε⁻¹ S_εK: its inverse is the block
of S⁻¹ that turns moments into curvature. What is lost is the strain by forces.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from curvcasadi.beam.along import Piecewise
from curvcasadi.beam.section import Section
from curvcasadi.symbolic.expressions import Array, Number, numbers, positive, symmetric

#: Gauss points of each interval: the deflection of the tip has polynomials of degree 2 over S.
_POINTS = 8
#: A mass matrix may differ from that of a rigid section by this part of its largest entry.
_ROUNDING = 1e-6


@dataclass(frozen=True, eq=False, kw_only=True)
class Condensation:
    """What condensing shear and extension does to a beam, clamped at the root, by linear theory.

    Attributes
    ----------
    shear_share_y, shear_share_z : float
        Part of the tip deflection under a tip force in y, and in z, that the beam leaves out: about
        3 EI/(GA L²) where the section is uniform.
    stretch : float
        Tip displacement along the beam by a unit axial tip force, m/N, that the beam leaves out.
    stiffening : float
        The largest part by which some bending or torsional stiffness would be too large if shear
        and extension were suppressed instead of condensed, over the stations.
    """

    shear_share_y: float
    shear_share_z: float
    stretch: float
    stiffening: float

    def __str__(self) -> str:
        return (
            f"shear left out of the tip deflection: {self.shear_share_y:.3%} in plane, "
            f"{self.shear_share_z:.3%} out of plane; stretch left out: {self.stretch:.3g} m/N; "
            f"suppressed instead of condensed it would be up to {self.stiffening:.3%} stiffer"
        )


@dataclass(frozen=True, eq=False, kw_only=True)
class SectionTable:
    """Full stiffness and mass of the sections along a beam, in its local axes.

    As many matrices as stations are linear between these, one fewer are constant in each interval.

    Attributes
    ----------
    xi : array, shape (m + 1,)
        Stations s/L from 0 to 1, increasing.
    stiffness : array, shape (m or m + 1, 6, 6)
        Of (K_x, K_y, K_z, stretch, shear y, shear z): N m², N m and N.
    mass : array, shape (m or m + 1, 6, 6)
        Per length, of the twist (ω, v) of the reference curve: kg m, kg and kg/m.
    length : float or None
        Length of the reference curve, m, where the file has it.
    """

    xi: Array
    stiffness: Array
    mass: Array
    length: float | None = None

    _section: Section = field(init=False, repr=False)

    def __post_init__(self) -> None:
        for name in ("stiffness", "mass"):
            values = numbers(f"SectionTable.{name}", getattr(self, name))
            if values.ndim != 3 or values.shape[1:] != (6, 6):
                raise ValueError(
                    f"SectionTable.{name}: expected shape (stations, 6, 6), found {values.shape}"
                )
            object.__setattr__(self, name, values)
        xi = [float(x) for x in self.xi]
        table = Piecewise(xi, tuple(self.stiffness))
        for x, matrix in zip(table.xi, self.stiffness, strict=False):
            symmetric(f"SectionTable.stiffness at xi = {x:g}", matrix, size=6, definite=True)
        object.__setattr__(self, "xi", np.array(xi))
        rigid = [_rigid(x, matrix) for x, matrix in zip(table.xi, self.mass, strict=False)]
        masses, centres, inertias = zip(*rigid, strict=True)
        section = Section.from_stiffness(
            Piecewise(xi, tuple(condense(matrix) for matrix in self.stiffness)),
            mass_per_length=Piecewise(xi, masses),
            center_of_mass=Piecewise(xi, centres),
            inertia=Piecewise(xi, inertias),
        )
        object.__setattr__(self, "_section", section)

    @property
    def section(self) -> Section:
        """The sections of a beam without shear and extension, at the stations of the table."""
        return self._section

    def condensation(self, length: float | None = None) -> Condensation:
        """What condensing shear and extension does to a beam of these sections.

        Parameters
        ----------
        length : float, optional
            Length of the beam, m; that of the table where None.

        Returns
        -------
        Condensation
            By linear theory, for the straight beam, clamped at the root.
        """
        if length is None and self.length is None:
            raise ValueError("length: expected a length, m, as the table has none, found None")
        span = float(positive("length", self.length if length is None else length))
        whole, bending = self._tip_flexibility(span)
        stiffening = max(
            float(np.linalg.eigvals(np.linalg.solve(condense(S), S[:3, :3])).real.max() - 1)
            for S in self.stiffness
        )
        share = 1 - np.diag(bending)[3:] / np.diag(whole)[3:]
        return Condensation(
            shear_share_y=float(share[1]),
            shear_share_z=float(share[2]),
            stretch=float(whole[3, 3] - bending[3, 3]),
            stiffening=stiffening,
        )

    def _tip_flexibility(self, length: float) -> tuple[Array, Array]:
        """∫ Wᵀ S⁻¹ W ds, (6, 6), whose W takes a wrench at the tip to s; and by curvature alone."""
        nodes, weights = np.polynomial.legendre.leggauss(_POINTS)
        stiffness = Piecewise(self.xi.tolist(), tuple(self.stiffness))
        whole, bending = np.zeros((6, 6)), np.zeros((6, 6))
        for left, right in zip(self.xi[:-1], self.xi[1:], strict=True):
            for node, weight in zip(nodes, weights, strict=True):
                xi = left + (right - left) * (node + 1) / 2
                step = weight * (right - left) / 2 * length
                W = np.eye(6)
                arm = (1 - xi) * length  # m = m_tip + arm e_x × f
                W[1, 5], W[2, 4] = -arm, arm
                flexibility = np.linalg.inv(stiffness(xi))
                whole += step * W.T @ flexibility @ W
                bending += step * W[:3].T @ flexibility[:3, :3] @ W[:3]
        return whole, bending


def condense(stiffness: Number) -> Array:
    """Stiffness of the curvatures of a section whose forces are zero.

    Parameters
    ----------
    stiffness : array, shape (6, 6)
        Symmetric, positive definite stiffness of (K_x, K_y, K_z, stretch, shear y, shear z).

    Returns
    -------
    ndarray, shape (3, 3)
        S_KK − S_Kε S_εε⁻¹ S_εK, N m².
    """
    S = symmetric("stiffness", stiffness, size=6, definite=True).full()
    return np.asarray(S[:3, :3] - S[:3, 3:] @ np.linalg.solve(S[3:, 3:], S[3:, :3]))


def _rigid(xi: float, matrix: Array) -> tuple[float, Array, Array]:
    """Mass, centre of mass and inertia about it of a section's mass matrix of (ω, v)."""
    m = matrix[3, 3]
    coupling = matrix[:3, 3:]  # m [c×]
    c = np.array([coupling[2, 1], coupling[0, 2], coupling[1, 0]]) / m
    c_hat = np.array([[0, -c[2], c[1]], [c[2], 0, -c[0]], [-c[1], c[0], 0]])
    expected = np.block([[matrix[:3, :3], m * c_hat], [m * c_hat.T, m * np.eye(3)]])
    fault = np.abs(matrix - expected).max()
    if not m > 0 or fault > _ROUNDING * np.abs(matrix).max():
        raise ValueError(
            f"SectionTable.mass at xi = {xi:g}: expected m I, m [c×] and an inertia of a rigid "
            f"section with m > 0, found a matrix that differs by {fault:.3g}"
        )
    inertia = matrix[:3, :3] - m * (c @ c * np.eye(3) - np.outer(c, c))
    return float(m), c, (inertia + inertia.T) / 2
