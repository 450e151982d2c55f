"""Can a flexible aircraft hold its height and its root moments in a gust, by its sensors?

    min_u  ½ Σ_k (h_k/0.2)² + (V_k/0.5)² + Σ_wings (M_k/150)² + |v_k|² + |w_k − w_{k−1}|²

Height h, airspeed V, root moments M and inputs u are changes from calm air; v = 2 u, of the outer
flaps 5 u, and w = 0.4 u over their limits. The HALE aircraft flies level at some 25 m/s and meets a
1-cosine gust of 2 m/s that lasts 1.5 s. Two flaps along each wing, the elevator and the thrust
answer. They follow their commands with a lag of 20 ms and at limited rates.

The aircraft that flies is not the model: it has more weights, elements and states of the air, GJ
and EI differ by up to 10 %, mass by 5 %, airspeed by 1 m/s, as a seed draws them. Two IMUs and two
strain gauges on each wing, height and airspeed are read at 40 Hz with noise, 25 ms late, and one
sample in twenty is missing. An extended Kalman filter on the model estimates state and gust, and
the controller takes this gust for the one to come. With the true state and the true gust of the
moment it is what full knowledge would give. `--animate` writes a GIF of the flight with the filter.
"""

import argparse
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import casadi as ca
import numpy as np
from matplotlib.figure import Figure

import curvcasadi as cc
from curvcasadi.plotting import animate_flight

AIRCRAFT = Path(__file__).parent / "hale_aircraft.toml"
DENSITY, SPEED, GRAVITY = 0.0889, 25.0, 9.80665  # kg/m³, m/s, m/s²
GUST = cc.OneMinusCosine(amplitude=2.0, duration=1.5, start=2.5)
CALM, END = 2.0, 8.0  # s: when the controller takes over; end of the flight
DT, HORIZON = 0.05, 20  # s; stages
SAMPLE, LATE, MISSING = 0.025, 1, 0.05  # s; samples; share of them
FINE, LAG = 0.005, 0.02  # s: step of the plant; lag of the actuators
VARIED, FASTER = {"GJ": 0.1, "EI": 0.1, "mass": 0.05}, 1.0  # relative; m/s
LIMITS = {"inner": 0.26, "outer": 0.26, "elevator": 0.2, "thrust": 8.0}  # beside trim; rad, N
EFFORT = {"inner": 2.0, "outer": 5.0, "elevator": 2.0, "thrust": 2.0}
RATES = {"inner": 1.0, "outer": 1.0, "elevator": 1.0, "thrust": 10.0}  # per second
MODEL = {"weights": (2, 3, 0), "elements": 4, "modes": 3, "entry": 1}
PLANT = {"weights": (3, 4, 2), "elements": 8, "modes": None, "entry": None}
IMUS, GAUGES = (0.0, 0.5), (0.05, 0.4)  # stations
KEPT = ("height", "airspeed", "root_moment_right", "root_moment_left")
READ = ("angular_rate", "acceleration")  # by an IMU
OUTPUTS = {"model": KEPT, "plant": (*KEPT, *(f"{k}_{s}" for k in READ for s in ("right", "left")))}
NOISE = {"angular_rate": 1e-3, "acceleration": 2e-2, "strain": 1e-5, "height": 0.1, "airspeed": 0.1}
# What the filter takes it for: its model knows rates, accelerations and strains no better.
TAKEN = NOISE | {"angular_rate": 1.5e-2, "acceleration": 0.1, "strain": 5e-4}
DRIVEN = {"twist": [3e-3] * 3 + [4e-2] * 3, "q_dot": 0.05, "lag": 0.01, "gust": 1.2}  # unit/√s
START = {"quaternion_wxyz": 0.02, "position": 0.3, "twist": [0.01] * 3 + [0.5] * 3}
START |= {"q": 3e-3, "q_dot": 0.02, "lag": 0.3, "gust": 0.5}
COMPILED = True


