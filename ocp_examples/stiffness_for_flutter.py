"""Where must a wing be stiffened to flutter 3 m/s later, at the least mass?

    min_{GJ, EI}  mass   subject to   V_flutter(GJ, EI) ≥ V_0 + 3 m/s

GJ and EI_y of the inner and the outer half of the HALE wing, which flies at 20 km with its root 2°
nose-up, bent by lift and weight. The flutter speed stands in the NLP as a Function; its Jacobian
is exact, the moving equilibrium included. Stiffness costs mass: a quarter of the wing is its
bending material, a quarter its torsional one.
"""

from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np
from matplotlib.figure import Figure

import curvcasadi as cc
from curvcasadi.reference_wings import hale_wing

DENSITY = 0.0889  # kg/m³, at 20 km
PITCH = np.radians(2.0)
LATER = 3.0  # m/s
SPEEDS = np.arange(15.0, 43.0, 3.0)  # m/s
DRAWN = np.arange(15.0, 42.0, 0.75)  # m/s
NOMINAL = np.ones(4)  # GJ inner, outer, EI_y inner, outer, over 1e4 and 2e4 N m²
EDGES = (0.0, 0.5, 1.0)


def masses(design: ca.MX) -> list[ca.MX]:
    """Mass per length of the halves, kg/m."""
    return [0.75 * (0.5 + 0.25 * design[k] + 0.25 * design[2 + k]) for k in range(2)]


def model() -> cc.ControlModel:
    design = ca.MX.sym("design", 4)
    section = cc.Section(
        GJ=cc.Steps(EDGES, [1e4 * design[0], 1e4 * design[1]]),
        EI_y=cc.Steps(EDGES, [2e4 * design[2], 2e4 * design[3]]),
        EI_z=4e6,
        mass_per_length=cc.Steps(EDGES, masses(design)),
        inertia=np.diag([0.1, 5e-4, 0.0995]),
    )
    beam = replace(hale_wing(3, 3, 2), section=section, grid=cc.Grid.lobatto(6), weight_bounds=None)
    strips = cc.StripAerodynamics(chord=1.0, aerodynamic_center=0.25, lift_slope=2 * np.pi)
    wing = cc.Wing(name="right", beam=beam, strips=strips)
    lag = cc.IndicialLag(poles=2, modes=3)
    return cc.wing_model(
        wing, density=DENSITY, lag=lag, parameters={"design": design}, outputs=("tip_position",)
    )


def sweep(flying: cc.ControlModel, design: np.ndarray, speeds: np.ndarray = SPEEDS) -> cc.Flutter:
    return cc.flutter(flying, speeds, p={"pitch": PITCH, "design": design})


def plot(designs: dict[str, cc.Flutter]) -> Figure:
    figure = Figure(figsize=(6.4, 3.6), layout="constrained")
    axes = figure.subplots()
    for label, found in designs.items():
        moving = found.roots.imag > 1e-6 * np.abs(found.roots)
        growth = np.where(moving, 2 * found.roots.real / np.abs(found.roots), -1.0).max(axis=1)
        axes.plot(found.speeds, growth, label=label)
        axes.plot(found.speed, 0, "o", color="black")
    axes.axhline(0, color="black", lw=0.8)
    axes.set(xlabel="airspeed [m/s]", ylabel=r"growth $2\,\mathrm{Re}\,\lambda/|\lambda|$ [-]")
    axes.grid(color="0.9")
    axes.legend(frameon=False)
    return figure


def main(out: Path = Path("out")) -> tuple[np.ndarray, float, float]:
    flying = model()
    start = sweep(flying, NOMINAL)
    required = start.speed + LATER
    speed = cc.flutter_speed_function(flying, ["design"], SPEEDS, p={"pitch": PITCH})
    design = ca.MX.sym("design", 4)
    mass = 8.0 * sum(masses(design))  # kg, two halves of 8 m
    options = {
        "ipopt.hessian_approximation": "limited-memory",
        "ipopt.tol": 1e-6,
        "ipopt.print_level": 0,
        "ipopt.sb": "yes",
        "print_time": False,
    }
    nlp = {"x": design, "f": mass, "g": speed(design)}
    solver = ca.nlpsol("stiffen", "ipopt", nlp, options)
    best = solver(x0=NOMINAL, lbx=0.5, ubx=5, lbg=required, ubg=ca.inf)["x"].full().ravel()
    found = sweep(flying, best)
    weigh = ca.Function("mass", [design], [mass])
    before, after = float(weigh(NOMINAL)), float(weigh(best))
    slopes = cc.flutter_derivatives(start, ["design"])["design"]
    print("V_flutter by each share at the start: " + ", ".join(f"{x:.2f}" for x in slopes) + " m/s")
    print(f"GJ of the halves {1e4 * best[0]:.0f}, {1e4 * best[1]:.0f} N m²")
    print(f"EI_y of the halves {2e4 * best[2]:.0f}, {2e4 * best[3]:.0f} N m²")
    print(
        f"flutter at {found.speed:.3f} m/s instead of {start.speed:.3f}, "
        f"mass {after:.3f} kg instead of {before:.3f}"
    )
    out.mkdir(exist_ok=True)
    designs = {"as it is": NOMINAL, "stiffened": best}
    figure = plot({label: sweep(flying, x, DRAWN) for label, x in designs.items()})
    figure.savefig(out / "stiffness_for_flutter.png", dpi=150)
    return best, found.speed - required, after - before


if __name__ == "__main__":
    main()
