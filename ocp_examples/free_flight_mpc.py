"""Can a flexible aircraft hold its height and its root moments in a gust?

    min_u  ½ Σ_k (h_k/0.3)² + (V_k − V)² + Σ_wings ((M_k − M_trim)/50)² + |v_k|² + |v_k − v_{k−1}|²

h is the height, V the airspeed, M the root moment, v = 0.3 u over its limits, beside trim. The HALE
aircraft flies level at 25 m/s and meets a 1-cosine gust of 2 m/s that lasts 1.5 s. Two flaps along
each wing, the elevator and the thrust answer. The aircraft is finer than the model of the
controller: more weights and elements, states of the air for each strip, steps of 10 ms, actuators
that follow their commands with a lag of 20 ms at their largest rate. The controller sees how far
the state is from trim, and the gust of the present moment, which it takes for the one to come.
`--animate` writes a GIF.
"""

import argparse
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

import curvcasadi as cc
from curvcasadi.plotting import animate_flight

AIRCRAFT = Path(__file__).parent / "hale_aircraft.toml"
DENSITY, SPEED = 0.0889, 25.0  # kg/m³, m/s
GUST = cc.OneMinusCosine(amplitude=2.0, duration=1.5, start=0.5)
DT, HORIZON, END = 0.05, 20, 6.0
FINE, LAG = 0.01, 0.02  # s: step of the plant; lag of the actuators
LIMITS = {"inner": 0.26, "outer": 0.26, "elevator": 0.2, "thrust": 8.0}  # beside trim; rad, N
RATES = {"inner": 1.0, "outer": 1.0, "elevator": 1.0, "thrust": 10.0}  # per second
MODEL = {"weights": (2, 3, 1), "elements": 4, "modes": 2, "entry": 1}
PLANT = {"weights": (3, 4, 2), "elements": 8, "modes": None, "entry": None}
COMPILED = True


class Flyer(NamedTuple):
    """An aircraft, its model, and state and inputs in trimmed flight."""

    aircraft: cc.Aircraft
    model: cc.ControlModel
    x: np.ndarray
    u: np.ndarray


def flyer(name, weights, elements, modes, entry):
    """The aircraft with two flaps along each wing, as fine as asked for."""
    aircraft = cc.load_aircraft(AIRCRAFT)
    wing = aircraft.beams[0]
    channels = zip(("torsion", "out_of_plane", "in_plane"), weights, strict=True)
    basis = cc.ChannelBasis(**{key: cc.Legendre(n) for key, n in channels})
    flaps = tuple(
        cc.ControlSurface(name=key, start=start, end=end, lift=3.5, moment=-0.6)
        for key, start, end in (("inner", 0.2, 0.6), ("outer", 0.6, 0.95))
    )
    beam = replace(wing.beam, basis=basis, grid=cc.Grid.lobatto(elements))
    right = replace(wing, beam=beam, strips=replace(wing.strips, controls=flaps))
    aircraft = replace(aircraft, beams=(right, cc.mirror_wing(right, "left")))
    model = cc.aircraft_model(
        aircraft,
        density=DENSITY,
        lag=cc.IndicialLag(poles=2, modes=modes),
        gust=cc.GustEntry(modes=entry),
        damping=2e-3,
        outputs=("height", "airspeed", "root_moment_right", "root_moment_left"),
        name=name,
    )
    clean = {"inner": 0.0, "outer": 0.0}
    trim = cc.trim(aircraft, speed=SPEED, density=DENSITY, inputs=clean)
    return Flyer(aircraft, model, *cc.trimmed_state(model, trim))


def controller(plant, small):
    """A real-time iteration every 50 ms, of changes from trim: x, gust -> change of the inputs."""
    names = [part.name for part in small.model.u.parts]
    trim = dict(zip(names, small.u, strict=True))
    moment = {f"root_moment_{side}": [0.0, 1 / 50**2, 0.0] for side in ("right", "left")}
    effort = {key: (0.3 / most) ** 2 for key, most in LIMITS.items()}
    mpc = cc.Mpc(
        small.model,
        dt=DT,
        horizon=HORIZON,
        outputs={"height": 1 / 0.3**2, "airspeed": 1.0, **moment},
        inputs=effort,
        moves=effort,
        bounds={key: (trim[key] - most, trim[key] + most) for key, most in LIMITS.items()},
        rate_bounds=RATES,
        u_trim=trim,
        compiled=COMPILED,
    )
    reference = small.model.y.split(small.model.output(small.x, small.u, 0))
    rest = cc.project_state(plant.model, plant.x, small.model)

    def control(x, gust):
        seen = cc.project_state(plant.model, x, small.model)
        away = cc.difference(small.model, rest, seen)
        step = mpc.step(cc.retract(small.model, small.x, away), [gust], reference)
        return step.u - small.u

    return control


