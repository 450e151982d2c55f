"""How does a very flexible aircraft fly level, and what does its flexibility change?

    Σ wrenches(q, α, thrust, elevator) = 0,   S q = Q(q, α),   climb = 0

The HALE wing on a 50 kg payload with a tail 10 m aft, at 20 km and from 24 to 34 m/s; and the same
aircraft with a wing a hundred times as stiff.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import curvcasadi as cc
from curvcasadi.reference_wings import RIGHT_WING_ROOT, hale_wing

DENSITY = 0.0889  # kg/m³, at 20 km
SPEEDS = np.arange(24.0, 35.0, 2.0)  # m/s


def aircraft(stiffness: float = 1.0) -> cc.Aircraft:
    beam = hale_wing()
    section = cc.Section(
        GJ=1e4 * stiffness, EI_y=2e4 * stiffness, EI_z=4e6 * stiffness, mass_per_length=0.75
    )
    wing = cc.StripAerodynamics(
        chord=1.0, aerodynamic_center=0.25, lift_slope=2 * np.pi, profile_drag=0.01
    )
    elevator = cc.ControlSurface(name="elevator", lift=3.0)
    tail = cc.StripAerodynamics(
        chord=0.5,
        aerodynamic_center=0.0,
        lift_slope=2 * np.pi,
        profile_drag=0.01,
        controls=(elevator,),
    )
    aft = cc.Pose(rotation=RIGHT_WING_ROOT.rotation, position=[-10, 0, 0])
    right = cc.Wing(name="right", beam=replace(beam, section=section), strips=wing)
    return cc.Aircraft(
        body=cc.RigidBody(mass=50.0, center_of_mass=[0, 0, 0]),
        beams=(right, cc.mirror_wing(right, "left")),
        surfaces=(cc.LiftingSurface(name="tail", area=2.5, pose=aft, strips=tail),),
        thrusts=(cc.Thrust(),),
    )


def plot(flexible: list[cc.TrimResult], stiff: list[cc.TrimResult]) -> Figure:
    figure = Figure(figsize=(6.4, 7.2), layout="constrained")
    front, angle = figure.subplots(2, 1)
    for results, style, label in ((flexible, "black", "flexible"), (stiff, "tab:blue", "stiff")):
        result = results[0]
        for name, shape in result.shapes.items():
            y, z = shape.positions.full()[1:]
            front.plot(y, -z, color=style, label=label if name == "right" else None)
        angles = [np.degrees(r.angle_of_attack) for r in results]
        angle.plot(SPEEDS, angles, "o-", color=style, label=label)
    front.set(xlabel="y, to the right [m]", ylabel="height $-z$ [m]", aspect="equal")
    front.set_title(f"from behind, at {SPEEDS[0]:g} m/s", fontsize="medium")
    angle.set(xlabel="speed [m/s]", ylabel="angle of attack [deg]")
    for axes in (front, angle):
        axes.grid(color="0.9")
        axes.legend(frameon=False)
    return figure


def main(directory: Path = Path("out")) -> list[list[cc.TrimResult]]:
    results = []
    for label, stiffness in (("flexible", 1.0), ("stiff", 100.0)):
        print(f"{label} wing")
        results.append(cc.trim_sweep(aircraft(stiffness), SPEEDS, density=DENSITY))
        print(cc.trim_table(results[-1]))
    directory.mkdir(exist_ok=True)
    plot(*results).savefig(directory / "trim_level_flight.png", dpi=150)
    return results


if __name__ == "__main__":
    main()
