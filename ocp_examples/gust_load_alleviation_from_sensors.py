"""How much of a gust's root moment can flaps take away where only sensors know the wing?

    samples, late and with gaps  →  x̂, ŵ (EKF on the model)  →  u (MPC of the expected gust)

Wing, gust, flaps and cost are those of `gust_load_alleviation.py`, but each wing that flies differs
from the model of the controller: EI and GJ by up to 10 %, mass by 5 %, airspeed by 1 m/s. Two IMUs
and three strain gauges at 100 Hz are noisy and 20 ms late; one sample in twenty is missing. Before
the gust, 1.5 s of calm air let the filter settle; their root moment is what the controller
keeps.
Without preview the controller expects that the estimated gust stays (or "none"); preview is an
upper bound. The wings fly as one batch: each is a lane of a vector register.
"""

from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import casadi as ca
import numpy as np
from matplotlib.figure import Figure

import curvcasadi as cc
from curvcasadi.reference_wings import hale_wing

AIRSPEED, PITCH, DENSITY = 20.0, np.radians(3.0), 0.0889
GUST = cc.OneMinusCosine(amplitude=2.0, duration=1.5, start=0.25)
CALM, END, FLIGHTS = 1.5, 2.5, 2  # s: before and from time 0
FINE, SAMPLE, DT, HORIZON = 1e-3, 0.01, 0.05, 20  # s: of the plant, sensors, controller; stages
LAG, LATE, MISSING = 0.02, 2, 0.05  # s, of the actuators; samples; share of them
VARIED, SPEED = np.array([0.1, 0.1, 0.05]), 1.0  # GJ, EI, mass; m/s
MOMENT, DEFLECTION, MOVE = 1 / 50**2, 0.02, 0.05  # weights
MODEL = {"weights": (3, 3, 1), "elements": 6, "modes": 3, "entry": 1}
PLANT = {"weights": (4, 5, 3), "elements": 10, "modes": None, "entry": None}
NOISE = {"q_dot": 0.05, "lag": 0.2, "gust": 1.5}  # densities that drive the filter's process
START = {"q": 0.003, "q_dot": 0.02, "lag": 0.3, "gust": 0.5}
SETS = {  # largest angles of the inner and the outer flap, rad, and rates, rad/s
    "small flaps": np.radians([[0.0, 10.0], [40.0, 40.0]]),
    "large flaps": np.radians([[15.0, 15.0], [60.0, 60.0]]),
}
CASES = {  # flaps, and the gust that the controller expects
    "small flaps, estimated gust": ("small flaps", "estimated"),
    "large flaps, preview": ("large flaps", "known"),
}
C, S = np.cos(PITCH), np.sin(PITCH)
ROOT = cc.RootMotion(
    pose=cc.Pose(rotation=[[C, 0, S], [0, 1, 0], [-S, 0, C]], position=[0, 0, 0]),
    gravity=[0, 0, 9.80665],
)
SENSORS = (
    *(cc.RateGyro(xi=xi, noise_density=1e-4, rate=1 / SAMPLE) for xi in (0.5, 1.0)),
    *(cc.Accelerometer(xi=xi, noise_density=2e-3, rate=1 / SAMPLE) for xi in (0.5, 1.0)),
    *(cc.StrainGauge(xi=xi, offset=[0, 0.05], noise=1e-5) for xi in (0.05, 0.2, 0.4)),
)


class Flights(NamedTuple):
    """Of all flights of one case."""

    moments: np.ndarray  # (T, flights), N m
    flaps: np.ndarray  # (T, flights, 2), rad
    gusts: np.ndarray  # (T, flights), estimated, m/s


def wing_model(name, weights, elements, modes, entry, varied=None):
    """The wing with two flaps; `varied` are factors of GJ, EI and mass."""
    flaps = tuple(
        cc.ControlSurface(name=key, start=start, end=end, lift=3.5, moment=-0.6)
        for key, start, end in (("inner", 0.2, 0.6), ("outer", 0.6, 0.95))
    )
    strips = cc.StripAerodynamics(
        chord=1.0, aerodynamic_center=0.25, lift_slope=2 * np.pi, controls=flaps, stations=8
    )
    nominal = beam = hale_wing(*weights, grid=cc.Grid.lobatto(elements))
    if varied is not None:
        names = ("GJ", "EI_y", "EI_z", "mass_per_length")
        factors = dict(zip(names, (varied[k] for k in (0, 1, 1, 2)), strict=True))
        new = {key: factor * getattr(beam.section, key) for key, factor in factors.items()}
        beam = replace(beam, section=replace(beam.section, **new))
    model = cc.wing_model(
        cc.Wing(name="right", beam=beam, strips=strips),
        density=DENSITY,
        lag=cc.IndicialLag(poles=2, modes=modes),
        gust=cc.GustEntry(kind="kussner", modes=entry),
        damping=2e-3,
        outputs=["root_moment"],
        parameters={} if varied is None else {"varied": varied},
        name=name,
    )
    return nominal, model


