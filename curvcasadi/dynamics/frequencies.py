"""Small vibrations of a beam about an equilibrium: natural frequencies and modes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from curvcasadi.beam.beam import Beam
from curvcasadi.beam.pose import unpack_pose
from curvcasadi.dynamics import system
from curvcasadi.dynamics.derivatives import differentiate
from curvcasadi.dynamics.mass import check_invertible
from curvcasadi.kinematics import jacobian as kinematics
from curvcasadi.kinematics.root_motion import RootMotion
from curvcasadi.lie import so3
from curvcasadi.symbolic.expressions import Array, instance, is_numeric, numbers
from curvcasadi.symbolic.text import described

#: Unsymmetric or gyroscopic parts below this fraction of a matrix are rounding.
_ROUNDING = 1e-9


#: Modes that are printed.
_SHOWN = 12


@dataclass(frozen=True, eq=False, kw_only=True)
class VibrationModes:
    """Modes of small vibrations about an equilibrium, one per weight.

    Attributes
    ----------
    frequencies : array, shape (n,)
        Natural frequencies, rad/s, ascending.
    shapes : array, shape (n, n)
        Weights, rad/m, of the modes, one mode a column, scaled to modal mass 1: shapesᵀ M shapes
        is the identity where the modes do not gyrate. Complex where the root rotates or loads have
        no potential, so that the parts of the beam move out of phase.
    q : array, shape (n,)
        Weights of the equilibrium, rad/m.
    stations : array, shape (N + 1,)
        Stations s/L of the displacements.
    displacements : array, shape (n, 3, N + 1)
        Displacements of the stations, m, parent axes, for each mode as scaled.
    motions : array, shape (n, 6, N + 1)
        Rotations, rad, and displacements, m, of the stations in their local axes.
    """

    frequencies: Array
    shapes: Any
    q: Array
    stations: Array
    displacements: Any
    motions: Any

    def __repr__(self) -> str:
        return f"<VibrationModes: {len(self.frequencies)} from {self.frequencies[0]:.5g} rad/s>"

    def __str__(self) -> str:
        rows = {
            f"mode {k + 1}": f"{omega:.5g} rad/s ({omega / (2 * np.pi):.4g} Hz)"
            for k, omega in enumerate(self.frequencies[:_SHOWN])
        }
        more = len(self.frequencies) - len(rows)
        title = "Natural frequencies" + (f", the lowest; {more} more" if more else "")
        return described(title, rows)


def natural_frequencies(
    beam: Beam,
    q: Any = None,
    loads: Sequence[Any] = (),
    root: RootMotion | None = None,
) -> Array:
    """Natural frequencies of small vibrations about an equilibrium.

    Parameters
    ----------
    beam : Beam
        With stiffness and mass; numbers alone.
    q : array, shape (n, 1), optional
        Weights of the equilibrium, rad/m; the straight beam unless given. If it is none under the
        loads, what is left of the balance is taken as a constant force on the weights.
    loads : sequence of loads
        Loads that hold the beam there. Their geometric stiffness is part of the frequencies.
    root : RootMotion, optional
        How the root moves steadily, such as the hub of a rotor; at rest unless given.

    Returns
    -------
    array, shape (n,)
        rad/s, ascending.

    Raises
    ------
    ValueError
        As `inverse_dynamics`; if the mass matrix is singular, or the equilibrium is unstable.
    """
    return vibration_modes(beam, q, loads, root).frequencies


def vibration_modes(
    beam: Beam,
    q: Any = None,
    loads: Sequence[Any] = (),
    root: RootMotion | None = None,
) -> VibrationModes:
    """Modes of small vibrations about an equilibrium.

    With r(q, q_dot, q_ddot) of `inverse_dynamics` they solve (λ² M + λ G + K) shape = 0, where K, G
    and M are its derivatives at rest and λ = i ω.

    Parameters
    ----------
    beam : Beam
        As for `natural_frequencies`.
    q, loads, root : optional
        As for `natural_frequencies`.

    Returns
    -------
    VibrationModes
        Frequencies, shapes and displacements.

    Raises
    ------
    ValueError
        As `natural_frequencies`.
    """
    instance("beam", beam, Beam)
    n = beam.basis.n
    at = np.zeros(n) if q is None else numbers("q", q).ravel()
    states = system.weights(beam, q=at)
    built = system.build(beam, loads, root, states)
    check_invertible(built)
    found = differentiate(built, states["q"], ca.DM.zeros(n), ca.DM.zeros(n))
    for matrix in found[:4]:
        if not is_numeric(matrix):
            raise ValueError(f"beam, loads, root: expected numbers, found symbols in {matrix}")
    stiffness, gyration, mass = (x.full() for x in found[1:4])
    frequencies, shapes = _solve(stiffness, gyration, mass)
    motions = _motions(built, states["q"], shapes)
    return VibrationModes(
        frequencies=frequencies,
        shapes=shapes,
        q=at,
        stations=np.array(_stations(built)),
        displacements=motions[:, :3, :],
        motions=motions[:, 3:, :],
    )


def _solve(stiffness: Array, gyration: Array, mass: Array) -> tuple[Array, Any]:
    """Frequencies (n,) and shapes (n, n) of λ² M + λ G + K."""
    from scipy.linalg import eig, eigh

    conservative = _is_small(stiffness - stiffness.T, stiffness) and _is_small(gyration, mass)
    if conservative:
        squares, shapes = eigh((stiffness + stiffness.T) / 2, mass)
        _check_stable(squares[0] > 0, f"the smallest squared frequency {squares[0]:g} rad²/s²")
        return np.sqrt(squares), shapes
    n = len(mass)
    inverse = np.linalg.solve(mass, np.hstack([stiffness, gyration]))
    values, vectors = eig(np.vstack([np.eye(n, 2 * n, n), -inverse]))
    _check_stable(
        np.max(values.real) <= 1e-6 * np.max(np.abs(values)) and np.all(values.imag != 0),
        f"the eigenvalue {values[np.argmax(values.real)]:g} 1/s",
    )
    rising = np.flatnonzero(values.imag > 0)
    order = rising[np.argsort(values.imag[rising])]
    shapes = vectors[:n, order]
    masses = np.einsum("in,ij,jn->n", shapes.conj(), mass, shapes).real
    return values.imag[order], shapes / np.sqrt(masses)


def _is_small(part: Array, whole: Array) -> bool:
    return bool(np.max(np.abs(part)) <= _ROUNDING * np.max(np.abs(whole)))


def _check_stable(stable: Any, text: str) -> None:
    if not stable:
        raise ValueError(f"q, loads: expected a stable equilibrium, found {text}")


def _stations(built: system.System) -> list[float]:
    length = float(built.beam.length)
    lengths = [float(data[0]) / length for data in built.chain.data]
    return [0.0, *np.cumsum(lengths).tolist()]


def _motions(built: system.System, q: ca.DM, shapes: Any) -> Any:
    """Displacements in parent axes, then rotations and displacements in local axes.

    Shape (modes, 9, stations); with the spatial Jacobian [A; B] the displacement is B + A × p.
    """
    states = kinematics.jacobian_states(built.chain, q, built.beam.root.packed)
    rows = []
    for state in states:
        rotation, position = unpack_pose(state)
        angular, linear = kinematics.unpack_sums(state)
        moved = linear - so3.hat(position) @ angular
        local = rotation.T @ angular, rotation.T @ moved
        rows.append(ca.vertcat(moved, *local).full() @ shapes)
    return np.array(rows).transpose(2, 1, 0)
