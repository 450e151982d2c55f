"""How much of a gust's root moment can flaps take away, and what is it worth to see it coming?

    min_u  ½ Σ_k (M_k − M_trim)²/50² + 0.02 |u_k|² + 0.05 |u_k − u_{k−1}|²,   |u|, |du/dt| bounded

The HALE wing at 3° and 20 m/s meets a 1-cosine gust of 2 m/s. The plant is finer than the model of
the controller: more weights, states of the air for each strip, a gust that enters each of them by
Küssner's function, Runge–Kutta at 1 ms, flaps that follow their commands with a lag of 20 ms at
their largest rate. Without preview the controller takes the gust that it is in for the one to come;
perfect preview is an upper bound of what a sensor ahead of the wing can give. `--animate` writes a
GIF.
"""

import argparse
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure
from scipy.linalg import solve_discrete_are

import curvcasadi as cc
from curvcasadi.plotting import animate_shape
from curvcasadi.reference_wings import hale_wing

AIRSPEED, PITCH, DENSITY = 20.0, np.radians(3.0), 0.0889
GUST = cc.OneMinusCosine(amplitude=2.0, duration=1.5, start=0.25)
DT, HORIZON, END = 0.05, 20, 4.0
FINE, SAMPLE, LAG = 1e-3, 0.01, 0.02  # s: of the plant, of what is shown; of the actuators
MOMENT, DEFLECTION, MOVE = 1 / 50**2, 0.02, 0.05  # weights
LQR_DEFLECTION = 30.0  # with less the law asks for more than the flaps can do
SPEEDS = np.arange(20.0, 33.0, 2.0)
MODEL = {"weights": (3, 4, 2), "elements": 8, "modes": 3, "entry": 1}
PLANT = {"weights": (4, 5, 3), "elements": 10, "modes": None, "entry": None}
CONTROLLERS = ("open loop", "LQR", "MPC", "MPC with preview")


class Flaps(NamedTuple):
    """Limits of the inner (0.2 to 0.6 of the span) and the outer flap (0.6 to 0.95)."""

    angles: np.ndarray  # rad
    rates: np.ndarray  # rad/s


SETS = {
    "small flaps": Flaps(np.radians([0.0, 10.0]), np.radians([40.0, 40.0])),
    "large flaps": Flaps(np.radians([15.0, 15.0]), np.radians([60.0, 60.0])),
}

CASES = dict.fromkeys(SETS, CONTROLLERS)


def wing_model(name, weights, elements, modes, entry):
    """The wing with two flaps, as fine as asked for."""
    flaps = tuple(
        cc.ControlSurface(name=key, start=start, end=end, lift=3.5, moment=-0.6)
        for key, start, end in (("inner", 0.2, 0.6), ("outer", 0.6, 0.95))
    )
    strips = cc.StripAerodynamics(
        chord=1.0, aerodynamic_center=0.25, lift_slope=2 * np.pi, controls=flaps, stations=8
    )
    beam = hale_wing(*weights, grid=cc.Grid.lobatto(elements))
    return cc.wing_model(
        cc.Wing(name="right", beam=beam, strips=strips),
        density=DENSITY,
        lag=cc.IndicialLag(poles=2, modes=modes),
        gust=cc.GustEntry(kind="kussner", modes=entry),
        damping=2e-3,
        outputs=["root_moment"],
        name=name,
    )


def parameters(gust=0.0):
    return np.array([AIRSPEED, PITCH, gust])


class Plant:
    """The finer wing with its actuators, in steps of 1 ms."""

    def __init__(self):
        self.model = wing_model("plant", **PLANT)
        functions = (cc.rk4_step(self.model, FINE), self.model.output)
        self.step, self.output = map(cc.compile_batch, functions)
        flutter = cc.flutter(self.model, SPEEDS, p={"pitch": PITCH})
        if flutter.speed is not None and flutter.speed < 1.1 * AIRSPEED:
            raise ValueError(f"AIRSPEED: expected well below flutter at {flutter.speed:.1f} m/s")
        self.trim = flutter.equilibria[list(SPEEDS).index(AIRSPEED)]

    def fly(self, control, flaps):
        """Times, moments, commands (2, T) and weights while `control` gives the input from t, x."""
        loop = cc.closed_loop(
            self.step,
            [self.trim],
            lambda t, states, applied: [control(t, states[0])],
            SAMPLE * np.arange(round(END / SAMPLE)),
            substeps=round(SAMPLE / FINE),
            actuators=cc.Actuators(lag=LAG, rate=flaps.rates),
            p=lambda t: parameters(float(GUST(t))),
            u=np.zeros(2),
            every=round(DT / SAMPLE),
        )
        x, u, p = loop.x[:, 0], loop.u[:, 0], loop.p[:, 0]
        moments = -self.output(x, u, p)[:, 1]  # they bend the root upward
        return loop.t, moments, u.T, x[:, self.model.x.slices["q"]].T


