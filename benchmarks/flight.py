"""Free flight in air: trimmed flight that is left alone."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import curvcasadi as cc
from benchmarks.table import Check, Table, checked

FILE = Path(__file__).parents[1] / "ocp_examples" / "hale_aircraft.toml"
DENSITY, SPEED, DURATION = 0.0889, 25.0, 60.0


def trimmed() -> Table:
    """The HALE aircraft, 200 kg m² of body inertia about each axis, trimmed and left alone."""
    aircraft = cc.load_aircraft(FILE)
    found = cc.trim(aircraft, speed=SPEED, density=DENSITY)
    checks = []
    for modes in (3, None):
        model = cc.aircraft_model(aircraft, density=DENSITY, lag=cc.IndicialLag(modes=modes))
        x, u = cc.trimmed_state(model, found)
        words = "a set of lag states per strip" if modes is None else "three lag functions"
        checks += _left_alone(model, x, u, words)
    return checked(f"Trimmed flight at {SPEED:g} m/s, left alone for {DURATION:g} s", checks)


def _left_alone(model: cc.ControlModel, x: np.ndarray, u: np.ndarray, words: str) -> list[Check]:
    times = np.linspace(0, DURATION, 61)
    motion = cc.simulate(model, x, times, u=u, method="implicit_midpoint", dt=0.02)
    speed = np.linalg.norm(motion.part("twist")[3:], axis=0)
    north, east, down = motion.part("position")
    values = {
        "change of speed, relative": np.max(np.abs(speed / SPEED - 1)),
        "change of height over distance": np.max(np.abs(down)) / north[-1],
        "drift to the side over distance": np.max(np.abs(east)) / north[-1],
    }
    return [
        Check(what=f"{what}, {words}", value=float(value), high=1e-6)
        for what, value in values.items()
    ]
