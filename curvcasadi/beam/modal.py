"""Curvature bases from the modes of a finite-element model, sampled along a reference line.

A mode is a small displacement u(s) and a small rotation r(s) of the sections of a straight line, in
its local axes. To first order, with p' = R e_x (Eq. 4) and R = I + [r×],

    K = r',      u' = r × e_x = (0, r_z, −r_y).

The linear K(s), kept and added with weights, are good functions for large deflections (the modal
rotations idea): the rotations that follow from them are exact for any weights, not linear.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from curvcasadi.beam.basis import VectorBasis
from curvcasadi.symbolic.expressions import Array, count, numbers

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline

#: Curvature times length over the amplitude below which a mode counts as one of a rigid body, and
#: the part of a curvature, over the largest, that must not follow from those of the other modes.
_NEGLIGIBLE = 1e-6


@dataclass(frozen=True, eq=False, kw_only=True)
class Modes:
    """M modes at N stations of a straight reference line, in its local axes.

    Attributes
    ----------
    stations : array, shape (N,)
        Arc lengths s from the root, 0, to the tip, increasing, m.
    displacements : array, shape (M, 3, N)
        Displacements u, m or any other unit of amplitude.
    rotations : array, shape (M, 3, N)
        Rotation vectors r of the same amplitude, rad.
    labels : tuple of str
        A name per mode.
    """

    stations: Array
    displacements: Array
    rotations: Array
    labels: tuple[str, ...]

    def __post_init__(self) -> None:
        s = numbers("Modes.stations", self.stations)
        if s.ndim != 1 or len(s) < 2 or s[0] != 0 or np.any(np.diff(s) <= 0):
            raise ValueError(
                f"Modes.stations: expected two or more increasing numbers from 0, found {s}"
            )
        object.__setattr__(self, "stations", s)
        shape = (len(self.labels), 3, len(s))
        for name in ("displacements", "rotations"):
            values = numbers(f"Modes.{name}", getattr(self, name))
            if values.shape != shape or not self.labels:
                raise ValueError(f"Modes.{name}: expected shape {shape}, found {values.shape}")
            object.__setattr__(self, name, values)
        for label, amplitude in zip(self.labels, _amplitudes(self), strict=True):
            if not amplitude > 0:
                raise ValueError(f"Modes: {label}: expected a mode that moves, found only zeros")


@dataclass(frozen=True, eq=False, kw_only=True)
class ModalBasis:
    """A curvature basis from modes, and how well it reproduces them.

    Attributes
    ----------
    basis : VectorBasis
        Curvature of each mode, scaled so that its largest magnitude at a station is 1.
    labels : tuple of str
        A name per mode.
    round_trip_error : array, shape (n,)
        What is lost from each mode to its curvature and back, relative.
    """

    basis: VectorBasis
    labels: tuple[str, ...]
    round_trip_error: Array


def basis_of_modes(modes: Modes, n: int | None = None) -> ModalBasis:
    """`modal_basis` of modes: see there."""
    modes = _first(modes, len(modes.labels) if n is None else count("n", n))
    curvatures, span = _rotations(modes).derivative(), float(modes.stations[-1])
    sampled = curvatures(modes.stations)  # (N, n, 3)
    largest = np.linalg.norm(sampled, axis=2).max(axis=0)
    _check_curvatures(modes, sampled, largest)

    def functions(xi: float) -> Array:
        return np.asarray((curvatures(xi * span) / largest[:, None]).T)

    return ModalBasis(
        basis=VectorBasis(functions, len(modes.labels), labels=modes.labels),
        labels=modes.labels,
        round_trip_error=round_trip_error(modes),
    )


def round_trip_error(modes: Modes) -> Array:
    """What is lost from modes to linear curvatures and back, (M,), relative.

    The curvatures are integrated to r = r(0) + ∫ K ds and u = u(0) + ∫ r × e_x ds. The error is the
    largest difference of a component of u/L or r at a station over the largest of all of these: of
    the splines' order where the line is inextensible and unshearable, and otherwise the part of the
    mode that stretches or shears it.
    """
    s, span = modes.stations, float(modes.stations[-1])
    rotations = _rotations(modes)
    curvatures = rotations.derivative()
    turned = rotations(0.0) + curvatures.antiderivative()(s)  # (N, M, 3)
    swept = rotations.antiderivative()(s)
    moved = modes.displacements[:, :, 0] + np.stack(
        [np.zeros_like(swept[..., 0]), swept[..., 2], -swept[..., 1]], axis=-1
    )
    given_u, given_r = (v.transpose(2, 0, 1) for v in (modes.displacements, modes.rotations))
    difference = np.maximum(np.abs(moved - given_u) / span, np.abs(turned - given_r))
    return np.asarray(difference.max(axis=(0, 2)) / _amplitudes(modes))


def spline(stations: Array, values: Array) -> CubicSpline:
    """Through values (M, 3, N), as a function of s with values (…, M, 3)."""
    from scipy.interpolate import CubicSpline

    return CubicSpline(stations, values.transpose(2, 0, 1), bc_type="not-a-knot")


def _first(modes: Modes, n: int) -> Modes:
    if n > len(modes.labels):
        raise ValueError(f"n: expected at most {len(modes.labels)}, the modes given, found {n}")
    return Modes(
        stations=modes.stations,
        displacements=modes.displacements[:n],
        rotations=modes.rotations[:n],
        labels=modes.labels[:n],
    )


def _rotations(modes: Modes) -> CubicSpline:
    return spline(modes.stations, modes.rotations)


def _amplitudes(modes: Modes) -> Array:
    """The largest of u/L and r of each mode, (M,)."""
    scaled = np.abs(modes.displacements) / modes.stations[-1]
    return np.asarray(np.maximum(scaled, np.abs(modes.rotations)).max(axis=(1, 2)))


def _check_curvatures(modes: Modes, sampled: Array, largest: Array) -> None:
    n, span = len(largest), modes.stations[-1]
    for label, curvature, amplitude in zip(modes.labels, largest, _amplitudes(modes), strict=False):
        if not curvature * span > _NEGLIGIBLE * amplitude:
            raise ValueError(
                f"{label}: expected a mode that bends or twists the line, found curvatures of at "
                f"most {curvature:.3g} rad/m"
            )
    scaled = (sampled / largest[:, None]).transpose(0, 2, 1).reshape(-1, n)
    own = np.zeros(n)  # what the columns before leave of each
    triangle = np.linalg.qr(scaled, mode="r")
    own[: len(triangle)] = np.abs(np.diag(triangle))
    for k in np.flatnonzero(own <= _NEGLIGIBLE * np.linalg.norm(scaled, axis=0)):
        raise ValueError(
            f"{modes.labels[k]}: expected a curvature of its own, found one that follows from the "
            "modes before"
        )
