"""Independent oracles: matrix exponentials, ODE solutions, exact series; none uses the package."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise

import mpmath as mp
import numpy as np
from numpy.polynomial import legendre
from scipy.integrate import solve_ivp
from scipy.linalg import expm

Matrix = np.ndarray

#: The test wing: 16 m, four Legendre functions a channel, strongly bent in all three.
WING_LENGTH = 16.0
_SERIES = np.array([1, -1 / 2, 1 / 3, -1 / 4])
WING_WEIGHTS = np.outer([0.06, -0.10, 0.03], _SERIES).ravel()
#: The channels of the test wing are proportional, so its curvatures commute as rotations. These
#: weights bend it as strongly, and the axis of curvature turns along the span.
CURLED_WEIGHTS = np.concatenate(
    [0.06 * _SERIES, -0.10 * _SERIES[[2, 0, 3, 1]], 0.03 * _SERIES[::-1]]
)


def wing_curvature(xi: float, weights: Matrix = WING_WEIGHTS) -> Matrix:
    """K (3,) of the test wing, rad/m."""
    return weights.reshape(3, 4) @ legendre.legval(2 * xi - 1, np.eye(4))


def curled_curvature(xi: float) -> Matrix:
    """K (3,) with the weights whose axis turns, rad/m."""
    return wing_curvature(xi, CURLED_WEIGHTS)


def hat(k: Sequence[float]) -> Matrix:
    x, y, z = np.ravel(k)
    return np.array([[0, -z, y], [z, 0, -x], [-y, x, 0.0]])


def twist_matrix(xi: Sequence[float]) -> Matrix:
    """ξ^ (4, 4), angular part first."""
    xi = np.ravel(xi)
    matrix = np.zeros((4, 4))
    matrix[:3, :3], matrix[:3, 3] = hat(xi[:3]), xi[3:]
    return matrix


def rotation(k: Sequence[float]) -> Matrix:
    """exp([k×])."""
    return expm(hat(k))


def constant_curvature(K: Sequence[float], s: float) -> tuple[Matrix, Matrix]:
    """(R, p) after the arc length `s` at the constant curvature `K`."""
    pose = expm(s * twist_matrix([*np.ravel(K), 1, 0, 0]))
    return pose[:3, :3], pose[:3, 3]


def integrate(
    curvature: Callable[[float], Matrix],
    length: float,
    stations: Sequence[float] = (1.0,),
    breaks: Sequence[float] = (),
    rotation: Matrix | None = None,
    position: Sequence[float] = (0, 0, 0),
) -> list[tuple[Matrix, Matrix]]:
    """(R, p) at increasing `stations` of R' = R [K×], p' = R e_x; panels end at `breaks`."""
    state = np.concatenate([(np.eye(3) if rotation is None else rotation).ravel(), position])
    stops = sorted({0.0, *breaks, *stations})
    found = {0.0: state}
    for left, right in pairwise(stops):
        inside = np.nextafter([left, right], [right, left])

        def slope(xi: float, y: Matrix, inside: Matrix = inside) -> Matrix:
            R = y[:9].reshape(3, 3)
            K = np.ravel(curvature(float(np.clip(xi, *inside))))
            return length * np.concatenate([(R @ hat(K)).ravel(), R[:, 0]])

        solution = solve_ivp(slope, (left, right), state, "DOP853", rtol=1e-13, atol=1e-14)
        state = solution.y[:, -1]
        found[right] = state
    return [(found[xi][:9].reshape(3, 3), found[xi][9:]) for xi in stations]


def body_twist_of(pose: Matrix, rate: Matrix) -> Matrix:
    """6-vector (ω, v) of pose⁻¹ d pose/dt, both (4, 4)."""
    matrix = np.linalg.solve(pose, rate)
    return np.array([matrix[2, 1], matrix[0, 2], matrix[1, 0], *matrix[:3, 3]])


def homogeneous(R: Matrix, p: Matrix) -> Matrix:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = R, np.ravel(p)
    return pose


def coefficient(k: int, angle: mp.mpf) -> mp.mpf:
    """c_k(θ²) of a positive angle by its closed form; call it with many digits."""
    c = mp.sin(angle) / angle if k % 2 else (1 - mp.cos(angle)) / angle**2
    for j in range(1 if k % 2 else 2, k, 2):
        c = (1 / mp.factorial(j) - c) / angle**2
    return c


def coefficient_derivative(k: int, angle: float, order: int, squared: bool = False) -> float:
    """Derivative of c_k with respect to θ, or (`squared`) to θ², from the closed form.

    At zero, from the first terms of Σ (−x)^j / (2j + k)!.
    """
    if angle == 0:
        if squared:
            return float((-1) ** order * mp.factorial(order) / mp.factorial(2 * order + k))
        if order % 2:
            return 0.0
        j = order // 2
        return float((-1) ** j * mp.factorial(order) / mp.factorial(order + k))
    with mp.workdps(250):
        theta = mp.mpf(angle)
        if squared:
            return float(mp.diff(lambda x: coefficient(k, mp.sqrt(x)), theta**2, order))
        return float(mp.diff(lambda t: coefficient(k, t), theta, order))


def matrix_series(
    k: Sequence[float], direction: Sequence[float], shift: int, size: int = 3
) -> list[Matrix]:
    """Derivatives 0 … 3 at t = 0 of Σ_m A(t)^m / (m + shift)!, A(t) = hat(k + t direction).

    shift 0 is the exponential and shift 1 the left Jacobian. Taylor arithmetic in 40 digits.
    `size` 4 takes 6-vectors and their 4 × 4 matrices.
    """
    lift = hat if size == 3 else twist_matrix
    with mp.workdps(40):
        a0 = mp.matrix(lift(np.zeros(len(k))).tolist())
        parts = []
        for vector in (k, direction):
            entries = lift(np.asarray(vector, dtype=float)).tolist()
            parts.append(mp.matrix(entries))
        power = [mp.eye(size), a0, a0, a0]
        total = [term / mp.factorial(shift) for term in power]
        for m in range(1, 45):
            power = [power[j] * parts[0] + (power[j - 1] * parts[1] if j else a0) for j in range(4)]
            total = [t + p / mp.factorial(m + shift) for t, p in zip(total, power, strict=True)]
        return [
            np.array((total[j] * mp.factorial(j)).tolist(), dtype=float).reshape(size, size)
            for j in range(4)
        ]