def trim(model, airspeed, **others):
    speeds = [airspeed, airspeed + 1]
    return cc.flutter(model, speeds, p={"pitch": PITCH, **others}).equilibria[0]


class Plant:
    """The wings that fly: their steps, readings and root moments, in batches."""

    def __init__(self, seeds):
        beam, model = wing_model("plant", **PLANT, varied=ca.MX.sym("varied", 3))
        n = beam.basis.n
        x, u, p = (ca.MX.sym(k, size) for k, size in (("x", model.x.size), ("u", 2), ("p", 6)))
        q_ddot = model.xdot(x, u, p)[n : 2 * n]
        readings = cc.measure(SENSORS, beam, x[:n], x[n : 2 * n], q_ddot, ROOT)
        moment = -model.output(x, u, p)[1]  # it bends the root upward
        read = ca.Function("read", [x, u, p], [readings.values, moment], {"cse": True})
        self.noise, self.read = readings.noise, cc.compile_batch(read)
        self.step = cc.compile_batch(cc.rk4_step(model, FINE))
        draws = np.array([np.random.default_rng(seed).uniform(-1, 1, 4) for seed in seeds])
        self.varied, self.airspeed = 1 + VARIED * draws[:, :3], AIRSPEED + SPEED * draws[:, 3]
        self.trims = np.array(
            [trim(model, v, varied=k) for k, v in zip(self.varied, self.airspeed, strict=True)]
        )

    def parameters(self, cases, gust):
        one = np.ones_like(self.airspeed)
        columns = [self.airspeed, PITCH * one, gust * one, *self.varied.T]
        return np.tile(np.column_stack(columns), (cases, 1))


class Filter:
    """An extended Kalman filter for each flight, and what it expects of the present."""

    def __init__(self, beam, model, flights):
        process = cc.ModelProcess(
            model=model, density=NOISE, estimated={"gust": None}, acceleration=0.2
        )
        ekf = cc.shape_ekf(beam, SENSORS, process=process, root=ROOT, recovery=10)
        rest = trim(model, AIRSPEED)
        start = ekf.initial(START, {k: rest[where] for k, where in model.x.slices.items()})
        self.state = np.tile(start.state[:, None], flights)
        self.factor = np.tile(start.factor, flights)
        functions = (cc.compile_function(f, derivatives=0) for f in (ekf.predict, ekf.update))
        self.predict, self.update = (f.map(flights) for f in functions)
        self.known, self.nx = np.tile([[AIRSPEED], [PITCH]], flights), model.x.size

    def take(self, samples, flaps):
        belief = self.predict(self.state, self.factor, SAMPLE, flaps.T, self.known)
        self.state, self.factor, *_ = self.update(*belief, samples.T, flaps.T, self.known)

    def present(self, flaps):
        """State (flights, nx) and gust (flights,) after the deflections since the last sample."""
        state, factor = self.state, self.factor
        for held in flaps:
            state, factor = self.predict(state, factor, SAMPLE, held.T, self.known)
        rows = np.array(state).T
        return rows[:, : self.nx], rows[:, self.nx]


def controller(model, flaps):
    """One real-time iteration every 50 ms."""
    names = [part.name for part in model.u.parts]
    return cc.Mpc(
        model,
        dt=DT,
        horizon=HORIZON,
        outputs={"root_moment": [0.0, MOMENT, 0.0]},
        inputs=dict.fromkeys(names, DEFLECTION),
        moves=dict.fromkeys(names, MOVE),
        bounds={k: (-most, most) for k, most in zip(names, flaps[0], strict=True)},
        rate_bounds=dict(zip(names, flaps[1], strict=True)),
    )


def expected(kind, time, gust):
    """The gust of each stage of the horizon that begins at `time`."""
    if kind == "known":
        return np.array([float(GUST(time + DT * (k + 0.5))) for k in range(HORIZON)])
    return np.full(HORIZON, gust if kind == "estimated" else 0.0)


