"""Draws the pictures of the README: `make figures`."""

from pathlib import Path

import casadi as ca
import matplotlib

from curvcasadi.plotting import plot_shape
from curvcasadi.reference_wings import hale_wing

FOLDER = Path(__file__).parent


def main() -> None:
    matplotlib.rcParams["svg.hashsalt"] = "curvcasadi"  # the same bytes at every run
    bent = ca.DM([0.02, 0, 0, -0.06, 0.02, 0, 0, 0, 0])
    figure = plot_shape(hale_wing(), bent)
    figure.savefig(FOLDER / "wing.svg", metadata={"Date": None})


if __name__ == "__main__":
    main()
