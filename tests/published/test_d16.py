"""Published case D16: a wing with a tip store, bent by its weight and by lift.

D. Tang and E. H. Dowell, AIAA J. 39(8), 2001; frequencies at an airspeed of A. Arena and
W. Lacarbonara, 2013, digitised in AeroBeams.jl.
"""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

import curvcasadi as cc
from tests.support.strip_wings import tang_dowell


@pytest.fixture(scope="module")
def model(published):
    return cc.wing_model(
        tang_dowell(published("D16")), density=1.225, gravity=9.807, outputs=("tip_position",)
    )


def sweep(model, degrees, speeds):
    return cc.flutter(model, speeds, p={"pitch": np.radians(degrees)})


def test_frequencies_at_an_airspeed(model, published):
    rows = published("D16")["reference"]["aeroelastic_frequencies_1deg_Arena_Lacarbonara"]
    found = sweep(model, 1.0, rows["U"])
    assert found.success
    for name, limit in (("torsion", 0.02), ("chord", 0.025)):
        expected = 2 * np.pi * np.array(rows[name])
        apart = np.where(found.roots.imag > 0, np.abs(found.roots), np.inf) / expected[:, None] - 1
        assert_allclose(np.abs(apart).min(axis=1), 0, atol=limit, err_msg=name)


@pytest.mark.parametrize("degrees", [1.0, 2.2])
def test_deflection_under_weight_and_lift(degrees, model, published):
    rows = published("D16")["reference"][f"tip_z_{degrees:g}deg_theory"]
    found = sweep(model, degrees, rows["U"])
    heights = [
        -float(model.output(x, [], [speed, np.radians(degrees)])[2])
        for speed, x in zip(found.speeds, found.equilibria, strict=True)
    ]
    assert_allclose(heights, rows["m"], atol=0.012)  # as the file says
