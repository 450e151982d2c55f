"""How do the natural frequencies of a wing change when it is bent?

    (ω² M(q) − K) shape = 0   about   S q = Q(q, F),   K = S − ∂Q/∂q

A dead force F at the tip bends the HALE wing upward. A twist near the root then moves the bent part
outboard forward and back, so that torsion and in-plane bending couple: one mode of both sinks, the
other one rises.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

import curvcasadi as cc
from curvcasadi.reference_wings import hale_wing

FORCES = np.linspace(0, 56, 29)  # N, upward
WING = replace(hale_wing(torsion=3, out_of_plane=5, in_plane=4), weight_bounds=None)
CHANNELS = {"torsion": slice(0, 3), "out of plane": slice(3, 8), "in plane": slice(8, 12)}
SHOWN = 6


def shares(shape: np.ndarray) -> list[float]:
    """Shares of the channels in the strain energy of a mode."""
    parts = []
    for rows in CHANNELS.values():
        q = np.zeros_like(shape)
        q[rows] = shape[rows]
        parts.append(float(cc.strain_energy(WING, q)))
    return [part / sum(parts) for part in parts]


def vibrations() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Tip heights (m), frequencies (forces, modes), rad/s, and shares (forces, modes, channels)."""
    heights, frequencies, parts, q = [], [], [], None
    for force in FORCES:
        loads = [cc.PointForce(1.0, [0, 0, -force])]  # body axes: z is down
        rest = cc.solve_equilibrium(WING, loads, q)
        q = rest.q
        modes = cc.vibration_modes(WING, q, loads)
        heights.append(-float(rest.shape.tip.position[2]))
        frequencies.append(modes.frequencies[:SHOWN])
        parts.append([shares(shape) for shape in modes.shapes.T[:SHOWN]])
    return np.array(heights), np.array(frequencies), np.array(parts)


def plot(heights: np.ndarray, frequencies: np.ndarray, parts: np.ndarray) -> Figure:
    """Each mode as dots whose colour mixes blue for torsion, red for in-plane bending."""
    figure = Figure(figsize=(6.4, 4.4), layout="constrained")
    axes = figure.subplots()
    colors = np.array([[0.0, 0.35, 0.85], [0.6, 0.6, 0.6], [0.85, 0.2, 0.1]])
    for k in range(frequencies.shape[1]):
        axes.plot(heights, frequencies[:, k], color="0.85", lw=1, zorder=1)
        axes.scatter(heights, frequencies[:, k], c=parts[:, k] @ colors, s=16, zorder=2)
    for name, color in zip(CHANNELS, colors, strict=True):
        axes.scatter([], [], color=color, s=16, label=name)
    axes.set(xlabel="height of the tip [m]", ylabel="natural frequency [rad/s]", yscale="log")
    axes.set_yticks([2, 5, 10, 20, 50], labels=["2", "5", "10", "20", "50"])
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.grid(color="0.9")
    axes.legend(frameon=False, loc="upper left", bbox_to_anchor=(1, 1), title="strain energy")
    return figure


def main(directory: Path = Path("out")) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    heights, frequencies, parts = vibrations()
    for k in (0, len(FORCES) // 2, -1):
        shown = ", ".join(f"{value:.3g}" for value in frequencies[k])
        print(f"tip at {heights[k]:5.2f} m: {shown} rad/s")
    twisting = int(parts[0, :, 0].argmax())
    share = parts[-1, :, 0]
    print(
        f"torsion is mode {twisting + 1} of the straight wing; of the bent one it is in the modes "
        + " and ".join(str(k + 1) for k in sorted(np.argsort(share)[-2:]))
    )
    directory.mkdir(exist_ok=True)
    plot(heights, frequencies, parts).savefig(directory / "modes_about_bent_shapes.png", dpi=150)
    return heights, frequencies, parts


if __name__ == "__main__":
    main()
