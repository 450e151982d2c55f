"""Where on the wing should four sensors sit?

    max_A  log det(P⁻¹ + Σ_{i ∈ A} H_i) − log det P⁻¹,      A of 4 out of 40

with H_i the information of sensor i about the six weights of the HALE wing, mean over shapes around
that under 1 g, and P what is known without sensors. The candidates are 20 attitude sensors of 0.5°,
10 strain gauges at the rear or front of the spar, and 10 GNSS antennas near the leading edge.
Greedy, exact, and four attitude sensors evenly spaced.
"""

from pathlib import Path

import numpy as np

import curvcasadi as cc
from curvcasadi.plotting import plot_placement
from curvcasadi.reference_wings import hale_wing

PRIOR = 0.02  # rad/m, standard deviation of each weight from gust to gust


def candidates() -> list:
    attitudes = [cc.AttitudeSensor(xi=xi, noise=np.deg2rad(0.5)) for xi in np.linspace(0.05, 1, 20)]
    gauges = [
        cc.StrainGauge(name=f"{side}_gauge_{k}", xi=xi, offset=[y, 0.03], noise=2e-5)
        for k, xi in enumerate((0.02, 0.25, 0.45, 0.7, 0.9), start=1)
        for side, y in (("rear", -0.1), ("front", 0.1))
    ]
    antennas = [
        cc.Marker(xi=xi, offset=[0, 0.2, 0], noise=[0.05, 0.05, 0.1])
        for xi in np.linspace(0.1, 1, 10)
    ]
    return [*attitudes, *gauges, *antennas]


def main(directory: Path = Path("out")) -> dict[str, cc.Placement]:
    wing = hale_wing(torsion=2, out_of_plane=2, in_plane=2)
    level = cc.solve_equilibrium(wing, [cc.Gravity([0, 0, 9.81])]).q.full().ravel()
    shapes = np.random.default_rng(3).normal(level, PRIOR, size=(8, 6))
    options = {"shapes": shapes, "prior": PRIOR}
    sensors = candidates()
    found = {
        "greedy": cc.place_sensors(wing, sensors, 4, **options),
        "exact": cc.place_sensors(wing, sensors, 4, method="exact", **options),
        "evenly spaced": cc.place_sensors(wing, sensors[4:20:5], 4, **options),
    }
    for name in ("greedy", "exact"):
        print(f"{name}: {found[name]}\n")
    part = found["evenly spaced"].gain / found["exact"].gain
    print(
        f"four attitude sensors evenly spaced: gain {found['evenly spaced'].gain:.4g} nats, "
        f"{100 * part:.0f} % of the exact optimum"
    )

    directory.mkdir(exist_ok=True)
    plot_placement(wing, found["greedy"]).savefig(directory / "place_sensors.png", dpi=150)
    return found


if __name__ == "__main__":
    main()