class Flyer(NamedTuple):
    """An aircraft, its model, and state and inputs in trimmed flight."""

    aircraft: cc.Aircraft
    model: cc.ControlModel
    x: np.ndarray
    u: np.ndarray


def flyer(name, weights, elements, modes, entry, GJ=1.0, EI=1.0, mass=1.0, speed=SPEED):
    """The aircraft with two flaps along each wing; its stiffness and mass times factors."""
    aircraft = cc.load_aircraft(AIRCRAFT)
    wing = aircraft.beams[0]
    orders = {"torsion": 1, "out_of_plane": 2, "in_plane": 2}
    basis = cc.ChannelBasis(
        **{
            key: cc.FreeTip(n, order) if name == "model" else cc.Legendre(n)
            for (key, order), n in zip(orders.items(), weights, strict=True)
            if n
        }
    )
    flaps = tuple(
        cc.ControlSurface(name=key, start=start, end=end, lift=3.5, moment=-0.6)
        for key, start, end in (("inner", 0.2, 0.6), ("outer", 0.6, 0.95))
    )
    beam = replace(wing.beam, basis=basis, grid=cc.Grid.lobatto(elements))
    beam = cc.perturbed_beam(beam, GJ=GJ, EI=EI, mass=mass)
    right = replace(wing, beam=beam, strips=replace(wing.strips, controls=flaps))
    body = replace(aircraft.body, mass=mass * aircraft.body.mass)
    aircraft = replace(aircraft, body=body, beams=(right, cc.mirror_wing(right, "left")))
    model = cc.aircraft_model(
        aircraft,
        density=DENSITY,
        gravity=GRAVITY,
        lag=cc.IndicialLag(poles=2, modes=modes),
        gust=cc.GustEntry(modes=entry),
        damping=2e-3,
        outputs=OUTPUTS[name],
        stations=IMUS,
        name=name,
    )
    clean, bounds = {"inner": 0.0, "outer": 0.0}, {"elevator": (-0.8, 0.8)}
    trim = cc.trim(aircraft, speed=speed, density=DENSITY, inputs=clean, bounds=bounds)
    return Flyer(aircraft, model, *cc.trimmed_state(model, trim))


def compiled(f):
    return cc.compile_function(f, derivatives=0) if COMPILED else f


def sensors(noise):
    """Sensors of a wing, whose samples have the standard deviations `noise`."""
    gyro, accelerometer = (noise[key] * SAMPLE**0.5 for key in READ)  # densities
    return (
        *(cc.RateGyro(xi=xi, noise_density=gyro, rate=1 / SAMPLE) for xi in IMUS),
        *(cc.Accelerometer(xi=xi, noise_density=accelerometer, rate=1 / SAMPLE) for xi in IMUS),
        *(cc.StrainGauge(xi=xi, offset=[0, 0.05], noise=noise["strain"]) for xi in GAUGES),
    )


