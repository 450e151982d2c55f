"""Figures of simulations."""

from __future__ import annotations

import numpy as np
import pytest

import curvcasadi as cc
from curvcasadi.reference_wings import hale_wing


def test_axes_say_of_what_each_part_is():
    model = cc.kinematic_model(hale_wing(torsion=1, out_of_plane=1, in_plane=1), time_constant=1.0)
    found = cc.simulate(model, [0.0, -0.02, 0.0], np.linspace(0, 1, 5))
    figure = cc.plot_motion(found, ["position", "q"])
    # The output "position" is the tip's, which its label says.
    assert [axes.get_ylabel() for axes in figure.axes] == ["tip position [m]", "q [rad/m]"]
    np.testing.assert_array_equal(figure.axes[0].lines[2].get_ydata(), found.part("position")[2])
    with pytest.raises(ValueError, match="parts: expected one or more names"):
        cc.plot_motion(found, [])
