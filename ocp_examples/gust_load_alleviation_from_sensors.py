"""How much of a gust's root moment can flaps take away where only sensors know the wing?

    samples, late and with gaps  →  x̂, ŵ (EKF on the model)  →  u (MPC of the expected gust)

Wing, gust, flaps and cost are those of `gust_load_alleviation.py`, but each wing that flies differs
from the model of the controller: EI and GJ by up to 10 %, mass by 5 %, airspeed by 1 m/s. Two IMUs
and three strain gauges at 100 Hz are noisy and 20 ms late; one sample in twenty is missing. Before
the gust, 1.5 s of calm air let the filter settle; their root moment is what the controller
keeps.
Without preview the controller expects that the estimated gust stays (or "none"); preview is an
upper bound. The wings fly as one batch: each is a lane of a vector register. `--animate` writes a
GIF of the first wing.
"""

import argparse
from pathlib import Path
from typing import NamedTuple

import casadi as ca
import numpy as np
from matplotlib.figure import Figure

import curvcasadi as cc
from curvcasadi.plotting import animate_shape
from curvcasadi.reference_wings import hale_wing

AIRSPEED, PITCH, DENSITY = 20.0, np.radians(3.0), 0.0889
GUST = cc.OneMinusCosine(amplitude=2.0, duration=1.5, start=0.25)
CALM, END, FLIGHTS = 1.5, 2.5, 2  # s: before and from time 0
FINE, SAMPLE, DT, HORIZON = 1e-3, 0.01, 0.05, 20  # s: of the plant, sensors, controller; stages
LAG, LATE, MISSING = 0.02, 2, 0.05  # s, of the actuators; samples; share of them
VARIED, SPEED = {"GJ": 0.1, "EI": 0.1, "mass": 0.05}, 1.0  # largest changes, relative and in m/s
MOMENT, DEFLECTION, MOVE = 1 / 50**2, 0.02, 0.05  # weights
MODEL = {"weights": (3, 3, 1), "elements": 6, "modes": 3, "entry": 1}
PLANT = {"weights": (4, 5, 3), "elements": 10, "modes": None, "entry": None}
NOISE = {"q_dot": 0.05, "lag": 0.2, "gust": 1.5, "airspeed": 0.02}  # drive the filter's process
START = {"q": 0.003, "q_dot": 0.02, "lag": 0.3, "gust": 0.5, "airspeed": 1.0}  # deviations
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
    """All wings in one case: entries by time, then by wing."""

    moments: np.ndarray  # N m
    flaps: np.ndarray  # of the inner and the outer one, rad
    gusts: np.ndarray  # as the filter estimates them, m/s
    weights: np.ndarray  # rad/m


def wing_model(name, weights, elements, modes, entry, factors=None):
    """The wing with two flaps; `factors` of GJ, EI and mass become parameters."""
    flaps = tuple(
        cc.ControlSurface(name=key, start=start, end=end, lift=3.5, moment=-0.6)
        for key, start, end in (("inner", 0.2, 0.6), ("outer", 0.6, 0.95))
    )
    strips = cc.StripAerodynamics(
        chord=1.0, aerodynamic_center=0.25, lift_slope=2 * np.pi, controls=flaps, stations=8
    )
    beam = cc.perturbed_beam(hale_wing(*weights, grid=cc.Grid.lobatto(elements)), **factors or {})
    model = cc.wing_model(
        cc.Wing(name="right", beam=beam, strips=strips),
        density=DENSITY,
        lag=cc.IndicialLag(poles=2, modes=modes),
        gust=cc.GustEntry(kind="kussner", modes=entry),
        damping=2e-3,
        outputs=["root_moment"],
        parameters=factors or {},
        name=name,
    )
    return beam, model


def trim(model, airspeed, **others):
    speeds = [airspeed, airspeed + 1]
    return cc.flutter(model, speeds, p={"pitch": PITCH, **others}).equilibria[0]


class Plant:
    """The wings that fly, one for each seed: their steps, readings and outputs, in batches."""

    def __init__(self, seeds):
        factors = {name: ca.MX.sym(name) for name in VARIED}
        beam, model = wing_model("plant", **PLANT, factors=factors)
        read = cc.readings_function(model, beam, SENSORS, root=ROOT)
        functions = (cc.rk4_step(model, FINE), read, model.output)
        self.model = model
        self.step, self.read, self.output = map(cc.compile_batch, functions)
        draws = np.array([np.random.default_rng(seed).uniform(-1, 1, 4) for seed in seeds])
        self.factors = 1 + draws[:, :3] * [*VARIED.values()]
        self.airspeed = AIRSPEED + SPEED * draws[:, 3:]
        self.trims = np.array([
            trim(model, float(speed), **dict(zip(VARIED, factors, strict=True)))
            for (speed,), factors in zip(self.airspeed, self.factors, strict=True)
        ])  # fmt: skip

    def parameters(self, time):
        one = np.ones_like(self.airspeed)
        return np.hstack([self.airspeed, PITCH * one, float(GUST(time)) * one, self.factors])

    def fly(self, control, rates=1.0, gust=0, **sensed):
        """Times and motion of all wings; `gust` is the entry of estimates that holds it."""
        loop = cc.closed_loop(
            self.step,
            self.trims,
            control,
            SAMPLE * np.arange(-round(CALM / SAMPLE), round(END / SAMPLE)),
            substeps=round(SAMPLE / FINE),
            actuators=cc.Actuators(lag=LAG, rate=rates),
            p=self.parameters,
            u=np.zeros(2),
            every=round(DT / SAMPLE),
            **sensed,
        )
        flat = (np.concatenate(rows) for rows in (loop.x, loop.u, loop.p))
        moments = -self.output(*flat)[:, 1].reshape(len(loop.t), -1)  # they bend the root upward
        weights = loop.x[:, :, self.model.x.slices["q"]]
        return loop.t, Flights(moments, loop.u, loop.estimates[:, :, gust], weights)


