"""Unsteady air against exact and published cases: sections, gusts, induced flow, flutter."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import casadi as ca
import numpy as np
from scipy.integrate import solve_ivp
from scipy.special import kv

import curvcasadi as cc
from benchmarks.statics import case, smith_wing, strip_load
from benchmarks.table import Check, Table, checked
from curvcasadi.aero.unsteady import UnsteadyAirload
from curvcasadi.dynamics.functions import balance_function
from curvcasadi.symbolic.expressions import Array
from tests.support.strip_wings import goland, hale

#: Largest relative errors, percent, that are admitted.
THEODORSEN = {2: 2.5, 3: 1.0, 4: 0.3}
FLUTTER_HALE = {2: (0.6, 1.5), 3: (0.5, 0.5), 4: (0.15, 0.15)}
FLUTTER_GOLAND = {2: (0.4, 1.2), 3: (0.3, 0.3)}


def unsteady() -> Table:
    """Sections, gusts, induced flow and flutter."""
    checks = [*_sections(), *_gusts(), *_lattice(), *_flutter(), *_bent_flutter(), *_nodes()]
    return checked("Unsteady air: errors in percent where nothing else is said", checks)


def _percent(what: str, value: float, high: float) -> Check:
    return Check(what=what, value=100 * abs(value), high=high, form="{:.3f}")


def _sections() -> Iterator[Check]:
    k = np.concatenate([np.geomspace(1e-4, 0.01, 20), np.linspace(0.01, 2, 400)])
    exact = kv(1, 1j * k) / (kv(0, 1j * k) + kv(1, 1j * k))
    for poles, limit in THEODORSEN.items():
        error = np.abs(cc.IndicialLag(poles=poles).theodorsen(k) / exact - 1).max()
        yield _percent(f"D23 C(k) for k up to 2, {poles} poles", float(error), limit)


def _lift(s: Array, half_length: float, entry: cc.GustEntry, lag: cc.IndicialLag | None) -> Array:
    """Lift coefficient of a held airfoil at `s` half chords of the gust of D21."""
    wing = case("D21")["aero"]
    gust = cc.OneMinusCosine(amplitude=wing["w_gust_max"], duration=2 * half_length)
    amplitudes, rates = entry.poles
    if lag is not None:
        amplitudes = np.append((1 - lag.amplitudes.sum()) * amplitudes, lag.amplitudes)
        rates = np.append(rates, lag.rates)
    entered = len(entry.poles.rates)

    def rate(now: float, x: Array) -> Array:
        follows = np.full(len(x), x[0])
        follows[:entered] = float(gust(now))
        return rates * (follows - x)

    run = solve_ivp(
        rate, (0, s[-1]), np.zeros(len(rates)), t_eval=s, rtol=1e-9, atol=1e-12, max_step=0.1
    )
    return np.asarray(2 * np.pi / wing["U"] * (amplitudes @ run.y))


def _gusts() -> Iterator[Check]:
    rows = case("D21")["reference"]["Kussner_COMPUTED_incompressible"]
    for name, half_length in (("H_pi", np.pi), ("H_8pi", 8 * np.pi)):
        table = np.array(rows[name]["[s,dcl]"])
        found = _lift(table[:, 0], half_length, cc.GustEntry(kind="kussner"), None)
        yield Check(
            what=f"D21 two Küssner states, {name}, lift coefficient",
            value=float(np.abs(found - table[:, 1]).max()),
            high=1e-4,
            form="{:.1e}",
        )
    s = np.linspace(3, 5, 81)
    found = _lift(s, np.pi, cc.GustEntry(kind="lag"), cc.IndicialLag(poles=3))
    yield _percent("D21 one entry lag, H = π, peak", found.max() / rows["H_pi"]["peak"] - 1, 0.5)


def _lattice() -> Iterator[Check]:
    """Tips of D11 with six horseshoes over the vortex-lattice rows."""
    rows = case("D11")["reference"]["SHARPy_UVLM_tip_(span,normal)_root_frame"]
    limits = {"asserted": 2.0, "full_wake": 5.0, "horseshoe": 5.0}
    for frozen in (False, True):
        line = cc.LiftingLine(panels=6, frozen=frozen)
        for name in ("2deg_nog", "2deg_g", "4deg_nog", "4deg_g"):
            beam, air = smith_wing(float(name[0])), replace(strip_load(25.0), induced_flow=line)
            loads = [air, cc.Gravity([0, 0, -9.754])] if name.endswith("_g") else [air]
            tip = cc.solve_equilibrium(beam, loads).shape.tip.position
            normal = float((beam.root.rotation.T @ tip)[2])
            kind = "frozen" if frozen else "moving"
            for key in (key for key in rows if key.startswith(f"{name}_")):
                what = f"D11 {key}, {kind} lifting line"
                if name == "2deg_g":
                    off = abs(normal - rows[key][1])
                    yield Check(what=f"{what}, m", value=off, high=0.03, form="{:.3f}")
                    continue
                limit = 5.0 if frozen else limits[key.removeprefix(f"{name}_")]
                yield _percent(what, normal / rows[key][1] - 1, limit)


def _flutter() -> Iterator[Check]:
    exact = case("D09")["reference"]["exact_Theodorsen_strip"]["rho 0.0889"]

    def sweep(
        wing: cc.Wing, density: float, speeds: list[float], poles: int, modes: int | None = 3
    ) -> cc.Flutter:
        lag = cc.IndicialLag(poles=poles, modes=modes)
        model = cc.wing_model(wing, density=density, gravity=0.0, lag=lag, outputs=())
        return cc.flutter(model, speeds, p={"pitch": 0.0})

    def hale_sweep(poles: int, modes: int | None = 3) -> cc.Flutter:
        return sweep(hale(), 0.0889, [25.0, 30.0, 35.0, 38.5], poles, modes)

    found = {poles: hale_sweep(poles) for poles in FLUTTER_HALE}
    for poles, limits in FLUTTER_HALE.items():
        yield from _errors(f"D09 flutter {{}}, {poles} poles", found[poles], exact, limits)
    diverged = found[3].divergence_speed or np.nan
    yield _percent("D09 divergence speed", diverged / exact["divergence_speed"] - 1, 0.05)
    whole, few = _onset(hale_sweep(3, None)), _onset(hale_sweep(3, 2))
    for number, values, limit in ((3, _onset(found[3]), 0.05), (2, few, 0.35)):
        worst = np.abs(values / whole - 1).max()
        yield _percent(f"D09 {number} lag functions over a set per strip", float(worst), limit)

    row = case("D12")["reference"]["exact_COMPUTED"]
    sharpy = row["SHARPy props, rho 1.02"]
    exact = {"flutter_speed": sharpy["speed"], "flutter_rad_s": sharpy["rad_s"]}
    for poles, limits in FLUTTER_GOLAND.items():
        goland_sweep = sweep(goland(), 1.02, [120.0, 140.0, 155.0], poles)
        yield from _errors(f"D12 flutter {{}}, {poles} poles", goland_sweep, exact, limits)
    vacuum = np.array(row["vacuum coupled rad_s (SHARPy props)"])
    frequencies = cc.natural_frequencies(goland().beam)[: len(vacuum)]
    worst = np.abs(frequencies / vacuum - 1).max()
    yield _percent("D12 four vacuum frequencies", float(worst), 0.1)


def _bent_flutter() -> Iterator[Check]:
    """Flutter of the HALE wing under its weight at 2°, by how its induced flow is modelled.

    The frozen lines are those of the unbent wing and of the shape at the onset of flutter.
    """
    wing, pitch, speeds = hale((4, 4, 2), 6), np.radians(2.0), [24.0, 25.0, 26.0, 27.0]

    def sweep(line: cc.LiftingLine | None) -> cc.Flutter:
        model = cc.wing_model(wing, density=0.0889, induced_flow=line, outputs=())
        return cc.flutter(model, speeds, p={"pitch": pitch})

    moving = sweep(cc.LiftingLine(panels=6))
    speed = float(moving.speed or np.nan)
    velocity = [speed * np.cos(pitch), 0, speed * np.sin(pitch)]
    flow = cc.Flow(density=0.0889, velocity=velocity)
    air = cc.AerodynamicLoad(strips=wing.strips, flow=flow, induced_flow=cc.LiftingLine(panels=6))
    c, s = np.cos(pitch), np.sin(pitch)
    attitude = [[c, 0, s], [0, 1, 0], [-s, 0, c]]
    q = cc.solve_equilibrium(wing.beam, [air, cc.Gravity([0, 0, 9.80665])], attitude=attitude).q
    straight = cc.LiftingLine(panels=6, frozen=True)
    bent = cc.LiftingLine(panels=6, frozen=True, shape=q, velocity=velocity)
    yield Check(what="HALE wing at 2°, flutter with induced flow, m/s", value=speed, form="{:.3f}")
    for what, line, high in (
        ("strips alone", None, 10.0),
        ("the line frozen unbent", straight, 0.5),
        ("the line frozen as bent", bent, 0.5),
    ):
        found = sweep(line).speed or np.nan
        yield _percent(f"HALE wing at 2°, flutter speed with {what}", found / speed - 1, high)


def _onset(found: cc.Flutter) -> Array:
    """Speed and frequency of flutter; NaN without."""
    return np.array([found.speed, found.frequency], dtype=float)


def _errors(
    text: str, found: cc.Flutter, exact: dict[str, float], limits: tuple[float, float]
) -> Iterator[Check]:
    expected = [exact["flutter_speed"], exact["flutter_rad_s"]]
    errors = _onset(found) / expected - 1
    for what, error, limit in zip(("speed", "frequency"), errors, limits, strict=True):
        yield _percent(text.format(what), float(error), limit)


def _nodes() -> Iterator[Check]:
    """Nodes of the equations of motion of the HALE wing with 9 weights and 6 lag states.

    The six aerodynamic stations divide the elements: four make ten.
    """
    line = cc.LiftingLine(panels=6)
    for elements, with_line, high in ((4, None, 10000.0), (6, None, 14000.0), (4, line, 15500.0)):
        motion = wing_motion(elements, with_line)
        nodes, slopes = (float(f.n_instructions()) for f in (motion, motion.jacobian()))
        what = f"wing model, 9 weights, 6 lag states, six stations, {elements} elements"
        air = "" if with_line is None else ", a lifting line that moves"
        yield Check(what=f"nodes of a {what}{air}", value=nodes, high=high, form="{:.0f}")
        yield Check(
            what=f"nodes of its derivative over it, {elements} elements{air}",
            value=slopes / nodes,
            high=12.0,
            form="{:.2f}",
        )


def wing_motion(elements: int, line: cc.LiftingLine | None = None) -> ca.Function:
    """The equations of motion of `wing_model` as one long expression."""
    wing = hale((3, 4, 2), elements)
    assert wing.strips is not None
    states, speed, pitch = ca.SX.sym("lag", 6), ca.SX.sym("airspeed"), ca.SX.sym("pitch")
    c, s = ca.cos(pitch), ca.sin(pitch)
    load = UnsteadyAirload(
        strips=wing.strips,
        flow=cc.Flow(density=0.0889, velocity=speed * ca.vertcat(c, 0, s)),
        lag=cc.IndicialLag(poles=2, modes=3),
        states=states,
        induced_flow=line,
    )
    attitude = ca.vertcat(ca.horzcat(c, 0, s), ca.horzcat(0, 1, 0), ca.horzcat(-s, 0, c))
    root = cc.RootMotion(
        pose=cc.Pose(rotation=attitude, position=[0, 0, 0]), gravity=[0, 0, 9.80665]
    )
    return balance_function(
        wing.beam,
        [load],
        load.parts.projection,
        {"lag": states, "airspeed": speed, "pitch": pitch},
        root=root,
        form="unrolled",
    )
