"""How stiff must a wing be, and where, so that its tip rises by no more than 2 m?

    min_{EI_1, EI_2, EI_3}  mean EI_y   subject to   height(q*(EI)) ≤ 2 m,   S(EI) q* = Q(q*)

EI_y is constant on thirds of the span. The equilibrium q* under strip airloads and weight stands
inside the NLP, as a Function whose derivatives come from the implicit function theorem.
"""

from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np
from matplotlib.figure import Figure

import curvcasadi as cc
from curvcasadi.reference_wings import hale_wing

HEIGHT = 2.0  # m
EDGES = (0.0, 1 / 3, 2 / 3, 1.0)
STRIPS = cc.StripAerodynamics(chord=1.0, aerodynamic_center=0.25, lift_slope=2 * np.pi)
# 25 m/s at 20 km, the root 4° nose-up; body axes.
STREAM = 25 * np.array([np.cos(np.radians(4)), 0, np.sin(np.radians(4))])
LOADS = (
    cc.AerodynamicLoad(strips=STRIPS, flow=cc.Flow(density=0.0889, velocity=STREAM)),
    cc.Gravity([0, 0, 9.81]),
)


def wing(EI: list[ca.MX | float]) -> cc.Beam:
    section = cc.Section(GJ=1e4, EI_y=cc.Steps(EDGES, EI), EI_z=4e6, mass_per_length=0.75)
    return replace(hale_wing(out_of_plane=6), section=section, weight_bounds=None)


def design() -> tuple[ca.DM, ca.DM]:
    """Rigidities, N m², and the weights of the equilibrium."""
    EI = ca.MX.sym("EI", 3)
    flexible = wing([2e4 * x for x in ca.vertsplit(EI)])
    equilibrium = cc.equilibrium_function(flexible, LOADS, {"EI": EI})
    start = ca.DM([3, 3, 3])
    q = equilibrium(cc.solve_equilibrium(wing([6e4] * 3), LOADS).q, EI)
    height = -cc.tip_function(flexible)(q)[0][2]
    options = {
        "ipopt.hessian_approximation": "limited-memory",
        "ipopt.print_level": 0,
        "ipopt.sb": "yes",
        "print_time": False,
    }
    nlp = {"x": EI, "f": ca.sum1(EI) / 3, "g": height}
    solver = ca.nlpsol("design", "ipopt", nlp, options)
    best = solver(x0=start, lbx=0.2, ubx=20, lbg=-ca.inf, ubg=HEIGHT)["x"]
    return 2e4 * best, ca.Function("q", [EI], [q])(best)


def plot(shapes: dict[str, tuple[cc.Beam, ca.DM]]) -> Figure:
    figure = Figure(figsize=(6.4, 3.6), layout="constrained")
    axes = figure.subplots()
    for label, (beam, q) in shapes.items():
        _, y, z = cc.shape_map(beam, q).positions.full()
        axes.plot(y, -z, label=label)
    axes.axhline(HEIGHT, color="tab:red", ls="--", lw=1, label="allowed height")
    axes.set(xlabel="y, to the right [m]", ylabel="height $-z$ [m]")
    axes.grid(color="0.9")
    axes.legend(frameon=False)
    return figure


def main(directory: Path = Path("out")) -> tuple[ca.DM, float, float]:
    EI, q = design()
    best = wing(ca.vertsplit(EI))
    height = -float(cc.shape_map(best, q).tip.position[2])
    mean = float(ca.sum1(EI)) / 3
    uniform = wing([mean] * 3)
    q_uniform = cc.solve_equilibrium(uniform, LOADS).q
    uniform_height = -float(cc.shape_map(uniform, q_uniform).tip.position[2])
    print("EI_y of the thirds: " + ", ".join(f"{x:.0f}" for x in EI.full().ravel()) + " N m²")
    print(f"tip height {height:.4f} m; with the same mean EI_y everywhere {uniform_height:.4f} m")
    directory.mkdir(exist_ok=True)
    shapes = {"best thirds": (best, q), "uniform, same mean": (uniform, q_uniform)}
    plot(shapes).savefig(directory / "design_stiffness.png", dpi=150)
    return EI, height, uniform_height


if __name__ == "__main__":
    main()
