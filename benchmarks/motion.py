"""Motion in time: energy, momenta, symmetry, damping, published motions, and times of steps."""

from __future__ import annotations

import shutil
import time
from functools import lru_cache

import casadi as ca
import numpy as np

import curvcasadi as cc
from benchmarks.dynamics import WEIGHT
from benchmarks.generated_c import NO_GCC
from benchmarks.table import Check, Table, checked, compared
from curvcasadi.control.implicit_midpoint import midpoint_solver
from curvcasadi.control.step import midpoint_rule, rk4
from curvcasadi.control.steppers import Native
from curvcasadi.lie import quaternion
from curvcasadi.reference_wings import hale_wing
from curvcasadi.symbolic.expressions import Array

#: A step of the implicit midpoint rule, s, and the weights of the wing.
STEP, COUNTS, N = 0.005, (2, 4, 2), 8


@lru_cache(maxsize=1)
def _model() -> cc.ControlModel:
    """The HALE wing under its weight, undamped."""
    return cc.beam_model(hale_wing(*COUNTS), WEIGHT)


def energy() -> Table:
    """What steps keep: energy, the way back, damping ratios."""
    checks = [
        Check(
            what=f"energy over largest kinetic energy, implicit midpoint at {1e3 * dt:g} ms",
            value=_energy_error(dt),
            high=high,
            form="{:.1e}",
        )
        for dt, high in ((0.001, 1e-7), (STEP, 1e-6))
    ]
    way, error = _forth_and_back()
    checks += [
        Check(what="violent motion: way of the tip in 0.4 s, m", value=way, low=10, form="{:.1f}"),
        Check(
            what="the same and back with reversed velocities: error of the tip, m",
            value=error,
            high=1e-6,
            form="{:.1e}",
        ),
        Check(
            what="damping ratios with C = β S: error, relative to β ω/2",
            value=_damping_error(),
            high=1e-9,
            form="{:.1e}",
        ),
    ]
    note = "HALE wing of 8 weights, released straight under its weight, 3 s."
    return checked("Motion: energy, symmetry, damping", checks, (note,))


def _energy_error(dt: float) -> float:
    wing = hale_wing(*COUNTS)
    q, rate = ca.MX.sym("q", N), ca.MX.sym("rate", N)
    parts = [cc.kinetic_energy(wing, q, rate), cc.potential_energy(wing, q, WEIGHT)]
    motion = cc.simulate(_model(), None, np.linspace(0, 3, 301), method="implicit_midpoint", dt=dt)
    of_state = ca.Function("energies", [q, rate], parts).map(len(motion.t))
    kinetic, potential = (
        part.full().ravel() for part in of_state(motion.part("q"), motion.part("q_dot"))
    )
    total = kinetic + potential
    return float(np.max(np.abs(total - total[0])) / kinetic.max())


def _forth_and_back() -> tuple[float, float]:
    """Way of the tip, m, and its error when it has come back."""
    start = np.zeros(2 * N)
    start[N + COUNTS[0]] = -0.3  # rad/(m s) of the first out-of-plane weight
    forth = cc.simulate(_model(), start, [0, 0.4], method="implicit_midpoint", dt=STEP)
    turned = forth.x[:, -1] * np.repeat([1, -1], N)
    back = cc.simulate(_model(), turned, [0, 0.4], method="implicit_midpoint", dt=STEP)
    first, last, again = forth.y[:3, 0], forth.y[:3, -1], back.y[:3, -1]
    return float(np.linalg.norm(last - first)), float(np.linalg.norm(again - first))


def _damping_error() -> float:
    beta, wing = 1e-3, hale_wing(*COUNTS)
    damped = cc.linearize(cc.beam_model(wing, damping=beta), np.zeros(2 * N)).eigenvalues
    oscillating = damped[damped.imag > 0]
    ratios = np.sort(-oscillating.real / np.abs(oscillating))
    expected = beta * cc.natural_frequencies(wing)[: len(ratios)] / 2
    return float(np.max(np.abs(ratios / expected - 1)))


def free_flight() -> Table:
    """Momenta of an aircraft without loads over ten seconds."""
    rows, drifts = [], {}
    for method, step in (
        ("variational", STEP),
        ("implicit_midpoint", STEP),
        ("implicit_midpoint", STEP / 4),
        ("implicit_midpoint", STEP / 8),
        ("rk4", STEP / 4),
        ("rk4", STEP / 8),
    ):
        found = drifts[method, step] = _drifts(method, step)
        rows += [
            Check(
                what=f"{method.replace('_', ' ')}, {1e3 * step:g} ms: change of {name}",
                value=value,
                high=1e-10 if method == "variational" else None,
                form="{:.1e}",
            )
            for name, value in zip(("linear momentum", "angular momentum"), found, strict=True)
        ]
    rows += [
        Check(
            what=f"{method.replace('_', ' ')}: order of the drift of linear momentum",
            value=float(np.log2(drifts[method, step][0] / drifts[method, step / 2][0])),
            form="{:.1f}",
        )
        for method, step in (("implicit_midpoint", STEP / 4), ("rk4", STEP / 4))
    ]
    note = (
        "A body of 50 kg with two HALE wings of 8 weights turns and flaps freely for 10 s, also in "
        "its plane; changes over the size of the momentum."
    )
    return checked("Free flight without loads", rows, (note,))