def fly(plant, control):
    """The flight while `control` changes the inputs, which follow with a lag."""
    model = plant.model
    step = cc.compile_function(
        cc.step_function(model, FINE, method="implicit_midpoint"), derivatives=0
    )
    output = cc.compile_function(model.output, derivatives=0)
    most = FINE * np.array([RATES[part.name] for part in model.u.parts])
    x, at, states, inputs, outputs = plant.x, np.zeros(model.u.size), [], [], []
    times = FINE * np.arange(round(END / FINE) + 1)
    for k, t in enumerate(times):
        gust = float(GUST(t))
        if k % round(DT / FINE) == 0:
            command = control(x, gust)
        states.append(x)
        inputs.append(plant.u + at)
        outputs.append(output(x, plant.u + at, gust).full()[:, 0])
        at = at + np.clip((command - at) * (1 - np.exp(-FINE / LAG)), -most, most)
        x, residual = step(x, plant.u + at, float(GUST(t + FINE / 2)))
        if not residual < 1e-8:
            raise ArithmeticError(f"the step at {t:.2f} s does not converge")
        x = x.full()[:, 0]
    return cc.Simulation(
        model=model,
        t=times,
        x=np.array(states).T,
        u=np.array(inputs).T,
        p=np.array([[float(GUST(t)) for t in times]]),
        y=np.array(outputs).T,
        iterations=0.0,
        success=True,
        message="flown",
    )


def peaks(flight):
    """Largest changes of height, m, and of the root moments, N m."""
    height = flight.part("height")[0]
    moments = [flight.part(f"root_moment_{side}")[1] for side in ("right", "left")]
    return np.abs(height - height[0]).max(), max(np.abs(m - m[0]).max() for m in moments)


def plot(flights):
    figure = Figure(figsize=(7, 7), layout="constrained")
    height, bending, deflection = figure.subplots(3, 1, sharex=True)
    for (name, flight), color in zip(flights.items(), ("0.6", "tab:blue"), strict=True):
        moment = -flight.part("root_moment_right")[1]
        height.plot(flight.t, flight.part("height")[0], color=color, label=name)
        bending.plot(flight.t, moment - moment[0], color=color)
    for key in ("inner", "outer", "elevator"):
        change = np.degrees(flight.part(key)[0])
        deflection.plot(flight.t, change - change[0], label=key)
    height.set(ylabel="height [m]")
    bending.set(ylabel="root bending,\nchange [N m]")
    deflection.set(xlabel="time [s]", ylabel="deflection by MPC\nbeside trim [°]")
    for axes in (height, bending, deflection):
        axes.grid(color="0.9")
    height.legend(frameon=False)
    deflection.legend(frameon=False, ncols=3)
    return figure


def main(directory=Path("out"), animate=False):
    plant, small = flyer("plant", **PLANT), flyer("model", **MODEL)
    flights = {
        "trimmed controls": fly(plant, lambda x, gust: np.zeros(len(plant.u))),
        "MPC": fly(plant, controller(plant, small)),
    }
    for name, flight in flights.items():
        height, moment = peaks(flight)
        print(f"{name}: height changes by {height:.2f} m, root moment by {moment:.0f} N m")
    directory.mkdir(exist_ok=True)
    plot(flights).savefig(directory / "free_flight_mpc.png", dpi=150)
    if animate:
        animate_flight(plant.aircraft, flights["MPC"], directory / "free_flight_mpc.gif")
    return {name: peaks(flight) for name, flight in flights.items()}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--animate", action="store_true", help="write a GIF of the flight")
    main(animate=parser.parse_args().animate)
