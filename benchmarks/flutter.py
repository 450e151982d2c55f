"""Flutter about bent shapes against published cases, and turbulence against long simulations."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

import curvcasadi as cc
from benchmarks.statics import case
from benchmarks.table import Check, Table, checked
from curvcasadi.symbolic.expressions import Array
from tests.published import test_published_vibrations as vibrations
from tests.support.strip_wings import ROOT, hale, last_growth, pazy, tang_dowell

#: Linearizations a speed of a sweep.
MOST_LINEARIZATIONS = 3.0
BENT = hale((4, 4, 3), 8)
PAZY_SPEEDS = np.arange(30, 86, 1.0)
#: Of the simulation, s; the gust repeats with it. Small enough to be linear.
PERIOD, STEP, INTENSITY = 1000.0, 0.02, 0.1


def bent_wings() -> Table:
    """Cases D10, D15 and D16."""
    checks = [*_loads(), *_angles(), *_pazy(), *_tang_dowell()]
    return checked(
        "Flutter about bent shapes: errors in percent where nothing else is said", checks
    )


def turbulence() -> Table:
    """The root bending moment in Dryden turbulence, by its spectrum and by simulation."""
    speed, pitch = 20.0, 0.03
    model = cc.wing_model(
        hale((2, 3, 1), 4),
        density=0.0889,
        lag=cc.IndicialLag(poles=2, modes=3),
        gust=cc.GustEntry(kind="kussner", modes=3),
        damping=0.002,
        outputs=("root_moment",),
    )
    rest = cc.flutter(model, [15.0, speed], p={"pitch": pitch}).equilibria[-1]
    linear = cc.linearize(model, rest, p={"airspeed": speed, "pitch": pitch})
    air = cc.Turbulence(intensity=INTENSITY, scale=150.0, speed=speed)
    gust = air.sample(duration=PERIOD, dt=STEP, seed=1)
    start = 60.0  # after which the start is forgotten
    times = np.arange(0, PERIOD + start + STEP / 2, STEP)
    motion = cc.simulate(
        model,
        rest,
        times,
        p={"airspeed": speed, "pitch": pitch, "gust": lambda t: float(gust(t))},
        method="implicit_midpoint",
    )
    found = motion.y[:, times >= start - STEP / 2].std(axis=1)
    expected = cc.rms_in_turbulence(linear, air, "root_moment")
    names = ("torsion", "out of plane", "in plane")
    checks = [
        Check(
            what=f"rms root moment, {name}: simulation over the spectrum",
            value=100 * abs(value / exact - 1),
            high=3.0,
        )
        for name, value, exact in zip(names, found, expected, strict=True)
    ]
    return checked(f"Dryden turbulence over {PERIOD:g} s: errors in percent", checks)


@cache
def by_load(load: float) -> cc.Flutter:
    """Case D10 B."""
    beam = replace(BENT.beam, initial_curvature=[0, 0.018, 0])
    force = cc.PointForce(1.0, [0, 0, -load], frame="dead")
    wing = replace(BENT, beam=beam, loads=(force,))
    model = cc.wing_model(wing, density=0.0889, gravity=0.0, outputs=())
    return cc.flutter(model, np.arange(15, 36, 2.0), p={"pitch": 0.0})


@cache
def by_angle(degrees: float) -> cc.Flutter:
    """Case D10 C."""
    return cc.flutter(_bent_model(), np.arange(10, 35, 1.0), p={"pitch": np.radians(degrees)})


@cache
def _bent_model() -> cc.ControlModel:
    return cc.wing_model(BENT, density=0.0889, gravity=9.8, outputs=())


@cache
def pazy_model(varying: bool, suction: float) -> cc.ControlModel:
    """Case D15."""
    wing = pazy(case("D15"), _pazy_beam(), varying=varying, suction=suction)
    return cc.wing_model(wing, density=1.225, gravity=0.0, outputs=())


@cache
def _pazy_beam() -> cc.Beam:
    return replace(vibrations.pazy(3, 4, 2), root=ROOT)


@cache
def pazy_sweep(degrees: float, suction: float) -> cc.Flutter:
    """The hump mode at a root angle."""
    speeds = PAZY_SPEEDS
    return cc.flutter(pazy_model(True, suction), speeds, p={"pitch": np.radians(degrees)})


@cache
def tang_dowell_sweep(degrees: float, speeds: tuple[float, ...]) -> tuple[cc.Flutter, Array]:
    """Case D16: the sweep, and the height of the tip at each speed."""
    model = cc.wing_model(
        tang_dowell(case("D16")), density=1.225, gravity=9.807, outputs=("tip_position",)
    )
    pitch = np.radians(degrees)
    found = cc.flutter(model, speeds, p={"pitch": pitch})
    pairs = zip(found.speeds, found.equilibria, strict=True)
    heights = [-float(model.output(x, [], [speed, pitch])[2]) for speed, x in pairs]
    return found, np.array(heights)


def onsets(end: str = "onset") -> tuple[Array, Array]:
    """Published root angles, degrees, and speeds of onset (or offset) of case D15, from 1° on."""
    rows = np.array(case("D15")["reference"][f"{end}_vs_root_angle_varying_coeff_[U,deg]"])
    rows = rows[rows[:, 1] >= 1]
    return rows[:, 1], rows[:, 0]


def frequency(found: cc.Flutter, hertz: list[float]) -> Array:
    """|λ| of the roots nearest to published frequencies at each speed, Hz."""
    sizes = np.where(found.roots.imag > 0, np.abs(found.roots) / (2 * np.pi), np.inf)
    nearest = np.argmin(np.abs(sizes - np.array(hertz)[:, None]), axis=1)
    return np.asarray(sizes[np.arange(len(sizes)), nearest])


def _loads() -> Iterator[Check]:
    rows = case("D10")["reference"]["B_flutter_speed_vs_tip_load_N"]
    pairs = list(zip(rows["load"], rows["speed"], strict=True))[::4]
    errors = [(by_load(load).speed or np.nan) / speed - 1 for load, speed in pairs]
    yield _worst("D10 B flutter speed, by tip load", errors, 5.0)


def _angles() -> Iterator[Check]:
    rows = case("D10")["reference"]
    speeds, frequencies = (rows[f"C_flutter_{name}_vs_root_angle"] for name in ("speed", "freq"))
    angles = [a for a in speeds["deg"] if a >= 0.75]
    found = [by_angle(angle) for angle in angles]
    of_speed = np.interp(angles, speeds["deg"], speeds["speed"])
    of_frequency = np.interp(angles, frequencies["deg"], frequencies["rad_s"])
    yield _worst("D10 C flutter speed, from 0.75°", _speeds(found) / of_speed - 1, 2.0)
    turning = np.array([f.frequency for f in found], dtype=float)
    yield _worst("D10 C flutter frequency, from 0.75°", turning / of_frequency - 1, 4.0)
    yield _linearizations("D10 C", found)


def _pazy() -> Iterator[Check]:
    angles, expected = onsets()
    for suction, limit, end, name in ((1.0, 4.0, 4.5, "with"), (0.0, 1.5, 2.0, "without")):
        found = [pazy_sweep(angle, suction) for angle in angles]
        yield _worst(f"D15 onset, 1° to 7°, {name} suction", _speeds(found) / expected - 1, limit)
        ends = [last_growth(sweep) for sweep in found] / onsets("offset")[1] - 1
        yield _worst(f"D15 offset, 1° to 7°, {name} suction", ends, end)
    yield _linearizations("D15", found)
    flat = cc.flutter(pazy_model(False, 1.0), [75.0, 80.0, 85.0], p={"pitch": 0.0})
    rows = case("D15")["reference"]["undeformed_without_tip_mass"]
    speed, hertz = rows["2D strip flutter"][0]
    values = [flat.speed, flat.frequency, flat.divergence_speed]
    exact = [speed, 2 * np.pi * hertz, rows["2D divergence"][1]]
    names = ("flutter speed", "flutter frequency", "divergence speed")
    for name, value, reference in zip(names, values, exact, strict=True):
        yield _worst(f"D15 straight, 2-D: {name}", [(value or np.nan) / reference - 1], 1.5)


def _tang_dowell() -> Iterator[Check]:
    rows = case("D16")["reference"]
    published = rows["aeroelastic_frequencies_1deg_Arena_Lacarbonara"]
    found, _ = tang_dowell_sweep(1.0, tuple(published["U"]))
    for name, limit in (("torsion", 2.0), ("chord", 2.5)):
        errors = frequency(found, published[name]) / published[name] - 1
        yield _worst(f"D16 {name} frequency, 1 to 40 m/s", errors, limit)
    for degrees in (1.0, 2.2):
        theory = rows[f"tip_z_{degrees:g}deg_theory"]
        _, heights = tang_dowell_sweep(degrees, tuple(theory["U"]))
        worst = float(np.abs(heights - theory["m"]).max())
        yield Check(what=f"D16 height of the tip, {degrees:g}°, mm", value=1e3 * worst, high=12.0)


def _speeds(found: list[cc.Flutter]) -> Array:
    return np.array([sweep.speed for sweep in found], dtype=float)


def _worst(what: str, errors: Any, limit: float) -> Check:
    return Check(what=what, value=100 * float(np.abs(errors).max()), high=limit)


def _linearizations(name: str, found: list[cc.Flutter]) -> Check:
    most = max(sweep.linearizations / len(sweep.speeds) for sweep in found)
    return Check(what=f"{name} linearizations a speed", value=most, high=MOST_LINEARIZATIONS)
