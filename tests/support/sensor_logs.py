"""Logs of sensors on a wing that flaps, as CSV, for tests of the command `estimate`."""

from __future__ import annotations

import casadi as ca
import numpy as np

from curvcasadi.files.estimation import load_estimation
from curvcasadi.sensors import RootMotion, measure

GRAVITY = RootMotion(gravity=[0, 0, 9.81])


def flapping(times, n_torsion, n_out_of_plane):
    """q, q_dot, q_ddot (n, T) of a wing that flaps at half a hertz, bent up on average."""
    mean = np.r_[np.zeros(n_torsion), -0.03, 0.02, np.zeros(n_out_of_plane - 2)]
    swing = np.r_[0.005, np.zeros(n_torsion - 1), -0.02, 0.01, 0.004, np.zeros(n_out_of_plane - 3)]
    lag = np.linspace(0.0, 1.0, len(mean))[:, None]
    omega = np.pi
    angle = omega * times - lag
    amplitude = swing[:, None]
    return (
        mean[:, None] + amplitude * np.sin(angle),
        amplitude * omega * np.cos(angle),
        -amplitude * omega**2 * np.sin(angle),
    )


def write_log(path, wing_file, times, *, seed=1, missing=0.0, root=GRAVITY):
    """Write what the sensors of a wing file measure, with noise; returns the weights (n, T).

    missing : part of the cells that are empty
    """
    wing = load_estimation(wing_file)
    rng = np.random.default_rng(seed)
    basis = wing.beam.basis
    counts = [family.n for family in (basis.torsion, basis.out_of_plane)]
    motion = flapping(np.asarray(times), *counts)
    symbols = [ca.SX.sym(name, basis.n) for name in ("q", "q_dot", "q_ddot")]
    found = measure(wing.sensors, wing.beam, *symbols, root)
    values = ca.Function("values", symbols, [found.values]).map(len(times))(*motion).full()
    values = values + rng.normal(size=values.shape) * found.noise[:, None]
    holes = rng.random(values.shape) < missing
    with path.open("w", encoding="utf-8") as file:
        file.write(",".join(("time", *found.labels)) + "\n")
        for k, time in enumerate(times):
            row = zip(values[:, k], holes[:, k], strict=True)
            cells = ["" if hole else f"{x:.9g}" for x, hole in row]
            file.write(",".join((f"{time:.9g}", *cells)) + "\n")
    return motion[0]
