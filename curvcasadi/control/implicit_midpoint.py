"""The implicit midpoint rule for models with inertia, attitudes on the group.

The unknowns are the rates z = (a, l) of the velocities v and of the parts o of first order. With
c ⊕ δ for a configuration c that is moved by the error state δ, m for the middle of the step:

    v_m = v + h/2 a,   o_m = o + h/2 l,   c_m = c ⊕ h/2 κ,   κ = kinematics(c_m, v_m)
    balance(x_m, a, u, p) = 0,   l = other_rates(x_m, a, u, p)
    v⁺ = v + h a,      o⁺ = o + h l,      c⁺ = c ⊕ h κ

The rule is symmetric in time, of order 2, and stable for what is linear and stiff at any step. The
iteration a ← a − A⁻¹ balance with A = M + h/2 C + h²/4 S, constant over the step, takes no
derivative of the balance, and l ← l − (l − other_rates)/(1 + h/2 d) only the rates d at which o
decays, where a model has them; Newton's takes all of them. It starts at

    a = A⁻¹ (g − C v − S (c + h/2 v)),

where g is a guess of the forces that are neither inertial nor of C and S. They change little from
step to step where stiff modes make the accelerations change at once, so that simulations
extrapolate g, not a.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from curvcasadi.control.error_state import add
from curvcasadi.control.iteration import iterated, relative_size
from curvcasadi.control.model import ControlModel, SecondOrder, symbols_of
from curvcasadi.symbolic.derivatives import with_jacobian
from curvcasadi.symbolic.expressions import AnyExpr
from curvcasadi.symbolic.layout import Layout
from curvcasadi.symbolic.ldl import ldl_factors, ldl_substitute, upper_triangle

#: Relative correction of the rates at which an implicit step has converged.
TOLERANCE = 1e-10
#: Most iterations of a step.
ITERATIONS = 30


@dataclass(frozen=True, eq=False, kw_only=True)
class Midpoint:
    """The rule for one model, and how its equations are solved."""

    model: ControlModel
    motion: SecondOrder
    newton: bool = False
    iterations: int = ITERATIONS
    tolerance: float = TOLERANCE

    @property
    def n_rates(self) -> int:
        """Number of unknown rates."""
        return self.motion.velocities + int(self.motion.balance.size1_out("other_rates"))

    @property
    def symbols(self) -> list[ca.MX]:
        """x, u and p."""
        return symbols_of(self.model)

    @property
    def configuration(self) -> Layout:
        """The parts of the configuration."""
        return Layout(self.model.x.parts[: self.motion.configuration])


def midpoint_step(rule: Midpoint, h: float) -> ca.Function:
    """(x, u, p) -> x_next, residual, with the Jacobian of the implicit function."""
    x, u, p = rule.symbols
    x_next, residual, _, _ = midpoint_solver(rule)(x, u, p, h, ca.DM.zeros(rule.n_rates))
    end = ca.MX.sym("out_x_next", rule.model.x.size)
    (_, v, o), (_, v_next, o_next) = _split(rule, x), _split(rule, end)
    rates = ca.vertcat(v_next - v, o_next - o) / h
    return with_jacobian(
        f"{rule.model.name}_step",
        {"x": x, "u": u, "p": p},
        {"x_next": x_next, "residual": residual},
        {"x_next": _slope(rule, h, x, u, p, rates)},
        nominal={"x_next": end},
    )


def midpoint_step_of_any_length(rule: Midpoint) -> ca.Function:
    """(x, u, p, h) -> x_next, residual, rates; no derivative is taken by the length h, which may
    be zero."""
    x, u, p = rule.symbols
    h, rates = ca.MX.sym("h"), ca.MX.sym("out_rates", rule.n_rates)
    z, residual, *_ = _solved(rule, x, u, p, h, ca.MX.zeros(rule.n_rates))
    return with_jacobian(
        f"{rule.model.name}_step_of",
        {"x": x, "u": u, "p": p, "h": h},
        {"x_next": after(rule, h, 1.0, x, z), "residual": residual, "rates": z},
        {"x_next": _slope(rule, h, x, u, p, rates)},
        held=["h"],
        nominal={"rates": rates},
    )


def midpoint_solver(rule: Midpoint) -> ca.Function:
    """(x, u, p, h, guess) -> x_next, residual, forces, iterations.

    `guess` and `forces` are (g, l); `residual` is the last correction of the accelerations over
    their size, NaN where the iteration diverged; `iterations` counts balances.
    """
    x, u, p = rule.symbols
    h, guess = ca.MX.sym("h"), ca.MX.sym("guess", rule.n_rates)
    z, residual, count, matrix, linear = _solved(rule, x, u, p, h, guess)
    a, rates = ca.vertsplit(z, [0, rule.motion.velocities, rule.n_rates])
    forces = ca.vertcat(matrix @ a + linear, rates)
    return ca.Function(
        f"{rule.model.name}_midpoint",
        [x, u, p, h, guess],
        [after(rule, h, 1.0, x, z), residual, forces, count],
        ["x", "u", "p", "h", "guess"],
        ["x_next", "residual", "forces", "iterations"],
    )


def _solved(
    rule: Midpoint, x: ca.MX, u: ca.MX, p: ca.MX, h: ca.MX, guess: ca.MX
) -> tuple[ca.MX, ...]:
    """Rates z, residual, iterations; and A and C v + S (c + h/2 v)."""
    nv = rule.motion.velocities
    matrix, factors, linear, elastic = _linear_part(rule, h, x, p)
    force, rates = ca.vertsplit(guess, [0, nv, rule.n_rates])
    start = ca.vertcat(ldl_substitute(nv)(factors, force - linear), rates)
    decay = ca.MX.zeros(rule.n_rates - nv)
    if rule.motion.decays is not None:
        decay = rule.motion.decays(x, p)
    z, residual, count = _loop(rule)(start, x, u, p, h, factors, elastic, decay)
    return z, residual, count, matrix, linear


def after(rule: Midpoint, h: AnyExpr, share: float, x: ca.MX, z: ca.MX) -> ca.MX:
    """The state after a share of the step, ½ or 1, with the rates z."""
    nv = rule.motion.velocities
    c, v, o = _split(rule, x)
    a, rates = ca.vertsplit(z, [0, nv, rule.n_rates])
    v_middle = v + h / 2 * a
    kappa = rule.motion.kinematics(ca.vertcat(c, v_middle, o))
    if any(part.attitude for part in rule.configuration.parts):
        # Body rates do not depend on the attitude, so one more evaluation is exact.
        turned = add(rule.configuration, c, h / 2 * kappa)
        kappa = rule.motion.kinematics(ca.vertcat(turned, v_middle, o))
    moved = add(rule.configuration, c, share * h * kappa)
    return ca.vertcat(moved, v + share * h * a, o + share * h * rates)


def errors(rule: Midpoint, h: AnyExpr, x: ca.MX, u: ca.MX, p: ca.MX, z: ca.MX) -> ca.MX:
    """What is zero at the solution: the balance at the middle, and l − other_rates."""
    nv = rule.motion.velocities
    balance, rates = rule.motion.balance(after(rule, h, 0.5, x, z), z[:nv], u, p)
    return ca.vertcat(balance, z[nv:] - rates)


def _split(rule: Midpoint, x: ca.MX) -> list[ca.MX]:
    """Configuration, velocities, and parts of first order."""
    start = rule.configuration.size
    pieces: list[ca.MX] = ca.vertsplit(
        x, [0, start, start + rule.motion.velocities, rule.model.x.size]
    )
    return pieces


def _linear_part(rule: Midpoint, h: ca.MX, x: ca.MX, p: ca.MX) -> tuple[ca.MX, ...]:
    """A, its factors, C v + S (c + h/2 v), and |A⁻¹ S c|.

    Accelerations are known to rounding of the last, not better. The mass matrix is that of the
    configuration to which the velocities lead in half a step.
    """
    nv = rule.motion.velocities
    halfway = after(rule, h, 0.5, x, ca.MX.zeros(rule.n_rates))
    mass, damping, stiffness = rule.motion.matrices(halfway, p)
    matrix = ca.densify(mass + h / 2 * damping + h**2 / 4 * stiffness)
    factors: Any = ldl_factors(nv)(upper_triangle(matrix))  # once for all iterations
    c, v, _ = _split(rule, x)
    parts = rule.configuration.split(c)
    errors = (
        ca.MX(3, 1) if part.attitude else parts[part.name] for part in rule.configuration.parts
    )
    elastic = ca.densify(stiffness @ ca.vertcat(*errors))
    linear = elastic + h / 2 * (stiffness @ v) + damping @ v
    size = ca.norm_1(ldl_substitute(nv)(factors, elastic))
    return matrix, factors, ca.densify(linear), size


def _loop(rule: Midpoint) -> ca.Function:
    """(z, x, u, p, h, factors of A, elastic size, decay) -> z, residual, count."""
    nv = rule.motion.velocities
    z, constants = ca.MX.sym("z", rule.n_rates), [*rule.symbols, ca.MX.sym("h")]
    constants += [ca.MX.sym("factors", nv * (nv + 1) // 2), ca.MX.sym("elastic")]
    constants.append(ca.MX.sym("decay", rule.n_rates - nv))
    better = ca.Function("iteration", [z, *constants], _iteration(rule, z, *constants))
    return iterated(better, rule.iterations, rule.tolerance)


def _iteration(
    rule: Midpoint,
    z: ca.MX,
    x: ca.MX,
    u: ca.MX,
    p: ca.MX,
    h: ca.MX,
    factors: ca.MX,
    elastic: ca.MX,
    decay: ca.MX,
) -> tuple[ca.MX, ca.MX]:
    """Better rates, and the size of the correction over that of the rates."""
    nv = rule.motion.velocities
    error = errors(rule, h, x, u, p, z)
    if rule.newton:
        change = ca.solve(ca.densify(ca.jacobian(error, z)), error, "qr")
    else:
        others = error[nv:] / (1 + h / 2 * decay)
        change = ca.vertcat(ldl_substitute(nv)(factors, error[:nv]), others)
    z_next = z - change
    _, v, o = _split(rule, x)
    real = rule.model.real
    # Times h, so that a step of no length has converged.
    size = h * (ca.norm_1(z_next[:nv]) + elastic) + ca.norm_1(v)
    relative = relative_size(h * change[:nv], size, real)
    if o.numel():
        size = h * ca.norm_1(z_next[nv:]) + ca.norm_1(o)
        relative += relative_size(h * change[nv:], size, real)
    return z_next, relative


def _slope(rule: Midpoint, h: AnyExpr, x: ca.MX, u: ca.MX, p: ca.MX, rates: ca.MX) -> ca.MX:
    """d x_next / d(x, u, p) where F(x, u, p, z) = 0:  dz = −F_z⁻¹ dF, z = `rates`."""
    n_inputs = x.numel() + u.numel() + p.numel()
    stacked, length = ca.MX.sym("inputs", n_inputs + rule.n_rates), ca.MX.sym("h")
    ends = np.cumsum([0, x.numel(), u.numel(), p.numel(), rule.n_rates]).tolist()
    arguments = ca.vertsplit(stacked, ends)
    results = [
        errors(rule, length, *arguments),
        after(rule, length, 1.0, arguments[0], arguments[3]),
    ]
    slopes = [ca.densify(ca.jacobian(result, stacked)) for result in results]
    f, g = ca.Function("slopes", [stacked, length], slopes)(ca.vertcat(x, u, p, rates), h)
    f_inputs, f_z = ca.horzsplit(f, [0, n_inputs, stacked.numel()])
    g_inputs, g_z = ca.horzsplit(g, [0, n_inputs, stacked.numel()])
    return g_inputs - g_z @ ca.solve(f_z, f_inputs, "qr")
