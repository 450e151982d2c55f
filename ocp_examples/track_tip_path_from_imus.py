"""Can the wing tip follow its path when the controller sees the wing through IMUs alone?

    τ dq/dt = u + d − q                   the wing, bent by an unknown disturbance d from 2 s on
    q' = q_dot,  q_dot' = white noise     what the filter believes
    min_u  ½ Σ_k |p_k − p_d,k|² + 25 |log(R_d,kᵀ R_k)|² + 300 |u_k − u_{k−1}|²

Four IMUs (gyro, accelerometer, magnetometer) at 100 Hz; one sample in five is missing, one in a
hundred is grossly wrong. The MPC takes the filter's q every 50 ms, and estimates d from what its
prediction missed. Does the tip stay on its path?
"""

from collections.abc import Iterator
from pathlib import Path

import casadi as ca
import numpy as np
from matplotlib.figure import Figure

import curvcasadi as cc
from curvcasadi.reference_wings import hale_wing

DT, STAGES, STEPS = 0.05, 8, 160  # of the MPC, s
SAMPLES = 5  # of the sensors in a step
TAU = 0.25  # s
GUST_AT = 2.0  # s
MOVES = 300  # weight of moves: noise is not to shake the wing, m²/rad²
OBSERVER_GAIN = 0.05  # part of the prediction error that is taken for disturbance
MISSING, GROSS = 0.2, 0.01  # parts of the samples

WING = hale_wing()
SENSORS = [
    sensor
    for xi in (0.25, 0.5, 0.75, 1.0)
    for sensor in (
        cc.RateGyro(xi=xi, noise_density=1e-3, rate=SAMPLES / DT),  # rad/√s
        cc.Accelerometer(xi=xi, noise_density=5e-3, rate=SAMPLES / DT),  # m/s² √s
        cc.Magnetometer(xi=xi, noise_density=3e-8, rate=SAMPLES / DT),  # T √s
    )
]
ROOT = cc.RootMotion(gravity=[0, 0, 9.80665], magnetic_field=[2e-5, 0, 4.4e-5])
DISTURBANCE = ca.DM([0, 0, 0, -0.02, 0.01, 0, 0, 0, 0])  # rad/m


def path_weights(t: float) -> ca.DM:
    """Weights of a wing that flaps by ±3.5 m and twists by ±6°: its tip is the path."""
    q = np.zeros(9)
    q[0], q[3] = 0.007 * np.sin(2 * t), -0.03 * (1 - np.cos(1.5 * t)) / 2 - 0.005
    return ca.DM(q)


def wing_and_sensors(
    model: cc.ControlModel, noise: np.ndarray, random: np.random.Generator
) -> Iterator[tuple[ca.DM, np.ndarray]]:
    """The truth: takes u and d, gives q and the samples since, one column each."""
    x = [ca.MX.sym(key, 9) for key in ("q", "q_dot", "q_ddot")]
    read = ca.Function("read", x, [cc.measure(SENSORS, WING, *x, root=ROOT).values])
    plant, q = cc.rk4_step(model, DT / SAMPLES), ca.DM.zeros(9)
    samples = np.zeros((len(noise), 0))
    while True:
        u, d = yield q, samples
        columns = []
        for _ in range(SAMPLES):
            q = plant(q, u, d)
            q_dot = (u + d - q) / TAU
            columns.append(read(q, q_dot, -q_dot / TAU).full()[:, 0])
        samples = np.stack(columns, axis=1)
        samples += noise[:, None] * random.normal(size=samples.shape)
        samples[random.random(samples.shape) < MISSING] = np.nan
        gross = random.random(samples.shape) < GROSS
        samples += gross * 100 * noise[:, None] * random.normal(size=samples.shape)


