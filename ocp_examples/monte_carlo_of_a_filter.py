"""Does a filter of the shape know how wrong it is? Four hundred flights at once answer.

    NEES = (x̂ − x)ᵀ P⁻¹ (x̂ − x),   E[NEES] = N   if the covariance P is that of the errors

Truth is drawn from the model that the filter assumes: white acceleration of the weights of the HALE
wing, and the noise of two markers that a tracker sees and of two rate gyros. Filters and sensors
are batches: each flight is a lane of a vector register. The band holds 95 % of averages over as
many flights.
"""

from pathlib import Path

import casadi as ca
import numpy as np
from matplotlib.figure import Figure
from scipy.stats import chi2

import curvcasadi as cc
from curvcasadi.reference_wings import hale_wing

FLIGHTS, STEPS, DT = 400, 100, 0.02  # s
DENSITY = 0.01  # of the white acceleration
DEVIATION = {"q": 0.002, "q_dot": 0.02}  # at the start
SENSORS = [
    cc.Marker(xi=0.5, noise=0.01),
    cc.Marker(xi=1.0, noise=0.01),
    cc.RateGyro(xi=0.5, noise_density=2e-3, rate=50),
    cc.RateGyro(xi=1.0, noise_density=2e-3, rate=50),
]


def readings(wing: cc.Beam) -> tuple[cc.Batch, np.ndarray]:
    """Ideal readings from weights and rates, and the deviation of their noise."""
    q, q_dot = ca.MX.sym("q", wing.basis.n), ca.MX.sym("q_dot", wing.basis.n)
    ideal = cc.measure(SENSORS, wing, q, q_dot)
    f = cc.function("readings", {"q": q, "q_dot": q_dot}, {"values": ideal.values})
    return cc.compile_batch(f), ideal.noise


def fly() -> tuple[np.ndarray, np.ndarray]:
    """NEES (STEPS, FLIGHTS), and errors of the first weight over their deviations."""
    rng, wing = np.random.default_rng(0), hale_wing(1, 2, 1)
    n = wing.basis.n
    ekf = cc.shape_ekf(wing, SENSORS, process="white_acceleration", density=DENSITY)
    predict, update = cc.compile_batch(ekf.predict), cc.compile_batch(ekf.update)
    read, noise = readings(wing)
    start = ekf.initial(DEVIATION)
    state = np.tile(start.state, (FLIGHTS, 1))
    factor = np.tile(start.factor, (FLIGHTS, 1, 1))
    x = state + rng.normal(size=state.shape) * np.sqrt(np.diag(start.covariance))
    root = np.linalg.cholesky([[DT**3 / 3, DT**2 / 2], [DT**2 / 2, DT]]) * DENSITY
    nees, errors = [], []
    for _ in range(STEPS):
        w = rng.normal(size=(2, FLIGHTS, n))
        x = np.hstack([x[:, :n] + DT * x[:, n:] + root[0, 0] * w[0],
                       x[:, n:] + root[1, 0] * w[0] + root[1, 1] * w[1]])  # fmt: skip
        z = read(x[:, :n], x[:, n:])
        z += noise * rng.normal(size=z.shape)
        state, factor = predict(state, factor, DT)
        state, factor, *_ = update(state, factor, z)
        d = np.einsum("rii->ri", factor)
        unit = np.triu(factor, 1) + np.eye(2 * n)
        whitened = np.linalg.solve(unit, (state - x)[..., None])[..., 0]
        nees.append((whitened**2 / d).sum(axis=1))
        variance = (unit[:, 0] ** 2 * d).sum(axis=1)
        errors.append((state - x)[:, 0] / np.sqrt(variance))
    return np.array(nees), np.array(errors)


def plot(nees: np.ndarray, errors: np.ndarray, band: np.ndarray, size: int) -> Figure:
    figure = Figure(figsize=(8, 3.4), layout="constrained")
    left, right = figure.subplots(1, 2)
    times = DT * (1 + np.arange(len(nees)))
    left.plot(times, nees.mean(axis=1) / size, color="black", lw=1.2)
    left.axhspan(*band, color="0.88")
    left.axhline(1, color="0.6", lw=0.8)
    left.set(xlabel="time [s]", ylabel=f"average NEES/{size} of {FLIGHTS} flights [1]")
    right.hist(errors.ravel(), bins=np.linspace(-4, 4, 41), density=True, color="0.8")
    bell = np.linspace(-4, 4, 200)
    right.plot(bell, np.exp(-(bell**2) / 2) / np.sqrt(2 * np.pi), color="C3")
    right.set(xlabel="error of the torsion over its deviation [1]", ylabel="density [1]")
    return figure


def main(directory: Path = Path("out")) -> tuple[float, np.ndarray]:
    nees, errors = fly()
    size = 2 * hale_wing(1, 2, 1).basis.n
    band = chi2.ppf([0.025, 0.975], size * FLIGHTS) / (size * FLIGHTS)
    ratio = nees.mean(axis=1) / size
    within = np.mean((ratio > band[0]) & (ratio < band[1]))
    print(f"NEES over its expectation: {ratio.mean():.3f}; {100 * within:.0f} % of the averages "
          f"of a time are within {band[0]:.3f} to {band[1]:.3f}")  # fmt: skip
    directory.mkdir(parents=True, exist_ok=True)
    cc.save_figure(plot(nees, errors, band, size), directory / "monte_carlo_of_a_filter.png")
    return float(ratio.mean()), band


if __name__ == "__main__":
    main()
