"""Studies: gust encounters of a wing over speeds, gusts, stiffness and mass, from TOML."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from curvcasadi.aero.gust import GustEntry
from curvcasadi.aero.lag_states import IndicialLag
from curvcasadi.aircraft.parts import Wing
from curvcasadi.beam.along import mapped
from curvcasadi.beam.section import COUPLINGS, RIGIDITIES
from curvcasadi.control.model import ControlModel
from curvcasadi.control.stability import stable_step
from curvcasadi.control.steady import SteadyStates
from curvcasadi.control.step import rk4_step
from curvcasadi.control.wing_model import wing_model
from curvcasadi.files import toml_reader as toml
from curvcasadi.files.toml_reader import Key, Keys
from curvcasadi.files.wing import WingFile, load_wing
from curvcasadi.symbolic.batch import compile_batch
from curvcasadi.symbolic.expressions import Array

STUDY = Keys(
    place="a study file",
    meaning="Every combination of speeds, gusts, stiffness and mass factors of one wing, for "
    "`curvcasadi sweep`: the wing flies level in steady flow, meets a 1 − cos gust, and the "
    "largest deflection and loads are kept.",
    required={
        "wing": Key(toml.TEXT, "wing file with [aerodynamics], its place relative to this file"),
        "cases": Key(toml.table_of("airspeeds"), "what is varied"),
        "simulation": Key(toml.table_of("density", "duration", "step"), "air and time"),
    },
)
_FACTORS = "factors on {} of the whole wing"
CASES = Keys(
    place="[cases]",
    meaning="Lists, of which every combination is a case.",
    required={
        "airspeeds": Key(toml.NUMBERS, "true airspeeds", "m/s"),
        "gust_lengths": Key(toml.NUMBERS, "of the gust, from its beginning to its end", "m"),
        "gust_amplitudes": Key(toml.NUMBERS, "largest velocities of the air, upward", "m/s"),
    },
    optional={
        "stiffness_factors": Key(toml.NUMBERS, _FACTORS.format("the stiffness"), default="`[1]`"),
        "mass_factors": Key(toml.NUMBERS, _FACTORS.format("mass and inertia"), default="`[1]`"),
    },
)
SIMULATION = Keys(
    place="[simulation] of a study",
    meaning="Air, time, and what the model of the wing is made of.",
    required={
        "density": Key(toml.NUMBER, "of the air", "kg/m³"),
        "duration": Key(toml.NUMBER, "time that is simulated, the gust begins at its start", "s"),
        "step": Key(toml.NUMBER, "of the classical Runge–Kutta method", "s"),
    },
    optional={
        "pitch": Key(toml.NUMBER, "of the root, nose-up", "rad", "`0`"),
        "damping": Key(toml.NUMBER, "the time β of damping C = β S", "s", "`0`"),
        "poles": Key(toml.WHOLE, "of the lag of circulation: 2, 3 or 4", default="`2`"),
        "modes": Key(toml.WHOLE, "functions along the span of the lag states", default="`3`"),
    },
)
#: Columns of a case, and of its result.
CASE_COLUMNS = ("airspeed", "gust_length", "gust_amplitude", "stiffness_factor", "mass_factor")
_MEASURED = ("tip_up", "root_moment_x", "root_moment_y", "root_moment_z")
RESULT_COLUMNS = tuple(f"{name}_{end}" for name in _MEASURED for end in ("largest", "smallest"))
#: Steps of a motion; more are a duration in another unit.
MOST_STEPS = 1_000_000
_DIVERGED = "the motion is not finite: use a smaller step, or the wing is unstable"


@dataclass(frozen=True, eq=False, kw_only=True)
class GustStudy:
    """Gust encounters of a wing: a function of rows of cases for `sweep`, with `batched=True`.

    Attributes
    ----------
    wing : WingFile
        The wing, with airfoil data.
    cases : array, shape (cases, 5)
        Airspeed, m/s, length, m, and amplitude, m/s, of the gust, factors on stiffness and mass.
    density, duration, step, pitch, damping, poles, modes : float or int
        As in the table [simulation] of a study file.
    """

    wing: WingFile
    cases: Array
    density: float
    duration: float
    step: float
    pitch: float = 0.0
    damping: float = 0.0
    poles: int = 2
    modes: int = 3

    def __call__(self, rows: Sequence[Array]) -> list[Any]:
        """Results of cases.

        Parameters
        ----------
        rows : sequence of arrays, shape (5,)
            Rows of `cases`.

        Returns
        -------
        list of arrays, shape (8,)
            Largest and smallest place of the tip, upward in body axes, m, and moments on the root,
            N m; an exception for a case that has no such numbers.
        """
        table = np.asarray(rows, dtype=float)
        results = np.full((len(table), len(RESULT_COLUMNS)), np.nan)
        for stiffness, mass in sorted({(row[3], row[4]) for row in table}):
            chosen = np.all(table[:, 3:] == (stiffness, mass), axis=1)
            results[chosen] = self._of_one_wing(table[chosen], stiffness, mass)
        finite = np.all(np.isfinite(results), axis=1)
        return [
            row if ok else ArithmeticError(_DIVERGED)
            for row, ok in zip(results, finite, strict=True)
        ]

    def _of_one_wing(self, table: Array, stiffness: float, mass: float) -> Array:
        """Results (cases, 8) of cases with the same factors, all at once."""
        model = wing_model(
            self._wing(stiffness, mass),
            density=self.density,
            lag=IndicialLag(poles=self.poles, modes=self.modes),
            damping=self.damping,
            gust=GustEntry(modes=self.modes),
            outputs=("tip_position", "root_moment"),
        )
        speed, length, amplitude = table[:, :3].T
        values = {"airspeed": speed, "pitch": np.full(len(table), self.pitch), "gust": 0 * speed}
        p = np.stack([values[part.name] for part in model.p.parts], axis=1)
        gust, u = model.p.slices["gust"].start, np.zeros(model.u.size)
        self._refuse_unstable(model, u, p[0])
        step, output = (compile_batch(f) for f in (rk4_step(model, self.step), model.output))
        x = self._steady(model, u, p)
        largest = smallest = output(x, u, p)
        for k in range(round(self.duration / self.step)):
            phase = (k + 0.5) * self.step * speed / length
            wave = amplitude / 2 * (1 - np.cos(2 * np.pi * phase))
            p[:, gust] = np.where(phase <= 1, wave, 0.0)
            step(x, u, p, out=[x])
            measured = output(x, u, p)
            largest, smallest = np.maximum(largest, measured), np.minimum(smallest, measured)
        up, down = -smallest[:, 2], -largest[:, 2]  # z of body axes is down
        columns = [up, down]
        for i in range(3, 6):
            columns += [largest[:, i], smallest[:, i]]
        return np.stack(columns, axis=1)

    def _refuse_unstable(self, model: ControlModel, u: Array, p: Array) -> None:
        """Refuse steps with which the fastest mode grows, even if it stays among the numbers."""
        limit, frequency = stable_step(model, np.zeros(model.x.size), u, p)
        if self.step > limit:
            raise ValueError(
                f"step: expected at most {limit:.3g} s, as the highest frequency is "
                f"{frequency:.4g} rad/s, found {self.step:g} s"
            )

    def _steady(self, model: ControlModel, u: Array, p: Array) -> Array:
        """States (cases, nx) of steady flight; NaN where there is none."""
        if model.second_order is None:
            raise ValueError(f"model: expected one with inertia, found {model.name!r}")
        steady = SteadyStates(model, model.second_order)
        states = np.full((len(p), model.x.size), np.nan)
        start, speeds = np.zeros(model.x.size), p[:, model.p.slices["airspeed"].start]
        for speed in np.unique(speeds):
            rows = speeds == speed
            found = steady.settle(start, u, p[rows][0])
            if found is not None:
                states[rows] = start = found[0]
        return states

    def _wing(self, stiffness: float, mass: float) -> Wing:
        """The wing with factors on the stiffness and the mass of its section."""
        file = self.wing
        section = file.beam.section
        if section is None or file.strips is None:
            raise ValueError("wing: expected a wing file with [section] and [aerodynamics]")
        factors = dict.fromkeys((*RIGIDITIES, *COUPLINGS), stiffness)
        factors |= dict.fromkeys(("mass_per_length", "inertia"), mass)
        changed = {
            name: mapped(getattr(section, name), partial(_times, factor))
            for name, factor in factors.items()
        }
        beam = replace(file.beam, section=replace(section, **changed))
        return Wing(name="wing", beam=beam, strips=file.strips)


def _times(factor: float, value: Any) -> Any:
    return factor * np.asarray(value) if isinstance(value, (list, tuple)) else factor * value


def load_study(path: str | Path) -> GustStudy:
    """Gust encounters that a study file describes.

    Parameters
    ----------
    path : str or Path
        Study file; SI units, radians.

    Returns
    -------
    GustStudy
        A function of rows of its own `cases`, for `sweep`.

    Raises
    ------
    ValueError
        If the file, or its wing file, is not what it should be: names the place.
    OSError
        If one cannot be read.
    """
    file = toml.load_table(path)
    values = file.read(STUDY)
    wing = load_wing(Path(path).parent / values["wing"])
    if wing.strips is None or wing.beam.section is None:
        raise file.error(
            f"wing: expected a wing file with [section] and [aerodynamics], found {values['wing']}"
        )
    lists = {"stiffness_factors": [1.0], "mass_factors": [1.0]} | file.table("cases").read(CASES)
    for key, entries in lists.items():
        positive = key != "gust_amplitudes"
        if not entries or (positive and min(entries) <= 0):
            what = "numbers above zero" if positive else "numbers"
            raise file.table("cases").error(f"{key}: expected {what}, found {entries}")
    order = [f"{name}s" for name in CASE_COLUMNS]
    cases = np.array([*product(*(lists[key] for key in order))], dtype=float)
    table = file.table("simulation")
    settings = table.read(SIMULATION)
    for key in ("density", "duration", "step"):
        if settings[key] <= 0:
            raise table.error(f"{key}: expected a number above zero, found {settings[key]}")
    if not 1 <= settings["duration"] / settings["step"] <= MOST_STEPS:
        raise table.error(
            f"duration: expected 1 to {MOST_STEPS} steps of {settings['step']:g} s, found "
            f"{settings['duration']:g} s"
        )
    with table.owning_errors():
        IndicialLag(poles=settings.get("poles", 2), modes=settings.get("modes", 3))
    return GustStudy(wing=wing, cases=cases, **settings)
