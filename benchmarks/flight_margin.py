"""Margins of the loop of MPC and filter in free flight: its parts by differences, as one map.

Over one period of the controller the linear loop is z ← A z + B v, u = C z with the commands v that
are held and those that the controller asks for, u. The sensitivity at the inputs, over their limits
D, is S(ζ) = D⁻¹ (I − C (ζ − A)⁻¹ B)⁻¹ D. The filter has the gain to which it settles in calm air.
"""

from __future__ import annotations

import runpy
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import curvcasadi as cc
from benchmarks.table import Check, Table, checked

Array = NDArray[np.float64]
EXAMPLE = Path(__file__).parents[1] / "ocp_examples" / "free_flight_mpc.py"
SEEDS = (0, 1, 2, 3)
SETTLED = 120  # updates of the filter
STEP = 1e-5
SLOW = 1.5  # rad/s
FREQUENCIES = np.geomspace(0.3, 62.0, 200)  # rad/s


def slopes(f: Callable[..., Array], sizes: Sequence[int], scale: float = STEP) -> list[Array]:
    """Derivatives of f(*changes) at zero by each change, central differences."""
    columns = []
    for unit in np.eye(sum(sizes)):
        up, down = (f(*np.split(h * unit, np.cumsum(sizes)[:-1])) for h in (scale, -scale))
        columns.append((up - down) / (2 * scale))
    return np.split(np.array(columns).T, np.cumsum(sizes)[:-1], axis=1)


