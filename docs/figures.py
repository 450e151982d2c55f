"""Draws the pictures of the README: `make figures`."""

import math
from pathlib import Path

import matplotlib

import curvcasadi as cc
from curvcasadi.reference_wings import hale_wing

FOLDER = Path(__file__).parent


def main() -> None:
    matplotlib.rcParams["svg.hashsalt"] = "curvcasadi"  # the same bytes at every run
    wing = hale_wing()
    strips = cc.StripAerodynamics(chord=1.0, aerodynamic_center=0.25, lift_slope=2 * math.pi)
    loads = [cc.DistributedForce((0, 0, -20), frame="dead")]
    shape = cc.solve_equilibrium(wing, loads)
    figure = cc.plot_shape(
        wing,
        shape.q,
        strips=strips,
        loads=loads,
        local_axes=False,
        title="a wing of 16 m half span under 20 N/m",
        camera=(45, -160),
    )
    figure.savefig(FOLDER / "wing.svg", metadata={"Date": None})


if __name__ == "__main__":
    main()
