"""Information of sensors, and the choice of the most informative ones."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose

import curvcasadi as cc
from curvcasadi.plotting.placement import plot_placement
from curvcasadi.reference_wings import hale_wing

WING = hale_wing(2, 2, 2)
RNG = np.random.default_rng(0)
PRIOR = 0.03
SHAPES = RNG.normal([0, 0, -0.04, 0.02, 0, 0], 0.01, size=(6, 6))
RATES = 0.3 * SHAPES[::-1]
IMU = {"noise_density": 1e-3, "rate": 100.0}
GRAVITY = cc.RootMotion(gravity=[0, 0, 9.81])


def attitude(xi):
    return cc.AttitudeSensor(xi=xi, noise=np.deg2rad(0.5))


#: Forty: attitudes along the span, gauges above and below mid-chord, markers at the leading edge.
FORTY = [
    *(attitude(xi) for xi in np.linspace(0.05, 1, 20)),
    *(
        cc.StrainGauge(xi=xi, offset=[0.1 * (-1) ** i, 0.03], noise=2e-5)
        for i, xi in enumerate(np.linspace(0.02, 0.9, 10))
    ),
    *(cc.Marker(xi=xi, offset=[0, 0.2, 0], noise=0.05) for xi in np.linspace(0.1, 1, 10)),
]
FEW = [FORTY[i] for i in (3, 8, 12, 19, 20, 23, 29, 31, 35, 39)]


def gain(sensors, prior=PRIOR, wing=WING):
    """log det of prior and information over the prior, from the public function alone."""
    before = np.eye(6) / prior**2
    after = before + cc.information_matrix(wing, sensors, SHAPES) if sensors else before
    return np.linalg.slogdet(after)[1] - np.linalg.slogdet(before)[1]


# Information -----------------------------------------------------------------------------------


def test_information_is_the_mean_over_shapes_of_what_ad_gives():
    sensors = [*FEW, cc.RateGyro(xi=0.7, **IMU), cc.Accelerometer(xi=0.9, **IMU)]
    q, q_dot = ca.SX.sym("q", 6), ca.SX.sym("q_dot", 6)
    channels = cc.sensor_channels(sensors)
    measured = ca.SX.sym("measured", channels.layout.size)
    residual = cc.measurement_residual(sensors, WING, measured, q, q_dot, root=GRAVITY)
    values = cc.measure(sensors, WING, q, q_dot, root=GRAVITY).values
    both = ca.vertcat(q, q_dot)
    f = ca.Function("f", [q, q_dot, measured], [values, ca.jacobian(residual, both)])
    expected = np.zeros((12, 12))
    for shape, rate in zip(SHAPES, RATES, strict=True):
        exact, _ = f(shape, rate, 0)
        J = f(shape, rate, exact)[1].full() / channels.noise[:, None]
        expected += J.T @ J / len(SHAPES)
    options = {"rates": RATES, "root": GRAVITY}
    found = cc.information_matrix(WING, sensors, SHAPES, unknowns=("q", "q_dot"), **options)
    assert_allclose(found, expected, rtol=0, atol=1e-11 * np.max(expected))
    known = cc.information_matrix(WING, sensors, SHAPES, **options)
    assert_allclose(known, expected[:6, :6], rtol=0, atol=1e-11 * np.max(expected))


def test_information_of_independent_sensors_adds_up():
    parts = sum(cc.information_matrix(WING, [sensor], SHAPES[0]) for sensor in FEW)
    whole = cc.information_matrix(WING, FEW, SHAPES[0])
    assert_allclose(parts, whole, rtol=0, atol=1e-12 * np.max(whole))


def test_deviations_of_the_shape_are_those_of_sampled_shapes():
    q, rng = SHAPES[0], np.random.default_rng(2)
    factor = 1e-4 * rng.normal(size=(6, 6))
    covariance = factor @ factor.T
    xi = [0.0, 0.3, 1.0]
    found = cc.shape_deviations(WING, q, covariance, xi)
    samples = q + rng.normal(size=(2000, 6)) @ factor.T
    symbol = ca.MX.sym("q", 6)
    poses = [cc.pose_at(WING, symbol, x) for x in xi]
    outputs = [ca.veccat(*(p.position for p in poses)), ca.veccat(*(p.rotation for p in poses))]
    positions, rotations = (
        m.full().T for m in ca.Function("poses", [symbol], outputs).map(2000)(samples.T)
    )
    positions, rotations = positions.reshape(-1, 3, 3), rotations.reshape(-1, 3, 3, 3)
    # Two thousand samples estimate a deviation to 1.6 %; three of these.
    assert_allclose(found.position, positions.std(axis=0).T, rtol=0.05, atol=1e-12)
    exact = [cc.pose_at(WING, q, x).rotation.full() for x in xi]
    turned = np.einsum("kji,nklj->nkil", exact, rotations)  # columns come first
    angles = np.stack([turned[..., 2, 1], turned[..., 0, 2], turned[..., 1, 0]], axis=-1)
    assert_allclose(found.attitude, angles.std(axis=0).T, rtol=0.05, atol=1e-12)
    assert_allclose(found.distance**2, np.sum(found.position**2, axis=0))


# Placement -------------------------------------------------------------------------------------


def test_greedy_reaches_95_percent_of_the_optimum_4_of_40():
    greedy = cc.place_sensors(WING, FORTY, 4, shapes=SHAPES, prior=PRIOR)
    exact = cc.place_sensors(WING, FORTY, 4, shapes=SHAPES, prior=PRIOR, method="exact")
    assert 0.95 * exact.gain <= greedy.gain <= exact.gain + 1e-9
    assert exact.gain <= greedy.bound
    # What the greedy choice itself knows of its quality, better than 1 - 1/e.
    assert 1 - 1 / np.e < greedy.guarantee <= greedy.gain / exact.gain
    assert exact.guarantee == 1


def test_the_gain_is_that_of_the_chosen_sensors():
    placed = cc.place_sensors(WING, FORTY, 3, shapes=SHAPES, prior=PRIOR)
    assert placed.sensors == tuple(FORTY[i] for i in placed.indices)
    assert placed.gain == pytest.approx(gain(placed.sensors), rel=1e-10)
    assert sorted(placed.order) == list(placed.indices)
    first = max(range(40), key=lambda i: gain([FORTY[i]]))
    assert placed.order[0] == first


@pytest.mark.parametrize("k", [1, 2, 3])
def test_exact_is_the_best_of_all_sets(k):
    placed = cc.place_sensors(WING, FEW, k, shapes=SHAPES, prior=PRIOR, method="exact")
    informations = [cc.information_matrix(WING, [sensor], SHAPES) for sensor in FEW]

    def determinant(chosen):
        return np.linalg.det(np.eye(6) + PRIOR**2 * sum(informations[i] for i in chosen))

    best = max(combinations(range(10), k), key=determinant)
    assert placed.indices == best


COSTS = np.array([3.0, 1.0, 2.5, 4.0, 0.3, 0.2, 0.4, 1.5, 1.0, 2.0])


@pytest.mark.parametrize("budget", [0.4, 1.0, 2.0, 4.1, 7.0])
@pytest.mark.parametrize("k", [None, 2])
def test_a_budget_is_kept_and_its_bound_holds(budget, k):
    options = {"shapes": SHAPES, "prior": PRIOR, "costs": COSTS, "budget": budget}
    sets = [
        s
        for size in range(1, 11 if k is None else k + 1)
        for s in combinations(range(10), size)
        if COSTS[list(s)].sum() <= budget + 1e-12
    ]
    greedy = cc.place_sensors(WING, FEW, k, **options)
    exact = cc.place_sensors(WING, FEW, k, **options, method="exact")
    informations = [cc.information_matrix(WING, [s], SHAPES) for s in FEW]

    def of(s):
        return np.linalg.slogdet(np.eye(6) + PRIOR**2 * sum(informations[i] for i in s))[1]

    assert exact.gain == pytest.approx(max(map(of, sets)), rel=1e-10)
    assert greedy.cost <= budget + 1e-12 and exact.cost <= budget + 1e-12
    assert (
        (1 - 1 / np.e) / 2 * exact.gain <= greedy.gain <= exact.gain + 1e-9 <= greedy.bound + 2e-9
    )


def test_gain_over_cost_alone_can_be_arbitrarily_bad_and_is_mended():
    """A gauge of next to no cost has the larger ratio, and leaves no room for the other."""
    gauge = cc.StrainGauge(xi=0.5, offset=[0, 0.05], noise=1e-2)
    candidates, costs = [gauge, attitude(1.0)], [1e-6, 10.0]
    placed = cc.place_sensors(
        WING, candidates, shapes=SHAPES, prior=PRIOR, costs=costs, budget=10.0
    )
    assert placed.indices == (1,)


def test_sensors_that_are_bought_together_are_one_candidate():
    xi = np.linspace(0.2, 1, 5)
    units = [[cc.RateGyro(xi=x, **IMU), cc.Accelerometer(xi=x, **IMU)] for x in xi]
    placed = cc.place_sensors(
        WING,
        units,
        2,
        shapes=SHAPES,
        rates=RATES,
        unknowns=("q", "q_dot"),
        prior=PRIOR,
        root=GRAVITY,
    )
    assert len(placed.indices) == 2 and len(placed.sensors) == 4
    assert placed.sensors[:2] == tuple(units[placed.indices[0]])
    assert placed.weight_deviations.shape == (6,)
    assert cc.measure(placed.sensors, WING, ca.DM(6, 1), ca.DM(6, 1), root=GRAVITY).values.numel()


def test_expected_deviations_are_those_of_fits_with_the_chosen_sensors():
    placed = cc.place_sensors(WING, FORTY, 4, shapes=SHAPES[0], prior=PRIOR)
    exact = cc.measure(placed.sensors, WING, ca.DM(SHAPES[0])).values
    fit = cc.fit_shape(WING, placed.sensors, exact, prior=(SHAPES[0], PRIOR))
    # Both are the inverse of the same matrix.
    assert_allclose(placed.weight_deviations, fit.deviations, rtol=1e-7)
    along = cc.shape_deviations(WING, SHAPES[0], fit.covariance)
    assert_allclose(placed.deviations.position, along.position, rtol=1e-7, atol=1e-12)
    assert np.all(placed.deviations.distance <= placed.prior_deviations.distance)
    assert_allclose(placed.prior_weight_deviations, PRIOR)


def test_what_chosen_sensors_do_not_see_is_told():
    gauges = [
        cc.StrainGauge(xi=xi, offset=[y, 0.05], noise=1e-6)
        for xi in (0.1, 0.5)
        for y in (-0.1, 0.1)
    ]
    placed = cc.place_sensors(WING, gauges, 4, shapes=SHAPES, prior=PRIOR)
    assert [words.split(":")[0] for words in placed.unseen] == ["torsion", "torsion"]
    assert "not seen by these sensors, the prior holds them" in str(placed)
    # The prior is all that is known of them.
    assert_allclose(placed.weight_deviations[:2], PRIOR, rtol=1e-12)


def test_the_summary_tells_places_gain_and_quality():
    text = str(cc.place_sensors(WING, FORTY, 2, shapes=SHAPES, prior=PRIOR, costs=2, budget=5))
    assert "at a cost of 4" in text and "% of the optimum" in text and "nats" in text
    assert "standard deviation of the tip" in text and "torsion: Legendre 0" in text
    assert "of the optimum of 40 candidates" in text


def test_the_summary_tells_sensors_at_one_station_apart():
    rear = replace(FORTY[20], name="rear")
    pairs = [[attitude(1.0), rear], [FORTY[29]]]
    text = str(cc.place_sensors(WING, pairs, 2, shapes=SHAPES, prior=PRIOR, method="exact"))
    first, second, *_ = text.splitlines()
    assert first == "candidates 0 (attitude at xi = 1, rear at xi = 0.02), 1 (strain at xi = 0.9)"
    assert second.endswith("nats over the prior, the optimum of 2 candidates")


# The figure ------------------------------------------------------------------------------------


def test_the_figure_shows_chosen_sensors_and_deviations_with_units():
    placed = cc.place_sensors(WING, FORTY, 4, shapes=SHAPES, prior=PRIOR)
    above, middle, below = plot_placement(WING, placed).axes
    assert [axes.get_ylabel() for axes in (middle, below)] == ["position [m]", "attitude [rad]"]
    assert "[m]" in above.get_xlabel() and "[-]" in below.get_xlabel()
    by_label = {str(line.get_label()): line for line in above.get_lines()}
    offered = {s.xi for s in FORTY}
    assert len(by_label["candidates"].get_xdata()) == len(offered)
    chosen = [
        len(line.get_xdata())
        for name, line in by_label.items()
        if name in ("attitude", "strain", "marker")
    ]
    assert sum(chosen) == 4
    drawn = middle.get_lines()[0].get_ydata()
    assert_allclose(drawn, placed.deviations.distance[1:])


# Refusals --------------------------------------------------------------------------------------


def place(candidates=FEW, k=2, **fields):
    return cc.place_sensors(WING, candidates, k, **{"shapes": SHAPES, "prior": PRIOR, **fields})


MISTAKES = {
    "no beam": (
        lambda: cc.place_sensors(None, FEW, 2, shapes=SHAPES, prior=PRIOR),
        "beam: expected a Beam",
    ),
    "no candidates": (lambda: place([]), "candidates: expected one or more"),
    "one sensor": (lambda: place(FEW[0]), "candidates: expected a sequence of sensors"),
    "a number": (lambda: place([FEW[0], 3]), r"candidates\[1\]: sensors: expected a sequence"),
    "an empty group": (lambda: place([FEW[0], []]), r"candidates\[1\]: .* one or more, found none"),
    "too many": (lambda: place(k=11), "k: expected at most the 10 candidates, found 11"),
    "none": (lambda: place(k=0), "k: expected a whole number of at least 1, found 0"),
    "neither": (lambda: place(k=None), "k: expected a number of candidates, or a budget"),
    "no costs": (lambda: place(budget=3.0), "costs: expected numbers where a budget is given"),
    "costs of others": (
        lambda: place(costs=[1, 2], budget=3),
        "costs: expected 1 or 10 numbers above zero",
    ),
    "free": (lambda: place(costs=0, budget=3), "costs: expected 1 or 10 numbers above zero"),
    "a small budget": (
        lambda: place(costs=COSTS, budget=0.1),
        "budget: expected at least 0.2, the cheapest candidate, found 0.1",
    ),
    "no method": (
        lambda: place(method="best"),
        "method: expected one of 'greedy', 'exact'; found 'best'",
    ),
    "too many sets": (
        lambda: place(FORTY, 6, method="exact"),
        "'exact' tries at most 200000 sets, 6 of 40 candidates are 3838380 sets; use 'greedy'",
    ),
    "too many affordable sets": (
        lambda: place(FORTY, None, costs=1, budget=20, method="exact"),
        "'exact' tries at most 200000 sets, 40 candidates have more sets within the budget",
    ),
    "shapes of another basis": (
        lambda: place(shapes=np.zeros((3, 5))),
        r"shapes: expected shape \(S, 6\) or \(6,\), found \(3, 5\)",
    ),
    "shapes beyond the bounds": (
        lambda: place(shapes=np.ones((2, 6))),
        r"shapes\[0\]\[0\] .* expected within Beam.weight_bounds",
    ),
    "rates of other shapes": (
        lambda: place(rates=np.zeros((2, 6))),
        "rates: expected one row for each of the 6 shapes, found 2",
    ),
    "unknown unknowns": (
        lambda: place(unknowns=("q_dot",)),
        r"unknowns: expected \('q',\) or \('q', 'q_dot'\)",
    ),
    "no prior": (lambda: place(prior=0), "prior: expected standard deviations above zero"),
    "a prior of another size": (
        lambda: place(prior=np.eye(5)),
        r"prior: expected a standard deviation, 6 of them or a covariance \(6, 6\)",
    ),
    "covariance of another size": (
        lambda: cc.shape_deviations(WING, SHAPES[0], np.eye(5)),
        r"covariance: expected shape \(6, 6\), found \(5, 5\)",
    ),
    "station off the beam": (
        lambda: cc.shape_deviations(WING, SHAPES[0], np.eye(6), [1.2]),
        r"stations: expected a number in \[0, 1\]",
    ),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_mistakes_are_named(name):
    call, message = MISTAKES[name]
    with pytest.raises(ValueError, match=message):
        call()
