"""Steps with which Runge–Kutta's method of order 4 is stable.

In a step h a mode x' = λ x is multiplied by R(h λ), R(z) = 1 + z + z²/2 + z³/6 + z⁴/24. With
|R| > 1 it grows by a fraction in each step, even if the mode itself decays, and many steps pass
before that is seen. An undamped mode is stable up to h |λ| = √8. The modes of a model with inertia
are those of its matrices, in vacuum, and those of its lag states, with the motion held; the modes
of other models are those of dx/dt.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence

import casadi as ca
import numpy as np

from curvcasadi.control.model import ControlModel, SecondOrder
from curvcasadi.symbolic.expressions import Array

#: Re λ over |λ| up to which the growth of a mode is rounding.
_ROUNDING = 1e-6
#: Relative excess of a step over the limit that is rounding.
SLACK = 1e-6


def stable_step(model: ControlModel, x: Array, u: Array, p: Array) -> tuple[float, float]:
    """Longest stable step at a state, s, and the frequency |λ| of the mode that limits it, rad/s.

    Infinite and zero where no mode limits it, and where modes cannot be computed: at a state that
    is not finite, or for parameters with which the matrices are singular.
    """
    try:
        with np.errstate(all="ignore"):
            modes = _modes(model, x, u, p)
    except (ValueError, RuntimeError, np.linalg.LinAlgError):
        return np.inf, 0.0
    modes = modes[(modes.real < _ROUNDING * abs(modes)) & np.isfinite(modes)]
    if not modes.size:
        return np.inf, 0.0
    frequencies = abs(modes)
    limits = _radius(abs(np.angle(modes))) / frequencies
    fastest = int(np.argmin(limits))
    return float(limits[fastest]), float(frequencies[fastest])


def remedy(
    model: ControlModel,
    h: float,
    x: Array,
    u: Array,
    p: Array,
    implicit: str = "'implicit_midpoint'",
) -> str | None:
    """What to do about a step `h`, in words; None where it is stable.

    `implicit` names the alternative to shorter steps, for models with inertia.
    """
    limit, frequency = stable_step(model, x, u, p)
    if not h > limit * (1 + SLACK):
        return None
    other = f"{implicit}, or " if model.second_order is not None else ""
    return (
        f"take {other}steps below {limit:.3g} s, as the highest frequency is {frequency:.4g} rad/s"
    )


def unstable_step(
    model: ControlModel,
    h: float,
    x: Array,
    u: Array,
    p: Array,
    implicit: str = "'implicit_midpoint'",
) -> str | None:
    """What is wrong with a step `h` and what to do, in words; None where it is stable."""
    todo = remedy(model, h, x, u, p, implicit)
    return todo and (
        f"steps of {h:.3g} s of Runge–Kutta's method are unstable, so that errors grow without "
        f"end; {todo}"
    )


def warn_of_unstable_step(
    name: str, model: ControlModel, h: float, at: Sequence[Array], stacklevel: int = 3
) -> None:
    """Warn of a step that is unstable at x, u and p; `name` says whose it is."""
    x, u, p = at
    wrong = unstable_step(model, h, x, u, p)
    if wrong:
        warnings.warn(f"{name}: {wrong}", stacklevel=stacklevel)


def _modes(model: ControlModel, x: Array, u: Array, p: Array) -> Array:
    motion = model.second_order
    if motion is None:
        return np.asarray(np.linalg.eigvals(_slope(lambda x: model.xdot(x, u, p), x, x.size)))
    modes, still = np.linalg.eigvals(_in_vacuum(motion, x, p)), np.zeros(motion.velocities)
    others = motion.balance.size1_out("other_rates")
    if others:
        rates = lambda x: motion.balance(x, still, u, p)[1]  # noqa: E731
        modes = np.concatenate([modes, np.linalg.eigvals(_slope(rates, x, others))])
    return np.asarray(modes)


def _in_vacuum(motion: SecondOrder, x: Array, p: Array) -> Array:
    mass, damping, stiffness = (matrix.full() for matrix in motion.matrices(x, p))
    n = len(mass)
    by_mass = np.linalg.solve(mass, np.hstack([-stiffness, -damping]))
    return np.vstack([np.eye(n, 2 * n, n), by_mass])


def _slope(f: Callable[[Array], ca.DM], x: Array, size: int) -> Array:
    """Derivative of f by the last entries of x, as many as f has, by central differences."""
    columns = []
    for i in range(x.size - size, x.size):
        step = np.zeros(x.size)
        step[i] = 1e-6 * max(abs(x[i]), 1.0)
        columns.append((f(x + step) - f(x - step)).full().ravel() / (2 * step[i]))
    return np.column_stack(columns)


def _radius(angles: Array) -> Array:
    """|z| at which |R(z)| passes 1, in directions of the left half-plane, by bisection."""
    low, high = np.full(angles.shape, 2.0), np.full(angles.shape, 4.0)
    for _ in range(50):
        middle = (low + high) / 2
        z = middle * np.exp(1j * angles)
        grows = abs(1 + z * (1 + z / 2 * (1 + z / 3 * (1 + z / 4)))) > 1
        low, high = np.where(grows, low, middle), np.where(grows, middle, high)
    return low
