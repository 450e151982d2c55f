"""The test wing as CasADi users write it without this package: expressions of Eqs. 2 and 4.

Each function returns the tip (position (3, 1), rotation (3, 3)) for weights `q` (12, 1).
"""

from __future__ import annotations

import casadi as ca
import numpy as np
from numpy.polynomial import legendre

from curvcasadi.symbolic.expressions import AnyExpr
from tests.support.wing import LENGTH

Tip = tuple[AnyExpr, AnyExpr]


def curvature(q: AnyExpr, xi: AnyExpr) -> AnyExpr:
    """K (3, 1), rad/m, of Legendre 4 a channel; `xi` may be a symbol."""
    z = 2 * xi - 1
    basis = [1, z]
    for k in (1, 2):
        basis.append(((2 * k + 1) * z * basis[k] - k * basis[k - 1]) / (k + 1))
    return ca.reshape(q, 4, 3).T @ ca.vertcat(*basis)


def slope(q: AnyExpr, state: AnyExpr, xi: AnyExpr) -> AnyExpr:
    """d(vec R, p)/dxi: R' = R [K×] and p' = R e_x, by L."""
    rotation = ca.reshape(state[:9], 3, 3)
    return LENGTH * ca.veccat(rotation @ ca.skew(curvature(q, xi)), rotation[:, 0])


START = ca.veccat(ca.DM.eye(3), ca.DM.zeros(3))


def runge_kutta(q: AnyExpr, steps: int) -> Tip:
    """The classical Runge–Kutta method of order 4."""
    state, h = START, 1 / steps
    for i in range(steps):
        xi = i * h
        k1 = slope(q, state, xi)
        k2 = slope(q, state + h / 2 * k1, xi + h / 2)
        k3 = slope(q, state + h / 2 * k2, xi + h / 2)
        k4 = slope(q, state + h * k3, xi + h)
        state = state + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return _tip(state)


def integrator(q: ca.MX, plugin: str, options: dict[str, float]) -> Tip:
    """CasADi's `integrator`, a DAE of Eqs. 2 and 4 with parameters q."""
    state, parameters, xi = ca.SX.sym("state", 12), ca.SX.sym("q", 12), ca.SX.sym("xi")
    dae = {"x": state, "p": parameters, "t": xi, "ode": slope(parameters, state, xi)}
    rod = ca.integrator("rod", plugin, dae, 0, 1, options)
    return _tip(rod(x0=START, p=q)["xf"])


def as_printed(q: AnyExpr, elements: int) -> Tip:
    """The paper's chain: mean of the end curvatures, Eqs. 6 and 13 as printed, which divide by |K|.

    D = I − sin(αs)/α [K×] + (1 − cos αs)/α² [K×]²,
    p = D_0ᵀ (s K Kᵀ/α² − (cos αs − 1)/α² [K×] − sin(αs)/α³ [K×]²) e_x,   α = |K|
    """
    h = LENGTH / elements
    ends = legendre.legvander(np.linspace(-1, 1, elements + 1), 3)
    deformation, position = ca.DM.eye(3), ca.DM.zeros(3)
    for basis in (ends[1:] + ends[:-1]) / 2:
        k = ca.reshape(q, 4, 3).T @ ca.DM(basis)
        alpha, k_hat = ca.norm_2(k), ca.skew(k)
        sine, cosine = ca.sin(alpha * h), ca.cos(alpha * h)
        element_position = (
            h * k @ k.T / alpha**2
            - (cosine - 1) / alpha**2 * k_hat
            - sine / alpha**3 * (k_hat @ k_hat)
        )[:, 0]
        position = position + deformation.T @ element_position
        element_deformation = (
            ca.DM.eye(3) - sine / alpha * k_hat + (1 - cosine) / alpha**2 * (k_hat @ k_hat)
        )
        deformation = element_deformation @ deformation
    return position, deformation.T


def _tip(state: AnyExpr) -> Tip:
    return state[9:], ca.reshape(state[:9], 3, 3)
