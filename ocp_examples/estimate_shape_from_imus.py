"""What do four IMUs tell of the shape of a flapping wing?

    q' = q_dot,  q_dot' = white noise
    measured: Ω_i, R_iᵀ (p̈_i − g), and noise, at four stations

The HALE wing flaps by ±2.8 m and twists, as the filter does not know: it sees gyros and
accelerometers at 100 Hz, and starts at the straight wing. Millimetres of error are left, within 3σ
in 99 of 100 samples: the acceleration of a flapping wing is not white, so the filter is told twice
of what it is. Wing, sensors and filter stand in hale_wing_imus.toml; out/imus.csv, a log of the
sensors, is what `curvcasadi estimate` reads. `--animate` writes a GIF of the estimate.
"""

import argparse
from pathlib import Path

import casadi as ca
import numpy as np
from matplotlib.figure import Figure

import curvcasadi as cc
from curvcasadi.plotting import animate_shape

FILE = Path(__file__).parent / "hale_wing_imus.toml"
RATE, SECONDS = 100.0, 8.0  # Hz, s
MEAN = np.array([0, 0, -0.03, 0, 0, 0])  # bent by its lift, rad/m
AMPLITUDE = np.array([0.008, 0.004, 0.02, 0.012, 0.006, 0])  # rad/m
FREQUENCY = np.array([2.0, 3.1, 1.5, 2.3, 3.7, 0])  # rad/s


def truth(wing: cc.EstimationFile) -> dict[str, np.ndarray]:
    """Weights, and what ideal sensors read, over time."""
    time = np.arange(1, int(RATE * SECONDS) + 1) / RATE
    phase = np.outer(FREQUENCY, time)
    q = MEAN[:, None] + AMPLITUDE[:, None] * np.sin(phase)
    q_dot = (AMPLITUDE * FREQUENCY)[:, None] * np.cos(phase)
    q_ddot = -(AMPLITUDE * FREQUENCY**2)[:, None] * np.sin(phase)
    x = [ca.MX.sym(key, len(q)) for key in ("q", "q_dot", "q_ddot")]
    measured = cc.measure(wing.sensors, wing.beam, *x, root=cc.RootMotion(gravity=[0, 0, 9.81]))
    read = ca.Function("read", x, [measured.values]).map(len(time))(q, q_dot, q_ddot).full()
    noise = measured.noise[:, None] * np.random.default_rng(0).normal(size=read.shape)
    return {"time": time, "q": q, "samples": read + noise, "labels": np.array(measured.labels)}


def write_log(log: dict[str, np.ndarray], path: Path) -> None:
    """The log as CSV: a line for each time, columns time and the labels of `measure`."""
    rows = np.column_stack([log["time"], log["samples"].T])
    header = ",".join(["time", *log["labels"]])
    np.savetxt(path, rows, fmt="%.9g", delimiter=",", header=header, comments="")


def estimate(wing: cc.EstimationFile, log: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    tip = cc.tip_function(wing.beam)
    slope = cc.jacobian_function(tip)
    found: dict[str, list[np.ndarray]] = {"q": [], "tip": [], "deviation": []}
    samples = zip(log["time"], log["samples"].T, strict=True)
    for at in cc.run_ekf(wing.ekf, wing.start, samples):
        q = wing.ekf.part(at, "q")
        J = slope(q)[0].full()
        found["q"].append(q)
        found["tip"].append(tip(q)[0].full().ravel())
        found["deviation"].append(np.sqrt(np.diag(J @ wing.ekf.covariance(at, "q") @ J.T)))
    return {key: np.array(value).T for key, value in found.items()}


def plot(log: dict[str, np.ndarray], tips: np.ndarray, found: dict[str, np.ndarray]) -> Figure:
    """The tip on the left; on the right its error, on the scale of what is left after 2 s."""
    figure = Figure(figsize=(9.6, 6.4), layout="constrained")
    rows = figure.subplots(3, 2, sharex=True)
    names = ("forward $x$", "outward $y$", "up $-z$")
    for k, ((left, right), name, sign) in enumerate(zip(rows, names, (1, 1, -1), strict=True)):
        left.plot(log["time"], sign * tips[k], color="tab:blue", lw=2, label="truth")
        left.plot(log["time"], sign * found["tip"][k], "--", color="black", lw=1, label="estimate")
        room = 0.2 + 0.1 * np.ptp(tips[k])
        left.set_ylim(np.min(sign * tips[k]) - room, np.max(sign * tips[k]) + room)
        left.set_ylabel(f"tip, {name} [m]")

        band = 3e3 * found["deviation"][k]
        right.fill_between(log["time"], -band, band, color="0.8", lw=0, label="3σ")
        error = 1e3 * sign * (found["tip"] - tips)[k]
        right.plot(log["time"], error, color="black", lw=0.8, label="estimate − truth")
        most = 1.5 * np.max(band[log["time"] > 2.0])
        right.set_ylim(-most, most)
        right.set_ylabel("error [mm]")
    for axes in rows[-1]:
        axes.set_xlabel("time [s]")
        axes.set_xlim(0, log["time"][-1])
    for axes in rows[0]:
        axes.legend(frameon=False, ncols=2, loc="lower center", bbox_to_anchor=(0.5, 1.0))
    return figure


def main(directory: Path = Path("out"), animate: bool = False) -> tuple[float, float]:
    wing = cc.load_estimation(FILE)
    log = truth(wing)
    directory.mkdir(exist_ok=True)
    write_log(log, directory / "imus.csv")
    found = estimate(wing, log)
    tips = cc.tip_function(wing.beam).map(len(log["time"]))(log["q"])[0].full()
    settled = log["time"] > 2.0
    error = np.linalg.norm(found["tip"] - tips, axis=0)[settled]
    within = np.mean(np.abs(found["tip"] - tips)[:, settled] <= 3 * found["deviation"][:, settled])
    rms = float(np.sqrt(np.mean(error**2)))
    print(f"tip from 2 s on: error {rms:.3f} m rms, {error.max():.3f} m at most")
    print(f"{100 * within:.1f} % of its coordinates within 3σ; flapping of {np.ptp(tips[2]):.1f} m")
    plot(log, tips, found).savefig(directory / "estimate_shape_from_imus.png", dpi=150)
    if animate:
        history, file = found["q"].T[::4], directory / "estimate_shape_from_imus.gif"
        animate_shape(wing.beam, log["time"][::4], history, file)
    return rms, float(within)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--animate", action="store_true", help="write a GIF of the wing")
    main(animate=parser.parse_args().animate)
