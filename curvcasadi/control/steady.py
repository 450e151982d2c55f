"""Steady states of models with inertia, and the linear models about them.

With velocities and accelerations zero, the configuration and the other states z solve

    r(z, u, p) = (balance, rates of the other states) = 0

by Newton's method. One set of slopes of r, by states and accelerations, gives both its tangent
T = ∂r/∂z and the state matrix A of the linear model, as accelerations are −M⁻¹ ∂balance. Slopes are
kept as long as the corrections they give shrink, so that a state near the one before takes one set.
From far away the way is that of r(z) = (1 − s) r(z₀): from the start to the steady state by a load
that vanishes, in steps that Newton's method contracts on.
"""

from __future__ import annotations

from typing import NamedTuple

import casadi as ca
import numpy as np

from curvcasadi.control.model import ControlModel, SecondOrder
from curvcasadi.symbolic.expressions import Array

#: Corrections shrink at least by this factor, or slopes are made anew, or the way in smaller steps.
CONTRACTION = 0.5
#: Of corrections: relative, and of curvatures in rad/m or lag states over the airspeed.
RELATIVE, ABSOLUTE = 1e-10, 1e-13
MOST_CORRECTIONS = 40
#: Forces that a small correction may still find, over elastic ones, and over those of a curvature,
#: rad/m.
BALANCED, STRAIGHT = 1e-4, 1e-9
#: Relative step of differences over the airspeed.
STEP = 1e-5
SHORTEST = 2.0**-6


class Slopes(NamedTuple):
    """Slopes of r at a state."""

    by_state: Array  #: (nv + no, nx)
    by_acceleration: Array  #: (nv + no, nv): the mass matrix on top


class SteadyStates:
    """Steady states of one model with equations of motion; it counts its linearizations."""

    def __init__(self, model: ControlModel, motion: SecondOrder) -> None:
        self.model, self.linearizations = model, 0
        n = motion.velocities
        x, a, u, p = (
            ca.MX.sym(name, motion.balance.size1_in(i))
            for i, name in enumerate(("x", "a", "u", "p"))
        )
        rest = ca.vertcat(*motion.balance(x, a, u, p))
        slopes = [ca.densify(ca.jacobian(rest, by)) for by in (x, a)]
        self._rest = ca.Function("rest", [x, a, u, p], [rest])
        self._slopes = ca.Function("slopes", [x, a, u, p], slopes)
        origin = np.zeros(self.model.x.size)
        self._kinematics = motion.kinematics.jacobian()(origin, np.zeros(n)).full()
        self._matrices, self._stiffness = motion.matrices, np.zeros((n, n))
        self.n = n
        self.free = np.r_[0:n, 2 * n : self.model.x.size]

    def residual(self, x: Array, u: Array, p: Array) -> Array:
        """r at a state, (nv + no,)."""
        return np.asarray(self._rest(x, np.zeros(self.n), u, p).full().ravel())

    def slopes(self, x: Array, u: Array, p: Array) -> Slopes:
        """Its slopes: one linearization."""
        self.linearizations += 1
        return Slopes(*(part.full() for part in self._slopes(x, np.zeros(self.n), u, p)))

    def tangent(self, slopes: Slopes) -> Array:
        """T, (nv + no, nv + no)."""
        return slopes.by_state[:, self.free]

    def state_matrix(self, slopes: Slopes) -> Array:
        """A, (nx, nx), where the slopes are those of a steady state."""
        n = self.n
        accelerations = -np.linalg.solve(slopes.by_acceleration[:n], slopes.by_state[:n])
        others = slopes.by_state[n:] + slopes.by_acceleration[n:] @ accelerations
        return np.vstack([self._kinematics, accelerations, others])

    def drift(self, x: Array, u: Array, p: Array, slopes: Slopes) -> Array:
        """dx/dV of a steady state, (nx,), by a difference of the residual over the airspeed."""
        at = self.model.p.slices["airspeed"]
        step = STEP * p[at]
        ends = [p.copy(), p.copy()]
        ends[0][at] -= step
        ends[1][at] += step
        low, high = (self.residual(x, u, end) for end in ends)
        moved = self._correction(slopes, (high - low) / (2 * step))
        drift = np.zeros_like(x)
        if moved is not None:
            drift[self.free] = moved
        return drift

    def settle(
        self, start: Array, u: Array, p: Array, slopes: Slopes | None = None
    ) -> tuple[Array, Slopes] | None:
        """The steady state near `start` and the last slopes used; None where there is none near.

        `slopes` are those of a neighbour, where there are any.
        """
        x = start.copy()
        x[self.n : 2 * self.n] = 0
        self._stiffness = self._matrices(x, p)[2].full()
        unbalanced = self.residual(x, u, p)
        if slopes is None:
            slopes = self.slopes(x, u, p)
        done, stride = 0.0, 1.0
        while done < 1:
            goal = min(1.0, done + stride)
            reached = self._newton(x, u, p, (1 - goal) * unbalanced, slopes)
            if reached is None:
                stride /= 2
                if stride < SHORTEST:
                    return None
            else:
                x, slopes = reached
                done, stride = goal, 2 * stride
        return x, slopes

    def _newton(
        self, x: Array, u: Array, p: Array, target: Array, slopes: Slopes
    ) -> tuple[Array, Slopes] | None:
        """r(x) = target, by corrections that shrink."""
        fresh, before, x = False, np.inf, x.copy()
        for _ in range(MOST_CORRECTIONS):
            left = self.residual(x, u, p) - target
            if not np.all(np.isfinite(left)):
                return None
            step = self._correction(slopes, left)
            if step is None:
                return None
            size = self._size(step)
            if size > CONTRACTION * before:
                if fresh:
                    return None
                slopes, fresh, before = self.slopes(x, u, p), True, np.inf
                continue
            fresh, before = False, size
            x[self.free] += step
            if self._small(step, x, p):
                return (x, slopes) if self._balanced(left, x) else None
        return None

    def _correction(self, slopes: Slopes, left: Array) -> Array | None:
        try:
            return np.asarray(-np.linalg.solve(self.tangent(slopes), left))
        except np.linalg.LinAlgError:  # singular to the last bit
            return None

    def _size(self, step: Array) -> float:
        """Of the configuration's part, by the energy that it costs."""
        bent = step[: self.n]
        return float(np.sqrt(max(float(bent @ self._stiffness @ bent), 0.0)))

    def _balanced(self, left: Array, x: Array) -> bool:
        """Whether what was left is little beside elastic forces.

        Elements that turn by many radians are so stiff that corrections are small whatever is left.
        """
        elastic = np.linalg.norm(self._stiffness @ x[: self.n])
        least = STRAIGHT * np.linalg.norm(self._stiffness)
        return bool(np.linalg.norm(left[: self.n]) <= BALANCED * elastic + least)

    def _small(self, step: Array, x: Array, p: Array) -> bool:
        speed = float(p[self.model.p.slices["airspeed"]][0])
        parts = ((slice(0, self.n), 1.0), (slice(self.n, None), speed))
        value = x[self.free]
        return all(
            np.abs(step[part]).max(initial=0.0)
            <= RELATIVE * np.abs(value[part]).max(initial=0.0) + ABSOLUTE * unit
            for part, unit in parts
        )