def simulate() -> dict[str, np.ndarray]:
    model = cc.kinematic_model(WING, time_constant=TAU)
    step = cc.tip_path_step_function(
        model, dt=DT, horizon=STAGES, attitude_weight=25, move_weight=MOVES, iterations=1
    )
    ekf = cc.shape_ekf(
        WING,
        SENSORS,
        process="white_acceleration",
        density=0.1,  # rad/(m s √s): new inputs change rates at once
        acceleration=0.2,  # rad/(m s²)
        root=ROOT,
    )
    start = ekf.initial({"q": 0.005, "q_dot": 0.01})
    truth = wing_and_sensors(model, ekf.channels.noise, np.random.default_rng(0))
    plant, tip = cc.rk4_step(model, DT), cc.tip_function(WING)

    q, _ = next(truth)
    seen, u, d = q, q, ca.DM.zeros(9)
    plan, at, held = ca.DM.zeros(step.size_in("guess")), start, 0
    log: dict[str, list] = {"time": [], "position": [], "desired": [], "believed": []}
    for k in range(STEPS):
        poses = [tip(path_weights((k + 1 + j) * DT)) for j in range(STAGES)]
        goals, frames = (ca.horzcat(*part) for part in zip(*poses, strict=True))
        found = step(seen, d, u, goals, frames, plan)
        if all(float(value) <= 1 for value in found[3:5]):  # violation, stationarity
            u, plan = found[:2]
        else:
            held += 1
        predicted = plant(seen, u, d)
        q, samples = truth.send((u, DISTURBANCE if k * DT >= GUST_AT else 0))
        times = at.time + DT / SAMPLES * np.arange(1, SAMPLES + 1)
        *_, at = cc.run_ekf(ekf, at, zip(times, samples.T, strict=True))
        seen = ca.DM(ekf.part(at, "q"))
        d += OBSERVER_GAIN * (seen - predicted) / (1 - np.exp(-DT / TAU))
        log["time"].append((k + 1) * DT)
        log["position"].append(tip(q)[0].full().ravel())
        log["desired"].append(goals[:, 0].full().ravel())
        log["believed"].append(tip(seen)[0].full().ravel())
    print(f"{held} of {STEPS} programs were not solved, and the input held")
    return {key: np.array(value) for key, value in log.items()}


def plot(log: dict[str, np.ndarray]) -> Figure:
    figure = Figure(figsize=(6.4, 4.8), layout="constrained")
    height, error = figure.subplots(2, 1, sharex=True)
    height.plot(log["time"], -log["desired"][:, 2], color="0.6", lw=3, label="path")
    height.plot(log["time"], -log["position"][:, 2], color="black", lw=1, label="tip")
    height.set_ylabel("tip height $-z$ [m]")
    for key, label, color in (
        ("position", "tip to path", "black"),
        ("believed", "estimate to tip", "tab:blue"),
    ):
        other = log["desired"] if key == "position" else log["position"]
        distance = np.linalg.norm(log[key] - other, axis=1)
        error.semilogy(log["time"], distance, color=color, lw=1, label=label)
    error.set(xlabel="time [s]", ylabel="distance [m]")
    for axes in (height, error):
        axes.axvline(GUST_AT, color="tab:red", ls="--", lw=1, label="disturbance begins")
        axes.legend(frameon=False, ncols=3, loc="lower center", bbox_to_anchor=(0.5, 1.0))
    return figure


def main(directory: Path = Path("out")) -> tuple[np.ndarray, np.ndarray]:
    log = simulate()
    distance = np.linalg.norm(log["position"] - log["desired"], axis=1)
    estimate = np.linalg.norm(log["believed"] - log["position"], axis=1)
    hit = np.argmax(distance * (log["time"] > GUST_AT))
    print(f"largest distance to the path after the disturbance: {distance[hit]:.3f} m")
    last = distance[-40:].max(), estimate[-40:].max()
    print(f"in the last 2 s: {last[0]:.3f} m; from the estimate to the tip {last[1]:.3f} m")
    directory.mkdir(exist_ok=True)
    plot(log).savefig(directory / "track_tip_path_from_imus.png", dpi=150)
    return distance, estimate


if __name__ == "__main__":
    main()