class Plant:
    """The aircraft that flies: its steps and what its sensors read, in lanes of one."""

    def __init__(self, seed):
        *draws, faster = np.random.default_rng(seed).uniform(-1, 1, 4)
        factors = {k: 1 + most * z for (k, most), z in zip(VARIED.items(), draws, strict=True)}
        self.trim = trim = flyer("plant", **PLANT, **factors, speed=SPEED + FASTER * faster)
        self.model = model = trim.model
        self.after = compiled(cc.step_function(model, FINE, method="implicit_midpoint"))
        sizes = {"x": model.x.size, "u": model.u.size, "p": model.p.size}
        x, u, p = (ca.MX.sym(key, size) for key, size in sizes.items())
        parts, outputs, readings = model.x.split(x), model.y.split(model.output(x, u, p)), []
        for wing in trim.aircraft.beams:
            gauges = sensors(NOISE)[-len(GAUGES) :]
            readings += [(key, outputs[f"{key}_{wing.name}"]) for key in READ]
            strains = cc.measure(gauges, wing.beam, parts[f"q_{wing.name}"]).values
            readings.append(("strain", strains))
        readings += [(key, outputs[key]) for key in ("height", "airspeed")]
        names, values = zip(*readings, strict=True)
        self.sensed = compiled(ca.Function("read", [x, u, p], [ca.vertcat(*values)]))
        self.noise = np.repeat([NOISE[key] for key in names], [v.numel() for v in values])
        self.actuators = cc.Actuators(lag=LAG, rate=[RATES[part.name] for part in model.u.parts])

    def step(self, x, u, p):
        """States after a step; NaN where it does not converge."""
        after, residual = self.after(x.T, u.T, p.T)
        return np.where(float(residual) < 1e-8, after.full().T, np.nan)

    def read(self, x, u, p):
        return self.sensed(x.T, u.T, p.T).full().T

    def fly(self, control, **sensed):
        """The flight, of `control` by the state or by what an observer makes of samples."""
        loop = cc.closed_loop(
            self.step,
            self.trim.x,
            control,
            SAMPLE * np.arange(round(END / SAMPLE)),
            substeps=round(SAMPLE / FINE),
            actuators=self.actuators,
            p=lambda time: np.array([[float(GUST(time))]]),
            u=self.trim.u,
            every=round(DT / SAMPLE),
            **sensed,
        )
        keys = {"x": loop.x[:, 0].T, "u": loop.u[:, 0].T, "p": loop.p[:, 0].T}
        keys["y"] = self.model.output(*keys.values()).full()
        return cc.Simulation(
            model=self.model, t=loop.t, **keys, iterations=0.0, success=True, message="flown"
        )


def make_filter(small):
    """An extended Kalman filter on the model, and what it starts from."""
    model, kinds = small.model, {"gust": "gust"}  # by name of the part
    for part in model.x.parts:
        kinds[part.name] = next(key for key in sorted(START)[::-1] if part.name.startswith(key))
    density = {name: DRIVEN[kind] for name, kind in kinds.items() if kind in DRIVEN}
    process = cc.ModelProcess(
        model=model, density=density, estimated={"gust": None}, acceleration=0.4
    )
    outputs = {key: TAKEN[key] for key in ("height", "airspeed")}
    root = cc.RootMotion(gravity=[0, 0, GRAVITY])
    on_wings = dict.fromkeys(("right", "left"), sensors(TAKEN))
    ekf = cc.shape_ekf(small.aircraft, on_wings, process=process, root=root, outputs=outputs)
    deviation = {name: START[kind] for name, kind in kinds.items()}
    mean = {key: small.x[where] for key, where in model.x.slices.items()}
    return ekf, ekf.initial(deviation, mean)


def make_mpc(small):
    """Predictive control of the model, for one real-time iteration every 50 ms."""
    names = [part.name for part in small.model.u.parts]
    trim = dict(zip(names, small.u, strict=True))
    moment = {f"root_moment_{side}": [0.0, 1 / 150**2, 0.0] for side in ("right", "left")}
    return cc.Mpc(
        small.model,
        dt=DT,
        horizon=HORIZON,
        outputs={"height": 1 / 0.2**2, "airspeed": 1 / 0.5**2, **moment},
        inputs={key: (EFFORT[key] / most) ** 2 for key, most in LIMITS.items()},
        moves={key: (0.4 / most) ** 2 for key, most in LIMITS.items()},
        bounds={key: (trim[key] - most, trim[key] + most) for key, most in LIMITS.items()},
        rate_bounds=RATES,
        u_trim=trim,
        compiled=COMPILED,
    )