def make_filter(beam, model, kind):
    """A filter that estimates the gust, too, and with preview of it the airspeed."""
    estimated = {"gust": None, "airspeed": None} if kind == "known" else {"gust": None}
    parts = {"q_dot", "lag", *estimated}
    process = cc.ModelProcess(
        model=model,
        density={part: NOISE[part] for part in parts},
        estimated=estimated,
        acceleration=0.2,
    )
    ekf = cc.shape_ekf(beam, SENSORS, process=process, root=ROOT, recovery=10)
    rest = trim(model, AIRSPEED)
    mean = {part: rest[where] for part, where in model.x.slices.items()} | {"airspeed": AIRSPEED}
    return ekf, ekf.initial(
        {part: START[part] for part in {"q", *parts}},
        {part: value for part, value in mean.items() if part in ekf.layout.slices},
    )


def controller(model, parts, flaps, kind, flights):
    """Real-time iterations, one every 50 ms, that keep the root moment of calm air.

    `parts` are those of the estimates. What the model is wrong by looks like a gust in calm air,
    which is expected to stay.
    """
    names = [part.name for part in model.u.parts]
    mpc = cc.Mpc(
        model,
        dt=DT,
        horizon=HORIZON,
        outputs={"root_moment": [0.0, MOMENT, 0.0]},
        inputs=dict.fromkeys(names, DEFLECTION),
        moves=dict.fromkeys(names, MOVE),
        bounds={k: (-most, most) for k, most in zip(names, flaps[0], strict=True)},
        rate_bounds=dict(zip(names, flaps[1], strict=True)),
    )
    controllers, calm = [mpc.copy() for _ in range(flights)], []

    def control(time, estimates, applied):
        x, gusts = estimates[:, : model.x.size], estimates[:, parts["gust"]]
        one = np.ones_like(gusts)
        speeds = estimates[:, parts["airspeed"]] if "airspeed" in parts else AIRSPEED * one
        known = np.hstack([speeds, PITCH * one, gusts])
        if time < -SAMPLE / 2:
            now = zip(x, applied, known, strict=True)
            outputs = [model.output(*arguments).full().ravel() for arguments in now]
            calm.append(np.hstack([outputs, gusts]))
            return 0 * applied
        means = np.mean(calm[len(calm) // 2 :], axis=0)
        commands = []
        for each, state, p, goal in zip(controllers, x, known, means, strict=True):
            preview = {"gust": expected(kind, time, p[2], goal[-1])}
            commands.append(each.step(state, p, {"root_moment": goal[:-1]}, preview).u)
        return commands

    return control


def expected(kind, time, gust, calm):
    """The gust of each stage of the horizon that begins at `time`."""
    if kind == "known":
        middles = time + DT * (np.arange(HORIZON) + 0.5)
        return calm + np.array([float(GUST(middle)) for middle in middles])
    return np.full(HORIZON, gust if kind == "estimated" else calm)


def simulate(seeds):
    """Times, and `Flights` by case: one flight of each case for each seed."""
    plant, (beam, model) = Plant(seeds), wing_model("model", **MODEL)
    times, rest = plant.fly(lambda time, x, applied: 0 * applied)
    found = {"open loop": rest}
    for name, (size, kind) in CASES.items():
        flaps, (ekf, start) = SETS[size], make_filter(beam, model, kind)
        parts = ekf.layout.slices
        known = [PITCH] if "airspeed" in parts else [AIRSPEED, PITCH]
        late = cc.DelayedFilter(ekf, start, dt=SAMPLE, delay=LATE, lanes=len(seeds), p=known)
        link = cc.SensorLink(noise=ekf.channels.noise, delay=LATE, loss=MISSING, seeds=seeds)
        control = controller(model, parts, flaps, kind, len(seeds))
        sensed = {"read": plant.read, "link": link, "observer": late}
        found[name] = plant.fly(control, flaps[1], parts["gust"].start, **sensed)[1]
    return times, found


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


def main(directory=Path("out"), animate=False):
    times, found = simulate(range(FLIGHTS))
    relief = changes(found)
    for name, change in relief.items():
        mean, worst = 100 * change.mean(), 100 * change.max()
        print(f"{name}: largest increment of the root moment {mean:+.0f} %, worst {worst:+.0f} %")
    directory.mkdir(exist_ok=True)
    plot(times, found).savefig(directory / "gust_load_alleviation_from_sensors.png", dpi=150)
    if animate:
        beam = hale_wing(*PLANT["weights"])
        weights = found[next(iter(CASES))].weights[::4, 0]
        file = directory / "gust_load_alleviation_from_sensors.gif"
        animate_shape(beam, times[::4], weights, file)
    return relief


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--animate", action="store_true", help="write a GIF of the wing")
    main(animate=parser.parse_args().animate)
