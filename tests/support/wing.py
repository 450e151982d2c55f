"""The test wing, strongly bent, and its tip pose to rounding."""

from __future__ import annotations

from functools import cache, lru_cache
from math import ceil

import casadi as ca
import numpy as np
from numpy.polynomial import legendre
from scipy.integrate import solve_ivp

import curvcasadi as cc
from curvcasadi.beam.grid import ExponentialName, RuleName
from curvcasadi.symbolic.expressions import AnyExpr, Array

LENGTH = 16.0  #: m
AMPLITUDES = np.array([0.06, -0.10, 0.03])  #: torsion, out-of-plane, in-plane, rad/m
SHARES = np.array([1, -1 / 2, 1 / 3, -1 / 4])  #: of the Legendre functions of each channel
WEIGHTS = np.outer(AMPLITUDES, SHARES).ravel()
RULES: tuple[RuleName, ...] = ("trapezoid", "midpoint", "magnus4", "magnus6")
ORDERS = {"trapezoid": 2, "midpoint": 2, "magnus4": 4, "magnus6": 6}


def wing(
    elements: int,
    rule: RuleName = "magnus4",
    exponential: ExponentialName = "series",
    per_channel: int = 4,
) -> cc.Beam:
    """The test wing on uniform elements, its root at the identity."""
    grid = cc.Grid.uniform(elements, rule=rule, exponential=exponential)
    return on_grid(grid, per_channel)


def on_grid(grid: cc.Grid, per_channel: int = 4) -> cc.Beam:
    """The test wing with `per_channel` Legendre functions for each of the three curvatures."""
    family = cc.Legendre(per_channel)
    basis = cc.ChannelBasis(torsion=family, out_of_plane=family, in_plane=family)
    return cc.Beam(length=LENGTH, basis=basis, grid=grid)


@cache
def reference() -> tuple[Array, Array]:
    """Tip rotation (3, 3) and position (3,), m: DOP853 on R' = R [K×], p' = R e_x."""

    def slope(s: float, state: Array) -> Array:
        rotation = state[:9].reshape(3, 3)
        k = WEIGHTS.reshape(3, 4) @ legendre.legval(2 * s / LENGTH - 1, np.eye(4))
        return np.concatenate([np.cross(rotation, k).ravel(), rotation[:, 0]])

    start = np.concatenate([np.eye(3).ravel(), np.zeros(3)])
    end = solve_ivp(slope, (0, LENGTH), start, method="DOP853", rtol=1e-13, atol=1e-14).y[:, -1]
    return end[:9].reshape(3, 3), end[9:]


def tip_pose(beam: cc.Beam, q: Array = WEIGHTS) -> tuple[Array, Array]:
    """Tip rotation (3, 3) and position (3,), m."""
    tip = cc.shape_map(beam, ca.DM(q)).tip
    return tip.rotation.full(), tip.position.full().ravel()


def position_error(position: AnyExpr) -> float:
    """Distance of a tip position of the test wing from the reference, over the length."""
    found = np.asarray(position, dtype=float).ravel()
    return float(np.linalg.norm(found - reference()[1])) / LENGTH


@lru_cache(maxsize=256)
def tip_error(
    elements: int, rule: RuleName = "magnus4", exponential: ExponentialName = "series"
) -> float:
    """Tip position error over the length."""
    return position_error(tip_pose(wing(elements, rule, exponential))[1])


def elements_for(error: float, rule: RuleName) -> int:
    """Least number of uniform elements whose tip error is at most `error` (in L).

    The rule's order gives a first number from 16 elements and a second one from the first; then
    neighbours decide.
    """
    n = 16
    for _ in range(2):
        n = ceil(n * (tip_error(n, rule) / error) ** (1 / ORDERS[rule]))
    while tip_error(n, rule) > error:
        n += 1
    while tip_error(n - 1, rule) <= error:
        n -= 1
    return n


def non_orthogonality(rotation: Array) -> float:
    """Largest entry of |Rᵀ R − I|."""
    return float(np.abs(rotation.T @ rotation - np.eye(3)).max())
