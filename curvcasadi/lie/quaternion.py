"""Unit quaternions (w, x, y, z) of rotations: Hamilton's product, scalar first.

q and −q are the same rotation R(q), and R(p q) = R(p) R(q). With a body rate Ω in local axes

    dq/dt = ½ q ∘ (0, Ω)      ⇔      dR/dt = R [Ω×]
"""

from __future__ import annotations

import casadi as ca

from curvcasadi.lie import series, so3
from curvcasadi.symbolic.expressions import Expr


def product(left: Expr, right: Expr) -> Expr:
    """Hamilton's product left ∘ right.

    Parameters
    ----------
    left, right : SX, MX or DM, shape (4, 1)
        Quaternions, scalar first.

    Returns
    -------
    SX, MX or DM, shape (4, 1)
    """
    a, u = left[0], left[1:4]
    b, v = right[0], right[1:4]
    return ca.vertcat(a * b - ca.dot(u, v), a * v + b * u + ca.cross(u, v))


def conjugate(q: Expr) -> Expr:
    """The inverse rotation (w, −x, −y, −z) of a unit quaternion, shape (4, 1)."""
    return ca.vertcat(q[0], -q[1:4])


def normalize(q: Expr) -> Expr:
    """q/|q|, shape (4, 1): the nearest unit quaternion. `q` must not be zero."""
    return q / ca.sqrt(ca.sumsqr(q))


def rotation(q: Expr) -> Expr:
    """Rotation matrix of a unit quaternion.

    R = I + 2 w [v×] + 2 [v×]²,   q = (w, v)

    Parameters
    ----------
    q : SX, MX or DM, shape (4, 1)
        Unit quaternion; of another length, the matrix is no rotation.

    Returns
    -------
    SX, MX or DM, shape (3, 3)
        Local-to-parent rotation.
    """
    v_hat = so3.hat(q[1:4])
    return ca.DM.eye(3) + 2 * q[0] * v_hat + 2 * (v_hat @ v_hat)


def exp(k: Expr, degree: int = series.DEGREE) -> Expr:
    """Unit quaternion of a rotation vector.

    q = (cos(θ/2), ½ c1(θ²/4) k),   θ = |k|: entire functions of θ²

    Parameters
    ----------
    k : SX, MX or DM, shape (3, 1)
        Rotation vector, rad.
    degree : int
        Degree of the polynomials in θ².

    Returns
    -------
    SX, MX or DM, shape (4, 1)
        Unit quaternion to rounding for angles up to 2π.
    """
    x = ca.sumsqr(k) / 4
    return ca.vertcat(series.c(0, x, degree), series.c(1, x, degree) / 2 * k)


def log(q: Expr) -> Expr:
    """Rotation vector of a unit quaternion, the shorter way round.

    Parameters
    ----------
    q : SX, MX or DM, shape (4, 1)
        Unit quaternion, of either sign.

    Returns
    -------
    SX, MX or DM, shape (3, 1)
        Rotation vector, rad, of at most π; see `so3.log` for its derivatives near π.
    """
    return so3.log(rotation(q))


def rate(q: Expr, omega: Expr) -> Expr:
    """dq/dt of a frame that turns with the rate `omega`.

    dq/dt = ½ q ∘ (0, Ω)   (Eq. 1 for quaternions)

    Parameters
    ----------
    q : SX, MX or DM, shape (4, 1)
        Local-to-parent quaternion.
    omega : SX, MX or DM, shape (3, 1)
        Angular velocity, local axes, rad/s.

    Returns
    -------
    SX, MX or DM, shape (4, 1)
    """
    return product(q, ca.vertcat(0, omega)) / 2
