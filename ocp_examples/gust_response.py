"""Which gust bends the roots of the wings most, and how much does free flight relieve them?

    dδ/dt = A δ + B_p w,   M = C δ,   w = ½ w₀ (1 − cos 2π V t/L)

The HALE aircraft in trimmed flight at 25 m/s, linearized; gusts of all lengths L, met by the whole
span at once. The same with the body held as in a wind tunnel: its states are left out.
"""

from itertools import pairwise
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from scipy.linalg import expm

import curvcasadi as cc

AIRCRAFT = Path(__file__).parent / "hale_aircraft.toml"
DENSITY, SPEED, AMPLITUDE = 0.0889, 25.0, 1.0  # kg/m³, m/s, m/s
LENGTHS = np.geomspace(5, 400, 25)  # m
STEP, AFTER = 0.01, 4.0  # s
BODY = ("quaternion_wxyz", "position", "twist")


def linear() -> cc.LinearModel:
    aircraft = cc.load_aircraft(AIRCRAFT)
    model = cc.aircraft_model(
        aircraft, density=DENSITY, gust=cc.GustEntry(), outputs=("root_moment_right",)
    )
    trim = cc.trim(aircraft, speed=SPEED, density=DENSITY)
    x, u = cc.trimmed_state(model, trim)
    return cc.linearize(model, x, u)


def peak(system: cc.LinearModel, kept: np.ndarray, length: float) -> float:
    """Largest growth of the root moment, N m; the second entry, upward where it is below zero."""
    a, b, c = system.A[np.ix_(kept, kept)], system.B_p[kept, 0], system.C[1, kept]
    n = len(a)
    # Exact for a gust that is linear within each step: the state with w and its slope.
    block = np.zeros((n + 2, n + 2))
    block[:n, :n], block[:n, n], block[n, n + 1] = a, b, 1.0
    step = expm(block * STEP)
    times = np.arange(0, length / SPEED + AFTER, STEP)
    wave = cc.OneMinusCosine(amplitude=AMPLITUDE, duration=length / SPEED)
    gust = np.array([float(wave(t)) for t in times])
    state, moments = np.zeros(n), [0.0]
    for now, then in pairwise(gust):
        extended = np.concatenate([state, [now, (then - now) / STEP]])
        state = step[:n] @ extended
        moments.append(-c @ state - 0.0)
    return float(np.max(moments))


def plot(peaks: dict[str, np.ndarray]) -> Figure:
    figure = Figure(figsize=(6.4, 4.0), layout="constrained")
    axes = figure.subplots()
    for label, values in peaks.items():
        axes.semilogx(LENGTHS, values, "o-", markersize=3, label=label)
    axes.set(xlabel="length of the gust [m]", ylabel="peak of root bending per gust [N m/(m/s)]")
    axes.grid(color="0.9", which="both")
    axes.legend(frameon=False)
    return figure


def main(directory: Path = Path("out")) -> dict[str, np.ndarray]:
    system = linear()
    slices = system.model.x.errors.slices
    held = np.concatenate([np.arange(slices[k].start, slices[k].stop) for k in BODY])
    rows = {"free flight": np.arange(len(system.A))}
    rows["body held"] = np.setdiff1d(rows["free flight"], held)
    peaks = {
        label: np.array([peak(system, kept, length) for length in LENGTHS])
        for label, kept in rows.items()
    }
    for label, values in peaks.items():
        worst = int(values.argmax())
        print(f"{label:<12} {values[worst]:7.1f} N m per m/s, by a gust of {LENGTHS[worst]:.0f} m")
    directory.mkdir(exist_ok=True)
    plot(peaks).savefig(directory / "gust_response.png", dpi=150)
    return peaks


if __name__ == "__main__":
    main()
