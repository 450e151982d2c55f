"""Can the wing tip follow a path while a disturbance bends the wing?

    min_u  ½ Σ_k |p_k − p_d,k|² + 25 |log(R_d,kᵀ R_k)|² + 10⁻² |u_k − u_{k−1}|²
    τ dq/dt = u + d − q,   |dq/dt| ≤ 0.25 rad/(m s),   |K| ≤ 0.2 rad/m

At 2 s a disturbance d, unknown to the controller, adds upward bending. An observer compares every
measured q with the prediction and hands its estimate of d to the next step. One real-time iteration
of the MPC runs every 50 ms. `--animate` writes a GIF.
"""

import argparse
from pathlib import Path

import casadi as ca
import numpy as np
from matplotlib.figure import Figure

import curvcasadi as cc
from curvcasadi.plotting import animate_shape
from curvcasadi.reference_wings import hale_wing

DT, STAGES, STEPS = 0.05, 8, 120
TAU = 0.25  # s
GUST_AT = 2.0  # s
OBSERVER_GAIN = 0.3  # part of the prediction error that is taken for disturbance


def path_weights(t: float) -> ca.DM:
    """Weights of a wing that flaps by ±3.5 m and twists by ±6°: its tip is the path."""
    q = np.zeros(9)
    q[0], q[3] = 0.007 * np.sin(2 * t), -0.03 * (1 - np.cos(1.5 * t)) / 2 - 0.005
    return ca.DM(q)


def simulate() -> dict[str, np.ndarray]:
    wing = hale_wing()
    model = cc.kinematic_model(wing, time_constant=TAU)
    step = cc.tip_path_step_function(
        model,
        dt=DT,
        horizon=STAGES,
        attitude_weight=25,
        rate_bound=0.25,
        curvature_bound=0.2,
        iterations=1,
    )
    plant, tip = cc.rk4_step(model, DT), cc.tip_function(wing)
    gust = ca.DM([0, 0, 0, -0.02, 0.01, 0, 0, 0, 0])  # rad/m

    q = u = estimate = ca.DM.zeros(9)
    plan = ca.DM.zeros(step.size_in("guess"))
    log: dict[str, list[np.ndarray]] = {"time": [], "q": [], "position": [], "desired": []}
    for k in range(STEPS):
        poses = [tip(path_weights((k + 1 + j) * DT)) for j in range(STAGES)]
        goals, frames = (ca.horzcat(*part) for part in zip(*poses, strict=True))
        u, plan, *_ = step(q, estimate, u, goals, frames, plan)
        predicted = plant(q, u, estimate)
        q = plant(q, u, gust if k * DT >= GUST_AT else 0)
        estimate += OBSERVER_GAIN * (q - predicted) / (1 - np.exp(-DT / TAU))
        log["time"].append(np.array((k + 1) * DT))
        log["q"].append(q.full().ravel())
        log["position"].append(tip(q)[0].full().ravel())
        log["desired"].append(goals[:, 0].full().ravel())
    return {key: np.array(value) for key, value in log.items()}


def plot(log: dict[str, np.ndarray]) -> Figure:
    figure = Figure(figsize=(6.4, 4.8), layout="constrained")
    height, error = figure.subplots(2, 1, sharex=True)
    height.plot(log["time"], -log["desired"][:, 2], color="0.6", lw=3, label="path")
    height.plot(log["time"], -log["position"][:, 2], color="black", lw=1, label="tip")
    height.set_ylabel("tip height $-z$ [m]")
    distance = np.linalg.norm(log["position"] - log["desired"], axis=1)
    error.semilogy(log["time"], distance, color="black")
    error.set(xlabel="time [s]", ylabel="distance to the path [m]")
    for axes in (height, error):
        axes.axvline(GUST_AT, color="tab:red", ls="--", lw=1, label="disturbance begins")
    height.legend(frameon=False, ncols=3, loc="lower center", bbox_to_anchor=(0.5, 1.0))
    return figure


def main(directory: Path = Path("out"), animate: bool = False) -> np.ndarray:
    log = simulate()
    distance = np.linalg.norm(log["position"] - log["desired"], axis=1)
    before, hit = log["time"] < GUST_AT, np.argmax(distance * (log["time"] > GUST_AT))
    print(f"distance to the path before the disturbance: {distance[before][-1]:.1e} m")
    print(f"largest after it: {distance[hit]:.3f} m; at the end: {distance[-1]:.1e} m")
    directory.mkdir(exist_ok=True)
    plot(log).savefig(directory / "track_tip_path_mpc.png", dpi=150)
    if animate:
        animate_shape(hale_wing(), log["time"], log["q"], directory / "track_tip_path_mpc.gif")
    return distance


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--animate", action="store_true", help="write a GIF of the wing")
    main(animate=parser.parse_args().animate)
