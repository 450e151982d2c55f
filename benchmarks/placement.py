"""Fits of a shape to sensors against their predicted errors, and placements against the optimum."""

from __future__ import annotations

import casadi as ca
import numpy as np
from scipy.spatial.transform import Rotation
from scipy.stats import kstest

import curvcasadi as cc
from benchmarks.table import Check, Table, checked
from curvcasadi.reference_wings import hale_wing
from curvcasadi.symbolic.expressions import Array

WING = hale_wing(torsion=2, out_of_plane=2, in_plane=2)
HALF_DEGREE = float(np.deg2rad(0.5))
PRIOR = 0.02
FITS, OUTLIER_FITS, WINGS = 1000, 100, 10


def fits() -> Table:
    """Monte Carlo of attitude sensors on the HALE wing under 1 g."""
    q = _loaded()
    four, ten = _attitudes((0.25, 0.5, 0.75, 1.0)), _attitudes(np.linspace(0.1, 1, 10))
    random = np.random.default_rng(11)
    found = [cc.fit_shape(WING, four, _measured(four, q, random)) for _ in range(FITS)]
    errors = np.array([fit.q.full().ravel() for fit in found]) - q
    tips, _ = cc.tip_function(WING).map(FITS)(ca.horzcat(*(fit.q for fit in found)))
    covariance = np.linalg.inv(cc.information_matrix(WING, four, q))
    tip = cc.shape_deviations(WING, q, covariance, [1.0]).position[:, 0]
    of_weights = np.std(errors, axis=0) / np.sqrt(np.diag(covariance))
    of_tip = np.std(tips.full(), axis=1) / tip

    robust = {loss: _error_with_outliers(ten, q, loss) for loss in ("squared", "cauchy")}
    setting = "four attitude sensors of 0.5°, six weights"
    return checked(
        "Fits of a shape: HALE wing under 1 g",
        [
            *_range(f"{setting}: deviation of the weights over the predicted one", of_weights),
            *_range("the same of the tip position", of_tip),
            Check(
                what="p of Kolmogorov and Smirnov for uniform p-values of χ²",
                value=float(kstest([fit.p_value for fit in found], "uniform").pvalue),
                low=0.01,
            ),
            Check(
                what="tip at 31 % of the span, from straight: error over its deviation, largest",
                value=_far_from_straight(four),
                high=4.0,
            ),
            Check(
                what="2 of 10 sensors wrong, Cauchy: error over the predicted one of clean data",
                value=robust["cauchy"],
                high=1.5,
            ),
            Check(what="the same with least squares", value=robust["squared"]),
        ],
        notes=(f"{FITS} fits, {OUTLIER_FITS} with outliers; root mean squares.",),
    )


def placements() -> Table:
    """Greedy choices against the best of all sets, on wings of random shapes and sensors."""
    ratios, guarantees, gains = [], [], []
    for seed in range(WINGS):
        random = np.random.default_rng(seed)
        shapes = random.normal(_loaded(), PRIOR, size=(8, 6))
        candidates = _candidates(random)
        greedy, exact = (
            cc.place_sensors(WING, candidates, 4, shapes=shapes, prior=PRIOR, method=method)
            for method in ("greedy", "exact")
        )
        ratios.append(greedy.gain / exact.gain)
        guarantees.append(greedy.guarantee)
        gains.append(exact.gain)
    return checked(
        "Placement of sensors: 4 of 40 candidates, 91 390 sets",
        [
            Check(
                what="gain of greedy over that of the optimum, least",
                value=min(ratios),
                low=0.95,
                form="{:.4f}",
            ),
            Check(
                what="what greedy guarantees of its own choice, least",
                value=min(guarantees),
                low=1 - 1 / np.e,
                form="{:.3f}",
            ),
            Check(what="gain of the optimum in log-determinant, mean, nats", value=np.mean(gains)),
        ],
        notes=(
            f"{WINGS} sets of candidates: attitude sensors, strain gauges and markers at random "
            "stations, with noise that differs by up to ten times.",
        ),
    )


def _loaded() -> Array:
    found = cc.solve_equilibrium(WING, [cc.Gravity([0, 0, 9.81])]).q
    return np.asarray(found.full().ravel())


def _attitudes(stations: object) -> list[cc.AttitudeSensor]:
    return [cc.AttitudeSensor(xi=xi, noise=HALF_DEGREE) for xi in np.ravel(stations)]


def _measured(
    sensors: list[cc.AttitudeSensor], q: Array, random: np.random.Generator, wrong: int = 0
) -> Array:
    """Attitudes with noise, `wrong` of them turned by a radian or so about a random axis."""
    exact = cc.measure(sensors, WING, ca.DM(q)).values.full().reshape(-1, 3, 3)
    turns = random.normal(scale=HALF_DEGREE, size=(len(sensors), 3))
    outliers = random.choice(len(sensors), wrong, replace=False)
    turns[outliers] = random.normal(size=(wrong, 3))
    # Values come by columns: transposed, the noise stands on the left.
    noise = Rotation.from_rotvec(turns).as_matrix().transpose(0, 2, 1)
    return np.asarray((noise @ exact).ravel())


def _error_with_outliers(sensors: list[cc.AttitudeSensor], q: Array, loss: str) -> float:
    random = np.random.default_rng(6)
    information = cc.information_matrix(WING, sensors, q)
    squares = []
    for _ in range(OUTLIER_FITS):
        fit = cc.fit_shape(WING, sensors, _measured(sensors, q, random, 2), loss=loss)
        error = fit.q.full().ravel() - q
        squares.append(error @ information @ error / q.size)
    return float(np.sqrt(np.mean(squares)))


def _far_from_straight(sensors: list[cc.AttitudeSensor]) -> float:
    random, largest = np.random.default_rng(1), 0.0
    for sign in (-1, 1):
        truth = np.array([0.01, 0, sign * 0.04, 0, 0, 0])
        for _ in range(10):
            fit = cc.fit_shape(WING, sensors, _measured(sensors, truth, random))
            errors = np.abs(fit.q.full().ravel() - truth) / fit.deviations
            largest = max(largest, float(np.max(errors)))
    return largest


def _candidates(
    random: np.random.Generator,
) -> list[cc.AttitudeSensor | cc.StrainGauge | cc.Marker]:
    def noise(size: float) -> float:
        return float(size * 10 ** random.uniform(-0.5, 0.5))

    return [
        *(cc.AttitudeSensor(xi=xi, noise=noise(HALF_DEGREE)) for xi in random.uniform(0.05, 1, 20)),
        *(
            cc.StrainGauge(xi=xi, offset=random.uniform(-0.1, 0.1, 2), noise=noise(2e-5))
            for xi in random.uniform(0, 0.9, 10)
        ),
        *(
            cc.Marker(xi=xi, offset=[0, 0.2, 0], noise=noise(0.05))
            for xi in random.uniform(0.1, 1, 10)
        ),
    ]


def _range(what: str, ratios: Array) -> list[Check]:
    limits = {"low": 0.9, "high": 1.1, "form": "{:.3f}"}
    return [
        Check(what=f"{what}, {name}", value=float(extreme(ratios)), **limits)
        for name, extreme in (("least", np.min), ("largest", np.max))
    ]