def simulate(seeds=range(FLIGHTS)):
    """Times, and `Flights` by case: one flight of each case for each seed."""
    plant, (beam, model), n = Plant(seeds), wing_model("model", **MODEL), len(seeds)
    lanes = [case for case in CASES.values() for _ in seeds]
    made = {flaps: controller(model, SETS[flaps]) for flaps in dict.fromkeys(k for k, _ in lanes)}
    controls = [made[flaps].copy() for flaps, _ in lanes]
    ekf, rng = Filter(beam, model, len(lanes)), np.random.default_rng(0)
    most = FINE * np.array([SETS[flaps][1] for flaps, _ in lanes])
    repeat = len(CASES) + 1  # with the open loop, whose flights are the first lanes
    x = np.tile(plant.trims, (repeat, 1))
    at = command = np.zeros((len(lanes), 2))
    rest, calm, late, held, log = np.zeros((n, 2)), [], [], [], []
    times = SAMPLE * np.arange(-round(CALM / SAMPLE), round(END / SAMPLE))
    for k, time in enumerate(times):
        p = plant.parameters(repeat, float(GUST(time)))
        values, moments = plant.read(x, np.vstack([rest, at]), p)
        noise = plant.noise * rng.normal(size=(n, len(plant.noise)))  # alike in all cases
        noise[rng.random(noise.shape) < MISSING] = np.nan
        late.append(values[n:] + np.tile(noise, (len(CASES), 1)))
        held.append(at)
        if k >= LATE:
            ekf.take(late[-1 - LATE], held[-1 - LATE])
        if k % round(DT / SAMPLE) == 0:
            states, gusts = ekf.present(held[-LATE:])
            known = [np.array([AIRSPEED, PITCH, gust]) for gust in gusts]
            if time < -SAMPLE / 2:
                now = zip(states, at, known, strict=True)
                calm.append([model.output(*arguments).full().ravel() for arguments in now])
            else:
                goals = np.mean(calm[len(calm) // 2 :], axis=0)
                command = np.array([
                    control.step(
                        state, p, {"root_moment": goal}, {"gust": expected(kind, time, p[2])}
                    ).u
                    for control, state, p, goal, (_, kind) in zip(
                        controls, states, known, goals, lanes, strict=True
                    )
                ])  # fmt: skip
        log.append((moments.ravel(), np.vstack([rest, at]), np.hstack([0 * rest[:, 0], gusts])))
        for j in range(round(SAMPLE / FINE)):
            at = at + np.clip((command - at) * (1 - np.exp(-FINE / LAG)), -most, most)
            p = plant.parameters(repeat, float(GUST(time + (j + 0.5) * FINE)))
            x = plant.step(x, np.vstack([rest, at]), p)
    columns = [np.split(np.array(rows), repeat, axis=1) for rows in zip(*log, strict=True)]
    names = ("open loop", *CASES)
    return times, {name: Flights(*(c[i] for c in columns)) for i, name in enumerate(names)}


def changes(found):
    """Largest increment of the root moment over the open loop's, less 1, by case and flight."""
    largest = {k: (each.moments - each.moments[0]).max(axis=0) for k, each in found.items()}
    return {k: v / largest["open loop"] - 1 for k, v in largest.items() if k != "open loop"}


def plot(times, found):
    """The flights with the least relief, of each case."""
    figure = Figure(figsize=(8, 6.5), layout="constrained")
    upper, middle, lower = figure.subplots(3, sharex=True, height_ratios=(2, 1, 1))
    colors = dict(zip(found, ("0.6", "tab:blue", "black"), strict=False))
    for name, each in found.items():
        worst = np.argmax(changes(found)[name]) if name in CASES else 0
        moments = each.moments[:, worst]
        upper.plot(times, moments - moments[0], color=colors[name], label=name)
        if name in CASES:
            middle.plot(times, np.degrees(each.flaps[:, worst, 1]), color=colors[name])
            lower.plot(times, each.gusts[:, worst], color=colors[name])
    lower.plot(times, [float(GUST(time)) for time in times], color="tab:red", ls="--", label="true")
    upper.set_ylabel("root moment,\nincrement [N m]")
    middle.set_ylabel("outer flap [°]")
    lower.set(ylabel="gust, as\nestimated [m/s]", xlabel="time [s]", xlim=(times[0], times[-1]))
    upper.legend(frameon=False)
    lower.legend(frameon=False)
    return figure


def main(directory=Path("out")):
    times, found = simulate()
    relief = changes(found)
    for name, change in relief.items():
        mean, worst = 100 * change.mean(), 100 * change.max()
        print(f"{name}: largest increment of the root moment {mean:+.0f} %, worst {worst:+.0f} %")
    directory.mkdir(exist_ok=True)
    plot(times, found).savefig(directory / "gust_load_alleviation_from_sensors.png", dpi=150)
    return relief


if __name__ == "__main__":
    main()
