"""Flights of the wing that the benchmarks estimate, and filters of their samples.

Wing: the HALE wing in a stream of 15 m/s, a flap, unsteady strips with two lag states, and gusts
that the filter estimates. Two IMUs, at half span and at the tip, and two strain gauges, at 100 Hz.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

import curvcasadi as cc
from curvcasadi.reference_wings import hale_wing
from curvcasadi.symbolic.expressions import Array

DT = 0.01  #: s
RUNS = 200
PITCH, AIRSPEED = 0.03, 15.0  #: rad, m/s
GUST_TIME = 1.0  #: s, in which a gust fades
#: Densities of the noise that drives q_dot, rad/(m s √s), and the gust, m/(s √s).
DENSITY = {"q_dot": 0.02, "lag": 0.05, "gust": 0.5}
#: Standard deviation of q_ddot about the model's, rad/(m s²).
ACCELERATION = 0.02
DEVIATION = {"q": 0.0005, "q_dot": 0.005, "lag": 0.02, "gust": 0.05}
_C, _S = float(np.cos(PITCH)), float(np.sin(PITCH))
ROOT = cc.RootMotion(
    pose=cc.Pose(rotation=[[_C, 0, _S], [0, 1, 0], [-_S, 0, _C]], position=[0, 0, 0]),
    gravity=[0, 0, 9.80665],
)
SENSORS = (
    *(cc.RateGyro(xi=xi, noise_density=1e-4, rate=1 / DT) for xi in (0.5, 1.0)),
    *(cc.Accelerometer(xi=xi, noise_density=2e-3, rate=1 / DT) for xi in (0.5, 1.0)),
    *(cc.StrainGauge(xi=xi, offset=[0, 0.05], noise=1e-5) for xi in (0.05, 0.4)),
)


def wing(stiffness: float = 1.0, mass: float = 1.0) -> cc.Wing:
    """The HALE wing with four weights and a flap, its stiffness and mass times a factor."""
    basis = cc.ChannelBasis(torsion=cc.Legendre(2), out_of_plane=cc.Legendre(2))
    beam = replace(hale_wing(grid=cc.Grid.lobatto(4)), basis=basis)
    section = replace(
        beam.section,
        **{key: stiffness * getattr(beam.section, key) for key in ("GJ", "EI_y", "EI_z")},
        mass_per_length=mass * beam.section.mass_per_length,
    )
    beam = replace(beam, section=section)
    flap = cc.ControlSurface(name="flap", lift=3.5, moment=-0.6, start=0.2, end=0.95)
    strips = cc.StripAerodynamics(
        chord=1.0, aerodynamic_center=0.25, lift_slope=2 * np.pi, controls=(flap,)
    )
    return cc.Wing(name="right", beam=beam, strips=strips)


def model(stiffness: float = 1.0, mass: float = 1.0) -> cc.ControlModel:
    """The wing in the stream."""
    return cc.wing_model(
        wing(stiffness, mass),
        density=0.0889,
        lag=cc.IndicialLag(poles=2, modes=1),
        gust=cc.GustEntry(kind="lag", modes=1),
        damping=0.01,
    )


def make(process: cc.ControlModel, **changes: Any) -> cc.ShapeEkf:
    """The filter on that model."""
    return cc.shape_ekf(wing().beam, SENSORS, process=_driven(process), root=ROOT, **changes)


def make_mhe(process: cc.ControlModel, **changes: Any) -> cc.ShapeMhe:
    """The moving-horizon estimator on that model."""
    driven = _driven(process)
    return cc.shape_mhe(wing().beam, SENSORS, process=driven, root=ROOT, dt=DT, **changes)


def _driven(model: cc.ControlModel) -> cc.ModelProcess:
    """The model with the noise that drives it."""
    return cc.ModelProcess(
        model=model,
        density=DENSITY,
        estimated={"gust": GUST_TIME},
        acceleration=ACCELERATION,
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class Flights:
    """True motions and what the sensors read, one a column."""

    x: Array  #: states (steps, nx, runs)
    gust: Array  #: (steps, runs)
    u: Array  #: (steps,), the same for all
    values: Array  #: (steps, m, runs)
    airspeed: float  #: m/s, of all

    def truth(self, layout: cc.Layout) -> Array:
        """What an estimator of this state should find, (steps, size, runs)."""
        rest = {"gust": self.gust, "airspeed": np.full_like(self.gust, self.airspeed)}
        names = [part.name for part in layout.parts if part.name in rest]
        return np.concatenate([self.x, *(rest[name][:, None] for name in names)], axis=1)

    def samples(self, run: int, known: Array) -> list[tuple[Array, dict[str, Any]]]:
        """Of one flight, as `run_mhe` takes them; a first one is missing, as are the readings at
        the start."""
        rows = [np.full(self.values.shape[1], np.nan), *self.values[:, :, run]]
        inputs = [{"u": u, "p": known} for u in (0.0, *self.u)]
        return list(zip(rows, inputs, strict=True))


def fly(
    process: cc.ControlModel,
    deviation: dict[str, float] = DEVIATION,
    *,
    steps: int,
    runs: int = RUNS,
    offset: Array | None = None,
    missing: float = 0.0,
    outliers: float = 0.0,
    native: bool = True,
    seed: int = 0,
    airspeed: float = AIRSPEED,
) -> Flights:
    """Truth from the model and the noise that estimators assume, and samples.

    Parameters
    ----------
    offset : error (n,) of the weights at the start instead of one drawn from `deviation`
    missing, outliers : shares of the samples; an outlier is off by 50 standard deviations or more
    native : compile all Functions
    airspeed : that of the truth, m/s
    """
    compiled = _compiled(native)
    step = compiled(cc.step_function(process, DT)).map(runs)
    n, nx = process.second_order.velocities, process.x.size  # type: ignore[union-attr]
    x, u, p = (ca.MX.sym(k, size) for k, size in (("x", nx), ("u", 1), ("p", 3)))
    a = ca.MX.sym("a", n)
    q_ddot = process.xdot(x, u, p)[n : 2 * n] + a
    ideal = cc.measure(SENSORS, wing().beam, x[:n], x[n : 2 * n], q_ddot, ROOT)
    read = compiled(ca.Function("read", [x, u, p, a], [ideal.values])).map(runs)

    rng = np.random.default_rng(seed)
    parts = [*process.x.parts, cc.Part("gust", 1, "m/s")]
    spread, strength = (
        np.concatenate([np.full(part.size, of.get(part.name, 0.0)) for part in parts])
        for of in (deviation, DENSITY)
    )
    strength *= np.sqrt(DT / 2)
    truth = spread[:, None] * rng.normal(size=(nx + 1, runs))
    if offset is not None:
        truth[:n] = offset[:, None]
    flown = np.tile([[airspeed], [PITCH]], runs)
    noise = ideal.noise[:, None]
    states, readings = [], []
    inputs = 0.05 * np.sin(2.0 * DT * np.arange(steps))
    for held in inputs:
        u_held = np.full((1, runs), held)
        truth = truth + strength[:, None] * rng.normal(size=truth.shape)
        given = np.vstack([flown, truth[nx:]])
        moved = step(truth[:nx], u_held, given)[0].full()
        truth = np.vstack([moved, np.exp(-DT / GUST_TIME) * truth[nx:]])
        truth = truth + strength[:, None] * rng.normal(size=truth.shape)
        given = np.vstack([flown, truth[nx:]])
        values = read(truth[:nx], u_held, given, ACCELERATION * rng.normal(size=(n, runs))).full()
        values += noise * rng.normal(size=values.shape)
        wrong = rng.random(values.shape) < outliers
        values += wrong * (50 + 50 * rng.random(values.shape)) * noise
        values[rng.random(values.shape) < missing] = np.nan
        states.append(truth)
        readings.append(values)
    both = np.array(states)
    return Flights(
        x=both[:, :nx],
        gust=both[:, nx],
        u=inputs,
        values=np.array(readings),
        airspeed=airspeed,
    )


def _compiled(native: bool) -> Callable[[ca.Function], ca.Function]:
    return (lambda f: cc.compile_function(f, derivatives=0)) if native else (lambda f: f)


@dataclass(frozen=True, eq=False, kw_only=True)
class Runs:
    """Monte Carlo runs, all at once."""

    nees: Array  #: (steps, runs)
    nis: Array  #: over the number of samples, (steps, runs)
    dof: Array  #: (steps, runs)
    size: int  #: of the error state
    tip: Array  #: distance of the estimated tip from the true one, m, (steps, runs)


def filtered(
    ekf: cc.ShapeEkf, flights: Flights, deviation: dict[str, float], *, native: bool = True
) -> Runs:
    """A filter of the samples of flights, at AIRSPEED unless it estimates that."""
    steps, _, runs = flights.x.shape
    predict, update = (_compiled(native)(f).map(runs) for f in (ekf.predict, ekf.update))
    tip = cc.tip_function(wing().beam).map(runs)
    n, size = wing().beam.basis.n, ekf.error_layout.size
    known = {"airspeed": AIRSPEED, "pitch": PITCH}
    means = {key: [known[key]] for key in ekf.layout.slices if key in known}
    at = ekf.initial(deviation, means)
    state, factor = np.tile(at.state[:, None], runs), np.tile(at.factor, runs)
    p = np.tile([[known[part.name]] for part in ekf.inputs["p"].parts], runs)
    found: dict[str, list[Array]] = {key: [] for key in ("nees", "nis", "dof", "tip")}
    truths = flights.truth(ekf.layout)
    for k in range(steps):
        u, truth = np.full((1, runs), flights.u[k]), truths[k]
        state, factor = predict(state, factor, np.full((1, runs), DT), u, p)
        result = [value.full() for value in update(state, factor, flights.values[k], u, p)]
        state, factor = result[:2]
        factors = factor.reshape(size, runs, size).transpose(1, 0, 2)
        d = np.einsum("rii->ri", factors)
        unit = np.triu(factors, 1) + np.eye(size)
        whitened = np.linalg.solve(unit, (state[:size] - truth).T[..., None])[..., 0]
        found["nees"].append((whitened**2 / d).sum(axis=1))
        found["nis"].append(result[4][0])
        found["dof"].append(result[5][0])
        tips = [tip(value[:n])[0].full() for value in (state, truth)]
        found["tip"].append(np.linalg.norm(tips[0] - tips[1], axis=0))
    return Runs(**{key: np.array(values) for key, values in found.items()}, size=size)


def simulate(
    process: cc.ControlModel,
    ekf: cc.ShapeEkf,
    deviation: dict[str, float],
    *,
    native: bool = True,
    **changes: Any,
) -> Runs:
    """A filter of the samples of flights of `process`, which `fly` describes."""
    flights = fly(process, deviation, native=native, **changes)
    return filtered(ekf, flights, deviation, native=native)
