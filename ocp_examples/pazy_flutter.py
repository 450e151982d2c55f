"""At what speeds does the Pazy wing flutter when its root angle bends it, and where does it stop?

    Re λ(V, angle) = 0

The benchmark wing of Technion, read from a wing file, has a hump mode, which grows between an onset
and an offset. Both fall by some 40 % as the wing bends. The lift slope falls to zero at the tip, as
in the strips of C. Riso and C.E.S. Cesnik, 2023, whose onsets and offsets are the points.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import curvcasadi as cc

FILE = Path(__file__).with_name("pazy_wing.toml")
DENSITY = 1.225  # kg/m³
SPEEDS = np.arange(30.0, 82.0, 2.0)  # m/s
ANGLES = (1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0)  # degrees
#: Of the strips, over the span: lift slope, 1/rad.
XI = (0.0, 0.14, 0.28, 0.42, 0.56, 0.63, 0.7, 0.765, 0.835, 0.87, 0.904, 0.935, 0.965, 0.983, 1.0)
SLOPE = (5.606, 5.590, 5.542, 5.447, 5.277, 5.145, 4.961, 4.696, 4.290, 3.998, 3.615, 3.145, 2.458)
SLOPE = (*SLOPE, 2.060, 0.0)
#: Degrees, onset and offset, m/s.
UM_NAST = (
    (1, 65.93, 72.60),
    (2, 56.50, 62.13),
    (3, 50.58, 55.35),
    (4, 46.37, 50.45),
    (5, 43.14, 46.70),
    (6, 40.58, 43.68),
    (7, 38.49, 41.19),
)


def model() -> cc.ControlModel:
    file = cc.load_wing(FILE)
    strips = replace(file.strips, lift_slope=lambda xi: float(np.interp(xi, XI, SLOPE)), stations=8)
    wing = cc.Wing(name="pazy", beam=file.beam, strips=strips)
    return cc.wing_model(wing, density=DENSITY, gravity=0.0, outputs=("tip_position",))


def offset(flying: cc.ControlModel, onset: float, pitch: float) -> float:
    """Speed at which the oscillation stops growing, to the steps of a fine sweep."""
    fine = cc.flutter(flying, np.linspace(0.99, 1.18, 39) * onset, p={"pitch": pitch})
    moving = fine.roots.imag > 1e-6 * np.abs(fine.roots)
    growth = np.where(moving, fine.roots.real / np.abs(fine.roots), -1.0).max(axis=1)
    last = np.flatnonzero(growth > 1e-5)[-1]
    return float(fine.speeds[last : last + 2].mean())


def plot(limits: np.ndarray, tips: list[float]) -> Figure:
    figure = Figure(figsize=(6.4, 6.4), layout="constrained")
    by_angle, by_tip = figure.subplots(2, 1)
    reference = np.array(UM_NAST)
    names = ("onset", "offset")
    for k, (name, color) in enumerate(zip(names, ("tab:blue", "tab:orange"), strict=True)):
        by_angle.plot(ANGLES, limits[:, k], color=color, label=name)
        by_angle.plot(reference[:, 0], reference[:, 1 + k], "o", color=color, mfc="white")
        by_tip.plot(tips, limits[:, k], color=color, label=name)
    by_angle.plot([], [], "o", color="black", mfc="white", label="UM/NAST, Riso and Cesnik 2023")
    by_angle.set(xlabel="root angle [deg]", ylabel="airspeed [m/s]")
    by_tip.set(xlabel="deflection of the tip at onset [% of semispan]", ylabel="airspeed [m/s]")
    for axes in (by_angle, by_tip):
        axes.grid(color="0.9")
        axes.legend(frameon=False)
    return figure


def main(out: Path = Path("out")) -> np.ndarray:
    flying = model()
    semispan = float(cc.load_wing(FILE).beam.length)
    limits, tips = [], []
    for angle in ANGLES:
        pitch = np.radians(angle)
        found = cc.flutter(flying, SPEEDS, p={"pitch": pitch})
        tip = flying.output(found.equilibrium, [], [found.speed, pitch])
        limits.append((found.speed, offset(flying, found.speed, pitch)))
        tips.append(-100 * float(tip[2]) / semispan)
        print(
            f"root angle {angle:g} deg: flutter from {found.speed:.2f} to {limits[-1][1]:.1f} m/s, "
            f"{found.frequency / (2 * np.pi):.1f} Hz, with the tip at {tips[-1]:.0f} % of semispan"
        )
    out.mkdir(exist_ok=True)
    plot(np.array(limits), tips).savefig(out / "pazy_flutter.png", dpi=150)
    return np.array(limits)


if __name__ == "__main__":
    main()