@lru_cache(maxsize=1)
def _free() -> cc.ControlModel:
    right = cc.Wing(name="right", beam=hale_wing(*COUNTS, grid=cc.Grid.lobatto(8)))
    body = cc.RigidBody(mass=50.0, center_of_mass=[0.1, 0, 0.2], inertia=np.diag([40.0, 30, 50]))
    wings = (right, cc.mirror_wing(right, "left"))
    return cc.aircraft_model(cc.Aircraft(body=body, beams=wings), density=0, gravity=0, outputs=[])


def _drifts(method: str, step: float) -> tuple[float, float]:
    """Change of linear and angular momentum in 10 s over their sizes."""
    bent = np.zeros(N)
    bent[2] = -0.03
    start = {
        "quaternion_wxyz": [1, 0, 0, 0],
        "q_right": bent + 0.01 * (np.arange(N) == 3),
        "q_left": bent,
        "twist": [0.3, 0.2, -0.15, 1.0, 0.5, -0.2],
        "q_dot_right": 0.02 * (np.arange(N) == 0) + 0.002 * (np.arange(N) == 6),
    }
    motion = cc.simulate(_free(), start, [0, 10], method=method, dt=step)  # type: ignore[arg-type]
    first, last = (_momentum(motion.x[:, k]) for k in (0, -1))
    linear, angular = (
        float(np.linalg.norm(last[part] - first[part]) / np.linalg.norm(first[part]))
        for part in (slice(0, 3), slice(3, 6))
    )
    return linear, angular


def _momentum(x: Array) -> Array:
    """Linear and angular momentum (6,), inertial axes."""
    motion = _free().second_order
    assert motion is not None and motion.momenta is not None
    body = motion.momenta(x)[0].full().ravel()[:6]
    rotation = quaternion.rotation(ca.DM(x[:4])).full()
    linear = rotation @ body[3:]
    return np.concatenate([linear, rotation @ body[:3] + np.cross(x[4:7], linear)])


def times() -> Table:
    """Times of compiled steps, and of simulated seconds."""
    title = f"Compiled steps: HALE wing of {N} weights, 16 elements"
    if not shutil.which("gcc"):
        return compared(title, ("what", "ratio"), [], (NO_GCC,))
    implicit, explicit = _steps_over_their_dynamics()
    ours, theirs = (
        _second("implicit_midpoint", dt=STEP), _second("cvodes", tolerance=1e-5)
    )  # fmt: skip
    rows = (
        ("implicit step at 5 ms over inverse dynamics, mean of 3 s", implicit, "≤ 5"),
        ("RK4 step over forward dynamics", explicit, "≤ 4.5"),
        ("simulated second, implicit at 5 ms over cvodes", ours / theirs, "≤ 0.5"),
    )
    return compared(
        title,
        ("what", "ratio", "asked for"),
        [(what, f"{x:.2f}", limit) for what, x, limit in rows],
    )


def _steps_over_their_dynamics() -> tuple[float, float]:
    model = _model()
    assert model.second_order is not None
    balance, slope = Native(model.second_order.balance), Native(model.xdot)
    implicit = Native(midpoint_solver(midpoint_rule(model)))
    x, u, p = (ca.MX.sym(name, size) for name, size in (("x", 2 * N), ("u", 0), ("p", 0)))
    explicit = Native(ca.Function("rk4", [x, u, p], [rk4(model, STEP, x, u, p)]))
    none = np.zeros(0)
    state, last, before = np.zeros(2 * N), np.zeros(N), np.zeros(N)
    samples: dict[float, tuple[Array, Array]] = {}
    counts = []
    for _ in range(600):
        guess = 2 * last - before
        end, _, forces, count = implicit(state, none, none, STEP, guess)
        counts.append(float(count[0]))
        samples[counts[-1]] = (state, guess)
        state, last, before = end, forces, last
    balance(state, np.zeros(N), none, none)
    slope(state, none, none)
    explicit(state, none, none)
    once = _least([balance, slope, explicit])
    mean = 0.0
    for count, (at, guess) in samples.items():
        implicit(at, none, none, STEP, guess)
        ratio = np.divide(*_least([implicit, balance]))
        mean += ratio * counts.count(count) / len(counts)
    return float(mean), once[2] / once[1]


def _least(natives: list[Native]) -> list[float]:
    """Least seconds of one call of each, in turns, so that all meet the same machine."""
    best = [np.inf] * len(natives)
    for _ in range(40):
        for i, native in enumerate(natives):
            start = time.perf_counter()
            for _ in range(100):
                native.evaluate()
            best[i] = min(best[i], (time.perf_counter() - start) / 100)
    return best


def _second(method: str, dt: float | None = None, tolerance: float | None = None) -> float:
    """Seconds that a simulated second takes, without the set-up: the tip errs by below 1 mm."""
    spent = []
    for end in (1, 11):
        rounds = []
        for _ in range(5):
            start = time.perf_counter()
            cc.simulate(
                _model(), None, [0, end], method=method, dt=dt, tolerance=tolerance  # type: ignore[arg-type]
            )  # fmt: skip
            rounds.append(time.perf_counter() - start)
        spent.append(min(rounds))
    return (spent[1] - spent[0]) / 10
