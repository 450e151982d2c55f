"""Can two flaps keep a very flexible wing quiet 20 % above its flutter speed?

    measured: Ω_i, R_iᵀ (p̈_i − g), ε_j, and noise  →  x̂ (EKF on the model)  →  u = −K (x̂ − x_0)

The HALE wing, level and sagging under its weight, flutters from 26 m/s on. At 1.2 times that speed
it is displaced along its flutter mode by 2 % of its span at the tip. Controller: a model of 18
states, an extended Kalman filter on it (two IMUs, two strain gauges, 100 Hz), and a regulator of
quadratic cost that knows the lag of the actuators. Wing: more weights, three poles of lag on more
functions along the span; flaps of ±15° with a lag of 20 ms and at most 60°/s.
`--animate` writes a GIF of the controlled wing.
"""

import argparse
from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np
from matplotlib.figure import Figure
from scipy.linalg import expm, solve_discrete_are
from scipy.optimize import brentq

import curvcasadi as cc
from curvcasadi.plotting import animate_shape
from curvcasadi.reference_wings import hale_wing

DT, LAG = 0.01, 0.02  # s: of samples; of the actuators
LIMIT, RATE = np.deg2rad(15), np.deg2rad(60)  # rad, rad/s
SPEEDS = np.arange(16.0, 32.0, 2.0)  # m/s, for the flutter of the wing
ABOVE = 1.2  # of the flutter speed
DISPLACED = 0.02  # of the span
SECONDS = 8.0
ROOT = cc.RootMotion(gravity=[0, 0, 9.80665])  # level: body axes are inertial axes
SENSORS = (
    *(cc.RateGyro(xi=xi, noise_density=1e-4, rate=1 / DT) for xi in (0.5, 1.0)),
    *(cc.Accelerometer(xi=xi, noise_density=2e-3, rate=1 / DT) for xi in (0.5, 1.0)),
    *(cc.StrainGauge(xi=xi, offset=[0, 0.05], noise=1e-5) for xi in (0.05, 0.4)),
)


def make(weights: tuple[int, int, int], elements: int, lag: cc.IndicialLag, name: str):
    """The wing with two flaps, and its model."""
    channels = zip(("torsion", "out_of_plane", "in_plane"), weights, strict=True)
    basis = cc.ChannelBasis(**{key: cc.Legendre(n) for key, n in channels})
    beam = replace(hale_wing(grid=cc.Grid.lobatto(elements)), basis=basis)
    flaps = [
        cc.ControlSurface(name=key, lift=3.5, moment=-0.6, start=a, end=b)
        for key, a, b in (("inner", 0.2, 0.6), ("outer", 0.6, 0.95))
    ]
    strips = cc.StripAerodynamics(
        chord=1.0,
        aerodynamic_center=0.25,
        lift_slope=2 * np.pi,
        profile_drag=0.01,
        controls=tuple(flaps),
    )
    wing = cc.Wing(name="right", beam=beam, strips=strips)
    outputs = ("tip_position",)
    return wing, cc.wing_model(
        wing, density=0.0889, lag=lag, damping=0.002, outputs=outputs, name=name
    )


def equilibrium(model: cc.ControlModel, speed: float) -> np.ndarray:
    return cc.flutter(model, [16.0, 20.0, 24.0, speed]).equilibria[-1]


def regulator(beam: cc.Beam, linear: cc.LinearModel) -> np.ndarray:
    """K (2, nx + 2) for the state and the deflections, which follow commands with the lag.

    It weighs displacement, velocity and angular rate of the tip against commands.
    """
    n, nx = beam.basis.n, len(linear.A)
    A = np.block([[linear.A, linear.B], [np.zeros((2, nx)), -np.eye(2) / LAG]])
    B = np.vstack([np.zeros((nx, 2)), np.eye(2) / LAG])
    step = expm(DT * np.block([[A, B], [np.zeros((2, nx + 4))]]))
    A, B = step[: nx + 2, : nx + 2], step[: nx + 2, nx + 2 :]
    turns, moves = np.split(cc.body_jacobian(beam, linear.x[:n]).full(), 2)
    Q = np.zeros((nx + 2, nx + 2))
    Q[:n, :n] = moves.T @ moves
    Q[n : 2 * n, n : 2 * n] = 0.1 * moves.T @ moves + turns.T @ turns
    R = 30.0 * np.eye(2)
    P = solve_discrete_are(A, B, Q, R)
    return np.linalg.solve(R + B.T @ P @ B, B.T @ P @ A)


def displaced(beam: cc.Beam, linear: cc.LinearModel) -> np.ndarray:
    """The equilibrium, displaced along the flutter mode by 2 % of the span at the tip."""
    n, tip = beam.basis.n, cc.tip_function(beam)
    roots, modes = np.linalg.eig(linear.A)
    mode = modes[:n, np.argmax(np.where(roots.imag > 1, roots.real, -np.inf))]
    mode = (mode / mode[np.argmax(np.abs(mode))]).real
    q, rest = linear.x[:n], tip(linear.x[:n])[0]

    def excess(scale: float) -> float:
        return float(ca.norm_2(tip(q + scale * mode)[0] - rest)) - DISPLACED * beam.length

    return np.concatenate([q + brentq(excess, 0, 0.1) * mode, linear.x[n:]])


