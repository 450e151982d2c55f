"""What do curvature weights gain over superposed Euler angles, up to a tip deflection of 60 %?

    min_q  ½ Σ_i |p(xi_i; q) − p_i|²/L² + |log(R_iᵀ R(xi_i; q))|²       eight stations, no noise

Three models with nine unknowns each, three for torsion, out-of-plane and in-plane. All use Legendre
polynomials P_k or their integrals from the root, F_k' = P_k and G_k'' = P_k, so that for small
deflections they are one and the same model:

    displacement modes    p = (s, v, w),  v, −w = Σ G_k q_k,  φ = Σ F_k q_k,  R = exp(φ, −w', v')
    Euler angles          φ, θ, ψ = Σ F_k q_k,  R = R_z(ψ) R_y(θ) R_x(φ),  p = ∫ R e_x ds
    curvature weights     K = Σ P_k q_k,  R' = R [K×],  p = ∫ R e_x ds

The first is linear modal practice: displacements and small angles add up; taking the angles for a
rotation vector is the kindest reading. The second adds up angles too, but keeps rotations and the
length exact; in plane bending it equals the third. Errors are the largest along the wing.

Both truths come from an ODE solver. A wing under lift, drag and pitching moment lies in none of the
models: Euler angles come near to curvature weights there. A wing whose curvature has nine weights
is recovered to rounding by the third alone, as one with nine weights of angles would be by the
second.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np
from matplotlib.figure import Figure
from numpy.polynomial import Legendre
from scipy.integrate import solve_ivp
from scipy.optimize import brentq, least_squares

import curvcasadi as cc
from curvcasadi.lie import so3
from curvcasadi.reference_wings import hale_wing

N = 32  # stations xi = 1/32 … 1; every fourth is measured
XI = np.arange(1, N + 1) / N
DEFLECTIONS = np.r_[0.01, 0.025, np.arange(1, 13) / 20]  # of the tip, over the span
WING = replace(
    hale_wing(3, 3, 3, grid=cc.Grid.uniform(N, rule="magnus6")),
    root=cc.Pose.identity(),
    weight_bounds=None,
)
L = WING.length
STIFFNESS = np.array([1e4, 2e4, 4e6])  # the HALE wing's G J, E I_y, E I_z, N m²
FORCE, MOMENT = np.array([0, -10, 60]), np.array([40, 0, 0])  # N/m, N m/m, section axes
WEIGHTS = np.array([0.02, -0.01, 0, -0.06, 0.03, -0.01, 0, 0.002, 0])  # rad/m

Shape = tuple[ca.SX, list[ca.SX]]  # positions (3, 32), m, and 32 rotations; root axes


def integrals(times: int, q: ca.SX, xi: np.ndarray) -> ca.SX:
    """Σ q_k ∫…∫ P_k ds, a row a channel, (3, len(xi))."""
    family = [Legendre.basis(k, domain=[0, 1]).integ(times, lbnd=0) for k in range(3)]
    return ca.reshape(q, 3, 3).T @ ca.DM(L**times * np.array([f(xi) for f in family]))


def displacement_modes(q: ca.SX) -> Shape:
    moved = integrals(2, q, XI)
    positions = ca.vertcat(ca.DM(L * XI).T, moved[2, :], -moved[1, :])
    return positions, [so3.exp(angles) for angles in ca.horzsplit(integrals(1, q, XI))]


def rotation(angles: ca.SX) -> ca.SX:
    """R_z(ψ) R_y(θ) R_x(φ) of the angles (φ, θ, ψ)."""
    x, y, z = (so3.exp(angles[k] * ca.DM.eye(3)[:, k], degree=12) for k in range(3))
    return z @ y @ x


def euler_angles(q: ca.SX) -> Shape:
    nodes, weights = np.polynomial.legendre.leggauss(8)  # between each two stations
    between = ((XI - 1 / N)[:, None] + (1 + nodes) / (2 * N)).ravel()
    tangents = [rotation(angles)[:, 0] for angles in ca.horzsplit(integrals(1, q, between))]
    sums = np.kron(np.triu(np.ones((N, N))), weights[:, None] * L / (2 * N))
    rotations = [rotation(angles) for angles in ca.horzsplit(integrals(1, q, XI))]
    return ca.horzcat(*tangents) @ ca.DM(sums), rotations


def curvature_weights(q: ca.SX) -> Shape:
    shape = cc.shape_map(WING, q)
    return shape.positions[:, 1:], [pose.rotation for pose in shape.poses[1:]]


MODELS = {
    "displacement modes": displacement_modes,
    "Euler angles": euler_angles,
    "curvature weights": curvature_weights,
}


def hat(a: Sequence[float]) -> np.ndarray:
    """[a×], as numpy arrays: `np.cross` of single vectors takes ten times as long."""
    return np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])


def loaded_wing(scale: float) -> tuple[np.ndarray, np.ndarray]:
    """The wing under `scale` times the loads, from its free tip inward.

    M' = −K × M − e_x × F − m,   F' = −K × F − f,   K = (M_x/GJ, M_y/EI_y, M_z/EI_z)
    """

    def slope(s: float, y: np.ndarray) -> np.ndarray:
        R, M, F = y[:9].reshape(3, 3), y[12:15], y[15:]
        K_hat = hat(M / STIFFNESS)
        dM = -K_hat @ M - hat([1, 0, 0]) @ F - scale * MOMENT
        return np.r_[(R @ K_hat).ravel(), R[:, 0], dM, -K_hat @ F - scale * FORCE]

    return integrate(slope, np.r_[np.eye(3).ravel(), np.zeros(9)], L * np.r_[XI[::-1], 0])


def prescribed_wing(scale: float) -> tuple[np.ndarray, np.ndarray]:
    """The wing with `scale` times the weights: R' = R [K×], p' = R e_x."""

    def slope(s: float, y: np.ndarray) -> np.ndarray:
        R, K = y[:9].reshape(3, 3), scale * WING.basis(s / L) @ WEIGHTS
        return np.r_[(R @ hat(K)).ravel(), R[:, 0]]

    return integrate(slope, np.r_[np.eye(3).ravel(), np.zeros(3)], L * np.r_[0, XI])


def integrate(slope: Callable, start: np.ndarray, s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Positions (3, 32), m, and rotations (3, 96) in the axes of the root, s = 0."""
    y = solve_ivp(slope, s[[0, -1]], start, "DOP853", s, rtol=1e-13, atol=1e-13).y[:, np.argsort(s)]
    R, p = y[:9].T.reshape(-1, 3, 3), y[9:12]
    return R[0].T @ (p[:, 1:] - p[:, :1]), np.hstack(R[0].T @ R[1:])


