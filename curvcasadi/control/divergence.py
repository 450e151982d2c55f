"""How the divergence speed of a wing changes with parameters.

At divergence the tangent T = ∂r/∂z of the steady equations r(z, V, p) = 0 is singular, T φ = 0 and
lᵀ T = 0. A state moves with y = V and y = p by the bordered system

    [T l; φᵀ 0] [w; s] = −[∂r/∂y; 0],

where s, what no state balances, is zero for a wing whose loads do not bend it in the way in which
it diverges: a symmetric one at no angle of attack, say, that its drag bends. There

    dV/dp = −μ_p/μ_V,      μ_y = lᵀ (∂T/∂z w_y + ∂T/∂y) φ.

Other wings bend more and more toward divergence and pass it by.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from curvcasadi.control.design import (
    SteadySlopes,
    beside_airspeed,
    columns_of,
    motion_of,
    parts_of,
)
from curvcasadi.control.flutter import Flutter
from curvcasadi.symbolic.expressions import Array, instance

#: Part of a change that no state balances, relative to the change, which is more than rounding.
UNBALANCED = 1e-6


def divergence_derivatives(found: Flutter, names: Sequence[str]) -> dict[str, Array]:
    """Derivatives of the divergence speed by parameters of the model, the equilibrium moving.

    Parameters
    ----------
    found : Flutter
        With a divergence speed.
    names : sequence of str
        Parts of p other than airspeed.

    Returns
    -------
    dict of str to array
        The derivative by each entry of a part, m/s over its unit.

    Raises
    ------
    ValueError
        If there is no divergence; for a parameter that bends the wing in the way in which it
        diverges, as the pitch of a straight one does: its divergence speed ends there; or as
        `design_derivatives`.
    """
    instance("found", found, Flutter)
    if found.divergence_speed is None or found.divergence_equilibrium is None:
        raise ValueError("found: expected a sweep with a divergence speed, found none")
    model, names = found.model, beside_airspeed(names)
    columns, labels = columns_of(model.p, ["airspeed", *names])
    p = found.p.copy()
    p[model.p.slices["airspeed"]] = found.divergence_speed
    at = SteadySlopes.of(model, motion_of(model), found.divergence_equilibrium, found.u, p)
    null, changes = _null_vectors(at.tangent), at.blocks["p"][:, columns]
    unbalanced = null.left @ changes
    size = np.linalg.norm(changes * null.rows[:, None], axis=0)
    beyond = np.abs(unbalanced) > UNBALANCED * size
    if np.any(beyond):
        bending = ", ".join(label for label, part in zip(labels, beyond, strict=True) if part)
        raise ValueError(
            "names: expected parameters that leave the wing unbent in the way in which it "
            f"diverges, found {bending}: with it the wing bends more and more, and does not diverge"
        )
    n, m = changes.shape
    bordered = np.zeros((n + 1, n + 1))
    bordered[:n, :n] = at.tangent
    bordered[:n, n], bordered[n, :n] = null.left / null.rows**2, null.right / null.columns**2
    moved = np.linalg.solve(bordered, np.vstack([-changes, np.zeros((1, m))]))[:n]
    directions = np.zeros((m, len(at.x)))
    directions[:, at.free] = moved.T
    along = zip(directions, np.eye(len(p))[columns], strict=True)
    turned = [null.left @ at.along(*way)["x"][:, at.free] @ null.right for way in along]
    return parts_of(model.p, names, -np.array(turned[1:]) / turned[0])


class _Null(NamedTuple):
    """Left and right null vectors of a tangent, and the scales of its rows and columns."""

    left: Array
    right: Array
    rows: Array  #: which make the largest entry of each row one
    columns: Array


def _null_vectors(tangent: Array) -> _Null:
    """Of the least singular value of the tangent, its rows and columns scaled to entries of one."""
    tiny = np.finfo(float).tiny
    rows = 1 / np.maximum(np.abs(tangent).max(axis=1), tiny)
    columns = 1 / np.maximum(np.abs(rows[:, None] * tangent).max(axis=0), tiny)
    left, _, right = np.linalg.svd(rows[:, None] * tangent * columns)
    return _Null(left[:, -1] * rows, right[-1] * columns, rows, columns)
