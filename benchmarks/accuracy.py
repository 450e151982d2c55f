"""Errors: orders of the rules, the paper's approximations, rotations, closed forms."""

from __future__ import annotations

from itertools import product
from math import ceil, log2

import casadi as ca
import numpy as np
from numpy.polynomial import legendre
from scipy.linalg import expm
from scipy.special import fresnel

import curvcasadi as cc
from benchmarks.table import Check, Table, checked, compared
from curvcasadi.beam.grid import ExponentialName, RuleName
from curvcasadi.symbolic.expressions import Array
from tests.support.wing import (
    LENGTH,
    ORDERS,
    RULES,
    WEIGHTS,
    elements_for,
    non_orthogonality,
    position_error,
    tip_error,
    tip_pose,
    wing,
)

#: Case 21: K, rad/m, s, m, and tip position, m, of one segment of constant curvature, as published
#: to ten digits from scipy.linalg.expm of the 4 × 4 twist matrix.
CASE_21 = (
    ((0.3, -0.8, 0.2), 1.0, (0.8909508551, 0.05525784899, 0.3846051133)),
    ((2.0, -3.0, 1.0), 1.5, (0.3099200549, -0.6985756288, 0.2844330039)),
    ((0.0, -3.141592654, 0.0), 1.0, (0.0, 0.0, 0.6366197724)),
    ((1e-7, 2e-7, -1e-7), 1.0, (1.0, -4.999999667e-8, -1.000000017e-7)),
    ((5.0, 0.0, 0.0), 2.0, (2.0, 0.0, 0.0)),
)


def rules() -> Table:
    """Tip error and observed order of the four rules on the test wing."""
    checks = [
        Check(
            what="tip error, 16 magnus4 elements, in L",
            value=tip_error(16),
            form="{:.1e}",
            high=2e-6,
        )
    ]
    for rule in RULES:
        coarse, fine = tip_error(16, rule), tip_error(32, rule)
        checks.append(
            Check(
                what=f"observed order of {rule}, 16 to 32 elements",
                value=log2(coarse / fine),
                form="{:.2f}",
                low=ORDERS[rule] - 0.1,
                high=ORDERS[rule] + 0.1,
            )
        )
    return checked("Test wing: 16 m, Legendre 4 a channel, uniform elements", checks)


def errors() -> Table:
    """Tip errors of the four rules on the test wing, and what 1e-8 L takes."""
    sizes, target = (8, 16, 32, 64, 128), 1e-8
    rows = [
        (rule, *(f"{tip_error(n, rule):.1e}" for n in sizes), str(elements_for(target, rule)))
        for rule in RULES
    ]
    headers = ("rule", *(f"{n} elements" for n in sizes), f"elements for {target:g}")
    return compared("Tip error of the test wing, in L", headers, rows)


def approximations() -> Table:
    """The paper's approximations, and Eq. 14's Euler step, on the test wing."""
    sizes = (16, 64, 256)
    names: dict[ExponentialName, str] = {
        "series": "exact, as polynomials",
        "rodrigues": "exact, Eqs. 6 and 13",
        "small_angle_sine": "Eq. 15",
        "small_angle": "Eqs. 16–18",
    }
    chosen: tuple[RuleName, ...] = ("trapezoid", "magnus4")
    rows = []
    for rule, exponential in product(chosen, names):
        tips = [tip_pose(wing(n, rule, exponential)) for n in sizes]
        rows.append(_approximation_row(f"{exponential} ({names[exponential]})", rule, tips))
    euler = [euler_tip(WEIGHTS, n) for n in sizes]
    rows.append(_approximation_row("Euler step (Eq. 14)", "start of element", euler))
    return compared(
        "The paper's approximations on the test wing",
        (
            "exponential",
            "curvature",
            *(f"tip error / L, {n}" for n in sizes),
            f"RᵀR − I, {sizes[-1]}",
        ),
        rows,
        ("Columns: number of elements; the last is the largest entry of |RᵀR − I| at the tip.",),
    )


def _approximation_row(name: str, rule: str, tips: list[tuple[Array, Array]]) -> tuple[str, ...]:
    errors = [f"{position_error(position):.1e}" for _, position in tips]
    return name, rule, *errors, f"{non_orthogonality(tips[-1][0]):.0e}"


