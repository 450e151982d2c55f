"""The plant on the host, and the same controller in Python as codegen/firmware/controller.c."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import casadi as ca
import numpy as np

import curvcasadi as cc
from codegen.loop.case import (
    AIRSPEED,
    GUST,
    MISSING,
    PATIENCE,
    PERIOD,
    PITCH,
    PLANT_STEPS,
    ROOT,
    SENSORS,
    STAGES,
    Case,
)
from curvcasadi.symbolic.expressions import Array

#: Samples of a period -> inputs of the period.
Controller = Callable[[Array], Array]


@dataclass(frozen=True, eq=False, kw_only=True)
class Flight:
    """A flight through the gust.

    Attributes
    ----------
    t : array, shape (T,)
        Times of the periods, s.
    bending : array, shape (T,)
        Out-of-plane bending moment at the root less that of steady flight, N m.
    u : array, shape (2, T)
        Deflections of the flaps, rad.
    """

    t: Array
    bending: Array
    u: Array

    @property
    def peak(self) -> float:
        """The largest deviation of the bending moment, N m."""
        return float(np.abs(self.bending).max())


class Plant:
    """The nonlinear wing and its sensors."""

    def __init__(self, case: Case) -> None:
        self.case = case
        model = case.plant
        self.step = cc.compile_function(
            cc.step_function(model, PERIOD / PLANT_STEPS, method="implicit_midpoint"),
            derivatives=0,
        )
        q, q_dot = (ca.MX.sym(name, 9) for name in ("q", "q_dot"))
        values = cc.measure(SENSORS, case.wing.beam, q, q_dot, root=ROOT).values
        self.read = cc.compile_function(ca.Function("read", [q, q_dot], [values]), derivatives=0)
        self.noise = case.filter.channels.noise

    def fly(self, controller: Controller, periods: int, seed: int = 1) -> Flight:
        """From steady flight; the gust comes as it is written in the case."""
        random = np.random.default_rng(seed)
        x = self.case.trim
        row = self.case.wing.beam.basis(0.0)[1]
        stiffness = float(self.case.wing.beam.section.stiffness(0.0)[1, 1])
        bending, inputs = [], []
        for k in range(periods):
            measured = self.read(x[:9], x[9:18]).full().ravel()
            measured = measured + self.noise * random.standard_normal(measured.size)
            if k in MISSING:
                measured[:] = np.nan
            u = controller(measured)
            bending.append(stiffness * float(row @ (x - self.case.trim)[:9]))
            inputs.append(u)
            h = PERIOD / PLANT_STEPS
            for i in range(PLANT_STEPS):
                gust = float(GUST(k * PERIOD + (i + 0.5) * h))
                x, residual = self.step(x, u, [AIRSPEED, PITCH, gust])
                x = x.full().ravel()
                if not float(residual) < 1e-8:
                    raise RuntimeError("the plant's step does not converge")
        return Flight(
            t=PERIOD * np.arange(periods), bending=np.array(bending), u=np.array(inputs).T
        )


@dataclass(eq=False)
class HostController:
    """The controller in double precision: update, optimize, predict.

    `source` holds where every input came from, as `controller_source` in C.
    """

    case: Case
    source: list[int] = field(default_factory=list)

    def __post_init__(self) -> None:
        case = self.case
        self.state, self.factor = case.start.state, case.start.factor
        self.mpc = case.controller
        self.mpc.reset()
        self.deviation = case.deviation
        self.blind = 0
        self.applied = np.zeros(2)

    def __call__(self, measured: Array) -> Array:
        ekf = self.case.filter
        updated = ekf.update(self.state, self.factor, measured, self.applied)
        self.state, self.factor = updated[0], updated[1]
        self.blind = 0 if float(updated[-1]) > 0 else self.blind + 1
        if self.blind > PATIENCE:
            self.applied, source = np.zeros(2), 2
            self.mpc.reset()
        else:
            z, gust = (part.full() for part in self.deviation(self.state))
            step = self.mpc.step(z.ravel(), preview={"gust": gust})
            self.applied, source = step.u, 0 if step.success else 1
        self.source.append(source)
        self.state, self.factor = ekf.predict(self.state, self.factor, PERIOD, self.applied)
        return self.applied


def still(measured: Array) -> Array:
    """No controller: flaps as in steady flight."""
    return np.zeros(2)


def data_header(case: Case) -> str:
    """What the controller in C begins with: controller_data.h."""
    start = case.start
    weights = ca.DM(start.factor)
    factor = weights.nonzeros() if weights.is_triu() else ca.triu(weights).nonzeros()
    reference = np.zeros((case.controller.function.size1_in("reference"), STAGES))
    arrays: dict[str, Any] = {
        "controller_state[CURV_EKF_UPDATE_N_STATE]": np.ravel(start.state),
        "controller_factor[CURV_EKF_UPDATE_N_FACTOR]": factor,
        "controller_trim[CONTROLLER_INPUTS]": np.zeros(2),
        "controller_reference[CURV_MPC_N_REFERENCE]": reference.ravel(order="F"),
    }
    suffix = "F" if case.real == "float" else ""
    lines = [
        "#ifndef CONTROLLER_DATA_H",
        "#define CONTROLLER_DATA_H",
        '#include "curv.h"',
        "/* Inputs of update and predict beside state, factor and samples. */",
        "#define UPDATE_INPUTS applied,",
        "#define PREDICT_INPUTS",
        f"static const curv_real controller_period = {PERIOD!r}{suffix};",
    ]
    for name, values in arrays.items():
        numbers = ", ".join(_literal(float(value), suffix) for value in values)
        lines.append(f"static const curv_real {name} = {{{numbers}}};")
    return "\n".join([*lines, "#endif", ""])


def _literal(value: float, suffix: str) -> str:
    text = f"{value:.9g}" if suffix else repr(value)
    return (text if "." in text or "e" in text else f"{text}.0") + suffix