def lqr(plant, model, trim, flaps):
    """Discrete linear-quadratic regulator of the same weights, cut off at the limits."""
    linear = cc.linearize(model, trim, None, parameters())
    step = cc.step_function(model, DT, method="implicit_midpoint", newton=True)
    a, b = (block.full() for block in step.jacobian()(trim, [0, 0], parameters(), trim, 0)[:2])
    c, d = linear.C[1:2] @ a, linear.C[1:2] @ b + linear.D[1:2]
    q, s = MOMENT * c.T @ c + 1e-9 * np.eye(len(a)), MOMENT * c.T @ d
    r = MOMENT * d.T @ d + LQR_DEFLECTION * np.eye(2)
    p = solve_discrete_are(a, b, q, r, s=s)
    gain = np.linalg.solve(r + b.T @ p @ b, b.T @ p @ a + s.T)
    last = np.zeros(2)

    def control(t, x):
        nonlocal last
        u = -gain @ (cc.project_state(plant, x, model) - trim)
        u = np.clip(u, last - flaps.rates * DT, last + flaps.rates * DT)
        last = np.clip(u, -flaps.angles, flaps.angles)
        return last

    return control


def mpc(plant, model, trim, flaps, preview):
    """One real-time iteration every 50 ms."""
    names = [part.name for part in model.u.parts]
    controller = cc.Mpc(
        model,
        dt=DT,
        horizon=HORIZON,
        outputs={"root_moment": [0.0, MOMENT, 0.0]},
        inputs=dict.fromkeys(names, DEFLECTION),
        moves=dict.fromkeys(names, MOVE),
        bounds={k: (-most, most) for k, most in zip(names, flaps.angles, strict=True)},
        rate_bounds=dict(zip(names, flaps.rates, strict=True)),
    )
    moment = model.output(trim, [0, 0], parameters()).full().ravel()

    def control(t, x):
        middles = t + DT * (np.arange(HORIZON) + 0.5)
        gusts = [float(GUST(time)) for time in (middles if preview else np.full(HORIZON, t))]
        state = cc.project_state(plant, x, model)
        step = controller.step(
            state, parameters(), {"root_moment": moment}, {"gust": np.array(gusts)}
        )
        return step.u

    return control


def simulate():
    """Results of `Plant.fly` by set of flaps and controller."""
    plant, model = Plant(), wing_model("model", **MODEL)
    trim = cc.project_state(plant.model, plant.trim, model)
    found = {}
    for size, flaps in SETS.items():
        arguments = (plant.model, model, trim, flaps)
        controls = {
            "open loop": lambda: lambda t, x: np.zeros(2),
            "LQR": lambda a=arguments: lqr(*a),
            "MPC": lambda a=arguments: mpc(*a, preview=False),
            "MPC with preview": lambda a=arguments: mpc(*a, preview=True),
        }
        for name in CASES[size]:
            found[size, name] = plant.fly(controls[name](), flaps)
    return found


def peaks(found):
    """Largest increment of the root moment over that of the open loop, less 1."""
    largest = {key: (moment - moment[0]).max() for key, (_, moment, *_) in found.items()}
    return {
        (size, name): value / largest[size, "open loop"] - 1
        for (size, name), value in largest.items()
        if name != "open loop"
    }


def plot(found):
    figure = Figure(figsize=(8, 6), layout="constrained")
    axes = figure.subplots(2, 2, sharex=True, sharey="row")
    colours = dict(zip(CONTROLLERS, ("0.6", "tab:blue", "tab:orange", "black"), strict=True))
    for (size, name), (times, moments, deflections, _) in found.items():
        above, below = axes[:, list(SETS).index(size)]
        above.plot(times, moments - moments[0], color=colours[name], label=name)
        if name != "open loop":
            below.plot(times, np.degrees(deflections[1]), color=colours[name])
        above.set_title(size)
        below.set_xlabel("time [s]")
    axes[0, 0].set_ylabel("root moment, increment [N m]")
    axes[1, 0].set_ylabel("outer flap [°]")
    axes[0, 0].legend(frameon=False)
    return figure


def main(directory=Path("out"), animate=False):
    found = simulate()
    changes = peaks(found)
    for (size, name), change in changes.items():
        print(f"{size}, {name}: largest increment of the root moment {100 * change:+.0f} %")
    directory.mkdir(exist_ok=True)
    plot(found).savefig(directory / "gust_load_alleviation.png", dpi=150)
    if animate:
        times, _, _, weights = found["large flaps", "MPC with preview"]
        beam = hale_wing(*PLANT["weights"])
        animate_shape(beam, times, weights.T, directory / "gust_load_alleviation.gif")
    return changes


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--animate", action="store_true", help="write a GIF of the wing")
    main(animate=parser.parse_args().animate)
