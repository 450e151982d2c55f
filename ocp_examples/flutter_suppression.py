"""Can two flaps keep a very flexible wing quiet above its flutter speed, where it is not its model?

    samples, late and with gaps  →  x̂ (EKF on the model)  →  u = −K (x̂ − x̂_0)

Each HALE wing that flies, level and sagging under its weight, differs from the model of 18 states:
EI and GJ by up to 10 %, mass by 5 %, more weights, three poles of lag for each strip. At 1.2 times
its own flutter speed (the controller is told a speed that is wrong by up to 1 m/s) it is displaced
along its flutter mode by 2 % of its span at the tip. Two IMUs and two strain gauges at 100 Hz are
noisy and 20 ms late, one sample in twenty is missing; a filter predicts them to the present, and a
regulator of quadratic cost that knows the lag of the actuators moves two flaps of ±15° with a lag
of 20 ms and at most 60°/s. `--animate` writes a GIF of the wing that is damped least.
"""

import argparse
from pathlib import Path
from typing import NamedTuple

import casadi as ca
import numpy as np
from matplotlib.figure import Figure
from scipy.linalg import expm, solve_discrete_are
from scipy.optimize import brentq

import curvcasadi as cc
from curvcasadi.plotting import animate_shape
from curvcasadi.reference_wings import hale_wing

FINE, DT, LATE, MISSING = 1e-3, 0.01, 2, 0.05  # s: of the plant; of samples; samples; their share
VARIED, MISJUDGED = {"GJ": 0.1, "EI": 0.1, "mass": 0.05}, 1.0  # relative; m/s
LAG, LIMIT, RATE = 0.02, np.deg2rad(15), np.deg2rad(60)  # s, rad, rad/s: of the flaps
SPEEDS = np.arange(16.0, 36.0, 2.0)  # m/s, for the flutter of the wings
ABOVE = 1.2  # of the flutter speed
DISPLACED = 0.02  # of the span
SECONDS, FLIGHTS = 8.0, 3
MODEL = {"weights": (3, 3, 1), "elements": 4, "poles": 2, "modes": 2}
PLANT = {"weights": (3, 4, 1), "elements": 8, "poles": 3, "modes": None}
NOISE = {"q_dot": 0.05, "lag": 0.2}  # densities that drive the filter's process
START = {"q": 0.01, "q_dot": 0.05, "lag": 0.3}
WASHOUT = 1.0  # s: the flaps forget what stays
ROOT = cc.RootMotion(gravity=[0, 0, 9.80665])  # level: body axes are inertial axes
SENSORS = (
    *(cc.RateGyro(xi=xi, noise_density=1e-4, rate=1 / DT) for xi in (0.5, 1.0)),
    *(cc.Accelerometer(xi=xi, noise_density=2e-3, rate=1 / DT) for xi in (0.5, 1.0)),
    *(cc.StrainGauge(xi=xi, offset=[0, 0.05], noise=1e-5) for xi in (0.05, 0.4)),
)


class Flights(NamedTuple):
    """All wings: entries by time, then by wing."""

    times: np.ndarray  # s
    heights: np.ndarray  # of the tip above its equilibrium, m
    flaps: np.ndarray  # of the inner and the outer one, rad
    weights: np.ndarray  # rad/m


def make(name, weights, elements, poles, modes, factors=None):
    """The wing with two flaps, and its model; `factors` of GJ, EI and mass become parameters."""
    flaps = tuple(
        cc.ControlSurface(name=key, lift=3.5, moment=-0.6, start=start, end=end)
        for key, start, end in (("inner", 0.2, 0.6), ("outer", 0.6, 0.95))
    )
    strips = cc.StripAerodynamics(
        chord=1.0,
        aerodynamic_center=0.25,
        lift_slope=2 * np.pi,
        profile_drag=0.01,
        controls=flaps,
    )
    beam = cc.perturbed_beam(hale_wing(*weights, grid=cc.Grid.lobatto(elements)), **factors or {})
    model = cc.wing_model(
        cc.Wing(name="right", beam=beam, strips=strips),
        density=0.0889,
        lag=cc.IndicialLag(poles=poles, modes=modes),
        damping=0.002,
        outputs=("tip_position",),
        parameters=factors or {},
        name=name,
    )
    return beam, model


def equilibrium(model, speed, **factors):
    return cc.flutter(model, [16.0, 20.0, 24.0, speed], p={"pitch": 0.0, **factors}).equilibria[-1]


