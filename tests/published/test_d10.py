"""Published case D10: flutter of the HALE wing about its shape under a tip load, and in flight.

M. J. Patil, D. H. Hodges, C. E. S. Cesnik, J. Aircraft 38(1), 2001, digitised in AeroBeams.jl: the
tip load (B) or the root angle (C) bends the wing, and bending lowers its flutter speed.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

import curvcasadi as cc
from tests.support.strip_wings import hale

WING = hale((4, 4, 3), 8)
SPEEDS = np.arange(10, 35)


@pytest.fixture(scope="module")
def model():
    return cc.wing_model(WING, density=0.0889, gravity=9.8, outputs=())


@pytest.mark.parametrize("degrees", [0.8055, 1.5422, 2.9077, 4.2043])
def test_flutter_about_the_bent_wing(degrees, model, published):
    rows = published("D10")["reference"]
    speeds, frequencies, tips = (
        rows[key]
        for key in (
            "C_flutter_speed_vs_root_angle",
            "C_flutter_freq_vs_root_angle",
            "C_tip_disp_at_flutter",
        )
    )
    found = cc.flutter(model, SPEEDS, p={"pitch": np.radians(degrees)})
    expected = np.interp(degrees, speeds["deg"], speeds["speed"])
    assert_allclose(found.speed, expected, rtol=0.02)
    frequency = np.interp(degrees, frequencies["deg"], frequencies["rad_s"])
    assert_allclose(found.frequency, frequency, rtol=0.04)
    q = found.equilibrium[model.x.slices["q"]]
    tip = cc.shape_map(WING.beam, q).tip.position
    # Digitised; the axis of his tip displacements is some 10 to 17 % short.
    assert_allclose(-float(tip[2]), np.interp(degrees, tips["deg"], tips["m"]), rtol=0.2)
    assert found.linearizations <= 3 * len(SPEEDS)


@pytest.mark.parametrize("load", [0.27782, 15.781, 39.688])
def test_flutter_of_the_curved_wing_under_a_tip_load(load, published):
    rows = published("D10")["reference"]["B_flutter_speed_vs_tip_load_N"]
    beam = replace(WING.beam, initial_curvature=[0, 0.018, 0])  # downward
    wing = replace(WING, beam=beam, loads=(cc.PointForce(1.0, [0, 0, -load], frame="dead"),))
    model = cc.wing_model(wing, density=0.0889, gravity=0.0, outputs=())
    found = cc.flutter(model, np.arange(15, 36, 4.0), p={"pitch": 0.0})
    assert_allclose(found.speed, rows["speed"][rows["load"].index(load)], rtol=0.05)