class Controller:
    """Predictive control of changes from what was seen in calm air."""

    def __init__(self, small, mpc):
        self.small, self.mpc, self.calm = small, mpc, []
        self.reference = small.model.y.split(small.model.output(small.x, small.u, 0))

    def away(self, x):
        """How far a state is from trim."""
        return cc.difference(self.small.model, self.small.x, x).full()[:, 0]

    def wait(self, x, gust):
        """See calm air."""
        self.calm.append([*self.away(x), gust])

    def change(self, x, gust):
        """Changes of the inputs."""
        rest = np.mean(self.calm[-len(self.calm) // 3 :], axis=0)
        x = cc.retract(self.small.model, self.small.x, self.away(x) - rest[:-1])
        return self.mpc.step(x, [gust - rest[-1]], self.reference).u - self.small.u


def simulate(plant, small, mpc, ekf, start, seed, native=False):
    """The flights of an aircraft, by what its controller knows.

    A `native` filter flies faster, but takes a minute to compile.
    """
    rest, nx = plant.trim.u, small.model.x.size

    def commands(seen):
        """Commands by the state and the gust that are `seen` in estimates."""
        controller = Controller(small, mpc.copy())

        def control(time, estimates, applied):
            known = seen(time, estimates[0])
            if time < CALM:
                controller.wait(*known)
                return [rest]
            return [rest + controller.change(*known)]

        return control

    def truth(time, x):
        """What nobody has: the state, and the gust of the moment."""
        return cc.project_state(plant.model, x, small.model), float(GUST(time))

    def estimated(time, z):
        return z[:nx], z[nx]

    late = cc.DelayedFilter(ekf, start, dt=SAMPLE, delay=LATE, compiled=native)
    link = cc.SensorLink(noise=plant.noise, delay=LATE, loss=MISSING, seeds=[seed])
    return {
        "trimmed controls": plant.fly(lambda time, x, applied: [rest]),
        "MPC, true state": plant.fly(commands(truth)),
        "MPC and EKF": plant.fly(commands(estimated), read=plant.read, link=link, observer=late),
    }


def peaks(flight):
    """Largest changes of height, m, and of the root moments, N m."""
    height = flight.part("height")[0]
    moments = [flight.part(f"root_moment_{side}")[1] for side in ("right", "left")]
    return np.abs(height - height[0]).max(), max(np.abs(m - m[0]).max() for m in moments)


def plot(flights):
    figure = Figure(figsize=(7, 7), layout="constrained")
    height, bending, deflection = figure.subplots(3, 1, sharex=True)
    for (name, flight), color in zip(flights.items(), ("0.6", "black", "tab:blue"), strict=True):
        moment = -flight.part("root_moment_right")[1]
        label = f"{name} and gust: full knowledge" if "true" in name else name
        height.plot(flight.t, flight.part("height")[0], color=color, label=label)
        bending.plot(flight.t, moment - moment[0], color=color)
    for key in ("inner", "outer", "elevator"):
        change = np.degrees(flight.part(key)[0])
        deflection.plot(flight.t, change - change[0], label=key)
    height.set(ylabel="height [m]")
    bending.set(ylabel="root bending,\nchange [N m]")
    deflection.set(xlabel="time [s]", ylabel="deflection by MPC and EKF,\nbeside trim [°]")
    for axes in (height, bending, deflection):
        axes.axvspan(GUST.start, GUST.start + GUST.duration, color="0.95")
        axes.grid(color="0.9")
    height.legend(frameon=False)
    deflection.legend(frameon=False, ncols=3)
    return figure


def main(directory=Path("out"), animate=False, seed=0):
    plant, small = Plant(seed), flyer("model", **MODEL)
    flights = simulate(plant, small, make_mpc(small), *make_filter(small), seed)
    for name, flight in flights.items():
        height, moment = peaks(flight)
        print(f"{name}: height changes by {height:.2f} m, root moment by {moment:.0f} N m")
    directory.mkdir(exist_ok=True)
    plot(flights).savefig(directory / "free_flight_mpc.png", dpi=150)
    if animate:
        flight, tenth = flights["MPC and EKF"], np.s_[:: round(0.1 / SAMPLE)]
        frames = {key: getattr(flight, key)[..., tenth] for key in "txupy"}
        film = directory / "free_flight_mpc.gif"
        animate_flight(plant.trim.aircraft, replace(flight, **frames), film)
    return {name: peaks(flight) for name, flight in flights.items()}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--animate", action="store_true", help="write a GIF of the flight")
    main(animate=parser.parse_args().animate)
