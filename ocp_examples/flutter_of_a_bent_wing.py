"""At what speed does a very flexible wing flutter, and what does its bending change?

    r(q, lag; V, pitch) = 0,   (λ I − A(V)) mode = 0,   Re λ = 0

The HALE wing at 20 km, clamped at root angles from 0.75° to 4.5° under its weight: the more it
bends, the more torsion and in-plane bending couple, and the lower is the speed of flutter. The
straight wing without weight flutters at 32.5 m/s.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import curvcasadi as cc
from curvcasadi.plotting import plot_flutter
from curvcasadi.reference_wings import hale_wing

DENSITY = 0.0889  # kg/m³, at 20 km
SPEEDS = np.arange(10.0, 36.0, 1.0)  # m/s
ANGLES = (0.75, 1.0, 1.5, 2.0, 3.0, 4.5)  # degrees
#: Of Patil, Hodges and Cesnik, J. Aircraft 38(1), 2001, digitised: degrees, m/s.
PATIL = ((0.8055, 29.361), (1.5422, 26.061), (2.2004, 24.067), (2.9077, 22.485), (3.6248, 21.179))


def wing() -> cc.Wing:
    beam = hale_wing(4, 4, 3)
    section = cc.Section(
        GJ=1e4, EI_y=2e4, EI_z=4e6, mass_per_length=0.75, inertia=np.diag([0.1, 5e-4, 0.0995])
    )
    beam = replace(beam, section=section, grid=cc.Grid.lobatto(8), weight_bounds=None)
    strips = cc.StripAerodynamics(chord=1.0, aerodynamic_center=0.25, lift_slope=2 * np.pi)
    return cc.Wing(name="right", beam=beam, strips=strips)


def plot(tips: list[float], found: list[cc.Flutter], straight: cc.Flutter) -> Figure:
    figure = Figure(figsize=(6.4, 6.4), layout="constrained")
    by_angle, by_tip = figure.subplots(2, 1)
    speeds = [result.speed for result in found]
    by_angle.plot(ANGLES, speeds, color="black", label="curvcasadi")
    by_angle.plot(*np.transpose(PATIL), "o", mfc="white", label="Patil, Hodges and Cesnik, 2001")
    by_angle.set(xlabel="root angle [deg]", ylabel="flutter speed [m/s]")
    by_angle.legend(frameon=False)
    by_tip.plot([0.0, *tips], [straight.speed, *speeds], "o-", color="black", mfc="white")
    by_tip.set(xlabel="height of the tip at flutter [m]", ylabel="flutter speed [m/s]")
    for axes in (by_angle, by_tip):
        axes.grid(color="0.9")
    return figure


def main(out: Path = Path("out")) -> list[cc.Flutter]:
    flying = cc.wing_model(wing(), density=DENSITY, outputs=("tip_position",))
    found, tips = [], []
    for angle in ANGLES:
        pitch = np.radians(angle)
        result = cc.flutter(flying, SPEEDS, p={"pitch": pitch})
        tip = flying.output(result.equilibrium, [], [result.speed, pitch])
        found.append(result)
        tips.append(-float(tip[2]))
        print(
            f"root angle {angle:4.2f} deg: flutter at {result.speed:.2f} m/s and "
            f"{result.frequency:.2f} rad/s with the tip at {tips[-1]:.2f} m"
        )
    weightless = cc.wing_model(wing(), density=DENSITY, gravity=0.0, outputs=())
    straight = cc.flutter(weightless, np.arange(15.0, 41.0), p={"pitch": 0.0})
    print(straight)

    out.mkdir(exist_ok=True)
    plot(tips, found, straight).savefig(out / "flutter_of_a_bent_wing.png", dpi=150)
    plot_flutter(straight).savefig(out / "flutter_of_the_straight_wing.png", dpi=150)
    return [straight, *found]


if __name__ == "__main__":
    main()
