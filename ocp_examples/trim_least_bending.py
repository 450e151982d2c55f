"""Which flap schedule unloads the root of a flexible wing in level flight?

    min_{q, α, thrust, elevator, flaps}  Σ_wings M_y(root)²
    subject to  Σ wrenches = 0,   S q = Q,   climb = 0,   |flap| ≤ 8°

Four flaps along each half wing carry the weight further inboard, and the angle of attack follows.
"""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import curvcasadi as cc
from curvcasadi.reference_wings import RIGHT_WING_ROOT, hale_wing

FLAPS = tuple(
    cc.ControlSurface(name=f"flap_{k + 1}", lift=3.5, moment=-0.6, start=k / 4, end=(k + 1) / 4)
    for k in range(4)
)
LARGEST = np.radians(8)
FLIGHT = {"speed": 26.0, "density": 0.0889}  # m/s, kg/m³


def aircraft() -> cc.Aircraft:
    wing = cc.StripAerodynamics(
        chord=1.0, aerodynamic_center=0.25, lift_slope=2 * np.pi, profile_drag=0.01, controls=FLAPS
    )
    elevator = cc.ControlSurface(name="elevator", lift=3.0)
    tail = cc.StripAerodynamics(
        chord=0.5, aerodynamic_center=0.0, lift_slope=2 * np.pi, controls=(elevator,)
    )
    aft = cc.Pose(rotation=RIGHT_WING_ROOT.rotation, position=[-10, 0, 0])
    right = cc.Wing(name="right", beam=hale_wing(), strips=wing)
    return cc.Aircraft(
        body=cc.RigidBody(mass=50.0, center_of_mass=[0, 0, 0]),
        beams=(right, cc.mirror_wing(right, "left")),
        surfaces=(cc.LiftingSurface(name="tail", area=2.5, pose=aft, strips=tail),),
        thrusts=(cc.Thrust(),),
    )


def plot(cases: dict[str, cc.TrimResult]) -> Figure:
    figure = Figure(figsize=(6.4, 6.4), layout="constrained")
    lift, front = figure.subplots(2, 1)
    for label, result in cases.items():
        loads, positions = result.airloads["right"], result.shapes["right"].positions.full()
        (line,) = lift.plot(16 * loads.xi, loads.lift.full().ravel(), label=label)
        front.plot(positions[1], -positions[2], color=line.get_color(), label=label)
    lift.set(xlabel="arc length from the root [m]", ylabel="lift [N/m]")
    front.set(xlabel="y, to the right [m]", ylabel="height $-z$ [m]", aspect="equal")
    for axes in (lift, front):
        axes.grid(color="0.9")
        axes.legend(frameon=False)
    return figure


def main(directory: Path = Path("out")) -> dict[str, cc.TrimResult]:
    flexible, names = aircraft(), [flap.name for flap in FLAPS]
    clean = cc.trim(flexible, **FLIGHT, inputs=dict.fromkeys(names, 0.0))
    flapped = cc.trim(
        flexible,
        **FLIGHT,
        objective="root_bending",
        bounds={name: (-LARGEST, LARGEST) for name in names},
        guess=clean,
    )
    cases = {"flaps at zero": clean, "least root bending": flapped}
    for label, result in cases.items():
        flaps = ", ".join(f"{np.degrees(result.inputs[name]):+.1f}" for name in names)
        print(
            f"{label:20s} root bending {-result.root_loads['right'][1]:6.0f} N m, angle of attack "
            f"{np.degrees(result.angle_of_attack):5.2f} deg, flaps ({flaps}) deg, "
            f"strain energy {result.strain_energy:6.1f} J"
        )
    directory.mkdir(exist_ok=True)
    plot(cases).savefig(directory / "trim_least_bending.png", dpi=150)
    return cases


if __name__ == "__main__":
    main()