class Plant:
    """The wings that fly, one for each seed, each above its own flutter speed."""

    def __init__(self, seeds, above):
        symbols = {name: ca.MX.sym(name) for name in VARIED}
        self.beam, self.model = make("wing", **PLANT, factors=symbols)
        read = cc.readings_function(self.model, self.beam, SENSORS, root=ROOT)
        functions = (cc.rk4_step(self.model, FINE), read, self.model.output)
        self.step, self.read, self.output = map(cc.compile_batch, functions)
        draws = np.array([np.random.default_rng(seed).uniform(-1, 1, 4) for seed in seeds])
        self.misjudged = MISJUDGED * draws[:, 3]
        columns = 1 + draws[:, :3] * [*VARIED.values()]
        self.factors = [dict(zip(VARIED, row, strict=True)) for row in columns]
        level = [{"pitch": 0.0, **each} for each in self.factors]
        flutter = [cc.flutter(self.model, SPEEDS, p=each).speed for each in level]
        self.flutter, self.speeds = np.array(flutter), above * np.array(flutter)
        self.p = np.column_stack([self.speeds, 0 * self.speeds, columns])
        wings = zip(self.speeds, self.factors, strict=True)
        self.rest = np.array([equilibrium(self.model, speed, **each) for speed, each in wings])
        self.start = np.array(
            [self.displaced(*each) for each in zip(self.rest, self.p, strict=True)]
        )

    def displaced(self, x, p):
        """The equilibrium, displaced along the flutter mode by 2 % of the span at the tip."""
        linear, n, tip = cc.linearize(self.model, x, None, p), self.beam.basis.n, self.model.output
        roots, modes = np.linalg.eig(linear.A)
        mode = modes[:n, np.argmax(np.where(roots.imag > 1, roots.real, -np.inf))]
        mode = (mode / mode[np.argmax(np.abs(mode))]).real
        away = np.concatenate([mode, np.zeros(len(x) - n)])

        def excess(scale):
            moved = tip(x + scale * away, [0, 0], p) - tip(x, [0, 0], p)
            return float(ca.norm_2(moved)) - DISPLACED * self.beam.length

        return x + brentq(excess, 0, 0.1) * away

    def fly(self, control, **sensed):
        loop = cc.closed_loop(
            self.step,
            self.start,
            control,
            DT * np.arange(round(SECONDS / DT) + 1),
            substeps=round(DT / FINE),
            actuators=cc.Actuators(lag=LAG, rate=RATE, lower=-LIMIT, upper=LIMIT),
            p=lambda time: self.p,
            u=np.zeros(2),
            **sensed,
        )
        flat = (np.concatenate(rows) for rows in (loop.x, loop.u, loop.p))
        tips = self.output(*flat)[:, 2].reshape(len(loop.t), -1)
        level = self.output(self.rest, 0 * loop.u[0], self.p)[:, 2]
        weights = loop.x[:, :, self.model.x.slices["q"]]
        return Flights(loop.t, level - tips, loop.u, weights)


def regulator(beam, linear):
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


def control(speeds):
    """Filter and regulator of each wing, at the speeds that they are told."""
    beam, model = make("control", **MODEL)
    nx, targets = model.x.size, np.array([equilibrium(model, speed) for speed in speeds])
    rest = targets
    gains = [
        regulator(beam, cc.linearize(model, target, None, [speed, 0.0]))
        for speed, target in zip(speeds, targets, strict=True)
    ]
    process = cc.ModelProcess(model=model, density=NOISE, acceleration=0.2)
    ekf = cc.shape_ekf(beam, SENSORS, process=process, root=ROOT)
    mean = {part: targets.mean(axis=0)[where] for part, where in model.x.slices.items()}
    start = ekf.initial(START, mean)
    told = np.column_stack([speeds, 0 * speeds])
    late = cc.DelayedFilter(ekf, start, dt=DT, delay=LATE, lanes=len(speeds), p=told)

    def command(time, estimates, flaps):
        nonlocal rest
        rest = rest + DT / WASHOUT * (estimates[:, :nx] - rest)
        away = np.hstack([estimates[:, :nx] - rest, flaps])
        return -np.einsum("kij,kj->ki", gains, away)

    return command, ekf.channels.noise, late


def simulate(seeds, above):
    """The wings, and `Flights` by name."""
    plant = Plant(seeds, above)
    command, noise, late = control(plant.speeds + plant.misjudged)
    link = cc.SensorLink(noise=noise, delay=LATE, loss=MISSING, seeds=seeds)
    return plant, {
        "flaps at rest": plant.fly(lambda time, x, flaps: 0 * flaps),
        "closed loop": plant.fly(command, read=plant.read, link=link, observer=late),
    }


def swings(flights, seconds=2.0):
    """Half of the range of the height of each tip in the last seconds, m."""
    return np.ptp(flights.heights[flights.times > flights.times[-1] - seconds], axis=0) / 2


def plot(found):
    figure = Figure(figsize=(8.0, 5.4), layout="constrained")
    upper, lower = figure.subplots(2, sharex=True)
    for name, color in (("flaps at rest", "0.7"), ("closed loop", "tab:blue")):
        lines = upper.plot(found[name].times, found[name].heights, color=color, lw=1.2)
        lines[0].set_label(name)
    upper.set_ylabel("tips above their\nequilibria [m]")
    upper.legend(frameon=False, ncols=2, loc="lower center", bbox_to_anchor=(0.5, 1.0))
    run = found["closed loop"]
    worst = np.argmax(swings(run))
    for k, (name, color) in enumerate((("inner flap", "tab:blue"), ("outer flap", "tab:orange"))):
        lower.plot(run.times, np.rad2deg(run.flaps[:, worst, k]), color=color, lw=1.2, label=name)
    lower.set(xlabel="time [s]", ylabel="deflection of the wing\ndamped least [°]", ylim=(-16, 16))
    lower.set_xlim(0, run.times[-1])
    lower.legend(frameon=False, ncols=2, loc="upper right")
    return figure


def main(directory=Path("out"), animate=False):
    plant, found = simulate(range(FLIGHTS), ABOVE)
    flutter = ", ".join(f"{speed:.2f}" for speed in plant.flutter)
    print(f"flutter at {flutter} m/s; flown at {ABOVE:.2f} times that")
    for name, flights in found.items():
        last = ", ".join(f"{swing:.3f}" for swing in swings(flights))
        print(f"{name}: in the last 2 s the tips swing by ±{last} m")
    directory.mkdir(exist_ok=True)
    plot(found).savefig(directory / "flutter_suppression.png", dpi=150)
    if animate:
        run, file = found["closed loop"], directory / "flutter_suppression.gif"
        worst = np.argmax(swings(run))
        beam = hale_wing(*PLANT["weights"])
        animate_shape(beam, run.times[::4], run.weights[::4, worst], file)
    return plant, found


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--animate", action="store_true", help="write a GIF of a wing")
    main(animate=parser.parse_args().animate)