def euler_tip(q: Array, elements: int, length: float = LENGTH) -> tuple[Array, Array]:
    """Tip of Eq. 14's step on Legendre weights q: R ← R (I + h [K×]), p ← p + h R e_x."""
    h = length / elements
    z = np.linspace(-1, 1, elements, endpoint=False)
    curvatures = q.reshape(3, -1) @ legendre.legvander(z, q.size // 3 - 1).T
    rotation, position = np.eye(3), np.zeros(3)
    for k in curvatures.T:
        position = position + h * rotation[:, 0]
        rotation = rotation + h * np.cross(rotation, k)
    return rotation, position


def rotations() -> Table:
    """Orthogonality of the rotation after many elements."""
    elements = 10_000
    coil = cc.Beam(  # every element turns 0.54 rad
        length=float(elements), basis=wing(1, per_channel=1).basis, grid=cc.Grid.uniform(elements)
    )
    turn = np.array([0.3, -0.4, 0.2])
    euler, _ = euler_tip(WEIGHTS, elements)
    return checked(
        "Rotation after 10 000 magnus4 elements: largest entry of |RᵀR − I|",
        [
            Check(
                what="test wing",
                value=non_orthogonality(tip_pose(wing(elements))[0]),
                high=5e-12,
                form="{:.1e}",
            ),
            Check(
                what="coil, 0.54 rad an element, 860 turns",
                value=non_orthogonality(tip_pose(coil, turn)[0]),
                high=5e-12,
                form="{:.1e}",
            ),
            Check(
                what="test wing, Eq. 14's Euler step R(I + h[K×])",
                value=non_orthogonality(euler),
                form="{:.1e}",
            ),
            Check(
                what="test wing, Eq. 14's Euler step, 100 elements",
                value=non_orthogonality(euler_tip(WEIGHTS, 100)[0]),
                form="{:.1e}",
            ),
        ],
    )


def closed_forms() -> Table:
    """Circle, helix, clothoid and case 21."""
    checks = [
        _exact("circle, a quarter turn, 4 elements", (0, -np.pi / 2 / LENGTH, 0), LENGTH, 4),
        _exact("circle, a full turn, 8 elements", (0, -2 * np.pi / LENGTH, 0), LENGTH, 8),
        _exact("helix, torsion and bending, 16 elements", (0.3, -0.5, 0), LENGTH, 16),
    ]
    checks += [_clothoid_order(rule) for rule in RULES]
    for k, (curvature, length, printed) in enumerate(CASE_21, start=1):
        elements = max(1, ceil(float(np.linalg.norm(curvature)) * length))
        rotation, position = tip_pose(_rod(length, elements, "magnus4"), _vector(curvature))
        pose = _exponential(curvature, length)
        off = max(np.abs(rotation - pose[:3, :3]).max(), np.abs(position - pose[:3, 3]).max())
        digits = np.abs(position - printed).max() / length
        checks += [
            Check(
                what=f"case 21, row {k}, N = {elements}: pose against expm",
                value=float(off),
                high=1e-12 * length,
                form="{:.1e}",
            ),
            Check(
                what=f"case 21, row {k}, N = {elements}: position against ten printed digits, in L",
                value=float(digits),
                high=5e-10,
                form="{:.1e}",
            ),
        ]
    return checked(
        "Closed forms",
        checks,
        (
            "Constant curvature is exact in any number of elements; case 21 takes as many as",
            "`Grid.max_angle` = 1 rad asks for. The clothoid (K_y linear, Fresnel integrals) turns",
            "2 rad; its error falls at the rule's order.",
        ),
    )


def _exact(what: str, curvature: tuple[float, float, float], length: float, n: int) -> Check:
    """Tip position error over the length of a rod of constant curvature."""
    position = tip_pose(_rod(length, n, "magnus4"), _vector(curvature))[1]
    error = np.linalg.norm(position - helix(curvature, length)) / length
    return Check(what=f"{what}: error in L", value=float(error), high=1e-12, form="{:.1e}")


def _clothoid_order(rule: RuleName) -> Check:
    """Observed order on K_y = −c s from the tip errors of 8 and 16 elements."""
    turn = 2.0
    exact = clothoid(turn, LENGTH)
    # −c s = −(c L/2) (P_0 + P_1) with c = 2 turn/L²
    q = np.array([0, 0, -turn / LENGTH, -turn / LENGTH, 0, 0])
    errors = []
    for n in (8, 16):
        position = tip_pose(_rod(LENGTH, n, rule, 2), q)[1]
        errors.append(float(np.linalg.norm(position - exact)) / LENGTH)
    return Check(
        what=f"clothoid, {rule}: order, 8 to 16 elements (error {errors[1]:.0e} L)",
        value=log2(errors[0] / errors[1]),
        low=ORDERS[rule] - 0.2,
        form="{:.2f}",
    )


def helix(curvature: tuple[float, float, float], length: float) -> Array:
    """Tip of a rod of constant curvature K = (τ, κ, 0), ω = |K|, m.

    p = s e_x − (1 − cos ωs)/ω² κ e_z + (ωs − sin ωs)/ω³ (−κ² e_x + τκ e_y)
    """
    tau, kappa, _ = curvature
    omega = float(np.hypot(tau, kappa))
    sine, cosine = np.sin(omega * length), np.cos(omega * length)
    drift = (omega * length - sine) / omega**3
    return np.array(
        [
            length - drift * kappa**2,
            drift * tau * kappa,
            -(1 - cosine) / omega**2 * kappa,
        ]
    )


def clothoid(turn: float, length: float) -> Array:
    """Tip of K_y = −c s that turns `turn` rad up: ∫ (cos, 0, sin)(c s²/2) ds, m."""
    scale = np.sqrt(np.pi * length**2 / (2 * turn))
    sine, cosine = fresnel(length / scale)
    return np.array([scale * cosine, 0.0, scale * sine])


def _rod(length: float, elements: int, rule: RuleName, per_channel: int = 1) -> cc.Beam:
    family = cc.Legendre(per_channel)
    basis = cc.ChannelBasis(torsion=family, out_of_plane=family, in_plane=family)
    # a hair above 1 rad: the rounding of |K| s/n must not refuse a whole number of elements
    grid = cc.Grid.uniform(elements, rule=rule, max_angle=1.0001)
    return cc.Beam(length=length, basis=basis, grid=grid)


def _vector(values: tuple[float, float, float]) -> Array:
    return np.array(values, dtype=float)


def _exponential(curvature: tuple[float, float, float], length: float) -> Array:
    """Pose (4, 4): expm of s [[K×, e_x], [0, 0]]."""
    twist = np.zeros((4, 4))
    twist[:3, :3] = ca.skew(ca.DM(curvature)).full()
    twist[0, 3] = 1
    return np.asarray(expm(length * twist))
