"""How does a wing move when the weight that hangs from its tip is cut off, and is energy kept?

    M(q) q̈ + bias(q, q̇) + S q = Q(weight),   q(0) from S q = Q(weight, load),   q̇(0) = 0
    T(q, q̇) + V(q) = constant

V is the strain energy and the potential of gravity. There is no damping: what changes of T + V is
the error of the integrator, the implicit midpoint rule with steps of 5 ms.
"""

from pathlib import Path

import casadi as ca
import numpy as np
from matplotlib.figure import Figure

import curvcasadi as cc
from curvcasadi.reference_wings import hale_wing

WEIGHT = cc.Gravity([0, 0, 9.81])  # body axes: z is down
LOAD = cc.PointForce(1.0, [0, 0, 80.0])  # N
DURATION, STEP = 6.0, 0.005
COLORS = {"kinetic": "C0", "strain": "C1", "weight": "C2", "sum": "black"}


def energies(wing: cc.Beam, motion: cc.Simulation) -> dict[str, np.ndarray]:
    """Energy of each sample, J: kinetic, of the strain, of the weight, and their sum."""
    q, q_dot = ca.MX.sym("q", wing.basis.n), ca.MX.sym("q_dot", wing.basis.n)
    strain = cc.strain_energy(wing, q)
    height = cc.potential_energy(wing, q, [WEIGHT]) - strain
    parts = [cc.kinetic_energy(wing, q, q_dot), strain, height]
    f = ca.Function("energies", [q, q_dot], parts).map(len(motion.t))
    values = [x.full().ravel() for x in f(motion.part("q"), motion.part("q_dot"))]
    return dict(zip(COLORS, [*values, sum(values)], strict=True))


def plot(motion: cc.Simulation, energy: dict[str, np.ndarray], rest: float) -> Figure:
    figure = Figure(figsize=(6.4, 5.4), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True)
    above.plot(motion.t, -motion.part("position")[2], color="black", lw=1.2, label="tip")
    above.axhline(rest, color="0.6", ls="--", lw=1, label="at rest without the load")
    above.set(ylabel="height $-z$ [m]")
    for name, values in energy.items():
        below.plot(motion.t, values, color=COLORS[name], lw=1.2, label=name)
    below.set(xlabel="time [s]", ylabel="energy [J]", xlim=(0, motion.t[-1]))
    for axes in (above, below):
        axes.grid(color="0.9")
        axes.legend(loc="center left", bbox_to_anchor=(1, 0.5), frameon=False)
    return figure


def main(directory: Path = Path("out")) -> tuple[float, float]:
    wing = hale_wing()
    start = cc.solve_equilibrium(wing, [WEIGHT, LOAD]).q
    rest = -float(cc.solve_equilibrium(wing, [WEIGHT]).shape.tip.position[2])
    model = cc.beam_model(wing, [WEIGHT], outputs=["position"])
    times = np.linspace(0, DURATION, 1 + round(50 * DURATION))
    motion = cc.simulate(
        model, {"q": start.full().ravel()}, times, method="implicit_midpoint", dt=STEP
    )
    energy = energies(wing, motion)
    height = -motion.part("position")[2]
    change = float(np.ptp(energy["sum"]) / energy["kinetic"].max())
    print(f"{motion}; {motion.iterations:.2f} iterations a step")
    print(f"the tip swings from {height.min():.2f} m to {height.max():.2f} m")
    print(f"the energy changes by {change:.1e} of the largest kinetic energy")
    directory.mkdir(exist_ok=True)
    plot(motion, energy, rest).savefig(directory / "release_under_load.png", dpi=150)
    cc.animate_shape(
        wing, None, motion, directory / "release_under_load.gif", local_axes=False, progress=False
    )
    return change, float(height.max())


if __name__ == "__main__":
    main()
