"""Figures of flutter sweeps show growth, frequency and roots."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

import curvcasadi as cc
from curvcasadi.plotting import plot_flutter, plot_root_locus
from tests.support.strip_wings import hale


@pytest.fixture(scope="module")
def sweep():
    lag = cc.IndicialLag(poles=2, modes=2)
    model = cc.wing_model(hale((2, 2, 0), 3), density=0.0889, gravity=0.0, lag=lag, outputs=())
    return cc.flutter(model, np.arange(20, 40, 2.0), p={"pitch": 0.0})


def test_growth_and_frequency_over_the_airspeed(sweep):
    growth, frequency = plot_flutter(sweep).axes
    curves = [line for line in growth.get_lines() if len(line.get_xdata()) == len(sweep.speeds)]
    assert len(curves) == np.count_nonzero(np.any(sweep.roots.imag > 0, axis=0))
    # One of them crosses zero between the speeds about flutter.
    k = np.searchsorted(sweep.speeds, sweep.speed)
    crossing = [line.get_ydata()[k - 1] < 0 < line.get_ydata()[k] for line in curves]
    assert sum(crossing) == 1
    marks = [line for line in frequency.get_lines() if line.get_marker() == "o"]
    assert_allclose(marks[0].get_ydata(), sweep.frequency / (2 * np.pi))
    assert "m/s" in frequency.get_xlabel() and "Hz" in frequency.get_ylabel()


def test_the_root_locus_crosses_the_axis_at_the_flutter_frequency(sweep):
    axes = plot_root_locus(sweep, 3).axes[0]
    (mark,) = (line for line in axes.get_lines() if line.get_marker() == "o")
    assert_allclose(mark.get_xydata(), [[0, sweep.frequency]])
    assert len(axes.collections) == 3


def test_figures_of_something_else_are_refused(sweep):
    with pytest.raises(ValueError, match="flutter: expected"):
        plot_flutter(sweep.roots)
    with pytest.raises(ValueError, match="number"):
        plot_root_locus(sweep, 0)
