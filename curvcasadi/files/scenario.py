"""Motions that wing files describe: the table `[simulation]`.

Errors are those of wing files: `path: [table] key: expected …, found …`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from curvcasadi.beam.beam import Beam
from curvcasadi.control.beam_model import beam_model
from curvcasadi.control.damping import modal_damping
from curvcasadi.control.model import ControlModel
from curvcasadi.control.simulation import Simulation, simulate
from curvcasadi.files import toml_reader as toml
from curvcasadi.files.timed_load import TimedLoad, read_timed
from curvcasadi.files.toml_reader import Key, Keys
from curvcasadi.files.wing import read_wing
from curvcasadi.kinematics.weights import check_angles
from curvcasadi.statics.equilibrium import solve_equilibrium
from curvcasadi.symbolic.expressions import Array

#: Integrators that a file may ask for.
METHODS = ("implicit_midpoint", "rk4", "cvodes")
#: Shapes that have a name.
STARTS = ("unloaded", "equilibrium")
SIMULATION = Keys(
    place="[simulation]",
    meaning="A motion of the wing for `curvcasadi simulate`: the loads of the file act all the "
    "time, those of [[simulation.loads]] by their tables. There is no air in it.",
    required={"duration": Key(toml.NUMBER, "time that is simulated", "s")},
    optional={
        "start": Key(
            toml.TEXT | toml.NUMBERS,
            "shape at time 0: `unloaded`, `equilibrium` under the loads at time 0, or the weights",
            "rad/m",
            '`"unloaded"`',
        ),
        "rates": Key(toml.NUMBERS, "rates of the weights at time 0", "rad/(m s)", "at rest"),
        "interval": Key(toml.NUMBER, "between the samples that are written", "s", "`0.02`"),
        "step": Key(toml.NUMBER, "longest step of the integrator", "s", "`0.005`"),
        "method": Key(
            toml.TEXT,
            f"one of {', '.join(f'`{name}`' for name in METHODS)}; steps of `rk4` must be far "
            "shorter, `cvodes` chooses its own",
            default='`"implicit_midpoint"`',
        ),
        "newton": Key(
            toml.FLAG,
            "Newton's iteration in implicit steps, for motions that do not converge otherwise",
            default="`false`",
        ),
        "damping": Key(
            toml.NUMBER,
            "time β of the structural damping C = β S: a mode of frequency ω has the ratio β ω/2",
            "s",
            "`0`",
        ),
        "damping_ratios": Key(
            toml.ONE_OR_EACH,
            "instead, damping ratios: of all modes of the wing at its start, or of the first ones",
            default="by damping",
        ),
        "loads": Key(toml.TABLES, "loads that change with time", default="none"),
    },
)


@dataclass(frozen=True, eq=False, kw_only=True)
class Scenario:
    """A motion that a wing file describes.

    Attributes
    ----------
    beam : Beam
        The wing.
    loads : tuple of loads
        Loads that act all the time.
    timed : tuple of TimedLoad
        Loads that change with time.
    start : dict of str to array
        Weights `q`, rad/m, and rates `q_dot`, rad/(m s), at time 0.
    times : array, shape (T,)
        Times of the samples, s.
    step : float
        Longest step of the integrator, s.
    method : str
        Integrator, as of `simulate`.
    damping : float or array, shape (n, n)
        As of `beam_model`.
    newton : bool
        As of `simulate`.
    """

    beam: Beam
    loads: tuple[Any, ...]
    timed: tuple[TimedLoad, ...]
    start: Mapping[str, Array]
    times: Array
    step: float
    method: Any
    damping: Any
    newton: bool = False

    @property
    def model(self) -> ControlModel:
        """The wing as a control model; its inputs are the factors of the timed loads."""
        names = [f"load_{k}_factor" for k in range(1, len(self.timed) + 1)]
        symbols = {name: ca.MX.sym(name) for name in names}
        pairs = zip(self.timed, symbols.values(), strict=True)
        loads = [*self.loads, *(timed.scaled(factor) for timed, factor in pairs)]
        return beam_model(self.beam, loads, inputs=symbols, damping=self.damping)


def simulate_scenario(scenario: Scenario, *, progress: bool = False) -> Simulation:
    """The motion of a scenario.

    Parameters
    ----------
    scenario : Scenario
        As `load_scenario` reads it.
    progress : bool
        Show a progress bar.

    Returns
    -------
    Simulation
        Motion at the times of the scenario.

    Raises
    ------
    ConvergenceError
        As `simulate`.
    """
    return simulate(
        scenario.model,
        scenario.start,
        scenario.times,
        u=(lambda t: [timed.factor(t) for timed in scenario.timed]) if scenario.timed else None,
        method=scenario.method,
        dt=scenario.step,
        newton=scenario.newton,
        progress=progress,
    )


def load_scenario(path: str | Path, **changes: Any) -> Scenario:
    """Motion of a wing file with the table [simulation].

    Parameters
    ----------
    path : str or Path
        Wing file; SI units, radians.
    **changes
        Keys of [simulation] that replace those of the file, or stand in for the table; and
        `more_loads`, a sequence of loads beside those of the file.

    Returns
    -------
    Scenario
        Ready for `simulate_scenario`.

    Raises
    ------
    ValueError
        As `load_wing`; for wrong values in [simulation], and for a file with an airstream.
    ConvergenceError
        If there is no equilibrium to start from.
    OSError
        If a file cannot be read.
    """
    file = toml.load_table(path)
    wing = read_wing(file)
    if "airstream" in file.content:
        raise file.error(
            "airstream: expected a wing without one, as its air would not follow the motion; "
            "found [airstream]. In Python `wing_model` has unsteady air"
        )
    further = tuple(changes.pop("more_loads", ()))
    content = file.content.get("simulation", {})
    if not isinstance(content, dict):  # WING has refused it
        raise file.error("simulation: expected a table")
    if not content and "duration" not in changes:
        raise file.error("simulation: expected a table [simulation] with duration, found none")
    table = toml.Table(file.path, "simulation", {**content, **changes})
    values = table.read(SIMULATION)
    for name in ("duration", "interval", "step"):
        if name in values and not values[name] > 0:
            raise table.error(f"{name}: expected a time above zero, s, found {values[name]:g}")
    loads = (*wing.loads, *further)
    timed = tuple(read_timed(entry) for entry in table.tables("loads"))
    acting = [*loads, *(entry.scaled(entry.factor(0.0)) for entry in timed)]
    start = _start(table, values, wing.beam, acting)
    return Scenario(
        beam=wing.beam,
        loads=loads,
        timed=timed,
        start=start,
        times=_times(table, values["duration"], values.get("interval", 0.02)),
        step=values.get("step", 0.005),
        method=table.one_of("method", METHODS) if "method" in values else METHODS[0],
        damping=_damping(table, values, wing.beam, start["q"], acting),
        newton=values.get("newton", False),
    )


#: Samples of a motion; more are a duration in another unit.
MOST_SAMPLES = 1_000_000


def _times(table: toml.Table, duration: float, interval: float) -> Array:
    """Multiples of the interval, and the end."""
    if interval > duration:
        raise table.error(
            f"interval: expected no more than the duration of {duration:g} s, found {interval:g}"
        )
    if duration > MOST_SAMPLES * interval:
        raise table.error(
            f"duration: expected at most {MOST_SAMPLES} intervals of {interval:g} s, found "
            f"{duration:g} s"
        )
    whole = np.arange(int(np.floor(duration / interval * (1 + 1e-12))) + 1) * interval
    if duration - whole[-1] > 1e-9 * duration:
        return np.append(whole, duration)
    return np.append(whole[:-1], duration)


def _start(
    table: toml.Table, values: Mapping[str, Any], beam: Beam, acting: list[Any]
) -> dict[str, Array]:
    """Weights and rates at time 0; `acting` are the loads of that time."""
    n = beam.basis.n
    start = values.get("start", STARTS[0])
    for key, found in (("start", start), ("rates", values.get("rates", [0.0] * n))):
        if isinstance(found, list) and len(found) != n:
            labels = ", ".join(beam.basis.labels)
            raise table.error(f"{key}: expected {n} numbers ({labels}), found {len(found)}")
    q = np.zeros(n)
    if isinstance(start, list):
        q = np.array(start, dtype=float)
        with table.owning_errors():
            check_angles(beam, ca.DM(q), "start")
    elif "start" in values and table.one_of("start", STARTS) == "equilibrium" and acting:
        q = solve_equilibrium(beam, acting).q.full().ravel()
    return {"q": q, "q_dot": np.array(values.get("rates", np.zeros(n)), dtype=float)}


def _damping(
    table: toml.Table, values: Mapping[str, Any], beam: Beam, q: Array, loads: list[Any]
) -> Any:
    if "damping_ratios" not in values:
        if values.get("damping", 0.0) < 0:
            raise table.error(
                f"damping: expected a time of at least zero, s, found {values['damping']:g}"
            )
        return values.get("damping", 0.0)
    if "damping" in values:
        raise table.error("damping_ratios: expected no damping beside it, found both")
    try:
        return modal_damping(beam, values["damping_ratios"], q, loads)
    except ValueError as error:
        raise table.error(f"damping_ratios: {error}") from None
