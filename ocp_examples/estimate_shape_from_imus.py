"""What do four IMUs tell of the shape of a flapping wing?

    q' = q_dot,  q_dot' = white noise
    measured: Ω_i, R_iᵀ (p̈_i − g), R_iᵀ m, and noise, at four stations

The HALE wing flaps by ±2.8 m, twists and sweeps a little, as the filter does not know: it sees
gyros, accelerometers and magnetometers at 100 Hz, and starts at the straight wing. Truth lies
within the 3σ bands of the estimate. Gravity says nothing of turns about itself, of in-plane
bending: without magnetometers that band is a metre wide. `--animate` writes a GIF of the estimate.
"""

import argparse
from pathlib import Path

import casadi as ca
import numpy as np
from matplotlib.figure import Figure

import curvcasadi as cc
from curvcasadi.plotting import animate_shape
from curvcasadi.reference_wings import hale_wing

RATE, SECONDS = 100.0, 8.0  # Hz, s
STATIONS = (0.25, 0.5, 0.75, 1.0)
GRAVITY = [0, 0, 9.80665]  # m/s², z is down
FIELD = [2e-5, 0, 4.4e-5]  # T, north and down

WING = hale_wing()  # weights: 3 torsion, 4 out-of-plane, 2 in-plane
SENSORS = [
    sensor
    for xi in STATIONS
    for sensor in (
        cc.RateGyro(xi=xi, noise_density=1e-3, rate=RATE),  # rad/√s
        cc.Accelerometer(xi=xi, noise_density=5e-3, rate=RATE),  # m/s² √s
        cc.Magnetometer(xi=xi, noise_density=3e-8, rate=RATE),  # T √s
    )
]
ROOT = cc.RootMotion(gravity=GRAVITY, magnetic_field=FIELD)
AMPLITUDE = np.array([0.008, 0.004, 0, 0.02, 0.012, 0.006, 0, 0.001, 0])  # rad/m
FREQUENCY = np.array([2.0, 3.1, 0, 1.5, 2.3, 3.7, 0, 1.1, 0])  # rad/s


def truth() -> dict[str, np.ndarray]:
    """Weights, their rates and accelerations, and what an ideal sensor reads, over time."""
    time = np.arange(1, int(RATE * SECONDS) + 1) / RATE
    phase = np.outer(FREQUENCY, time)
    mean = np.zeros((9, 1))
    mean[3] = -0.03  # bent by its lift
    q = mean + AMPLITUDE[:, None] * np.sin(phase)
    q_dot = (AMPLITUDE * FREQUENCY)[:, None] * np.cos(phase)
    q_ddot = -(AMPLITUDE * FREQUENCY**2)[:, None] * np.sin(phase)
    x = [ca.MX.sym(key, 9) for key in ("q", "q_dot", "q_ddot")]
    read = ca.Function("read", x, [cc.measure(SENSORS, WING, *x, root=ROOT).values])
    return {"time": time, "q": q, "read": read.map(len(time))(q, q_dot, q_ddot).full()}


def estimate(log: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    ekf = cc.shape_ekf(
        WING,
        SENSORS,
        process="white_acceleration",
        density=np.repeat([0.04, 0.06, 0.002], (3, 4, 2)),  # rad/(m s √s)
        acceleration=np.repeat([0.03, 0.05, 0.002], (3, 4, 2)),  # rad/(m s²)
        root=ROOT,
    )
    start = ekf.initial({"q": np.repeat([0.02, 0.04, 0.002], (3, 4, 2)), "q_dot": 0.05})
    noise = np.random.default_rng(0).normal(size=log["read"].shape)
    samples = log["read"] + ekf.channels.noise[:, None] * noise
    tip = cc.tip_function(WING)
    slope = cc.jacobian_function(tip)
    found: dict[str, list[np.ndarray]] = {"q": [], "tip": [], "deviation": []}
    for at in cc.run_ekf(ekf, start, zip(log["time"], samples.T, strict=True)):
        q, J = ekf.part(at, "q"), slope(ekf.part(at, "q"))[0].full()
        found["q"].append(q)
        found["tip"].append(tip(q)[0].full().ravel())
        found["deviation"].append(np.sqrt(np.diag(J @ ekf.covariance(at, "q") @ J.T)))
    return {key: np.array(value).T for key, value in found.items()}


def plot(log: dict[str, np.ndarray], tips: np.ndarray, found: dict[str, np.ndarray]) -> Figure:
    figure = Figure(figsize=(6.4, 6.4), layout="constrained")
    rows = figure.subplots(3, 1, sharex=True)
    names = ("forward $x$", "outward $y$", "up $-z$")
    for k, (axes, name, sign) in enumerate(zip(rows, names, (1, 1, -1), strict=True)):
        middle, band = sign * found["tip"][k], 3 * found["deviation"][k]
        axes.fill_between(log["time"], middle - band, middle + band, color="0.8", label="3σ")
        axes.plot(log["time"], sign * tips[k], color="tab:blue", lw=2, label="truth")
        axes.plot(log["time"], middle, "--", color="black", lw=1, label="estimate")
        room = 0.2 + 0.3 * np.ptp(tips[k])
        axes.set(ylabel=f"tip, {name} [m]")
        axes.set_ylim(np.min(sign * tips[k]) - room, np.max(sign * tips[k]) + room)
    rows[-1].set_xlabel("time [s]")
    rows[0].legend(frameon=False, ncols=3, loc="lower center", bbox_to_anchor=(0.5, 1.0))
    return figure


def main(directory: Path = Path("out"), animate: bool = False) -> tuple[float, float]:
    log = truth()
    found = estimate(log)
    tips = cc.tip_function(WING).map(len(log["time"]))(log["q"])[0].full()
    settled = log["time"] > 2.0
    error = np.linalg.norm(found["tip"] - tips, axis=0)[settled]
    within = np.mean(np.abs(found["tip"] - tips)[:, settled] <= 3 * found["deviation"][:, settled])
    rms = float(np.sqrt(np.mean(error**2)))
    print(f"tip from 2 s on: error {rms:.3f} m rms, {error.max():.3f} m at most")
    print(f"{100 * within:.1f} % of its coordinates within 3σ; flapping of {np.ptp(tips[2]):.1f} m")
    directory.mkdir(exist_ok=True)
    plot(log, tips, found).savefig(directory / "estimate_shape_from_imus.png", dpi=150)
    if animate:
        history = found["q"].T[::4]
        animate_shape(WING, log["time"][::4], history, directory / "estimate_shape_from_imus.gif")
    return rms, float(within)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--animate", action="store_true", help="write a GIF of the wing")
    main(animate=parser.parse_args().animate)
