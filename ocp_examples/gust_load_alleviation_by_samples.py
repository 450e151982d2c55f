"""Can a controller that samples motions, without derivatives, relieve a gust as well as `cc.Mpc`?

    u ← Σ_j w_j u_j,   w_j ~ exp(−(J_j − min J)/λ),   u_j = u + noise within the limits
    J = ½ Σ_k (M_k − M_trim)²/50² + 0.02 |u_k|² + 0.05 |u_k − u_{k−1}|²

Model predictive path integral control: the motions of all samples are one batch in single
precision, each a lane of a vector register. Both controllers know the gust, and the model is the
plant.
"""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import curvcasadi as cc
from curvcasadi.reference_wings import hale_wing

AIRSPEED, PITCH, DENSITY = 20.0, np.radians(3.0), 0.0889
GUST = cc.OneMinusCosine(amplitude=2.0, duration=1.0, start=0.25)
DT, HORIZON, END, SUBSTEPS = 0.05, 16, 2.0, 5  # s
MOMENT, DEFLECTION, MOVE, LIMIT = 1 / 50**2, 0.02, 0.05, np.radians(15)
SAMPLES, NOISE, TEMPERATURE = 128, 0.08, 0.05  # rad, and of J


def wing_model() -> cc.ControlModel:
    flaps = tuple(
        cc.ControlSurface(name=name, start=start, end=end, lift=3.5, moment=-0.6)
        for name, start, end in (("inner", 0.2, 0.6), ("outer", 0.6, 0.95))
    )
    strips = cc.StripAerodynamics(
        chord=1.0, aerodynamic_center=0.25, lift_slope=2 * np.pi, controls=flaps, stations=8
    )
    return cc.wing_model(
        cc.Wing(name="right", beam=hale_wing(1, 3, 1, grid=cc.Grid.lobatto(6)), strips=strips),
        density=DENSITY,
        lag=cc.IndicialLag(poles=2, modes=2),
        gust=cc.GustEntry(kind="lag", modes=2),
        damping=2e-3,
        outputs=["root_moment"],
    )


def parameters(gust: float = 0.0) -> np.ndarray:
    return np.array([AIRSPEED, PITCH, gust])


def gusts(time: float) -> np.ndarray:
    """The gust in the middle of each stage from `time` on."""
    return np.array([float(GUST(time + DT * (k + 0.5))) for k in range(HORIZON)])


class Sampler:
    """A plan of inputs (HORIZON, 2), and the batch that improves it."""

    def __init__(self, model: cc.ControlModel, moment: float) -> None:
        self.step = cc.compile_batch(cc.rk4_step(model, DT, substeps=SUBSTEPS), "float")
        self.output = cc.compile_batch(model.output, "float")
        self.moment, self.rng = moment, np.random.default_rng(0)
        self.plan, self.last = np.zeros((HORIZON, 2)), np.zeros(2)

    def cost(self, x: np.ndarray, inputs: np.ndarray, gust: np.ndarray) -> np.ndarray:
        """J of each sample, whose inputs are (HORIZON, SAMPLES, 2)."""
        state = np.tile(x, (SAMPLES, 1)).astype(np.float32)
        before, cost = np.tile(self.last, (SAMPLES, 1)), np.zeros(SAMPLES)
        for u, w in zip(inputs, gust, strict=True):
            self.step(state, u, parameters(w), out=[state])
            moment = self.output(state, u, parameters(w))[:, 1] - self.moment
            effort = DEFLECTION * (u**2).sum(axis=1) + MOVE * ((u - before) ** 2).sum(axis=1)
            cost += MOMENT * moment**2 + effort
            before = u
        return cost / 2

    def __call__(self, x: np.ndarray, time: float) -> np.ndarray:
        self.plan = np.vstack([self.plan[1:], self.plan[-1:]])
        for spread in (NOISE, NOISE / 2):
            noise = self.rng.normal(scale=spread, size=(HORIZON, SAMPLES, 2)).cumsum(axis=0)
            noise /= np.sqrt(1 + np.arange(HORIZON))[:, None, None]
            noise[:, 0] = 0
            inputs = np.clip(self.plan[:, None] + noise, -LIMIT, LIMIT)
            cost = self.cost(x, inputs, gusts(time))
            weights = np.exp(-(cost - cost.min()) / TEMPERATURE)
            self.plan = np.einsum("ksi,s->ki", inputs, weights / weights.sum())
        self.last = self.plan[0]
        return self.last


def derivative_based(model: cc.ControlModel, moment: np.ndarray):
    names = [part.name for part in model.u.parts]
    controller = cc.Mpc(
        model,
        dt=DT,
        horizon=HORIZON,
        outputs={"root_moment": [0.0, MOMENT, 0.0]},
        inputs=dict.fromkeys(names, DEFLECTION),
        moves=dict.fromkeys(names, MOVE),
        bounds={name: (-LIMIT, LIMIT) for name in names},
    )
    reference = {"root_moment": moment}
    return lambda x, t: controller.step(x, parameters(), reference, {"gust": gusts(t)}).u


def fly(model: cc.ControlModel, x: np.ndarray, control) -> tuple[np.ndarray, np.ndarray]:
    """Moments that bend the root upward (T,), N m, and inputs (T, 2), rad."""
    step = cc.compile_function(cc.rk4_step(model, DT, substeps=SUBSTEPS), derivatives=0)
    moments, inputs = [], []
    for t in DT * np.arange(round(END / DT)):
        u = np.asarray(control(x, t)).ravel()
        p = parameters(float(GUST(t + DT / 2)))
        moments.append(-float(model.output(x, u, p)[1]))
        inputs.append(u)
        x = step(x, u, p).full().ravel()
    return np.array(moments), np.array(inputs)


def plot(found: dict[str, tuple[np.ndarray, np.ndarray]]) -> Figure:
    figure = Figure(figsize=(6.4, 5), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True)
    colours = dict(zip(found, ("0.6", "black", "tab:red"), strict=True))
    for name, (moments, inputs) in found.items():
        times = DT * np.arange(len(moments))
        above.plot(times, moments - moments[0], color=colours[name], label=name)
        if name != "open loop":
            below.plot(times, np.degrees(inputs[:, 1]), color=colours[name])
    above.set(ylabel="root moment, increment [N m]")
    above.legend(frameon=False)
    below.set(xlabel="time [s]", ylabel="outer flap [°]", xlim=(0, END - DT))
    return figure


def main(directory: Path = Path("out")) -> dict[str, float]:
    model = wing_model()
    calm = {"airspeed": AIRSPEED, "pitch": PITCH}
    trim = cc.simulate(model, np.zeros(model.x.size), [0, 15.0], p=calm,
                       method="implicit_midpoint", dt=0.02).x[:, -1]  # fmt: skip
    moment = model.output(trim, [0, 0], parameters()).full().ravel()
    controls = {
        "open loop": lambda x, t: np.zeros(2),
        "cc.Mpc": derivative_based(model, moment),
        f"{SAMPLES} samples": Sampler(model, moment[1]),
    }
    found = {name: fly(model, trim, control) for name, control in controls.items()}
    peaks = {name: float((m - m[0]).max()) for name, (m, _) in found.items()}
    for name, peak in peaks.items():
        print(f"{name}: largest increment of the root moment {peak:.0f} N m")
    directory.mkdir(parents=True, exist_ok=True)
    name = "gust_load_alleviation_by_samples.png"
    cc.save_figure(plot(found), directory / name)
    return peaks


if __name__ == "__main__":
    main()