def fly(plant, control, speed: float, closed: bool) -> dict[str, np.ndarray]:
    """The motion of the wing, with the flaps at rest or in closed loop."""
    (wing, model), (small_wing, small) = plant, control
    beam = small_wing.beam
    p, n, nx = [speed, 0.0], wing.beam.basis.n, small.x.size
    linear = cc.linearize(model, equilibrium(model, speed), None, p)
    target = equilibrium(small, speed)
    K = regulator(beam, cc.linearize(small, target, None, p))
    process = cc.ModelProcess(model=small, density={"q_dot": 0.05, "lag": 0.2}, acceleration=0.2)
    ekf = cc.shape_ekf(beam, SENSORS, process=process, root=ROOT)
    start = ekf.initial(
        {"q": 0.01, "q_dot": 0.05, "lag": 0.3},
        {part: target[where] for part, where in small.x.slices.items()},
    )
    x, u, given = (ca.MX.sym(key, k) for key, k in (("x", model.x.size), ("u", 2), ("p", 2)))
    q_ddot = model.xdot(x, u, given)[n : 2 * n]
    values = cc.measure(SENSORS, wing.beam, x[:n], x[n : 2 * n], q_ddot, ROOT).values
    read = ca.Function("read", [x, u, given], [values])
    step = cc.compile_function(cc.step_function(model, DT, substeps=4), derivatives=0)
    rng, noise = np.random.default_rng(0), ekf.channels.noise
    state, factor = start.state, start.factor
    at, flaps, command = displaced(wing.beam, linear), np.zeros(2), np.zeros(2)
    found: dict[str, list[np.ndarray]] = {"q": [at[:n]], "flaps": [flaps]}
    for _ in range(round(SECONDS / DT)):
        for _ in range(10):  # the actuators, at 1 ms
            change = (command - flaps) * (1 - np.exp(-0.1 * DT / LAG))
            flaps = flaps + np.clip(change, -0.1 * RATE * DT, 0.1 * RATE * DT)
        at = step(at, flaps, p)[0].full()[:, 0]
        if closed:
            measured = read(at, flaps, p).full()[:, 0] + noise * rng.normal(size=len(noise))
            predicted = ekf.predict(state, factor, DT, flaps, p)
            state, factor = ekf.update(*predicted, measured, flaps, p)[:2]
            estimate = state.full()[:nx, 0]
            command = np.clip(-K @ np.concatenate([estimate - target, flaps]), -LIMIT, LIMIT)
        found["q"].append(at[:n])
        found["flaps"].append(flaps)
    history = {key: np.array(rows).T for key, rows in found.items()}
    tip = cc.tip_function(wing.beam)
    history["tip"] = tip.map(history["q"].shape[1])(history["q"])[0].full()
    history["tip"] -= tip(linear.x[:n])[0].full()
    history["time"] = DT * np.arange(history["q"].shape[1])
    return history


def plot(runs: dict[str, dict[str, np.ndarray]]) -> Figure:
    figure = Figure(figsize=(8.0, 5.4), layout="constrained")
    upper, lower = figure.subplots(2, sharex=True)
    for name, color, width in (("flaps at rest", "0.6", 1.2), ("closed loop", "tab:blue", 1.6)):
        run = runs[name]
        upper.plot(run["time"], -run["tip"][2], color=color, lw=width, label=name)
    upper.set_ylabel("tip above its\nequilibrium [m]")
    upper.legend(frameon=False, ncols=2, loc="lower center", bbox_to_anchor=(0.5, 1.0))
    run = runs["closed loop"]
    for k, (name, color) in enumerate((("inner flap", "tab:blue"), ("outer flap", "tab:orange"))):
        lower.plot(run["time"], np.rad2deg(run["flaps"][k]), color=color, lw=1.2, label=name)
    lower.set(xlabel="time [s]", ylabel="deflection [°]", ylim=(-16, 16))
    lower.set_xlim(0, run["time"][-1])
    lower.legend(frameon=False, ncols=2, loc="upper right")
    return figure


def main(
    directory: Path = Path("out"), animate: bool = False
) -> tuple[float, np.ndarray, np.ndarray]:
    plant = make((3, 4, 1), 8, cc.IndicialLag(poles=3, modes=3), "wing")
    control = make((3, 3, 1), 4, cc.IndicialLag(poles=2, modes=2), "control")
    flutter = cc.flutter(plant[1], SPEEDS).speed
    speed = ABOVE * flutter
    print(f"flutter at {flutter:.2f} m/s; flown at {speed:.2f} m/s, {ABOVE:.2f} times that")
    runs = {
        name: fly(plant, control, speed, name == "closed loop")
        for name in ("flaps at rest", "closed loop")
    }
    distances = {name: np.linalg.norm(run["tip"], axis=0) for name, run in runs.items()}
    last = runs["closed loop"]["time"] > SECONDS - 2
    for name, distance in distances.items():
        print(f"{name}: tip moves by {distance[last].max():.3f} m at most in the last 2 s")
    directory.mkdir(exist_ok=True)
    plot(runs).savefig(directory / "flutter_suppression.png", dpi=150)
    if animate:
        run, file = runs["closed loop"], directory / "flutter_suppression.gif"
        animate_shape(plant[0].beam, run["time"][::4], run["q"].T[::4], file)
    return speed / flutter, distances["flaps at rest"][last], distances["closed loop"][last]


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--animate", action="store_true", help="write a GIF of the wing")
    main(animate=parser.parse_args().animate)