class Loop:
    """The loop of an aircraft as matrices."""

    def __init__(
        self, example: dict[str, Any], plant: Any, small: Any, mpc: Any, ekf: Any, start: Any
    ):
        self.example, sample = example, example["SAMPLE"]
        model, inner = plant.model, small.model
        nd, ne, nu = model.x.errors.size, inner.x.errors.size, model.u.size
        away = cc.difference
        calm, trim = plant.trim.x, plant.trim.u

        def moved(dx: Array) -> Array:
            return cc.retract(model, calm, dx).full()[:, 0]

        def held(x: Array, at: Array, command: Array) -> Array:
            loop = cc.closed_loop(
                plant.step,
                x,
                lambda *_: [trim + command],
                [0.0, sample],
                substeps=round(sample / example["FINE"]),
                actuators=plant.actuators,
                p=lambda _: np.zeros(1),
                u=trim + at,
            )
            return np.concatenate([loop.x[-1, 0], loop.u[-1, 0] - trim])

        still = np.zeros(nu)
        rested = held(calm, still, still)[:-nu]

        def flown(dx: Array, at: Array, command: Array) -> Array:
            after = held(moved(dx), at, command)
            return np.concatenate([away(model, rested, after[:-nu]).full()[:, 0], after[-nu:]])

        def read(dx: Array, at: Array) -> Array:
            return plant.read(moved(dx)[None], (trim + at)[None], np.zeros((1, 1)))[0]

        belief, readings = (start.state, start.factor), read(np.zeros(nd), still)
        for _ in range(SETTLED):
            ahead = ekf.predict(*belief, sample, trim)
            belief = ekf.update(*ahead, readings, trim)[:2]
        mean, spread = (np.array(part) for part in ahead)
        rest = mean[: inner.x.size, 0]
        others = mean[inner.x.size + 1 :, 0]

        def state(z: Array, about: Array = mean) -> Array:
            x = cc.retract(inner, about[: inner.x.size, 0], z[:ne]).full()[:, 0]
            return np.concatenate([x, about[inner.x.size, 0] + z[ne:], others])

        def error(found: Any, about: Array) -> Array:
            values = np.array(found)[:, 0]
            x = away(inner, about[: inner.x.size, 0], values[: inner.x.size]).full()[:, 0]
            return np.concatenate([x, [values[inner.x.size] - about[inner.x.size, 0]]])

        after = np.array(ekf.predict(mean, spread, sample, trim)[0])
        corrected = np.array(ekf.update(mean, spread, readings, trim)[0])

        def predicted(z: Array, u: Array) -> Array:
            return error(ekf.predict(state(z), spread, sample, trim + u)[0], after)

        def updated(z: Array, y: Array, u: Array) -> Array:
            found = ekf.update(state(z), spread, readings + y, trim + u)[0]
            return error(found, corrected)

        def asked(z: Array, last: Array) -> Array:
            mpc.reset(small.u + last)
            controller = example["Controller"](small, mpc)
            controller.wait(rest, 0.0)
            return controller.change(state(z)[: inner.x.size], float(z[ne]))

        self.sizes = nd, nu, ne + 1
        self.flown, self.read = slopes(flown, (nd, nu, nu)), slopes(read, (nd, nu))
        self.predicted = slopes(predicted, (ne + 1, nu))
        self.updated = slopes(updated, (ne + 1, len(readings), nu))
        self.asked = slopes(asked, (ne + 1, nu), 1e-4)

    def period(self, z: Array, held: Array) -> tuple[Array, Array]:
        """The columns z after a period in which `held` is commanded, and what is asked for.

        z holds the state, the deflections, the estimate, the last readings with their deflections,
        and the last command. The readings are one sample late.
        """
        nd, nu, nz = self.sizes
        (rx, ru), (px, pu), (ux, uy, uu) = self.read, self.predicted, self.updated
        (fx, fa, fc), (ax, al) = self.flown, self.asked
        ends = np.cumsum([nd, nu, nz, len(rx), nu])
        x, at, mean, late, then, last = np.split(z, ends)
        asked = last
        for k in range(round(self.example["DT"] / self.example["SAMPLE"])):
            mean = px @ mean + pu @ then
            mean = ux @ mean + uy @ late + uu @ then
            late, then = rx @ x + ru @ at, at
            if k == 0:
                asked = ax @ (px @ mean + pu @ at) + al @ last
            x, at = np.split(fx @ x + fa @ at + fc @ held, [nd])
        return np.concatenate([x, at, mean, late, then, held]), asked

    def margins(self) -> tuple[Array, float]:
        """Largest singular values of S at the frequencies, and the largest growth, 1/s.

        The growth is that of poles above `SLOW`: no input reaches the dutch roll, which is slower.
        """
        nd, nu, nz = self.sizes
        n = nd + nu + nz + len(self.read[0]) + 2 * nu
        a, c = self.period(np.eye(n), np.zeros((nu, n)))
        b, _ = self.period(np.zeros((n, nu)), np.eye(nu))
        values = np.log(np.linalg.eigvals(a + b @ c).astype(complex)) / self.example["DT"]
        growth = float(values.real[np.abs(values.imag) > SLOW].max())
        limits = np.array([*self.example["LIMITS"].values()])
        found = []
        for frequency in FREQUENCIES:
            turn = np.exp(1j * frequency * self.example["DT"])
            loop = c @ np.linalg.solve(turn * np.eye(n) - a, b)
            scaled = np.linalg.inv(np.eye(nu) - loop) * limits / limits[:, None]
            found.append(np.linalg.svd(scaled, compute_uv=False)[0])
        return np.array(found), growth


def margins() -> Table:
    """Largest sensitivity of the example, of some of its aircraft."""
    example = runpy.run_path(str(EXAMPLE))
    small = example["flyer"]("model", **example["MODEL"])
    mpc, (ekf, start) = example["make_mpc"](small), example["make_filter"](small)
    native = {k: cc.compile_function(getattr(ekf, k), derivatives=0) for k in ("predict", "update")}
    ekf = replace(ekf, **native)
    checks = []
    for seed in SEEDS:
        loop = Loop(example, example["Plant"](seed), small, mpc, ekf, start)
        values, growth = loop.margins()
        where = FREQUENCIES[values.argmax()]
        what = f"aircraft {seed}, at {where:.1f} rad/s"
        checks.append(Check(what=what, value=float(values.max()), high=2.5, form="{:.2f}"))
        what = f"aircraft {seed}, growth of its poles, 1/s"
        checks.append(Check(what=what, value=growth, high=0.0, form="{:.2f}"))
    notes = ("With 2 each input alone may change by factors of 0.67 to 2, or by 29° in phase.",)
    return checked("Free flight: largest sensitivity at the inputs", checks, notes)
