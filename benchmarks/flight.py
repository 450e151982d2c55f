"""Free flight in air: trimmed flight that is left alone, straight and in a turn."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import casadi as ca
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


def turning() -> Table:
    """The same aircraft with ailerons, a fin and a rudder, in coordinated turns of 0.1 rad/s."""
    aircraft = _agile(cc.load_aircraft(FILE))
    air = {"speed": SPEED, "density": DENSITY}
    straight = cc.trim(aircraft, **air, inputs={"aileron": 0.0, "rudder": 0.0})
    still, right, left = (
        cc.trim(aircraft, **air, turn=cc.Turn(rate=rate)) for rate in (0.0, 0.1, -0.1)
    )
    model = cc.aircraft_model(aircraft, density=DENSITY, lag=cc.IndicialLag(modes=None), outputs=())
    x, u = cc.trimmed_state(model, right)
    inputs = model.u.split(ca.DM(u))
    times = np.linspace(0, 10, 11)
    motion = cc.simulate(model, x, times, u=u, method="implicit_midpoint", dt=0.02)
    twist = motion.part("twist")
    course = np.tan(right.roll) * right.gravity / (SPEED * right.turn_rate)
    values = {
        "no rate against straight flight, unknowns": (_apart(still, straight, 1.0), 1e-12),
        "left against the mirror image of right, unknowns": (_apart(left, right, -1.0), 1e-10),
        "inputs of the model against those of the trim, relative": (
            max(abs(float(inputs[k]) / v - 1) for k, v in right.inputs.items()),
            1e-9,
        ),
        "change of the twist in 10 s, rad/s and m/s": (np.max(np.abs(twist - twist[:, :1])), 1e-10),
        "change of height over distance": (
            np.max(np.abs(motion.part("position")[2])) / (SPEED * times[-1]),
            1e-10,
        ),
        "load factor times cos of the bank angle less 1": (
            abs(right.load_factor * np.cos(right.roll) - 1),
            5e-3,
        ),
        "tan of the bank angle times g/(V rate) less 1": (abs(course - 1), 0.02),
    }
    checks = [Check(what=what, value=float(v), high=high) for what, (v, high) in values.items()]
    return checked(f"Coordinated turn at {SPEED:g} m/s, 0.1 rad/s", checks)


def _agile(aircraft: cc.Aircraft) -> cc.Aircraft:
    aileron = cc.ControlSurface(name="aileron", lift=3.0, start=0.7, antisymmetric=True)
    rudder = cc.ControlSurface(name="rudder", lift=3.0)
    right, tail = aircraft.beams[0], aircraft.surfaces[0]
    right = replace(right, strips=replace(right.strips, controls=(aileron,)))
    upright = cc.Pose(rotation=[[0, 1, 0], [0, 0, -1], [-1, 0, 0]], position=[-10, 0, -1])
    strips = replace(tail.strips, controls=(rudder,), upper_side=1)
    fin = cc.LiftingSurface(name="fin", area=1.5, pose=upright, strips=strips)
    return replace(aircraft, beams=(right, cc.mirror_wing(right, "left")), surfaces=(tail, fin))


def _apart(one: cc.TrimResult, other: cc.TrimResult, side: float) -> float:
    """Largest difference of angles, inputs over their size and weights; `side` −1 for a mirror."""
    gaps = [one.angle_of_attack - other.angle_of_attack, one.pitch - other.pitch]
    gaps += [one.sideslip - side * other.sideslip, one.roll - side * other.roll]
    for name, value in other.inputs.items():
        lateral = side if name in ("aileron", "rudder") else 1.0
        gaps.append((one.inputs[name] - lateral * value) / max(abs(value), 1.0))
    image = {"right": "left", "left": "right"} if side < 0 else {"right": "right", "left": "left"}
    gaps += [float(ca.norm_inf(q - other.q[image[name]])) for name, q in one.q.items()]
    return float(np.max(np.abs(gaps)))
