"""Where does a free beam fly that is pushed and turned at one end for 2.5 s, then let go?

    d(momentum)/dt = F,   F = 8 for t ≤ 2.5, then 0:   x_center = 0.4 t², then 2.5 + 2 (t − 2.5)

This is the flying spaghetti of J. C. Simo and L. Vu-Quoc (1986), in their consistent units: length
10, EI = 100, mass 1 and rotary inertia 10 per length, a force of 8 and a moment of 80. An aircraft
without a body is a beam that flies alone; its own curvatures and the motion of its root are the
state, so that Newton's law of the centre of mass is a test of all of them.
"""

from pathlib import Path

import casadi as ca
import numpy as np
from matplotlib.figure import Figure

import curvcasadi as cc
from curvcasadi.lie import quaternion

PUSHED, END = 2.5, 7.5
BEAM = cc.Beam(
    length=10.0,
    basis=cc.ChannelBasis(out_of_plane=cc.Legendre(8)),
    grid=cc.Grid.lobatto(16),
    section=cc.Section(
        GJ=500, EI_y=100, EI_z=100, mass_per_length=1, inertia=np.diag([20, 10, 10])
    ),
    root=cc.Pose(rotation=[[0.6, 0, 0.8], [0, 1, 0], [-0.8, 0, 0.6]], position=[0, 0, 0]),
)
PUSH = (cc.PointForce(1.0, [8, 0, 0]), cc.PointMoment(1.0, [0, 80, 0]))


def fly(loads: tuple[cc.Load, ...], start: object, times: np.ndarray) -> cc.Simulation:
    wing = cc.Wing(name="beam", beam=BEAM, loads=loads)
    alone = cc.Aircraft(body=cc.NoBody(), beams=(wing,))
    model = cc.aircraft_model(alone, density=0, gravity=0, outputs=[])
    return cc.simulate(model, start, times, dt=0.0025)


def shapes(states: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Curves (T, 3, stations) and centres of mass (T, 3) of states (nx, T), inertial axes."""
    x = ca.MX.sym("x", states.shape[0])
    attitude, place, q, _ = ca.vertsplit(x, [0, 4, 7, 7 + BEAM.basis.n, x.numel()])
    rotation = quaternion.rotation(attitude)
    # The potential in gravity along −x, −y and −z is the mass moment along these.
    moments = [cc.potential_energy(BEAM, q, [cc.Gravity(-axis)]) for axis in np.eye(3)]
    center = place + rotation @ (ca.vertcat(*moments) - cc.strain_energy(BEAM, q)) / 10
    stations = np.linspace(0, 1, 41)
    curve = ca.horzcat(*(place + rotation @ cc.pose_at(BEAM, q, xi).position for xi in stations))
    f = ca.Function("shapes", [x], [curve, center])
    found = [f(state) for state in states.T]
    return np.array([a.full() for a, _ in found]), np.array([b.full().ravel() for _, b in found])


def plot(times: np.ndarray, curves: np.ndarray, centers: np.ndarray) -> Figure:
    figure = Figure(figsize=(8.0, 4.2), layout="constrained")
    axes = figure.subplots()
    every = range(0, len(times), 10)
    colors = [(0.1, 0.3, 0.7, 0.35 + 0.65 * k / len(times)) for k in every]
    for k, color in zip(every, colors, strict=True):
        axes.plot(curves[k, 0], curves[k, 2], color=color, lw=1.2)
        axes.annotate(f"{times[k]:g} s", curves[k, [0, 2], -1], fontsize=6, color="0.4")
    axes.plot(centers[:, 0], centers[:, 2], color="tab:red", lw=1.5, label="centre of mass")
    axes.plot(*curves[::2, [0, 2], -1].T, ":", color="0.6", lw=1, label="pushed end")
    axes.set(xlabel="x (consistent units)", ylabel="z (consistent units)", aspect="equal")
    axes.grid(color="0.9")
    axes.legend(frameon=False, loc="center left", bbox_to_anchor=(1, 0.5))
    return figure


def main(directory: Path = Path("out")) -> tuple[float, np.ndarray]:
    pushed = fly(PUSH, {"quaternion_wxyz": [1, 0, 0, 0]}, np.linspace(0, PUSHED, 51))
    free = fly((), pushed.x[:, -1], np.linspace(PUSHED, END, 101))
    times = np.append(pushed.t, free.t[1:])
    curves, centers = shapes(np.hstack([pushed.x, free.x[:, 1:]]))
    exact = np.where(times < PUSHED, 0.4 * times**2, 2.5 + 2 * (times - PUSHED))
    moved = centers - centers[0]
    error = float(np.abs(moved - np.column_stack([exact, 0 * exact, 0 * exact])).max())
    tip = curves[:, :, -1] - curves[0, :, -1]
    print(f"the centre of mass flies {moved[-1, 0]:.6f} far, by Newton's law {exact[-1]:.6f}")
    print(f"largest difference on the way: {error:.1e}")
    print(f"the pushed end moves from {tip[:, 0].min():.2f} to {tip[:, 0].max():.2f} along x")
    directory.mkdir(exist_ok=True)
    plot(times, curves, centers).savefig(directory / "free_flying_beam.png", dpi=150)
    return error, tip


if __name__ == "__main__":
    main()
