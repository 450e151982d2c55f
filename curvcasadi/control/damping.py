"""Structural damping: the matrix C of the force C q_dot on the weights."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np

from curvcasadi.beam.beam import Beam
from curvcasadi.dynamics import vibration_modes
from curvcasadi.kinematics.root_motion import RootMotion
from curvcasadi.symbolic.expressions import AnyExpr, Array, Number, is_numeric, numbers

#: Of the largest eigenvalue of a damping matrix: what negative ones are rounding.
ROUNDING = 1e-9


def modal_damping(
    beam: Beam,
    ratios: Number,
    q: Any = None,
    loads: Sequence[Any] = (),
    root: RootMotion | None = None,
) -> Array:
    """The matrix C that gives each mode of small vibrations a damping ratio of its own.

        C = M Φ diag(2 ζ_k ω_k) Φᵀ M,      Φᵀ M Φ = I

    with the frequencies ω_k and shapes Φ of `vibration_modes`. C is constant: far from the shape
    that it was made about, modes have other ratios.

    Parameters
    ----------
    beam : Beam
        With stiffness and mass; numbers alone.
    ratios : float or array, shape (k,)
        Damping ratios ζ, one for all modes, or those of the first k modes by frequency; all further
        modes have the last one.
    q, loads, root : optional
        As for `vibration_modes`: the equilibrium that vibrates; the straight beam unless given.

    Returns
    -------
    ndarray, shape (n, n)
        C, N m³ s, for `damping=` of a model; symmetric.

    Raises
    ------
    ValueError
        If a ratio is negative, there are more ratios than modes, modes gyrate (their shapes are
        complex), or as `vibration_modes`.
    """
    modes = vibration_modes(beam, q, loads, root)
    found, n = np.atleast_1d(numbers("ratios", ratios)), len(modes.frequencies)
    if found.ndim != 1 or not 1 <= found.size <= n:
        raise ValueError(f"ratios: expected 1 to {n} numbers, found shape {found.shape}")
    if np.min(found) < 0:
        raise ValueError(f"ratios: expected numbers of at least zero, found {np.min(found):g}")
    if np.iscomplexobj(modes.shapes):
        raise ValueError(
            "loads, root: expected modes without gyration, which loads that have no potential and "
            "a rotating root bring; found complex mode shapes"
        )
    every = np.append(found, np.full(n - found.size, found[-1]))
    # Φᵀ M Φ = I makes M Φ the inverse of Φᵀ.
    scaled = np.linalg.inv(modes.shapes).T
    matrix = scaled @ np.diag(2 * every * modes.frequencies) @ scaled.T
    return np.asarray((matrix + matrix.T) / 2)


def _refuse_gain(array: Array) -> None:
    """Refuse a matrix C whose force C q_dot would feed energy into a motion."""
    powers = np.linalg.eigvalsh((array + array.T) / 2)
    if powers[0] < -ROUNDING * np.abs(powers).max():
        raise ValueError(
            "damping: expected a matrix that takes energy out of every motion, found one with the "
            f"eigenvalue {powers[0]:.4g} of its symmetric part"
        )


def damping_matrix(value: Number, n: int, stiffness: AnyExpr) -> ca.MX:
    """C (n, n) of a number β, C = β S, or of C itself."""
    if not is_numeric(value):
        matrix = value * stiffness if value.numel() == 1 else value
    else:
        array = numbers("damping", value)
        if array.size == 1 and not float(array.ravel()[0]) >= 0:
            raise ValueError(f"damping: expected a time of at least zero, s, found {array}")
        if array.shape == (n, n) and n > 1:
            _refuse_gain(array)
        matrix = float(array.ravel()[0]) * stiffness if array.size == 1 else ca.MX(ca.DM(array))
    if matrix.shape != (n, n):
        raise ValueError(f"damping: expected a number or a matrix ({n}, {n}), found {matrix.shape}")
    return ca.densify(ca.MX(matrix))
