"""Which curvature explains markers that were measured along the wing?

    min_q  ½ Σ_i |p(xi_i; q) − m_i|²/L²,      m_i = p(xi_i; q_true) + noise

Ten markers on the 16 m HALE wing, each with 2 mm of noise per axis. Nine weights take up nine of
the thirty readings, so the residual of a right fit is near σ (1 − 9/30)^½ = 1.67 mm per axis.
"""

from pathlib import Path

import casadi as ca
import numpy as np
from matplotlib.figure import Figure

import curvcasadi as cc
from curvcasadi.reference_wings import hale_wing

SIGMA = 2e-3  # m, per axis
STATIONS = np.linspace(0.1, 1.0, 10)
TRUTH = [0.02, -0.01, 0, -0.06, 0.03, -0.01, 0, 0.002, 0]  # rad/m


def positions(wing: cc.Beam, q: ca.DM) -> np.ndarray:
    """Positions (3, 10) of the markers, m, body axes."""
    return np.hstack([cc.pose_at(wing, q, xi).position.full() for xi in STATIONS])


def main(directory: Path = Path("out")) -> float:
    wing = hale_wing()
    noise = np.random.default_rng(7).normal(scale=SIGMA, size=(3, len(STATIONS)))
    measured = positions(wing, ca.DM(TRUTH)) + noise
    markers = [
        cc.Target(xi=xi, position=marker, weight=1.0)
        for xi, marker in zip(STATIONS, measured.T, strict=True)
    ]
    fit = cc.reach_shape(wing, markers, regularization=1e-12)

    residual = np.sqrt(np.mean(fit.distances**2) / 3)
    expected = SIGMA * np.sqrt(1 - wing.basis.n / measured.size)
    error = positions(wing, fit.q) - positions(wing, ca.DM(TRUTH))
    print(f"residual per axis: {1e3 * residual:.2f} mm, expected {1e3 * expected:.2f} mm")
    print(f"shape error per axis: {1e3 * np.sqrt(np.mean(error**2)):.2f} mm")

    directory.mkdir(exist_ok=True)
    figure = Figure(figsize=(6.4, 3.6), layout="constrained")
    axes = figure.subplots()
    fine = cc.shape_map(wing, fit.q).positions.full()
    axes.plot(fine[1], -fine[2], color="black", label="fitted wing")
    axes.plot(measured[1], -measured[2], "o", color="tab:red", label="measured markers")
    axes.set(xlabel="span $y$ [m]", ylabel="height $-z$ [m]", aspect="equal")
    axes.legend(frameon=False)
    figure.savefig(directory / "match_measured_shape.png", dpi=150)
    return float(residual / expected)


if __name__ == "__main__":
    main()
