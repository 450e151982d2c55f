"""A figure of mode shapes shows what the modes hold."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

import curvcasadi as cc
from curvcasadi.plotting import plot_modes
from curvcasadi.reference_wings import hale_wing


def test_modes_are_drawn_over_the_span_with_their_frequencies():
    modes = cc.vibration_modes(hale_wing(2, 3, 2))
    figure = plot_modes(modes, 3)
    flap, _, twist = figure.axes
    labels = [line.get_label() for line in flap.get_lines()]
    assert labels == [f"{w:.4g} rad/s" for w in modes.frequencies[:3]]
    first = flap.get_lines()[0]
    assert_allclose(first.get_xdata(), modes.stations)
    # The first mode of this wing is flap: its largest motion is that of the tip.
    assert_allclose(np.max(np.abs(first.get_ydata())), 1.0)
    # The third is torsion.
    assert_allclose(np.max(np.abs(twist.get_lines()[2].get_ydata())), 1.0)


def test_a_number_of_modes_below_one_is_refused():
    with pytest.raises(ValueError, match="number"):
        plot_modes(cc.vibration_modes(hale_wing(2, 3, 2)), 0)
