"""Which gust, at which speed, bends a wing most, and what does the envelope of all gusts look like?

    w(t) = ½ W (1 − cos(2 π t V/H)),   W = 2 m/s,   for 12 lengths H at 10 speeds V

All gusts run at once: each is a lane of a vector register. Every case starts in steady flow.
"""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import curvcasadi as cc
from curvcasadi.reference_wings import hale_wing

SPEEDS, LENGTHS = np.linspace(16, 26, 10), np.linspace(5, 115, 12)  # m/s, m
AMPLITUDE, DENSITY, PITCH = 2.0, 0.0889, 0.05  # m/s, kg/m³, rad
SETTLING, GUST, STEP = 8.0, 6.0, 0.005  # s


def model() -> cc.ControlModel:
    strips = cc.StripAerodynamics(chord=1.0, aerodynamic_center=0.25, lift_slope=2 * np.pi)
    wing = cc.Wing(name="wing", beam=hale_wing(1, 3, 1, grid=cc.Grid.lobatto(6)), strips=strips)
    lag, entry = cc.IndicialLag(poles=2, modes=2), cc.GustEntry(kind="lag", modes=2)
    return cc.wing_model(wing, density=DENSITY, lag=lag, gust=entry, damping=0.02,
                         outputs=("tip_position", "root_moment"))  # fmt: skip


def envelope(wing: cc.ControlModel) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times, moment that bends the root upward (times, cases), cases (speed, length)."""
    step, output = cc.compile_batch(cc.rk4_step(wing, STEP)), cc.compile_batch(wing.output)
    cases = np.array([(v, h) for v in SPEEDS for h in LENGTHS])
    speed, length = cases.T
    parts = {"airspeed": speed, "pitch": np.full(len(cases), PITCH), "gust": np.zeros(len(cases))}
    p = np.stack([parts[part.name] for part in wing.p.parts], axis=1)
    gust, bending = wing.p.slices["gust"].start, wing.y.slices["root_moment"].start + 1
    x, none = np.zeros((len(cases), wing.x.size)), np.zeros(0)
    times = np.arange(-SETTLING, GUST, STEP)
    moments = []
    for t in times:
        phase = t * speed / length
        inside = (phase >= 0) & (phase <= 1)
        p[:, gust] = np.where(inside, AMPLITUDE / 2 * (1 - np.cos(2 * np.pi * phase)), 0)
        step(x, none, p, out=[x])
        if t >= 0:
            moments.append(-output(x, none, p)[:, bending])
    return times[times >= 0], np.array(moments), cases


def plot(times: np.ndarray, moments: np.ndarray, cases: np.ndarray) -> Figure:
    figure = Figure(figsize=(9, 3.6), layout="constrained")
    left, right = figure.subplots(1, 2)
    worst = int(np.abs(moments).max(axis=0).argmax())
    left.fill_between(times, moments.min(axis=1) / 1e3, moments.max(axis=1) / 1e3, color="0.85",
                      label=f"all {len(cases)} cases")  # fmt: skip
    label = f"worst: {cases[worst, 0]:.0f} m/s, {cases[worst, 1]:.0f} m"
    left.plot(times, moments[:, worst] / 1e3, color="C3", lw=1.3, label=label)
    left.set(xlabel="time [s]", ylabel="moment at the root, upward [kN m]", xlim=(0, times[-1]))
    left.legend(loc="lower center", bbox_to_anchor=(0.5, 1), ncols=2, frameon=False)
    largest = np.abs(moments).max(axis=0).reshape(len(SPEEDS), len(LENGTHS)) / 1e3
    filled = right.contourf(LENGTHS, SPEEDS, largest, levels=12, cmap="viridis")
    figure.colorbar(filled, ax=right, label="largest moment [kN m]")
    right.plot(cases[worst, 1], cases[worst, 0], "o", color="C3")
    right.set(xlabel="length of the gust [m]", ylabel="airspeed [m/s]")
    return figure


def main(directory: Path = Path("out")) -> np.ndarray:
    times, moments, cases = envelope(model())
    worst = int(np.abs(moments).max(axis=0).argmax())
    print(f"{len(cases)} gusts of {AMPLITUDE:g} m/s, {GUST:g} s each")
    print(f"worst: {cases[worst, 1]:.0f} m long at {cases[worst, 0]:.0f} m/s, "
          f"{np.abs(moments[:, worst]).max():.0f} N m at the root")  # fmt: skip
    directory.mkdir(parents=True, exist_ok=True)
    cc.save_figure(plot(times, moments, cases), directory / "gust_load_envelope.png")
    return np.abs(moments).max(axis=0).reshape(len(SPEEDS), len(LENGTHS))


if __name__ == "__main__":
    main()
