"""Samples reach a controller noisy, late, and not all of them."""

import numpy as np
import pytest

import curvcasadi as cc


def arrivals(calls, **options):
    link = cc.SensorLink(**options)
    return [link(np.full((len(options.get("seeds", (0,))), 2), float(k))) for k in range(calls)]


def test_samples_are_late():
    found = arrivals(5, noise=0.0, delay=2)
    assert found[:2] == [None, None]
    np.testing.assert_array_equal(found[2:], [[[0, 0]], [[1, 1]], [[2, 2]]])


def test_noise_and_loss_are_as_large_as_asked_for():
    found = np.array(arrivals(20_000, noise=[0.1, 2.0], loss=0.05))[:, 0]
    errors = found - np.arange(20_000)[:, None]
    # Three standard deviations of each statistic.
    assert np.mean(np.isnan(found), axis=0) == pytest.approx([0.05, 0.05], abs=0.005)
    np.testing.assert_allclose(np.nanstd(errors, axis=0), [0.1, 2.0], rtol=0.016)


def test_lanes_of_a_seed_are_alike_whatever_flies_beside_them():
    two = np.array(arrivals(50, noise=1.0, loss=0.1, seeds=(7, 3)))
    three = np.array(arrivals(50, noise=1.0, loss=0.1, seeds=(3, 5, 7)))
    np.testing.assert_array_equal(two, three[:, [2, 0]])
    assert not np.array_equal(two[:, 0], two[:, 1], equal_nan=True)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"noise": -1.0}, "noise: expected numbers of at least zero"),
        ({"noise": 1.0, "delay": -1}, "delay: expected"),
        ({"noise": 1.0, "delay": 0.5}, "delay: expected"),
        ({"noise": 1.0, "loss": 1.0}, "loss: expected a share"),
        ({"noise": 1.0, "seeds": ()}, "seeds: expected a seed for each lane"),
        ({"noise": 1.0, "seeds": (0.5,)}, "seeds: expected"),
    ],
)
def test_mistakes_are_named(options, words):
    with pytest.raises(ValueError, match=words):
        cc.SensorLink(**options)


def test_readings_of_other_lanes_are_refused():
    link = cc.SensorLink(noise=[0.1, 0.1], seeds=(0, 1))
    for values in (np.zeros(2), np.zeros((1, 2)), np.zeros((2, 3))):
        with pytest.raises(ValueError, match="values: expected shape"):
            link(values)