def fit_all(model: Callable[[ca.SX], Shape], truths: list) -> np.ndarray:
    """Largest errors along each fitted wing, (2, truths): position over L, attitude in degrees."""
    q, p, R = ca.SX.sym("q", 9), ca.SX.sym("p", 3, N), ca.SX.sym("R", 3, 3 * N)
    positions, rotations = model(q)
    frames = zip(ca.horzsplit(R, 3), rotations, strict=True)
    all_errors = ca.vertcat((positions - p) / L, ca.horzcat(*(so3.log(a.T @ b) for a, b in frames)))
    measured = ca.vec(all_errors[:, 3::4])
    outputs = [all_errors, measured, ca.jacobian(measured, q)]
    errors = ca.Function("errors", [q, p, R], outputs)
    largest = []
    for truth in truths:
        best = least_squares(
            lambda q, truth=truth: errors(q, *truth)[1].full().ravel(),
            np.zeros(9),
            jac=lambda q, truth=truth: errors(q, *truth)[2].full(),
            **dict.fromkeys(("xtol", "ftol", "gtol"), 1e-15),
        )
        left = errors(best.x, *truth)[0].full().reshape(2, 3, N)
        largest.append(np.linalg.norm(left, axis=1).max(axis=1) * [1, 180 / np.pi])
    return np.transpose(largest)


def compare(wing: Callable, limit: float) -> dict[str, np.ndarray]:
    """Errors (2, deflections) of every model; at the scale `limit` the tip is beyond 60 %."""

    def miss(scale: float, deflection: float) -> float:
        return wing(scale)[0][2, -1] / L - deflection

    scales = [brentq(miss, 0, limit, (deflection,), 1e-6, 1e-6) for deflection in DEFLECTIONS]
    truths = [wing(scale) for scale in scales]
    return {name: fit_all(model, truths) for name, model in MODELS.items()}


def plot(cases: dict[str, dict[str, np.ndarray]]) -> Figure:
    figure = Figure(figsize=(8, 5.4), layout="constrained")
    axes = figure.subplots(2, len(cases), sharex=True)
    looks = ("s", "#D55E00"), ("^", "#009E73"), ("o", "#0072B2")  # for colour-blind readers too
    for column, (truth, case) in zip(axes.T, cases.items(), strict=True):
        for (label, errors), (marker, color) in zip(case.items(), looks, strict=True):
            for ax, error in zip(column, errors, strict=True):
                ax.semilogy(100 * DEFLECTIONS, error, marker, ls="-", color=color, label=label)
                ax.grid(color="0.9")
        column[0].set_title(truth, fontsize="medium")
        column[1].set(xlabel="tip deflection [% of span]", xlim=(0, 62))
    axes[0, 0].set_ylabel("largest position error / span")
    axes[1, 0].set_ylabel("largest attitude error [deg]")
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=3)
    return figure


def main(directory: Path = Path("out")) -> dict[str, dict[str, np.ndarray]]:
    cases = {
        "(a) Wing under lift, drag and moment": compare(loaded_wing, 0.6),
        "(b) Wing whose curvature has nine weights": compare(prescribed_wing, 2.0),
    }
    for truth, case in cases.items():
        print(f"{truth}: position error / span, attitude error in degrees")
        print(" tip  " + "".join(f"{name:>22s}" for name in case))
        for k in np.flatnonzero(np.isin(DEFLECTIONS, (0.05, 0.2, 0.4, 0.6))):
            row = (f"{error[0, k]:12.1e}, {error[1, k]:.1e}" for error in case.values())
            print(f"{DEFLECTIONS[k]:4.0%} " + " ".join(row))
    directory.mkdir(exist_ok=True)
    plot(cases).savefig(directory / "compare_with_euler_angles.png", dpi=150)
    return cases


if __name__ == "__main__":
    main()
